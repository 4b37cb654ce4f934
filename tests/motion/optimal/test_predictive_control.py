"""Model-predictive control in closed loop, with a delay, and when its budget is missed."""

import numpy as np
import pytest

import rnc_pin as rnc
import systems
from rnc_pin.motion import optimal
from rnc_pin.motion.optimal import InputBound, PredictiveController

pytestmark = pytest.mark.filterwarnings("ignore:.*quadratic costs stall:rnc_pin.errors.ModelWarning")


def controller_of(reduced, **options):
    place = [rnc.FramePosition("sleigh", "xy"), rnc.FrameYaw("sleigh")]
    costs = [optimal.EffortCost(0.01), optimal.VelocityCost(2.0, phase="both")]
    costs += [optimal.OutputCost(place, [1.0, 0.0, 0.0], weight=10.0, phase="both")]
    return PredictiveController(reduced, costs, 2.0, nodes=15, **{"bounds": [InputBound(-30.0, 30.0)], **options})


def test_missed_updates_keep_the_last_motion_and_reach_the_verdict():
    """Every second update of the sleigh is late, then every one, so that it stands: the run was once 'succeeded'."""
    reduced = systems.sleigh()

    class Late(PredictiveController):
        def step(self, t, measurement, state):
            self.updates = optimal.UpdateSchedule(budget=0.0 if self.always or round(t / 0.05) % 2 else None)
            return super().step(t, measurement, state)

    for always, word in ((False, "degraded"), (True, "failed")):
        controller = controller_of(reduced)
        controller.__class__, controller.always = Late, always
        run = rnc.simulate(reduced, controller, reduced.robot.configuration(), 0.5, dt=0.05)
        assert (run.verdict.word, np.abs(run.T).max() < 1e-12) == (word, always)
        (found,) = (each for each in run.verdict.findings if each.kind == "fallback")
        assert (found.where, found.amount) == ("predictive controller", 1.0 if always else pytest.approx(0.5, abs=0.1))
    assert rnc.simulate(reduced, controller_of(reduced), reduced.robot.configuration(), 0.1, dt=0.05).verdict.succeeded


@pytest.mark.parametrize(("mass", "word"), [(1.0, "succeeded"), (0.8, "failed")])
def test_bounds_of_accelerations_are_limits_of_the_run(mass, word):
    """The sleigh of the model accelerates at its bound, but for forces that are held (1 %); a lighter one more."""
    reduced, lighter = systems.sleigh(), systems.sleigh.__wrapped__()
    for body in lighter.robot.model.inertias:
        body.mass *= mass
        body.inertia *= mass
    bounds = [InputBound([-0.5, -1.0], [0.4, np.inf])]
    controller, plant = controller_of(reduced, form="acceleration", bounds=bounds), rnc.ReducedPlant(lighter)
    run = rnc.simulate(reduced, controller, reduced.robot.configuration(), 1.0, v2_0=[0.0, 0.5], dt=0.01, plant=plant)
    rates = np.diff(run.v2[:, 0]) / np.diff(run.time)
    assert 0.0 < rates.max() / 0.4 * mass - 1.0 < 0.01
    assert run.verdict.word == word
    if word == "failed":
        found = next(each for each in run.verdict.findings if each.where == reduced.reducing.names[0])
        assert (found.kind, found.amount) == ("acceleration", pytest.approx(rates.max() - 0.4))


def test_prediction_over_the_delay_is_the_simulated_state():
    """The first node of a motion with delay is where the sleigh is at the end of the delay."""
    reduced = systems.sleigh()
    controller = controller_of(reduced, updates=optimal.UpdateSchedule(delay=0.1, period=0.5))
    moving = reduced.at(reduced.robot.configuration(), np.array([0.4, 0.0])).measure(np.zeros(2))
    _, state = controller.step(0.0, moving, controller.initial_state(moving))
    np.testing.assert_allclose(state.q[0][:2], [0.04, 0.0], atol=1e-3)  # coasting: no inputs before
    assert state.begin == 0.1


def test_a_bound_holds_between_the_nodes_of_its_own_plant_too():
    """Feedback between updates once turned 2.2 mrad beyond a bound of 0.4 rad."""
    reduced = systems.sleigh()
    goal = systems.goal_of("sleigh", 1.0, 0.5)
    costs = [optimal.SetPointCost(goal, weight=10.0, velocity_weight=0.1), optimal.EffortCost(0.01)]
    bounds = [optimal.OutputBound(rnc.FrameYaw("sleigh"), -0.4, 0.4), optimal.VelocityBound(-0.5, 0.5)]
    controller = PredictiveController(reduced, costs, 3.0, form="acceleration", bounds=bounds)
    run = rnc.simulate(reduced, controller, reduced.robot.configuration(), 3.0, dt=0.01)
    assert 0.39 < np.arctan2(run.q[:, 3], run.q[:, 2]).max() < 0.4
    assert 0.49 < np.abs(run.v2).max() < 0.5
