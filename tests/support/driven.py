"""Ideal robots: configurations that follow the velocities of a kinematic controller exactly, replayed in Pinocchio."""

from typing import NamedTuple

import numpy as np
import pinocchio as pin


class Drive(NamedTuple):
    time: np.ndarray
    q: np.ndarray
    v: np.ndarray
    """Full velocities at the samples, from R and b at the configurations that were reached."""
    v2: np.ndarray
    states: list


def drive(reduced, controller, q0, duration, dt, v2=None, disturb=None, substeps=4):
    """Motion under ``v2(t) = v2 + v2_dot s`` within each sample, by the midpoint rule in substeps."""
    model, q = reduced.robot.model, np.array(q0, dtype=float)
    here = reduced.at(q, np.zeros(reduced.r) if v2 is None else v2).measure()
    state, rows, states = controller.initial_state(here), [], []
    h = dt / substeps
    for sample in range(round(duration / dt)):
        t = sample * dt
        if disturb is not None:
            q = disturb(sample, q)
        target, state = controller.step(t, reduced.at(q, here.v2).measure(), state)
        at = reduced.at(q)
        rows.append((t, q.copy(), at.R @ target.v2 + at.b, target.v2.copy()))
        states.append(state)
        for k in range(substeps):
            v2_here, v2_mid = (target.v2 + target.v2_dot * h * (k + part) for part in (0.25, 0.5))
            at = reduced.at(q)
            middle = reduced.at(pin.integrate(model, q, h / 2 * (at.R @ v2_here + at.b)))
            q = pin.integrate(model, q, h * (middle.R @ v2_mid + middle.b))
    times, configurations, velocities, reduced_velocities = (np.array(each) for each in zip(*rows, strict=True))
    return Drive(times, configurations, velocities, reduced_velocities, states)
