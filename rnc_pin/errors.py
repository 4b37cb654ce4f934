"""Errors that users meet: one root, one line each, the data attached."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    import numpy as np


class Motion(Protocol):
    """What errors carry of a motion that they ended: a ``Trajectory`` or, of kinematics alone, a ``Rollout``."""

    @property
    def time(self) -> np.ndarray:
        """(N,) [s]"""
        ...

    @property
    def q(self) -> np.ndarray:
        """(N, nq)"""
        ...


class RncError(Exception):
    """Root of every error this package raises on purpose.

    Attributes:
        trajectory: where a simulation or a roll-out raised it, the motion until then; else None.
    """

    trajectory: Motion | None = None


class ModelWarning(UserWarning):
    """A robot's file says something that is left out of the model, or that no machine can be."""


class ModelError(RncError):
    """A file, joint or frame is not there, or a model cannot be simulated."""


class ConstraintError(RncError):
    """Constraints, outputs or actuators that do not fit together."""


class ConfigurationError(RncError):
    """A scenario file, option or argument is wrong: says where and what was expected."""


class InfeasibleError(ConfigurationError):
    """What is asked for is well formed but cannot be done: no gains suit it, or it leads through singularities."""


class InputError(RncError, ValueError):
    """An array has the wrong shape or holds values that are not finite."""


class SimulationError(RncError):
    """A run cannot go on."""


class DivergenceError(SimulationError):
    """The state left every sensible bound.

    Attributes:
        time: simulation time [s], or None outside a simulation.
    """

    def __init__(self, what: str, *, time: float | None = None) -> None:
        self.what, self.time = what, time
        super().__init__(what)

    def __str__(self) -> str:
        when = "" if self.time is None else f" at t = {self.time:.3f} s"
        return f"diverged{when}: {self.what}"


class LimitError(SimulationError):
    """A joint ran into its position limit while limits were enforced."""


class SingularityError(SimulationError):
    """The stack ``E = [A; J2]`` cannot be inverted: the outputs do not parametrise the motion here.

    Attributes:
        q: the configuration, (nq,).
        condition: 2-norm condition number of ``E`` with rows scaled to unit length.
        rows: names of the rows that are (nearly) linearly dependent.
        time: simulation time [s], or None outside a simulation.
    """

    def __init__(
        self,
        what: str,
        *,
        q: np.ndarray,
        condition: float,
        rows: Sequence[str],
        time: float | None = None,
    ) -> None:
        self.what = what
        self.q = q
        self.condition = condition
        self.rows = tuple(rows)
        self.time = time
        super().__init__(what)

    def __str__(self) -> str:
        when = "" if self.time is None else f" at t = {self.time:.3f} s"
        where = ", ".join(f"{value:.4g}" for value in self.q)
        return (
            f"{self.what}{when}: rows {', '.join(self.rows)} are dependent "
            f"(condition {self.condition:.3g}) at q = [{where}]"
        )


def nearest(name: str, valid: Iterable[str], ending: str = "") -> str:
    """Words that point from a wrong name to the valid ones: ``; did you mean 'b'?``.

    An ``ending`` that all names share is shown but not compared, or it would make any two look alike.
    """
    choices = [str(choice) for choice in valid]
    if not choices:
        return "; there are none"
    close = difflib.get_close_matches(str(name), choices, n=1, cutoff=0.5)
    # A short word is often the part that a person remembers: `wheel` for `wheel_left_joint`.
    close = close or [choice for choice in choices if len(name) > 2 and name in choice][:1]
    if close:
        return f"; did you mean '{close[0]}{ending}'?"
    shown = ", ".join(choice + ending for choice in choices[:12]) + (", ..." if len(choices) > 12 else "")
    return f"; expected one of: {shown}"


def few(names: Sequence[str], most: int = 3) -> str:
    """The first names and how many more there are: ``a, b, c and 4 more``."""
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")
