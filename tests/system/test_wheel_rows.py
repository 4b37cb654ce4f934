"""Rows that published robots need: rollers, skidding wheels, casters, points beside frames, the steering of a car."""

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
import systems
from bodies import add_body, add_frame
from refusals import refused
from rnc_pin.model.kinematics import Kinematics
from row_kinds import BESIDE, OF_TWO_WHEELS
from systems import WHEEL
from tolerances import ROUNDING
from urdf_parts import joint, link, read


@pytest.mark.parametrize("name", ["mecanum", "omni", "skid", "side slip x", "side slip y", "caster of a wheel"])
def test_rows_are_drawn_where_they_act(name, generator):
    """The velocity of the material point at the line of action, along it, is what the row forbids."""
    kind, robot = OF_TWO_WHEELS[name], systems.bicycle().robot
    rows, kinematics = kind.bind(robot), Kinematics(robot)
    frame = robot.frame_id(kind.frame)
    for _ in range(3):
        q = robot.random_configuration(generator, 1.0)
        motion = kinematics.position(q).with_velocity(generator.normal(size=robot.nv))
        points, directions = rows.lines_of_action(motion)
        velocity, centre = motion.velocity(frame), motion.placement(frame).translation
        moved = velocity[:3] + np.cross(velocity[3:], points - centre)
        found, expected = rows.jacobian(motion) @ motion.v, np.sum(directions * moved, axis=1)
        if name == "caster of a wheel":  # a ball that glides: only the velocity of its centre counts
            expected = velocity[2:3]
        np.testing.assert_allclose(found, expected, atol=ROUNDING)
        np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0, atol=ROUNDING)


def test_three_omni_wheels_turn_as_they_are_pushed_along_their_headings():
    """The textbook's matrix of a kiwi drive: radius * rate = heading . v + distance * yaw rate."""
    model, distance = systems.rolling_base({}, WHEEL), 0.2
    angles = np.array([0.0, 2.0, -2.2])
    for k, angle in enumerate(angles):
        # The axle points outwards, so a wheel at angle a heads along (sin a, -cos a).
        out = pin.SE3(pin.utils.rotate("z", angle - np.pi / 2), distance * np.array([np.cos(angle), np.sin(angle), 0]))
        systems.add_wheel(model, 1, f"wheel_{k}", out, WHEEL)
    wheels = [rnc.RollingWheel(f"wheel_{k}", WHEEL, roller=0) for k in range(3)]
    spins = [f"wheel_{k}_spin" for k in range(3)]
    reduced = rnc.NonholonomicSystem(rnc.Robot(model), wheels, spins).reduce([*map(rnc.JointPosition, spins)])
    q = reduced.robot.configuration({"root_joint": [0.4, -0.1, 0.6]})
    rates = np.array([1.0, -2.0, 0.5])
    base = reduced.at(q, rates).v[:3]
    headings = np.stack([np.sin(angles), -np.cos(angles), np.full(3, -distance)], axis=1)
    np.testing.assert_allclose(headings @ base, WHEEL * rates, atol=ROUNDING)


def wheels_about(folder, base, **axes):
    """A body with wheels on continuous joints about any axes: frames and joints of their names."""
    parts = [link("base"), *map(link, axes)]
    for name, axis in axes.items():
        along = " ".join(map(str, axis))
        parts.append(joint(f"{name}_spin", "base", name, (0.3, 0.2, 0), along, rpy="0.2 0 0"))
    return read(folder / "wheels.urdf", *parts, base=base)


@pytest.mark.parametrize("roller", [0.6, -1.5])
def test_turning_the_axle_round_does_not_turn_the_roller(roller, tmp_path):
    robot = wheels_about(tmp_path, "planar", up=(0, 1, 0), down=(0, -1, 0))
    wheels = [rnc.RollingWheel(name, WHEEL, roller=roller) for name in ("up", "down")]
    q = robot.configuration({"root_joint": [0.2, 0.1, 0.7], "up_spin": 0.4, "down_spin": 1.4})
    rows = {wheel.frame: wheel.bind(robot).jacobian(Kinematics(robot).position(q))[0] for wheel in wheels}
    np.testing.assert_allclose(rows["up"][:3], -rows["down"][:3], atol=ROUNDING)  # a row for the other heading
    rates = [rows[name][robot.velocity_indices(f"{name}_spin")] for name in ("up", "down")]
    np.testing.assert_allclose(*rates, atol=ROUNDING)


@pytest.mark.parametrize("axis", [(0.0, -1.0, 0.0), (0.6, 0.8, 0.0), (-0.48, 0.6, 0.64)])
def test_a_wheel_rolls_about_an_axis_in_any_direction(axis, tmp_path):
    """A continuous joint about a skew axis: the contact is where the lowest point of such a disk is, and rests."""
    robot = wheels_about(tmp_path, "free", wheel=axis)
    rows, kinematics = rnc.RollingWheel("wheel", WHEEL).bind(robot), Kinematics(robot)
    generator, frame = np.random.default_rng(1), robot.frame_id("wheel")
    for _ in range(3):
        q = robot.random_configuration(generator, 1.0)
        motion = kinematics.position(q).with_velocity(generator.normal(size=robot.nv))
        axle = motion.placement(frame).rotation @ np.array(axis)
        down = np.array([0.0, 0.0, -1.0]) + axle[2] * axle
        arm = WHEEL * down / np.linalg.norm(down)
        velocity = motion.velocity(frame)
        contact = velocity[:3] + np.cross(velocity[3:], arm)
        ahead = np.cross(axle, [0.0, 0.0, 1.0])
        ahead /= np.linalg.norm(ahead)
        expected = [ahead @ contact, np.cross([0.0, 0.0, 1.0], ahead) @ contact, contact[2]]
        np.testing.assert_allclose(rows.jacobian(motion) @ motion.v, expected, atol=ROUNDING)


def with_frames(robot, frames):
    """The robot with more frames: name to the frame on which it sits and where."""
    model = robot.model.copy()
    for name, (on, placement) in frames.items():
        carrier = model.frames[model.getFrameId(on)]
        add_frame(model, name, carrier.parentJoint, carrier.placement * placement)
    return rnc.Robot(model)


def test_a_point_beside_a_frame_is_as_a_frame_there():
    turned = (0.3, -0.5, 1.1)
    back = pin.rpy.rpyToMatrix(np.array(turned)).T
    frames = {"a": ("rear", pin.SE3(np.eye(3), np.array(BESIDE)))}
    place, turns = np.array([0.0, 0.1, -0.4]), {"b": np.eye(3), "b_turned": back}
    frames |= {name: ("front", pin.SE3(R, place)) for name, R in turns.items()}
    robot = with_frames(systems.bicycle().robot, frames)
    offsets = {"offset_a": BESIDE, "offset_b": (0.0, 0.1, -0.4)}
    pairs = [
        (rnc.NoSideSlip("rear", "z", at=BESIDE), rnc.NoSideSlip("a", "z")),
        (rnc.LoopClosure("rear", "front", "point", **offsets), rnc.LoopClosure("a", "b", "point")),
        (rnc.LoopClosure("rear", "front", "frame", **offsets, rpy=turned), rnc.LoopClosure("a", "b_turned")),
    ]
    assert pairs[0][0].bind(robot).names == ("no_side_slip(rear[0.1 -0.2 0.3].z)",)
    generator, kinematics = np.random.default_rng(2), Kinematics(robot)
    for _ in range(3):
        q, v = robot.random_configuration(generator, 1.0), generator.normal(size=robot.nv)
        rates = kinematics.position(q).with_velocity(v)
        for pair in pairs:
            ours, theirs = (each.bind(robot) for each in pair)
            for method in ("jacobian", "jacobian_dot", "bias_acceleration", "residual"):
                expected = getattr(theirs, method)(rates)
                np.testing.assert_allclose(getattr(ours, method)(rates), expected, atol=ROUNDING)


test_what_makes_no_sense_is_refused = refused([
    (rnc.LoopClosure("rear", "front", "point", (0, 1)), rnc.ConfigurationError,
        "point on frame 'rear': expected three"),
    (rnc.LoopClosure("rear", "front", rpy=(0, np.nan, 1)), rnc.ConfigurationError, "rpy of the loop of 'rear' and"),
    (rnc.NoSideSlip("frame", at=(0, 1)), rnc.ConfigurationError, "expected three finite numbers, found"),
    (rnc.NoSideSlip("fram", at=(0, 1, 0)), rnc.ModelError, "did you mean 'frame'"),
    (rnc.Caster("frame", -0.1), rnc.ConstraintError, "radius of caster 'frame' has to be zero or positive, found -0.1"),
    (rnc.Caster("fram", 0.1), rnc.ModelError, "did you mean 'frame'"),
    (rnc.RollingWheel("rear", 0.3, roller=1.6), rnc.ConstraintError, "roller of wheel 'rear' has to point less than"),
    (rnc.RollingWheel("rear", 0.3, roller=45), rnc.ConstraintError, "found 45 rad .* 0.7854 or -0.7854"),
    (rnc.RollingWheel("rear", 0.3, roller=np.nan), rnc.ConstraintError, "found nan rad"),
    (rnc.RollingWheel("rear", 0.3, roller=0, lateral=False), rnc.ConfigurationError, "omit one of them"),
], lambda kind: kind.bind(systems.bicycle().robot))  # fmt: skip


@pytest.mark.parametrize("axis", [None, "y"])
@pytest.mark.parametrize("first", ["left", "right"])
def test_the_linkage_as_a_coupler_has_its_angle_and_slope(first, axis):
    """``cot(r) - cot(l) = w / L``, so ``dl / dr = sin(l)^2 / sin(r)^2``; the right axis points down."""
    joints = ("left_steer", "right_steer") if first == "left" else ("right_steer", "left_steer")
    (coupler,) = rnc.AckermannSteering(*joints, "bl", axis=axis).bind(systems.ackermann_robot()).mechanisms()
    assert (coupler.joint, coupler.driver, coupler.period) == (*joints, np.pi)
    sign, k = (1.0 if first == "left" else -1.0), systems.TRACK / systems.WHEELBASE
    for position in (-0.9, -0.2, 0.3, 0.8):
        angle, slope = coupler.function(position)
        # To the left: the joint that leads turns by -sign * position, the one that follows by sign * angle.
        driver, follower = -sign * position, sign * angle
        left, right = (follower, driver) if first == "left" else (driver, follower)
        assert 1 / np.tan(right) - 1 / np.tan(left) == pytest.approx(k, rel=1e-12)
        assert slope == pytest.approx(-((np.sin(follower) / np.sin(driver)) ** 2), rel=1e-12)


@pytest.mark.parametrize(("joints", "error", "words"), [
    (("left_steer", "leaning", "bl"), rnc.ConstraintError, r"'leaning' turns about \(0.4, 0, 0.9165\), expected a ver"),
    (("left_steer", "sliding", "bl"), rnc.ConstraintError, "'sliding' slides, expected a vertical axis"),
    (("left_steer", "root_joint", "bl"), rnc.ConstraintError, "'root_joint' has 3 degrees of freedom, expected one"),
    (("left_steer", "left_steer", "bl"), rnc.ConstraintError, "found 0 m and"),
    (("beside", "also_beside", "bl"), rnc.ConstraintError, "have to be above 1e-06 m, found 1.8 m and 0 m"),
    (("left_stear", "right_steer", "bl"), rnc.ModelError, "did you mean 'left_steer'"),
    (("left_steer", "right_steer", "b"), rnc.ModelError, "no frame 'b'"),
])  # fmt: skip
def test_steering_that_is_none_is_refused(joints, error, words):
    model = systems.ackermann_robot().model.copy()
    slanted = pin.JointModelRevoluteUnaligned(np.array([0.4, 0.0, np.sqrt(0.84)]))
    for name, kind, where in (
        ("leaning", slanted, (1.0, 0.3, 0.0)), ("sliding", "PZ", (1.0, 0.3, 0.0)),
        ("beside", "RZ", (0.0, 0.9, 0.0)), ("also_beside", "RZ", (0.0, -0.9, 0.0)),
    ):  # fmt: skip
        add_body(model, name, kind, 1.0, 1, moments=0.01, at=where)
    with pytest.raises(error, match=words):
        rnc.AckermannSteering(*joints).bind(rnc.Robot(model))
