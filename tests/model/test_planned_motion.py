"""Planned motion and steps in one call of the kernel, beside the step of the action models."""

import numpy as np
import pytest

import systems
from rnc_pin.model.evaluator import Evaluator
from rnc_pin.motion.optimal import Nodes, action_model
from systems import random_states

SYSTEMS = ("sleigh", "mobile_manipulator", "tiago", "free_flying_panda", "space_robot", "ackermann_car")


def stepped(model, start, u, h, steps):
    """The same motion step by step."""
    now, found = Nodes(*(each[None] for each in start)), []
    for used in np.repeat(u, steps, axis=0):
        now = model.step(now, used[None], np.array([h]))
        found.append((now.q[0], now.w[0]))
    return tuple(np.array(each) for each in zip(*found, strict=True))


@pytest.mark.parametrize("form", ["kinematic", "acceleration", "dynamic"])
@pytest.mark.parametrize("name", SYSTEMS)
def test_the_compiled_motion_is_that_of_the_steps(name, form, monkeypatch):
    reduced, generator = getattr(systems, name)(), np.random.default_rng(2)
    if form == "dynamic" and not reduced.p:
        pytest.skip("no actuators")
    (model := action_model(reduced, form)).parts = 1
    ((q, v2),) = random_states(reduced, 1)
    start, u = (q, v2[: model.nw]), 0.1 * generator.normal(size=(3, model.nu))
    if reduced.evaluator.kernel is None:
        assert reduced.evaluator.planned_motion(form, start, u, 1e-3, 4) is None
        return
    states = random_states(reduced, 3)
    nodes = Nodes(np.array([q for q, _ in states]), np.array([v2[: model.nw] for _, v2 in states]))
    after = reduced.evaluator.planned_steps(form, *nodes, u, np.array([1e-3, 0.0, 0.02]))
    twice = [np.repeat(each, 2, axis=0) for each in (*nodes, u)]
    shared = reduced.evaluator.planned_steps(form, *twice, np.tile([1e-3, 0.02], 3))
    monkeypatch.setattr(Evaluator, "planned_steps", lambda *_: None)
    for one, other in zip(after, model.step(nodes, u, np.array([1e-3, 0.0, 0.02])), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-13, atol=1e-13)
    apart = model.step(Nodes(*twice[:2]), twice[2], np.tile([1e-3, 0.02], 3))
    for one, other in zip(shared, apart, strict=True):  # steps from one node share its flow
        np.testing.assert_allclose(one, other, rtol=1e-13, atol=1e-13)
    found = reduced.evaluator.planned_motion(form, start, u, 1e-3, 4)
    assert found is not None
    for one, other in zip(found, stepped(model, start, u, 1e-3, 4), strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-13 * (1 + np.abs(other).max(initial=0.0)))
