"""Pages and videos of ``rnc-pin replay``, and its refusals."""

import os
from pathlib import Path

import pytest

from rnc_pin.applications.scenario.execution import execute
from rnc_pin.applications.scenario.scenario import Scenario

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
    other, page = runs["space-robot"] / "trajectory_platform_uncontrolled.npz", tmp_path / "both.html"
    status, out, error = call("replay", runs["space-robot"], other, "--html", page)
    assert (status, error) == (0, "")
    assert out == f"wrote {page} ({page.stat().st_size / 1e6:.1f} MB)\n"
    status, _, error = call("replay", runs["space-robot"], runs["fire-truck"], "--html", tmp_path / "no.html")
    assert status == 2
    assert "fire-truck: is of robot 'fire_truck'" in error
    assert "one scene shows one robot" in error


@pytest.mark.parametrize(("video", "words"), [
    ("run.avi", "run.avi: expected a name that ends in .mp4 or .gif"),
    ("nowhere/run.mp4", "--video nowhere/run.mp4: folder"),
    (".", "--video .: is a folder, expected a file"),
])  # fmt: skip
def test_what_cannot_be_written_is_one_line(video, words, run, call, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    status, out, error = call("replay", run, "--video", video)
    assert (status, out) == (2, "")
    assert words in error
    assert len(error.splitlines()) == 1


def test_files_are_whole_and_nothing_of_others_is_written(run, call, tmp_path, monkeypatch):
    place, mine = tmp_path / "run.html", tmp_path / "mine"
    mine.write_text("mine")
    for target in (mine, tmp_path / "nowhere"):  # links are not followed, also those that lead nowhere
        place.symlink_to(target)
        assert call("replay", run, "--html", place)[0] == 2
        assert place.is_symlink()
        assert call("replay", run, "--html", place, "--force")[0] == 0
        assert not place.is_symlink()
        place.unlink()
    assert mine.read_text() == "mine"
    assert not (tmp_path / "nowhere").exists()
    os.mkfifo(place)
    status, _, error = call("replay", run, "--html", place, "--force")
    assert (status, error.count("\n")) == (2, 1)
    assert "is not a regular file" in error
    place.unlink()

    link, names = os.link, os.listdir(tmp_path)

    def late(source, target):  # somebody is quicker
        Path(target).write_text("mine")
        link(source, target)

    monkeypatch.setattr(os, "link", late)
    status, _, error = call("replay", run, "--html", place)
    assert (status, error.count("\n")) == (2, 1)
    assert "cannot be written: File exists" in error
    assert (place.read_text(), sorted(os.listdir(tmp_path))) == ("mine", sorted({*names, place.name}))
