"""Arguments of controllers that are refused, each with its message."""

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from controlled_tasks import TASK
from rnc_pin.control import SlitheringReference
from systems import fire_truck, mobile_manipulator


def refusals():
    truck, manipulator = fire_truck(), mobile_manipulator()
    of_two = rnc.Task.of(truck, TASK[0], TASK[1], ["trailer_yaw", "tractor_yaw"])
    flat = rnc.Robot(pin.buildSampleModelManipulator())

    def two(q):
        return np.zeros((2, flat.nv))

    return {
        "two headings of a trailer": (
            lambda: SlitheringReference(truck, of_two, "tractor", "rear_axle"),
            "slithers by one vertical output, its yaw; the task has trailer_yaw, tractor_yaw",
        ),
        "too few names": (
            lambda: rnc.NonholonomicSystem(flat, [rnc.Pfaffian(two, two, ["one"])]),
            "1 names for 2 Pfaffian rows",
        ),
        "names in one word": (
            lambda: rnc.NonholonomicSystem(flat, []).reduce([rnc.Output(lambda q: q, two, two, "both")]),
            "names of a user-defined output have to be a list of strings, found 'both'",
        ),
        "position of a ball": (
            lambda: rnc.NonholonomicSystem(manipulator.robot, []).reduce([rnc.JointPosition("root_joint")]),
            "joint 'root_joint' has 3 degrees of freedom: use outputs of a frame",
        ),
    }  # fmt: skip


REFUSED = refusals()


@pytest.mark.parametrize(("call", "words"), REFUSED.values(), ids=REFUSED)
def test_what_is_refused_is_said(call, words):
    with pytest.raises(rnc.RncError) as caught:
        call()
    assert words in str(caught.value)
