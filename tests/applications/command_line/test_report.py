"""Printed tables: errors of outputs and goals; distances to obstacles apart from those between links."""

import time

import numpy as np
import pytest
from rich.console import Console

import rnc_pin as rnc
from rnc_pin.applications.command_line import messages
from rnc_pin.applications.command_line.report import ProgressBar, print_summary
from rnc_pin.simulation import Clearance, LimitReplay, add_limits


@pytest.fixture
def summary():
    robot = rnc.Robot.from_urdf("unicycle.urdf", base="planar")
    reduced = rnc.NonholonomicSystem(robot, []).reduce()
    run = rnc.free_motion(reduced, robot.configuration(), np.zeros(reduced.r), duration=0.1)
    pairs = (
        Clearance(("elbow", "hand"), 0.001, 0.5, False, constant=True),
        Clearance(("arm", "tool"), 0.0043, 2.0, False),
        Clearance(("base", "rack"), 0.0512, 3.14, True),
    )
    found = rnc.summarize(run)
    add_limits(found, LimitReplay((), pairs, (), run.time, run.q[:, :0], 0.2))
    return found


def test_distances_to_obstacles_are_printed_apart(summary, capsys):
    print_summary(summary)
    printed = " ".join(capsys.readouterr().out.split())
    assert "distance to obstacles, smallest 0.0512 m, base / rack at t = 3.14 s" in printed
    assert "distance between links, smallest 0.0043 m, arm / tool at t = 2.00 s" in printed
    assert "elbow" not in printed
    assert "final error" not in printed  # a free motion has no goals


def test_goals_of_a_program_are_printed_with_their_errors(summary, capsys):
    """The program of a hand on a robot whose outputs are its joints: no output has a reference."""
    print_summary({**summary, "goal_error": {"hand_x": 0.0123}})
    (row,) = [line for line in capsys.readouterr().out.splitlines() if "hand_x" in line]
    assert row.split() == ["│", "hand_x", "│", "1.23e-02", "│", "-", "│", "-", "│"]


@pytest.mark.parametrize("quiet", [False, True])
def test_a_log_gets_a_line_each_minute(quiet, monkeypatch, capsys):
    monkeypatch.setattr(messages, "_MINUTE", 0.02)
    with ProgressBar(Console(stderr=True), 10.0, "driving", quiet) as advance:
        advance(4.0, "driving")
        time.sleep(0.5)
    first, *lines = capsys.readouterr().out.splitlines() or [""]
    assert (first, set(lines)) == (("", set()) if quiet else ("driving ...", {"driving: 40 %, 0 min ..."}))
