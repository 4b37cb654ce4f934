"""Derivatives and linearisations: against differences of the dynamics, closed forms and published numbers."""

import numpy as np
import pinocchio as pin
import pytest
import scipy.linalg

import rnc_pin as rnc
import textbook_systems as textbook
from systems import four_bar
from textbook_systems import linear


@pytest.mark.parametrize("actuators", [("left_axle", "right_axle"), ()])
def test_pendulum_on_wheels_falls_at_the_rate_of_the_closed_form(actuators):
    reduced = textbook.wheeled_pendulum(actuators)
    found = rnc.linearize(reduced, reduced.robot.configuration(), coordinates=["pitch"])
    # Body 12 kg, 0.45 m up, 0.8 kg m^2; two wheels 1 kg, 0.005 kg m^2, 0.1 m.
    rolling, turning, coupling = 12 + 2 + 2 * 0.005 / 0.1**2, 0.8 + 12 * 0.45**2, 12 * 0.45
    pole = np.sqrt(coupling * 9.81 * rolling / (turning * rolling - coupling**2))
    np.testing.assert_allclose(found.eigenvalues, [-pole, 0, 0, pole], rtol=1e-12, atol=1e-12)
    assert found.state_names == ("pitch", "base_speed_x", "pitch_dot", "base_yaw_dot")
    assert (found.input_names, found.B.shape, found.difference_error) == (actuators, (4, len(actuators)), 0.0)


def test_python_control_has_the_names_and_the_poles_of_the_model(monkeypatch):
    cart = rnc.Robot.from_urdf("mobile_manipulator.urdf", base="planar")
    system = rnc.NonholonomicSystem(cart, [rnc.NoSideSlip("axle")], [rnc.FrameForce("base", "x")])
    found = rnc.linearize(system.reduce(), cart.configuration())
    other = found.to_control()
    assert other.state_labels == other.output_labels == list(found.state_names)  # which differ
    assert (other.input_labels, found.input_names) == (["force(base_x)"], ("force(base.x)",))
    np.testing.assert_allclose(np.sort_complex(other.poles()), found.eigenvalues, atol=1e-9)
    monkeypatch.setattr("rnc_pin.errors.find_spec", lambda name: None)
    with pytest.raises(rnc.ConfigurationError, match=r"python-control is not installed: pip install '\.\[control\]'"):
        found.to_control()


def test_whole_state_of_a_steady_motion_is_the_variational_equation():
    """Deviations from a circling disk, measured in axes that go along, against two nonlinear runs."""
    reduced = textbook.vertical_disk()
    model, q0, v2, size, duration = reduced.robot.model, reduced.robot.configuration(), np.array([5.0, 0.8]), 1e-5, 1.3
    found = rnc.linearize(reduced, q0, v2)
    start = np.random.default_rng(2).normal(size=found.A.shape[0])

    def end(sign):
        q = pin.integrate(model, q0, sign * size * start[: reduced.n])
        run = rnc.free_motion(reduced, q, v2 + sign * size * start[reduced.n :], duration, dt=duration)
        return run.q[-1], run.v2[-1]

    middle = rnc.free_motion(reduced, q0, v2, duration, dt=duration).q[-1]
    (q_plus, v2_plus), (q_minus, v2_minus) = end(1), end(-1)
    moved = (pin.difference(model, middle, q_plus) - pin.difference(model, middle, q_minus)) / (2 * size)
    expected = scipy.linalg.expm(found.A * duration) @ start
    np.testing.assert_allclose(np.r_[moved, (v2_plus - v2_minus) / (2 * size)], expected, atol=1e-7)


def test_deviation_is_the_state():
    reduced = textbook.wheeled_pendulum()
    q0 = reduced.robot.configuration({"root_joint": (0.3, -0.2, 3.0)})
    found = rnc.linearize(reduced, q0, coordinates=["pitch", rnc.FrameYaw("base")], rates=["pitch", "base_yaw"])
    q = reduced.robot.configuration({"root_joint": (0.3, -0.2, -3.0), "pitch": 0.1})
    turned = 2 * np.pi - 6.0  # through pi, not back around
    np.testing.assert_allclose(found.deviation(q, [7.0, 8.0, 9.0]), [0.1, turned, 8.0, 9.0], atol=1e-15)
    for own in ("_read", "_kept"):  # how it finds them
        assert own not in repr(found)


FIXED, MOVING = rnc.FramePosition("base", "z"), ["pitch", "root_joint[0]"]


@pytest.mark.parametrize(("options", "error", "words"), [
    ({"coordinates": [], "rates": []}, rnc.InputError, "coordinates and rates are both empty"),
    ({"T": [1.0, 1.0]}, rnc.ConstraintError, "not an equilibrium and not a steady motion"),
    ({"coordinates": []}, rnc.ConstraintError, "also depends on 'pitch'"),
    ({"rates": ["pitch"]}, rnc.ConstraintError, "also depends on 'base_speed_x'"),
    ({"coordinates": ["pich"]}, rnc.ModelError, "did you mean 'pitch'"),
    ({"rates": ["base_yow"]}, rnc.ModelError, "did you mean 'base_yaw'"),
    ({"coordinates": "pitch"}, rnc.InputError, "have to be a list"),
    ({"coordinates": ["pitch", "pitch"]}, rnc.ConstraintError, "not independent"),
    ({"coordinates": [FIXED], "rates": []}, rnc.ConstraintError, "coordinates base_z are not independent under"),
    ({"coordinates": [rnc.FrameSpeed("base")]}, rnc.ConstraintError, "quasi-velocity: it has no value"),
    ({"v2": [0.5, 0, 0], "coordinates": MOVING}, rnc.ConstraintError, r"'root_joint\[0\]' moves in this motion"),
])  # fmt: skip
def test_what_cannot_be_linearised_is_refused(options, error, words):
    reduced = textbook.wheeled_pendulum()
    with pytest.raises(error, match=words):
        rnc.linearize(reduced, reduced.robot.configuration(), **options)
    with pytest.raises(rnc.ConstraintError, match="rate of 'pitch'"):
        rnc.linearize(reduced, reduced.robot.configuration({"pitch": 0.3}))
    with pytest.raises(rnc.InputError, match="q has shape"):
        rnc.linearize(reduced, reduced.robot.configuration()[:-1])


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
    reduced, speed, turn = textbook.unicycle(), 6.0, 4.0
    rho = speed / turn
    q = reduced.robot.configuration({"root_joint": (3.0, 2.0 - rho, 0.0)})  # heading along x, left of its bearing
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
    reduced = textbook.unicycle()
    with pytest.raises(rnc.ConstraintError) as told:
        rnc.linearize(reduced, reduced.robot.configuration(), [0.5, 2.0], coordinates=[rnc.FramePosition("body", "y")])
    missing = "not a closed system: the motion of body_y, body_speed_x, body_yaw also depends on 'root_joint[2]'"
    assert str(told.value) == missing


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
    np.testing.assert_allclose(found.B, [[0.0], [1 / reduced.at(q).H[0, 0]]], rtol=1e-9)
    np.testing.assert_allclose(found.deviation(closed(1.3), [0.7]), [0.3, 0.7], atol=1e-12)


def test_inputs_that_hold_are_the_smallest():
    model, _ = textbook.planar_model()
    model.gravity.linear = np.array([-2.0, 0.0, 0.0])
    slope = rnc.Robot(model)
    B = np.array([[1.0, 2.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    system = rnc.NonholonomicSystem(slope, [rnc.NoSideSlip("body")], B)
    reduced = system.reduce([rnc.FrameSpeed("body"), rnc.FrameYaw("body")])
    found = rnc.linearize(reduced, slope.configuration())
    np.testing.assert_allclose(found.T, [0.4, 0.8, 0.0], atol=1e-12)  # 2 N in all
    with pytest.raises(rnc.ConstraintError) as told:
        rnc.linearize(reduced, slope.configuration(), T=[0.0, 0.0, 0.05])
    words = "under T = [0. 0. 0.05] the rate of 'body_speed_x' changes by -2 a second"
    assert str(told.value) == f"not an equilibrium and not a steady motion: {words}"


def test_eigenvalues_stand_by_real_part_and_then_by_imaginary_part():
    A = np.zeros((5, 5))
    A[:2, :2], A[2:4, 2:4], A[4, 4] = [[-1, 3], [-3, -1]], [[-1, 2], [-2, -1]], -4
    np.testing.assert_allclose(linear(A, np.zeros((5, 1))).eigenvalues, [-4, -1 - 3j, -1 - 2j, -1 + 2j, -1 + 3j])
