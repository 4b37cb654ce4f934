"""Adaptive velocity tracker: no model. Paper (10), Lemma 3."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array

from rnc_pin.control.dead_zone import apply_dead_zone
from rnc_pin.control.gains import VelocityGains
from rnc_pin.control.protocol import (
    Command,
    Description,
    KinematicController,
    State,
    command_towards,
    describe,
    elapsed_time,
    listed,
)
from rnc_pin.control.windup import saturation_mask
from rnc_pin.math.linear_algebra import apply
from rnc_pin.model.measurement import Measurement
from rnc_pin.printing import ReprMixin


class TrackerState(NamedTuple):
    """What the tracker has learnt; batch axes lead."""

    time: float | None
    g: Float[Array, "*batch r"]
    C: Float[Array, "*batch r r"]
    D: Float[Array, "*batch r r2"]
    target: State
    """State of the kinematic controller."""


class VelocityTracker(ReprMixin):
    """``F = C v2d_dot + D [v2 v2d] + g + k e_v`` with gains learnt from ``e_v = v2d - v2``, paper (10).

    The scan of the paper loses the third law, ``Ddot = -sigma D + beta e_v [v2 v2d]^T``. In discrete time
    the leak is exact over a sample, and the step along the regressor w is bounded: what one sample adds
    to F is at most ``k e_v``, however large ``beta |w|^2 dt`` (under explicit Euler more than 2 diverges).
    For small steps both are the paper's. With a dead zone z the laws learn from what of ``e_v`` is beyond it, and of
    outputs within it what is learnt stays as it is, leak included: noise of velocities that is smaller than z cannot
    make it drift (``control.dead_zone``); errors of up to z are left to k. Of outputs whose actuators gave too little
    nothing is learnt that would ask for more (``control.windup``).

    Reads from the measurement: ``v2``, ``excess`` where somebody looked, and what its kinematic controller reads.

    Args:
        target: kinematic controller that decides ``v2d`` and its rate.
        gains: k, beta, sigma, dead zone.
        held: reduced force that holds the robot up where it starts (r,), as its actuators report while it rests; g is
            what has to be learnt besides. Zero by default, so that a robot under gravity drops until g has grown.
    """

    def __init__(
        self, target: KinematicController, gains: VelocityGains | None = None, held: np.ndarray | None = None
    ) -> None:
        self.target = target
        self.gains = VelocityGains.paper() if gains is None else gains
        self._zoned = bool(np.any(self.gains.dead_zone))
        self.held = 0.0 if held is None else np.asarray(held, dtype=float)

    def describe(self) -> Description:
        """Its gains, the force that it starts with, and what it follows."""
        return {
            "type": type(self).__name__,
            "gains": self.gains.describe(),
            "held": listed(self.held),
            "target": describe(self.target),
        }

    def initial_state(self, measurement: Measurement) -> TrackerState:
        """All adaptive gains zero."""
        shape = np.shape(measurement.v2)
        r = shape[-1]
        return TrackerState(
            time=None,
            g=np.zeros(shape),
            C=np.zeros((*shape, r)),
            D=np.zeros((*shape, r * r)),
            target=self.target.initial_state(measurement),
        )

    def step(self, t: float, measurement: Measurement, state: TrackerState) -> tuple[Command, TrackerState]:
        """One sample; the time since the last one may vary.

        Raises:
            InputError: time runs backwards.
        """
        elapsed = elapsed_time(t, state.time)
        target, target_state = self.target.step(t, measurement, state.target)
        v2 = measurement.v2
        error = target.v2 - v2
        products = (v2[..., :, None] * target.v2[..., None, :]).reshape(*v2.shape[:-1], -1)  # [v2 v2d]
        square = 1.0 + np.vecdot(target.v2_dot, target.v2_dot) + np.vecdot(products, products)
        k, beta, sigma = self.gains.k, self.gains.beta, self.gains.sigma
        decay = np.asarray(np.exp(-sigma * elapsed))
        held = -np.expm1(-sigma * elapsed) / sigma if sigma else elapsed  # integral of the leak over the sample
        gain = held * beta / (1.0 + held * beta * square[..., None] / k)
        step = gain * error
        if self._zoned:
            learnt_from = apply_dead_zone(error, self.gains.dead_zone)
            step, decay = gain * learnt_from, np.where(learnt_from == 0.0, 1.0, decay)
        if measurement.excess is not None:
            stays = saturation_mask(measurement.excess, error)
            step, decay = np.where(stays, 0.0, step), np.where(stays, 1.0, decay)
        g = decay * state.g + step
        C = decay[..., None] * state.C + step[..., :, None] * target.v2_dot[..., None, :]
        D = decay[..., None] * state.D + step[..., :, None] * products[..., None, :]
        F = apply(C, target.v2_dot) + apply(D, products) + g + k * error + self.held
        command = command_towards(target, F)
        return command, TrackerState(t, g, C, D, target_state)
