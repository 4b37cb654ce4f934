"""Constraints of constant rank give regular motion, whatever the outputs."""

from functools import cache

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp

import rnc_pin as rnc
from bodies import add_body, add_frame

MOTION = 1e-8  # positions and velocities after seconds of free motion, against the reference's own integration

L1, L2 = 1.0, 0.4  # rear axle to pivot, pivot to front axle [m]
C1, C2 = 0.3, 0.15  # centres of mass, ahead of the rear axle and of the pivot [m]
M1, M2, I1, I2 = 3.0, 1.2, 0.5, 0.08  # masses [kg] and yaw inertias about the centres of mass [kg m^2]
FOLDED = np.arccos(-L2 / L1)  # of the pivot [rad]
TIMES = np.linspace(0.0, 1.0, 21)  # [s]; folded at the middle
EDGES = ("no_side_slip(rear.y)", "no_side_slip(front.y)")


@cache
def racer():
    """Two bodies, an axle under each, and a pivot in between; nothing drives it."""
    model = pin.Model()
    seat = add_body(model, "root_joint", "Planar", M1, com=(C1, 0, 0), moments=I1, frame="rear")
    handle = add_body(model, "pivot", "RZ", M2, seat, com=(C2, 0, 0), moments=I2, at=(L1, 0, 0))
    add_frame(model, "front", handle, (L2, 0, 0))
    return rnc.NonholonomicSystem(rnc.Robot(model), [rnc.NoSideSlip("rear"), rnc.NoSideSlip("front")])


def directions(angle):
    """Unit vectors along and across."""
    return np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])


def racer_rate(t, z):
    """Newton and Euler for two free bodies, with the forces at pivot and axles as multipliers.

    State z (12,): position of the centre of mass and heading of the seat, the same of the handle, and all their rates.
    Rows: the pivot is one point (2), each axle's velocity across its body is zero. Regular everywhere.
    """
    zdot, w, front_w = z[6:], z[8], z[11]
    (along, across), (front_along, front_across) = directions(z[2]), directions(z[5])
    arm, front_arm = L1 - C1, -C2  # from the centres of mass ahead to the pivot
    rows, bias_acceleration = np.zeros((4, 6)), np.zeros(4)
    rows[:2, :2], rows[:2, 2] = np.eye(2), arm * across
    rows[:2, 3:5], rows[:2, 5] = -np.eye(2), -front_arm * front_across
    bias_acceleration[:2] = -arm * w**2 * along + front_arm * front_w**2 * front_along
    rows[2, :2], rows[2, 2], bias_acceleration[2] = across, -C1, -w * along @ zdot[:2]
    rows[3, 3:5], rows[3, 5] = front_across, L2 - C2
    bias_acceleration[3] = -front_w * front_along @ zdot[3:5]
    compliance = rows / np.array([M1, M1, I1, M2, M2, I2])
    return np.concatenate([zdot, compliance.T @ np.linalg.solve(compliance @ rows.T, -bias_acceleration)])


def folded(speed=0.9, w=-0.7):
    """Both bodies (12,) at the fold, where the outputs say nothing of the yaw rate w, and the state moves on.

    The front axle moves sideways at ``-u sin(p) + (L1 cos(p) + L2) w + L2 pdot`` (Krishnaprasad and Tsakiris 2001, The
    dynamics of the roller racer), so that u and pdot leave w open where its factor vanishes.
    """
    heading, front_w = 0.5, w + speed * np.sin(FOLDED) / L2
    (along, across), (front_along, front_across) = directions(heading), directions(heading + FOLDED)
    return np.concatenate([
        C1 * along, [heading], L1 * along + C2 * front_along, [heading + FOLDED],
        speed * along + C1 * w * across, [w], speed * along + L1 * w * across + C2 * front_w * front_across, [front_w],
    ])  # fmt: skip


def racer_from_bodies(z):
    """Pinocchio's q (x, y, cos, sin, pivot) and v of the racer, (..., 5) and (..., 4)."""
    heading, w = z[..., 2], z[..., 8]
    along, across = (np.moveaxis(direction, 0, -1) for direction in directions(heading))
    axle, axle_dot = z[..., :2] - C1 * along, z[..., 6:8] - C1 * w[..., None] * across
    q = np.concatenate([axle, along, (z[..., 5] - heading)[..., None]], axis=-1)
    return q, np.stack([np.vecdot(along, axle_dot), np.vecdot(across, axle_dot), w, z[..., 11] - w], axis=-1)


@pytest.mark.parametrize("outputs", [[rnc.FrameSpeed("rear"), rnc.JointPosition("pivot")], None])
@pytest.mark.parametrize("w", [-0.7, 0.4])
def test_a_racer_folds_through_dependent_outputs(outputs, w):
    exact = {"method": "DOP853", "rtol": 1e-13, "atol": 1e-13}
    start = solve_ivp(racer_rate, (0.0, -0.5), folded(w=w), **exact).y[:, -1]
    z = solve_ivp(racer_rate, (0.0, 1.0), start, t_eval=TIMES, **exact).y.T
    q, v = racer_from_bodies(z)
    assert np.cos(q[0, 4] - FOLDED) < np.cos(q[10, 4] - FOLDED)
    reduced = racer().reduce(outputs)
    v2 = np.linalg.lstsq(reduced.at(q[0]).R, v[0])[0]
    run = rnc.free_motion(reduced, q[0], v2, TIMES[-1], dt=TIMES[1], tolerance=1e-12)
    np.testing.assert_allclose(run.q, q, rtol=0, atol=MOTION)
    np.testing.assert_allclose(run.v, v, rtol=0, atol=MOTION)
    np.testing.assert_allclose(run.energy, run.energy[0], rtol=1e-9)
