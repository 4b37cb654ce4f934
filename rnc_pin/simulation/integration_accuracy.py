"""Estimated error of the integration of a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from rnc_pin.errors import DivergenceError
from rnc_pin.plants import Plant
from rnc_pin.plants.reduced import IntegrationErrors
from rnc_pin.printing import printed

_LINEAR = 1.0  # error of an angle above which its propagation is not linear [rad]
_NONLINEAR = "the motion lets it grow until a linear propagation means nothing"
_AT_FAULT = 0.01  # estimated error of the velocities, relative to their size, from which the integrator diverges


@printed()
@dataclass(frozen=True)
class IntegrationAccuracy:
    """Estimated error of the integration of a run.

    Errors are the largest of the entries of configuration and velocity with the same unit. If ``linearized``, they were
    propagated along the run: the motion lets them grow or fade, and so does the feedback of the controller. Otherwise
    the inputs count as given: errors of the velocity go on as errors of the position, and nothing else changes them.

    Attributes:
        tolerance: largest error per second that the plant allows [m, rad, m/s or rad/s].
        rate: largest error of a sample per second.
        substeps: largest number of integration steps in a sample.
        enough: number that the tolerance asks for.
        local: largest error of a sample by unit.
        accumulated: error accumulated over the run by unit; its largest value if ``linearized``.
        linearized: True if errors were propagated along the motion and its feedback.
        unknown: reason why no accumulated error is stated; empty if it is.
    """

    tolerance: float
    rate: float
    substeps: int
    enough: int
    local: Mapping[str, float] = field(default_factory=dict)
    accumulated: Mapping[str, float] = field(default_factory=dict)
    linearized: bool = False
    unknown: str = ""

    @classmethod
    def of_errors(
        cls,
        errors: IntegrationErrors,
        tolerance: float,
        units: Sequence[str],
        propagated: np.ndarray | None = None,
        unknown: str = "",
    ) -> IntegrationAccuracy:
        """Return the accuracy for estimated errors.

        Args:
            errors: the errors.
            tolerance: largest error per second that the plant allows.
            units: units of the entries of the velocity (nv,).
            propagated: errors (2 nv,) that were propagated along the motion, if they are known.
            unknown: reason why the accumulated errors are not known.
        """
        now, all_units = errors.folded(), [*(unit.removesuffix("/s") for unit in units), *units]
        local, accumulated = (
            {unit: max(float(value) for value, own in zip(values, all_units, strict=True) if own == unit)
             for unit in dict.fromkeys(all_units)}
            for values in (now.largest, now.past if propagated is None else propagated)
        )  # fmt: skip
        if propagated is not None and not (accumulated.get("rad", 0.0) < _LINEAR and np.isfinite(propagated).all()):
            unknown = _NONLINEAR
        linearized = propagated is not None and not unknown
        most, enough = now.most, max(now.enough, now.most)
        accumulated = {} if unknown else accumulated
        return cls(tolerance, float(now.rate), most, enough, local, accumulated, linearized, unknown)

    @classmethod
    def together(cls, parts: Sequence[IntegrationAccuracy | None]) -> IntegrationAccuracy | None:
        """Return the accuracy of a run of several parts; None if one part has none."""
        found = [each for each in parts if each is not None]
        if not found or len(found) < len(parts):
            return None
        units, unknown = found[0].local, next((each.unknown for each in found if each.unknown), "")
        return cls(
            max(each.tolerance for each in found),
            max(each.rate for each in found),
            max(each.substeps for each in found),
            max(each.enough for each in found),
            {unit: max(each.local[unit] for each in found) for unit in units},
            {unit: sum(each.accumulated[unit] for each in found) for unit in units if not unknown},
            all(each.linearized for each in found),
            unknown,
        )

    @property
    def is_kept(self) -> bool:
        """True if no sample exceeds the tolerance."""
        return self.rate <= self.tolerance

    @property
    def remedy(self) -> str:
        """Number of substeps that keeps the tolerance, in words."""
        if self.enough == self.substeps:
            return f"{self.substeps} substeps do not suffice: reduce the sampling period"
        return f"substeps {self.substeps} is too small: remove it, or set {self.enough}"


def blamed(error: DivergenceError, plant: Plant, v: np.ndarray) -> DivergenceError:
    """Return an error of a motion at velocity v (nv,) that says whether the integrator diverges, and not the robot."""
    errors: IntegrationErrors | None = getattr(plant, "errors", None)
    if errors is None or errors.enough <= errors.most:
        return error
    estimated = errors.folded().past[len(v) :].max(initial=0.0)
    if estimated > _AT_FAULT * np.abs(v).max(initial=0.0):
        what = f"the integrator, not the robot: {error.what}; substeps {errors.most} is too small, set {errors.enough}"
        return DivergenceError(what, time=error.time)
    return error
