"""Derivatives of the dynamics, beside those of bodies and inputs written out."""

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from rnc_pin.analysis.derivatives import state_derivatives
from rnc_pin.model.differences import directional_derivative, gradient
from systems import (
    random_states,
    sleigh,
)
from textbook_systems import rail_sliders


def carried_along(mu, mu_dot, B):
    """Four bodies on rails, two rows of a user that move by themselves, an output that varies."""

    def rows(q):
        return np.array([[1.0, np.sin(q[2]), 0.3 * q[3], -0.7], [q[1] * q[3], -0.4, 2.0, np.cos(q[0])]])

    def rows_dot(q, v):
        return np.array(
            [
                [0.0, np.cos(q[2]) * v[2], 0.3 * v[3], 0.0],
                [q[1] * v[3] + q[3] * v[1], 0.0, 0.0, -np.sin(q[0]) * v[0]],
            ]
        )

    system = rnc.NonholonomicSystem(rail_sliders(4), [rnc.Pfaffian(rows, rows_dot, None, mu, mu_dot)], B)
    return rows, rows_dot, system.reduce([rnc.JointPosition("s1"), rnc.JointPosition("s3")])


def belt_speed(q):
    return np.array([np.sin(1.3 * q[1]) + 0.2 * q[0] * q[3], 0.6 * q[2] ** 2 - 1.1])


def belt_acceleration(q, v):
    return np.array([1.3 * np.cos(1.3 * q[1]) * v[1] + 0.2 * (q[0] * v[3] + q[3] * v[0]), 1.2 * q[2] * v[2]])


def drives(q):
    return np.array([[0.4, -1.2 * q[2]], [np.sin(q[0]), 0.5], [0.0, q[1] * q[3]], [0.9, np.cos(q[1])]])


def test_derivatives_under_rows_that_move_by_themselves_are_those_of_the_bodies():
    """Unit masses: ``E v = [mu; v2]``, and accelerations and multipliers from one linear system."""
    rows, rows_dot, reduced = carried_along(belt_speed, belt_acceleration, drives)
    J2 = np.eye(4)[[1, 3]]

    def velocity(q, v2):
        return np.linalg.solve(np.vstack([rows(q), J2]), [*belt_speed(q), *v2])

    def acceleration(q, v2, T):
        v = velocity(q, v2)
        A = rows(q)
        whole = np.block([[np.eye(4), A.T], [A, np.zeros((2, 2))]])
        right = np.concatenate([drives(q) @ T, belt_acceleration(q, v) - rows_dot(q, v) @ v])
        return J2 @ np.linalg.solve(whole, right)[:4]

    def slope(function, at):
        h = 1e-4
        return np.stack([(function(at + h * e) - function(at - h * e)) / (2 * h) for e in np.eye(len(at))], axis=-1)

    generator = np.random.default_rng(1)
    for _ in range(3):
        q, v2, T = generator.normal(size=4), generator.normal(size=2), generator.normal(size=2)
        found = state_derivatives(reduced, q, v2, T)
        np.testing.assert_allclose(found.v, velocity(q, v2), rtol=1e-10)
        np.testing.assert_allclose(found.v2_dot, acceleration(q, v2, T), rtol=1e-10)
        for part, expected in (
            (found.v_q, slope(lambda p, v2=v2: velocity(p, v2), q)),
            (found.v_v2, slope(lambda y, q=q: velocity(q, y), v2)),
            (found.v2_dot_q, slope(lambda p, v2=v2, T=T: acceleration(p, v2, T), q)),
            (found.v2_dot_v2, slope(lambda y, q=q, T=T: acceleration(q, y, T), v2)),
            (found.v2_dot_T, slope(lambda u, q=q, v2=v2: acceleration(q, v2, u), T)),
        ):
            np.testing.assert_allclose(part, expected, rtol=1e-5, atol=1e-5 * np.abs(expected).max())
        assert 0 < found.difference_error < 1e-9


@pytest.mark.parametrize("affine", [False, True])
@pytest.mark.parametrize("moving", [False, True])
def test_the_error_of_differences_is_that_of_two_steps(affine, moving):
    """Of eighth order, one step twice the other: the difference of both is 255 times the error of the finer one.

    Drives that vary with the place count with all their inputs together, rows that move by themselves beside them.
    """
    k = 20.0

    def push(q):
        return np.array([[np.sin(k * q[0]), 2.0, np.sin(k * q[0])], [0.0, 0.0, 0.0]])

    def rate(q):
        return 0.7 * np.sin(k * q[1:])

    def rate_dot(q, v):
        return 0.7 * k * np.cos(k * q[1:]) * v[1:]

    row, both = np.array([[0.0, 1.0]]), np.array([[1.0, 1.0]])
    moved = rnc.Pfaffian(lambda q: row, lambda q, v: 0 * row, None, *((rate, rate_dot) if affine else ()))
    output = rnc.Output(lambda q: both @ q, lambda q: both, lambda q, v: 0 * both, ["both"])
    reduced = rnc.NonholonomicSystem(rail_sliders(2), [moved], push).reduce([output])
    q, T = np.array([0.13, -0.21]), np.array([0.03, 0.5, -0.08])
    found = state_derivatives(reduced, q, np.array([0.4 * moving]), T)
    along_0, along_1 = found.v2_dot_q[0]
    error = abs(along_0 / (T[0] + T[2]) - k * np.cos(k * q[0]))
    estimate = 255 * error * np.abs(T).sum()
    # The other row's body accelerates by mu' mu, of which mu'' is found by differences.
    exact = (0.7 * k) ** 2 * (np.cos(k * q[1]) ** 2 - np.sin(k * q[1]) ** 2) * affine
    assert along_1 == pytest.approx(exact, rel=1e-6, abs=1e-12)
    assert found.difference_error == pytest.approx(estimate + 255 * abs(along_1 - exact), rel=0.05)


def test_what_is_in_closed_form_has_no_error():
    """Inputs or not, moving or not."""
    reduced = sleigh()
    for v2 in ([0.0, 0.0], [0.6, -1.3]):
        found = state_derivatives(reduced, reduced.robot.configuration(), np.array(v2), np.array([3.0, -2.0]))
        assert found.difference_error == 0.0


def test_derivatives_know_actuators_that_are_a_function():
    """Of the configuration: forces of a thruster on the sleigh, by hand."""
    robot = sleigh().robot

    def thruster(q):
        c, s = q[2], q[3]  # of the heading, as a planar joint has it
        return np.array([[1.0, 0.2 * c], [0.0, 0.3 * s], [0.1 * q[0], 1.0]])

    reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")], thruster).reduce()
    T = np.array([0.7, -0.4])
    for q, v2 in random_states(reduced, 2):
        found = state_derivatives(reduced, q, v2, T)
        wanted = gradient(robot.model, lambda p, v2=v2: reduced.forward_dynamics(p, v2, T), q, 1e-3)
        np.testing.assert_allclose(found.v2_dot_q, wanted, atol=1e-7)
        assert 0 < found.difference_error < 1e-9


def test_nothing_changes_along_no_way():
    model = sleigh().robot.model
    zero = directional_derivative(model, lambda q: np.outer(q, q), pin.neutral(model), np.zeros(3))
    assert zero.shape == (4, 4)
    assert not zero.any()
