"""``rnc-pin replay`` with several runs, and what it writes besides the page."""

import pytest

SHORT = ["--set", "simulation.duration=0.5", "--set", "simulation.dt=0.01"]


@pytest.fixture
def runs(call, tmp_path):
    folders = {name: tmp_path / name for name in ("space-robot", "fire-truck")}
    for name, folder in folders.items():
        assert call("run", name, "--out", folder, *SHORT)[0] == 0
    return folders


def test_runs_are_compared_by_name(runs, call, tmp_path):
    other = runs["space-robot"] / "trajectory_platform_uncontrolled.npz"
    page, plot = tmp_path / "both.html", tmp_path / "both.png"
    status, out, error = call("replay", runs["space-robot"], other, "--html", page, "--plot", plot, "--aside")
    assert (status, error) == (0, "")
    assert out.splitlines() == [f"wrote {page} ({page.stat().st_size / 1e6:.1f} MB)", f"wrote {plot}"]
    assert plot.stat().st_size > 10_000
    status, _, error = call("replay", runs["space-robot"], runs["fire-truck"], "--html", tmp_path / "no.html")
    assert status == 2
    assert "fire-truck: is of robot 'fire_truck'" in error
    assert "one scene shows one robot" in error


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--video", "run.avi"], "run.avi: expected a name that ends in .mp4 or .gif"),
        (["--plot", "run.doc"], "run.doc: expected a name that ends in .png, .pdf, .svg or .html"),
        (["--frames", "."], "--frames .: is there and not empty"),
        (["--video", "nowhere/run.mp4"], "--video nowhere/run.mp4: there is no folder"),
        (["--plot", "."], "--plot .: is a folder, expected a file"),
    ],
)
def test_what_cannot_be_written_is_one_line(arguments, words, runs, call, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    status, out, error = call("replay", runs["space-robot"], *arguments)
    assert (status, out) == (2, "")
    assert words in error
    assert len(error.splitlines()) == 1
