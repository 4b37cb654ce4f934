"""Roller racer: Krishnaprasad and Tsakiris, Oscillations, SE(2)-snakes and motion control (Dynamical Systems 16, 2001).

The momentum equation is written out here for two bodies with any centres of mass, and SciPy integrates it by itself.
The seat's axle moves forward at u and turns at w, the hinge has the angle f, l is the distance from the first axle to
the hinge and d from the hinge to the second axle (negative behind it). Both axles without side slip give

    w = (u sin f - d fdot) / (l cos f + d),

so k(f) = sin f / (l cos f + d) is the turn per distance with a stiff hinge. With the momentum (px, py) of both bodies
in the axes of the seat and their angular momentum a about its axle,

    P = px + k a,      Pdot = py (w - k u) + a k'(f) fdot.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from scipy.integrate import solve_ivp

import rnc_pin as rnc
from benchmarks.validation.row import MOTION, Row, conserved
from rnc_pin.motion.planning import ReferencePoint

SOURCE = "Krishnaprasad & Tsakiris 2001 (equations)"
HINGE, AXLE = 0.5, -0.1  # m, as in urdf/roller_racer.urdf
SEAT = (50.0, 0.1, 1.6)  # mass, centre from the axle along the seat, moment of inertia about it
BAR = (2.0, -0.06, 0.03)  # the same of the handlebar, from the hinge
AMPLITUDE, PACE, DURATION = 0.7, 5.0, 3.0  # rad, rad/s, s


class Oscillation:
    """Hinge at ``AMPLITUDE sin(PACE t)``, at its full rate from the start."""

    size = 1

    def at(self, t: float) -> ReferencePoint:
        derivatives = -1j * AMPLITUDE * np.exp(1j * PACE * t) * (1j * PACE) ** np.arange(4)
        return ReferencePoint(*derivatives.real[:, None])


@cache
def racer() -> rnc.ReducedModel:
    """Forward speed as the only reducing output: the hinge follows its oscillation."""
    robot = rnc.Robot.from_urdf("roller_racer.urdf", base="planar")
    axles = [rnc.NoSideSlip("rear_axle"), rnc.NoSideSlip("front_axle")]
    hinge = rnc.PrescribedMotion(rnc.JointPosition("hinge"), Oscillation())
    system = rnc.NonholonomicSystem(robot, [*axles, hinge], ["hinge"])
    return system.reduce([rnc.FrameSpeed("seat")], [rnc.FramePosition("seat", "xy"), rnc.FrameYaw("seat")])


def turn_rate(u: float, f: float, rate: float) -> float:
    """Turning rate of the seat at which no axle slips."""
    return (u * np.sin(f) - AXLE * rate) / (HINGE * np.cos(f) + AXLE)


def momentum(u: float, w: float, f: float, rate: float) -> np.ndarray:
    """Momentum along and across the seat, and angular momentum about its axle (3,)."""
    turned = np.exp(1j * f)
    bodies = (
        (SEAT, SEAT[1] + 0j, u + 1j * w * SEAT[1], w),
        (BAR, HINGE + BAR[1] * turned, u + 1j * w * HINGE + 1j * (w + rate) * BAR[1] * turned, w + rate),
    )
    linear = sum(mass * velocity for (mass, _, _), _, velocity, _ in bodies)
    angular = sum(
        mass * (place.conjugate() * velocity).imag + inertia * spin
        for (mass, _, inertia), place, velocity, spin in bodies
    )
    return np.array([linear.real, linear.imag, angular])


def published(times: np.ndarray) -> np.ndarray:
    """Speed, place and heading (N, 4) by the momentum equation."""

    def hinge(t: float) -> tuple[float, float]:
        return AMPLITUDE * np.sin(PACE * t), AMPLITUDE * PACE * np.cos(PACE * t)

    def along(u: float, f: float, rate: float) -> float:
        px, _, a = momentum(u, turn_rate(u, f, rate), f, rate)
        return px + np.sin(f) / (HINGE * np.cos(f) + AXLE) * a

    def speed(P: float, f: float, rate: float) -> float:
        still = along(0.0, f, rate)
        return (P - still) / (along(1.0, f, rate) - still)  # P is linear in u

    def rates(t: float, state: np.ndarray) -> list[float]:
        f, rate = hinge(t)
        u = speed(state[0], f, rate)
        w = turn_rate(u, f, rate)
        _, py, a = momentum(u, w, f, rate)
        width = HINGE * np.cos(f) + AXLE
        slope = (HINGE + AXLE * np.cos(f)) / width**2
        force = py * (w - np.sin(f) / width * u) + a * slope * rate
        return [force, u * np.cos(state[3]), u * np.sin(state[3]), w]

    start = [along(0.0, *hinge(0.0)), 0.0, 0.0, 0.0]
    solution = solve_ivp(rates, (0.0, times[-1]), start, "DOP853", times, rtol=1e-13, atol=1e-13)
    speeds = [speed(P, *hinge(t)) for t, P in zip(times, solution.y[0], strict=True)]
    return np.column_stack([speeds, solution.y[1:].T])


def rows() -> list[Row]:
    """Displacement, trajectory and energy of a run from rest."""
    reduced = racer()
    run = rnc.free_motion(reduced, reduced.robot.configuration(), [0.0], DURATION, dt=0.1)
    expected = published(run.time)
    ours = np.column_stack([run.v2[:, 0], run.x1])
    quantities = ("speed after 3 s [m/s]", "displacement after 3 s [m]")
    pairs = (expected[-1, 0], ours[-1, 0]), tuple(np.linalg.norm(each[-1, 1:3]) for each in (expected, ours))
    return [
        *(Row(SOURCE, f"roller racer: {what}", *pair, MOTION) for what, pair in zip(quantities, pairs, strict=True)),
        Row(SOURCE, "roller racer: speed, place and heading over 3 s", expected, ours, MOTION),
        conserved("roller racer: energy less work of the hinge", np.ptp(run.energy - run.work) / run.energy.max()),
    ]
