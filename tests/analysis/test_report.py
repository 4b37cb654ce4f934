"""Growth vectors, redundancy classes and the report."""

import dataclasses
import json

import numpy as np
import pytest

import rnc_pin as rnc
from systems import ALL, mobile_manipulator, sleigh
from textbook_systems import planar_model, rail_sliders
from tolerances import ROUNDING


@pytest.mark.parametrize("name", ["four_bar", "mecanum", "tumbling_panda"])
def test_lemma_1_holds_in_the_report_and_it_is_json(name):
    report = rnc.analyze(ALL[name](), samples=4)
    assert report.lemma1_holds
    assert report.lemma1["Hdot - V - V^T"] < 1e-8
    assert report.redundancy.reason == "no redundant output"
    content = json.loads(json.dumps(report.to_dict()))
    assert content["condition"]["min"] <= content["condition"]["median"] <= content["condition"]["max"]
    assert content["actuation_rank"] == content["r"]


def test_lemma_1_is_denied_to_wrong_rates(robot):
    """The residuals can fail: the rate of a constraint becomes wrong after it was checked."""

    def rows(q):
        return np.array([[1.0, np.sin(q[1]), 0.2, 0.1]])

    factor = 1.0
    kind = rnc.Pfaffian(rows, lambda q, v: factor * np.array([[0.0, np.cos(q[1]) * v[1], 0.0, 0.0]]))
    reduced = rnc.NonholonomicSystem(robot, [kind]).reduce([rnc.JointPosition(f"joint_{i}") for i in (1, 2, 3)])
    assert rnc.analyze(reduced, samples=8).lemma1_holds
    factor = 0.0
    assert not rnc.analyze(reduced, samples=8).lemma1_holds


def test_a_system_that_does_not_reach_everything_says_how_much():
    robot = rnc.Robot.from_urdf("mobile_manipulator.urdf", base="planar")
    kinds = [rnc.NoSideSlip("base"), rnc.FixedOutput(rnc.JointPosition("joint_2"), 0.3)]
    report = rnc.analyze(rnc.NonholonomicSystem(robot, kinds).reduce(), samples=4)
    assert report.growth_vector == (3, 4)
    assert "at most 4 of 5" in str(report)
    assert "at most 5 of 5" in str(dataclasses.replace(report, growth_vector=(3, 4, 5)))


def test_the_mobile_manipulator_is_singular_with_a_straight_arm_and_with_the_tip_abeam():
    reduced, vertical = mobile_manipulator(), ["distance_base_tip"]
    report = rnc.analyze(reduced, redundant=["base_speed_x"], samples=32, vertical=vertical)
    located = {each.matrix: each for each in report.singularities}
    assert all(each.located for each in located.values())
    assert abs(np.sin(located["E"].configuration["joint_2"])) < ROUNDING
    # Along a straight arm the tip goes as the base does, however that turns.
    assert set(located["E"].rows) == {"no_side_slip(axle.y)", "tip_x", "tip_y", "base_speed_x"}
    assert located["A4"].rows == ("distance_base_tip",)
    values = located["A4"].configuration  # links of one metre: the bearing of the tip is from the heading, at the axle
    bearing = values["joint_1"] + np.arctan2(np.sin(values["joint_2"]), 1 + np.cos(values["joint_2"]))
    assert abs(np.cos(bearing)) < ROUNDING
    # What is reported can be set again.
    q = reduced.robot.configuration(located["E"].configuration)
    assert reduced.at(q).smallest_singular_value < ROUNDING


@pytest.mark.parametrize(("B", "rank", "missing"), [
    ([[1, 0, 0], [0, 1, 0], [0, 0, 1]], 3, ()),
    ([[1, 0], [0, 1], [0, 0]], 2, ("s2",)),
    ([[0, 0], [2, 0], [0, 3]], 2, ("s0",)),
    ([[1, 1], [1, 1], [0, 0]], 1, ("s0", "s1", "s2")),
    ([[1, 0], [1, 0], [0, 5]], 2, ("s0", "s1")),
    ([[0.0], [0.0], [0.0]], 0, ("s0", "s1", "s2")),
])  # fmt: skip
@pytest.mark.parametrize("unit", [1e-7, 1.0, 1e7])
def test_forces_that_are_missing(B, rank, missing, unit):
    """One more is missing at positive q1, so that this is no worst sample."""
    B, more = unit * np.array(B, float), np.array([[3.0, 1.0, 0.0], [0.0, 2.0, 1.0], [1.0, 0.0, 1.0]])

    def drives(q):
        return np.hstack([B, unit * more * (q[1] > 0)])

    reduced = rnc.NonholonomicSystem(rail_sliders(3), [], drives).reduce([rnc.JointPosition(f"s{k}") for k in range(3)])
    report = rnc.analyze(reduced, samples=12)
    assert (report.actuation_rank, report.unactuated) == (rank, missing)
    words = f", not fully actuated: {', '.join(missing)}" if missing else ""
    assert f"{rank} of 3 reduced forces{words}\n" in str(report)


def ahead_of(wall):
    """Output x of a planar base, undefined behind ``wall[0]``."""

    def coordinate(q):
        if q[0] < wall[0]:
            raise rnc.SingularityError("behind the wall", q=q, condition=np.inf, rows=("ahead",))
        return q[:1]

    def rows(q):
        coordinate(q)
        return np.array([[q[2], -q[3], 0.0]])

    def rows_dot(q, v):
        return np.array([[-q[3] * v[2], -q[2] * v[2], 0.0]])

    return rnc.Output(coordinate, rows, rows_dot, ["ahead"])


def test_a_report_is_of_the_samples_it_says():
    """Those that its seed draws; Lemma 1 and the class are judged on the better half."""
    wall = -0.5
    ahead = ahead_of([wall])
    model, _ = planar_model()
    system = rnc.NonholonomicSystem(rnc.Robot(model), [rnc.NoSideSlip("body")], np.eye(3)[:, :1])
    reduced = system.reduce([ahead, rnc.FrameYaw("body")], [rnc.FramePosition("body", "y")])
    seed, samples, generator = 5, 21, np.random.default_rng(5)
    drawn = np.stack([reduced.random_configuration(generator) for _ in range(samples)])
    regular = drawn[drawn[:, 0] >= wall]
    conditions = np.array([reduced.at(q).condition for q in regular])
    good = regular[conditions <= np.median(conditions)]
    report = rnc.analyze(reduced, redundant=["body_yaw"], samples=samples, seed=seed)
    assert 0 < samples - len(regular) < samples
    assert (report.samples, report.singular_samples) == (samples, samples - len(regular))
    assert f"condition of E at {len(regular)} samples" in str(report)
    expected = {"min": conditions.min(), "median": np.median(conditions), "max": conditions.max()}
    assert report.condition == pytest.approx(expected)
    assert report.lemma1 == pytest.approx(rnc.analysis.lemma_1_residuals(reduced, good, seed))
    assert report.lemma1_holds
    task = rnc.Task.of(reduced, ["ahead"], ["body_yaw"])
    assert report.redundancy == rnc.analysis.classify(reduced, task, good, seed)
    assert (report.n, report.r, report.p, report.rank) == (3, 2, 1, 1)
    assert (report.actuation_rank, report.unactuated) == (1, ("body_yaw",))
    assert report.completely_nonholonomic


def test_a_report_leaves_out_where_outputs_are_undefined():
    wall = [-np.inf]
    ahead = ahead_of(wall)
    reduced = rnc.NonholonomicSystem(sleigh().robot, [rnc.NoSideSlip("sleigh")]).reduce([ahead, rnc.FrameYaw("sleigh")])
    assert rnc.analyze(reduced, samples=16).growth_vector == (2, 3)
    wall[0] = 0.0
    assert rnc.analyze(reduced, samples=16).growth_vector == (2, 3)
    wall[0] = np.inf
    with pytest.raises(rnc.SingularityError, match="behind the wall"):
        rnc.analyze(reduced, samples=16)
