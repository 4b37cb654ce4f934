"""Effect of active limits on the tasks of a program, state by state."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from rnc_pin.errors import InputError
from rnc_pin.printing import printed


@printed()
@dataclass(frozen=True)
class LimitEffect:
    """Effect of limits at one state.

    Attributes:
        time: time of the state [s].
        active: limits that change the motion.
        exceeded: limits that gave way because they excluded each other, with the amounts.
        freedom: dimension of the reduced velocities that the active limits leave free.
        task_error: change of the rate of each task row that the limits cause; zero without active limits.
    """

    time: float
    active: tuple[str, ...]
    exceeded: Mapping[str, float]
    freedom: int
    task_error: Mapping[str, float]


class LimitedProgram(Protocol):
    """Program with limits, such as ``rnc.control.VelocityQP``."""

    def effect(self, t: float, q: ArrayLike, v2: ArrayLike) -> LimitEffect:
        """Return the effect of the limits at one state."""
        ...


def limit_effects(
    program: LimitedProgram, states: Sequence[tuple[float, ArrayLike, ArrayLike]], n: int, r: int
) -> tuple[LimitEffect, ...]:
    """Return the effect of the limits of a program at each state.

    Args:
        program: a program, such as ``rnc.control.VelocityQP`` with its ``dt``.
        states: time [s], configuration (nq,) and reduced velocity (r,) of each state.
        n: length of configurations.
        r: number of reduced velocities.

    Raises:
        InputError: a state has another shape, or the program reports no effects.
    """
    if not hasattr(program, "effect"):
        raise InputError(f"{type(program).__name__} reports no effects of limits: expected a VelocityQP")
    found = []
    for index, state in enumerate(states):
        try:
            t, q, v2 = state
            shapes = np.shape(q), np.shape(v2)
        except (TypeError, ValueError):
            raise InputError(f"state {index}: expected (t, q, v2)") from None
        if shapes != ((n,), (r,)):
            raise InputError(f"state {index}: q and v2 have shapes {shapes}, expected ({n},) and ({r},)")
        found.append(program.effect(float(t), q, v2))
    return tuple(found)
