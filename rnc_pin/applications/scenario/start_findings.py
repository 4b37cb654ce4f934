"""Findings about the model of a scenario at its start, before any run."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from rnc_pin.analysis import wheel_height_findings
from rnc_pin.applications.scenario.schema import ScenarioFile
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
