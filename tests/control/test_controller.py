"""Controllers say what they are and with which gains; those of users need not."""

import numpy as np
import pytest

import rnc_pin as rnc
from rnc_pin import control
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.control import Command, Describable, VelocityTracker, describe
from rnc_pin.control.controller import check_size
from rnc_pin.planning import Hold
from simple_controllers import Memoryless
from systems import space_robot


def test_two_phases_keep_the_gains_of_both():
    experiment = Scenario.load("mobile-manipulator-two-phase", {"comparisons": {}, "plots": {}}).experiment
    hand, platform = experiment.provenance.to_json()["controller"]["parts"]
    assert (hand["type"], platform["type"], platform["target"]["type"]) == (
        "PositionTracker",
        "VelocityTracker",
        "UnicycleStabilizer",
    )
    assert sorted([*hand["outputs"], *platform["outputs"]]) == list(range(experiment.reduced.r))
    assert len(hand["gains"]["k1"]) == len(hand["outputs"])
    assert len(platform["gains"]["k"]) == len(platform["outputs"])


def test_a_controller_that_says_nothing_runs_all_the_same():
    reduced = space_robot()
    q0 = reduced.robot.configuration({"joint_2": 1.8, "joint_3": -1.1})
    silent = Memoryless(lambda t, measurement: Command(F=-measurement.v2))
    assert isinstance(silent, control.Controller)
    assert not isinstance(silent, Describable)
    assert describe(silent) == {"type": "Memoryless"}
    assert len(rnc.simulate(reduced, silent, q0, 0.1, 0.01).time) == 11
    assert describe(VelocityTracker(silent))["target"] == {"type": "Memoryless"}


def test_a_reference_has_one_value_for_each_output():
    check_size(Hold(np.zeros(300)), 300, "reducing")
    with pytest.raises(rnc.ConfigurationError, match="the reducing reference has 300 values for 299 outputs"):
        check_size(Hold(np.zeros(300)), 299, "reducing")
