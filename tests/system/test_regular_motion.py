"""Constraints of constant rank give regular motion, whatever the outputs and the order of the rows.

A roller racer folds through a configuration where its reducing outputs are dependent; cars with Ackermann steering and
with four steered wheels drive through straight, where the rows of two wheels coincide. The references use neither
rnc_pin nor Pinocchio: planar mechanics, body by body, in NumPy.
"""

from functools import cache
from itertools import permutations

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp

import rnc_pin as rnc
from bodies import add_body, add_frame
from planar_cars import ACKERMANN, FOUR_STEERED, at, directions, integrated, yawing
from tolerances import KKT, ROUNDING

MOTION = 1e-8  # positions and velocities after seconds of free motion, against the reference's own integration
REFERENCE_ENERGY, REFERENCE_CONSTRAINT = 1e-11, 1e-10  # what the references themselves keep


# ---------------------------------------------------------------------- roller racer: outputs that become dependent

L1, L2 = 1.0, 0.4  # rear axle to pivot, pivot to front axle [m]
C1, C2 = 0.3, 0.15  # centres of mass, ahead of the rear axle and of the pivot [m]
M1, M2, I1, I2 = 3.0, 1.2, 0.5, 0.08  # masses [kg] and yaw inertias about the centres of mass [kg m^2]
FOLDED = np.arccos(-L2 / L1)  # of the pivot [rad]
DURATION, SPACING = 3.0, 0.05  # of motions and of their samples [s]
EDGES = ("no_side_slip(rear.y)", "no_side_slip(front.y)")


@cache
def racer():
    """Two bodies, an axle under each, and a pivot in between; nothing drives it."""
    model = pin.Model()
    seat = add_body(model, "root_joint", "Planar", yawing(M1, I1, C1), frame="rear")
    handle = add_body(model, "pivot", "RZ", yawing(M2, I2, C2), seat, at=at(L1))
    add_frame(model, "front", handle, at(L2))
    return rnc.NonholonomicSystem(rnc.Robot(model), [rnc.NoSideSlip("rear"), rnc.NoSideSlip("front")])


@cache
def racer_in_speed_and_pivot(**options):
    return racer().reduce([rnc.FrameSpeed("rear"), rnc.JointPosition("pivot")], **options)


def stack_determinant(pivot):
    """Of ``[A; J2]`` with v = (u, side slip, w, pivot rate) and v2 = (u, pivot rate).

    The rear axle's row is side slip = 0. The front axle moves sideways at ``-u sin(p) + (L1 cos(p) + L2) w + L2 pdot``
    (Krishnaprasad and Tsakiris 2001, The dynamics of the roller racer), so that u and pdot leave w open where its
    factor vanishes. The row itself never does: L2 stands before pdot everywhere.
    """
    return L1 * np.cos(pivot) + L2


def racer_v(pivot, speed, yaw_rate):
    """All velocities (u, side slip, w, pivot rate) from u and w, which parametrise the motion everywhere."""
    pivot_rate = (speed * np.sin(pivot) - stack_determinant(pivot) * yaw_rate) / L2
    return np.stack([speed, 0.0 * speed, yaw_rate, pivot_rate], axis=-1)


MASSES = np.array([M1, M1, I1, M2, M2, I2])


def racer_rows(z):
    """Rows (4, 6) on the velocities of two free bodies, and their rate times these velocities (4,).

    State z (12,): position of the centre of mass and heading of the seat, the same of the handle, and all their rates.
    Rows: the pivot is one point (2), each axle's velocity across its body is zero.
    """
    (_, _, heading, _, _, front_heading), zdot = z[:6], z[6:]
    (along, across), (front_along, front_across) = directions(heading), directions(front_heading)
    w, front_w = zdot[2], zdot[5]
    arm, front_arm = L1 - C1, -C2  # from the centres of mass ahead to the pivot
    rows, bias_acceleration = np.zeros((4, 6)), np.zeros(4)
    rows[:2, :2], rows[:2, 2] = np.eye(2), arm * across
    rows[:2, 3:5], rows[:2, 5] = -np.eye(2), -front_arm * front_across
    bias_acceleration[:2] = -arm * w**2 * along + front_arm * front_w**2 * front_along
    rows[2, :2], rows[2, 2] = across, -C1
    bias_acceleration[2] = -w * along @ zdot[:2]
    rows[3, 3:5], rows[3, 5] = front_across, L2 - C2
    bias_acceleration[3] = -front_w * front_along @ zdot[3:5]
    return rows, bias_acceleration


def racer_rate(t, z):
    """Newton and Euler for the two bodies, with the forces at pivot and axles as multipliers.

    Regular wherever the four rows are independent, which they are everywhere; no mass matrix, no Coriolis terms.
    """
    rows, bias_acceleration = racer_rows(z)
    compliance = rows / MASSES
    forces = np.linalg.solve(compliance @ rows.T, -bias_acceleration)
    return np.concatenate([z[6:], compliance.T @ forces])


def bodies_from_racer(x, y, heading, pivot, v):
    """Both bodies' centres of mass and headings, and their rates (12,), from the racer's own q and v."""
    u, side, w, pivot_rate = v
    (along, across), (front_along, front_across) = directions(heading), directions(heading + pivot)
    axle, axle_dot = np.array([x, y]), u * along + side * across
    front_w = w + pivot_rate
    return np.concatenate([
        axle + C1 * along, [heading], axle + L1 * along + C2 * front_along, [heading + pivot],
        axle_dot + C1 * w * across, [w], axle_dot + L1 * w * across + C2 * front_w * front_across, [front_w],
    ])  # fmt: skip


def racer_from_bodies(z):
    """Pinocchio's q (x, y, cos, sin, pivot) and v of the racer, (..., 5) and (..., 4)."""
    heading, w = z[..., 2], z[..., 8]
    along, across = (np.moveaxis(direction, 0, -1) for direction in directions(heading))
    axle, axle_dot = z[..., :2] - C1 * along, z[..., 6:8] - C1 * w[..., None] * across
    q = np.concatenate([axle, along, (z[..., 5] - heading)[..., None]], axis=-1)
    speed, slip = np.vecdot(along, axle_dot), np.vecdot(across, axle_dot)
    return q, np.stack([speed, slip, w, z[..., 11] - w], axis=-1)


TIMES = np.linspace(0.0, DURATION, round(DURATION / SPACING) + 1)


@cache
def folding_motions(count=6):
    """Reference motions (count, times, 12) from seeded random starts, which fold through dependent outputs."""
    generator, found = np.random.default_rng(7), []
    for _ in range(50 * count):
        x, y, heading, pivot = generator.uniform(-1, 1, 4) * [1, 1, np.pi, np.pi]
        speed, yaw_rate = generator.uniform(-1.5, 1.5, 2)
        if abs(stack_determinant(pivot)) < 0.2:
            continue  # starts are given in the outputs' rates, which have to say what moves
        start = bodies_from_racer(x, y, heading, pivot, racer_v(pivot, speed, yaw_rate))
        z = integrated(racer_rate, start, TIMES)
        determinant = stack_determinant(z[:, 5] - z[:, 2])
        if determinant.min() < -0.1 and determinant.max() > 0.1:
            found.append(z)
            if len(found) == count:
                return np.stack(found)
    raise AssertionError(f"only {len(found)} of {count} motions fold")


def state_when_folded():
    """A regular state of the two bodies (12,) of which the outputs' stack is singular, and moves on."""
    return bodies_from_racer(0.3, -0.2, 0.5, FOLDED, racer_v(FOLDED, 0.9, -0.7))


def test_reference_of_the_racer_keeps_energy_and_constraints():
    z = folding_motions()
    energy = 0.5 * (MASSES * z[..., 6:] ** 2).sum(axis=-1)
    np.testing.assert_allclose(energy, np.broadcast_to(energy[:, :1], energy.shape), rtol=0, atol=REFERENCE_ENERGY)
    for state in z.reshape(-1, 12):
        rows, _ = racer_rows(state)
        np.testing.assert_allclose(rows @ state[6:], 0.0, atol=REFERENCE_CONSTRAINT)
        assert np.linalg.svd(rows / np.linalg.norm(rows, axis=1)[:, None], compute_uv=False)[-1] > 0.05
    seat, handle = z[..., :3], z[..., 3:6]
    gap = seat[..., :2] + np.moveaxis((L1 - C1) * directions(seat[..., 2])[0], 0, -1)
    gap -= handle[..., :2] - np.moveaxis(C2 * directions(handle[..., 2])[0], 0, -1)
    np.testing.assert_allclose(gap, 0.0, atol=REFERENCE_CONSTRAINT)
    # The closed form of the front axle's row, which the determinant is read from, is that of the two bodies.
    q, v = racer_from_bodies(z)
    expected = racer_v(q[..., 4], v[..., 0], v[..., 2])
    np.testing.assert_allclose(v, expected, rtol=0, atol=REFERENCE_CONSTRAINT)
    # They do cross: the determinant changes sign between two samples, and nothing grows on the way.
    determinant = stack_determinant(q[..., 4])
    assert (np.abs(determinant[:, 0]) > 0.2).all()
    assert (np.diff(np.sign(determinant), axis=1) != 0).any(axis=1).all()
    assert np.abs(v).max() < 10


def agree_while_folding(reduced, outputs, z):
    q, v = racer_from_bodies(z)
    run = rnc.free_motion(reduced, q[0], v[0, outputs], DURATION, dt=SPACING, tolerance=1e-12)
    np.testing.assert_allclose(run.time, TIMES, atol=ROUNDING)
    np.testing.assert_allclose(run.q, q, rtol=0, atol=MOTION)
    np.testing.assert_allclose(run.v, v, rtol=0, atol=MOTION)
    np.testing.assert_allclose(run.v2, v[:, outputs], rtol=0, atol=MOTION)
    np.testing.assert_allclose(run.energy, run.energy[0], rtol=1e-9)


@pytest.mark.parametrize("start", range(6))
def test_a_racer_folds_through_dependent_outputs(start):
    agree_while_folding(racer_in_speed_and_pivot(), [0, 3], folding_motions()[start])


def through_the_fold(before=0.5, after=0.5, spacing=0.05):
    """A motion (times, 12) with a sample exactly at the singular configuration, at t = ``before``."""
    ends = (0.0, -before)
    start = solve_ivp(racer_rate, ends, state_when_folded(), "DOP853", rtol=1e-13, atol=1e-13).y[:, -1]
    times = np.linspace(0.0, before + after, round((before + after) / spacing) + 1)
    return times, integrated(racer_rate, start, times)


def v2_of(reduced, q, v):
    """Reducing velocities of a motion v that complies, for outputs that somebody else chose."""
    v2, *_ = np.linalg.lstsq(reduced.terms(q, np.zeros(reduced.r)).R, v)
    np.testing.assert_allclose(reduced.at(q, v2).v, v, atol=ROUNDING)
    return v2


def test_outputs_of_the_plants_own_are_regular_on_the_fold():
    reduced = racer().reduce()
    times, z = through_the_fold()
    q, v = racer_from_bodies(z)
    for i in (0, 9, 10, 11):  # the start; before, on and behind the fold
        v2 = v2_of(reduced, q[i], v[i])
        terms = reduced.terms(q[i], v2)
        vdot = terms.R @ reduced.forward_dynamics(q[i], v2, np.zeros(0)) + terms.R_dot @ v2
        # From accelerations in the world to those of the planar base's own axes.
        zdot = racer_rate(0.0, z[i])
        along, across = directions(z[i, 2])
        slow = zdot[6:8] - C1 * (zdot[8] * across - z[i, 8] ** 2 * along)  # of the rear axle's middle
        w, speed, slip = v[i, 2], v[i, 0], v[i, 1]
        expected = [along @ slow + w * slip, across @ slow - w * speed, zdot[8], zdot[11] - zdot[8]]
        np.testing.assert_allclose(vdot, expected, rtol=0, atol=KKT * np.abs(expected).max())
    run = rnc.free_motion(reduced, q[0], v2_of(reduced, q[0], v[0]), times[-1], dt=times[1])
    np.testing.assert_allclose(run.q, q, rtol=0, atol=MOTION)
    np.testing.assert_allclose(run.v, v, rtol=0, atol=MOTION)


def test_a_measurement_in_dependent_outputs_is_refused():
    """A controller works in the outputs, so for it the fold is singular; it is told which rows meet, and where."""
    reduced = racer_in_speed_and_pivot()
    q, v = racer_from_bodies(state_when_folded())
    with pytest.raises(rnc.SingularityError) as refused:
        reduced.at(q, v[[0, 3]]).measure()
    error = refused.value
    np.testing.assert_allclose(error.q, q, atol=ROUNDING)
    assert error.condition > 1e8
    # The front axle's row is one of u, pivot rate and side slip there.
    assert {"rear_speed_x", "pivot", EDGES[1]} <= set(error.rows) <= {"rear_speed_x", "pivot", *EDGES}
    # Beside the fold there is nothing to refuse.
    for beside in (-1e-3, 1e-3):
        near = np.append(q[:4], FOLDED + beside)
        assert np.isfinite(reduced.at(near, v[[0, 3]]).measure().v).all()


# ---------------------------------------------------------------------- cars: rows that coincide when going straight
CARS = {"ackermann": ACKERMANN, "four-steered": FOUR_STEERED}
ORDERS = list(permutations(["fl", "fr", "bl", "br"]))
# Straight, straight but for so little that rows are nearly dependent, and turning both ways, once very sharply.
CURVATURES = [0.0, 1e-12, -1e-9, 3e-8, 1e-6, -1e-3, 0.2, -0.45, 1.1]

each_car = pytest.mark.parametrize("car", CARS.values(), ids=CARS)
each_order = pytest.mark.parametrize("order", ORDERS[::5], ids=lambda order: "-".join(order))


def car_states(car):
    """Configurations that comply, velocities (u, first steering rate) and inputs, seeded: (curvature, q, v2, T)."""
    generator, states = np.random.default_rng(3), []
    for curvature in CURVATURES:
        q = car.q(generator.uniform(-2, 2, 3), curvature, generator.uniform(-3, 3, 4))
        states.append((curvature, q, generator.uniform(-2, 2, 2), generator.uniform(-20, 20, 3)))
    return states


def close(actual, expected, tolerance):
    """Relative to the largest entry of each state (..., size), or to one."""
    scale = np.maximum(1.0, np.abs(expected).max(axis=-1, keepdims=True))
    np.testing.assert_allclose(actual / scale, expected / scale, rtol=0, atol=tolerance)


CROSSING = np.linspace(0.0, 1.0, 21)


@cache
def through_straight(car):
    """From a left turn through straight into a right turn, with no inputs: by its initial steering rate alone."""
    start = [0.4, -0.3, 0.8, 0.35, 0.1, 0.2, 0.3, 0.4, 1.5, -1.5]
    return car.motion(np.array(start), CROSSING)


@each_car
def test_reference_of_the_cars_keeps_energy_and_constraints(car):
    """The turning centre's coordinates and the KKT solution over all rows are two derivations: they agree."""
    M, _ = car.inertia()
    states, q, v = through_straight(car)
    assert states[0, 3] > 0.3
    assert states[-1, 3] < -0.3
    energy = 0.5 * np.einsum("ti,ij,tj->t", v, M, v)
    np.testing.assert_allclose(energy / energy[0], 1.0, rtol=0, atol=REFERENCE_ENERGY)
    rank = 4 + 2 + len(car.pairs)  # every wheel rolls; the car turns about one centre; the pairs agree upon it
    for q_t, v_t in zip(q, v, strict=True):
        A, _ = car.rows(q_t, v_t)
        np.testing.assert_allclose(A @ v_t, 0.0, atol=REFERENCE_CONSTRAINT)
        np.testing.assert_allclose(car.coupling(q_t)[0], 0.0, atol=REFERENCE_CONSTRAINT)
    for curvature, q, v2, T in car_states(car):
        own = car.own_rates(curvature, v2)
        R, R_dot = car.basis(curvature, own[1])
        v = R @ own
        A, bias_acceleration = car.rows(q, v)
        np.testing.assert_allclose(A @ R, 0.0, atol=1e-14)
        close(A @ R_dot @ own, -bias_acceleration, 1e-13)
        assert np.linalg.matrix_rank(A, tol=1e-11) == rank, "constant on the manifold of the coupling"
        right = R.T @ (car.force(T) - v[2] * car.inertia()[1] @ v - M @ R_dot @ own)
        close(car.acceleration(q, v, T), R @ np.linalg.solve(R.T @ M @ R, right) + R_dot @ own, 1e-11)
    # Away from the manifold it is another.
    q[1 + car.steer("fr")] += 0.2
    assert np.linalg.matrix_rank(car.rows(q, v)[0], tol=1e-6) > rank


@each_car
@each_order
def test_cars_turn_about_their_centre_in_every_order(car, order):
    reduced = car.reduce(order)
    states = car_states(car)
    for curvature, q, v2, _ in states:
        expected = car.basis(curvature)[0] @ car.own_rates(curvature, v2)
        close(reduced.at(q, v2).v, expected, KKT)
    # One call for straight and turning alike: what is chosen for one state must not be kept for the next.
    together = reduced.at(np.stack([q for _, q, _, _ in states]), np.stack([v2 for _, _, v2, _ in states])).v
    expected = [car.basis(curvature)[0] @ car.own_rates(curvature, v2) for curvature, _, v2, _ in states]
    close(together, np.stack(expected), KKT)


@each_car
@each_order
def test_cars_accelerate_as_all_rows_say_in_every_order(car, order):
    reduced = car.reduce(order)
    states, expected = car_states(car), []
    for curvature, q, v2, T in states:
        v = car.basis(curvature)[0] @ car.own_rates(curvature, v2)
        expected.append(car.acceleration(q, v, T))
        terms = reduced.terms(q, v2)
        close(terms.R @ reduced.forward_dynamics(q, v2, T) + terms.R_dot @ v2, expected[-1], KKT)
    q, v2, T = (np.stack([state[i] for state in states]) for i in (1, 2, 3))
    first = 3  # the first steering joint: v2 is (u, its rate)
    close(reduced.forward_dynamics(q, v2, T), np.stack(expected)[:, [0, first]], KKT)


@each_car
@pytest.mark.parametrize("order", ["fl fr bl br", "br bl fr fl"])
def test_cars_steer_through_straight(car, order):
    """If both front wheels, or both steered rear wheels, come first, the first two lateral rows coincide there."""
    _, q, v = through_straight(car)
    reduced = car.reduce(tuple(order.split()))
    run = rnc.free_motion(reduced, q[0], v[0, [0, 3]], CROSSING[-1], dt=CROSSING[1], tolerance=1e-12)
    np.testing.assert_allclose(run.q, q, rtol=0, atol=MOTION)
    np.testing.assert_allclose(run.v, v, rtol=0, atol=MOTION)
