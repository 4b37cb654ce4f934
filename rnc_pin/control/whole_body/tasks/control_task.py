"""Base of the tasks of whole-body control: rows ``J v = rate`` that a program satisfies as well as it can."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy import ndarray as Array

from rnc_pin.array_shapes import Float
from rnc_pin.control.whole_body.control_sample import ControlSample
from rnc_pin.errors import ConfigurationError
from rnc_pin.model.reduced_model import ReducedModel


class TaskRows(NamedTuple):
    """Rows of a task at one sample: the program minimises ``weight (J v - rate)^2`` of each."""

    jacobian: Float[Array, "k nv"]
    """Jacobian J on the full velocity at the end of the sample; the program multiplies it by R."""
    rate: Float[Array, " k"]
    """Desired rate."""


class BoundTask(ABC):
    """Task of one model.

    Attributes:
        names: name of each row, (k,).
        goal_names: names of the outputs that ``goal`` describes; empty if there are none.
        constant: True if the Jacobian on the full velocity does not depend on the configuration, as for joints.
    """

    names: tuple[str, ...]
    goal_names: tuple[str, ...] = ()
    constant: bool = False

    @abstractmethod
    def rows(self, sample: ControlSample) -> TaskRows:
        """Return the rows at the end of a sample."""

    def goal(self, time: float) -> Float[Array, " k"]:
        """Return the desired values of the outputs ``goal_names`` at a time [s], for the record of a run."""
        return np.zeros(0)


@dataclass(frozen=True, kw_only=True)
class ControlTask(ABC):
    """Task of whole-body control: a description without a model.

    To add a task, derive a frozen dataclass with its settings and a ``bind`` method.

    Args:
        weight: weight of the squared error within the same priority; a number, or one for each row.
        gain: rate of convergence [1/s]; a number, or one for each row.
        priority: level of the task. Level 0 is strictly above level 1, and so on.
    """

    weight: float | Sequence[float] = 1.0
    gain: float | Sequence[float] = 1.0
    priority: int = 0

    @abstractmethod
    def bind(self, reduced: ReducedModel) -> BoundTask:
        """Return the task of a model, with all names resolved.

        Raises:
            ModelError: a joint or frame does not exist.
            ConfigurationError: the settings do not fit the model.
        """

    def numbers(self, name: str, value: float | Sequence[float], size: int) -> Float[Array, " k"]:
        """Return a setting as one number for each of ``size`` rows.

        Raises:
            ConfigurationError: a number is negative or not finite, or their count is neither one nor ``size``.
        """
        array = np.asarray(value, dtype=float)
        if array.shape not in ((), (size,)) or not (np.isfinite(array).all() and (array >= 0).all()):
            raise ConfigurationError(
                f"{name} of {type(self).__name__} has to be a number or {size} numbers, not negative, found {value}"
            )
        return np.array(np.broadcast_to(array, (size,)))
