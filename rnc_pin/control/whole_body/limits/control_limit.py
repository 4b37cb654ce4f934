"""Base of the limits of whole-body control: rows ``lower <= J v <= upper`` that a program respects."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from numpy import ndarray as Array

from rnc_pin.array_shapes import Float, Int
from rnc_pin.control.whole_body.control_sample import ControlSample
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

    @abstractmethod
    def bind(self, reduced: ReducedModel) -> BoundLimit:
        """Return the limit of a model, with all names resolved.

        Raises:
            ModelError: a joint or frame does not exist.
            ConfigurationError: the settings do not fit the model.
        """
