"""``rnc-pin replay`` with several runs, and what it writes besides the page."""

import os
from pathlib import Path

import pytest
from matplotlib.figure import Figure

from rnc_pin.applications.scenario.execution import execute
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.simulation import run_figure
from rnc_pin.visualization import recording

SHORT = ["--set", "simulation.duration=0.1", "--set", "simulation.dt=0.01"]


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A run that is replayed, and not changed."""
    path = tmp_path_factory.mktemp("run") / "trajectory.npz"
    options = {"simulation.duration": 0.5, "simulation.dt": 0.01, "comparisons": {}}
    execute(Scenario.load("space-robot", options)).trajectory.save(path)
    return path


def test_runs_are_compared_by_name(call, tmp_path, no_pictures):
    runs = {name: tmp_path / name for name in ("space-robot", "fire-truck")}
    for name, folder in runs.items():
        assert call("run", name, "--out", folder, *SHORT)[0] == 0
    other = runs["space-robot"] / "trajectory_platform_uncontrolled.npz"
    page, plot = tmp_path / "both.html", tmp_path / "both.png"
    status, out, error = call("replay", runs["space-robot"], other, "--html", page, "--plot", plot)
    assert (status, error) == (0, "")
    assert out.splitlines() == [f"wrote {page} ({page.stat().st_size / 1e6:.1f} MB)", f"wrote {plot}"]
    assert plot.stat().st_size > 10_000
    status, _, error = call("replay", runs["space-robot"], runs["fire-truck"], "--html", tmp_path / "no.html")
    assert status == 2
    assert "fire-truck: is of robot 'fire_truck'" in error
    assert "one scene shows one robot" in error


@pytest.mark.parametrize(("arguments", "words"), [
    (["--video", "run.avi"], "run.avi: expected a name that ends in .mp4 or .gif"),
    (["--plot", "run.doc"], "run.doc: expected a name that ends in .png, .pdf or .svg"),
    (["--video", "nowhere/run.mp4"], "--video nowhere/run.mp4: folder"),
    (["--plot", "."], "--plot .: is a folder, expected a file"),
])  # fmt: skip
def test_what_cannot_be_written_is_one_line(arguments, words, run, call, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine").touch()
    status, out, error = call("replay", run, *arguments)
    assert (status, out) == (2, "")
    assert words in error
    assert len(error.splitlines()) == 1


@pytest.fixture
def stills(monkeypatch):
    """Pictures without a browser, and empty plots; what is in them is of no interest here."""
    monkeypatch.setattr(run_figure, "plot_run", lambda *arguments: Figure(figsize=(1, 1)))
    monkeypatch.setattr(recording, "take_pictures", lambda *arguments: iter([b"one", b"two"]))


KINDS = {"--html": "run.html", "--plot": "run.png"}


@pytest.mark.parametrize("option", ["--html", "--plot"])
def test_files_are_whole_and_nothing_of_others_is_written(option, run, call, tmp_path, stills, monkeypatch):
    place, mine = tmp_path / KINDS[option], tmp_path / "mine"
    mine.write_text("mine")
    for target in (mine, tmp_path / "nowhere"):  # links are not followed, also those that lead nowhere
        place.symlink_to(target)
        assert call("replay", run, option, place)[0] == 2
        assert place.is_symlink()
        assert call("replay", run, option, place, "--force")[0] == 0
        assert not place.is_symlink()
        place.unlink()
    assert mine.read_text() == "mine"
    assert not (tmp_path / "nowhere").exists()
    os.mkfifo(place)
    status, _, error = call("replay", run, option, place, "--force")
    assert (status, error.count("\n")) == (2, 1)
    assert "is not a regular file" in error
    place.unlink()

    link, names = os.link, os.listdir(tmp_path)

    def late(source, target):  # somebody is quicker
        Path(target).write_text("mine")
        link(source, target)

    with monkeypatch.context() as patched:
        patched.setattr(os, "link", late)
        status, _, error = call("replay", run, option, place)
    assert (status, error.count("\n")) == (2, 1)
    assert "cannot be written: File exists" in error
    assert place.read_text() == "mine"
    assert sorted(os.listdir(tmp_path)) == sorted({*names, place.name})
