"""Arguments of controllers that are refused, each with its message."""

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from controlled_tasks import TASK
from refusals import refused
from systems import fire_truck, mobile_manipulator


def refusals():
    truck, manipulator = fire_truck(), mobile_manipulator()
    of_two = rnc.Task.of(truck, TASK[0], TASK[1], ["trailer_yaw", "tractor_yaw"])
    flat = rnc.Robot(pin.buildSampleModelManipulator())

    def two(q):
        return np.zeros((2, flat.nv))

    hold = rnc.planning.Hold(np.zeros(manipulator.r))
    q0 = manipulator.robot.configuration({"joint_1": 0.5, "joint_2": -1.2})
    forces = rnc.control.VelocityTracker(rnc.control.ReducingOutputController(manipulator, hold))
    tip = {rnc.FramePosition("tip", "xy"): [1.0, 0.5]}

    return [
        (lambda: rnc.control.SlitheringReference(truck, of_two, "tractor", "rear_axle"),
            "slithers by one vertical output, its yaw; the task has trailer_yaw, tractor_yaw"),
        (lambda: rnc.NonholonomicSystem(flat, [rnc.Pfaffian(two, two, ["one"])]), "1 names for 2 Pfaffian rows"),
        (lambda: rnc.NonholonomicSystem(flat, []).reduce([rnc.Output(lambda q: q, two, two, "both")]),
            "names of a user-defined output have to be a list of strings, found 'both'"),
        (lambda: rnc.NonholonomicSystem(manipulator.robot, []).reduce([rnc.JointPosition("root_joint")]),
            "joint 'root_joint' has 3 degrees of freedom: use outputs of a frame"),
        (lambda: rnc.control.ReducingOutputController(manipulator, [1.0, 0.0]),
            "the reducing reference has to be one such as rnc.planning.Hold(values), found [1.0, 0.0]"),
        (lambda: rnc.control.RedundancyController(manipulator, hold, hold),
            "RedundancyController: task: expected Task, found ReducedModel"),
        (lambda: rnc.control.StateFeedback(manipulator, rnc.Linearization, np.eye(4)),
            "StateFeedback: linear: expected Linearization, found ReducedModel"),
        (lambda: rnc.optimal.plan(q0, manipulator, tip, 2.0), "plan: reduced: expected ReducedModel, found array"),
        *((make, rnc.ConfigurationError, "target: expected a kinematic controller, such as rnc.control") for make in (
            lambda: rnc.control.VelocityTracker(hold), lambda: rnc.control.ComputedTorque(manipulator, hold),
            lambda: rnc.control.ComputedTorque(hold, manipulator),
            lambda: rnc.control.VelocityTracker(rnc.control.ReducingOutputController))),
        (lambda: rnc.control.VelocityTracker(forces.target, {"k": 10.0}),
            "gains: expected VelocityGains, found a mapping with keys k"),
        (lambda: rnc.control.VelocityTracker(forces.target, rnc.control.VelocityGains(k=[-1.0, 1.0, 1.0, 1.0])),
            "gain k: expected numbers of at least 0, found [-1.0, 1.0, 1.0, 1.0]"),
        (lambda: rnc.kinematic_rollout(manipulator, forces, q0, 1.0),
            "it gives forces, not velocities: expected a kinematic controller"),
        (lambda: rnc.kinematic_rollout(manipulator, forces.target, q0, -1.0),
            "duration -1.0 and dt 0.02 have to be positive numbers"),
        (lambda: rnc.free_motion(manipulator, q0, np.zeros(4), "2"), "duration '2', dt"),
        (lambda: rnc.NonholonomicSystem(manipulator.robot, [], "joint_1"),
            "actuators: expected a list, a matrix or a function B(q), found 'joint_1'"),
        (lambda: rnc.NonholonomicSystem(manipulator.robot, []).reduce("tip"),
            "reducing outputs: expected a list, found 'tip'"),
        (lambda: manipulator.forward_dynamics(q0, None, np.zeros(manipulator.p)),
            "v2 is missing: expected the reduced velocity"),
        (lambda: rnc.analyze(manipulator, samples=0), "samples: expected an integer of at least 1"),
        (lambda: rnc.solve_ik(manipulator, q0, tip, search=5), "solve_ik: search: expected IkSearch, found 5"),
        (lambda: rnc.planning.find_way(manipulator, q0, tip, ["box"]),
            "obstacles: expected a list of Obstacle objects, found ['box']"),
        (lambda: rnc.planning.find_way(manipulator, q0, tip, settings={"seconds": 1.0}),
            "settings: expected WaySettings, found a mapping with keys seconds"),
    ]  # fmt: skip


test_what_is_refused_is_said = refused(refusals())


def test_servos_refuse_constraints_that_depend_on_time(robot):
    swing = rnc.planning.Harmonic([0.0], amplitude=[0.3], frequency=0.5)
    kinds = [rnc.MomentumConservation("platform"), rnc.PrescribedMotion(rnc.JointPosition("joint_1"), swing)]
    reduced = rnc.NonholonomicSystem(robot, kinds, ["joint_2", "joint_3"]).reduce()
    target = rnc.control.ReducingOutputController(reduced, rnc.planning.Hold(np.zeros(reduced.r)))
    for make in (lambda: rnc.VelocityLoop(reduced, target, 0.01), lambda: rnc.plants.VelocityPlant(reduced)):
        with pytest.raises(rnc.ConfigurationError, match=r"depend on time are not supported: prescribed\(joint_1\)"):
            make()
