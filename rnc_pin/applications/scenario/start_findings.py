"""Knowledge about the model of a scenario before any run: findings at its start, and warnings as data."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

import numpy as np

from rnc_pin.analysis import wheel_height_findings
from rnc_pin.applications.scenario.schema import ScenarioFile
from rnc_pin.errors import ModelWarning
from rnc_pin.model import ReducedModel
from rnc_pin.verdict import Finding, Severity


def start_findings(scenario: ScenarioFile, reduced: ReducedModel, q0: np.ndarray) -> tuple[Finding, ...]:
    """Compare the radii of wheels with their heights and shapes at the initial configuration (nq,).

    The height of the ground is that of ``view.ground``, if the scenario states one; constraints may name their own.
    """
    ground = scenario.view.ground
    return wheel_height_findings(reduced, q0, None if isinstance(ground, str) else ground)


def warnings_of(findings: Iterable[Finding]) -> tuple[str, ...]:
    """Messages of the findings that are more than a note."""
    return tuple(str(each) for each in findings if each.severity is not Severity.NOTE)


@contextmanager
def collected_model_warnings(show: bool) -> Iterator[list[str]]:
    """Collect the texts of ``ModelWarning``, each once. Other warnings are shown as usual.

    Args:
        show: True to show those of models afterwards too.
    """
    texts: list[str] = []
    told: list[warnings.WarningMessage] = []
    try:
        with warnings.catch_warnings(record=True) as found:
            warnings.simplefilter("always", ModelWarning)
            yield texts
            told = found
    finally:
        for each in told:
            of_model = issubclass(each.category, ModelWarning)
            if of_model and str(each.message) not in texts:
                texts.append(str(each.message))
            if show or not of_model:
                warnings.warn_explicit(each.message, each.category, each.filename, each.lineno)
