"""Verdicts of scenarios: what only the scenario knows about its run."""

import pytest
import yaml

from rnc_pin.applications.scenario.execution import execute
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.verdict import FindingKind
from urdf_parts import joint, link, robot, write

SCENARIO = {
    "robot": {"urdf": "cart.urdf", "base": "fixed"}, "actuators": ["x"], "outputs": {"reducing": [{"joint": "x"}]},
    "reference": {"primary": {"minimum_jerk": {"to": [1.0], "duration": 2}}},
    "controller": {"type": "reducing_outputs", "tracker": "computed_torque"},
    "simulation": {"duration": 2.5, "dt": 0.01},
}  # fmt: skip


def run_of(folder, changes):
    slide = joint("x", "base", "slide", axis="1 0 0", kind="prismatic", effort=99, limits=(-2, 2), speed=9)
    write(folder / "cart.urdf", robot(link("base"), link("slide"), slide))
    return execute(Scenario.load(str(write(folder / "cart.yaml", yaml.safe_dump(SCENARIO | changes))))).trajectory


@pytest.mark.parametrize(("duration", "said"), [(1.0, True), (1.95, False), (2.5, False)])
def test_a_run_that_ends_before_its_reference_says_how_far(tmp_path, duration, said):
    """Halfway, the cart is halfway, and nothing said so: it had kept up. At 1.95 s it is 1e-4 from the end."""
    verdict = run_of(tmp_path, {"simulation": {"duration": duration, "dt": 0.01}}).verdict
    assert (verdict.word, len(verdict.findings)) == ("succeeded", int(said))
    if said:
        (found,) = verdict.findings
        assert (found.kind, found.where, found.amount) == (FindingKind.GOAL, "x", pytest.approx(0.5, abs=1e-3))


def test_a_run_that_ends_before_its_plan_says_how_far():
    options = {"plots": {}, "comparisons": {}, "planner.duration": 3.0, "simulation.duration": 1.5}
    changes = {"obstacles": [], "planner.clearance": None, "planner.goal": {"tractor_x": 1.0}}
    run = execute(Scenario.load("docking", {**options, **changes}).build()).trajectory
    found = next(each for each in run.verdict.findings if each.kind is FindingKind.GOAL)
    assert str(found.severity) == "degrades"
    assert found.amount == pytest.approx(abs(1.0 - run.x1[-1, run.info.outputs.x1.names.index("tractor_x")]))


@pytest.mark.parametrize(("more", "word"), [([], "failed"), ([{"singularity": {"gain": 0.1}}], "succeeded")])
def test_postures_are_goals_where_nothing_else_is_asked(tmp_path, more, word):
    """The cart may go 0.4 m/s, and ends 0.4 m from its posture: it once succeeded. Beside a task, that is a wish."""
    tasks = [{"posture": {"joints": {"x": 0.8}, "gain": 4.0}}, {"damping": {"weight": 1e-4}}, *more]
    limits = {"joint_velocity": {"limit": 0.4}}
    controller = {"type": "qp", "tracker": "computed_torque", "tasks": tasks, "limits": limits}
    changes = {"controller": controller, "reference": {}, "simulation": {"duration": 1.0, "dt": 0.01}}
    verdict = run_of(tmp_path, changes).verdict
    assert verdict.word == word
    if word == "failed":
        assert (verdict.first.kind, verdict.first.where) == (FindingKind.GOAL, "x")
        assert verdict.first.amount == pytest.approx(0.4, abs=0.01)
