"""Commands come from a web page: every name and number is checked."""

import json
import math

import pytest

import rnc_pin as rnc
from rnc_pin.applications.drive import commands
from rnc_pin.applications.drive.commands import parse_command
from rnc_pin.applications.drive.controls import DriveControls, DrivenBase, Range

CONTROLS = DriveControls(
    frames={"tip": (True, True, True)}, joints={"elbow": Range(-1.0, 2.0, 0.5, "rad")},
    base=DrivenBase("base", turns=True, slides=False),
)  # fmt: skip
VALID = [
    commands.FrameGoal(frame="tip", position=(1.0, 2.5, -0.1), orientation=(0.0, 0.0, 0.0, 1.0)),
    commands.ReleaseFrame(frame="tip"), commands.JointGoal(joint="elbow", position=2.0),
    commands.BaseVelocity(forward=-1.0, turn=0.5), commands.BaseGoal(x=1.0, y=-2.0), commands.HoldBase(on=True),
    commands.GainSetting(gain="base speed", value=0.3), commands.StopMotion(), commands.EndRun(),
]  # fmt: skip


def test_each_kind_is_read_from_its_message():
    assert {command.kind for command in VALID} == set(commands.KINDS)
    for command in VALID:
        assert parse_command(json.loads(json.dumps({"kind": command.kind, **dict(command)})), CONTROLS) == command


FRAME = {"kind": "frame_goal", "frame": "tip", "position": [0, 0, 0]}
BASE = {"kind": "base_goal", "x": 0, "y": 0}
REFUSED = [
    (["stop"], "no command"),
    ({}, "no command None"),
    ({"kind": "stopp"}, "did you mean 'stop'"),
    ({"kind": ["stop"]}, "no command"),
    ({"kind": "x" * 100_000}, "no command"),
    ({"kind": "stop", "when": 1}, "'when' is not known"),
    ({"kind": "release_frame", "frame": "x" * 100_000}, "at most 200 characters"),
    ({**FRAME, "frame": "tipp"}, "did you mean 'tip'"),
    ({"kind": "frame_goal", "frame": "tip"}, "position: is missing"),
    ({**FRAME, "position": [0, 0]}, "position"),
    ({**FRAME, "position": "here"}, "position"),
    ({**FRAME, "orientation": [0, 0, 0, 0]}, "unit quaternion"),
    ({**BASE, "x": math.nan}, "finite"),
    ({**BASE, "y": -math.inf}, "finite"),
    ({**BASE, "x": 10**400}, "largest magnitude"),
    ({**BASE, "x": True}, "takes no boolean"),
    ({**BASE, "x": "1"}, "a valid number"),
    ({**BASE, "x": 101}, "less than or equal to 100"),
    ({"kind": "joint_goal", "joint": "elbow", "position": 2.01}, "-1 to 2 rad"),
    ({"kind": "joint_goal", "joint": "wrist", "position": 0}, "no joint 'wrist'"),
    ({"kind": "joint_goal", "joint": 1, "position": 0}, "a valid string"),
    ({"kind": "base_velocity", "forward": 1.1, "turn": 0}, "less than or equal to 1"),
    ({"kind": "gain", "gain": "base speed", "value": 0}, "0.02 to 2 m/s"),
    ({"kind": "hold_base", "on": 1}, "a valid boolean"),
]


@pytest.mark.parametrize(("message", "words"), REFUSED, ids=[words for _, words in REFUSED])
def test_anything_else_is_refused_in_one_short_line(message, words):
    with pytest.raises(rnc.RncError, match=words) as refusal:
        parse_command(message, CONTROLS)
    assert len(str(refusal.value)) < 300
    assert "\n" not in str(refusal.value)


def test_a_robot_without_a_base_refuses_its_commands():
    for message in (BASE, {"kind": "hold_base", "on": True}):
        with pytest.raises(rnc.InputError, match="no base"):
            parse_command(message, DriveControls(frames={}, joints={}))
