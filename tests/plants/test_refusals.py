"""Refusals of the room: what is wrong, in one line."""

import numpy as np
import pinocchio as pin

import rnc_pin as rnc
import systems
from bodies import add_body, free_body
from refusals import refused
from rnc_pin.plants import FaultyPlant, VelocityPlant

WRONG, INPUT = rnc.ConfigurationError, rnc.InputError
BALL = rnc.RollingBall("ball", 0.1)


def contact_plant(*contacts, system=None):
    robot = free_body(1.0, [0.1] * 3, ball=[0, 0, 0], point=[0, 0, 0.5])
    return rnc.ContactPlant(system or rnc.NonholonomicSystem(robot), contacts)


def contact(kind=BALL, **options):
    return rnc.UnilateralContact(kind, **options)


def sleigh():
    robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
    return rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")])


def floating():
    model = pin.Model()
    model.gravity = pin.Motion.Zero()
    base = add_body(model, "root_joint", "FreeFlyer", 1.0, frame="ball")
    add_body(model, "arm", "RX", 1.0, base)
    return rnc.NonholonomicSystem(rnc.Robot(model), [rnc.MomentumConservation("root_joint")])


def simulated(controller, plant=None):
    reduced = systems.mobile_manipulator()
    target = rnc.control.ReducingOutputController(reduced, rnc.planning.Hold([0.0] * reduced.r))
    q0 = reduced.robot.configuration()
    rnc.simulate(reduced, controller(reduced, target), q0, 0.1, plant=plant and plant(reduced))


def rubbing(plant=None):
    reduced = sleigh().reduce()
    plant = plant or FaultyPlant(rnc.ReducedPlant(reduced), rnc.Faults(), reduced)
    rnc.free_motion(plant, reduced.robot.configuration(), [1.0, 0.0], 1.0)


VELOCITIES, FORCES = rnc.control.ActuatorVelocityController, rnc.control.ComputedTorque


test_what_does_not_fit_is_refused_in_one_line = refused([
    (lambda: contact_plant(contact()).reset(np.array([0, 0, 0.05, 0, 0, 0, 1.0]), np.zeros(6)), INPUT,
        r"contact 'ball' starts 0\.05 m below the ground"),
    (lambda: contact_plant(contact(), system="ball"), WRONG, "system: expected NonholonomicSystem"),
    (contact_plant, WRONG, "expected a list of UnilateralContact"),
    (lambda: contact_plant(contact(), contact()), WRONG, "'ball' occurs twice"),
    (lambda: contact_plant(contact(rnc.NoSideSlip("ball"))), WRONG, "NoSideSlip: .*found 0 height rows"),
    (lambda: contact_plant(contact(rnc.RollingBall("ball", 0.1, rnc.SphericalGround(2.0)))), WRONG,
        "expected a plane as ground, found SphericalGround"),
    (lambda: contact_plant(contact(rnc.Caster("sleigh", 0.0)), system=sleigh()), WRONG, "robot with a free base"),
    (lambda: contact(restitution=1.2), WRONG, "restitution of UnilateralContact has to be .* at most 1, found 1.2"),
    (lambda: contact(friction=-0.1), WRONG, "friction of UnilateralContact has to be at least 0, found -0.1"),
    (lambda: contact_plant(contact(), contact(rnc.RollingBall("point", 0.1), friction=0.5)), WRONG,
        "contact 'ball': requires its coefficient of friction"),
    (lambda: contact_plant(contact(rnc.Caster("ball", 0.1), friction=0.5)), WRONG,
        "a Caster has no rows along the ground for friction"),
    (lambda: contact_plant(contact(friction=0.5), system=floating()), WRONG, "conserve a momentum are not supported"),
    (lambda: simulated(VELOCITIES), WRONG, "gives velocities: expected a plant with velocity servos.*None"),
    (lambda: simulated(VELOCITIES, rnc.ReducedPlant), WRONG, "gives velocities: .* found a ReducedPlant"),
    (lambda: simulated(FORCES, VelocityPlant), WRONG, "takes velocities: .* found a ComputedTorque"),
    (lambda: VelocityPlant(systems.mobile_manipulator(), servo_time="fast"), INPUT, "servo_time of a VelocityPlant"),
    (lambda: VelocityPlant(systems.mobile_manipulator(), servo_time=np.inf), INPUT, "servo_time of a VelocityPlant"),
    (lambda: VelocityPlant(systems.mobile_manipulator(), substeps=0), INPUT, "substeps"),
    (lambda: rubbing(rnc.ReducedPlant(sleigh().reduce(), joint_friction=True)), INPUT, "dry friction is not smooth"),
    (rubbing, INPUT, "requires a ReducedModel or a ReducedPlant"),
    (lambda: rnc.Faults(dropped=2.0), WRONG, "fault dropped"),
    (lambda: rnc.Faults(position_noise=-1.0), WRONG, "fault position_noise"),
    (lambda: rnc.Faults(counts=0), WRONG, "fault counts"),
    (lambda: rnc.Faults(effort=np.nan), WRONG, "fault effort"),
])  # fmt: skip
