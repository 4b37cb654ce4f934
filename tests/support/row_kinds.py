"""Constraints and outputs of every kind, each on a robot, and grounds of every kind."""

from functools import cache

import numpy as np
import pinocchio as pin

import rnc_pin as rnc
from rolling import rigid_body
from systems import ackermann_car, bicycle, free_bodies

BESIDE = (0.1, -0.2, 0.3)
SLOPE = rnc.GroundPlane(normal=(0.2, -0.3, 1.0), point=(0.1, 0.2, 0.3))
MOVING = rnc.GroundPlane(normal=(0.2, -0.3, 1.0), point=(0.1, 0.2, 0.3), velocity=(0.3, 0.2, 0.0), spin=-0.7)
TURNTABLE = rnc.GroundPlane(spin=1.3, point=(0.2, -0.1, 0.0), velocity=(0.3, -0.2, 0.0))
BOWL = rnc.SphericalGround(2.0, (0.1, 0.2, 1.9), angular_velocity=(0.3, -0.5, 0.8))
DRUM = rnc.CylindricalGround(2.0, (0.2, 1.0, 0.3), (0.1, 0.2, 1.9), spin=0.7, sliding=-0.4)
BALL = rnc.SphericalGround(2.0, (0.1, 0.2, -2.1), inside=False)


class Waves:
    """Ground of a user's own: z = sin(x) cos(2 y) / 10."""

    moves, angular_velocity, along = False, np.zeros(3), np.eye(3)[0]

    def level(self, point):
        return point[..., 2] - 0.1 * np.sin(point[..., 0]) * np.cos(2 * point[..., 1])

    def gradient(self, point):
        x, y = point[..., 0], point[..., 1]
        slopes = 0.1 * np.cos(x) * np.cos(2 * y), -0.2 * np.sin(x) * np.sin(2 * y)
        return np.stack([-slopes[0], -slopes[1], np.ones_like(x)], axis=-1)

    def hessian(self, point):
        x, y = point[..., 0], point[..., 1]
        bent = 0.1 * np.sin(x) * np.cos(2 * y), 0.2 * np.cos(x) * np.sin(2 * y)
        out = np.zeros((*point.shape, 3), dtype=point.dtype)
        out[..., 0, 0], out[..., 1, 1] = bent[0], 4 * bent[0]
        out[..., 0, 1] = out[..., 1, 0] = bent[1]
        return out

    def below(self, place):
        return place - self.level(place)[..., None] * np.eye(3)[2]

    def material_velocity(self, place):
        return np.zeros_like(place)


EGG = rnc.Ellipsoid((0.4, 0.2, 0.1))

ON_PLANES = {
    "wheel": rnc.RollingWheel("body", 0.3, "y", ground=MOVING),
    "roller": rnc.RollingWheel("body", 0.3, "y", roller=0.4, ground=MOVING),
    "skid on a turntable": rnc.RollingWheel("body", 0.2, "y", lateral=False, ground=TURNTABLE),
    "ball": rnc.RollingBall("body", 0.3, ground=MOVING),
    "caster": rnc.Caster("body", 0.1, ground=SLOPE),
    "knife edge": rnc.NoSideSlip("body", "x", (0.1, 0.2, 0.3), ground=MOVING),
}
ROLLING = {
    "sphere": rnc.RollingBody("body", rnc.Sphere(0.3)),
    "sphere beside its frame": rnc.RollingBody("body", rnc.Sphere(0.3), at=(0.05, -0.02, 0.08)),
    "ellipsoid": rnc.RollingBody("body", EGG, rpy=(0.2, 0.1, -0.5), at=(0.0, 0.01, 0.03)),
    "tyre": rnc.RollingBody("body", rnc.Torus(0.3, 0.05, "y")),
    "disk": rnc.RollingBody("body", rnc.Torus(0.3, axis="x"), at=(0.1, 0.0, 0.0)),
    "no pivoting": rnc.RollingBody("body", EGG, pivoting=False),
    "turntable": rnc.RollingBody("body", EGG, ground=TURNTABLE),
    "turntable without pivoting": rnc.RollingBody("body", rnc.Torus(0.3, 0.05), pivoting=False, ground=TURNTABLE),
    "turning slope": rnc.RollingBody("body", EGG, ground=rnc.GroundPlane(SLOPE.normal, SLOPE.point, spin=-0.7)),
}
ON_CURVED_GROUND = {
    "in a bowl": rnc.RollingBody("body", EGG, ground=BOWL),
    "in a drum, without pivoting": rnc.RollingBody("body", EGG, ground=DRUM, pivoting=False),
    "on a ball": rnc.RollingBody("body", EGG, ground=BALL),
    "on waves": rnc.RollingBody("body", EGG, ground=Waves()),
}
PLATE = rnc.GroundPlane(frame="plate")
BELT = rnc.GroundPlane((0.1, 0.2, 1.0), velocity=(0.2, -0.1, 0.0), frame="plate")
SLANTED = rnc.GroundPlane((0.2, -0.3, 1.0), (0.1, 0.2, 0.3), frame="plate")
TURNING = rnc.GroundPlane((0.2, -0.3, 1.0), (0.1, 0.2, 0.3), spin=-0.7, frame="plate")
CARRIED = {
    "ball on a plate": rnc.RollingBall("body", 0.2, ground=PLATE),
    "ball on a plate that turns": rnc.RollingBall("body", 0.2, ground=TURNING),
    "egg without pivoting": rnc.RollingBody("body", EGG, pivoting=False, ground=TURNING),
    "ball on a belt": rnc.RollingBall("body", 0.2, ground=BELT),
    "slanted egg": rnc.RollingBody("body", EGG, at=(0, 0.01, 0.03), pivoting=False, ground=SLANTED),
    "slanted wheel": rnc.RollingWheel("body", 0.3, "x", ground=SLANTED),
    "wheel on a plate": rnc.RollingWheel("body", 0.2, "y", ground=PLATE),
    "wheel on a plate that turns": rnc.RollingWheel("body", 0.2, "y", ground=TURNING),
    "egg in a bowl": rnc.RollingBody("body", EGG, ground=rnc.SphericalGround(2.0, (0, 0, 1.9), frame="plate")),
    "ball on a ball": rnc.RollingBall("body", 0.2, ground=rnc.SphericalGround(0.5, inside=False, frame="plate")),
    "caster on a plate": rnc.Caster("body", 0.2, ground=PLATE),
    "knife edge on a plate": rnc.NoSideSlip("body", "y", ground=PLATE),
    "knife edge beside its frame": rnc.NoSideSlip("body", (0.9, 0.3, -0.2), at=(0.1, -0.2, 0.3), ground=PLATE),
    "knife edge on a plate that turns": rnc.NoSideSlip("body", "z", ground=TURNING),
}
OFFSETS = {"offset_a": BESIDE, "offset_b": (0.0, 0.1, -0.4)}
OF_TWO_WHEELS = {
    "mecanum": rnc.RollingWheel("front", 0.3, roller=-np.pi / 4),
    "omni": rnc.RollingWheel("rear", 0.3, roller=0.0),
    "skid": rnc.RollingWheel("front", 0.3, lateral=False),
    "side slip x": rnc.NoSideSlip("front", "x", at=BESIDE),
    "side slip y": rnc.NoSideSlip("front", "y", at=BESIDE),
    "side slip z": rnc.NoSideSlip("frame", "z", at=BESIDE),
    "caster of a wheel": rnc.Caster("front", 0.05),
    "points": rnc.LoopClosure("rear", "front", "point", **OFFSETS),
    "frames": rnc.LoopClosure("rear", "front", "frame", **OFFSETS, rpy=(0.3, -0.5, 1.1)),
    "point of the world": rnc.LoopClosure("universe", "front", "point", BESIDE),
    "frame of the world": rnc.LoopClosure("front", "universe", "frame", BESIDE),
    "ball of a wheel": rnc.RollingBall("front", 0.3),
    "gear": rnc.JointCoupling("front_wheel", "rear_wheel", 0.5),
    "fixed joint": rnc.FixedOutput(rnc.JointPosition("steer"), 0.2),
    "fixed distance": rnc.FixedOutput(rnc.Distance("rear", "front"), 1.1),
    "fixed orientation": rnc.FixedOutput(rnc.FrameOrientation("front"), (0.1, -0.4, 0.3)),
    "joint": rnc.JointPosition("steer"),
    "position": rnc.FramePosition("front", "zx"),
    "orientation": rnc.FrameOrientation("front"),
    "speed": rnc.FrameSpeed("front", "y"),
    **{f"tilt {axis}": rnc.FrameTilt("front", axis) for axis in "xyz"},
    **{f"yaw {axis}": rnc.FrameYaw("front", axis) for axis in "xyz"},
    **{f"angular velocity {axis}": rnc.FrameAngularVelocity("front", axis) for axis in "xyz"},
    "angular velocity in the world": rnc.FrameAngularVelocity("front", "z", axes="world"),
    "distance": rnc.Distance("rear", "front"),
}
OF_A_CAR = {
    "ackermann": rnc.AckermannSteering("left_steer", "right_steer", "bl"),
    "ackermann the other way": rnc.AckermannSteering("right_steer", "left_steer", "br", (0.0, 1.0, 0.0)),
}


def floating_arm():
    return rnc.Robot.from_urdf("floating_arm.urdf", base="free", gravity=(0, 0, 0))


OF_AN_ARM = {
    "centre of mass": rnc.CenterOfMass(),
    "no momentum": rnc.MomentumConservation("root_joint"),
    "momentum": rnc.MomentumConservation("root_joint", [0.4, -0.3, 0.2, 0.1, 0.5, -0.2]),
}


@cache
def robots():
    """Robot of each kind of rows, and the kinds."""
    return (
        (rigid_body(), ON_PLANES | ROLLING | ON_CURVED_GROUND),
        (free_bodies("plate", "body"), CARRIED),
        (bicycle().robot, OF_TWO_WHEELS),
        (ackermann_car().robot, OF_A_CAR),
        (floating_arm(), OF_AN_ARM),
    )


def drawn(robot, seed):
    """A configuration near others in which bodies are beside each other and above their ground, and a velocity."""
    generator = np.random.default_rng(seed)
    if robot.joint_names[0] == "plate_root":
        q = pin.integrate(robot.model, robot.configuration(), 0.4 * generator.normal(size=robot.nv))
        q[:3], q[7:10] = (0.1, 0.2, -0.3), (0.3, 0.1, 0.4)
    else:
        q = robot.random_configuration(generator, 1.0)
        if robot.nv == 6:
            q[:3] = 0.1, -0.2, 0.05
    return q, generator.normal(size=robot.nv)
