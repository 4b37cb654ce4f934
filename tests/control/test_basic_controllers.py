"""Computed torque, references of the reducing outputs, and linear-quadratic regulators with the feedback of states."""

from types import SimpleNamespace

import numpy as np
import pytest

import rnc_pin as rnc
from controlled_tasks import Cubic
from refusals import refused
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.control import ComputedTorque, ReducingOutputController, StateFeedback, VelocityTarget
from rnc_pin.model.coordinates import Coordinates
from rnc_pin.model.evaluation_results import Measurement
from rnc_pin.motion.planning import Hold
from simple_controllers import Counting
from systems import random_states, space_robot


def test_computed_torque_makes_the_velocity_error_fade_at_its_gain():
    """Closed loop of the model under its force: ``v2_dot = v2d_dot + k (v2d - v2)``."""
    reduced, k = space_robot(), np.array([3.0, 7.0, 1.5])
    v2d, v2d_dot = np.array([0.4, -0.2, 0.3]), np.array([1.1, 0.7, -0.9])
    law = ComputedTorque(reduced, Counting(lambda t, _: VelocityTarget(v2d, v2d_dot, estimates=np.array([t]))), k)
    for q, v2 in random_states(reduced, 3, condition=30.0):
        m = reduced.at(q, v2).measure()
        command, state = law.step(0.7, m, law.initial_state(m))
        assert state == 6
        rate = reduced.forward_dynamics(q, v2, reduced.allocate(q, command.F))
        np.testing.assert_allclose(rate, v2d_dot + k * (v2d - v2), atol=1e-8)
        assert (command.estimates.tolist(), command.v2_desired.tolist()) == ([0.7], [0.4, -0.2, 0.3])
    assert law.describe()["k"] == [3.0, 7.0, 1.5]


@pytest.mark.parametrize("monitored", [False, True])
def test_reducing_outputs_follow_at_their_gains(monitored, generator):
    """Angles by the shorter way; batches; what is monitored is said and moves nothing."""
    reference, k2 = Cubic([0.1, 2.9], [0.5, -0.8], [0.4, 0.3], [-0.7, 1.1]), np.array([1.7, 0.6])
    reduced = SimpleNamespace(r=2, reducing=SimpleNamespace(coordinates=Coordinates([False, True])))
    aside = (np.array([2, 0]), Hold([0.5, 0.6])) if monitored else None
    law = ReducingOutputController(reduced, reference, k2, aside)
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


test_what_a_file_gets_wrong_is_said_in_a_line = refused([
    ({"initial.v2": {"rol": 10}}, "initial.v2: no reducing output 'rol'; did you mean 'roll'"),
    ({"controller.v2": {"rol": 1}}, "controller.v2: no reducing output 'rol'; did you mean 'roll'"),
    ({"controller.coordinates": ["rol"]}, "controller: no coordinate 'rol'"),
    ({"controller.state_cost": {"rol": 1}}, "controller: state_cost: no 'rol'; did you mean 'roll'"),
    ({"controller.rates": ["roll"]}, "controller: not a closed system: the motion of"),
    ({"controller.input_cost": 0}, "controller: input_cost: every input needs a positive weight"),
    ({"simulation.dt": 1.0}, "unstable in discrete time.* the sampling period 1 s"),
    ({"reference.vertical": {"hold": {}}}, "is not followed by a controller of type 'state_feedback'"),
], lambda changes: Scenario.load("ball-on-plate", changes).build())  # fmt: skip


STATES = ("tilt", "arm", "speed", "tilt_dot", "wheel_dot", "yaw_dot")


def linear():
    """Five outputs, of which speed and spin are quasi-velocities; not every value is a state, nor every rate."""
    names = ("speed", "tilt", "wheel", "spin", "arm")
    quasi, turning = [True, False, False, True, False], Coordinates([False, True, True, False, True])
    outputs = SimpleNamespace(names=names, quasi=quasi, coordinates=turning)
    generator = np.random.default_rng(1)
    return SimpleNamespace(
        B=np.zeros((6, 2)), T=np.array([0.3, -0.8]), v2=np.array([1.0, 2.0, 3.0, 4.0, 5.0]), state_names=STATES,
        reducing=outputs, deviation=lambda q, v2: np.concatenate([q, v2[:1], v2[1:4]]),
    ), generator.uniform(-1, 1, (2, 6))  # fmt: skip


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
def test_state_feedback_moves_the_states_of_outputs_that_have_a_reference(names, generator):
    """Values where they are states, and rates where those are; angles by the shorter way."""
    model, K = linear()
    places = [model.reducing.names.index(name) for name in names]
    reference = Cubic(*np.random.default_rng(9).uniform(-2, 2, (4, 5))[:, places])
    law = StateFeedback(model, K, reference, names)
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


test_state_feedback_refuses_what_does_not_fit = refused([
    (lambda K: (K.T,), "the gain has shape (6, 2), expected (2, 6)"),
    (lambda K: (K, Hold(np.zeros(2)), ["tilt"]), "the state feedback's reference has 2 values for 1 outputs"),
    (lambda K: (K, Hold(np.zeros(1)), ["tild"]), "no reducing output 'tild'; did you mean 'tilt'?"),
    (lambda K: (K, Hold(np.zeros(5))), f"neither 'spin' nor its rate is a state, expected one of {', '.join(STATES)}"),
], lambda given: StateFeedback(linear()[0], *given(linear()[1])), rnc.ConfigurationError)  # fmt: skip
