"""The queue of a page, and commands.json."""

import json

import pytest

import rnc_pin as rnc
from rnc_pin.applications.drive.commands import (
    CommandLog,
    EndRun,
    JointGoal,
    LoggedCommand,
    RecordedDrive,
    StopMotion,
    ends,
    log_entries,
    read_drive,
    write_drive,
)
from rnc_pin.applications.drive.controls import DriveControls, Range
from rnc_pin.applications.drive.run import CommandQueue

CONTROLS = DriveControls(frames={}, joints={f"j{k}": Range(-1.0, 1.0, 0.0) for k in range(300)})


def moved(joint, position):
    return {"kind": "joint_goal", "joint": joint, "position": position}


def test_only_the_latest_command_for_a_target_waits():
    queue = CommandQueue(CONTROLS)
    for k in range(1000):
        assert queue.put(moved("j1", k / 1000))
    assert queue.put({"kind": "stop"})
    assert queue.put(moved("j1", 0.5))
    assert queue.take() == [StopMotion(), JointGoal(joint="j1", position=0.5)]  # in the order of the last messages
    assert queue.take() == []


def test_the_queue_is_bounded_and_says_what_it_refuses():
    queue = CommandQueue(CONTROLS)
    accepted = [queue.put(moved(f"j{k}", 0.0)) for k in range(300)]
    assert sum(accepted) == 200 == len(queue.take())
    assert queue.refused == "too many commands in one sample"
    assert not queue.put(moved("j1", 7.0))
    assert queue.refused.startswith("joint 'j1': expected -1 to 1")
    assert queue.put(moved("j1", 0.7))
    assert queue.refused == ""


def test_commands_are_due_once_at_their_sample():
    log = CommandLog([LoggedCommand(3, StopMotion()), LoggedCommand(5, JointGoal(joint="j0", position=0.1))])
    assert (log.due(0, 2), log.due(0, 4)) == ([], [StopMotion()])
    assert (log.due(1, 5), log.due(2, 9)) == ([JointGoal(joint="j0", position=0.1)], [])
    assert ends([StopMotion(), EndRun()])
    assert not ends([StopMotion()])


def record(**changed):
    log = CommandLog([LoggedCommand(3, JointGoal(joint="j1", position=0.1 + 0.2)), LoggedCommand(7, EndRun())])
    content = {
        "scenario": "s", "config": {"robot": {}}, "folder": None, "frames": ["tip"], "samples": 10,
        "versions": {"numpy": "2"}, "commands": log_entries(log, 0.01),
    }  # fmt: skip
    return RecordedDrive(**{**content, **changed}), log


def test_a_record_is_read_back_with_all_digits(tmp_path):
    written, log = record()
    write_drive(written, tmp_path / "commands.json")
    found = read_drive(tmp_path / "commands.json")
    assert (found, found.log(CONTROLS).commands, found.commands[0]["time"]) == (written, log.commands, 0.03)


REFUSED = [
    ("{", "not JSON"),
    ("[]", "expected a mapping"),
    ("[" * 100_000, "not JSON"),
    (None, "cannot be read"),
    ({"format": "other"}, "format: expected 'rnc_pin commands 1'"),
    ({"samples": "10"}, "samples: expected a valid integer"),
    ({"samples": 1}, "samples: expected greater than or equal to 2"),
    ({"frames": [1]}, "frames"),
    ({"config": []}, "config"),
]


@pytest.mark.parametrize(("change", "words"), REFUSED, ids=[words for _, words in REFUSED])
def test_other_files_are_refused(tmp_path, change, words):
    write_drive(record()[0], path := tmp_path / "c.json")
    if change is None:
        path.unlink()
    else:
        text = json.dumps({**json.loads(path.read_text()), **change}) if isinstance(change, dict) else change
        path.write_text(text)
    with pytest.raises(rnc.ConfigurationError, match=words):
        read_drive(path)


@pytest.mark.parametrize(("entries", "words"), [
    ([{"kind": "stop"}], "sample"),
    ([{"sample": True, "kind": "stop"}], "sample"),
    ([{"sample": -1, "kind": "stop"}], "sample"),
    ([{"sample": 1, **moved("j1", 3.0)}], "expected -1 to 1"),
    ([{"sample": 5, "kind": "stop"}, {"sample": 4, "kind": "stop"}], "at least 5"),
])  # fmt: skip
def test_an_invalid_command_of_a_file_is_named_by_its_number(entries, words):
    broken, _ = record(commands=entries)
    with pytest.raises(rnc.ConfigurationError, match=rf"commands\[{len(entries) - 1}\]: .*{words}"):
        broken.log(CONTROLS)
