"""Controllers say what they are and with which gains; those of users need not."""

import inspect
import json

import numpy as np
import pytest

import rnc_pin as rnc
from rnc_pin import control
from rnc_pin.control import Command, Describable, VelocityTracker, describe
from rnc_pin.scenario.execution import plan
from rnc_pin.scenario.files import built_in_names
from systems import space_robot

CONTROLLERS = [
    each
    for each in vars(control).values()
    if inspect.isclass(each) and not getattr(each, "_is_protocol", False) and hasattr(each, "step")
]


@pytest.mark.parametrize("kind", CONTROLLERS)
def test_every_controller_describes_itself(kind):
    assert "describe" in vars(kind) or kind is control.SlitheringReference  # which is a reference


GAINS = {  # of what a controller is made of, by its type
    "VelocityTracker": {"gains", "target"},
    "PositionTracker": {"gains"},
    "JacobianTransposeController": {"tracker", "active"},
    "ReducingOutputController": {"k2"},
    "RedundancyController": {"k3", "k21"},
    "UncertainController": {"alpha", "initial", "bounds", "controller"},
    "UncertainRedundancyController": {"k3", "k21", "alpha", "initial", "bounds"},
    "SteeringController": {"k3", "k4", "k21"},
    "UnicycleStabilizer": {"goal", "k", "rate"},
    "SplitController": {"parts"},
}


def parts_of(description):
    """A description and those inside it."""
    yield description
    for value in description.values():
        for each in value if isinstance(value, list) else [value]:
            if isinstance(each, dict) and "type" in each:
                yield from parts_of(each)


@pytest.mark.parametrize("name", built_in_names())
def test_the_record_of_a_built_in_scenario_has_its_gains(name):
    written = json.loads(json.dumps(plan(name, {"comparisons": {}, "plots": {}}).experiment.notes["controller"]))
    parts = list(parts_of(written))
    for part in parts:
        assert set(part) >= GAINS[part["type"]], part
    trackers = [part["gains"] for part in parts if "gains" in part]
    assert trackers
    for gains in trackers:
        assert set(gains) in ({"k", "beta", "sigma"}, {"k1", "k2", "gamma", "beta", "sigma"})
        assert all(np.min(gain) > 0 for gain in gains.values())


def test_two_phases_keep_the_gains_of_both():
    experiment = plan("mobile-manipulator-two-phase", {"comparisons": {}, "plots": {}}).experiment
    hand, platform = experiment.notes["controller"]["parts"]
    assert (hand["type"], platform["type"], platform["target"]["type"]) == (
        "PositionTracker",
        "VelocityTracker",
        "UnicycleStabilizer",
    )
    assert sorted([*hand["outputs"], *platform["outputs"]]) == list(range(experiment.reduced.r))
    assert len(hand["gains"]["k1"]) == len(hand["outputs"])
    assert len(platform["gains"]["k"]) == len(platform["outputs"])


class _Silent:
    """A controller of somebody who never heard of descriptions."""

    def initial_state(self, measurement):
        return None

    def step(self, t, measurement, state):
        return Command(F=-measurement.v2), None


def test_a_controller_that_says_nothing_runs_all_the_same():
    reduced = space_robot()
    q0 = reduced.robot.configuration({"joint_2": 1.8, "joint_3": -1.1})
    assert isinstance(_Silent(), control.Controller)
    assert not isinstance(_Silent(), Describable)
    assert describe(_Silent()) == {"type": "_Silent"}
    assert len(rnc.simulate(reduced, _Silent(), q0, 0.1, 0.01).time) == 11
    assert describe(VelocityTracker(_Silent()))["target"] == {"type": "_Silent"}
