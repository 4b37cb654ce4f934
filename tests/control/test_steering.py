"""Class 2s: backstepping of the fire truck's rear steering (section 4.3)."""

from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from controlled_tasks import Cubic, task_at
from rnc_pin.control import OuterGains, SteeringController
from rnc_pin.model.evaluation_results import Measurement
from rnc_pin.model.state_evaluation import kinematic_gradient
from systems import fire_truck, random_states
from tolerances import FINITE_DIFFERENCE


def test_gradient_of_the_kinematics_is_exact():
    reduced = fire_truck()
    for q, _ in random_states(reduced, 4):
        gradient = kinematic_gradient(reduced.at(q), [1, 2])
        for column, output in enumerate((1, 2)):
            v, h = reduced.terms(q, np.eye(3)[output]).v, 1e-4
            moved = (pin.integrate(reduced.robot.model, q, k * h * v) for k in (-2, -1, 1, 2))
            A = [reduced.terms(each, np.zeros(3)).A_star for each in moved]
            difference = (A[0] - 8 * A[1] + 8 * A[2] - A[3]) / (12 * h)
            rounding = FINITE_DIFFERENCE * (1 + np.abs(A[0]).max())
            np.testing.assert_allclose(gradient[..., column], difference, atol=rounding)


PLACES = ([3, 0, 5], [4, 1], [2, 0])
ORDERS = np.random.default_rng(11).uniform(-1, 1, (4, 5))


def steering(gradient, **changes):
    """Three primary, two redundant and two of three vertical outputs of a system that is written down."""
    arrays = SimpleNamespace(output_slopes=lambda along: np.moveaxis(gradient[..., along], -1, 0))
    reduced = SimpleNamespace(affine=False, rheonomic=False, at=lambda q: SimpleNamespace(arrays_at_q=arrays))
    chosen = task_at(*PLACES)
    first, base = Cubic(*ORDERS[:, :3]), Cubic(*ORDERS[:, 3:])
    return SteeringController(reduced, chosen, first, base, **changes), first, base


@pytest.mark.parametrize("monitored", [False, True])
def test_steering_is_the_damped_least_squares_of_what_the_vertical_rates_miss(monitored, generator):
    """``N v22 = wdot + k4 (w - A3 v21) - (A3 v21)dot at rest of x22``, beside ``0.1 v22 = 0``; at most 4 rad/s."""
    k3, k21, k4, t = np.array([1.3, 0.4]), np.array([0.9, 2.2, 0.6]), 4.7, 0.6
    gains, largest = OuterGains(k3=k3, k21=k21, k4=k4), []
    aside = rnc.planning.Hold([0.77])
    for _ in range(9):
        gradient = generator.uniform(-1, 1, (3, 6, 6))
        law, first, base = steering(gradient, gains=gains, monitored=(np.array([1]), aside) if monitored else None)
        x1, x2, v2 = generator.uniform(-1, 1, 3), generator.uniform(-1, 1, 6), generator.uniform(-1, 1, 6)
        A, A_dot = generator.uniform(-1, 1, (2, 3, 6))
        m = Measurement(q=np.zeros(2), v2=v2, x1=x1, x2=x2, v1=np.full(3, np.nan), A_star=A, A_star_dot=A_dot)
        target, state = law.step(t, m)
        assert state is None
        primary, redundant, vertical = PLACES
        x21d, x11d, v21 = first.at(t), base.at(t), v2[primary]
        v21d_dot = x21d.acceleration + k21 * (x21d.velocity - v21)
        N = np.array([[gradient[k][primary][:, s] @ v21 for s in redundant] for k in vertical])
        A3, A3_dot = A[vertical][:, primary], A_dot[vertical][:, primary]
        missing = x11d.velocity + k3 * (x11d.position - x1[vertical]) - A3 @ v21
        wanted_dot = x11d.acceleration + k3 * (x11d.velocity - A3 @ v21)
        at_rest = A3_dot @ v21 - N @ v2[redundant] + A3 @ v21d_dot
        rows = np.vstack([N, 0.1 * np.eye(2)])
        v22 = np.linalg.lstsq(rows, np.concatenate([wanted_dot + k4 * missing - at_rest, np.zeros(2)]), rcond=None)[0]
        np.testing.assert_allclose(target.v2[primary], x21d.velocity + k21 * (x21d.position - x2[primary]), rtol=1e-12)
        np.testing.assert_allclose(target.v2[redundant], np.clip(v22, -4.0, 4.0), rtol=1e-9)
        largest.append(np.abs(v22).max())
        np.testing.assert_allclose(target.v2_dot[primary], v21d_dot, rtol=1e-12)
        assert target.v2_dot[[*redundant, 2]].tolist() == [0.0, 0.0, 0.0]
        np.testing.assert_array_equal(target.x1[vertical], x11d.position)
        np.testing.assert_array_equal(target.x1[1], 0.77 if monitored else np.nan)
        np.testing.assert_array_equal(target.x2[primary], x21d.position)
        assert np.isnan(target.x2[[1, 2, 4]]).all()
    assert min(largest) < 4.0 < max(largest)


def test_steering_takes_over_where_redundant_rates_move_nothing():
    law, first, base = steering(np.zeros((3, 6, 6)))
    A = np.zeros((3, 6))
    A[:, PLACES[0]] = 5.0
    A[1] = 7.0  # a vertical output that the task does not name
    assert law.initial_state(Measurement(A_star=A)) is None
    A[0, 4] = -1e-6
    with pytest.raises(rnc.ConfigurationError) as caught:
        law.initial_state(Measurement(A_star=A))
    words = "rates of b_4, b_1 move c_2, c_0 directly (A4 is not zero): use the class-1 controller"
    assert str(caught.value) == words
    assert law.describe() == {"type": "SteeringController", "k3": 2.0, "k4": 10.0, "k21": 2.0}
    reduced = SimpleNamespace(affine=False)
    for places, counts in (
        (([0], [1], [0, 1]), "1 and 2"), (([0], [1, 2], [0]), "2 and 1"), (([0], [], []), "0 and 0"),
    ):  # fmt: skip
        with pytest.raises(rnc.ConfigurationError) as caught:
            SteeringController(reduced, task_at(*places), first, base)
        words = f"steering needs as many redundant as vertical outputs, found {counts}"
        assert str(caught.value) == words
    with pytest.raises(rnc.ConfigurationError) as caught:
        SteeringController(SimpleNamespace(affine=True), task_at(*PLACES), first, base)
    assert str(caught.value) == "steering assumes A v = 0, and these constraints are affine (A v = mu)"
    for one, other, words in ((base, base, "the primary .* 2 values for 3"), (first, first, "the vertical .* 3 .* 2 ")):
        with pytest.raises(rnc.ConfigurationError, match=words):
            SteeringController(reduced, task_at(*PLACES), one, other)
