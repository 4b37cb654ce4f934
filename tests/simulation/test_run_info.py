"""The record of a run: typed in the package, JSON under fixed keys in its file."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import rnc_pin as rnc
from refusals import refused
from rnc_pin.applications.command_line.replay import load_run
from rnc_pin.applications.scenario.execution import execute
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.simulation import PlannedPath, Provenance, RunInfo, TaskNames
from rnc_pin.simulation.run_info import provenance_of
from simple_controllers import Idle
from systems import space_robot

SHORT = {"simulation.duration": 0.02, "comparisons": {}, "plots": {}}
FULL = Provenance(
    scenario="mine", seed=3, config={"robot": {"urdf": "mine.urdf"}, "constraints": [], "title": None},
    folder="/home/me", controller={"type": "Mine", "k": [1.0, 2.0]}, task=TaskNames(("tip_x",), ("joint_1",)),
    path=PlannedPath("tractor", ((0.0, 0.0, 0.1), (1.0, 0.0, 0.2))), estimates={"mass": "kg"},
    predicted={"rolling": "m/s"}, more={"note": ["anything", {"else": 1.5}]},
)  # fmt: skip


def idle_run(v2_0=None, **options):
    reduced = space_robot()
    q0 = reduced.robot.configuration({"joint_2": 1.0, "joint_3": 1.0})
    return rnc.simulate(reduced, Idle(3), q0, 0.02, 0.01, v2_0=v2_0, options=rnc.SimulationOptions(**options))


@pytest.fixture(scope="module")
def run():
    return idle_run(meta=FULL)


@pytest.mark.parametrize("origin", [FULL, Provenance(), replace(FULL, path=None, seed=None)])
def test_provenance_survives_being_plain(origin):
    content = origin.to_json()
    assert json.loads(json.dumps(content)) == content
    assert None not in content.values()
    assert provenance_of(content) == origin


def test_a_run_tells_its_file_what_it_knows(run, tmp_path):
    run.save(tmp_path / "run.npz")
    again = rnc.Trajectory.load(tmp_path / "run.npz")
    judged = run.with_verdict(run.verdict)
    assert again.info == judged.info
    for name, values in run.arrays.items():
        np.testing.assert_array_equal(again.arrays[name], values)
    assert [each.name for each in tmp_path.iterdir()] == ["run.npz"]
    assert again.meta == judged.meta == json.loads(json.dumps(judged.meta))
    assert again.info.provenance == FULL
    with np.load(tmp_path / "run.npz") as file:
        written = json.loads(str(file["meta"]))
    assert list(written) == [
        "names", "units", "angular", "rotations", "quasi", "goals", "dt", "versions", "scenario", "seed", "config",
        "folder", "controller", "task", "path", "estimates", "predicted", "note", "outcome", "integration", "verdict",
    ]  # fmt: skip
    assert written["names"]["T"] == ["joint_1", "joint_2", "joint_3"]
    assert written["task"] == {"primary": ["tip_x"], "redundant": ["joint_1"]}
    assert (written["note"], written["outcome"]) == (["anything", {"else": 1.5}], "completed")


def test_what_is_not_there_is_not_needed(run):
    needed = {key: run.meta[key] for key in ("names", "units", "angular")}
    outputs = run.info.outputs
    x1, x2 = (replace(columns, quasi=()) for columns in (outputs.x1, outputs.x2))
    assert RunInfo.from_json(needed) == RunInfo(replace(outputs, x1=x1, x2=x2))
    assert RunInfo.from_json(run.meta).to_json() == run.meta


REFUSED = {
    "a number for a mapping": ({"config": 3}, "'meta' has 3 as 'config', expected a mapping"),
    "a text for a number": ({"seed": "3"}, "'meta' has '3' as 'seed', expected a valid integer"),
    "true for a number": ({"dt": True}, "'meta' has True as 'dt', expected a valid number"),
    "an outcome nobody knows": ({"outcome": "won"},
        "'meta' has 'won' as 'outcome', expected 'completed', 'interrupted', "),
    "numbers for names": ({"goals": [1]}, r"'meta' has 1 as 'goals\[0\]', expected a valid string"),
    "a text for names": ({"task": {"primary": "tip"}}, "'meta' has 'tip' as 'task.primary', expected a list"),
    "a path of nobody": ({"path": {"poses": []}}, "'meta' has no 'path.frame'"),
    "poses without headings": ({"path": {"frame": "tip", "poses": [[0.0, 1.0]]}},
        r"'meta' has no 'path.poses\[0\]\[2\]'"),
    "a key of two lines": ({"estimates": {"a\nb": 3}}, r"'meta' has 3 as 'estimates.a b', expected a valid string"),
    "no names": ({"names": []}, "'meta' does not name the outputs"),
    "flags in words": ({"angular": {"x1": [], "x2": ["no"]}}, r"'no' as 'angular.x2\[0\]', expected a valid boolean"),
    "inputs without names": ({"names": {"x1": ["platform"], "x2": ["tip_x", "tip_y", "joint_1"], "T": ["joint_1"]}},
        "'meta' does not name the columns of 'T'"),
    "too few names": ({"names": {"x1": ["platform"], "x2": ["tip"]}}, "'meta' does not name the columns of 'x2'"),
}  # fmt: skip


@pytest.mark.parametrize(("parts", "words"), REFUSED.values(), ids=REFUSED)
def test_a_file_that_says_something_else_is_refused(parts, words, run, tmp_path):
    path = tmp_path / "run.npz"
    run.save(path)
    with np.load(path) as file:
        arrays = dict(file)
    np.savez(path, **{**arrays, "meta": np.array(json.dumps({**run.meta, **parts}))})
    with pytest.raises(rnc.ConfigurationError, match=words) as caught:
        rnc.Trajectory.load(path)
    assert str(caught.value).startswith(f"{path}: not a trajectory: ")
    assert len(str(caught.value).splitlines()) == 1


test_what_could_not_be_written_is_refused_before_the_run = refused([
    ({"task": "reach"}, rnc.ConfigurationError, "'meta' has 'reach' as 'task', expected a mapping"),
    ({"note": {"q": [object()]}}, rnc.InputError, r"meta.note.q\[0\]: is of type object, expected numbers"),
], lambda meta: idle_run(meta=meta, observer=lambda sample: pytest.fail("it ran")))  # fmt: skip


def test_what_a_run_will_say_is_looked_up_before_it_runs(monkeypatch):
    monkeypatch.setattr("rnc_pin.simulation.sampled_run.versions", lambda: pytest.fail("looked up"))
    with pytest.raises(pytest.fail.Exception, match="looked up"):
        idle_run(observer=lambda sample: pytest.fail("it ran"))


def test_the_run_of_a_built_in_scenario_names_no_folder(tmp_path, monkeypatch):
    run = execute(Scenario.load("space-robot", SHORT)).trajectory
    assert "folder" not in run.meta
    assert str(Path(rnc.__file__).parent) not in json.dumps(run.meta)
    run.save(tmp_path / "run.npz")
    # A file of the same name where the replay is started is another robot.
    (tmp_path / "space_robot.urdf").write_text("<robot name='other'/>")
    monkeypatch.chdir(tmp_path)
    assert load_run(tmp_path / "run.npz").scenario.robot.name == "space_robot"
