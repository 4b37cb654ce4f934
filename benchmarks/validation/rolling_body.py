"""Bodies whose contact point moves over them: a rattleback and a Chaplygin ball.

Kane and Levinson, Int. J. Non-Linear Mechanics 17 (1982) 175-186; Garcia and Hubbard, Proc. R. Soc. A 418 (1988)
165-197; Chaplygin, Matematicheskii Sbornik 24 (1903) 139-168.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from scipy.integrate import solve_ivp

import rnc_pin as rnc
from benchmarks.validation.row import EIGENVALUE, MOTION, Row, conserved

GRAVITY, UP = 9.81, np.array([0.0, 0.0, 1.0])
SEMI_AXES, RISE = np.array([0.2, 0.03, 0.02]), -0.01  # m; the centre of mass is below the centre
SKEW = 0.2  # rad between the axes of inertia and of the ellipsoid
MOMENTS = np.array([2e-4, 1.6e-3, 1.7e-3])  # kg m^2, of 1 kg
RADIUS, BALL_MASS, BALL_MOMENTS = 0.3, 2.0, np.array([0.03, 0.05, 0.07])


def rolling(mass: float, inertia: np.ndarray, lever: np.ndarray, shape: rnc.Ellipsoid | rnc.Sphere) -> rnc.ReducedModel:
    """A body on a free base, its angular velocities as reducing outputs."""
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root_joint")
    model.appendBodyToJoint(joint, pin.Inertia(mass, lever, inertia), pin.SE3.Identity())
    model.addFrame(pin.Frame("body", joint, pin.SE3.Identity(), pin.FrameType.BODY))
    model.gravity.linear = -GRAVITY * UP
    system = rnc.NonholonomicSystem(rnc.Robot(model), [rnc.RollingBody("body", shape)])
    return system.reduce([rnc.FrameAngularVelocity("body", axis) for axis in "xyz"])


def rattleback_inertia() -> np.ndarray:
    """Rotational inertia about the centre of mass, in the axes of the ellipsoid."""
    turn = pin.rpy.rpyToMatrix(0.0, 0.0, SKEW)
    return turn @ np.diag(MOMENTS) @ turn.T


def skew(vector: np.ndarray) -> np.ndarray:
    """Matrix (3, 3) of the vector product; of complex numbers too."""
    x, y, z = vector
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])


def rates(state: np.ndarray) -> np.ndarray:
    """Rates of the angular velocity w and of the vertical u (6,) of the rattleback, in its own axes.

    The equations share no code with the package. With the arm r from the centre of mass to the contact,
    ``I wdot + w x I w = r x m (r x wdot + rdot x w + w x (r x w) + g u)`` and ``udot = u x w``.
    """
    w, u, inertia, squares = state[:3], state[3:], rattleback_inertia(), SEMI_AXES**2
    support = (u @ (squares * u)) ** 0.5
    point = -squares * u / support  # from the centre to the contact
    r = point - np.array([0.0, 0.0, RISE])
    u_dot = skew(u) @ w
    r_dot = -squares * u_dot / support + squares * u * (u @ (squares * u_dot)) / support**3
    arm, turning = skew(r), skew(w)
    known = skew(r_dot) @ w + turning @ (arm @ w) + GRAVITY * u
    right = arm @ known - turning @ (inertia @ w)
    return np.concatenate([np.linalg.solve(inertia - arm @ arm, right), u_dot])


def newton_and_euler(w0: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Angular velocity (N, 3) of the rattleback in its own axes, by SciPy."""
    start = np.concatenate([w0, UP])
    found = solve_ivp(lambda _, state: rates(state), (0, times[-1]), start, "DOP853", times, rtol=1e-12, atol=1e-13)
    return np.asarray(found.y[:3].T)


def ordered(values: np.ndarray) -> np.ndarray:
    """The four eigenvalues that are not zero."""
    kept = values[np.argsort(np.abs(values))[-4:]]
    return np.asarray(kept[np.lexsort((kept.imag, kept.real.round(6)))])


def eigenvalues(stone: rnc.ReducedModel, upright: np.ndarray, spin: float) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvalues (4,) of a steady spin [rad/s]: by complex steps of the equations here, and by the package."""
    steady, step = np.array([0.0, 0.0, spin, *UP]), 1e-30
    expected = np.imag([rates(steady + 1j * step * e) for e in np.eye(6)]).T / step
    tilts = [rnc.FrameTilt("body", axis) for axis in "xy"]
    ours = rnc.linearize(stone, upright, steady[:3], coordinates=tilts)
    return ordered(np.linalg.eigvals(expected)), ordered(ours.eigenvalues)


def rows() -> list[Row]:
    """Spin of a rattleback that reverses; first integrals of it and of a Chaplygin ball."""
    stone = rolling(1.0, rattleback_inertia(), np.array([0.0, 0.0, RISE]), rnc.Ellipsoid(SEMI_AXES))
    start = np.array([0.3, 0.0, -5.0])
    upright = stone.assembled(stone.robot.configuration({"root_joint": (0, 0, SEMI_AXES[2], 0, 0, 0, 1)}))
    run = rnc.free_motion(stone, upright, start, 1.0, dt=0.05)
    expected = newton_and_euler(start, run.time)
    kinetic = 0.5 * MOMENTS[2] * start[2] ** 2

    ball = rolling(BALL_MASS, np.diag(BALL_MOMENTS), np.zeros(3), rnc.Sphere(RADIUS))
    placed = ball.robot.configuration({"root_joint": (0, 0, RADIUS, 0.5, 0.1, -0.3, np.sqrt(0.65))})
    rolled = rnc.free_motion(ball, placed, np.array([1.0, -2.0, 1.5]), 5.0, dt=0.1)
    arm = RADIUS * UP  # from the contact to the centre
    momenta = []
    for q, w in zip(rolled.q, rolled.v2, strict=True):
        R = pin.Quaternion(q[3:7]).toRotationMatrix()
        momenta.append(R @ (BALL_MOMENTS * w) + BALL_MASS * np.cross(arm, np.cross(R @ w, arm)))
    held = np.broadcast_to(momenta[0], (len(momenta), 3))
    equations = "Garcia & Hubbard 1988 (equations)"
    spins = np.linspace(-20.0, 20.0, 9)  # either direction has a pair that grows
    worst = "rattleback: eigenvalues at nine spins from -20 to 20 rad/s, worst of 36"
    linear = np.array([eigenvalues(stone, upright, spin) for spin in spins])
    return [
        Row(equations, worst, linear[:, 0].ravel(), linear[:, 1].ravel(), EIGENVALUE),
        Row(equations, "rattleback: angular velocity over 1 s, reversal included [rad/s]", expected, run.v2, MOTION),
        Row(equations, "rattleback: spin after 1 s, from -5 [rad/s]", expected[-1, 2], run.v2[-1, 2], MOTION),
        conserved("rattleback: energy", np.ptp(run.energy) / kinetic),
        Row("Chaplygin 1903", "ball: angular momentum about the contact over 5 s", held, np.array(momenta), MOTION),
        conserved("Chaplygin ball: energy", np.ptp(rolled.energy) / rolled.energy[0]),
    ]
