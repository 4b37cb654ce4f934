"""Bodies that roll on other bodies: a ball on a table that tilts, a ball on a ball, and two eggs that float.

Neither reference uses Pinocchio. The table has a Lagrangian of one coordinate. The balls have Newton's and Euler's
equations with the contact force as unknown. Two eggs in free space keep energy and both momenta.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from scipy.integrate import solve_ivp

import rnc_pin as rnc
from benchmarks.validation.row import MOTION, Row, conserved

GRAVITY, RADIUS, MASS = 9.81, 0.1, 0.5
TILT, RATE = 0.25, 1.7  # rad, rad/s: the table turns by TILT sin(RATE t) about y
LARGE, INERTIA = 0.4, 0.3  # radius [m] and moment of inertia [kg m^2] of the lower ball, which turns about its centre
EXACT = {"rtol": 1e-12, "atol": 1e-13, "method": "DOP853"}


def pair(*lower: pin.JointModel, mass: float = MASS, gravity: float = GRAVITY) -> pin.Model:
    """A body "lower" behind joints at the origin, and a free homogeneous ball "upper"."""
    model, joint = pin.Model(), 0
    for number, kind in enumerate(lower):
        joint = model.addJoint(joint, kind, pin.SE3.Identity(), f"lower_{number}")
    model.appendBodyToJoint(joint, pin.Inertia(1.0, np.zeros(3), INERTIA * np.eye(3)), pin.SE3.Identity())
    model.addFrame(pin.Frame("lower", joint, pin.SE3.Identity(), pin.FrameType.BODY))
    free = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root_joint")
    model.appendBodyToJoint(free, pin.Inertia.FromSphere(mass, RADIUS), pin.SE3.Identity())
    model.addFrame(pin.Frame("upper", free, pin.SE3.Identity(), pin.FrameType.BODY))
    model.gravity.linear = np.array([0.0, 0.0, -gravity])
    return model


def tilting_rows() -> list[Row]:
    """Place of a ball on a table that a prescribed motion tilts.

    With the place s along the table, ``7/5 (s'' + r a'') = s a'^2 + g sin a`` for the angle a.
    """
    robot = rnc.Robot(pair(pin.JointModelRY()))
    tilting = rnc.PrescribedMotion(
        rnc.JointPosition("lower_0"), rnc.planning.Harmonic([0.0], [TILT], RATE / (2 * np.pi), ramp=0.0)
    )
    rolling = rnc.RollingBall("upper", RADIUS, ground=rnc.GroundPlane(frame="lower"))
    reduced = rnc.NonholonomicSystem(robot, [tilting, rolling]).reduce()
    q0 = robot.configuration({"root_joint": (0.2, 0.0, RADIUS, 0, 0, 0, 1)})
    start = np.linalg.lstsq(reduced.at(q0, t=0.0).R, -reduced.at(q0, np.zeros(reduced.r), t=0.0).v, rcond=None)[0]
    run = rnc.free_motion(reduced, q0, start, 3.0, dt=0.1)
    angle, rate = TILT * np.sin(RATE * run.time), RATE * TILT * np.cos(RATE * run.time)
    places = np.array([pin.utils.rotate("y", a).T @ q[1:4] for a, q in zip(angle, run.q, strict=True)])

    def motion(t: float, state: np.ndarray) -> list[float]:
        a, a_dot, a_ddot = TILT * np.sin(RATE * t), RATE * TILT * np.cos(RATE * t), -(RATE**2) * TILT * np.sin(RATE * t)
        return [state[1], 5 / 7 * (state[0] * a_dot**2 + GRAVITY * np.sin(a)) - RADIUS * a_ddot]

    speed = run.v[0, 1] - RADIUS * rate[0]  # the centre moves at s' + r a'
    found = solve_ivp(motion, (0, 3.0), [0.2, speed], t_eval=run.time, **EXACT).y[0]
    return [Row("Lagrange", "ball on a tilting table: place over 3 s [m]", found, places[:, 0], MOTION)]


def ball_on_ball(time: np.ndarray, normal: np.ndarray, spins: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Centre (N, 3) of a ball on another one that turns about its fixed centre, by Newton and Euler.

    The contact force f is that which keeps ``c' = w2 x r n + w1 x R n``, with the centre ``c = (R + r) n``:
    ``m c'' = f + m g``, ``J2 w2' = -r n x f``, ``J1 w1' = -R n x f``.
    """
    about = 2 / 5 * MASS * RADIUS**2
    weight = np.array([0.0, 0.0, -MASS * GRAVITY])

    def rate(_: float, state: np.ndarray) -> np.ndarray:
        n, lower, upper = state[:3] / (LARGE + RADIUS), state[3:6], state[6:]
        turned = RADIUS * upper + LARGE * lower
        velocity = np.cross(turned, n)
        n_dot = velocity / (LARGE + RADIUS)
        across = pin.skew(n)
        gain = (RADIUS**2 / about + LARGE**2 / INERTIA) * across @ across - np.eye(3) / MASS
        force = np.linalg.solve(gain, weight / MASS - np.cross(turned, n_dot))
        moment = -np.cross(n, force)
        return np.concatenate([velocity, LARGE * moment / INERTIA, RADIUS * moment / about])

    start = np.concatenate([(LARGE + RADIUS) * normal, *spins])
    return np.asarray(solve_ivp(rate, (0, time[-1]), start, t_eval=time, **EXACT).y[:3].T)


def ball_rows() -> list[Row]:
    """Path of a ball that rolls off another one, which turns freely about its centre."""
    robot = rnc.Robot(pair(pin.JointModelSpherical()))
    ground = rnc.SphericalGround(LARGE, inside=False, frame="lower")
    speeds = [rnc.FrameAngularVelocity(frame, axis) for frame in ("lower", "upper") for axis in "xyz"]
    reduced = rnc.NonholonomicSystem(robot, [rnc.RollingBall("upper", RADIUS, ground=ground)]).reduce(speeds)
    normal = np.array([0.2, -0.1, 1.0])
    normal /= np.linalg.norm(normal)
    q0 = robot.configuration({"root_joint": (*(LARGE + RADIUS) * normal, 0, 0, 0, 1)})
    spins = np.array([0.3, -0.4, 2.0]), np.array([1.0, 0.5, -3.0])
    run = rnc.free_motion(reduced, q0, np.concatenate(spins), 0.6, dt=0.02)
    drift, what = np.abs(run.energy / run.energy[0] - 1).max(), "ball on a ball that turns: centre over 0.6 s [m]"
    return [
        Row("Newton and Euler", what, ball_on_ball(run.time, normal, spins), run.q[:, 4:7], MOTION),
        conserved("the same: energy", drift),
    ]


def rows() -> list[Row]:
    """Tilting table, ball on a ball."""
    return [*tilting_rows(), *ball_rows()]
