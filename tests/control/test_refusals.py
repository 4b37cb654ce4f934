"""Arguments of controllers that are refused, each with its message."""

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from controlled_tasks import TASK
from rnc_pin.control import (
    ChainedStabilizer,
    MomentumRegressor,
    RedundancyController,
    SlitheringReference,
    SteeringController,
    UnknownMass,
)
from rnc_pin.planning import Hold
from systems import fire_truck, mobile_manipulator, space_robot


def refusals():
    truck, manipulator, robot = fire_truck(), mobile_manipulator(), rnc.Robot.from_urdf("space_robot.urdf")
    of_truck = rnc.Task.of(truck, *TASK)
    of_two = rnc.Task.of(truck, TASK[0], TASK[1], ["trailer_yaw", "tractor_yaw"])
    of_robot = rnc.Task.of(space_robot(), ["tip_x", "tip_y"], ["joint_1"], ["platform"])
    light = robot.model.copy()
    light.inertias[3] = pin.Inertia(0.0, np.zeros(3), np.zeros((3, 3)))
    flat = rnc.Robot(pin.buildSampleModelManipulator())

    def two(q):
        return np.zeros((2, flat.nv))

    return {
        "stabiliser without motion": (lambda: ChainedStabilizer(3, max_input=0.0), "positive largest input, found 0"),
        "no unknown body": (lambda: MomentumRegressor(robot, "platform", []), "name at least one body of unknown mass"),
        "unknown body without mass": (
            lambda: MomentumRegressor(rnc.Robot(light), "platform", [UnknownMass("joint_2")]),
            "body behind joint 'joint_2' has no mass",
        ),
        "weights of the wrong number": (
            lambda: RedundancyController(of_robot, Hold([0.0, 0.0]), Hold([0.0]), weights=[1.0, 2.0]),
            "weights have to be 1 positive numbers",
        ),
        "steering two by one": (
            lambda: SteeringController(truck, of_two, Hold([0.0, 0.0]), Hold([0.0, 0.0])),
            "as many redundant as vertical outputs, found 1 and 2",
        ),
        "two headings of a trailer": (
            lambda: SlitheringReference(truck, of_two, "tractor", "rear_axle"),
            "slithers by one vertical output, its yaw; the task has trailer_yaw, tractor_yaw",
        ),
        "no place of the trailer": (
            lambda: SlitheringReference(truck, of_truck, "tractor", "rear_axle", kingpin="tractor", spacing=-1.0),
            "spacing of a slithering reference has to be positive",
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
        "force on a ball": (
            lambda: rnc.NonholonomicSystem(manipulator.robot, [], ["root_joint"]),
            "actuator 'root_joint' is a joint of several degrees of freedom",
        ),
    }  # fmt: skip


REFUSED = refusals()


@pytest.mark.parametrize(("call", "words"), REFUSED.values(), ids=REFUSED)
def test_what_is_refused_is_said(call, words):
    with pytest.raises(rnc.RncError) as caught:
        call()
    assert words in str(caught.value)
