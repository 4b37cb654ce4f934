"""Lemma 1 and the KKT solution on every system."""

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from systems import ALL, random_states, reacting, without_outputs
from textbook_systems import rail_sliders
from tolerances import CONSTRAINT, FINITE_DIFFERENCE, KKT, LEMMA_1, ROUNDING

STATES = 3
STEP = 4e-4


@pytest.fixture(params=[*ALL, *(f"{name} without outputs" for name in ALL)], scope="module")
def reduced(request):
    name, _, without = request.param.partition(" ")
    return without_outputs(name) if without else ALL[name]()


@pytest.fixture(scope="module")
def states(reduced):
    return random_states(reduced, STATES)


def moved(reduced, q, v, step):
    return pin.integrate(reduced.robot.model, q, step * v)


def derivative(reduced, q, v, function):
    """Central difference, fourth order, of a function of q along v."""
    speed = np.linalg.norm(v)
    f = [function(moved(reduced, q, v / speed, k * STEP)) for k in (-2, -1, 1, 2)]
    return (f[0] - 8 * f[1] + 8 * f[2] - f[3]) / (12 * STEP) * speed


def assert_close(actual, expected, tolerance):
    scale = max(1.0, np.abs(expected).max(initial=0.0))
    np.testing.assert_allclose(actual, expected, rtol=0, atol=tolerance * scale)


def test_basis_satisfies_the_constraints_and_gives_back_the_reducing_outputs(reduced, states):
    for q, v2 in states:
        t = reduced.terms(q, v2)
        lengths = np.linalg.norm(t.A, axis=1, keepdims=True) * np.linalg.norm(t.R)
        assert np.abs(t.A @ t.R / lengths).max(initial=0.0) < CONSTRAINT
        relative = np.abs(reduced.at(q, v=t.v).residual / lengths[:, 0]).max(initial=0.0)
        assert relative < CONSTRAINT * (1 + np.linalg.norm(v2) + np.linalg.norm(t.b))
        assert_close(reduced.at(q).J2 @ t.R, np.eye(reduced.r), ROUNDING)


def test_inertia_is_symmetric_positive_definite_and_its_rate_is_v_plus_its_transpose(reduced, states):
    for q, v2 in states:
        t = reduced.terms(q, v2)
        assert_close(t.H, t.H.T, ROUNDING)
        assert np.linalg.eigvalsh(t.H)[0] > 0
        H_dot = derivative(reduced, q, t.v, lambda p, v2=v2: reduced.terms(p, v2).H)
        assert_close(t.V + t.V.T, H_dot, LEMMA_1)


def test_coriolis_matrix_alone_depends_on_velocity_and_is_linear_in_it(reduced, states):
    for q, v2 in states:
        other = np.flip(v2) + 0.3
        # Weights that add up to one: with affine constraints V is affine, and without it is zero at rest (below).
        V = [reduced.terms(q, each).V for each in (v2, other, 3 * v2 - 2 * other)]
        assert_close(V[2], 3 * V[0] - 2 * V[1], ROUNDING)
        moving, resting = reduced.terms(q, v2), reduced.terms(q, np.zeros_like(v2))
        assert_close(moving.H, resting.H, ROUNDING)
        if not reduced.affine:  # else both hold what the given motion b does
            assert_close(moving.G, resting.G, ROUNDING)
            assert_close(resting.V, np.zeros_like(resting.V), ROUNDING)
            assert not moving.b.any()
            assert not moving.b_dot.any()


def test_rates_of_basis_constraints_and_outputs(reduced, states):
    for q, v2 in states:
        t = reduced.terms(q, v2)
        for rate, name in ((t.R_dot, "R"), (t.A_dot, "A"), (t.A_star_dot, "A_star"), (t.b_dot, "b")):
            difference = derivative(reduced, q, t.v, lambda p, v2=v2, name=name: getattr(reduced.terms(p, v2), name))
            assert_close(rate, difference, FINITE_DIFFERENCE)
        measured, v = reduced.at(q, v2).measure(), t.v
        x1_dot = derivative(reduced, q, v, lambda p: reduced.at(p).outputs()[0])
        x2_dot = derivative(reduced, q, v, lambda p: reduced.at(p).outputs()[1])
        assert_close(measured.v1, x1_dot, FINITE_DIFFERENCE)
        if reduced.affine:
            offset_dot = derivative(reduced, q, v, lambda p, v2=v2: reduced.at(p, v2).measure().v1_offset)
            assert_close(measured.v1_offset_dot, offset_dot, FINITE_DIFFERENCE)
            assert_close(measured.v1, measured.A_star @ v2 + measured.v1_offset, ROUNDING)
        else:
            assert measured.v1_offset is None
        own = ~reduced.reducing.quasi
        assert_close(v2[own], x2_dot[own], FINITE_DIFFERENCE)


def test_acceleration_agrees_with_kkt_and_inverse_dynamics_undoes_it(reduced, states):
    """Pinocchio's saddle-point problem does not impose momenta: that they are conserved has to follow."""
    model = reduced.robot.model
    data = model.createData()
    generator, rows = np.random.default_rng(1), reacting(reduced)
    for q, v2 in states:
        T = generator.normal(size=reduced.p)
        t, full = reduced.terms(q, v2), reduced.lagrangian_terms(q, v2)
        bias_acceleration = t.A_dot[rows] @ t.v  # mu is constant in all of them
        vdot = pin.forwardDynamics(model, data, q, t.v, full.B @ T, t.A[rows], bias_acceleration)
        v2_dot = reduced.forward_dynamics(q, v2, T)
        assert_close(t.R @ v2_dot + t.R_dot @ v2 + t.b_dot, vdot, KKT)
        # The multipliers of the same problem, in the sign of the paper's (1).
        residual = full.B @ T - full.H @ vdot - full.C @ t.v - full.g
        multipliers = reduced.multipliers(q, v2, T)
        assert_close(t.A.T @ multipliers, residual, KKT)
        assert_close(multipliers[~rows], np.zeros((~rows).sum()), KKT * (1 + np.abs(full.B @ T).max()))
        F = t.input_matrix @ T
        assert_close(reduced.inverse_dynamics(q, v2, v2_dot), F, KKT)
        assert_close(t.H @ v2_dot + t.V @ v2 + t.G, F, KKT)
        assert_close(t.input_matrix @ reduced.allocate(q, F), F, KKT)


def test_energy_changes_by_the_power_of_the_actuators(reduced, states, generator):
    for q, v2 in states:
        v, v2_dot, power = reduced.at(q, v2).flow(generator.normal(size=reduced.p))
        h = STEP / np.linalg.norm(v) / 10

        def energy(step, q=q, v=v, v2=v2, v2_dot=v2_dot):
            # Second-order step of q is enough for a central difference of first order in time.
            return reduced.energy(moved(reduced, q, v, step), v2 + step * v2_dot)

        difference = (energy(h) - energy(-h)) / (2 * h)
        rounding = FINITE_DIFFERENCE * np.linalg.norm(v) * (1 + abs(energy(0)))
        assert difference == pytest.approx(power, rel=FINITE_DIFFERENCE, abs=rounding)


def slides(A, A_dot, moving=False):
    """Unit masses, of which the last moves at ``A(q) v2 + 0.4 + q1``; the rates change after they were checked."""
    told = right_rate
    moves = (lambda q: 0.4 + q[1:2], lambda q, v: v[1:2]) if moving else ()
    rows = (lambda q: np.array([[*(-A(q)), 1.0]]), lambda q, v: np.array([[*(-told(q, v)), 0.0]]))
    row = rnc.Pfaffian(*rows, ["row"], *moves)
    reduced = rnc.NonholonomicSystem(rail_sliders(3), [row]).reduce([rnc.JointPosition("s0"), rnc.JointPosition("s1")])
    told = A_dot
    return reduced


def slopes(q):
    return np.array([np.sin(3.0 * q[1]), 2.0 * q[0] * q[2]])


def right_rate(q, v):
    return np.array([3.0 * np.cos(3.0 * q[1]) * v[1], 2.0 * (q[0] * v[2] + q[2] * v[0])])


def wrong_rate(q, v):
    """Too fast, and not linear in the velocity."""
    return (1.2 + 0.1 * v @ v) * right_rate(q, v)


@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize("step", [5e-4, 0.05])
def test_residuals_of_lemma_1_are_those_of_the_slides(moving, step):
    """``R = [1; A]``, so that ``H = 1 + A^T A`` and ``V = A^T Adot``, whatever is said to be the rate of A."""
    reduced = slides(slopes, wrong_rate, moving)
    configurations = np.random.default_rng(5).normal(size=(4, 3))
    seed = 11
    found = rnc.analysis.lemma_1_residuals(reduced, configurations, seed, step)
    draws = np.random.default_rng(seed).uniform(-1, 1, (4, 2))

    def H(q):
        return np.eye(2) + np.outer(slopes(q), slopes(q))

    def V(q, v2):
        v = np.array([*v2, slopes(q) @ v2 + moving * (0.4 + q[1])])
        return v, np.outer(slopes(q), wrong_rate(q, v))

    rate, linear, ratio = [], [], []
    for q, v2 in zip(configurations, draws, strict=True):
        (v, here), (_, doubled), (_, rest) = V(q, v2), V(q, 2 * v2), V(q, 0 * v2)
        speed = np.linalg.norm(v)
        size = np.abs(H(q)).max() * speed + np.abs(here).max()
        h = step / speed
        H_dot = (H(q - 2 * h * v) - 8 * H(q - h * v) + 8 * H(q + h * v) - H(q + 2 * h * v)) / (12 * h)
        rate.append(np.abs(H_dot - here - here.T).max() / size)
        linear.append(np.abs(doubled - 2 * here + rest).max() / size)
        values = np.linalg.eigvalsh(H(q))
        ratio.append(values[0] / values[-1])
    assert found["Hdot - V - V^T"] == pytest.approx(max(rate), rel=1e-9)
    assert found["V linear"] == pytest.approx(max(linear), rel=1e-9)
    assert found["smallest eigenvalue of H"] == pytest.approx(min(ratio), rel=1e-9)
    assert max(found["A R"], found["H - H^T"]) < 1e-14
    if step < 1e-3:
        usual = rnc.analysis.lemma_1_residuals(reduced, configurations, seed)
        assert usual == pytest.approx(found, rel=1e-12)


def test_lemma_1_holds_of_slides():
    found = rnc.analysis.lemma_1_residuals(slides(slopes, right_rate), np.random.default_rng(5).normal(size=(4, 3)))
    assert max(found[name] for name in ("A R", "H - H^T", "Hdot - V - V^T", "V linear")) < 1e-9
    free = rnc.NonholonomicSystem(rail_sliders(1), []).reduce([rnc.JointPosition("s0")])
    assert rnc.analysis.lemma_1_residuals(free, np.zeros((1, 1))) == {
        "A R": 0.0, "H - H^T": 0.0, "Hdot - V - V^T": 0.0, "V linear": 0.0, "smallest eigenvalue of H": 1.0,
    }  # fmt: skip
