"""Impacts: a bar that is pinned, and an arm that grasps a drifting body.

The textbook side of the grasp has a position and a heading for each body, joints as constraints between them, and no
Pinocchio: ``m (v+ - v-) = J^T i``, ``J v+ = 0``.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pinocchio as pin

import rnc_pin as rnc
from benchmarks.validation.row import MATRIX, Row, conserved
from rnc_pin.robots.robot_files import find_urdf

MASSES, INERTIAS = np.array([40.0, 4.0, 3.0, 12.0]), np.array([7.0, 0.35, 0.2, 0.5])
MOUNT, UPPER, CENTRES, FOREARM, HANDLE = 0.5, 1.0, (0.5, 0.4), 0.8, -0.35


@cache
def robot() -> rnc.Robot:
    """Satellite with an arm, and a body that is free to move beside it."""
    arm = rnc.Robot.from_urdf(find_urdf("floating_arm.urdf"), base="planar", gravity=(0, 0, 0))
    model = arm.model.copy()
    joint = model.addJoint(0, pin.JointModelPlanar(), pin.SE3.Identity(), "drift")
    model.appendBodyToJoint(joint, pin.Inertia(12.0, np.zeros(3), 0.5 * np.eye(3)), pin.SE3.Identity())
    place = pin.SE3(np.eye(3), np.array([HANDLE, 0.0, 0.0]))
    model.addFrame(pin.Frame("handle", joint, 0, place, pin.FrameType.OP_FRAME))
    return rnc.Robot(model)


def bodies(q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray, list[tuple[int, complex]]]:
    """Velocities (x, y, heading) of the four bodies (4, 3), their centres, and both ends of all three joints."""
    yaw, shoulder, elbow = np.angle(q[2] + 1j * q[3]), np.angle(q[4] + 1j * q[5]), np.angle(q[6] + 1j * q[7])
    headings = np.exp(1j * np.cumsum([yaw, shoulder, elbow]))
    spins = np.cumsum(v[2:5])
    origin, drifting = q[0] + 1j * q[1], q[8] + 1j * q[9]
    along = q[10] + 1j * q[11]
    pivots = origin + np.cumsum([0.0, MOUNT * headings[0], UPPER * headings[1]])
    levers = CENTRES[0] * headings[1], CENTRES[1] * headings[2]
    centres = np.array([origin, pivots[1] + levers[0], pivots[2] + levers[1], drifting])
    velocity = (v[0] + 1j * v[1]) * headings[0]
    elbow_velocity = velocity + 1j * spins[0] * MOUNT * headings[0]
    speeds = [velocity, elbow_velocity + 1j * spins[1] * levers[0]]
    elbow_velocity = elbow_velocity + 1j * spins[1] * UPPER * headings[1]
    speeds += [elbow_velocity + 1j * spins[2] * levers[1], (v[5] + 1j * v[6]) * along]
    rates = np.array([[z.real, z.imag, w] for z, w in zip(speeds, [*spins, v[7]], strict=True)])
    hand = pivots[2] + FOREARM * headings[2]
    return rates, centres, [(0, pivots[1]), (1, pivots[1]), (1, pivots[2]), (2, pivots[2]), (2, hand), (3, hand)]


def textbook_grasp(q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, float]:
    """Velocities (4, 3) of the bodies after the grasp, and the lost energy [J]."""
    before, centres, ends = bodies(q, v)
    rows = np.zeros((7, 12))
    for pair in range(3):
        for sign, (body, point) in zip((1.0, -1.0), ends[2 * pair : 2 * pair + 2], strict=True):
            lever = point - centres[body]
            rows[2 * pair, 3 * body : 3 * body + 3] += sign * np.array([1.0, 0.0, -lever.imag])
            rows[2 * pair + 1, 3 * body : 3 * body + 3] += sign * np.array([0.0, 1.0, lever.real])
    rows[6, [8, 11]] = 1.0, -1.0
    inertia = np.column_stack([MASSES, MASSES, INERTIAS]).ravel()
    kkt = np.block([[np.diag(inertia), -rows.T], [rows, np.zeros((7, 7))]])
    after = np.linalg.solve(kkt, np.concatenate([inertia * before.ravel(), np.zeros(7)]))[:12]
    return after.reshape(4, 3), 0.5 * float(inertia @ (before.ravel() ** 2 - after**2))


def momentum(q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Linear momentum of all bodies, and angular momentum about the world's origin, from their sums."""
    rates, centres, _ = bodies(q, v)
    linear = MASSES[:, None] * rates[:, :2]
    turning = centres.real @ linear[:, 1] - centres.imag @ linear[:, 0] + INERTIAS @ rates[:, 2]
    return np.array([*linear.sum(axis=0), turning])


def grasp_rows() -> list[Row]:
    """Jump of the velocity, and the momentum of a run through the grasp."""
    held = rnc.NonholonomicSystem(robot(), [rnc.LoopClosure("hand", "handle")])
    start = robot().configuration({"root_joint": (0.3, -0.2, 0.4), "shoulder": 0.6, "elbow": -0.9})
    q = held.assembled(start, hold=["root_joint", "shoulder", "elbow"])
    v = np.array([0.03, -0.02, 0.05, 0.1, -0.2, -0.25, 0.1, 0.12])
    jump = rnc.impact(held, q, v)
    after, loss = textbook_grasp(q, v)
    found, _, _ = bodies(q, jump.v)

    # A body that drifts, and the motion of both after the grasp.
    free = rnc.NonholonomicSystem(robot()).reduce()
    drift = rnc.free_motion(free, start, free.at(start, v=v).v2, 1.0)
    together = held_where_they_are(drift.q[-1])
    caught = rnc.impact(together, drift.q[-1], drift.v[-1]).v
    carried = rnc.free_motion(together, drift.q[-1], together.at(drift.q[-1], v=caught).v2, 2.0)
    momenta = np.array([momentum(*state) for run in (drift, carried) for state in zip(run.q, run.v, strict=True)])
    drift = np.abs(momenta - momenta[0]).max() / np.abs(momenta[0]).max()
    return [
        Row("closed form", "grasp: velocities of four bodies after it [m/s, rad/s]", after, found, MATRIX),
        Row("closed form", "grasp: lost energy [J]", loss, jump.loss, MATRIX),
        conserved("grasp: momentum of all bodies through it", drift),
    ]


def held_where_they_are(q: np.ndarray) -> rnc.ReducedModel:
    """Model with a grasp in the present pose of hand and handle."""
    model, data = robot().model, robot().model.createData()
    pin.framesForwardKinematics(model, data, q)
    relative = data.oMf[robot().frame_id("hand")].actInv(data.oMf[robot().frame_id("handle")])
    rpy = tuple(pin.rpy.matrixToRpy(relative.rotation).tolist())
    closure = rnc.LoopClosure("hand", "handle", offset_a=tuple(relative.translation.tolist()), rpy=rpy)
    return rnc.NonholonomicSystem(robot(), [closure]).reduce()


def pinned_bar() -> Row:
    """A bar moves across its length when its end is pinned: angular velocity 3 v / (2 L)."""
    length, speed = 1.4, 0.8
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelPlanar(), pin.SE3.Identity(), "bar_joint")
    model.appendBodyToJoint(joint, pin.Inertia(3.0, np.zeros(3), 3.0 * length**2 / 12 * np.eye(3)), pin.SE3.Identity())
    end = pin.SE3(np.eye(3), np.array([-length / 2, 0.0, 0.0]))
    model.addFrame(pin.Frame("end", joint, 0, end, pin.FrameType.OP_FRAME))
    bar = rnc.Robot(model)
    pin_at_end = rnc.LoopClosure("universe", "end", kind="point", offset_a=(-length / 2, 0.0, 0.0))
    jump = rnc.impact(rnc.NonholonomicSystem(bar, [pin_at_end]), bar.configuration(), [0.0, speed, 0.0])
    turns = "bar pinned at its end: angular velocity [rad/s]"
    return Row("closed form", turns, 1.5 * speed / length, jump.v[2], MATRIX)


def rows() -> list[Row]:
    """Jumps in closed form, and a motion through a grasp."""
    return [pinned_bar(), *grasp_rows()]
