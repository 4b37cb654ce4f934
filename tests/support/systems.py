"""The systems that invariants are tested on: the paper's three, and robots nobody prepared for this."""

from collections.abc import Sequence
from functools import cache
from itertools import islice
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from bodies import add_body, add_frame


@cache
def sleigh(thrust: float = np.inf, torque: float = np.inf, vertical: tuple = ()) -> rnc.ReducedModel:
    """A Chaplygin sleigh with a thruster and a flywheel, and limits of both."""
    actuators = [rnc.FrameForce("sleigh", "x", limit=thrust), rnc.FrameTorque("sleigh", "z", limit=torque)]
    robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
    system = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")], actuators)
    return system.reduce([rnc.FrameSpeed("sleigh"), rnc.FrameYaw("sleigh")], vertical)


JOINTS = ["joint_1", "joint_2", "joint_3"]  # of the space robot


def floating_robot(momentum: float = 0.0, model: pin.Model | None = None) -> rnc.NonholonomicSystem:
    """The space robot, or a model of it, with an angular momentum."""
    robot = rnc.Robot.from_urdf("space_robot.urdf") if model is None else rnc.Robot(model)
    return rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform", momentum)], JOINTS)


def in_joints(system: rnc.NonholonomicSystem) -> rnc.ReducedModel:
    return system.reduce([rnc.JointPosition(joint) for joint in JOINTS], [rnc.JointPosition("platform")])


def in_tip_and_joint(system: rnc.NonholonomicSystem) -> rnc.ReducedModel:
    outputs = [rnc.FramePosition("tip", "xy"), rnc.JointPosition("joint_1")]
    return system.reduce(outputs, [rnc.JointPosition("platform")])


@cache
def space_robot() -> rnc.ReducedModel:
    return in_tip_and_joint(floating_robot())


@cache
def space_robot_in_joints() -> rnc.ReducedModel:
    return in_joints(floating_robot())


def arm_on_base(robot: rnc.Robot | None = None, forces: Sequence = ()) -> rnc.NonholonomicSystem:
    """The mobile manipulator, or a changed one, with a motor for each motion that its axle leaves."""
    robot = robot or rnc.Robot.from_urdf("mobile_manipulator.urdf", base="planar")
    drives = [rnc.FrameForce("base", "x"), rnc.FrameTorque("base", "z"), "joint_1", "joint_2"]
    return rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("axle")], drives, forces=forces)


@cache
def mobile_manipulator() -> rnc.ReducedModel:
    outputs = [rnc.FramePosition("tip", "xy"), rnc.FrameSpeed("base"), rnc.FrameYaw("base")]
    return arm_on_base().reduce(outputs, [rnc.Distance("base", "tip"), rnc.FramePosition("base", "xy")])


@cache
def differential_drive(*forces: rnc.forces.Wrench) -> rnc.ReducedModel:
    robot = rnc.Robot.from_urdf("differential_drive.urdf", base="planar")
    wheels = [rnc.RollingWheel("left_wheel", 0.1), rnc.RollingWheel("right_wheel", 0.1)]
    system = rnc.NonholonomicSystem(robot, wheels, ["left_wheel_joint", "right_wheel_joint"], forces=forces)
    return system.reduce([rnc.FrameSpeed("base"), rnc.FrameYaw("base")])


@cache
def fire_truck(urdf: str | Path = "fire_truck.urdf", *more: rnc.FramePosition) -> rnc.ReducedModel:
    """The truck of a file, with more vertical outputs."""
    robot = rnc.Robot.from_urdf(urdf, base="planar")
    edges = [rnc.NoSideSlip(f"{axle}_axle") for axle in ("front", "tractor", "rear")]
    steering = ("front_steering", "rear_steering")
    system = rnc.NonholonomicSystem(robot, edges, [rnc.FrameForce("tractor", "x"), *steering])
    vertical = [rnc.FramePosition("tractor", "xy"), rnc.FrameYaw("trailer"), rnc.FrameYaw("tractor"), *more]
    return system.reduce([rnc.FrameSpeed("tractor"), *map(rnc.JointPosition, steering)], vertical)


PANDA = [f"panda_joint{i}" for i in range(1, 8)]
FINGERS = {"panda_finger_joint1": 0.0, "panda_finger_joint2": 0.0}


def floating_panda(momentum: tuple[float, ...] | float = 0.0) -> rnc.NonholonomicSystem:
    """A free-flyer base with six momentum rows, gravity off."""
    robot = rnc.Robot.from_example("panda", base="free", gravity=(0, 0, 0), lock=FINGERS)
    return rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("root_joint", momentum)], PANDA)


@cache
def free_flying_panda() -> rnc.ReducedModel:
    """Hand and joints as outputs."""
    outputs = [rnc.FramePosition("panda_hand"), *(rnc.JointPosition(PANDA[i]) for i in (0, 2, 4, 6))]
    return floating_panda().reduce(outputs, [rnc.FramePosition("panda_link0"), rnc.FrameYaw("panda_link0")])


def driven_panda(masses: float = 1.0) -> rnc.ReducedModel:
    """Panda on a fixed base, in the angles of its joints, with a motor for each; masses relative to its file."""
    robot = rnc.Robot.from_example("panda", lock=FINGERS)
    for body in robot.model.inertias:
        body.mass, body.inertia = masses * body.mass, masses * body.inertia
    return rnc.NonholonomicSystem(robot, [], PANDA).reduce(map(rnc.JointPosition, PANDA))


@cache
def tiago() -> rnc.ReducedModel:
    """A planar base on two rolling wheels (six contact rows of rank three) under gravity, with an arm."""
    robot = rnc.Robot.from_example("tiago_no_hand", base="planar")
    wheels = ["wheel_left_joint", "wheel_right_joint"]
    arm = [name for name in robot.joint_names if name not in ("root_joint", *wheels)]
    rows = [rnc.RollingWheel(f"wheel_{side}_link", 0.0985) for side in ("left", "right")]
    system = rnc.NonholonomicSystem(robot, rows, [*wheels, *arm])
    outputs = [rnc.FrameSpeed("base_link"), rnc.FrameYaw("base_link"), *map(rnc.JointPosition, arm)]
    return system.reduce(outputs, [rnc.FramePosition("arm_7_link"), rnc.Distance("base_link", "arm_7_link")])


@cache
def leaning_wheel() -> rnc.ReducedModel:
    """A free disk that rolls and leans, under gravity: the contact arm and its rate depend on q."""
    model = pin.Model()
    model.name = "disk"
    add_body(model, "root_joint", "FreeFlyer", 2.0, moments=(0.05, 0.09, 0.05), frame="disk")
    system = rnc.NonholonomicSystem(rnc.Robot(model), [rnc.RollingWheel("disk", 0.3, axis="y")], np.eye(6)[:, 3:])

    spin, still = np.eye(6)[3:], np.zeros((3, 6))
    return system.reduce([rnc.Output(None, lambda q: spin, lambda q, v: still, ["spin_x", "spin_y", "spin_z"])], [])


@cache
def spinning_space_robot() -> rnc.ReducedModel:
    """The space robot with an angular momentum that is not zero: an affine constraint."""
    return in_tip_and_joint(floating_robot(6.0))


@cache
def drifting_manipulator() -> rnc.ReducedModel:
    """A platform that slides on the plane without friction, with linear and angular momentum."""
    robot = rnc.Robot.from_urdf("mobile_manipulator.urdf", base="planar")
    momentum = rnc.MomentumConservation("root_joint", (3.0, -2.0, 5.0))
    system = rnc.NonholonomicSystem(robot, [momentum], ["joint_1", "joint_2"])
    joints = [rnc.JointPosition("joint_1"), rnc.JointPosition("joint_2")]
    return system.reduce(joints, [rnc.FramePosition("base", "xy"), rnc.FrameYaw("base")])


@cache
def tumbling_panda() -> rnc.ReducedModel:
    """A free-flyer base whose linear and angular momentum are constant in the world, not in its own axes."""
    system = floating_panda((2.0, -1.0, 0.5, 0.3, 0.4, -0.6))
    joints = [rnc.JointPosition(joint) for joint in PANDA]
    return system.reduce(joints, [rnc.FramePosition("panda_hand"), rnc.FrameYaw("panda_link0")])


CRANK, COUPLER, ROCKER, GROUND = 0.3, 0.8, 0.6, 0.9


def four_bar_robot(knee: bool = False) -> rnc.Robot:
    """Crank and coupler from one pivot, rocker from the other, an open loop; with a knee the rocker ends in a link."""
    model = pin.Model()
    model.name = "four-bar"

    def link(parent: int, x: float, name: str, length: float, mass: float) -> int:
        across = mass * length**2 / 12
        joint = add_body(model, name, "RY", mass, parent, com=(length / 2, 0, 0), at=(x, 0, 0),
                         moments=[0.01, across, across + 0.001])  # fmt: skip
        add_frame(model, f"{name}_tip", joint, (length, 0.0, 0.0))
        return joint

    link(link(0, 0.0, "crank", CRANK, 1.0), CRANK, "coupler", COUPLER, 2.0)
    rocker = link(0, GROUND, "rocker", ROCKER, 1.5)
    if knee:
        link(rocker, ROCKER, "knee", 0.1, 0.2)
        add_frame(model, "knee_pin", 4)
    return rnc.Robot(model)


@cache
def four_bar() -> rnc.ReducedModel:
    """A planar loop closed at a point: three rows of rank two."""
    loop = rnc.LoopClosure("coupler_tip", "rocker_tip", "point")
    system = rnc.NonholonomicSystem(four_bar_robot(), [loop], ["crank"])
    return system.reduce([rnc.JointPosition("crank")], [rnc.JointPosition("rocker")])


@cache
def bicycle() -> rnc.ReducedModel:
    """Two wheels, the front one on a fork whose steering axis is raked back, free to lean, under gravity."""
    model = pin.Model()
    model.name = "bicycle"
    rake, radius = 0.35, 0.3
    steering = np.array([-np.sin(rake), 0.0, np.cos(rake)])

    def part(name, kind, mass, size, parent, com, **more):
        moments = mass * size**2 * np.array([0.3, 0.5, 0.25])
        return add_body(model, name, kind, mass, parent, com=com, moments=moments, **more)

    frame = part("root_joint", "FreeFlyer", 10.0, 0.6, 0, (0.4, 0.0, 0.3), frame="frame")
    part("rear_wheel", "RY", 1.5, radius, frame, (0.0, 0.0, 0.0), frame="rear")
    rake_axis = pin.JointModelRevoluteUnaligned(steering)
    fork = part("steer", rake_axis, 2.0, 0.3, frame, (0.05, 0.0, 0.1), at=(0.9, 0.0, 0.2))
    part("front_wheel", "RY", 1.5, radius, fork, (0.0, 0.0, 0.0), at=(0.12, 0.0, -0.2), frame="front")
    wheels = [rnc.RollingWheel("rear", radius), rnc.RollingWheel("front", radius)]
    system = rnc.NonholonomicSystem(rnc.Robot(model), wheels, ["rear_wheel", "steer", rnc.FrameTorque("frame", "x")])
    lean = np.eye(9)[3:4]  # angular velocity about the frame's own x axis
    roll = rnc.Output(None, lambda q: lean, lambda q, v: 0 * lean, ["roll_rate"])
    joints = [rnc.JointPosition("steer"), rnc.JointPosition("rear_wheel")]
    return system.reduce([roll, *joints], [rnc.FramePosition("front", "xy")])


def rolling_base(wheels: dict[str, tuple[float, float]], radius: float, base: str = "planar") -> pin.Model:
    """A body with wheels about its y axis at places (x, y): frames "base" and of the wheels' names."""
    model = pin.Model()
    model.name = "rolling base"
    inertia = pin.Inertia(20.0, np.array([0.05, 0.02, 0.1]), np.diag([0.5, 0.7, 0.9]))
    carrier = add_body(model, "root_joint", {"planar": "Planar", "free": "FreeFlyer"}[base], inertia, frame="base")
    for name, (x, y) in wheels.items():
        add_wheel(model, carrier, name, pin.SE3(np.eye(3), np.array([x, y, 0.0])), radius)
    return model


def add_wheel(model: pin.Model, carrier: int, name: str, place: pin.SE3, radius: float) -> None:
    """A wheel that turns about the y axis of its place on joint "<name>_spin", with a frame of its name."""
    moments = 1.5 * radius**2 * np.array([0.3, 0.5, 0.3])
    add_body(model, f"{name}_spin", "RUBY", 1.5, carrier, moments=moments, at=place, frame=name)


CORNERS = {"fl": (0.3, 0.25), "fr": (0.3, -0.25), "bl": (-0.3, 0.25), "br": (-0.3, -0.25)}
ROLLERS = {"fl": -np.pi / 4, "fr": np.pi / 4, "bl": np.pi / 4, "br": -np.pi / 4}
WHEEL = 0.08


def at_pose(reduced, x, y, yaw=0.0, **joints):
    """Configuration of a base in the plane."""
    q = np.array(reduced.robot.configuration(joints))
    q[:4] = x, y, np.cos(yaw), np.sin(yaw)
    return q


def goal_of(frame, x=0.0, y=0.0, yaw=0.0):
    """Goal of a plan: pose of a frame in the plane."""
    return {rnc.FramePosition(frame, "xy"): [x, y], rnc.FrameYaw(frame): yaw}


def knife_box(length=0.6, width=0.6):
    """A box with a knife edge in its middle."""
    unicycle = rnc.Robot.from_urdf("unicycle.urdf", base="planar")
    robot = with_shape(unicycle, "axle", coal.Box(length, width, 0.2), joint=1)
    return rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("axle")]).reduce()


def with_shape(robot, name, shape, place=None, joint=None):
    """The robot with a shape as its outline, on a frame or, where this spins, on another joint in its place."""
    geometry, frame = pin.GeometryModel(), robot.model.getFrameId(name)
    joint, place = joint or robot.model.frames[frame].parentJoint, place or pin.SE3.Identity()
    geometry.addGeometryObject(pin.GeometryObject(f"{name}_0", joint, frame, place, shape))
    return rnc.Robot(robot.model, collision_model=geometry)


@cache
def pendulum() -> rnc.ReducedModel:
    """One joint, in the tilt of its bob."""
    model = pin.Model()
    add_body(model, "hinge", "RUBY", pin.Inertia(1.3, np.array([0.1, 0.0, -0.4]), 0.07 * np.eye(3)), frame="bob")
    system = rnc.NonholonomicSystem(rnc.Robot(model), [], ["hinge"])
    return system.reduce([rnc.FrameTilt("bob", "x")], [rnc.FrameYaw("bob", "y"), rnc.FrameOrientation("bob")])


@cache
def mecanum() -> rnc.ReducedModel:
    """A base on four Mecanum wheels, which goes in any direction."""
    wheels = [rnc.RollingWheel(name, WHEEL, roller=roller) for name, roller in ROLLERS.items()]
    robot = rnc.Robot(rolling_base(CORNERS, WHEEL))
    system = rnc.NonholonomicSystem(robot, wheels, [f"{name}_spin" for name in CORNERS])
    outputs = [rnc.FrameSpeed("base", "x"), rnc.FrameSpeed("base", "y"), rnc.FrameYaw("base")]
    return system.reduce(outputs, [rnc.FramePosition("base", "xy")])


def on_two_wheels(
    height: float = 0.3, track: float = 0.4, ahead: float = 0.2, center: float = 0.0, radius: float = 0.1
) -> rnc.ReducedModel:
    """A body of 10 kg on two driven wheels without mass and a caster ahead; its centre is between axle and caster."""
    model, ground = pin.Model(), -radius
    com = (center, 0.0, height + ground)
    base = add_body(model, "root_joint", "Planar", 10.0, com=com, moments=(0.3, 0.3, 0.2), frame="base")
    add_frame(model, "nose", base, (ahead, 0.0, 0.0))
    for name, y in (("l", track / 2), ("r", -track / 2)):
        add_body(model, f"{name}_spin", "RUBY", 0.0, base, moments=1e-9, at=(0.0, y, 0.0), frame=name)
    rows = [rnc.RollingWheel("l", radius), rnc.RollingWheel("r", radius), rnc.Caster("nose", radius)]
    system = rnc.NonholonomicSystem(rnc.Robot(model), rows, ["l_spin", "r_spin"])
    return system.reduce([rnc.FrameSpeed("base"), rnc.FrameYaw("base")])


def on_four_wheels() -> rnc.ReducedModel:
    """A body of 20 kg with four driven wheels without mass; its centre is aside."""
    robot = rnc.Robot(rolling_base(CORNERS, WHEEL))
    for joint in range(2, robot.model.njoints):
        robot.model.inertias[joint] = pin.Inertia(0.0, np.zeros(3), 1e-9 * np.eye(3))
    rows = [rnc.RollingWheel(name, WHEEL) for name in CORNERS]
    return rnc.NonholonomicSystem(robot, rows, [f"{name}_spin" for name in CORNERS]).reduce()


WHEELBASE, TRACK, SCRUB = 1.1, 0.6, 0.07


def ackermann_robot(first: str = "left", base: str = "planar") -> rnc.Robot:
    """A car, its origin on the rear axle; left steers about an axis up, right down; wheels beside their pivots."""
    model = rolling_base({"bl": (0.0, TRACK / 2), "br": (0.0, -TRACK / 2)}, WHEEL, base)
    carrier = model.getJointId("root_joint")
    kinds = {
        "left": (1, pin.JointModelRZ(), np.eye(3)),
        "right": (-1, pin.JointModelRUBZ(), np.diag([1.0, -1.0, -1.0])),
    }
    for side in ("left", "right") if first == "left" else ("right", "left"):
        sign, kind, axes = kinds[side]
        pivot = pin.SE3(axes, np.array([WHEELBASE, sign * TRACK / 2, 0.0]))
        knuckle = add_body(model, f"{side}_steer", kind, 0.8, carrier, com=(0, 0.03, 0), moments=0.01, at=pivot)
        add_wheel(model, knuckle, f"f{side[0]}", pin.SE3(np.eye(3), np.array([0.0, SCRUB, 0.0])), WHEEL)
    return rnc.Robot(model)


@cache
def ackermann_car() -> rnc.ReducedModel:
    """Four rolling wheels and a steering linkage: speed and one steering freedom."""
    wheels = [rnc.RollingWheel(name, WHEEL) for name in ("fl", "fr", "bl", "br")]
    steering = rnc.AckermannSteering("left_steer", "right_steer", "bl")
    system = rnc.NonholonomicSystem(ackermann_robot(), [*wheels, steering], ["left_steer", "bl_spin", "br_spin"])
    outputs = [rnc.FrameSpeed("base"), rnc.JointPosition("left_steer")]
    return system.reduce(outputs, [rnc.FrameYaw("base"), rnc.FramePosition("fl", "xy")])


ALL = {function.__name__: function for function in (
    space_robot, space_robot_in_joints, mobile_manipulator, fire_truck, free_flying_panda, tiago, leaning_wheel,
    spinning_space_robot, drifting_manipulator, tumbling_panda, four_bar, bicycle, pendulum, mecanum, ackermann_car,
)}  # fmt: skip


def without_outputs(name: str, **options) -> rnc.ReducedModel:
    """The same system reduced without naming an output."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rnc.NonholonomicSystem, "reduce", lambda system, *_: system)
        system = ALL[name].__wrapped__()
    return system.reduce(**options)


def random_states(reduced: rnc.ReducedModel, count: int, seed: int = 0, condition: float = 3e2):
    """Seeded random (q, v2) at which the outputs parametrise the motion well."""
    generator = np.random.default_rng(seed)
    drawn = (reduced.random_configuration(generator, spread=1.2) for _ in range(100 * count))
    good = ((q, generator.uniform(-1, 1, reduced.r)) for q in drawn if reduced.at(q).condition < condition)
    states = list(islice(good, count))
    assert len(states) == count, f"only {len(states)} of {count} configurations have condition below {condition:g}"
    return states


def reacting(reduced: rnc.ReducedModel) -> np.ndarray:
    """Mask of the constraint rows that have a reaction, (m,): all except momenta, which the dynamics conserve."""
    rows = np.ones(reduced.m, dtype=bool)
    for block, where, _ in reduced.constraints.places:
        rows[where] = block.conserved is None
    return rows


def free_arm():
    """Free base with a continuous joint and a slider: bodies and frames "base", "upper" and "tip"."""
    model = pin.Model()
    base = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root_joint")
    placement = pin.SE3(pin.rpy.rpyToMatrix(0.3, -0.2, 0.5), np.array([0.4, 0.1, 0.3]))
    arm = model.addJoint(base, pin.JointModelRUBY(), placement, "arm")
    hand = model.addJoint(arm, pin.JointModelPZ(), placement, "hand")
    for joint, name in ((base, "base"), (arm, "upper"), (hand, "tip")):
        model.appendBodyToJoint(joint, pin.Inertia.FromSphere(1.0, 0.2), placement)
        add_frame(model, name, joint, placement)
    return model


def sprung_arm():
    """Free base with a continuous joint and a slider, and a force of every kind."""
    of = rnc.forces
    hand, arm, distance = rnc.JointPosition("hand"), rnc.JointPosition("arm"), rnc.Distance("base", "tip")
    forces = [of.Spring(hand, 40.0, 0.3), of.Spring(arm, 2.0, 3.0), of.Spring(distance, 20.0, 0.3)]
    forces += [of.Spring(rnc.FramePosition("tip", "zx"), (5.0, 2.0), (0.1, -0.2))]
    forces += [of.Spring(rnc.FrameYaw("tip", "x"), 1.5, -3.0), of.Damper(rnc.FrameTilt("tip", "y"), 1.1)]
    forces += [of.Damper(rnc.FrameOrientation("upper"), (0.2, 0.3, 0.4)), of.Damper(rnc.FrameSpeed("base", "z"), 0.8)]
    forces += [of.Damper(distance, 3.0), of.SmoothFriction(arm, 0.7, 0.4)]
    forces += [of.SmoothFriction(rnc.FramePosition("upper", "y"), 1.0, 0.6)]
    forces += [of.Wrench("tip", (1.0, -2.0, 0.5), (0.3, 0.2, 0.7))]
    forces += [of.Wrench("upper", (4.0, 1.0, 0.0), (0.0, 0.0, 0.6), axes="own")]
    drives = [rnc.FrameForce("tip", "x"), rnc.FrameTorque("base", "z"), "arm", "hand"]
    constraints = [rnc.NoSideSlip("base", "y"), rnc.NoSideSlip("upper", "z")]
    return rnc.NonholonomicSystem(rnc.Robot(free_arm()), constraints, drives, forces=forces).reduce()


def free_bodies(*names):
    """Free bodies with different inertias, each with a frame of its name."""
    model = pin.Model()
    for number, name in enumerate(names):
        lever, moments = (0.01, 0.02, -0.03), (20.0, 30.0, 40.0)  # found by moving, not by turning
        add_body(model, f"{name}_root", "FreeFlyer", 1.0 + number, com=lever, moments=moments, frame=name)
    return rnc.Robot(model)


@cache
def balls_on_curved_ground():
    """Balls in a bowl that turns, on a hill, in a drum that turns and slides, and in a pipe on a plate that moves."""
    bowl = rnc.SphericalGround(3.0, (0.1, 0.2, 2.0), angular_velocity=(0.3, -0.5, 0.8))
    drum = rnc.CylindricalGround(3.0, (1.0, 0.3, 0.2), (0.1, 0.2, 1.5), spin=0.7, sliding=-0.4)
    pipe = rnc.CylindricalGround(4.0, (0.2, -0.3, 1.0), frame="plate")
    rows = [
        rnc.RollingBody("egg", rnc.Sphere(0.2), at=(0.0, 0.01, 0.03), pivoting=False, ground=bowl),
        rnc.RollingBall("ball", 0.2, ground=rnc.SphericalGround(0.5, (0.1, 0.2, -2.1), inside=False)),
        rnc.RollingBall("one", 0.3, ground=drum),
        rnc.RollingBody("two", rnc.Sphere(0.1), rpy=(0.2, 0.1, -0.5), ground=pipe),
    ]
    return rnc.NonholonomicSystem(free_bodies("plate", "egg", "ball", "one", "two"), rows).reduce()


def mecanum_box() -> rnc.ReducedModel:
    """A box on four Mecanum wheels, with collision geometry."""
    rows = [rnc.RollingWheel(name, WHEEL, roller=roller) for name, roller in ROLLERS.items()]
    return rnc.NonholonomicSystem(with_shape(mecanum().robot, "base", coal.Box(0.6, 0.4, 0.2)), rows).reduce()
