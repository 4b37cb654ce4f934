"""Constraints that depend on time: a pendulum on a shaken pivot, and a knife edge that turns at a given rate.

P. L. Kapitza, Soviet Physics JETP 21 (1951); N. W. McLachlan, Theory and Application of Mathieu Functions (1947).
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import scipy

import rnc_pin as rnc
from benchmarks.validation.row import MOTION, Row, conserved
from rnc_pin.motion.planning import ReferencePoint

LENGTH, MASS, GRAVITY = 0.4, 1.3, 9.81  # m, kg, m/s^2
SHAKEN, RATE = 0.1, 32.0  # m, rad/s: (SHAKEN RATE)^2 > 2 g l keeps the pendulum upright
TILT, DURATION = 0.3, 1.0
SMALL = 1e-5  # rad, of the linear motions


class Cosine:
    """Pivot at ``amplitude cos(rate t)``."""

    size = 1

    def __init__(self, amplitude: float) -> None:
        self.amplitude = amplitude

    def at(self, t: float) -> ReferencePoint:
        derivatives = self.amplitude * np.exp(1j * RATE * t) * (1j * RATE) ** np.arange(4)
        return ReferencePoint(*derivatives.real[:, None])


def pendulum(amplitude: float, gravity: float = GRAVITY) -> rnc.ReducedModel:
    """Point mass on a massless rod; at angle zero it stands upright."""
    model = pin.Model()
    pivot = model.addJoint(0, pin.JointModelPZ(), pin.SE3.Identity(), "pivot")
    model.appendBodyToJoint(pivot, pin.Inertia(0.5, np.zeros(3), 1e-3 * np.eye(3)), pin.SE3.Identity())
    hinge = model.addJoint(pivot, pin.JointModelRY(), pin.SE3.Identity(), "hinge")
    bob = pin.Inertia(MASS, np.array([0.0, 0.0, LENGTH]), np.zeros((3, 3)))
    model.appendBodyToJoint(hinge, bob, pin.SE3.Identity())
    model.gravity.linear[:] = 0.0, 0.0, -gravity
    driven = rnc.PrescribedMotion(rnc.JointPosition("pivot"), Cosine(amplitude))
    return rnc.NonholonomicSystem(rnc.Robot(model), [driven], ["hinge"]).reduce()


def trace_over_a_period(amplitude: float, gravity: float) -> float:
    """Trace of the map of small angles and rates over one period of the pivot: -2 and 2 bound the stable motions."""
    reduced, period = pendulum(amplitude, gravity), 2 * np.pi / RATE
    one = rnc.free_motion(reduced, np.array([amplitude, SMALL]), [0.0], period, period)
    other = rnc.free_motion(reduced, np.array([amplitude, 0.0]), [SMALL], period, period)
    return float(one.q[-1, 1] + other.v2[-1, 0]) / SMALL


def turning_edge(speed: float = 0.8, rate: float = 1.7) -> tuple[rnc.Trajectory, np.ndarray]:
    """Run of a mass on a knife edge whose direction turns over time, and the circle that it has to draw."""
    model = pin.Model()
    x = model.addJoint(0, pin.JointModelPX(), pin.SE3.Identity(), "x")
    y = model.addJoint(x, pin.JointModelPY(), pin.SE3.Identity(), "y")
    model.appendBodyToJoint(y, pin.Inertia(2.0, np.zeros(3), np.eye(3)), pin.SE3.Identity())
    edge = rnc.Pfaffian(lambda q, t: np.array([[np.sin(rate * t), -np.cos(rate * t)]]), names=["edge"], rheonomic=True)
    run = rnc.free_motion(rnc.NonholonomicSystem(rnc.Robot(model), [edge]).reduce(), np.zeros(2), [speed], 4.0, 0.1)
    angle = rate * run.time
    return run, speed / rate * np.stack([np.sin(angle), 1 - np.cos(angle)], axis=1)


def rows() -> list[Row]:
    """Angle over time, work of the pivot, bounds of stability and a circle."""
    run = rnc.free_motion(pendulum(SHAKEN), np.array([SHAKEN, TILT]), [0.0], DURATION, 0.1)

    def rates(t: float, x: np.ndarray) -> list[float]:
        return [x[1], (GRAVITY - SHAKEN * RATE**2 * np.cos(RATE * t)) / LENGTH * np.sin(x[0])]

    times = run.time
    angle = scipy.integrate.solve_ivp(rates, (0, times[-1]), [TILT, 0.0], "DOP853", times, rtol=1e-13, atol=1e-13).y[0]
    # Mathieu's equation x'' + (A - 2 q cos 2s) x = 0 has A = -4 g / (l rate^2) and q = 2 amplitude / l.
    q = scipy.optimize.brentq(lambda q: scipy.special.mathieu_b(1, q), 0.5, 1.2, xtol=1e-14)
    least = 0.5
    weight = -scipy.special.mathieu_a(0, least) * LENGTH * RATE**2 / 4
    first, other = (trace_over_a_period(a * LENGTH / 2, g) for a, g in ((q, 0.0), (least, weight)))
    edge, circle = turning_edge()
    return [
        Row("Kapitza 1951 (equation)", "pendulum on a shaken pivot: angle over 1 s [rad]", angle, run.q[:, 1], MOTION),
        conserved("the same: energy less work of the pivot", np.ptp(run.energy - run.work) / np.ptp(run.energy)),
        Row("McLachlan 1947", "no gravity, amplitude 0.454 l: trace over a period", -2.0, first, MOTION),
        Row("McLachlan 1947", "amplitude l / 4, largest gravity that it bears: trace", 2.0, other, MOTION),
        Row("closed form", "knife edge that turns over time: circle [m]", circle, edge.q, MOTION),
    ]
