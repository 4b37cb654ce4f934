"""Bounds of contact forces: derivatives beside differences, and plans beside closed forms."""

import numpy as np
import pytest

import rnc_pin as rnc
import systems
from rnc_pin.optimal.action_models import Nodes, action_model
from rnc_pin.optimal.node_data import NodeData
from systems import WHEEL, random_states, rolling_base

FRICTION = 0.7


def three_supports(base="planar"):
    """Two driven wheels and a caster."""
    robot = rnc.Robot(rolling_base({"l": (0.0, 0.2), "r": (0.0, -0.2), "nose": (0.4, 0.0)}, WHEEL, base))
    rows = [rnc.RollingWheel("l", WHEEL), rnc.RollingWheel("r", WHEEL), rnc.Caster("nose", WHEEL)]
    system = rnc.NonholonomicSystem(robot, rows, ["l_spin", "r_spin", "nose_spin"])
    return system.reduce([rnc.FrameSpeed("base"), rnc.FrameYaw("base"), rnc.JointPosition("nose_spin")])


def four_wheels():
    robot = rnc.Robot(rolling_base(systems.CORNERS, WHEEL))
    rows = [rnc.RollingWheel(name, WHEEL) for name in systems.CORNERS]
    return rnc.NonholonomicSystem(robot, rows, [f"{name}_spin" for name in systems.CORNERS]).reduce()


SYSTEMS = {
    "three supports": three_supports,
    "three supports of a free base": lambda: three_supports("free"),
    "four wheels": four_wheels,
    "mecanum": systems.mecanum,
    "sleigh": systems.sleigh,
    "bicycle": systems.bicycle,
    "car": systems.ackermann_car,
}


def moved(model, at, u, by, of_input):
    """Nodes displaced by tangent vectors."""
    states = model.displaced(at, by[:, : model.nx])
    return NodeData(model, states, u + by[:, model.nx :], np.zeros(len(u)), None)


@pytest.mark.parametrize("bound", [rnc.optimal.NormalForceBound(0.0), rnc.optimal.GripBound(FRICTION)], ids=["normal", "grip"])
@pytest.mark.parametrize("form", ["dynamic", "acceleration"])
@pytest.mark.parametrize("name", SYSTEMS)
def test_derivatives_of_contact_forces_are_those_of_differences(name, form, bound):
    reduced = SYSTEMS[name]()
    model = action_model(reduced, form)
    if form == "acceleration" and reduced.p != reduced.r:
        with pytest.raises(rnc.ConfigurationError, match="use form 'dynamic'"):
            bound.bind(model)
        return
    rows = bound.bind(model)
    states = list(random_states(reduced, 4))
    generator = np.random.default_rng(3)
    at = Nodes(np.array([q for q, _ in states]), np.array([v2 for _, v2 in states]))
    u = generator.normal(size=(4, model.nu))
    found = rows.rows(moved(model, at, u, np.zeros((4, model.nx + model.nu)), None), True)
    whole = np.concatenate([found.x, found.u], axis=2)
    step = 1e-5
    for column in range(model.nx + model.nu):
        by = np.zeros((4, model.nx + model.nu))
        by[:, column] = step
        ahead, behind = (rows.rows(moved(model, at, u, sign * by, None), True).value for sign in (1, -1))
        difference = (ahead - behind) / (2 * step)
        scale = np.abs(whole).max() + np.abs(found.value).max()
        np.testing.assert_allclose(whole[:, :, column], difference, atol=2e-6 * scale)
