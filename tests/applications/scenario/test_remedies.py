"""Refused motions: the refusal says when, where and which rows, and the remedies in it were tried."""

import re

import numpy as np
import pytest
import yaml

import rnc_pin as rnc
from rnc_pin.applications.scenario.remedies import _result, _timed
from urdf_parts import robot

SPINNING = {"constraints": [{"momentum": {"joint": "platform", "momentum": 3.0}}], "comparisons": {}, "plots": {}}
"""The space robot with a momentum that is not zero: the platform turns until the arm has to stretch."""


def four_links():
    """The space robot with a fourth link: a platform and point masses of 10 kg at the ends of links of 1 m."""
    body = '<link name="{0}"><inertial><origin xyz="{1} 0 0"/><mass value="10"/><inertia {2}/></inertial></link>'
    no_inertia = 'ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"'
    turning = (
        '<joint name="{0}" type="continuous"><parent link="{1}"/><child link="{2}"/><origin xyz="{3} 0 0"/>'
        '<axis xyz="0 0 1"/></joint>'
    )
    names = ["body", *(f"link_{k}" for k in range(1, 5))]
    joints = ["platform", *(f"joint_{k}" for k in range(1, 5))]
    parts = ['<link name="ground"/>', body.format("body", 0, no_inertia.replace('izz="0"', 'izz="10"'))]
    parts[1] = parts[1].replace('ixx="0" iyy="0"', 'ixx="5" iyy="5"')
    parts += [body.format(name, 1, no_inertia) for name in names[1:]]
    parents = ["ground", *names[:-1]]
    parts += [
        turning.format(name, *pair, int(k > 1))
        for k, (name, *pair) in enumerate(zip(joints, parents, names, strict=True))
    ]
    tip = '<joint name="tip_joint" type="fixed"><parent link="link_4"/><child link="tip"/><origin xyz="1 0 0"/></joint>'
    return robot(*parts, '<link name="tip"/>', tip)


FOUR = """
robot: {urdf: four.urdf}
constraints: [{momentum: platform}]
actuators: [joint_1, joint_2, joint_3, joint_4]
outputs:
  reducing: [{frame_position: {frame: tip, axes: xy}}, {joint: joint_1}, {joint: joint_2}]
  vertical: [{joint: platform}]
task: {primary: [tip_x, tip_y], redundant: [joint_1, joint_2]}
initial: {q: {joint_1: -0.4, joint_2: 1.2, joint_3: -1.0, joint_4: 0.8}}
reference:
  primary: {minimum_jerk: {to: [1.9, 1.4], duration: 6}}
  vertical: {minimum_jerk: {to: [0.4], duration: 6}}
controller: {type: redundancy, preset: scaled}
simulation: {duration: 10, dt: 0.002}
"""


def refusal_of(scenario):
    with pytest.raises(rnc.InfeasibleError) as caught:
        scenario.run()
    return caught.value


def test_a_fourth_link_is_refused_with_its_cause_and_with_a_remedy_that_runs(tmp_path):
    (tmp_path / "four.urdf").write_text(four_links())
    (tmp_path / "four.yaml").write_text(FOUR)
    path = str(tmp_path / "four.yaml")
    error = refusal_of(rnc.Scenario.load(path))
    scenario = rnc.Scenario.load(path)
    # the rows are dependent at the place that the error names, by a plain decomposition of E
    E = scenario.reduced.at(error.q).E
    left, values, _ = np.linalg.svd(E / np.linalg.norm(E, axis=1)[:, None])
    assert values[-1] < 0.05
    names = (*scenario.system.constraints.names, *scenario.reduced.reducing.names)
    assert names[int(np.argmax(np.abs(left[:, -1])))] in error.rows
    assert 0.0 < error.time < 7.0
    said = str(error)
    assert f"nearly singular at t = {error.time:.2f} s at q = [" in said
    assert "sample faster" not in said
    nearer = {f"reference.{role}.minimum_jerk.to": (start + 0.5 * (np.array(goal) - start)).round(6).tolist()
              for role, goal, start in _goals(scenario)}  # fmt: skip
    assert "tried with success: goals at 0.5 of the way: the run succeeds" in said
    assert rnc.Scenario.load(path, nearer).run().verdict.succeeded
    tried = dict(re.findall(r"tried in vain: (controller\.\w+=\S+): ([^;]*)", said))
    assert "diverged at t = " in tried["controller.tracker=computed_torque"]
    with pytest.raises(rnc.DivergenceError):
        rnc.Scenario.load(path, {"controller.tracker": "computed_torque"}).run()
    assert re.search(r"tried in vain: controller\.secondary=\{singularity: \{\}\}: still refused at t = ", said)
    assert re.search(r"references and simulation 2 times slower: still refused at t = ", said)
    assert "joint joint_3 instead of joint_1 among the reducing outputs" in said


def _goals(scenario):
    x1, x2 = scenario.reduced.at(scenario.q0).outputs()
    return [("primary", [1.9, 1.4], x2[scenario.task.primary]), ("vertical", [0.4], x1[scenario.task.vertical])]


def test_a_spinning_space_robot_is_refused_with_its_cause_and_remedies_if_asked():
    """Sweeps build many runs, and only need to know which are infeasible."""
    with pytest.raises(rnc.InfeasibleError) as caught:
        rnc.Scenario.load("space-robot", SPINNING).build()
    assert "tried with success" not in str(caught.value)
    with pytest.raises(rnc.InfeasibleError) as caught:
        rnc.Scenario.load("space-robot", SPINNING).build(remedies=True)
    error = caught.value
    assert {"momentum(platform)", "tip_x"} <= set(error.rows)
    assert error.singular_value < 0.01
    said = str(error)
    assert "a shorter sampling period does not help" in said
    assert "tried with success: goals at 0.5 of the way" in said
    assert "controller.secondary" not in said  # no redundant output is left for it


def test_a_refused_preflight_has_remedies_too():
    options = {"preflight": "refuse", "reference.primary.minimum_jerk.to": [2.95, 0.4], "comparisons": {}, "plots": {}}
    error = refusal_of(rnc.Scenario.load("space-robot", {**options, "controller.tracker": "computed_torque"}))
    assert "singular configuration" in str(error)
    assert "tried with success: goals at 0.5 of the way" in str(error)
    assert "controller.tracker=computed_torque" not in str(error)  # that is what was refused


def test_errors_that_no_motion_causes_have_no_remedies(tmp_path):
    with pytest.raises(rnc.ConfigurationError) as caught:
        rnc.Scenario.load("space-robot", {"controller.secondary": {"singularity": {}}}).run()
    assert "tried" not in str(caught.value)


def test_all_times_of_references_are_slowed():
    raw = yaml.safe_load("""
        reference: {primary: {via_points: {times: [1, 2], points: [[0], [1]]}}, vertical: {harmonic: {frequency: 2}}}
        controller: {tasks: [{output: {reference: {minimum_jerk: {by: [1], duration: 3, begin: 1}}}}]}
        simulation: {duration: 4}
    """)
    assert _timed(raw) == {
        "reference.primary.via_points.times": [1, 2],
        "reference.vertical.harmonic.frequency": 2,
        "controller.tasks.0.output.reference.minimum_jerk.duration": 3,
        "controller.tasks.0.output.reference.minimum_jerk.begin": 1,
    }


@pytest.mark.parametrize(("near_singular", "expected"), [
    (True, "still refused at t = 1.20 s, smallest singular value 0.01 (rolling, wheel)"),
    (False, "still refused, no velocity gains suit this region"),
])  # fmt: skip
def test_a_remedy_in_vain_blames_singular_outputs_only_where_they_are_nearly_singular(near_singular, expected):
    """The inertia of a heavy arm with light joints excludes gains at regular configurations too."""
    error = rnc.InfeasibleError("no velocity gains suit this region; sample faster")
    error.time, error.rows = 1.2, ("rolling", "wheel")
    error.singular_value, error.near_singular = 0.01, near_singular

    def refuse(raw, watch):
        raise error

    assert _result(refuse, {}) == (False, expected)
