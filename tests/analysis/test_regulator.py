"""Regulators, linear models and combinations of rows of systems written down, beside closed forms."""

import numpy as np
import pytest
import scipy.linalg

import rnc_pin as rnc
from rnc_pin.analysis import integrability
from systems import four_bar
from textbook_systems import linear, planar_model, rail_sliders, unicycle

# ---------------------------------------------------------------------- the regulator


@pytest.mark.parametrize("a", [-0.7, 0.0, 1.3])
def test_the_gain_of_one_state_is_that_of_the_closed_form(a):
    b, q, r = 0.8, 3.0, 0.5
    expected = (a + np.sqrt(a**2 + b**2 * q / r)) / b
    for state_cost in (q, [q], {"x0": q}, [[q]]):
        for input_cost in (r, [r], {"u0": r}, [[r]]):
            np.testing.assert_allclose(rnc.lqr(linear([[a]], [[b]]), state_cost, input_cost), [[expected]])


def test_a_gain_for_inputs_that_cost_together_is_the_least():
    """No other gain costs less: the cost of a start x is ``x^T P x``, by the equation of Lyapunov."""
    generator = np.random.default_rng(0)
    system = linear(generator.normal(size=(3, 3)), generator.normal(size=(3, 2)))
    Q, R = np.diag([1.0, 0.0, 2.0]), np.array([[2.0, 0.7], [0.7, 0.5]])
    K = rnc.lqr(system, {"x0": 1.0, "x2": 2.0}, R)

    def cost(gain):
        closed = system.A - system.B @ gain
        assert np.linalg.eigvals(closed).real.max() < 0
        return np.trace(scipy.linalg.solve_continuous_lyapunov(closed.T, -(Q + gain.T @ R @ gain)))

    for i in np.ndindex(K.shape):
        step = np.zeros(K.shape)
        step[i] = 1e-4
        assert abs(cost(K + step) - cost(K - step)) / 2e-4 < 1e-6 * cost(K)
        assert cost(K) < min(cost(K + step), cost(K - step))


def test_what_grows_and_costs_nothing_is_mirrored():
    """The cheapest way to stop it: from a rate of 1.5 to one of -1.5. What fades by itself is left alone."""
    np.testing.assert_allclose(rnc.lqr(linear([[1.5]], [[0.5]]), 0.0), [[6.0]])
    K = rnc.lqr(linear(np.diag([-1.0, 1.5]), [[0.0], [0.5]]), {"x1": 0.0})
    np.testing.assert_allclose(K, [[0.0, 6.0]], atol=1e-9)


OSCILLATOR = [[0.3, 2.7, 0.0, 0.0], [-1.9, -0.3, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [0.0, 0.0, 0.0, 0.0]]


@pytest.mark.parametrize(
    ("A", "B", "cost", "words"),
    [
        (
            OSCILLATOR,
            [[0, 0], [0, 0], [0, 1], [1, 0]],
            1.0,
            "the actuators u0, u1 do not control a mode that is not stable: it moves x0, x1",
        ),
        (
            OSCILLATOR,
            [[1, 0], [0, 0], [0, 0], [0, 0]],
            1.0,
            "the actuators u0, u1 do not control a mode that is not stable: it moves x3",
        ),
        (
            OSCILLATOR,
            [[1, 0], [0, 0], [0, 0], [0, 1]],
            {"x2": 1.0, "x3": 2.0},
            "state_cost: a mode that is not stable has zero cost: it moves x0, x1",
        ),
        (
            OSCILLATOR,
            [[1, 0], [0, 0], [0, 0], [0, 1]],
            {"x0": 1.0},
            "state_cost: a mode that is not stable has zero cost: it moves x3",
        ),
        (
            np.diag([0.5, 0.2]),
            [[1.0], [0.0]],
            1.0,
            "the actuators u0 do not control a mode that is not stable: it moves x1",
        ),
    ],
)
@pytest.mark.parametrize("rate", [1.0, 1e5])
def test_modes_that_cannot_be_held_are_named(A, B, cost, words, rate):
    """However fast they are."""
    with pytest.raises(rnc.ConstraintError) as told:
        rnc.lqr(linear(rate * np.array(A), rate * np.array(B)), cost)
    assert str(told.value) == words


def test_a_mode_that_moves_many_states_names_them_all():
    """Their mean grows, and the inputs do not move it."""
    mean = np.full((16, 16), 1 / 16)
    B = np.zeros((16, 1))
    B[:2, 0] = 1.0, -1.0
    with pytest.raises(rnc.ConstraintError) as told:
        rnc.lqr(linear(1.5 * mean - np.eye(16), B), 1.0)
    assert str(told.value).endswith(f"it moves {', '.join(f'x{k}' for k in range(16))}")


def test_only_the_proportion_of_the_costs_counts():
    system = linear([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]])
    np.testing.assert_allclose(rnc.lqr(system, 1e-8, 1e-8), rnc.lqr(system, 1.0, 1.0), rtol=1e-6)


@pytest.mark.parametrize("size", [1e-4, 1.0, 1e4])
def test_a_double_integrator_in_other_units_of_time_is_regulated(size):
    K = rnc.lqr(linear([[0.0, size], [0.0, 0.0]], [[0.0], [size]]), 1.0)
    np.testing.assert_allclose(K, [[1.0, np.sqrt(3.0)]], rtol=1e-7)


@pytest.mark.parametrize(
    ("cost", "inputs", "words"),
    [
        ([[1.0, 2.0], [2.0, 1.0]], 1.0, "state_cost: no weight may be negative"),
        ([1.0, -1e-3], 1.0, "state_cost: no weight may be negative"),
        ([[1.0, 0.5], [0.0, 1.0]], 1.0, "or a symmetric matrix, found"),
        ([1.0, np.nan], 1.0, "or a symmetric matrix, found"),
        ([[1.0, 2.0]], 1.0, "or a symmetric matrix, found"),
        ([1.0], 1.0, "state_cost: expected a number, one for each of x0, x1, or a symmetric matrix, found"),
        (1.0, [1.0, 1.0], "input_cost: expected a number, one for each of u0, or a symmetric matrix, found"),
        (1.0, 0.0, "input_cost: every input needs a positive weight"),
        (1.0, -1.0, "input_cost: every input needs a positive weight"),
        (1.0, {"u": 1.0}, "input_cost: no 'u'; did you mean 'u0'"),
    ],
)
def test_costs_that_are_none_are_refused(cost, inputs, words):
    with pytest.raises(rnc.ConfigurationError, match=words):
        rnc.lqr(linear([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]]), cost, inputs)


def test_a_cost_that_is_negative_by_rounding_is_none():
    """A square of a row has no negative weight, but its computed eigenvalue is less than zero."""
    row = np.array([[1.0, 1.0 / 3.0]])
    cost = row.T @ row - 1e-15 * np.eye(2)
    assert np.linalg.eigvalsh(cost).min() < 0
    K = rnc.lqr(linear([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]]), cost)
    np.testing.assert_allclose(K, [[1.0, np.sqrt(1 / 9 + 2.0)]], rtol=1e-6)


# ---------------------------------------------------------------------- linear models


CENTER = np.array([3.0, 2.0])


def round_a_center():
    """Distance from a point, and heading against the bearing from there; rows in the body's own axes."""

    def parts(q):
        (x, y), (c, s) = q[:2] - CENTER, q[2:]
        ahead, beside = x * c + y * s, y * c - x * s
        return ahead, beside, np.hypot(x, y)

    def value(q):
        ahead, beside, rho = parts(q)
        return np.array([rho, np.arctan2(-beside, ahead)])

    def rows(q):
        ahead, beside, rho = parts(q)
        return np.array([[ahead / rho, beside / rho, 0.0], [beside / rho**2, -ahead / rho**2, 1.0]])

    def rows_dot(q, v):
        ahead, beside, rho = parts(q)
        ahead_dot, beside_dot = v[0] + v[2] * beside, v[1] - v[2] * ahead
        rho_dot = (ahead * ahead_dot + beside * beside_dot) / rho
        first = np.array([ahead_dot, beside_dot, 0.0]) / rho - np.array([ahead, beside, 0.0]) * rho_dot / rho**2
        second = np.array([beside_dot, -ahead_dot, 0.0]) - 2 * np.array([beside, -ahead, 0.0]) * rho_dot / rho
        return np.stack([first, second / rho**2])

    return rnc.Output(value, rows, rows_dot, ["rho", "phi"])


def test_a_circle_in_coordinates_that_do_not_move():
    """``rho' = u cos(phi)``, ``phi' = w - u sin(phi) / rho`` of a unicycle; its rates in another order."""
    reduced, speed, turn = unicycle(), 6.0, 4.0
    rho = speed / turn
    q = reduced.robot.configuration(
        {"root_joint": (3.0, 2.0 - rho, 0.0)}
    )  # heading along x, to the left of its bearing
    found = rnc.linearize(reduced, q, [speed, turn], coordinates=[round_a_center()], rates=["body_yaw", "body_speed_x"])
    assert found.state_names == ("rho", "phi", "body_yaw_dot", "body_speed_x")
    A = np.zeros((4, 4))
    A[0, 1], A[1, 0], A[1, 2], A[1, 3] = -speed, speed / rho**2, 1.0, -1.0 / rho
    np.testing.assert_allclose(found.A, A, atol=1e-8)
    np.testing.assert_allclose(found.B, [[0, 0], [0, 0], [0, 1 / 0.1], [1 / 1.0, 0]], atol=1e-9)
    moved = reduced.robot.configuration({"root_joint": (3.0, 2.0 - rho - 0.1, 0.2)})
    np.testing.assert_allclose(found.deviation(moved, [6.3, 3.9]), [0.1, 0.2, -0.1, 0.3], atol=1e-12)


def test_a_coordinate_in_the_world_does_not_turn_with_the_body():
    """In a turn, of ``y' = u sin(yaw)`` the heading is missing; where the body is along x is not."""
    reduced = unicycle()
    with pytest.raises(rnc.ConstraintError) as told:
        rnc.linearize(reduced, reduced.robot.configuration(), [0.5, 2.0], coordinates=[rnc.FramePosition("body", "y")])
    missing = "not a closed system: the motion of body_y, body_speed_x, body_yaw also depends on 'root_joint[2]'"
    assert str(told.value) == missing


def test_of_coordinates_that_move_the_fastest_is_named():
    reduced = unicycle()
    q = reduced.robot.configuration({"root_joint": (0.0, 0.0, 0.3)})
    with pytest.raises(rnc.ConstraintError) as told:
        rnc.linearize(reduced, q, [1.0, 0.0], coordinates=[rnc.FrameYaw("body"), rnc.FramePosition("body", "yx")])
    assert str(told.value) == "coordinate 'body_x' moves in this motion: leave it out of the coordinates"


@pytest.mark.parametrize("speed", [0.5, 3.0])
def test_a_coordinate_moves_above_a_hundred_millionth_of_the_motion(speed):
    """Or of one a second; slower ones rest."""
    reduced, coordinates = unicycle(), [rnc.FrameYaw("body"), rnc.FramePosition("body", "y")]
    limit = 1e-8 * (1.0 + speed) / speed
    q = reduced.robot.configuration({"root_joint": (0.0, 0.0, 0.97 * limit)})
    found = rnc.linearize(reduced, q, [speed, 0.0], coordinates=coordinates)
    np.testing.assert_allclose(found.A[:2, :2], [[0.0, 0.0], [speed, 0.0]], atol=1e-12)  # y' = u sin(yaw)
    q = reduced.robot.configuration({"root_joint": (0.0, 0.0, 1.03 * limit)})
    with pytest.raises(rnc.ConstraintError) as told:
        rnc.linearize(reduced, q, [speed, 0.0], coordinates=coordinates)
    assert str(told.value) == "coordinate 'body_y' moves in this motion: leave it out of the coordinates"


def test_a_loop_has_the_coordinates_that_it_leaves():
    """The crank alone: differences of its acceleration, over configurations at which the loop is closed."""
    reduced = four_bar()
    guess = reduced.robot.configuration({"crank": 1.0, "coupler": -0.4, "rocker": 1.5})

    def closed(crank):
        return reduced.assembled(np.array([crank, *guess[1:]]), hold=["crank"])

    q = closed(1.0)
    found = rnc.linearize(reduced, q, coordinates=["crank"])
    assert abs(found.T[0]) > 0.1
    h, rest = 1e-4, np.zeros(1)
    ahead, behind = (reduced.forward_dynamics(closed(1.0 + sign * h), rest, found.T)[0] for sign in (1, -1))
    np.testing.assert_allclose(found.A, [[0.0, 1.0], [(ahead - behind) / (2 * h), 0.0]], rtol=1e-5, atol=1e-9)
    np.testing.assert_allclose(found.B, [[0.0], [1 / reduced.inertia(q)[0, 0]]], rtol=1e-9)
    moved = closed(1.3)
    np.testing.assert_allclose(found.deviation(moved, [0.7]), [0.3, 0.7], atol=1e-12)


def test_inputs_that_hold_are_the_smallest():
    """Three drives for two velocities, on a slope."""
    model, _ = planar_model()
    model.gravity.linear = np.array([-2.0, 0.0, 0.0])
    slope = rnc.Robot(model)
    B = np.array([[1.0, 2.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    reduced = rnc.NonholonomicSystem(slope, [rnc.NoSideSlip("body")], B).reduce(
        [rnc.FrameSpeed("body"), rnc.FrameYaw("body")]
    )
    found = rnc.linearize(reduced, slope.configuration())
    np.testing.assert_allclose(found.T, [0.4, 0.8, 0.0], atol=1e-12)  # 2 N in all
    with pytest.raises(rnc.ConstraintError) as told:
        rnc.linearize(reduced, slope.configuration(), T=[0.0, 0.0, 0.05])
    assert str(told.value) == (
        "not an equilibrium and not a steady motion: under T = [0. 0. 0.05] "
        "the rate of 'body_speed_x' changes by -2 a second"
    )


def test_eigenvalues_stand_by_real_part_and_then_by_imaginary_part():
    A = np.zeros((5, 5))
    A[:2, :2], A[2:4, 2:4], A[4, 4] = [[-1, 3], [-3, -1]], [[-1, 2], [-2, -1]], -4
    np.testing.assert_allclose(linear(A, np.zeros((5, 1))).eigenvalues, [-4, -1 - 3j, -1 - 2j, -1 + 2j, -1 + 3j])


# ---------------------------------------------------------------------- integrable combinations


@pytest.mark.parametrize(
    ("share", "words"),
    [
        (2.0, "first - 2.5 second"),
        (-2.0, "first + 2.5 second"),
        (5.0, "first - second"),
    ],
)
def test_a_combination_of_rows_as_they_are_is_put_in_words(share, words):
    """Rows ``5 b + dw`` and ``k b + 3 dw`` with a contact form b: what is left of b is the differential of w."""

    def contact(q):
        return np.array([-q[1], q[0], 1.0, 0.0])

    def rows(q):
        return np.stack([5 * contact(q) + [0, 0, 0, 1], share * contact(q) + [0, 0, 0, 3]])

    def rows_dot(q, v):
        rate = np.array([-v[1], v[0], 0.0, 0.0])
        return np.stack([5 * rate, share * rate])

    system = rnc.NonholonomicSystem(rail_sliders(4), [rnc.Pfaffian(rows, rows_dot, ["first", "second"])])
    reduced = system.reduce([rnc.JointPosition("s0"), rnc.JointPosition("s1")])
    found = integrability(reduced, np.random.default_rng(0).normal(size=(3, 4)))
    assert found.growth_vector == (2, 3)
    assert found.nonholonomic == ("first", "second")
    (combination,) = found.combinations
    assert combination.constant
    assert str(combination) == words
    report = rnc.analyze(reduced, samples=8)
    assert report.integrable_combinations == (words,)
    assert not report.completely_nonholonomic
