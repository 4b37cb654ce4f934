"""Base of the limits of whole-body control, rows ``lower <= J v <= upper``, and decelerations that efforts allow."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np
from numpy import ndarray as Array

from rnc_pin.array_shapes import Float, Int
from rnc_pin.control.whole_body.control_sample import ControlSample
from rnc_pin.model.parameter_types import check_settings
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.state_evaluation import StateEvaluation


class LimitRows(NamedTuple):
    """Rows of a limit at one sample: ``lower <= J v <= upper`` for the velocity at the end of the sample."""

    jacobian: Float[Array, "k nv"]
    """Jacobian J on the full velocity; the program multiplies it by R."""
    lower: Float[Array, " k"]
    """Lower bounds; -inf for rows without one."""
    upper: Float[Array, " k"]
    """Upper bounds; inf for rows without one."""
    places: Int[Array, " k"] | None = None
    """Indices of these rows among the names of the limit, if the other rows are idle; None if no row is left out."""


class BoundLimit(ABC):
    """Limit of one model.

    Attributes:
        names: name of each row, (k,), e.g. "elbow position".
        averaged: True if the bounds hold for the mean velocity over the sample too.
    """

    names: tuple[str, ...]
    averaged: ClassVar[bool] = False

    @abstractmethod
    def rows(self, sample: ControlSample) -> LimitRows:
        """Return the rows at the end of a sample. An idle row has infinite bounds, or is not among ``places``."""

    def exceeded_by(
        self, state: StateEvaluation, time: float, mean: Float[Array, " nv"] | None = None
    ) -> Float[Array, " k"] | None:
        """Return the amount by which a state exceeds each limit, negative or zero for the others.

        Rows can be stricter than a limit: they plan to stop in time. By default, None: a state exceeds the limit if
        its velocity violates the rows of the sample that led to it.

        Args:
            state: the state.
            time: its time [s].
            mean: mean velocity over the sample that led to it; None for a start.
        """
        return None


@dataclass(frozen=True, kw_only=True)
class ControlLimit(ABC):
    """Limit of whole-body control: a description without a model.

    To add a limit, derive a frozen dataclass with its settings and a ``bind`` method.

    Args:
        priority: order in which limits give way if they exclude each other: the largest number first. Hard limits never
            give way to others.

    Attributes:
        hard: True for limits that are never softened in favour of others. They have to allow zero velocity.
    """

    hard: ClassVar[bool] = False

    priority: int = 0

    def __post_init__(self) -> None:
        check_settings(self)

    @abstractmethod
    def bind(self, reduced: ReducedModel) -> BoundLimit:
        """Return the limit of a model, with all names resolved.

        Raises:
            ModelError: a joint or frame does not exist.
            ConfigurationError: the settings do not fit the model.
        """


# ------------------------------------------------------------------ decelerations

_BRAKING = 0.5  # share of the efforts that may be planned for stopping
_LEAST = 0.1  # of that deceleration remains where gravity takes more
_NO_EFFECT = 1e-9  # [m/s^2 or rad/s^2 per N m] below which an actuator does not change a row


class PlannedBraking:
    """Half of the efforts of a model, less the load at a state: gravity, velocity products and passive forces.

    The other half is left for other rows that brake at the same time, and for a load that grows while the robot stops.
    """

    def __init__(self, reduced: ReducedModel) -> None:
        efforts = reduced.actuation.limits
        self._unlimited = np.flatnonzero(~np.isfinite(efforts))
        self._efforts = np.where(np.isfinite(efforts), _BRAKING * efforts, 0.0)
        self._any = bool(self._efforts.any())

    def decelerations(self, jacobian: Float[np.ndarray, "k nv"], state: StateEvaluation) -> Float[np.ndarray, " k"]:
        """Accelerations (k,) of rows [m/s^2 or rad/s^2] in their positive direction; infinite without limits."""
        if not (self._any and len(jacobian)):
            return np.full(len(jacobian), np.inf)
        effects, adverse = state.row_accelerations(jacobian @ state.R)
        effects = np.abs(effects)
        planned = effects @ self._efforts
        found = np.maximum(planned + np.minimum(adverse, 0.0), _LEAST * planned)
        found[planned <= _NO_EFFECT] = np.inf
        if len(self._unlimited):
            found[(effects[:, self._unlimited] > _NO_EFFECT).any(axis=1)] = np.inf
        return found
