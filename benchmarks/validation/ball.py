"""Homogeneous ball that rolls on a plane: straight and steady on a level one, 5/7 g sin(a) downhill on a slope.

Routh, Advanced Part of a Treatise on the Dynamics of a System of Rigid Bodies (1884); Neimark and Fufaev (1972).
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

import rnc_pin as rnc
from benchmarks.validation.row import INVARIANT, MOTION, Row

SOURCE = "Routh 1884"
RADIUS, GRAVITY = 0.2, 9.81
UP = np.array([0.0, 0.0, 1.0])


def _turn(q: np.ndarray) -> np.ndarray:
    return pin.Quaternion(q[3:7]).toRotationMatrix()


def contact_rows(q: np.ndarray) -> np.ndarray:
    """Velocity of the material point at the contact, in world axes, (3, 6)."""
    turn = _turn(q)
    return np.hstack([turn, RADIUS * pin.skew(UP) @ turn])


def contact_rows_dot(q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Rate of ``contact_rows`` along v."""
    rate = _turn(q) @ pin.skew(v[3:])
    return np.hstack([rate, RADIUS * pin.skew(UP) @ rate])


def ball(slope: float) -> rnc.ReducedModel:
    """The ball, its three spins as reducing outputs; the plane stays z = 0 and gravity leans by ``slope`` [rad]."""
    gravity = GRAVITY * np.array([np.sin(slope), 0.0, -np.cos(slope)])
    robot = rnc.Robot.from_urdf("rolling_ball.urdf", base="free", gravity=gravity)
    system = rnc.NonholonomicSystem(robot, [rnc.Pfaffian(contact_rows, contact_rows_dot, ["x", "y", "height"])])
    return system.reduce([rnc.FrameSpin("ball", axis) for axis in "xyz"], [rnc.FramePosition("ball", "xyz")])


def rows() -> list[Row]:
    """Place and spin on the level, place on a slope, energy."""
    spin, duration = np.array([3.0, -2.0, 5.0]), 20.0
    q0 = rnc.Robot.from_urdf("rolling_ball.urdf", base="free").configuration({"root_joint": (0, 0, RADIUS, 0, 0, 0, 1)})
    result = []
    for slope, word in ((0.0, "level"), (0.3, "slope")):
        reduced = ball(slope)
        run = rnc.free_motion(reduced, q0, spin, duration, dt=0.1)
        start = RADIUS * np.cross(spin, UP)  # of the centre: spin x (radius up)
        downhill = 5 / 14 * GRAVITY * np.sin(slope) * run.time[:, None] ** 2 * np.array([1.0, 0.0, 0.0])
        closed = RADIUS * UP + run.time[:, None] * start + downhill
        result.append(Row(SOURCE, f"ball on a {word}: centre over 20 s [m]", closed, run.x1, MOTION))
        if slope == 0:
            world = np.array([_turn(q) @ v2 for q, v2 in zip(run.q, run.v2, strict=True)])
            result.append(
                Row(SOURCE, "ball on a level: spin over 20 s", np.broadcast_to(spin, world.shape), world, MOTION)
            )
        # On the slope energy moves between height and speed, so the drift is measured by what moves.
        exchanged = max(abs(run.energy[0]), GRAVITY * np.sin(slope) * run.x1[-1, 0])
        drift = np.abs(run.energy - run.energy[0]).max() / exchanged
        result.append(Row("conservation", f"ball on a {word}: energy over 20 s, relative", 0.0, drift, INVARIANT, 1.0))
    return result
