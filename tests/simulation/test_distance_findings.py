"""Findings about distances: a run through an obstacle, and thresholds on both sides."""

from dataclasses import replace

import coal
import numpy as np
import pytest

import rnc_pin as rnc
from carts import WHEELS, cart_with_arm
from rnc_pin.collision import Obstacle, OmittedPair, ground_shape
from rnc_pin.simulation import Clearance, LimitReplay, distance_findings, replay_limits
from rnc_pin.verdict import FindingKind, Severity


def replay_of(*clearances, omitted=()):
    time = np.array([0.0, 1.0])
    return LimitReplay((), clearances, omitted, time, np.zeros((2, 0)), 0.2, 1e-3)


def test_a_run_along_a_rack_over_a_floor(tmp_path):
    """The outer face of the left wheel is at y = 0.22 m; the rack begins at y = 0.2 m, and at x = 1 m."""
    robot = cart_with_arm(tmp_path)
    reduced = rnc.NonholonomicSystem(robot, []).reduce()
    run = rnc.free_motion(reduced, robot.configuration(), np.zeros(reduced.r), duration=2.0, dt=1.0)
    q = np.array([robot.configuration({"shoulder": -1.5})] * 3)  # the arm is up
    q[:, 0] = [0.0, 1.0, 2.0]
    floor = Obstacle(ground_shape(), name="floor", ignored_links=WHEELS)
    rack = Obstacle(coal.Box(1.0, 0.2, 0.6), position=(1.5, 0.3, 0.3), name="rack")
    replay = replay_limits(robot, replace(run, q=q), [floor, rack], within=0.2)
    hit, near = distance_findings(replay, clearance=0.06)
    assert (hit.kind, hit.where) == (FindingKind.COLLISION, "wheel_left / rack")
    assert hit.amount == pytest.approx(0.02, abs=1e-5)
    assert 0.9 < hit.time <= 2.0
    assert (near.kind, near.where) == (FindingKind.CLEARANCE, "cart / rack")
    assert near.amount == pytest.approx(0.01, abs=1e-5)


def test_thresholds():
    touching = Clearance(("a", "b"), -0.9e-6, 0.5, True)
    deep = Clearance(("a", "b"), -1.1e-6, 0.5, True)
    assert distance_findings(replay_of(touching)) == []
    (found,) = distance_findings(replay_of(deep))
    assert (found.kind, found.severity, found.amount, found.time) == ("collision", "fails", 1.1e-6, 0.5)
    near, nearer = (Clearance(("a", "b"), 0.1 - short, 0.5, True) for short in (0.9e-4, 1.1e-4))
    assert distance_findings(replay_of(near), 0.1) == []
    (found,) = distance_findings(replay_of(nearer), 0.1)
    assert (found.kind, found.severity) == ("clearance", "fails")
    assert found.amount == pytest.approx(1.1e-4)
    assert distance_findings(replay_of(nearer)) == []


def test_words():
    base = ("base", "rack")
    assert [str(each) for each in distance_findings(replay_of(Clearance(base, -0.29, 3.1, True)), 0.1)] == [
        "base and rack penetrate each other by 0.29 m at t = 3.1 s"
    ]
    assert [str(each) for each in distance_findings(replay_of(Clearance(base, 0.04, 3.1, True)), 0.1)] == [
        "base comes within 0.04 m of rack at t = 3.1 s, 0.1 m was asked for"
    ]


def test_a_pair_has_one_finding_with_its_deepest_value():
    """Two shapes of one link."""
    both = [Clearance(("base", "rack"), distance, t, True) for distance, t in ((-0.2, 1.0), (-0.1, 2.0))]
    (found,) = distance_findings(replay_of(*both, Clearance(("base", "rack"), 0.01, 0.0, True)), 0.1)
    assert (found.amount, found.time, found.where, found.unit) == (0.2, 1.0, "base / rack", "m")


def test_links_of_the_robot_have_no_clearance_but_may_not_collide():
    wrist = Clearance(("arm_5", "tool"), 0.004, 1.0, False)
    assert distance_findings(replay_of(wrist), 0.1) == []
    (found,) = distance_findings(replay_of(wrist._replace(distance=-0.004)), 0.1)
    assert found.kind is FindingKind.COLLISION


def test_overlaps_at_the_start_are_notes_and_fast_motions_degrade():
    omitted = (OmittedPair(("torso", "arm_1"), "overlap by 0.0115 m at the reference configuration", 0.0115),)
    fast = Clearance(("arm", "wall"), 0.15, 1.0, True, False, True)
    found = distance_findings(replay_of(fast, omitted=omitted))
    assert [each.severity for each in found] == [Severity.DEGRADES, Severity.NOTE]
    assert str(found[1]) == "torso and arm_1 overlap by 0.0115 m at the start: they are not checked"
    assert "arm / wall is not certain" in str(found[0])


def test_a_clearance_that_the_replay_cannot_know_is_refused():
    with pytest.raises(rnc.InputError, match=r"clearance is 0.3 m, but the replay knows distances up to 0.2 m"):
        distance_findings(replay_of(), 0.3)
