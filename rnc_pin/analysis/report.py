"""Everything there is to know about a reduced system before it is controlled."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from rnc_pin.analysis.growth import growth_vector
from rnc_pin.analysis.lemma_1 import lemma_1_residuals
from rnc_pin.analysis.redundancy import classify
from rnc_pin.errors import SingularityError
from rnc_pin.independence import DroppedRow
from rnc_pin.reduction import ReducedModel
from rnc_pin.task import Task

_GROWTH_SAMPLES = 3
_LEMMA_TOLERANCE = 1e-6


@dataclass(frozen=True)
class Report:
    """What ``analyze`` found.

    Attributes:
        n, r, p: degrees of freedom, reducing outputs, actuators.
        rank: independent constraint rows, m.
        kept_rows, dropped_rows: constraint rows, the latter with reasons.
        growth_vector: dimensions of span(R) and its brackets, level by level.
        completely_nonholonomic: whether they reach n.
        redundancy_class: "1", "2", "2s" or None for the task.
        redundancy: x11 (``tracked``), x12 (``driven``), and the evidence.
        actuation_rank: smallest rank of ``R^T B``; below r not every F can be realised.
        condition: min, median and max condition number of E with unit rows.
        singular_samples: how many sampled configurations were singular, of ``samples``.
        lemma1: worst residuals of Lemma 1.
        lemma1_holds: whether they are all at the level of rounding and differencing.
    """

    n: int
    r: int
    p: int
    rank: int
    kept_rows: tuple[str, ...]
    dropped_rows: tuple[DroppedRow, ...]
    growth_vector: tuple[int, ...]
    completely_nonholonomic: bool
    redundancy_class: str | None
    redundancy: dict[str, Any]
    actuation_rank: int
    condition: dict[str, float]
    samples: int
    singular_samples: int
    lemma1: dict[str, float]
    lemma1_holds: bool

    def to_dict(self) -> dict[str, Any]:
        """Plain lists, numbers and strings, ready for JSON."""
        content = asdict(self)
        for name in ("growth_vector", "kept_rows", "dropped_rows"):
            content[name] = list(content[name])
        return content


def analyze(
    reduced: ReducedModel,
    primary: Sequence[str] | None = None,
    redundant: Sequence[str] = (),
    samples: int = 64,
    seed: int = 0,
) -> Report:
    """Analyse a reduced system at seeded random configurations.

    Args:
        reduced: the model.
        primary: names of the reducing outputs that the task names; all that are not redundant by default.
        redundant: names of those that it leaves free.
        samples: how many configurations.
        seed: of the random configurations.

    Raises:
        ConfigurationError: unknown output names.
        SingularityError: every sampled configuration is singular.
    """
    if primary is None:
        primary = [name for name in reduced.reducing.names if name not in redundant]
    task = Task.of(reduced, primary, redundant)
    generator = np.random.default_rng(seed)
    regular, failure = [], None
    for _ in range(samples):
        q = reduced.robot.random_configuration(generator)
        try:
            reduced.inertia(q)
            regular.append(q)
        except SingularityError as error:
            failure = error
    if not regular:
        assert failure is not None
        raise failure
    configurations = np.stack(regular)
    conditions = np.asarray(reduced.condition(configurations))
    # Next to a singular configuration differences say little: what holds is decided on the better half.
    good = configurations[conditions <= np.median(conditions)]
    best = configurations[np.argsort(conditions)[:_GROWTH_SAMPLES]]
    growth = max(growth_vector(reduced, q) for q in best)
    redundancy = classify(reduced, task, good, seed)
    lemma = lemma_1_residuals(reduced, good, seed)
    held = max(lemma[name] for name in ("A R", "H - H^T", "Hdot - V - V^T", "V linear")) < _LEMMA_TOLERANCE
    ranks = np.linalg.matrix_rank(reduced.input_matrix(configurations), rtol=1e-10) if reduced.p else np.zeros(1)
    return Report(
        n=reduced.n,
        r=reduced.r,
        p=reduced.p,
        rank=reduced.m,
        kept_rows=reduced.constraints.names,
        dropped_rows=reduced.dropped_rows,
        growth_vector=growth,
        completely_nonholonomic=growth[-1] == reduced.n,
        redundancy_class=redundancy.redundancy_class,
        redundancy={"tracked": redundancy.tracked, "driven": redundancy.driven, **redundancy.evidence},
        actuation_rank=int(np.min(ranks)),
        condition={
            "min": float(conditions.min()),
            "median": float(np.median(conditions)),
            "max": float(conditions.max()),
        },
        samples=samples,
        singular_samples=samples - len(regular),
        lemma1=lemma,
        lemma1_holds=bool(held and lemma["smallest eigenvalue of H"] > 0),
    )
