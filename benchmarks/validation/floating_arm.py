"""Free-floating arm: generalized Jacobian and inertia, and the turn of the base that a loop of the joints leaves.

Umetani and Yoshida, IEEE Trans. Robotics and Automation 5 (1989) 303-314.

The textbook side is written out by hand for the planar arm: complex numbers, sums over the bodies, no Pinocchio.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from scipy.integrate import quad

import rnc_pin as rnc
from benchmarks.validation.row import MATRIX, MOTION, Row, conserved

SOURCE = "Umetani & Yoshida 1989"
MASSES, INERTIAS = (40.0, 4.0, 3.0), (7.0, 0.35, 0.2)
MOUNT, UPPER, CENTRES, FOREARM = 0.5, 1.0, (0.5, 0.4), 0.8


@cache
def arm() -> rnc.ReducedModel:
    """Both joints driven, nothing else; hand and attitude of the satellite as vertical outputs."""
    robot = rnc.Robot.from_urdf("floating_arm.urdf", base="planar", gravity=(0, 0, 0))
    joints = ["shoulder", "elbow"]
    system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("root_joint")], joints)
    return system.reduce(
        [rnc.JointPosition(name) for name in joints], [rnc.FramePosition("hand", "xy"), rnc.FrameYaw("satellite")]
    )


def textbook(yaw: float, shoulder: float, elbow: float) -> tuple[np.ndarray, np.ndarray]:
    """Inertia matrix (5, 5) and hand Jacobian (2, 5) for rates of base (x, y, yaw) and joints, in world axes."""
    headings = np.exp(1j * np.cumsum([yaw, shoulder, elbow]))
    pivots = np.cumsum([0.0, MOUNT * headings[0], UPPER * headings[1]])  # of base, shoulder, elbow, from the base
    centres = [0.0, pivots[1] + CENTRES[0] * headings[1], pivots[2] + CENTRES[1] * headings[2]]

    def jacobian(point: complex, body: int) -> np.ndarray:
        turning = [1j * (point - pivots[k]) if k <= body else 0.0 for k in range(3)]
        columns = np.array([1.0, 1j, *turning])
        return np.vstack([columns.real, columns.imag])

    H = np.zeros((5, 5))
    for body, (mass, inertia, centre) in enumerate(zip(MASSES, INERTIAS, centres, strict=True)):
        spin = np.array([0.0, 0.0, *(float(k <= body) for k in range(3))])
        linear = jacobian(centre, body)
        H += mass * linear.T @ linear + inertia * np.outer(spin, spin)
    return H, jacobian(pivots[2] + FOREARM * headings[2], 2)


def generalized(yaw: float, shoulder: float, elbow: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """``Hm - Hbm^T Hs^-1 Hbm``, generalized Jacobian ``Jm - Js Hs^-1 Hbm``, and rates of the base ``-Hs^-1 Hbm``."""
    H, J = textbook(yaw, shoulder, elbow)
    base = -np.linalg.solve(H[:3, :3], H[:3, 3:])
    return H[3:, 3:] + H[:3, 3:].T @ base, J[:, 3:] + J[:, :3] @ base, base


def loop(s: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A closed path of the joints in 0 <= s <= 2 pi, with its first and second derivatives."""
    centre, size = np.array([0.4, 1.1]), np.array([0.9, 0.7])
    sine, cosine = np.sin(s), np.cos(s)
    return (
        centre + size * np.array([cosine, sine]),
        size * np.array([-sine, cosine]),
        size * np.array([-cosine, -sine]),
    )


def rows() -> list[Row]:
    """Matrices at random states, and the holonomy of a loop."""
    reduced, generator = arm(), np.random.default_rng(4)
    worst: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    for _ in range(20):
        x, y, yaw, shoulder, elbow = generator.uniform(-3, 3, 5)
        q = reduced.robot.configuration({"root_joint": (x, y, yaw), "shoulder": shoulder, "elbow": elbow})
        terms = reduced.terms(q, np.zeros(2))
        inertia, jacobian, base = generalized(yaw, shoulder, elbow)
        for name, pair in {
            "generalized inertia R^T H* R": (inertia, terms.H),
            "generalized Jacobian": (jacobian, terms.A_star[:2]),
            "base turn for joint rates": (base[2:], terms.A_star[2:]),
        }.items():
            if name not in worst or np.abs(pair[0] - pair[1]).max() > np.abs(worst[name][0] - worst[name][1]).max():
                worst[name] = pair
    result = [Row(SOURCE, f"arm: {name}, worst of 20 states", *pair, MATRIX) for name, pair in worst.items()]

    def turn_rate(s: float) -> float:
        joints, rates, _ = loop(s)
        return float(generalized(0.0, *joints)[2][2] @ rates)

    turned = quad(turn_rate, 0, 2 * np.pi, epsabs=1e-13, epsrel=1e-13)[0]

    def torques(t: float, q: np.ndarray, v2: np.ndarray) -> np.ndarray:
        return reduced.inverse_dynamics(q, v2, loop(t)[2])

    start, rates, _ = loop(0.0)
    q0 = reduced.robot.configuration({"shoulder": start[0], "elbow": start[1]})
    run = rnc.free_motion(reduced, q0, rates, 2 * np.pi, dt=np.pi / 50, inputs=torques)
    loops, ours = "arm: turn of the base over a closed loop [rad]", run.x1[-1, 2] - run.x1[0, 2]
    drift = np.ptp(run.energy - run.work) / run.energy.max()
    result.append(Row("holonomy (quadrature)", loops, turned, ours, MOTION))
    return [*result, conserved("arm: energy less work over the loop", drift)]
