"""Planned steps in one call of the kernel, beside the formulas of the action models."""

import numpy as np
import pytest

import systems
from by_numpy import needs_library
from rnc_pin import _kernel
from rnc_pin.motion.optimal import Nodes, action_model
from rnc_pin.motion.planning.action_models import FORMS
from systems import random_states

SYSTEMS = ("sleigh", "mobile_manipulator", "tiago", "free_flying_panda", "space_robot", "ackermann_car")


def stepped(model, start, u, h, steps):
    """The same motion step by step."""
    now, found = Nodes(*(each[None] for each in start)), []
    for used in np.repeat(u, steps, axis=0):
        now = model.step(now, used[None], np.array([h]))
        found.append((now.q[0], now.w[0]))
    return tuple(np.array(each) for each in zip(*found, strict=True))


@needs_library
@pytest.mark.parametrize("form", ["kinematic", "acceleration", "dynamic"])
@pytest.mark.parametrize("name", SYSTEMS)
def test_the_compiled_motion_is_that_of_the_steps(name, form, monkeypatch):
    reduced, generator = getattr(systems, name)(), np.random.default_rng(2)
    if form == "dynamic" and not reduced.p:
        pytest.skip("no actuators")
    (model := action_model(reduced, form)).parts = 1
    ((q, v2),) = random_states(reduced, 1)
    start, u = (q, v2[: model.nw]), 0.1 * generator.normal(size=(3, model.nu))
    states = random_states(reduced, 3)
    nodes = Nodes(np.array([q for q, _ in states]), np.array([v2[: model.nw] for _, v2 in states]))
    twice = [np.repeat(each, 2, axis=0) for each in (*nodes, u)]
    h, found = np.array([1e-3, 0.0, 0.02]), np.empty((12, len(q) + model.nw))
    parts = (*(each.copy() for each in start), np.repeat(u, 4, axis=0), np.full(12, 1e-3), found)
    assert reduced.evaluator.calls.planned_steps(FORMS.index(form), *parts)
    fast = model.step(nodes, u, h), model.step(Nodes(*twice[:2]), twice[2], np.repeat(h, 2))
    monkeypatch.setattr(reduced.evaluator, "calls", _kernel.NUMPY_ALONE)
    plain = model.step(nodes, u, h), model.step(Nodes(*twice[:2]), twice[2], np.repeat(h, 2))
    for one, other in zip((*fast[0], *fast[1]), (*plain[0], *plain[1]), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-13, atol=1e-13)
    expected = np.hstack(stepped(model, start, u, 1e-3, 4))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13 * (1 + np.abs(expected).max(initial=0.0)))
