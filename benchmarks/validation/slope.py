"""Disk on a slope: held upright it descends and returns, free it falls over; and a cone that rolls about its apex.

J. I. Neimark, N. A. Fufaev, Dynamics of Nonholonomic Systems (1972); A. M. Bloch, Nonholonomic Mechanics and Control
(2003), section 1.6: a knife edge on an inclined plane. A disk that rolls has the same path, with the inertia of its
rolling. L. D. Landau, E. M. Lifshitz, Mechanics (1976), section 32: a cone that rolls on a plane.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from scipy.integrate import solve_ivp

import rnc_pin as rnc
from benchmarks.validation.row import MATRIX, MOTION, Row, conserved

GRAVITY, SLOPE = 9.81, 0.3  # m/s^2, rad; the plane falls along its first axis
RADIUS, MASS = 0.25, 2.0
ABOUT, ACROSS = 0.5 * MASS * RADIUS**2, 0.25 * MASS * RADIUS**2  # of a thin disk, about its axle and across
NORMAL = np.array([np.sin(SLOPE), 0.0, np.cos(SLOPE)])
DOWN = np.array([np.cos(SLOPE), 0.0, -np.sin(SLOPE)])
WEIGHT = np.array([0.0, 0.0, -GRAVITY])
GROUND = rnc.GroundPlane(normal=tuple(NORMAL))
TURN = 1.6  # rad/s, of the upright disk
HALF_ANGLE, HEIGHT = 0.4, 0.3  # rad, m, of a homogeneous cone of one kilogram


def upright() -> rnc.ReducedModel:
    """Disk on a carrier that keeps it upright on the slope: it slides in both axes of the plane, turns and rolls."""
    model = pin.Model()
    along, across, up = GROUND.axes
    plane = pin.SE3(np.column_stack([along, across, up]), RADIUS * up)
    still, joint = pin.SE3.Identity(), 0
    kinds = pin.JointModelPX(), pin.JointModelPY(), pin.JointModelRZ(), pin.JointModelRY()
    for name, kind, place in zip(("x", "y", "heading", "axle"), kinds, (plane, still, still, still), strict=True):
        joint = model.addJoint(joint, kind, place, name)
    model.appendBodyToJoint(joint, pin.Inertia(MASS, np.zeros(3), np.diag([ACROSS, ABOUT, ACROSS])), still)
    model.addFrame(pin.Frame("disk", joint, still, pin.FrameType.BODY))
    model.gravity.linear = WEIGHT
    system = rnc.NonholonomicSystem(rnc.Robot(model), [rnc.RollingWheel("disk", RADIUS, ground=GROUND)])
    return system.reduce([rnc.JointPosition("axle"), rnc.JointPosition("heading")], [rnc.JointPosition("x")])


def path(time: np.ndarray) -> np.ndarray:
    """Place (N, 2) down and across the slope of an upright disk from rest that heads downhill and turns steadily.

    ``(m + I / r^2) sddot = m g sin a cos(w t)`` along the heading w t; so it draws a cycloid across the slope.
    """
    pull = MASS * GRAVITY * np.sin(SLOPE) / (MASS + ABOUT / RADIUS**2)
    angle = TURN * time
    return pull / (2 * TURN**2) * np.column_stack([np.sin(angle) ** 2, angle - np.sin(2 * angle) / 2])


def falling() -> rnc.ReducedModel:
    """The same disk on a free base: its angular velocities as reducing outputs, its centre as vertical outputs."""
    robot = rnc.Robot.from_urdf("rolling_disk.urdf", base="free", gravity=tuple(WEIGHT))
    wheel = rnc.RollingWheel("disk", RADIUS, axis="y", ground=GROUND)
    outputs = [rnc.FrameAngularVelocity("disk", axis) for axis in "xyz"]
    return rnc.NonholonomicSystem(robot, [wheel]).reduce(outputs, [rnc.FramePosition("disk", "xyz")])


def newton_and_euler(w: np.ndarray, axle: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Displacement (N, 3) of the centre of a disk on the slope, from equations that share no code with the package.

    With the axle e, the angular momentum ``I w + (J - I) (w . e) e`` about the centre, and the arm r from there to the
    contact, which lies in the plane of the disk: ``v = r x w`` and ``d/dt momentum = r x m (vdot - g)``.

    Args:
        w: angular velocity at the start, world axes (3,).
        axle: unit vector along the axle at the start (3,).
        times: instants (N,).
    """

    def rate(_: float, state: np.ndarray) -> np.ndarray:
        w, e = state[:3], state[3:6]
        e_dot = np.cross(w, e)
        below = (NORMAL @ e) * e - NORMAL
        below_dot = (NORMAL @ e_dot) * e + (NORMAL @ e) * e_dot
        size = np.linalg.norm(below)
        r = RADIUS * below / size
        r_dot = RADIUS * (below_dot / size - below * (below @ below_dot) / size**3)
        inertia = ACROSS * np.eye(3) + (ABOUT - ACROSS) * np.outer(e, e)
        arm = pin.skew(r)
        known = MASS * arm @ (np.cross(r_dot, w) - WEIGHT) - (ABOUT - ACROSS) * (w @ e) * e_dot
        return np.concatenate([np.linalg.solve(inertia - MASS * arm @ arm, known), e_dot, np.cross(r, w)])

    start = np.concatenate([w, axle, np.zeros(3)])
    return np.asarray(solve_ivp(rate, (0, times[-1]), start, "DOP853", times, rtol=1e-12, atol=1e-13).y[6:].T)


def cone() -> tuple[rnc.ReducedModel, np.ndarray]:
    """Cone that lies on the level and rolls about its apex, and its rest."""
    base = HEIGHT * np.tan(HALF_ANGLE)
    about, across = 0.3 * base**2, 0.15 * base**2 + 3 / 80 * HEIGHT**2
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root_joint")
    inertia = pin.Inertia(1.0, np.array([0.75 * HEIGHT, 0.0, 0.0]), np.diag([about, across, across]))
    model.appendBodyToJoint(joint, inertia, pin.SE3.Identity())
    model.addFrame(pin.Frame("apex", joint, pin.SE3.Identity(), pin.FrameType.BODY))
    rim = rnc.RollingBody("apex", rnc.Torus(base, axis="x"), at=(HEIGHT, 0.0, 0.0))
    apex = rnc.LoopClosure("universe", "apex", "point")
    reduced = rnc.NonholonomicSystem(rnc.Robot(model), [rim, apex]).reduce([rnc.FrameYaw("apex")])
    lifted = pin.Quaternion(pin.rpy.rpyToMatrix(0.0, -HALF_ANGLE, 0.0)).coeffs()
    return reduced, reduced.robot.configuration({"root_joint": (0, 0, 0, *lifted)})


def rows() -> list[Row]:
    """Cycloid of an upright disk, fall of a free one, energies, and the inertia of a cone."""
    held = upright()
    kept = rnc.free_motion(held, held.robot.configuration(), np.array([0.0, TURN]), 5.0, dt=0.1)
    ours = kept.q[:, :2]
    half = np.pi / TURN  # a half turn of the heading takes it back to its height
    back = rnc.free_motion(held, held.robot.configuration(), np.array([0.0, TURN]), half, dt=half)

    free = falling()
    axle, spin = np.array([0.0, 1.0, 0.0]), np.array([0.4, 6.0, -1.0])
    lean = pin.Quaternion(pin.rpy.rpyToMatrix(0.0, SLOPE, 0.0))
    placed = free.robot.configuration({"root_joint": (*(RADIUS * NORMAL), *lean.coeffs())})
    fall = rnc.free_motion(free, placed, spin, 1.0, dt=0.05)
    centre = newton_and_euler(lean.toRotationMatrix() @ spin, axle, fall.time)

    lying, rest = cone()
    rolled = lying.at(rest, [1.0])
    on_side = "cone on its side: 2 T / (m h^2 rate^2) = 3/20 (1 + 5 cos^2 a)"
    inertia = 3 / 20 * (1 + 5 * np.cos(HALF_ANGLE) ** 2)
    source = "Neimark & Fufaev 1972"
    return [
        Row(source, "upright disk on a slope: cycloid over 5 s [m]", path(kept.time), ours, MOTION),
        Row(source, "the same: descent after half a turn [m]", 0.0, back.q[-1, 0], MOTION, float(np.ptp(ours[:, 0]))),
        conserved("the same: energy", np.ptp(kept.energy) / np.ptp(ours @ [1, 0])),
        Row("Newton and Euler", "free disk on a slope: centre over 1 s [m]", centre, fall.x1 - fall.x1[0], MOTION),
        conserved("the same: energy", np.ptp(fall.energy) / abs(fall.energy[0])),
        Row("Landau & Lifshitz 1976", on_side, inertia, rolled.H[0, 0] / HEIGHT**2, MATRIX),
    ]
