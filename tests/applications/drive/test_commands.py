"""Commands come from a web page: every name and number is checked."""

import math

import pytest

import rnc_pin as rnc
from rnc_pin.applications.drive.commands import (
    KINDS,
    BaseGoal,
    BaseVelocity,
    EndRun,
    FrameGoal,
    GainSetting,
    HoldBase,
    JointGoal,
    ObstacleGoal,
    ReleaseFrame,
    StopMotion,
    command_entry,
    command_target,
    parse_command,
)
from rnc_pin.applications.drive.controls import DriveControls, DrivenBase, Range

CONTROLS = DriveControls(
    frames={"tip": (True, True, True)},
    joints={"elbow": Range(-1.0, 2.0, 0.5, "rad")},
    base=DrivenBase("base", turns=True, slides=False),
    obstacles={"ball": (0.0, 0.0, 0.0)},
)
VALID = {
    "frame_goal": ({"frame": "tip", "position": [1, 2.5, -0.1], "orientation": [0, 0, 0, 1]},
        FrameGoal("tip", (1.0, 2.5, -0.1), (0.0, 0.0, 0.0, 1.0))),
    "release_frame": ({"frame": "tip"}, ReleaseFrame("tip")),
    "joint_goal": ({"joint": "elbow", "position": 2}, JointGoal("elbow", 2.0)),
    "base_velocity": ({"forward": -1, "turn": 0.5}, BaseVelocity(-1.0, 0.5, 0.0)),
    "base_goal": ({"x": 1, "y": -2, "heading": 3}, BaseGoal(1.0, -2.0, 3.0)),
    "hold_base": ({"on": True}, HoldBase(True)),
    "obstacle_goal": ({"obstacle": "ball", "position": [0, 0, 1]}, ObstacleGoal("ball", (0.0, 0.0, 1.0))),
    "gain": ({"gain": "base speed", "value": 0.3}, GainSetting("base speed", 0.3)),
    "stop": ({}, StopMotion()),
    "end": ({}, EndRun()),
}  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
def test_each_kind_is_read_and_written_without_loss(kind):
    message, command = VALID[kind]
    assert parse_command({"kind": kind, **message}, CONTROLS) == command
    assert parse_command(command_entry(command), CONTROLS) == command


INVALID = {
    "no mapping": (["stop"], "expected|mapping"),
    "no kind": ({}, "no command 'None'"),
    "unknown kind": ({"kind": "stopp"}, "did you mean 'stop'"),
    "kind of another type": ({"kind": ["stop"]}, "no command"),
    "unknown entry": ({"kind": "stop", "when": 1}, "no entry 'when'"),
    "unknown frame": ({"kind": "frame_goal", "frame": "tipp", "position": [0, 0, 0]}, "did you mean 'tip'"),
    "missing": ({"kind": "frame_goal", "frame": "tip"}, "'position' is missing"),
    "two numbers": ({"kind": "frame_goal", "frame": "tip", "position": [0, 0]}, "expected 3 numbers"),
    "text": ({"kind": "frame_goal", "frame": "tip", "position": "here"}, "expected 3 numbers"),
    "NaN": ({"kind": "base_goal", "x": math.nan, "y": 0}, "finite"),
    "infinite": ({"kind": "base_goal", "x": 0, "y": -math.inf}, "finite"),
    "too large for a float": ({"kind": "base_goal", "x": 10**400, "y": 0}, "finite"),
    "a truth value": ({"kind": "base_goal", "x": True, "y": 0}, "expected a finite number, found True"),
    "far away": ({"kind": "base_goal", "x": 101, "y": 0}, "within 100 m"),
    "two headings": ({"kind": "base_goal", "x": 0, "y": 0, "heading": [0, 1]}, "heading: expected a finite number"),
    "many turns": ({"kind": "base_goal", "x": 0, "y": 0, "heading": 7}, "heading: expected an angle"),
    "zero quaternion": (
        {"kind": "frame_goal", "frame": "tip", "position": [0, 0, 0], "orientation": [0, 0, 0, 0]}, "unit quaternion",
    ),
    "beyond a joint's range": ({"kind": "joint_goal", "joint": "elbow", "position": 2.01}, "-1 to 2 rad"),
    "unknown joint": ({"kind": "joint_goal", "joint": "wrist", "position": 0}, "no joint 'wrist'"),
    "a name that is a number": ({"kind": "joint_goal", "joint": 1, "position": 0}, "expected a name"),
    "a share above one": ({"kind": "base_velocity", "forward": 1.1, "turn": 0}, "share of -1 to 1"),
    "a gain below its range": ({"kind": "gain", "gain": "base speed", "value": 0}, "0.02 to 2 m/s"),
    "no switch": ({"kind": "hold_base", "on": 1}, "true or false"),
}  # fmt: skip


def test_a_goal_of_the_base_may_have_no_heading():
    for message in ({"x": 1, "y": -2}, {"x": 1, "y": -2, "heading": None}):
        command = parse_command({"kind": "base_goal", **message}, CONTROLS)
        assert command == BaseGoal(1.0, -2.0)
        assert command_entry(command) == {"kind": "base_goal", "x": 1.0, "y": -2.0}


@pytest.mark.parametrize("case", INVALID)
def test_anything_else_is_refused_in_one_short_line(case):
    message, words = INVALID[case]
    with pytest.raises(rnc.InputError, match=words) as refusal:
        parse_command(message, CONTROLS)
    assert len(str(refusal.value)) < 300
    assert "\n" not in str(refusal.value)


def test_a_long_name_is_not_repeated_whole():
    with pytest.raises(rnc.InputError) as refusal:
        parse_command({"kind": "x" * 100_000}, CONTROLS)
    assert len(str(refusal.value)) < 600


def test_a_robot_without_a_base_refuses_its_commands():
    still = DriveControls(frames={}, joints={})
    for message in ({"kind": "base_goal", "x": 0, "y": 0}, {"kind": "hold_base", "on": True}):
        with pytest.raises(rnc.InputError, match="no base"):
            parse_command(message, still)


def test_the_target_of_a_command_is_its_kind_and_name():
    assert command_target(JointGoal("elbow", 0.0)) == command_target(JointGoal("elbow", 1.0))
    assert command_target(JointGoal("elbow", 0.0)) != command_target(JointGoal("wrist", 0.0))
    assert command_target(StopMotion()) != command_target(EndRun())
