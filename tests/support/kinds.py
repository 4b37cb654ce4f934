"""A reduction for each kind of row and force that the compiled kernel knows, and whole robots beside them."""

from dataclasses import replace
from functools import cache

import numpy as np
import pinocchio as pin

import rnc_pin as rnc
import systems
from bodies import add_body, add_frame
from row_kinds import BESIDE, CARRIED, ON_PLANES, ROLLING
from systems import free_arm, free_bodies

JOINTS = [rnc.JointPosition(name) for name in ("rear_wheel", "steer", "front_wheel")]
CONSTRAINTS = {
    "wheels": [rnc.RollingWheel("rear", 0.3), rnc.RollingWheel("front", 0.3)],
    "roller": [rnc.RollingWheel("front", 0.3, roller=-np.pi / 4)],
    "skid": [rnc.RollingWheel("rear", 0.3, lateral=False), rnc.NoSideSlip("front", (0.9, 0.3, 0.2), at=BESIDE)],
    "side slip": [rnc.NoSideSlip("frame", "z", at=BESIDE), rnc.NoSideSlip("rear", "y")],
    "caster": [rnc.Caster("front", 0.05), rnc.RollingBall("rear", 0.3)],
    "point of the world": [rnc.LoopClosure("universe", "front", "point", BESIDE, (0.0, 0.1, -0.4))],
    "point of a wheel": [rnc.LoopClosure("front", "universe", "point", BESIDE)],
    "frame of the world": [rnc.LoopClosure("universe", "rear", "frame", BESIDE, (0.0, 0.1, -0.4), (0.3, -0.5, 1.1))],
    "frame of a wheel": [rnc.LoopClosure("front", "universe", "frame", BESIDE, (0.0, 0.1, -0.4), (0.3, -0.5, 1.1))],
    "fixed outputs": [rnc.FixedOutput(rnc.FrameYaw("front", "z"), 0.3), rnc.FixedOutput(JOINTS[1], 0.2)],
    "gear": [rnc.JointCoupling("front_wheel", "rear_wheel", 0.5), rnc.NoSideSlip("frame", "y")],
}
TURNS = [rnc.FrameAngularVelocity("frame", axis) for axis in "xyz"]
SPEEDS = [rnc.FrameSpeed("rear", axis) for axis in "xyz"]
OUTPUTS = {
    "position": [rnc.FramePosition("front", "xyz"), *TURNS, *JOINTS],
    "orientation": [*SPEEDS, rnc.FrameOrientation("front"), *JOINTS],
    "yaw and tilt": [*SPEEDS, TURNS[1], rnc.FrameYaw("front", "z"), rnc.FrameTilt("rear", "x"), *JOINTS],
    "distance": [*SPEEDS, *TURNS, rnc.JointPosition("rear_wheel"), rnc.Distance("box", "front"), JOINTS[2]],
}


def two_wheeler(constraints=(), outputs=(), vertical=(), gravity=True):
    """The robot of the bicycle with a frame of the world, driven at a joint and at two frames; heavy by default."""
    model = systems.bicycle().robot.model.copy()
    add_frame(model, "box", at=(0.3, 1.1, -0.4))
    model.gravity.linear = np.array([0.0, 0.0, -9.81 * gravity])
    actuators = ["steer", rnc.FrameTorque("frame", "x"), rnc.FrameForce("front", "z")]
    system = rnc.NonholonomicSystem(rnc.Robot(model), constraints, actuators)
    return system.reduce(outputs or None, vertical)


def momenta(value):
    """Arm on a base that is free or planar, whose momentum is given; no gravity."""
    robot = rnc.Robot((systems.free_flying_panda() if np.size(value) == 6 else planar_arm()).robot.model)
    first, *others = robot.joint_names
    closed = [rnc.MomentumConservation(first, value)]
    return rnc.NonholonomicSystem(robot, closed, list(others)).reduce([rnc.JointPosition(name) for name in others])


def on_free_bodies(*names):
    """Kinds of these names, each on a free body of its own; the ground of some is a plate that moves freely."""
    frames = [f"body {k}" for k in range(len(names))]
    kinds = [(ON_PLANES | ROLLING | CARRIED)[name] for name in names]
    rows = [replace(kind, frame=frame) for kind, frame in zip(kinds, frames, strict=True)]
    return rnc.NonholonomicSystem(free_bodies("plate", *frames), rows).reduce()


@cache
def planar_arm():
    model = pin.Model()
    base = add_body(model, "root_joint", "Planar", 2.0, com=(0.2, 0.3, 0.0), at=(0.4, -0.3, 0.0))
    upper = add_body(model, "shoulder", "RZ", 2.0, base, com=(0.2, 0.3, 0.0), at=(0.5, 0.1, 0.2))
    add_body(model, "elbow", "RZ", 1.0, upper, com=(0.3, 0.1, 0.0), at=(0.5, 0.1, 0.2))
    model.gravity.linear = np.zeros(3)
    return rnc.NonholonomicSystem(rnc.Robot(model), []).reduce()


ON_A_PLATE = ("knife edge beside its frame", "caster on a plate", "ball on a belt", "slanted egg", "slanted wheel")
KINDS = {
    **{name: lambda rows=rows: two_wheeler(rows) for name, rows in CONSTRAINTS.items()},
    **{name: lambda rows=rows: two_wheeler([], rows) for name, rows in OUTPUTS.items()},
    "momentum of a free base": lambda: momenta((0.5, -0.2, 0.3, 0.1, 0.4, -0.6)),
    "no momentum of a free base": lambda: momenta(np.zeros(6)),
    "momentum of a planar base": lambda: momenta((0.5, -0.2, 0.3)),
    "no momentum of a planar base": lambda: momenta(np.zeros(3)),
    "momentum of a platform": systems.spinning_space_robot,
    "steering": systems.ackermann_car,
    "loop": systems.four_bar,
    "disk that leans": systems.leaning_wheel,
    "bodies that roll": lambda: on_free_bodies("turning slope", "turntable without pivoting", "ball", "roller"),
    "bodies on bodies": lambda: on_free_bodies(*ON_A_PLATE),
    "balls on curved ground": systems.balls_on_curved_ground,
    "wheels on moving ground": lambda: on_free_bodies("wheel", "skid on a turntable", "disk", "knife edge"),
    "forces": systems.sprung_arm,
}
"""Reductions that need no Python after their description."""
ILL_SCALED = ("distance", "momentum of a free base", "steering")
"""Reductions whose rows have different lengths."""


def outputs_of_all_kinds():
    """Free base: outputs of every kind, a point with an offset, a caster, a force on a frame, and rows of the user."""
    robot = rnc.Robot(free_arm())
    row = np.linspace(0.2, 1.0, robot.nv)[None]

    def turning(q):
        return row * np.cos(q[0])

    def turning_rate(q, v):
        return -row * np.sin(q[0]) * (pin.Quaternion(q[3:7]).matrix()[0] @ v[:3])

    constraints = [rnc.NoSideSlip("base", "y", at=(0.2, -0.1, 0.3)), rnc.Caster("upper", 0.1)]
    constraints += [rnc.Pfaffian(turning, turning_rate, names=["row"])]
    actuators = [rnc.FrameForce("tip", "x"), rnc.FrameTorque("base", "z"), "arm", "hand", rnc.FrameForce("base", "y")]
    vertical = [
        rnc.FrameOrientation("tip"), rnc.FrameYaw("tip", "y"), rnc.FrameTilt("tip", "x"), rnc.Distance("base", "tip"),
        rnc.FramePosition("tip", "zx"), rnc.FrameAngularVelocity("base", "z"), rnc.FrameSpeed("upper", "z"),
        rnc.Output(None, turning, turning_rate, ["own"]),
    ]  # fmt: skip
    return rnc.NonholonomicSystem(robot, constraints, actuators).reduce(vertical=vertical)


def driven_arm():
    """Arm on a free base: a joint, the tilt of a frame and its speed move as prescribed, above a turntable."""
    robot, swing = rnc.Robot(free_arm()), rnc.planning.Harmonic([0.1], amplitude=[0.3], frequency=0.5, phase=0.4)
    outputs = (rnc.JointPosition("arm"), rnc.FrameTilt("tip", "x"), rnc.FrameSpeed("upper", "z"))
    rows = [rnc.NoSideSlip("base", "y", at=(0.2, -0.1, 0.3), ground=rnc.GroundPlane(spin=0.7))]
    rows += [rnc.PrescribedMotion(output, swing) for output in outputs]
    return rnc.NonholonomicSystem(robot, rows, [rnc.FrameForce("tip", "x"), rnc.FrameTorque("base", "z"), "hand"])


WHOLE = "bicycle drifting_manipulator fire_truck free_flying_panda mecanum mobile_manipulator tiago tumbling_panda"
ROBOTS = {**{name: systems.ALL[name] for name in WHOLE.split()}, "outputs_of_all_kinds": outputs_of_all_kinds}
