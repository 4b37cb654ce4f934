"""Snakeboard: Ostrowski, Lewis, Murray and Burdick, Nonholonomic mechanics and locomotion (IEEE ICRA 1994).

Both axles are steered by opposite angles and the rotor swings. What is published is the model, its momentum equation
and its gaits (drive 1:1, rotate 2:1); their numbers are plots. So the momentum equation is written out here, and SciPy
integrates it by itself: with forward speed u, steering f, rotor angle s, half length l and total inertia J,

    yaw rate w = u tan(f) / l,      P = (m + J tan(f)^2 / l^2) u + Jr sdot tan(f) / l,
    Pdot = (J w + Jr sdot) fdot / (l cos(f)^2),

which for J = m l^2 is theirs.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from scipy.integrate import solve_ivp

import rnc_pin as rnc
from benchmarks.validation.row import MOTION, Row, conserved

SOURCE = "Ostrowski et al. 1994 (equations)"
HALF = 0.2  # m
JOINTS = ("rotor", "front_steering", "back_steering")
BODIES = {  # place along the board [m], mass [kg], moment of inertia [kg m^2], as in urdf/snakeboard.urdf
    "board": (0.0, 2.4, 0.016),
    "rotor": (0.0, 3.0, 0.072),
    "front": (HALF, 0.3, 0.0013),
    "back": (-HALF, 0.3, 0.0013),
}
GAITS = {"drive": (1.0, 1.0), "rotate": (1.0, 2.0)}  # frequencies of steering and rotor over the base frequency
STEERING, SWING, BASE = 0.3, 0.7, 2.0  # rad, rad, rad/s
DURATION = 15.0


@cache
def snakeboard() -> rnc.ReducedModel:
    """Forward speed, rotor and both axles as reducing outputs; the speed is not driven."""
    robot = rnc.Robot.from_urdf("snakeboard.urdf", base="planar")
    axles = [rnc.NoSideSlip("front_truck"), rnc.NoSideSlip("back_truck")]
    system = rnc.NonholonomicSystem(robot, axles, JOINTS)
    return system.reduce(
        [rnc.FrameSpeed("board"), *(rnc.JointPosition(name) for name in JOINTS)],
        [rnc.FramePosition("board", "xy"), rnc.FrameYaw("board")],
    )


def shape(gait: str, t: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Angles of rotor, front and back axle, their rates and accelerations."""
    steering, rotor = (BASE * factor for factor in GAITS[gait])
    size = np.array([SWING, STEERING, -STEERING])
    rate = np.array([rotor, steering, steering])
    phase = rate * t
    return size * np.sin(phase), size * rate * np.cos(phase), -size * rate**2 * np.sin(phase)


def published(gait: str, times: np.ndarray) -> np.ndarray:
    """Speed, place and heading (N, 4) by the momentum equation."""
    mass = sum(body[1] for body in BODIES.values())
    inertia = sum(body[2] + body[1] * body[0] ** 2 for body in BODIES.values())
    rotor = BODIES["rotor"][2]

    def speed(momentum: float, f: float, s_dot: float) -> float:
        return (momentum - rotor * s_dot * np.tan(f) / HALF) / (mass + inertia * (np.tan(f) / HALF) ** 2)

    def rate(t: float, state: np.ndarray) -> list[float]:
        momentum, _, _, heading = state
        (_, f, _), (s_dot, f_dot, _), _ = shape(gait, t)
        u = speed(momentum, f, s_dot)
        w = u * np.tan(f) / HALF
        force = (inertia * w + rotor * s_dot) * f_dot / (HALF * np.cos(f) ** 2)
        return [force, u * np.cos(heading), u * np.sin(heading), w]

    # From rest but for the rates of the shape: P = Jr sdot tan(f) / l is zero where f is.
    solution = solve_ivp(rate, (0.0, times[-1]), np.zeros(4), "DOP853", times, rtol=1e-13, atol=1e-14)
    speeds = [speed(P, shape(gait, t)[0][1], shape(gait, t)[1][0]) for t, P in zip(times, solution.y[0], strict=True)]
    return np.column_stack([speeds, solution.y[1:].T])


def swimming(gait: str) -> rnc.Trajectory:
    """The whole dynamics, with rotor and axles made to follow the gait by their torques."""
    reduced = snakeboard()

    def torques(t: float, q: np.ndarray, v2: np.ndarray) -> np.ndarray:
        wanted = np.append(0.0, shape(gait, t)[2])
        # The speed is not driven: it accelerates so that no force along it is asked for.
        force = reduced.inverse_dynamics(q, v2, wanted)
        wanted[0] = -force[0] / reduced.at(q).H[0, 0]
        return reduced.inverse_dynamics(q, v2, wanted)[1:]

    start = np.append(0.0, shape(gait, 0.0)[1])
    return rnc.free_motion(reduced, reduced.robot.configuration(), start, DURATION, dt=0.1, inputs=torques)


def rows() -> list[Row]:
    """Speed and trajectory under two gaits, displacement over the run, energy."""
    result = []
    for gait in GAITS:
        run = swimming(gait)
        expected = published(gait, run.time)
        ours = np.column_stack([run.v2[:, 0], run.x1])
        board, moved = f"snakeboard, {gait} gait", [np.linalg.norm(each[-1, 1:3]) for each in (expected, ours)]
        result += [
            Row(SOURCE, f"{board}: displacement after 15 s [m]", *moved, MOTION),
            Row(SOURCE, f"{board}: speed, place and heading over 15 s", expected, ours, MOTION),
            conserved(f"{board}: energy less work", np.ptp(run.energy - run.work) / run.energy.max()),
        ]
    return result
