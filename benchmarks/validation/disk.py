"""Disk and hoop that roll without slip and may fall: Routh (1884); O'Reilly, Nonlinear Dynamics 10 (1996) 287-305.

And the vertical disk of Bloch, Nonholonomic Mechanics and Control (2003).
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pinocchio as pin
from scipy.optimize import brentq

import rnc_pin as rnc
from benchmarks.validation.row import EIGENVALUE, MOTION, Row, conserved

RADIUS, GRAVITY = 0.25, 9.81
SHAPES = {"rolling_disk": 3.0, "rolling_hoop": 4.0}  # critical spin^2 is g / (factor r)


@cache
def rolling(name: str) -> rnc.ReducedModel:
    """Lean, heading of the axle, and spin about it as reducing outputs; nothing is driven."""
    robot = rnc.Robot.from_urdf(f"{name}.urdf", base="free", gravity=(0, 0, -GRAVITY))
    system = rnc.NonholonomicSystem(robot, [rnc.RollingWheel("disk", RADIUS, axis="y")])
    return system.reduce(
        [rnc.FrameTilt("disk", "y"), rnc.FrameYaw("disk", "y"), rnc.FrameAngularVelocity("disk", "y")],
        [rnc.FramePosition("disk", "xyz")],
    )


def placed(reduced: rnc.ReducedModel, tilt: float) -> np.ndarray:
    """The configuration whose axle, along y, points up by ``tilt`` [rad], over the origin."""
    quaternion = pin.Quaternion(pin.rpy.rpyToMatrix(tilt, 0.0, 0.0)).coeffs()
    return reduced.robot.configuration({"root_joint": (0, 0, RADIUS * np.cos(tilt), *quaternion)})


def critical_spin(name: str) -> float:
    """Spin about the axle at which straight rolling stops falling over [rad/s]."""
    reduced = rolling(name)
    q = placed(reduced, 0.0)

    def square(spin: float) -> float:
        """Square of the pair of eigenvalues that is not zero, (trace of A^2) / 2."""
        A = rnc.linearize(reduced, q, [0, 0, spin], coordinates=[rnc.FrameTilt("disk", "y")]).A
        return float(np.trace(A @ A)) / 2

    return float(brentq(square, 0.5, 20.0, xtol=1e-13, rtol=1e-14))


def steady_spin(reduced: rnc.ReducedModel, tilt: float, precession: float) -> float:
    """Spin about the axle [rad/s] with which a disk circles steadily, from the balance of angular momentum.

    ``I_t W^2 sin(t) cos(t) = (I_a + m r^2) w W cos(t) + m g r sin(t)``, tilt t of the axle, precession W.
    """
    inertia = reduced.robot.model.inertias[1]
    I_t, I_a, _ = np.diag(inertia.inertia)
    sine, cosine = np.sin(tilt), np.cos(tilt)
    weight = inertia.mass * GRAVITY * RADIUS * sine
    return (I_t * precession**2 * sine * cosine - weight) / ((I_a + inertia.mass * RADIUS**2) * precession * cosine)


def circling(name: str, tilt: float, precession: float, duration: float) -> tuple[rnc.Trajectory, float]:
    """A steady circular motion, and the radius of the centre's circle by the formula [m]."""
    reduced = rolling(name)
    spin = steady_spin(reduced, tilt, precession)
    run = rnc.free_motion(reduced, placed(reduced, tilt), np.array([0.0, precession, spin]), duration, dt=0.05)
    return run, RADIUS * abs(spin / precession)


def rows() -> list[Row]:
    """Critical spins, steady circles, energy over a minute, and the vertical disk."""
    result = []
    for name, factor in SHAPES.items():
        word = name.removeprefix("rolling_")
        spin, exact = f"{word}: critical spin sqrt(g / {factor:.0f} r) [rad/s]", np.sqrt(GRAVITY / (factor * RADIUS))
        result.append(Row("Routh 1884, O'Reilly 1996", spin, exact, critical_spin(name), EIGENVALUE))
        tilt, precession = 0.4, 3.0
        run, radius = circling(name, tilt, precession, 10.0)
        turned = precession * run.time
        # The axle starts along y, so the disk heads along +-x and circles about a point on the y axis.
        side = np.sign(run.v2[0, 2] / precession)
        circle = np.column_stack([np.sin(turned), 1 - np.cos(turned)]) * radius * side
        result += [
            Row("O'Reilly 1996", f"{word}: steady circle, centre over 10 s [m]", circle, run.x1[:, :2], MOTION),
            Row("O'Reilly 1996", f"{word}: steady circle, tilt after 10 s [rad]", tilt, run.x2[-1, 0], MOTION),
        ]
        reduced = rolling(name)
        lasts = 60.0 if name == "rolling_disk" else 10.0
        run = rnc.free_motion(reduced, placed(reduced, 0.2), np.array([0.5, 1.0, 8.0]), lasts, dt=0.05)
        drift = np.abs(run.energy / run.energy[0] - 1).max()
        result.append(conserved(f"{word}: energy over {lasts:.0f} s while it wobbles", drift))
    return result + vertical_disk()


def vertical_disk() -> list[Row]:
    """Bloch (2003), section 1.4: heading and roll turn steadily, the contact goes in a circle."""
    robot = rnc.Robot.from_urdf("vertical_disk.urdf", base="planar")
    system = rnc.NonholonomicSystem(robot, [rnc.RollingWheel("disk", RADIUS)])
    reduced = system.reduce([rnc.JointPosition("axle"), rnc.FrameYaw("carrier")], [rnc.FramePosition("disk", "xy")])
    roll, turn = 6.0, 0.7
    run = rnc.free_motion(reduced, robot.configuration(), np.array([roll, turn]), 60.0, dt=0.1)
    angle = turn * run.time
    circle = RADIUS * roll / turn * np.column_stack([np.sin(angle), 1 - np.cos(angle)])
    rates = np.broadcast_to([roll, turn], run.v2.shape)
    return [
        Row("Bloch 2003", "vertical disk: contact over 60 s [m]", circle, run.x1, MOTION),
        Row("Bloch 2003", "vertical disk: roll and turn rates over 60 s [rad/s]", rates, run.v2, MOTION),
    ]
