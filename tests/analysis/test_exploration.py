"""Uses of redundancy beside a projection by NumPy, and beside the classes of all partitions."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import assume, given, settings

import rnc_pin as rnc
from random_systems import recipes, reduced_of
from rnc_pin.analysis import classify
from rnc_pin.analysis.exploration import default_candidates, tip_frames, tip_positions
from rnc_pin.outputs import velocity_outputs
from systems import fire_truck, mobile_manipulator, space_robot
from urdf_parts import joint, link, read


def hub(folder, arms, links, base):
    """Hub in the plane with arms of equal links, on a pivot or free."""
    turns = {"axis": "0 0 1", "kind": "revolute", "limits": (-3, 3)}
    parts = [link("hub", 5, moment=5)]
    if base == "fixed":
        parts += ['<link name="world"/>', joint("pivot", "world", "hub", **turns)]
    for arm in range(arms):
        before = "hub"
        for k in range(links):
            name, place = f"{'left' if arm == 0 else 'right'}_{k + 1}", (1 if k else 0.3, 0, 0)
            parts += [link(name, at="0.5 0 0", moment=1), joint(f"{name}_joint", before, name, place, **turns)]
            before = name
        hand = f"{before}_hand"
        parts += [f'<link name="{hand}"/>', joint(f"{before}_end", before, hand, (1, 0, 0), kind="fixed")]
    robot = read(folder / "hub.urdf", *parts, base=base)
    conserved = rnc.MomentumConservation("pivot" if base == "fixed" else "root_joint")
    driven = [name for name in robot.joint_names if name not in ("pivot", "root_joint")]
    return rnc.NonholonomicSystem(robot, [conserved], driven).reduce()


def use_of(found, *names):
    return next(each for each in found.rows if set(each.vertical) == set(names))


def test_a_hand_is_the_end_of_a_chain_in_place_of_its_fingers():
    assert tip_frames(rnc.NonholonomicSystem(rnc.Robot.from_example("panda"), []).reduce()) == ("panda_hand_tcp",)


def test_a_hub_with_four_links_turns_while_its_hand_rests(tmp_path):
    found = rnc.explore(hub(tmp_path, 1, 4, "fixed"), [rnc.FramePosition("left_4_hand", "xy")])
    use = use_of(found, "pivot")
    assert (use.redundancy_class, use.rank, found.motions, len(use.redundant)) == ("1", 1, 2, 2)
    assert found.rows[0].redundancy_class == "1"


def test_a_second_arm_turns_a_free_hub_and_the_centre_of_mass_is_conserved(tmp_path):
    found = rnc.explore(hub(tmp_path, 2, 2, "planar"), [rnc.FramePosition("left_2_hand", "xy")])
    assert found.motions == 2
    hand = use_of(found, "right_2_hand_x", "right_2_hand_y")
    assert (use_of(found, "hub_yaw").redundancy_class, hand.redundancy_class, hand.rank) == ("1", "1", 2)
    center = use_of(found, "center_of_mass_x", "center_of_mass_y")
    assert center.redundancy_class is None
    assert "no motion of the robot changes" in center.reason
    np.testing.assert_allclose(center.singular_values, 0.0, atol=1e-9)


def test_a_distance_along_an_arm_is_lost_where_the_arm_is_straight(tmp_path):
    reduced = hub(tmp_path, 1, 2, "fixed")
    along, primary = [rnc.Distance("left_1", "left_2_hand")], [rnc.JointPosition("pivot")]
    (use,) = rnc.explore(reduced, primary, along).rows
    assert use.straight == ("left_2_joint",)
    assert "with pivot at rest, left_2_joint, left_1_joint can move distance_left_1_left_2_hand" in use.reason
    assert "lost where left_2_joint is straight" in use.reason
    (bent,) = rnc.explore(reduced, primary, along, region={"left_2_joint": (0.5, 1.0)}).rows
    assert bent.singular_share == 0.0
    assert 0.5 <= reduced.robot.joint_values(bent.singular_at)["left_2_joint"] <= 1.0


def test_a_free_base_under_gravity_has_yaw_and_tilt_and_a_steered_axle_is_no_end_of_a_chain():
    robot = rnc.Robot.from_example("hyq_no_sensors", base="free")
    outputs = [name for group in default_candidates(rnc.NonholonomicSystem(robot).reduce()) for name in group]
    assert {rnc.FrameYaw("base_link"), rnc.FrameTilt("base_link", "x"), rnc.FrameTilt("base_link", "y")} <= {*outputs}
    assert tip_positions(fire_truck()) == [rnc.FramePosition("trailer", "xy")]


def test_ends_of_chains_need_one_regular_configuration_only(monkeypatch):
    reduced = space_robot()
    straight, good = reduced.robot.configuration(), reduced.random_configuration(np.random.default_rng(1))
    drawn = iter([straight, good, good, good])
    with pytest.raises(rnc.SingularityError):
        _ = reduced.at(straight).R
    monkeypatch.setattr(type(reduced), "random_configuration", lambda *_: next(drawn))
    assert tip_positions(reduced) == [rnc.FramePosition("tip", "xy")]


@pytest.mark.parametrize("more", [[], [{"force": {"frame": "board", "axis": "x"}}]], ids=["joints", "force"])
def test_the_free_motion_of_a_snakeboard_is_its_speed_and_a_use_only_with_a_force(more):
    joints = ["rotor", "front_steering", "back_steering"]
    reduced = rnc.Scenario.load("snakeboard", {"actuators": [*joints, *more]}).reduced
    use = rnc.explore(reduced, joints, ["board_yaw"]).rows[0]
    assert (use.redundancy_class, use.redundant, use.driven) == ("1", ("board_speed_x",), bool(more))


@pytest.mark.parametrize("base", ["planar", "free"])
def test_entries_of_v_are_joints_and_speeds_of_free_bodies(base):
    robot = rnc.Robot.from_example("hyq_no_sensors", base=base)
    reduced = rnc.NonholonomicSystem(robot).reduce([*velocity_outputs(robot).values()])
    q = reduced.random_configuration(np.random.default_rng(0))
    np.testing.assert_allclose(reduced.at(q).J2, np.eye(robot.nv), atol=1e-12)


BASE = rnc.FramePosition("base", "xy")


@pytest.mark.parametrize(("system", "primary", "vertical", "expected"), [
    (space_robot, ["tip_x", "tip_y"], ["platform"], "1"),
    (mobile_manipulator, [rnc.FramePosition("tip", "xy"), "base_yaw"], [rnc.Distance("base", "tip")], "1"),
    (mobile_manipulator, [rnc.FramePosition("tip", "xy")], [BASE, rnc.FrameYaw("base")], "3"),
    (fire_truck, ["tractor_speed_x", "front_steering"], [rnc.JointPosition("hitch")], "2s"),
])  # fmt: skip
def test_the_systems_of_the_paper_have_their_classes(system, primary, vertical, expected):
    reduced = system()
    blocks = [place.block for place in reduced.all_constraints.places]
    kinds = [block.kind for block in blocks]
    assert [each.redundancy_class for each in rnc.explore(reduced, primary, [vertical]).rows] == [expected]
    assert [block.kind for block in blocks] == kinds


@settings(max_examples=20, deadline=None, derandomize=True)
@given(recipes())
def test_motions_are_those_of_a_projection(recipe):
    """``D D^T`` by the projection of scaled velocities onto the null space of all rows."""
    try:
        reduced = reduced_of(recipe)
        robot = reduced.robot
        joints = [name for name in robot.joint_names if robot.model.joints[robot.joint_id(name)].nv == 1]
        assume(len(joints) > 1 and not reduced.affine)
        outputs = [rnc.JointPosition(name) for name in joints]
        found = rnc.explore(reduced, outputs[:1], outputs[1:], 1)
    except (rnc.ConfigurationError, rnc.ConstraintError, rnc.SingularityError):
        assume(False)
    angles = [unit.startswith("rad") for unit in robot.velocity_units]
    lengths, unit = np.where(angles, found.length, 1.0), np.eye(robot.nv)
    for use in found.rows:
        if len(use.vertical) > 1:
            continue
        rows = np.vstack([reduced.at(use.singular_at).A, unit[robot.velocity_indices(joints[0])]]) / lengths
        projection = np.eye(robot.nv) - np.linalg.pinv(rows, rcond=1e-12) @ rows
        k = robot.velocity_indices(use.vertical[0]).start
        np.testing.assert_allclose(use.singular_values[0] ** 2, projection[k, k], atol=1e-10)


@pytest.mark.parametrize("system", [space_robot, mobile_manipulator, fire_truck])
def test_classes_are_those_of_the_best_partition(system):
    """Every choice of redundant outputs among the reducing ones, by ``classify``."""
    reduced = system()
    names = reduced.reducing.names
    q = np.stack([reduced.random_configuration(np.random.default_rng(k)) for k in range(8)])
    for size in range(1, reduced.r):
        for redundant in combinations(names, size):
            primary = [name for name in names if name not in redundant]
            by_partition = classify(reduced, rnc.Task.of(reduced, primary, list(redundant)), q).redundancy_class
            (use,) = rnc.explore(reduced, primary, [list(reduced.vertical.names)], 16).rows
            assert use.redundancy_class in (by_partition, "3" if by_partition is None else by_partition), redundant


@pytest.mark.parametrize(("primary", "samples", "error", "words"), [
    (["tipp_x"], 4, rnc.ConfigurationError, "no output 'tipp_x'; did you mean 'tip_x'"),
    ([], 4, rnc.ConfigurationError, "primary outputs: expected at least one"),
    (["platform", "tip_x", "tip_y", "joint_1"], 4, rnc.ConfigurationError, "cannot move them independently"),
    (["tip_x"], 0, rnc.InputError, "samples: expected an integer of at least 1, found 0"),
])  # fmt: skip
def test_refusals(primary, samples, error, words):
    with pytest.raises(error, match=words):
        rnc.explore(space_robot(), primary, samples=samples)
    with pytest.raises(rnc.InputError, match=r"region: joint 'joint_1': expected \(smallest, largest\)"):
        rnc.explore(space_robot(), ["tip_x"], region={"joint_1": (1.0, 0.0)})
