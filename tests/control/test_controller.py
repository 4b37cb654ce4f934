"""Controllers say what they are and with which gains; those of users need not."""

import rnc_pin as rnc
from rnc_pin.control import Command, Describable, VelocityTracker, describe
from simple_controllers import Memoryless
from systems import space_robot


def test_a_controller_that_says_nothing_runs_all_the_same():
    reduced = space_robot()
    q0 = reduced.robot.configuration({"joint_2": 1.8, "joint_3": -1.1})
    silent = Memoryless(lambda t, measurement: Command(F=-measurement.v2))
    assert isinstance(silent, rnc.control.Controller)
    assert not isinstance(silent, Describable)
    assert describe(silent) == {"type": "Memoryless"}
    assert len(rnc.simulate(reduced, silent, q0, 0.1, 0.01).time) == 11
    assert describe(VelocityTracker(silent))["target"] == {"type": "Memoryless"}
