"""Trial runs of drafts: errors beside the motion, abilities of a robot of its kind, and efforts of the file."""

import numpy as np
import pytest

import rnc_pin as rnc
from rnc_pin.applications.init import DraftOptions, draft, draft_with_decisions, scenario_candidate, trial
from rnc_pin.applications.init.assumptions import ActuatorCandidates, BaseAssumptions
from rnc_pin.applications.init.trial import Trial, model_findings, run_findings
from rnc_pin.applications.scenario.execution import execute
from rnc_pin.applications.scenario.files import read_yaml
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.verdict import FindingKind, Severity
from urdf_parts import BOX, joint, link, pivot, robot, wheel, write


def drafted(text, folder):
    """(text of the draft in one line, content, its path)."""
    (folder / "robot.urdf").write_text(text)
    path = folder / "robot.yaml"
    path.write_text(draft(str(folder / "robot.urdf"), folder, DraftOptions()))
    return path.read_text().replace("\n# ", " "), read_yaml(path), path


def upright_arm():
    """Two links on top of each other: gravity pulls at no joint where they stand upright."""
    parts = [link("base")]
    for name, parent, height in (("shoulder", "base", 0.1), ("elbow", "shoulder_link", 0.5)):
        parts += [link(f"{name}_link", 2.0, at="0 0 0.25", moment=0.05)]
        parts += [joint(name, parent, f"{name}_link", (0, 0, height), kind="revolute", effort=50, limits=(-2, 2))]
    return robot(*parts, name="arm")


@pytest.fixture
def strict(monkeypatch):
    """A load is not seen, and 2 % of the motion are a miss: the adaptive tracker, which learns the load, has 5 %."""
    monkeypatch.setattr(scenario_candidate.start_values, "is_loaded", lambda *given: False)
    for module in (trial, scenario_candidate):
        monkeypatch.setattr(module, "FAR", 0.02)
    monkeypatch.setattr(trial, "LOST", 0.03)


def test_gravity_is_seen_beside_a_symmetric_pose(tmp_path):
    text, content, _ = drafted(upright_arm(), tmp_path)
    assert content["controller"]["tracker"] == "computed_torque"
    assert "gravity loads the robot" in text
    assert float(text.split("tried for 6 s: the largest error is ")[1].split()[0]) < 1e-3


@pytest.mark.usefixtures("strict")
def test_a_tracker_that_misses_its_reference_gives_way_to_the_next(tmp_path):
    text, content, _ = drafted(upright_arm(), tmp_path)
    assert content["controller"]["tracker"] == "computed_torque"
    assert "does not suit: its run misses its reference" in text


@pytest.mark.usefixtures("strict")
def test_what_remains_of_an_error_is_said(tmp_path, monkeypatch):
    monkeypatch.setattr(scenario_candidate, "_TRACKERS", {"adaptive": scenario_candidate._ADAPTIVE})
    with pytest.warns(rnc.ModelWarning, match="'arm' is drafted, but its run misses its reference: .* is off by"):
        text, _, path = drafted(upright_arm(), tmp_path)
    assert "NOT CONFIRMED: its run misses its reference: elbow is off by" in text
    worst = max(execute(Scenario.load(str(path))).summary["max_error"].values())
    assert float(text.split("error is ")[1].split()[0]) == pytest.approx(worst, rel=0.05)


def car(toe=0.0, rear=100.0, steering=10.0, rear_right=None):
    """A car with rear drive and two steered wheels: toe-in of these [rad], and efforts of its motors [N m]."""
    parts = [link("base", 20, '<box size="0.9 0.3 0.1"/>')]
    for side, sign in (("left", 1), ("right", -1)):
        effort = rear if rear_right is None or side == "left" else rear_right
        parts.append(wheel(f"rear_{side}", "base", (-0.3, 0.25 * sign, 0), effort=effort))
        parts.append(pivot(f"steer_{side}", "base", (0.3, 0.25 * sign, 0), steering))
        parts.append(wheel(f"front_{side}", f"steer_{side}", (0, 0, 0), effort=None, toe=-sign * toe))
    return robot(*parts, name="car")


def cart():
    robot = rnc.Robot.from_urdf("differential_drive.urdf", base="planar")
    wheels = [rnc.RollingWheel("left_wheel", 0.2), rnc.RollingWheel("right_wheel", 0.2)]
    return rnc.NonholonomicSystem(robot, wheels, ["left_wheel_joint", "right_wheel_joint"])


SPEED = {"frame_speed": {"frame": "base", "axis": "x"}}


def rolling(**more):
    return BaseAssumptions("planar", "a cart", "base", outputs=[(SPEED, 0.5)], travel=0.5, **more)


LEFT = ["left_wheel_joint"]


@pytest.mark.parametrize(("chosen", "driven", "more", "expected"), [
    ([SPEED], [], {}, None),
    ([{"joint": "left_wheel_joint"}], [], {}, (FindingKind.GOAL, "base", "lock the base")),
    ([SPEED], LEFT, {"passive": {*LEFT}}, (FindingKind.MODEL, LEFT[0], "takes to be passive are driven")),
    ([SPEED], LEFT, {"passive": {*LEFT}, "without_effort": {*LEFT}}, None),  # a note and a remark say it
])  # fmt: skip
def test_a_base_has_to_have_its_speed_and_its_motors(chosen, driven, more, expected):
    found = model_findings(cart(), rolling(**more), chosen, driven)
    assert len(found) == (expected is not None)
    for each in found:
        assert (each.kind, each.where, each.severity) == (*expected[:2], Severity.FAILS)
        assert expected[2] in each.message


@pytest.mark.parametrize(("radius", "doubts"), [(0.2, 0), (200.0, 1), (0.0002, 1)])
def test_a_file_in_other_units_than_metres_is_doubted(radius, doubts):
    wheels = [({"rolling_wheel": {"frame": f"{side}_wheel", "radius": radius}}, "") for side in ("left", "right")]
    found = model_findings(cart(), rolling(constraints=wheels), [SPEED], ())
    assert len(found) == doubts
    assert all(f"radius of {radius:g} m: lengths in a robot's file are in metres" in each.message for each in found)


def rolled(speed):
    """(Robot, its motion at a speed [m/s] for 2 s)."""
    robot = (system := cart()).robot
    reduced = system.reduce([rnc.FrameSpeed("base"), rnc.FrameYaw("base")])
    return robot, rnc.free_motion(reduced, robot.configuration(), [speed, 0.0], duration=2.0)


def test_the_base_has_to_move():
    (robot, rest), (_, rolls) = rolled(0.0), rolled(0.09)
    asked = 0.5 * (10 * 0.4**3 - 15 * 0.4**4 + 6 * 0.4**5)  # minimum jerk, after 2 of 5 s
    (found,) = run_findings(Trial(2.0), rest, rolling(), robot)
    assert (found.kind, found.severity) == (FindingKind.GOAL, Severity.FAILS)
    assert found.amount == pytest.approx(asked)
    assert run_findings(Trial(2.0), rolls, rolling(), robot) == []
    assert Trial(2.0, findings=(found,)).rank > Trial(2.0, "yaw", 0.4, 1.0).rank


def test_an_error_of_half_the_motion_fails():
    robot, run = rolled(0.1)
    found = [run_findings(Trial(2.0, "yaw", error, 1.0), run, rolling(), robot) for error in (0.1, 0.3, 0.6)]
    assert [[each.severity for each in every] for every in found] == [[], [Severity.DEGRADES], [Severity.FAILS]]


def test_efforts_beyond_the_file_are_said(tmp_path, brief):
    with pytest.warns(rnc.ModelWarning, match="'car' is drafted, but effort of rear_left_joint: .*, limit 1e-06"):
        text, _, path = drafted(car(rear=1e-6), tmp_path)
    said = text.partition("CHECK: effort of rear_left_")[2]
    run = execute(Scenario.load(str(path))).trajectory
    largest = np.abs(run.T[run.time < 0.02 + 1e-9, 0]).max()
    assert float(said.split("joint: ")[1].split()[0]) == pytest.approx(largest, rel=1e-3)
    assert "of the usual motion" not in text


def pendulum(lower, upper, effort, speed=20, center="0.5 0 0"):
    """A rod of 2 kg on a horizontal axle, with its center of mass in a place of the rod [m]."""
    axle = joint("axle", "base", "rod", (0, 0, 0), kind="revolute", effort=effort, limits=(lower, upper))
    axle = axle.replace('velocity="20"', f'velocity="{speed}"')
    return robot(link("base"), link("rod", 2, at=center, moment=0.05), axle)


def test_a_joint_starts_where_its_motor_holds_the_weight(tmp_path):
    """At zero the weight needs 9.81 N m."""
    text, content, path = drafted(pendulum(-0.5, 1.5, effort=5.0), tmp_path)
    assert np.cos(content["initial"]["q"]["axle"]) * 9.81 < 0.8 * 5.0
    assert "start where motors can hold the weight: axle at" in text
    assert execute(Scenario.load(str(path))).trajectory.verdict.succeeded


def test_a_weight_that_no_start_makes_bearable_is_said(tmp_path):
    with pytest.warns(rnc.ModelWarning, match="effort of axle: .* limit 5"):
        text, content, _ = drafted(pendulum(-0.5, 0.5, effort=5.0), tmp_path)
    assert "q" not in content.get("initial", {}) or not content["initial"]["q"]
    assert "CHECK: effort of axle: " in text
    assert "where motors can hold" not in text


@pytest.mark.parametrize(("limited", "share"), [({"speed": 0.01}, (0.1, 0.15)), ({"effort": 6.5}, (0.3, 0.5))])
def test_a_motion_is_reduced_until_it_keeps_the_limits_of_the_file(limited, share, tmp_path):
    """The usual one, 0.2 rad within 5 s, needs 0.075 rad/s, and lifts the rod: from 5.9 to 7.3 N m."""
    text, content, path = drafted(pendulum(-0.5, 1.5, **{"effort": 50.0, **limited}, center="0.3 0 0.4"), tmp_path)
    (step,) = content["reference"]["primary"]["minimum_jerk"]["by"]
    run = execute(Scenario.load(str(path))).trajectory
    assert run.verdict.succeeded
    assert share[0] < step / 0.2 < share[1]
    assert run.q[-1, 0] - run.q[0, 0] == pytest.approx(step, abs=1e-3)
    assert f"with {round(100 * step / 0.2)} % of the usual motion" in text


def test_forces_that_are_rounding_steer_no_wheel():
    """Two wheels push a car; their effect of 2e-32 on its steering is no force."""
    candidates = ActuatorCandidates([("left", ""), ("right", "")], [("steer", ""), ("other", "")], [], [])
    forces = np.array([[10.0, 10.0, 0.0, 0.0], [2e-32, -2e-32, 1.0, 3.0]])
    assert candidates.enough(forces) == [("left", ""), ("right", ""), ("steer", "")]
    assert candidates.enough(forces[:, [0, 1, 0, 0]]) == candidates.sure


DRIVEN = ["rear_left_joint", "rear_right_joint", "steer_left_joint"]


@pytest.mark.parametrize(("efforts", "actuators", "said"), [
    ({"rear": 0}, {*DRIVEN}, "- rear_left_joint  # effort 0 in the file: CHECK its limit"),
    ({"rear_right": 0}, {*DRIVEN} - {"rear_right_joint"},
        "Which wheels are driven? rear_left_joint (80 % sure: effort 0 of rear_right_joint)"),
    ({"rear": 0, "steering": 0}, {*DRIVEN}, "the file states no effort: 0 for every joint"),
], ids=["wheels", "one wheel", "all"])  # fmt: skip
def test_efforts_of_0_leave_a_wheel_idle_if_another_drives_and_are_said(efforts, actuators, said, tmp_path, brief):
    text, content, _ = drafted(car(**efforts), tmp_path)
    assert (len(content["actuators"]), {*content["actuators"]}) == (len(actuators), actuators)
    assert said in text
    assert "nothing drives" not in text or "rear_right" in efforts


def test_of_two_open_answers_the_one_whose_run_keeps_the_limits_is_taken(tmp_path):
    """The axle in front is pushed: a free joint folds beyond its limit, a driven one steers."""
    parts = [link("rear", 20.0, BOX), wheel("rl", "rear", (-0.3, 0.3, 0)), wheel("rr", "rear", (-0.3, -0.3, 0))]
    parts += [link("front", 20.0, BOX, at="0.4 0 0")]
    parts += [joint("waist", "rear", "front", (0.1, 0, 0), "0 0 1", "revolute", 200.0, (-0.6, 0.6))]
    parts += [wheel("fl", "front", (0.5, 0.3, 0)), wheel("fr", "front", (0.5, -0.3, 0))]
    found = draft_with_decisions(str(write(tmp_path / "unit.urdf", robot(*parts))), tmp_path)
    assert "# base planar: 4 wheels, steered like a car\n" in found.text
    taken = next(each for each in found.decisions if each.question == "Is waist a free hitch?")
    assert (taken.answer, taken.is_open) == ("no, it is driven and steers", False)
    assert taken.evidence.startswith("with the answer 'yes', its run has position of waist")


def test_a_scenario_is_no_robot_and_another_file_of_xml_no_scenario(tmp_path):
    scenario, robot = tmp_path / "made.yaml", tmp_path / "model.sdf"
    scenario.write_text("robot: {urdf: car.urdf}\n")
    robot.write_text('<?xml version="1.0"?>\n<sdf version="1.7"/>\n')
    with pytest.raises(rnc.ModelError, match=r"that is a scenario, not a robot: run it with: rnc-pin run .*made\.yaml"):
        draft(str(scenario), tmp_path)
    with pytest.raises(rnc.ConfigurationError, match=r"found XML: if this is a URDF, .* draft one with: rnc-pin init"):
        read_yaml(robot)
