"""Motion after the end of a plan: a stop within the accelerations of the plan, or the last velocities for ever."""

from __future__ import annotations

from contextlib import suppress
from typing import Literal

import numpy as np
from numpy import ndarray as Array

from rnc_pin.errors import ConfigurationError, ConstraintError, nearest
from rnc_pin.optimal.action_models import ActionModel, KinematicModel, Nodes
from rnc_pin.optimal.guesses import inputs_for
from rnc_pin.optimal.motion_plan import MotionPlan

End = Literal["stop", "continue"]
_AT_REST = 1e-3  # part of an interval: a plan that brakes in less time ends at rest
_ROUNDING = 1e-12  # part of the largest velocity of the plan that is rounding


class PlanEnd:
    """Motion after the end of a plan.

    ``"stop"``: the reduced velocities fall linearly to zero. No acceleration exceeds the largest of the plan, unless
    the stop would take longer than the plan. A plan that ends at rest stands still, and in the kinematic form the
    velocity jumps to zero, as it jumps between intervals. ``"continue"``: the reduced velocities stay. The inputs are
    those of this motion; of an underactuated system, those that come nearest to it.

    Args:
        model: action model of the plan.
        plan: the plan.
        end: "stop" or "continue".

    Attributes:
        duration: time until the motion stands still [s]; infinite for "continue".

    Raises:
        ConfigurationError: unknown end.
    """

    def __init__(self, model: ActionModel, plan: MotionPlan, end: End = "stop") -> None:
        if end not in ("stop", "continue"):
            raise ConfigurationError(
                f"end '{end}': expected 'stop' or 'continue'{nearest(str(end), ['stop', 'continue'])}"
            )
        self._model, self._plan = model, plan
        self._driven = KinematicModel(model.reduced)
        self._h = float(plan.time[-1] - plan.time[-2])
        self._reached = 0, plan.q[-1:]
        self._input_of: tuple[int, Array] | None = None
        self._rates = np.zeros((1, model.r))
        self.duration = np.inf if end == "continue" else self._braking(plan)
        self._stand: tuple[Nodes, Array] | None = None

    def at(self, since: float) -> tuple[Nodes, Array]:
        """State (one node) and input at a time after the end of the plan [s]."""
        if since >= self.duration:
            if self._stand is None:
                self._stand = self._standing()
            return self._stand
        k = int(since / self._h)
        if self.duration < np.inf:
            k = min(k, round(self.duration / self._h) - 1)
        start = self._start(k)
        if self._input_of is None or self._input_of[0] != k:
            middle = Nodes(self._moved(start, k * self._h, self._h / 2), self._velocity((k + 0.5) * self._h))
            self._input_of = k, self._input(middle, self._rates)  # constant over the interval: that of its middle
        q = self._moved(start, k * self._h, since - k * self._h)
        return Nodes(q, self._velocity(since) if self._model.nw else self._plan.w[-1:]), self._input_of[1]

    def _velocity(self, since: float) -> Array:
        """Reduced velocity (1, r) at a time after the end of the plan."""
        last = self._plan.w if self._model.nw else self._plan.u
        return last[-1:] + since * self._rates

    def _moved(self, q: Array, since: float, step: float) -> Array:
        """Configuration (1, nq) after a step from a time on, with the velocity of its middle."""
        speed = self._velocity(since + step / 2)
        return self._driven.step(Nodes(q, np.empty((1, 0))), speed, np.array([step])).q

    def _braking(self, plan: MotionPlan) -> float:
        """Duration of the stop, a whole number of intervals; it sets their length and the reduced acceleration."""
        if not self._model.nw:
            return 0.0
        largest = np.abs(plan.acceleration[:, :, : self._model.r]).max(axis=(0, 1))
        speed = np.abs(plan.w[-1])
        moves = speed > _ROUNDING * np.abs(plan.w).max(initial=0.0)
        least = speed[moves] / plan.duration  # a stop takes no longer than the plan
        total = float((speed[moves] / np.maximum(largest[moves], least)).max(initial=0.0))
        if total < _AT_REST * self._h:
            return 0.0
        count = int(np.ceil(total / self._h - 1e-9))
        self._h, self._rates = total / count, -plan.w[-1:] / total
        return total

    def _start(self, k: int) -> Array:
        """Configuration (1, nq) at the start of the k-th interval.

        Only the last one is kept, because the motion may go on for days. An earlier one is computed again.
        """
        reached, q = self._reached if self._reached[0] <= k else (0, self._plan.q[-1:])
        for each in range(reached, k):
            q = self._moved(q, each * self._h, self._h)
        self._reached = k, q
        return q

    def _input(self, at: Nodes, rates: Array) -> Array:
        """Input of the form that gives reduced accelerations (1, r), or comes nearest to them."""
        if self._model.form == "acceleration":
            return rates[0]
        if self._model.form == "dynamic":
            with suppress(ConstraintError):
                return inputs_for(self._model, at, rates)[0]
        return np.array(self._plan.u[-1])

    def _standing(self) -> tuple[Nodes, Array]:
        """State at rest after the stop, and the input that holds it."""
        zeros = np.zeros((1, self._model.nw))
        rest = Nodes(self._start(round(self.duration / self._h)), zeros)
        if self._model.form != "dynamic":
            return rest, np.zeros(self._model.nu)
        return rest, self._input(rest, zeros)
