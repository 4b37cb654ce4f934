"""The queue of a page, and the log of its commands."""

from rnc_pin.applications.drive.commands import JointGoal, LoggedCommand, StopMotion, due_commands
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
    assert sum([queue.put(moved(f"j{k}", 0.0)) for k in range(300)]) == 200 == len(queue.take())
    assert queue.refused == "too many commands in one sample"
    assert not queue.put(moved("j1", 7.0))
    assert queue.refused.startswith("joint 'j1': expected -1 to 1")
    assert queue.put(moved("j1", 0.7))
    assert queue.refused == ""


def test_commands_are_due_once_at_their_sample():
    goal = JointGoal(joint="j0", position=0.1)
    log = [LoggedCommand(3, StopMotion()), LoggedCommand(5, goal)]
    assert [due_commands(log, *at) for at in ((0, 2), (0, 4), (1, 5), (2, 9))] == [[], [StopMotion()], [goal], []]
