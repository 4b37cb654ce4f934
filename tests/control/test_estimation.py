"""Estimators: the step of the law, its bounds, and controllers that see estimated kinematics."""

from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from rnc_pin.control import Command, Estimator, UncertainController, UnknownRadius, UnknownTrack, WheelRegressor
from rnc_pin.control.controller import findings_of, nested
from rnc_pin.control.estimation import EstimatorState, adapt
from rnc_pin.model.evaluation_results import Measurement
from textbook_systems import reduced_cart, two_wheeled_cart


class Known:
    """A regression of two parameters that is written down, and a model that shows what it believes."""

    names, Y = ("one", "two"), np.array([[2.0, 0.5], [0.0, 1.0], [1.0, -1.0]])

    def regress(self, q, v):
        return q * v, self.Y

    def estimated(self, reduced):
        model = SimpleNamespace()
        model.use = lambda p: vars(model).update(parameters=tuple(p))
        return model


def estimator(initial=(1.0, 2.0), affine=False, **settings):
    return Estimator(SimpleNamespace(affine=affine), Known(), initial, **settings)


def test_estimates_take_the_step_of_the_law_within_their_bounds():
    """Implicit, so that it never overshoots: ``p + s Y^T (1 + s Y Y^T)^-1 e`` with s the gain times the time."""
    measured, Y = Measurement(q=np.array([1.0, 2.0, 3.0]), v=np.array([3.0, 1.0, -0.5])), Known.Y
    free = estimator(alpha=0.7, bounds=(0.1, [50.0, 60.0]))
    assert free.model.parameters == (1.0, 2.0)
    first, error = free.step(3.0, measured, free.initial_state())
    np.testing.assert_allclose(error, [0.0, 0.0, -0.5])
    assert first.time == 3.0
    assert first.p.tolist() == [1.0, 2.0]  # no time has passed
    second, same = free.step(3.5, measured, first)
    np.testing.assert_array_equal(same, error)
    expected = first.p + 0.35 * Y.T @ np.linalg.solve(np.eye(3) + 0.35 * Y @ Y.T, error)
    np.testing.assert_allclose(second.p, expected, rtol=1e-12)
    assert (free.model.parameters, free.initial_state().p.tolist()) == (tuple(second.p), [1.0, 2.0])
    assert free.model.parameters == (1.0, 2.0)
    for settings in ({"alpha": 0.0}, {"dead_zone": 0.5}, {"dead_zone": np.array([0.0, 0.0, 0.6])}):
        still = estimator(**settings)
        assert still.step(9.0, measured, still.initial_state()._replace(time=0.0))[0].p.tolist() == [1.0, 2.0]
    held = estimator(alpha=10.0, bounds=([0.9, 1.99], [1.1, 2.01]))
    for sign, edge in ((1.0, [1.1, 1.99]), (-1.0, [0.9, 2.01])):
        pull = Measurement(q=np.array([1.0, 2.0, 3.0]), v=np.array([3.0, 1.0, -1 / 3]) + sign * np.array([0, 0, 9.0]))
        assert held.step(9.0, pull, held.initial_state()._replace(time=0.0))[0].p.tolist() == edge
    settings = {"alpha": 0.7, "dead_zone": 0.0, "bounds": [[0.1, 0.1], [50.0, 60.0]]}
    assert free.describe() == {**settings, "initial": {"one": 1.0, "two": 2.0}}
    with pytest.raises(rnc.InputError, match="time runs backwards: 2 s after 3 s"):
        free.step(2.0, measured, first)


def test_estimates_may_begin_at_their_bounds_and_not_beyond():
    for initial in ((0.5, 3.0), (3.0, 0.5)):
        assert estimator(initial, bounds=(0.5, 3.0)).initial.tolist() == list(initial)
    for settings, words in (
        ({"initial": (1.0,)}, "1 initial estimates for 2 unknown parameters"),
        ({"initial": (1.0, 2.0, 3.0)}, "3 initial estimates for 2 unknown parameters"),
        ({"initial": (1.0, 3.001), "bounds": (0.5, 3.0)}, "of the two, 3.001, has to be within its bounds 0.5 and 3$"),
        ({"initial": (0.499, 9.0), "bounds": (0.5, 3.0)}, "of the one, 0.499, has to be within its bounds 0.5 and 3$"),
        ({"bounds": (0.0, 3.0)}, r"have to be positive and in order, found \(0.0, 3.0\)"),
        ({"bounds": (3.0, 3.0)}, "have to be positive and in order"),
        ({"bounds": (0.1, [5.0, 0.1])}, "have to be positive and in order"),
        ({"bounds": (0.1, [5.0, 6.0, 7.0])}, "bounds of estimates: 3 values for 2 unknown parameters"),
        ({"affine": True}, "but the momentum is not zero"),
    ):
        with pytest.raises(rnc.ConfigurationError, match=words):
            estimator(**settings)


class Believer:
    """An estimator that is written down: its model has kinematics of its own, and allocates three times the force."""

    def __init__(self):
        self.model = SimpleNamespace(at=self._at)

    def _at(self, q, v2):
        return SimpleNamespace(
            A_star=np.array([[v2[0], 2.0]]), A_star_dot=np.array([[q[0], 4.0]]), input_matrix=np.diag([5.0, 6.0]),
            allocate=lambda F: 3.0 * F,
        )  # fmt: skip

    def describe(self):
        return {"alpha": 0.5}

    def initial_state(self):
        return EstimatorState(None, np.array([1.0]))

    def step(self, t, measurement, state):
        return EstimatorState(t, state.p + 1.0), np.array([0.25])


class Watcher:
    """A controller that remembers what it is shown, and commands what it was made with."""

    def __init__(self, **command):
        self.command, self.shown = command, []

    def initial_state(self, measurement):
        self.shown.append(measurement)
        return 4

    def step(self, t, measurement, state):
        self.shown.append(measurement)
        return Command(**self.command), state + 1

    def findings(self, state, samples):
        return [(*nested(state), samples)[1:]]


@pytest.mark.parametrize("by_force", [True, False])
def test_a_controller_under_estimates_sees_their_kinematics_and_is_allocated_by_them(by_force):
    force = np.array([1.0, -2.0])
    inner = Watcher(F=force, v2_desired=force) if by_force else Watcher(T=force)
    law = UncertainController(Believer(), inner)
    others = {"A_star": np.zeros((1, 2)), "residual": np.ones(1), "input_deficit": force}
    m = Measurement(q=np.array([7.0]), v2=np.array([8.0, 9.0]), **others)
    command, state = law.step(0.5, m, law.initial_state(m))
    assert command.F is None
    assert command.T.tolist() == ([3.0, -6.0] if by_force else [1.0, -2.0])
    assert command.v2_desired is (force if by_force else None)
    assert (command.estimates.tolist(), command.prediction_error.tolist()) == ([2.0], [0.25])
    assert (state.estimator.time, state.estimator.p.tolist(), state.target) == (0.5, [2.0], 5)
    assert findings_of(law, state, 1) == ((5, 1),)
    assert len(inner.shown) == 2
    for seen in inner.shown:
        assert (seen.A_star.tolist(), seen.A_star_dot.tolist()) == ([[8.0, 2.0]], [[7.0, 4.0]])
        assert seen.force_deficit.tolist() == [5.0, -12.0]
        assert seen.residual is None
        assert seen.input_deficit is force
    assert law.describe() == {"type": "UncertainController", "alpha": 0.5, "controller": {"type": "Watcher"}}


def test_models_with_other_parameters_are_other_models():
    """Neither the given model nor a model or state with earlier parameters changes, also not what is read later."""
    reduced = reduced_cart(two_wheeled_cart(pin.JointModelPlanar()))
    regressor = WheelRegressor(reduced, [UnknownTrack(["right", "left"]), UnknownRadius(["right"])])
    estimated = regressor.estimated(reduced)
    q, v2 = np.array([0.2, -0.1, 0.6, 0.8, 0.3, 0.4])[: reduced.robot.nq], np.array([0.7, -0.4])
    before = reduced.at(q, v2).measure()
    model = estimated.with_parameters(np.array([0.9, 0.33]))
    other = reduced_cart(two_wheeled_cart(pin.JointModelPlanar(), (0.1, 0.45, 0.2), (0.1, -0.45, 0.2)), (0.2, 0.33))
    v = other.at(q, v2).v
    np.testing.assert_allclose(model.at(q, v=v).residual, 0.0, atol=1e-12)
    assert np.abs(reduced.at(q, v=v).residual).max() > 1e-3
    state, fresh = model.at(q, v2), model.at(q, v2)
    names = ("A_star", "R", "H", "V", "G", "R_dot", "input_matrix")
    expected = {name: np.array(getattr(fresh, name)) for name in names}
    second = estimated.with_parameters(np.array([0.6, 0.25]))
    assert second.at(q, v2).H.shape == (2, 2)
    np.testing.assert_allclose(second.at(q, v=before.v).residual, 0.0, atol=1e-12)
    for name, value in expected.items():
        np.testing.assert_array_equal(getattr(state, name), value)
    np.testing.assert_array_equal(reduced.at(q, v2).measure().v, before.v)


def test_estimates_of_one_sample_are_the_least_squares_of_where_they_were_and_of_what_is_seen():
    """``x`` makes ``|x|^2 / step + |Y x - beyond the zone|^2`` least; then it is cut to its box."""
    generator, step = np.random.default_rng(3), 0.7 * 0.4
    for _ in range(5):
        p, Y, error = generator.normal(size=3), generator.normal(size=(2, 3)), generator.normal(size=2)
        zone = np.array([0.4, 0.1])
        seen = np.sign(error) * np.maximum(np.abs(error) - zone, 0.0)
        rows = np.vstack([np.eye(3) / np.sqrt(step), Y])
        moved = np.linalg.lstsq(rows, np.concatenate([np.zeros(3), seen]), rcond=None)[0]
        low, high = p + np.minimum(0.5 * moved, -9.0), p + np.array([9.0, 0.01, 9.0])
        found = adapt(p, Y, error, 0.7, 0.4, low, high, zone)
        np.testing.assert_allclose(found, np.clip(p + moved, low, high), rtol=1e-10)
        wide = (np.full(3, -99.0), np.full(3, 99.0))
        plain = np.linalg.lstsq(rows, np.concatenate([np.zeros(3), error]), rcond=None)[0]
        np.testing.assert_allclose(adapt(p, Y, error, 0.7, 0.4, *wide), p + plain, rtol=1e-10)
