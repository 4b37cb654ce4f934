"""Homogeneous ball that rolls: steady on a level, 5/7 g sin(a) down a slope, circles at 2/7 of a turntable's rate.

Earnshaw (1844); Routh, The Advanced Part of a Treatise on the Dynamics of a System of Rigid Bodies (1884).
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

import rnc_pin as rnc
from benchmarks.validation.row import MATRIX, MOTION, Row, conserved

SOURCE = "Routh 1884"
RADIUS, GRAVITY, TABLE = 0.2, 9.81, 1.5  # m, m/s^2, rad/s
UP = np.array([0.0, 0.0, 1.0])
SPIN, DURATION = np.array([3.0, -2.0, 5.0]), 20.0


def contact_on_turntable() -> rnc.Pfaffian:
    """The point of the ball at the contact moves as the table does under it: an affine constraint, by hand."""

    def turn(q: np.ndarray) -> np.ndarray:
        return pin.Quaternion(q[3:7]).toRotationMatrix()

    def rows(q: np.ndarray) -> np.ndarray:
        return np.hstack([turn(q), RADIUS * pin.skew(UP) @ turn(q)])

    def rows_dot(q: np.ndarray, v: np.ndarray) -> np.ndarray:
        rate = turn(q) @ pin.skew(v[3:])
        return np.hstack([rate, RADIUS * pin.skew(UP) @ rate])

    def table(q: np.ndarray) -> np.ndarray:
        return TABLE * np.cross(UP, q[:3])

    def table_dot(q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return TABLE * np.cross(UP, turn(q) @ v[:3])

    return rnc.Pfaffian(rows, rows_dot, ["x", "y", "height"], rate=table, rate_dot=table_dot)


def ball(slope: float = 0.0, contact: rnc.Pfaffian | rnc.RollingBall | None = None) -> rnc.ReducedModel:
    """The ball, its three spins as reducing outputs; the plane stays z = 0 and gravity leans by ``slope`` [rad]."""
    gravity = GRAVITY * np.array([np.sin(slope), 0.0, -np.cos(slope)])
    robot = rnc.Robot.from_urdf("rolling_ball.urdf", base="free", gravity=gravity)
    system = rnc.NonholonomicSystem(robot, [contact or rnc.RollingBall("ball", RADIUS)])
    return system.reduce([rnc.FrameAngularVelocity("ball", axis) for axis in "xyz"], [rnc.FramePosition("ball", "xyz")])


def rolling(
    reduced: rnc.ReducedModel, place: tuple[float, float] = (0.0, 0.0), duration: float = DURATION
) -> rnc.Trajectory:
    """Let go with a given spin, for some seconds."""
    q0 = reduced.robot.configuration({"root_joint": (*place, RADIUS, 0, 0, 0, 1)})
    return rnc.free_motion(reduced, q0, SPIN, duration, dt=0.1)


def on_curved_ground() -> list[Row]:
    """Acceleration in a bowl at a large angle, and rates in an upright cylinder, which give its frequency."""
    grounds, length = (rnc.SphericalGround(1.0), *[rnc.CylindricalGround(1.0)] * 2), 1.0 - RADIUS
    robot = rnc.Robot.from_urdf("rolling_ball.urdf", base="free", gravity=GRAVITY * np.array([0.0, 0.0, -1.0]))
    angle, turn, rise, spin = 1.1, 3.0, 0.4, 0.7
    places = length * np.array([[np.sin(angle), 0.0, -np.cos(angle)], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    spins = [np.zeros(3), *(np.array([s, rise / RADIUS, -turn * length / RADIUS]) for s in (0.0, spin))]
    found = []
    for ground, place, w in zip(grounds, places, spins, strict=True):
        system = rnc.NonholonomicSystem(robot, [rnc.RollingBall("ball", RADIUS, ground)])
        reduced = system.reduce([rnc.FrameAngularVelocity("ball", axis) for axis in "xyz"])
        state = reduced.at(robot.configuration({"root_joint": (*place, 0, 0, 0, 1)}), w)
        v, v_dot = state.v, state.v_dot(state.v2_dot([]))
        found.append((v, v_dot, v_dot[:3] + np.cross(v[3:], v[:3])))
    (_, _, fallen), (_, _, slow), (v, v_dot, fast) = found
    ahead = np.array([np.cos(angle), 0.0, np.sin(angle)])
    # The acceleration of z is linear in the spin s about the outward radius, whose rate is proportional to that of z.
    rate = np.sqrt((slow - fast)[2] / spin * (v_dot[3] + turn * v[4]) / v[2])
    bowl, down = "ball in a bowl at 1.1 rad: acceleration [m/s^2]", -5 / 7 * GRAVITY * np.sin(angle)
    tube = "ball in an upright cylinder: frequency of its height over that of its turns"
    return [
        Row(SOURCE, bowl, down, fallen @ ahead, MATRIX),
        Row("Neimark & Fufaev 1972", tube, np.sqrt(2 / 7), rate / turn, MATRIX),
    ]


def rows() -> list[Row]:
    """Place and spin on the level, place on a slope and on a turntable, energy."""
    run = rolling(ball())
    start = RADIUS * np.cross(SPIN, UP)  # velocity of the centre: spin x (radius up)
    straight = RADIUS * UP + run.time[:, None] * start
    turns = [pin.Quaternion(q[3:7]).toRotationMatrix() for q in run.q]
    spin = np.array([turn @ v2 for turn, v2 in zip(turns, run.v2, strict=True)])
    slope = 0.3
    down = rolling(ball(slope), duration=10.0)
    fall = 5 / 14 * GRAVITY * np.sin(slope) * down.time[:, None] ** 2 * np.array([1.0, 0.0, 0.0])
    exchanged = GRAVITY * np.sin(slope) * down.x1[-1, 0]  # between height and speed
    place = np.array([0.4, -0.3])
    ground = rnc.GroundPlane(spin=TABLE)
    tables = [contact_on_turntable(), rnc.RollingBall("ball", RADIUS, ground)]
    by_hand, on_table = (
        rolling(ball(contact=each), tuple(place), lasts).x1[:, :2]
        for each, lasts in zip(tables, (10.0, DURATION), strict=True)
    )
    rate, velocity = 2 / 7 * TABLE, TABLE * np.array([-place[1], place[0]]) + start[:2]
    angle = rate * run.time
    across = np.array([-velocity[1], velocity[0]])
    circle = place + (np.outer(np.sin(angle), velocity) + np.outer(1 - np.cos(angle), across)) / rate
    table = "ball on a turntable"
    return [
        *on_curved_ground(),
        Row(SOURCE, "ball on a level: centre over 20 s [m]", straight, run.x1, MOTION),
        Row(SOURCE, "ball on a level: spin over 20 s [rad/s]", np.broadcast_to(SPIN, spin.shape), spin, MOTION),
        Row(SOURCE, "ball on a slope: centre over 10 s [m]", straight[: len(fall)] + fall, down.x1, MOTION),
        Row("Earnshaw 1844", f"{table}, rows by hand: centre over 10 s [m]", circle[: len(by_hand)], by_hand, MOTION),
        Row("Earnshaw 1844", f"{table}, GroundPlane: centre over 20 s [m]", circle, on_table, MOTION),
        conserved("ball on a level: energy", np.ptp(run.energy) / run.energy[0]),
        conserved("ball on a slope: energy", np.ptp(down.energy) / exchanged),
    ]
