"""Analyses of systems written down row by row: expressions and limits, beside mechanics that the tests write out."""

import numpy as np
import pytest

import rnc_pin as rnc
from rnc_pin.analysis import lemma_1_residuals
from rnc_pin.analysis.derivatives import state_derivatives
from rnc_pin.model.rows import Rows
from systems import sleigh
from textbook_systems import WHEEL, cart_robot, rail_sliders

# ---------------------------------------------------------------------- derivatives


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


def mu(q):
    return np.array([np.sin(1.3 * q[1]) + 0.2 * q[0] * q[3], 0.6 * q[2] ** 2 - 1.1])


def mu_dot(q, v):
    return np.array([1.3 * np.cos(1.3 * q[1]) * v[1] + 0.2 * (q[0] * v[3] + q[3] * v[0]), 1.2 * q[2] * v[2]])


def drives(q):
    return np.array([[0.4, -1.2 * q[2]], [np.sin(q[0]), 0.5], [0.0, q[1] * q[3]], [0.9, np.cos(q[1])]])


def test_derivatives_under_rows_that_move_by_themselves_are_those_of_the_bodies():
    """Unit masses: ``E v = [mu; v2]``, and accelerations and multipliers from one linear system."""
    rows, rows_dot, reduced = carried_along(mu, mu_dot, drives)
    J2 = np.eye(4)[[1, 3]]

    def velocity(q, v2):
        return np.linalg.solve(np.vstack([rows(q), J2]), [*mu(q), *v2])

    def acceleration(q, v2, T):
        v = velocity(q, v2)
        A = rows(q)
        whole = np.block([[np.eye(4), A.T], [A, np.zeros((2, 2))]])
        right = np.concatenate([drives(q) @ T, mu_dot(q, v) - rows_dot(q, v) @ v])
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


# ---------------------------------------------------------------------- grip


class TwoCasters(Rows):
    """A bar with a caster at both ends, as a constraint of a user's own: two rows that carry."""

    holonomic = (True, True)
    on_ground = True
    units = ("m/s", "m/s")

    def bind(self, robot):
        self.parts = [rnc.Caster(name, WHEEL).bind(robot) for name in ("nose", "tail")]
        self.names = ("front", "back")
        self.joints = tuple({joint for part in self.parts for joint in part.joints})
        return self

    def jacobian(self, at):
        return np.concatenate([part.jacobian(at) for part in self.parts], axis=-2)

    def jacobian_dot(self, at):
        return np.concatenate([part.jacobian_dot(at) for part in self.parts], axis=-2)

    def bias_acceleration(self, at):
        return np.concatenate([part.bias_acceleration(at) for part in self.parts], axis=-1)

    def residual(self, at):
        return np.concatenate([part.residual(at) for part in self.parts], axis=-1)

    def lines_of_action(self, at):
        both = [part.lines_of_action(at) for part in self.parts]
        return tuple(np.concatenate(each, axis=-2) for each in zip(*both, strict=True))


class Wheel:
    """A wheel under a name of a user's own, which says of no frame that it is its."""

    def bind(self, robot):
        return rnc.RollingWheel("b", WHEEL).bind(robot)


def test_a_bar_of_two_casters_carries_as_two_do():
    robot = cart_robot()
    wheel = rnc.RollingWheel("a", WHEEL)
    apart = [wheel, rnc.Caster("nose", WHEEL), rnc.Caster("tail", WHEEL)]
    q = robot.configuration({"root_joint": (0.3, -0.2, 1.1), "mast": 0.8})
    loads = []
    for rows in (apart, [wheel, TwoCasters()]):
        reduced = rnc.NonholonomicSystem(robot, rows).reduce()
        loads.append(rnc.Grip(reduced, 0.5).loads(q, np.zeros(reduced.r), np.zeros(0)))
    assert loads[0] > 1.0
    np.testing.assert_allclose(loads[1], loads[0], rtol=1e-12)


def test_a_wheel_without_a_frame_has_the_name_of_its_first_row():
    reduced = rnc.NonholonomicSystem(cart_robot(), [rnc.Caster("nose", WHEEL), Wheel()]).reduce()
    assert rnc.Grip(reduced, 0.5).names == ("rolling(b)",)


def test_no_ground_grips_without_end():
    with pytest.raises(rnc.ConfigurationError, match="friction of the ground has to be positive, found inf"):
        rnc.Grip(sleigh(), float("inf"))


# ---------------------------------------------------------------------- Lemma 1


def slides(A, A_dot, mu=None, mu_dot=None):
    """Unit masses, of which the last moves at ``A(q) v2 + mu(q)``."""
    moves = () if mu is None else (lambda q: np.array([mu(q)]), lambda q, v: np.array([mu_dot(q, v)]))
    row = rnc.Pfaffian(
        lambda q: np.array([[*(-A(q)), 1.0]]), lambda q, v: np.array([[*(-A_dot(q, v)), 0.0]]), ["row"], *moves
    )
    return rnc.NonholonomicSystem(rail_sliders(3), [row]).reduce([rnc.JointPosition("s0"), rnc.JointPosition("s1")])


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

    def mu(q):
        return moving * (0.4 + q[1])

    def mu_dot(q, v):
        return moving * v[1]

    reduced = slides(slopes, wrong_rate, *((mu, mu_dot) if moving else ()))
    configurations = np.random.default_rng(5).normal(size=(4, 3))
    seed = 11
    found = lemma_1_residuals(reduced, configurations, seed, step)
    draws = np.random.default_rng(seed).uniform(-1, 1, (4, 2))

    def H(q):
        return np.eye(2) + np.outer(slopes(q), slopes(q))

    def V(q, v2):
        v = np.array([*v2, slopes(q) @ v2 + mu(q)])
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
        usual = lemma_1_residuals(reduced, configurations, seed)
        assert usual == pytest.approx(found, rel=1e-12)


def test_lemma_1_holds_of_slides():
    """And of a body without constraints, whose H does not change."""
    found = lemma_1_residuals(slides(slopes, right_rate), np.random.default_rng(5).normal(size=(4, 3)))
    assert max(found[name] for name in ("A R", "H - H^T", "Hdot - V - V^T", "V linear")) < 1e-9
    free = rnc.NonholonomicSystem(rail_sliders(1), []).reduce([rnc.JointPosition("s0")])
    assert lemma_1_residuals(free, np.zeros((1, 1))) == {
        "A R": 0.0,
        "H - H^T": 0.0,
        "Hdot - V - V^T": 0.0,
        "V linear": 0.0,
        "smallest eigenvalue of H": 1.0,
    }
