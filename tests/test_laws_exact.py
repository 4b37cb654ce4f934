"""Laws that take what others learn, split it up or need a model, each beside a plain rewriting of what it says."""

from types import SimpleNamespace

import numpy as np
import pytest

import rnc_pin as rnc
from controlled_tasks import Cubic
from rnc_pin.control import (
    ChainedStabilizer,
    ComputedTorque,
    JacobianTransposeController,
    PositionTracker,
    ReducingOutputController,
    SplitController,
    StateFeedback,
    VelocityTarget,
    effective_inertia,
)
from rnc_pin.control.deviation import fed_back
from rnc_pin.control.estimation import adapt
from rnc_pin.control.protocol import Command, check_size, elapsed_time
from rnc_pin.math.coordinates import Coordinates
from rnc_pin.model.measurement import Measurement
from rnc_pin.planning import Hold
from systems import random_states, space_robot

# ---------------------------------------------------------------------- the chain


def chain_rate(x, u):
    """Of a chained state under its two inputs."""
    return np.array([u[0], u[1], *(x[1:-1] * u[0])])


@pytest.mark.parametrize("over", [0.999, 1.001, 1.7])
def test_a_chain_at_its_limit_moves_along_its_law_alone(over):
    """From just beyond the limit on its command has that length, and a rate across itself."""
    free, x, u, h = ChainedStabilizer(4), np.array([0.8, -0.3, 0.5, 0.2]), np.array([-0.7, 0.4]), 1e-6
    limit = np.linalg.norm(free.command(x)) / over
    held = ChainedStabilizer(4, max_input=limit)
    command, rate = held.command(x), held.command_rate(x, u)
    assert np.linalg.norm(command) == pytest.approx(min(over, 1.0) * limit)
    ahead, behind = (held.command(x + sign * h * chain_rate(x, u)) for sign in (1, -1))
    np.testing.assert_allclose(rate, (ahead - behind) / (2 * h), atol=1e-6)
    assert (abs(command @ rate) < 1e-9) == (over > 1)


def test_a_chain_says_where_it_has_no_law_and_which_rates_make_no_sense():
    for x, said in (([0.0, 2.0, 3.0], "0"), ([1e-320, 2.0, 3.0], "9.99989e-321")):
        with pytest.raises(rnc.InputError) as caught:
            ChainedStabilizer(3).command(np.array(x))
        assert str(caught.value) == f"a chained state with x1 = {said} is outside the domain of its stabiliser: x1 = 0"
    for n, k, rate in ((2, 0.5, 1.5), (3, -0.5, 1.5), (3, 0.0, 1.5), (3, 1.5, 1.5), (4, 0.5, float("nan"))):
        with pytest.raises(rnc.ConfigurationError) as caught:
            ChainedStabilizer(n, k, rate)
        words = f"a chained stabiliser needs n >= 3 and 0 < k < rate, found {n}, {k:g}, {rate:g}"
        assert str(caught.value) == words
    for max_input in (0.0, -1.0, float("nan")):
        with pytest.raises(rnc.ConfigurationError, match="needs a positive largest input, found"):
            ChainedStabilizer(3, max_input=max_input)
    assert ChainedStabilizer(3, max_input=1e-9).command(np.array([1.0, 0.0, 0.0])).tolist() == [-1e-9, 0.0]


# ---------------------------------------------------------------------- what a law is made of


def test_time_passes_from_sample_to_sample_and_may_stand_still():
    assert elapsed_time(7.0, None) == 0.0
    assert elapsed_time(7.0, 7.0) == 0.0
    assert elapsed_time(7.25, 7.0) == 0.25
    with pytest.raises(rnc.InputError) as caught:
        elapsed_time(6.5, 7.0)
    assert str(caught.value) == "time runs backwards: 6.5 s after 7 s"
    with pytest.raises(rnc.ConfigurationError) as caught:
        check_size(Hold([1.0, 2.0]), 3, "tip's")
    assert str(caught.value) == "the tip's reference has 2 values for 3 outputs"
    check_size(Hold([1.0, 2.0]), 2, "tip's")


def test_an_output_without_a_value_needs_none_where_nothing_is_fed_back():
    gains, error = np.array([2.0, 0.0, -3.0]), np.array([[0.5, np.nan, 2.0], [1.5, 4.0, -1.0]])
    np.testing.assert_array_equal(fed_back(gains, error), [[1.0, 0.0, -6.0], [3.0, 0.0, 3.0]])
    np.testing.assert_array_equal(fed_back(0.0, error), np.zeros((2, 3)))
    assert fed_back(0.0, error).shape == (2, 3)
    np.testing.assert_array_equal(fed_back(2.0, error[1]), [3.0, 8.0, -2.0])
    np.testing.assert_array_equal(fed_back(gains, np.array([np.inf, np.nan, 1.0])), [np.inf, 0.0, -3.0])
    for gain in (2.0, -2.0, np.array([0.0, 1e-9, 0.0])):
        with pytest.raises(
            rnc.InputError, match=r"without a value: it is a quasi-velocity, .* measure\(q, v2, integrals\)"
        ):
            fed_back(gain, error)


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


# ---------------------------------------------------------------------- laws over a model


@pytest.mark.parametrize("monitored", [False, True])
def test_reducing_outputs_follow_at_their_gains(monitored):
    """Angles by the shorter way; batches; what is monitored is said and moves nothing."""
    reference, k2 = Cubic([0.1, 2.9], [0.5, -0.8], [0.4, 0.3], [-0.7, 1.1]), np.array([1.7, 0.6])
    reduced = SimpleNamespace(r=2, reducing=SimpleNamespace(coordinates=Coordinates([False, True])))
    aside = (np.array([2, 0]), Hold([0.5, 0.6])) if monitored else None
    law = ReducingOutputController(reduced, reference, k2, aside)
    generator = np.random.default_rng(1)
    m = Measurement(x1=np.zeros((4, 3)), x2=generator.uniform(-2, 2, (4, 2)), v2=generator.normal(size=(4, 2)))
    target, state = law.step(0.3, m, law.initial_state(m))
    point = reference.at(0.3)
    error = point.position - m.x2
    error[:, 1] = np.angle(np.exp(1j * error[:, 1]))
    np.testing.assert_allclose(target.v2, point.velocity + k2 * error, rtol=1e-12)
    np.testing.assert_allclose(target.v2_dot, point.acceleration + k2 * (point.velocity - m.v2), rtol=1e-12)
    np.testing.assert_array_equal(target.x2, np.tile(point.position, (4, 1)))
    assert state is target.estimates is target.prediction_error is None
    if monitored:
        np.testing.assert_array_equal(target.x1, np.tile([0.6, np.nan, 0.5], (4, 1)))
    else:
        assert target.x1 is None
    with pytest.raises(rnc.ConfigurationError, match="the reducing reference has 3 values for 2 outputs"):
        ReducingOutputController(reduced, Hold(np.zeros(3)))
    assert law.describe() == {"type": "ReducingOutputController", "k2": [1.7, 0.6]}


class Counting:
    """A target that is written down."""

    def initial_state(self, measurement):
        return 5

    def step(self, t, measurement, state):
        return VelocityTarget(
            np.array([0.4, -0.2, 0.3]), np.array([1.1, 0.7, -0.9]), estimates=np.array([t])
        ), state + 1


def test_computed_torque_makes_the_velocity_error_fade_at_its_gain():
    """What the model does under its force: ``v2_dot = v2d_dot + k (v2d - v2)``."""
    reduced, k = space_robot(), np.array([3.0, 7.0, 1.5])
    law = ComputedTorque(reduced, Counting(), k)
    for q, v2 in random_states(reduced, 3, condition=30.0):
        m = reduced.measure(q, v2)
        command, state = law.step(0.7, m, law.initial_state(m))
        assert state == 6
        rate = reduced.forward_dynamics(q, v2, reduced.allocate(q, command.F))
        np.testing.assert_allclose(rate, [1.1, 0.7, -0.9] + k * ([0.4, -0.2, 0.3] - v2), atol=1e-8)
        assert command.estimates.tolist() == [0.7]
        assert command.v2_desired.tolist() == [0.4, -0.2, 0.3]
    assert law.describe()["k"] == [3.0, 7.0, 1.5]


ON = ["joint_3", "joint_1"]
TIP = np.array([1, 0])


def test_forces_on_some_outputs_come_from_the_actuators_that_are_on():
    """By virtual work, on a batch; the others give nothing. What is moved is what those actuators feel."""
    reduced = space_robot()
    names = list(reduced.actuation.names)
    places = [names.index(name) for name in ON]
    q, v2 = (np.stack(each) for each in zip(*random_states(reduced, 4, seed=3, condition=30.0), strict=True))
    reference = Cubic([0.4, 0.9], [0.5, -0.8], [0.4, 0.3], [-0.7, 1.1])
    tracker = PositionTracker(reference, outputs=TIP)
    law = JacobianTransposeController(reduced, tracker, ON)
    m = reduced.measure(q, v2)
    state = law.initial_state(m)
    command, after = law.step(0.0, m, state)
    asked, learnt = tracker.step(0.0, m, state)
    assert after.time == learnt.time
    assert command.F is None
    np.testing.assert_array_equal(command.x2_desired, asked.x2_desired)
    M = law.effective_inertia(q)
    np.testing.assert_array_equal(M, effective_inertia(reduced, q, TIP, ON))
    for i in range(4):
        assert np.flatnonzero(command.T[i]).tolist() == sorted(places)
        drive = reduced.drive_jacobian(q[i])
        one = reduced.measure(q[i], v2[i])
        np.testing.assert_allclose(law.step(0.0, one, law.initial_state(one))[0].T, command.T[i], rtol=1e-9)
        for place in places:
            assert command.T[i, place] == pytest.approx(drive[TIP, place] @ asked.F[i])
        T = np.zeros(reduced.p)
        T[places] = drive[TIP][:, places].T @ [0.8, -1.9]
        moved = (reduced.forward_dynamics(q[i], np.zeros(3), T) - reduced.forward_dynamics(q[i], np.zeros(3), 0 * T))[
            TIP
        ]
        np.testing.assert_allclose(M[i] @ moved, [0.8, -1.9], atol=1e-8)
    said = law.describe()
    assert (said["type"], said["active"]) == ("JacobianTransposeController", ON)
    assert said["tracker"] == tracker.describe()
    for active, words in (
        (["joint_3"], "1 active actuators cannot drive 2 outputs"),
        (["joint_3", "joint_1", "joint_3"], "active actuator 'joint_3' is named twice"),
        (["joint_1", "joint_3", "joint_3", "joint_1"], "active actuator 'joint_1' is named twice"),
        (["joint_1", "jount_1"], "no actuator 'jount_1'; did you mean 'joint_1'?"),
    ):
        with pytest.raises(rnc.ConfigurationError) as caught:
            JacobianTransposeController(reduced, tracker, active)
        assert str(caught.value).startswith(words)
    assert JacobianTransposeController(reduced, tracker, names).describe()["active"] == names


class Part:
    """A controller that says what it sees."""

    def __init__(self, factor, **more):
        self.factor, self.more = factor, more

    def initial_state(self, measurement):
        return measurement.v2.shape

    def step(self, t, measurement, state):
        excess = 0.0 if measurement.force_deficit is None else measurement.force_deficit
        F = self.factor * measurement.x2 + t * measurement.v2 + excess
        return Command(F=F, **self.more), (*state, self.factor)


@pytest.mark.parametrize("batch", [(), (3,)])
def test_parts_see_and_command_outputs_of_their_own(batch):
    first, second = Part(2.0, v2_desired=np.array([5.0, 6.0])), Part(-3.0, x2_desired=np.array([7.0]))
    third = Part(0.5, x1_desired=np.array([8.0]), v2_desired=np.array([1.0]), x2_desired=np.array([2.0]))
    fourth = Part(0.7, x1_desired=np.array([9.0]))
    places = ([3, 0], [1], [4], [2])
    split = SplitController([*zip((first, second, third, fourth), map(np.array, places), strict=True)], 5)
    generator = np.random.default_rng(1)
    x2, v2, excess = generator.normal(size=(3, *batch, 5))
    factors = np.array([2.0, -3.0, 0.7, 2.0, 0.5])
    for given in (None, excess):
        m = Measurement(x2=x2, v2=v2, force_deficit=given)
        states = split.initial_state(m)
        assert states == ((*batch, 2), (*batch, 1), (*batch, 1), (*batch, 1))
        command, after = split.step(0.3, m, states)
        np.testing.assert_allclose(command.F, factors * x2 + 0.3 * v2 + (0.0 if given is None else given), rtol=1e-14)
        assert after == tuple((*state, part) for state, part in zip(states, (2.0, -3.0, 0.5, 0.7), strict=True))
        np.testing.assert_array_equal(command.v2_desired, np.broadcast_to([6, np.nan, np.nan, 5, 1], x2.shape))
        np.testing.assert_array_equal(command.x2_desired, np.broadcast_to([np.nan, 7, np.nan, np.nan, 2], x2.shape))
        assert command.x1_desired.tolist() == [8.0]
    said = split.describe()
    assert [part["outputs"] for part in said["parts"]] == [[3, 0], [1], [4], [2]]
    assert {part["type"] for part in said["parts"]} == {"Part"}
    for chosen, r, found in (
        (([0], [2]), 3, "[0, 2], expected each of 0 to 2"),
        (([0, 1], [1]), 2, "[0, 1, 1], expected each of 0 to 1"),
    ):
        with pytest.raises(rnc.ConfigurationError) as caught:
            SplitController([(first, np.array(each)) for each in chosen], r)
        assert str(caught.value) == f"the parts command outputs {found} once"


# ---------------------------------------------------------------------- state feedback

STATES = ("tilt", "arm", "speed", "tilt_dot", "wheel_dot", "yaw_dot")


def linear():
    """Five outputs, of which speed and spin are quasi-velocities; not every value is a state, nor every rate."""
    names = ("speed", "tilt", "wheel", "spin", "arm")
    outputs = SimpleNamespace(
        names=names,
        quasi=[True, False, False, True, False],
        coordinates=Coordinates([False, True, True, False, True]),
    )
    generator = np.random.default_rng(1)
    return SimpleNamespace(
        B=np.zeros((6, 2)),
        T=np.array([0.3, -0.8]),
        v2=np.array([1.0, 2.0, 3.0, 4.0, 5.0]),
        state_names=STATES,
        reducing=outputs,
        deviation=lambda q, v2: np.concatenate([q, v2[:1], v2[1:4]]),
    ), generator.uniform(-1, 1, (2, 6))


def test_state_feedback_sees_the_deviation_from_where_it_was_linearised():
    model, K = linear()
    law = StateFeedback(model, K)
    q, v2 = np.array([0.5, -0.7]), np.array([0.1, 0.2, -0.3, 0.4, 0.5])
    m = Measurement(q=q, v2=v2)
    command, state = law.step(0.4, m, law.initial_state(m))
    np.testing.assert_allclose(command.T, model.T - K @ [0.5, -0.7, 0.1, 0.2, -0.3, 0.4], rtol=1e-12)
    assert command.v2_desired is model.v2
    assert command.x2_desired is command.F is state is None
    assert law.outputs == ()
    assert law.describe() == {
        "type": "StateFeedback", "states": list(STATES), "K": K.tolist(), "T": [0.3, -0.8], "v2": [1, 2, 3, 4, 5],
    }  # fmt: skip


@pytest.mark.parametrize("names", [["arm", "wheel", "speed", "tilt"], ["tilt", "arm"], ["speed"]])
def test_state_feedback_moves_the_states_of_outputs_that_have_a_reference(names):
    """Values where they are states, and rates where those are; angles by the shorter way."""
    model, K = linear()
    places = [model.reducing.names.index(name) for name in names]
    orders = np.random.default_rng(9).uniform(-2, 2, (4, 5))
    reference = Cubic(*orders[:, places])
    law = StateFeedback(model, K, reference, names)
    generator = np.random.default_rng(2)
    for _ in range(4):
        q, v2, x2 = generator.normal(size=2), generator.normal(size=5), generator.uniform(-3, 3, 5)
        before = v2.copy()
        command, _ = law.step(0.4, Measurement(q=q, v2=v2, x2=x2))
        x, point = model.deviation(q, v2), reference.at(0.4)
        x2_desired, v2_desired = np.full(5, np.nan), model.v2.copy()
        for k, name in enumerate(names):
            v2_desired[places[k]] = point.velocity[k]
            if name in ("tilt", "arm"):
                x[STATES.index(name)] = np.angle(np.exp(1j * (x2[places[k]] - point.position[k])))
                x2_desired[places[k]] = point.position[k]
            rate = name if name == "speed" else f"{name}_dot"
            if rate in STATES:
                x[STATES.index(rate)] = v2[places[k]] - point.velocity[k]
        np.testing.assert_allclose(command.T, model.T - K @ x, rtol=1e-11)
        np.testing.assert_array_equal(command.x2_desired, x2_desired)
        np.testing.assert_array_equal(command.v2_desired, v2_desired)
        np.testing.assert_array_equal(v2, before)
    assert model.v2.tolist() == [1.0, 2.0, 3.0, 4.0, 5.0]


def test_state_feedback_refuses_what_does_not_fit():
    model, K = linear()
    for arguments, words in (
        ((K.T,), "the gain has shape (6, 2), expected (2, 6)"),
        ((K, Hold(np.zeros(2)), ["tilt"]), "the state feedback's reference has 2 values for 1 outputs"),
        ((K, Hold(np.zeros(1)), ["tild"]), "no reducing output 'tild'; did you mean 'tilt'?"),
        ((K, Hold(np.zeros(5))), f"neither 'spin' nor its rate is a state, expected one of {', '.join(STATES)}"),
    ):
        with pytest.raises(rnc.ConfigurationError) as caught:
            StateFeedback(model, *arguments)
        assert str(caught.value) == words
