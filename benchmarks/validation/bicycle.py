"""Benchmark bicycle: Meijaard, Papadopoulos, Ruina and Schwab, Proc. R. Soc. A 463 (2007) 1955-1982.

The full nonlinear bicycle is reduced under its six contact rows and linearised about upright rolling. The published
matrices are in tests/data/bicycle_linear.json, evaluated with 50 digits from table 1 of the paper.
"""

from __future__ import annotations

import json
from functools import cache

import numpy as np
import scipy.linalg
from scipy.optimize import brentq

import rnc_pin as rnc
from benchmarks.validation.row import DATA, EIGENVALUE, INVARIANT, MATRIX, Row, conserved

SOURCE = "Meijaard et al. 2007"
REFERENCE = json.loads((DATA / "bicycle_linear.json").read_text())
REAR, FRONT = 0.3, 0.35
LEAN, STEER = "root_joint[3]", "steering"


@cache
def bicycle() -> rnc.ReducedModel:
    """Lean rate, steer rate and the rear wheel's own spin as reducing outputs; nothing but steering driven."""
    g = REFERENCE["parameters"]["g"]
    robot = rnc.Robot.from_urdf("bicycle.urdf", base="free", gravity=(0, 0, -g))
    wheels = [rnc.RollingWheel("rear_wheel", REAR), rnc.RollingWheel("front_wheel", FRONT)]
    system = rnc.NonholonomicSystem(robot, wheels, actuators=["steering"])
    return system.reduce(
        [rnc.FrameAngularVelocity("rear_frame", "x"), rnc.JointPosition("steering"), rnc.JointPosition("rear_axle")],
        [rnc.FrameTilt("rear_frame", "y"), rnc.FramePosition("rear_wheel", "xy")],
    )


def upright(reduced: rnc.ReducedModel | None = None, rear: float = REAR) -> np.ndarray:
    """The configuration that stands upright, heading along x."""
    return (reduced or bicycle()).robot.configuration({"root_joint": (0, 0, rear, 0, 0, 0, 1)})


def linear(speed: float, reduced: rnc.ReducedModel | None = None, rear: float = REAR) -> rnc.Linearization:
    """State (lean, steer, their rates) about rolling straight ahead at a speed [m/s].

    Args:
        speed: of the bicycle.
        reduced: another bicycle than the benchmark, with the same outputs.
        rear: radius of its rear wheel [m].
    """
    reduced = reduced or bicycle()
    kept = [reduced.reducing.names[i] for i in (0, 1)]
    q = upright(reduced, rear)
    return rnc.linearize(reduced, q, [0.0, 0.0, speed / rear], coordinates=[LEAN, STEER], rates=kept)


def matrices(
    reduced: rnc.ReducedModel | None = None, rear: float = REAR, g: float = REFERENCE["parameters"]["g"]
) -> dict[str, np.ndarray]:
    """M, C1, K0 and K2 of ``M x'' + v C1 x' + (g K0 + v^2 K2) x = f``, of the benchmark or another bicycle."""
    v, model = 5.0, reduced or bicycle()
    M = model.at(upright(model, rear)).H[:2, :2]
    at_rest, moving = (-M @ linear(speed, model, rear).A[2:] for speed in (0.0, v))
    return {"M": M, "C1": moving[:, 2:] / v, "K0": at_rest[:, :2] / g, "K2": (moving[:, :2] - at_rest[:, :2]) / v**2}


def weave_speed() -> float:
    """Speed at which the oscillation stops growing [m/s]."""

    def growth(speed: float) -> float:
        values = linear(speed).eigenvalues
        return float(values[np.abs(values.imag) > 1e-3].real.max())

    return float(brentq(growth, 4.0, 5.0, xtol=1e-13, rtol=1e-14))


def capsize_speed() -> float:
    """Speed at which slow capsizing begins [m/s]: a real eigenvalue, and so the determinant, is zero."""
    return float(brentq(lambda speed: np.linalg.det(linear(speed).A), 5.5, 7.0, xtol=1e-13, rtol=1e-14))


def released(speed: float, duration: float, size: float) -> np.ndarray:
    """State (4,) over the lean rate [rad/s] that the nonlinear bicycle is let go with."""
    reduced, q = bicycle(), upright()
    run = rnc.free_motion(reduced, q, [size, 0.0, speed / REAR], duration, dt=duration, tolerance=(1e-13, 1e-15))
    return np.array([run.x1[-1, 0], run.q[-1, 9], run.v2[-1, 0], run.v2[-1, 1]]) / size


def small_motion(speed: float, duration: float, size: float = 2e-4) -> tuple[np.ndarray, np.ndarray]:
    """State (4,) over a small lean rate: of the nonlinear bicycle, and by the published matrices.

    Left and right are alike, so that the linear motion is left by the square of the lean rate, which two of them
    cancel: where one is small enough by itself, rounding in 10 m of rolling is as large as the tolerance.
    """
    nonlinear = (4.0 * released(speed, duration, size) - released(speed, duration, 2.0 * size)) / 3.0
    published = REFERENCE["linear"]
    M, C1, K0, K2 = (np.array(published[name]) for name in ("M", "C1", "K0", "K2"))
    stiffness = REFERENCE["parameters"]["g"] * K0 + speed**2 * K2
    A = np.block([[np.zeros((2, 2)), np.eye(2)], [-np.linalg.solve(M, stiffness), -np.linalg.solve(M, speed * C1)]])
    return nonlinear, scipy.linalg.expm(A * duration) @ np.array([0.0, 0.0, 1.0, 0.0])


def in_order(values: np.ndarray) -> np.ndarray:
    """Eigenvalues by real part, then by imaginary part, up to rounding: conjugate pairs may come in either order."""
    return values[np.lexsort((values.imag, values.real.round(9)))]


def rows() -> list[Row]:
    """Matrices, eigenvalues at eleven speeds, critical speeds, and nonlinear motions."""
    found = matrices()
    result = [Row(SOURCE, f"matrix {name}", REFERENCE["linear"][name], found[name], MATRIX) for name in found]
    for speed in range(11):
        published = REFERENCE["linear"]["eigenvalues"][str(speed)]
        expected = np.array(published["real"]) + 1j * np.array(published["imag"])
        ours, expected = in_order(linear(float(speed)).eigenvalues), in_order(expected)
        worst = np.abs(ours - expected) / np.abs(expected)
        k = int(np.argmax(worst))
        result.append(Row(SOURCE, f"eigenvalues at {speed} m/s, worst of 4", expected[k], complex(ours[k]), EIGENVALUE))
    special = REFERENCE["linear"]["special_speeds"]
    result.append(Row(SOURCE, "weave speed [m/s]", special["v_w"], weave_speed(), EIGENVALUE))
    result.append(Row(SOURCE, "capsize speed [m/s]", special["v_c"], capsize_speed(), EIGENVALUE))
    for speed, word in ((3.5, "weaves"), (5.0, "settles")):
        nonlinear, published = small_motion(speed, 2.0)
        moved = f"nonlinear bicycle at {speed} m/s after 2 s ({word})"
        result.append(Row(SOURCE, moved, published, nonlinear, EIGENVALUE))
    run = rnc.free_motion(bicycle(), upright(), np.array([0.3, 0.0, 5.0 / REAR]), 60.0, dt=0.5)
    drift, lift = np.abs(run.energy / run.energy[0] - 1).max(), run.position_residual.max()
    return [
        *result,
        conserved("bicycle: energy over 60 s", drift),
        Row("conservation", "bicycle: wheels off the ground over 60 s [m]", 0.0, lift, INVARIANT, 1.0),
    ]
