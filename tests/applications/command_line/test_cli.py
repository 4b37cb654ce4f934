"""The command line as its users meet it: what it prints, what it writes, and its exit status."""

import io
import json
import shlex
import subprocess
import sys
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
import yaml

import rnc_pin as rnc
from patience import PATIENCE
from rnc_pin.applications.command_line.cli import main
from rnc_pin.applications.scenario.files import built_in_names, find_scenario
from rnc_pin.robots.robot_files import shipped_directory
from terminal import results
from urdf_parts import joint, link, robot, write

SHORT, ALONE = ["--set", "simulation.duration=0.2"], ["--set", "comparisons={}"]
BARE = [*SHORT, *ALONE, "--set", "plots={}"]

ARRAYS = {  # sizes of one sample: nq = nv = 4, r = p = 3, m = 1
    "time": (), "q": (4,), "v": (4,), "v2": (3,), "v2_desired": (3,), "x1": (1,), "x1_desired": (1,), "x2": (3,),
    "x2_desired": (3,), "F": (3,), "T": (3,), "multipliers": (1,), "energy": (), "constraint_residual": (),
}  # fmt: skip


class Ended(NamedTuple):
    """Exit status and outputs of a command."""

    returncode: int
    stdout: str
    stderr: str


@pytest.fixture(scope="module")
def first_run(tmp_path_factory):
    """A run of the paper's figure 4, cut short: (its end, its folder). Look at it, do not write into it."""
    folder, out, error = tmp_path_factory.mktemp("first") / "out", io.StringIO(), io.StringIO()
    with pytest.MonkeyPatch.context() as patched, redirect_stdout(out), redirect_stderr(error):
        patched.setattr(sys, "argv", ["rnc-pin", "run", "space-robot", *SHORT, "--out", str(folder)])
        with pytest.raises(SystemExit) as end:
            main()
    return Ended(end.value.code, out.getvalue(), error.getvalue()), folder


def parsed(text):
    """JSON as the standard has it, which knows neither NaN nor Infinity."""

    def refuse(constant):
        raise AssertionError(f"{constant} is not JSON")

    return json.loads(text, parse_constant=refuse)


def arrays(path):
    with np.load(path) as file:
        return {name: file[name] for name in file.files}


def the_line(error):
    """The message of an error that is exactly one line, as every error has to be."""
    assert error.endswith("\n")
    assert len(error.splitlines()) == 1, error
    assert error.startswith("rnc-pin: error: ")
    assert "unexpected" not in error
    return error.removeprefix("rnc-pin: error: ").strip()


def test_list_names_every_scenario(call):
    status, out, error = call("list")
    assert (status, error) == (0, "")
    assert all(name in out for name in built_in_names())
    status, out, error = call("list", "--json")
    assert sorted(parsed(out)) == built_in_names()
    assert all(parsed(out).values())


def test_run_writes_what_the_manual_says(first_run):
    process, folder = first_run
    assert (process.returncode, process.stderr) == (0, "")
    written = {path.name for path in folder.iterdir()} - {".rnc_pin"}
    assert written == {
        "trajectory.npz", "trajectory_platform_uncontrolled.npz", "summary.json", "scenario.yaml",
        "figure_4a.png", "figure_4b.png", "overview.png", "limits.png", "top_view.png", "animation.html",
    }  # fmt: skip
    assert all(name in process.stdout for name in written)
    for picture in folder.glob("*.png"):
        assert picture.read_bytes().startswith(b"\x89PNG\r\n\x1a\n")
    assert "<html" in (folder / "animation.html").read_text()[:200]
    scenario = yaml.safe_load((folder / "scenario.yaml").read_text())
    assert (scenario["simulation"]["duration"], scenario["constraints"]) == (0.2, [{"momentum": "platform"}])


def test_the_trajectory_holds_finite_arrays_of_the_right_sizes(first_run):
    trajectory = arrays(first_run[1] / "trajectory.npz")
    meta = parsed(str(trajectory.pop("meta")))
    assert trajectory["time"].tolist() == pytest.approx(np.arange(101) * 0.002)
    for name, size in ARRAYS.items():
        assert (trajectory[name].shape, trajectory[name].dtype) == ((101, *size), np.float64)
        assert np.isfinite(trajectory[name]).all(), name
    assert (meta["names"]["x2"], meta["units"]["x2"]) == (["tip_x", "tip_y", "joint_1"], ["m", "m", "rad"])
    assert {"scenario", "versions", "seed"} <= set(meta)


def test_the_summary_fits_the_trajectory(first_run):
    _, folder = first_run
    summary, trajectory = parsed((folder / "summary.json").read_text()), arrays(folder / "trajectory.npz")
    assert (summary["scenario"], summary["outcome"]) == ("space-robot", "completed")
    assert summary["duration"] == trajectory["time"][-1]
    error = np.abs(trajectory["x2_desired"][:, 0] - trajectory["x2"][:, 0])
    assert (summary["final_error"]["tip_x"], summary["max_error"]["tip_x"]) == (error[-1], error.max())
    assert summary["rms_error"]["tip_x"] == pytest.approx(np.sqrt(np.mean(error**2)))
    assert set(summary["final_error"]) == {"tip_x", "tip_y", "platform"}
    assert summary["constraint_residual_max"] == trajectory["constraint_residual"].max() < 1e-12
    assert 0 < summary["min_singular_value"] < 1
    assert 0 <= summary["energy_drift"] < 1e-9
    assert summary["wall_time"] > 0
    assert summary["realtime_factor"] == pytest.approx(summary["duration"] / summary["wall_time"])


def test_json_is_all_that_is_printed_of_a_run_into_its_default_folder(call, tmp_path, monkeypatch, no_pictures):
    monkeypatch.chdir(tmp_path)
    status, out, error = call("run", "space-robot", *BARE, "--json")
    assert (status, error) == (0, "")
    folder, printed = tmp_path / "runs" / "space-robot", parsed(out)
    files, elapsed = printed.pop("files"), printed.pop("elapsed_time")
    assert elapsed > printed["wall_time"]  # reading, building and drawing are in it
    assert printed == parsed((folder / "summary.json").read_text())
    assert set(files) == {path.name for path in folder.iterdir()} - {".rnc_pin"}


def test_a_failed_run_has_status_1_and_keeps_its_results(call, tmp_path):
    # The paper's gains, towards a point beyond the reach of three links of a metre: through the stretched arm.
    far = "reference.primary={minimum_jerk: {to: [4, 0], duration: 1}}"
    options = ["--set", "controller.preset=paper", "--set", far, "--set", "simulation.duration=2", "--set", "plots={}"]
    status, out, error = call("run", "space-robot", *options, "--json", "--out", tmp_path)
    assert status == 1
    message = the_line(error)
    assert " at t = 0." in message
    assert str(tmp_path) in message
    summary, trajectory = parsed((tmp_path / "summary.json").read_text()), arrays(tmp_path / "trajectory.npz")
    assert parsed(out)["outcome"] == summary["outcome"] in ("diverged", "singular")
    assert summary["message"] in message
    assert 0 < summary["duration"] == trajectory["time"][-1] < 1
    assert summary["samples"] == len(trajectory["time"])
    assert "comparisons" not in summary
    assert all(np.isfinite(trajectory[name]).all() for name in ARRAYS)
    assert parsed(str(trajectory["meta"]))["outcome"] == summary["outcome"]
    assert (tmp_path / "overview.png").is_file()


def test_a_run_that_misses_a_goal_says_so(call, tmp_path, no_pictures):
    stuck = ["--set", "faults.stuck={joint: joint_1, time: 0.1}", "--set", "simulation.duration=1"]
    status, out, error = call("run", "space-robot", *BARE, *stuck, "--json", "--out", tmp_path)
    assert status == 1
    summary = parsed(out)
    missed = {name: value for name, value in summary["final_error"].items() if value > 0.02}
    assert missed
    assert summary["goals_missed"] == missed == parsed((tmp_path / "summary.json").read_text())["goals_missed"]
    assert summary["verdict"] == "failed"
    assert [each["where"] for each in summary["findings"] if each["severity"] == "fails"] == list(missed)
    first = next(iter(missed))
    assert f"rnc-pin: error: the goal of {first} is missed by " in error.splitlines()[-1]
    status, out, error = call("replay", tmp_path)
    assert (status, "space-robot: failed" in out) == (1, True)
    assert f"rnc-pin: error: the goal of {first} is missed by " in error.splitlines()[-1]
    assert f"the run is in {tmp_path}" in error.splitlines()[-1]
    accepted = ["--set", "accept=[goal]"]
    status, out, error = call("run", "space-robot", *BARE, *stuck, "--json", "--out", tmp_path, *accepted)
    assert (status, parsed(out)["verdict"]) == (0, "degraded")
    assert f"rnc-pin: warning: the goal of {first} is missed by " in error


@pytest.mark.parametrize(("options", "outcome"), [
    (["simulation.position_limits=true", "initial.q.joint_1=69.8", "controller.preset=paper"], "limit"),
    (["actuators=[]"], "failed"),
])  # fmt: skip
def test_a_run_that_fails_at_once_still_gives_json(options, outcome, call, tmp_path, no_pictures):
    settings = [word for option in options for word in ("--set", option)]
    status, out, error = call("run", "space-robot", *BARE, *settings, "--json", "--out", tmp_path)
    assert status == 1
    the_line(error)
    assert parsed(out)["outcome"] == parsed((tmp_path / "summary.json").read_text())["outcome"] == outcome


def test_inspect_answers_every_question_on_one_page(call):
    inspect = ("inspect", "space-robot", "--samples", 16)
    status, out, _ = call(*inspect)
    assert status == 0
    page = " ".join(out.replace("│", " ").split())  # one line, without the frame of its table
    for words in (
        "primary motions tip_x, tip_y ", "redundant motions joint_1 ", "actuators joint_1, joint_2, joint_3",
        "momentum(platform) [nonholonomic]", "completely nonholonomic [growth vector (3, 4),", "3 of 3 reduced forces",
        "class 1 [A4 has full row rank]", "E: momentum(platform), tip_x, tip_y, joint_1 [singular, e.g. at platform =",
        "A4: platform [singular, e.g. at platform =", "Lemma 1 holds, residuals A R ",
    ):  # fmt: skip
        assert words in page, words
    assert len(out.splitlines()) <= 50
    *best, command = out.splitlines()[-4:]
    assert all(line.startswith("class 1: with tip_xy at rest, ") for line in best)
    assert command == "more: rnc-pin explore space-robot"
    status, out, error = call(*inspect, "--json")
    assert (status, error) == (0, "")
    report = parsed(out)
    assert (report["n"], report["r"], report["p"], report["rank"]) == (4, 3, 3, 1)
    assert (report["kept_rows"], report["dropped_rows"]) == (["momentum(platform)"], [])
    assert (report["growth_vector"], report["completely_nonholonomic"]) == ([3, 4], True)
    assert (report["redundancy_class"], report["actuation_rank"]) == ("1", 3)
    assert 1 <= report["condition"]["min"] <= report["condition"]["median"] <= report["condition"]["max"]
    assert report["lemma1_holds"] is True
    assert report["lemma1"]["A R"] < 1e-12
    assert (report["primary"], report["redundant"]) == (["tip_x", "tip_y"], ["joint_1"])


def test_inspect_looks_at_the_vertical_outputs_that_the_task_names(call):
    _, out, _ = call("inspect", "fire-truck", "--samples", 4, "--json")
    report = parsed(out)
    assert report["redundancy_class"] == "2s"
    assert (report["redundancy"]["tracked"], report["redundancy"]["driven"]) == (["trailer_yaw"], [])


@pytest.mark.parametrize(("system", "start", "kind", "vertical", "controller"), [
    ("space-robot", [], "1", {"platform"}, "redundancy"),
    ("space-robot", ["--set", "initial.q={}"], "1", {"platform"}, "redundancy"),  # a straight arm
    ("snakeboard", ["--set", "actuators=[rotor, front_steering, back_steering, {force: {frame: board, axis: x}}]"],
     "1", {"board_yaw"}, "redundancy"),
    ("space-robot", [], "1", {"joint_1"}, "redundancy"),
    ("fire-truck", [], "2s", {"trailer_yaw"}, "steering"),
    ("mobile-manipulator", [], "3", {"base_x", "base_y"}, "two_phase"),
])  # fmt: skip
def test_explore_finds_the_answers_of_the_paper_and_writes_scenarios_that_succeed(
    system, start, kind, vertical, controller, call, tmp_path
):
    status, out, error = call("explore", system, *start, "--json")
    assert (status, error) == (0, "")
    rows = parsed(out)["rows"]
    row = next(each for each in rows if (each["redundancy_class"], {*each["vertical"]}) == (kind, vertical))
    file = tmp_path / "use.yaml"
    status, out, _ = call("explore", system, *start, "--write", file, "--row", row["row"])
    assert status == 0
    *table, end = out.splitlines()
    assert len(table) <= 20
    assert f"class {kind}: {row['reason']}" in out
    assert end == f"wrote {file}, whose run succeeded: rnc-pin run {file}"
    written = rnc.Scenario.load(file)
    assert written.content.controller.type == controller
    run = written.run()
    assert run.verdict.succeeded
    moved = [run.info.outputs.x1.names.index(name) for name in vertical]
    assert np.linalg.norm(run.x1[-1, moved] - run.x1[0, moved]) > 0.03


def test_explore_writes_the_use_of_a_joint_that_moves_nothing_else(call, tmp_path):
    """Such as a gripper or the last joint of a wrist: it is a coordinate itself, and no output is there twice."""
    wrist = joint("wrist", "slide", "hand", (0.3, 0, 0), "1 0 0")
    parts = link("world"), joint("rail", "world", "slide", (0, 0, 0), "1 0 0"), link("slide"), wrist, link("hand")
    urdf, file = write(tmp_path / "arm.urdf", robot(*parts)), tmp_path / "arm.yaml"
    assert call("init", urdf, "--base", "fixed", "--out", file)[0] == 0
    status, out, error = call("explore", file, "--primary", "rail", "--write", tmp_path / "use.yaml")
    assert (status, error) == (0, "")
    assert "wrist can turn wrist" in out
    run = rnc.Scenario.load(tmp_path / "use.yaml").run()
    assert run.verdict.succeeded
    assert np.ptp(run.q, axis=0).max() > 0.03


@pytest.mark.parametrize(("arguments", "words"), [
    (["space-robot", "--primary", "tipp_x"], "no output 'tipp_x'; did you mean 'tip_x'"),
    (["space-robot", "--row", 99, "--write", "use.yaml"], "--row 99: expected a row from 1 to 6"),
    (["space-robot", "--row", 6, "--write", "use.yaml"], "1 of 2 directions of center_of_mass_xy can be moved"),
    (["space-robot", "--write", "there.yaml"], "--write there.yaml: exists"),
    (["snakeboard", "--write", "use.yaml"], "board_speed_x can turn board_yaw; no actuator drives it"),
])  # fmt: skip
def test_explore_refuses(arguments, words, call, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("there.yaml").touch()
    status, _, error = call("explore", *arguments)
    assert status == 2
    assert words in error
    assert not Path("use.yaml").exists()


@pytest.mark.parametrize("source", ["", "trajectory.npz"], ids=["folder", "file"])
def test_replay_shows_the_summary_or_writes_a_page(source, first_run, call, tmp_path):
    source, page = first_run[1] / source, tmp_path / "page.html"
    status, out, error = call("replay", source)
    assert (status, error) == (0, "")
    assert "space-robot: succeeded" in out
    assert call("replay", source, "--html", page)[0] == 0
    assert page.stat().st_size > 500_000  # the viewer is in it
    written = page.read_bytes()
    status, _, error = call("replay", source, "--html", page)
    assert status == 2
    assert "page.html" in the_line(error)
    assert page.read_bytes() == written
    assert call("replay", source, "--html", page, "--force")[0] == 0


def test_replay_finds_the_robot_from_anywhere(call, tmp_path, monkeypatch, no_pictures):
    """The run was started beside a scenario and a URDF of one's own; the replay is not."""
    raw = yaml.safe_load(find_scenario("space-robot").read_text())
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump({**raw, "robot": {"urdf": "mine.urdf"}}))
    (tmp_path / "mine.urdf").write_bytes((shipped_directory() / "space_robot.urdf").read_bytes())
    monkeypatch.chdir(tmp_path)
    assert call("run", "mine.yaml", *BARE, "--out", "out")[0] == 0
    monkeypatch.chdir("/")
    status, _, error = call("replay", tmp_path / "out", "--html", tmp_path / "page.html")
    assert (status, error) == (0, "")


def packed(content):
    buffer = io.BytesIO()
    np.savez(buffer, **content)
    return buffer.getvalue()


def with_meta(good, text):
    return packed({**good, "meta": np.array(text)})


RUBBISH = {
    "text": lambda good: b"hello",
    "another archive": lambda good: packed({"a": np.zeros(3)}),
    "no scenario": lambda good: with_meta(good, "{}"),
    "another robot": lambda good: packed({**good, "q": good["q"][:, :2]}),
    "NaN": lambda good: packed({**good, "q": np.full_like(good["q"], np.nan)}),
}


@pytest.mark.parametrize("content", RUBBISH.values(), ids=RUBBISH)
def test_replay_of_rubbish_is_refused(content, first_run, call, tmp_path):
    path = tmp_path / "rubbish.npz"
    path.write_bytes(content(arrays(first_run[1] / "trajectory.npz")))
    status, out, error = call("replay", path, "--html", tmp_path / "page.html")
    assert (status, results(out)) == (2, "")
    message = the_line(error)
    assert "rubbish.npz" in message
    assert "pickle" not in message  # what NumPy proposes would run what is in the file
    assert [each.name for each in tmp_path.iterdir()] == ["rubbish.npz"]


def test_a_sweep_has_the_same_results_on_any_number_of_processes(call, no_pictures, tmp_path):
    arguments = ["sweep", "space-robot", "--set", "simulation.duration=0.02", "--runs", "3"]
    one, two = tmp_path / "one", tmp_path / "two"
    assert call(*arguments, "--jobs", 1, "--out", one)[0] == 0
    status, out, error = call(*arguments, "--jobs", "2", "--json", "--out", two)
    assert (status, error) == (0, "")
    assert parsed(out) == parsed((two / "sweep.json").read_text())
    assert parsed(out)["outcomes"] == {"completed": 3}
    assert (one / "sweep.json").read_text() == (two / "sweep.json").read_text()
    first, second = (rnc.load_sweep(folder) for folder in (one, two))
    for here, there in zip(first.rows(), second.rows(), strict=True):
        assert {**here, "wall_time": 0} == {**there, "wall_time": 0}
    assert len(set(first["initial.q.joint_2"])) == 3


def test_a_sweep_accepts_kinds_of_findings(call, no_pictures, tmp_path):
    stuck = ["--set", "faults.stuck={joint: joint_1, time: 0.1}", "--set", "simulation.duration=1"]
    short = ["sweep", "space-robot", *stuck, "--runs", "2", "--jobs", "1", "--json"]
    for more, status, verdict in (([], 1, "goal"), (["--set", "accept=[goal]"], 0, "degraded")):
        found, out, _ = call(*short, *more, "--out", tmp_path / verdict)
        assert (found, parsed(out)["verdicts"]) == (status, {"succeeded": 1, verdict: 1})


def test_a_sweep_with_runs_that_fail_says_so(call, tmp_path):
    # The stretched arm is drawn with certainty.
    ranges = "sweep={initial.q.joint_2: [0, 0], initial.q.joint_3: [0, 0]}"
    twice = ["--runs", 2, "--jobs", 1]
    status, out, _ = call("sweep", "space-robot", "--set", ranges, *twice, "--json", "--out", tmp_path)
    assert (status, parsed(out)["outcomes"]) == (1, {"infeasible": 2})
    first, command, *_ = (tmp_path / "failures.txt").read_text().splitlines()
    assert first.startswith("# run 0: infeasible: ")
    assert "singular configuration" in first
    status, _, error = call(*shlex.split(command)[1:], "--out", tmp_path / "again")
    assert status == 2
    assert "singular configuration" in error


def test_the_command_of_a_failed_run_repeats_it(call, no_pictures, tmp_path):
    """To the bit: drawn values, the seed of its faults, and its failure."""
    draws = {
        "sweep": "{initial.q.joint_2: [1.6, 2.0], faults.position_noise: {log_uniform: [1.0e-5, 1.0e-4]},"
        " faults.velocity_noise: {choice: [30, 40]}}",
        "simulation.duration": 0.05,
    }
    options = [each for key, value in draws.items() for each in ("--set", f"{key}={value}")]
    assert call("sweep", "space-robot", *options, "--runs", 4, "--out", tmp_path / "all")[0] == 1
    results = rnc.load_sweep(tmp_path / "all")
    row = next(results.failures())
    assert call(*shlex.split(results.command(row))[1:], "--out", tmp_path / "one")[0] == 1
    summary = parsed((tmp_path / "one" / "summary.json").read_text())
    assert (summary["message"], summary["energy_drift"]) == (row["message"], row["energy_drift"])
    assert summary["rms_error"]["tip_x"] == row["rms_error.tip_x"]
    assert len(set(results["seed"])) == 4  # each run has its own noise


SET_DURATION = ["run", "space-robot", "--set", "duration=-1"]
USAGE = {
    "no command": ([], "command"),
    "unknown command": (["rnu"], "No such command 'rnu'"),
    "no scenario": (["run"], "Missing argument 'SCENARIO'"),
    "misspelt scenario": (["run", "space-robt"], "did you mean 'space-robot'?"),
    "option without value": (["run", "space-robot", "--set", "seed"], "option 'seed': expected key=value"),
    "option of an unknown key": (["run", "space-robot", "--set", "sede=1"], "did you mean 'seed'?"),
    "file as folder": (["run", "space-robot", "--out", "/dev/null"], "--out /dev/null: is a file"),
    "no such trajectory": (["replay", "nowhere.npz"], "no file 'nowhere.npz'"),
    "sweep without count": (["sweep", "space-robot", "--out", "x"], "Missing option '--runs'"),
    "sweep on no process": (["sweep", "space-robot", "--runs", "2", "--jobs", "0", "--out", "x"], "--jobs 0"),
    "key of two levels below": (SET_DURATION, "did you mean 'planner.duration' or 'simulation.duration'?"),
    "key of a level below": (["run", "space-robot", "--set", "dt=0"],
        "'dt' is not known; did you mean 'simulation.dt'?"),
    "key of no part": (["run", "space-robot", "--set", "durations=1"], "'durations' is not known"),
}  # fmt: skip


@pytest.mark.parametrize(("arguments", "words"), USAGE.values(), ids=USAGE)
def test_wrong_usage_is_one_line_and_status_2(arguments, words, call, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    status, out, error = call(*arguments)
    assert (status, results(out)) == (2, "")
    assert words in the_line(error)
    assert len(error) < 300
    assert list(tmp_path.iterdir()) == []  # nothing is written before everything is checked


@pytest.mark.parametrize("arguments", [["--debug", "run", "nowhere"], ["run", "nowhere", "--debug"]])
def test_debug_shows_where(arguments, call):
    status, _, error = call(*arguments)
    assert status == 2
    assert "Traceback" in error
    assert "find_scenario" in error
    assert error.splitlines()[-1].startswith("rnc-pin: error: no scenario 'nowhere'")


def test_the_module_is_the_command_too(tmp_path):
    command = [sys.executable, "-m", "rnc_pin", "list", "--json"]
    process = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=PATIENCE)
    assert sorted(parsed(process.stdout)) == built_in_names()


def test_nothing_is_printed_after_a_command_that_searched_a_way(tmp_path):
    """OMPL's bindings print what is not collected at the exit."""
    code = "import sys, ompl.base, rnc_pin.applications.command_line.cli as cli; sys.argv[1:] = ['list']; cli.run()"
    command = [sys.executable, "-c", code]
    process = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=PATIENCE)
    assert (process.returncode, process.stderr) == (0, "")
