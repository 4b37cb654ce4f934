"""Models whose motions the benchmarks of optimal control plan."""

from __future__ import annotations

from collections.abc import Sequence

import rnc_pin as rnc
from rnc_pin.motion.optimal import OutputBound, VelocityBound


def knife_edge(inputs: Sequence[rnc.FrameForce | rnc.FrameTorque] = ()) -> rnc.ReducedModel:
    robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
    system = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")], inputs)
    return system.reduce([rnc.FrameSpeed("sleigh"), rnc.FrameYaw("sleigh")])


def car(driven: str = "rear_axle") -> rnc.ReducedModel:
    """Car with a driven axle, of which the front one is steered too."""
    robot = rnc.Robot.from_urdf("car.urdf", base="planar")
    rows = [rnc.NoSideSlip("front_axle"), rnc.NoSideSlip("rear_axle")]
    system = rnc.NonholonomicSystem(robot, rows, [rnc.FrameForce(driven, "x"), "front_steering"])
    return system.reduce([rnc.FrameSpeed(driven), rnc.JointPosition("front_steering")])


def mobile_manipulator() -> rnc.ReducedModel:
    robot = rnc.Robot.from_urdf("mobile_manipulator.urdf", base="planar")
    inputs = [rnc.FrameForce("base", "x"), rnc.FrameTorque("base", "z"), "joint_1", "joint_2"]
    system = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("axle")], inputs)
    joints = [rnc.JointPosition("joint_1"), rnc.JointPosition("joint_2")]
    return system.reduce([rnc.FrameSpeed("base"), rnc.FrameYaw("base"), *joints])


def tractor(trailers: int) -> rnc.ReducedModel:
    """Tractor with trailers, each hitched on the axle before."""
    given = {"trailers": trailers}
    robot = rnc.Robot.from_urdf("tractor_trailers.urdf.xacro", base="planar", xacro_arguments=given)
    axles = ["front_axle", "tractor_axle", *(f"axle_{k}" for k in range(1, trailers + 1))]
    drives = [rnc.FrameForce("tractor", "x"), "front_steering"]
    system = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip(axle) for axle in axles], drives)
    return system.reduce([rnc.FrameSpeed("tractor"), rnc.JointPosition("front_steering")])


def docking(
    trailers: int, most_bent: float
) -> tuple[rnc.ReducedModel, dict[rnc.Output, list[float] | float], list[OutputBound | VelocityBound]]:
    """Docking of a tractor: it ends straight at the origin, with limits of speed, steering angle and hitch angles."""
    reduced = tractor(trailers)
    hitches = [rnc.JointPosition(joint) for joint in reduced.robot.joint_names if joint.startswith("hitch")]
    steering = OutputBound(rnc.JointPosition("front_steering"), -0.8, 0.8)
    goal = {rnc.FramePosition("tractor", "xy"): [0.0, 0.0], rnc.FrameYaw("tractor"): 0.0, **dict.fromkeys(hitches, 0.0)}
    return reduced, goal, [steering, VelocityBound(-1.0, 1.0), OutputBound(hitches, -most_bent, most_bent)]
