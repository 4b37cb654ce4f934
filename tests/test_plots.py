"""Plots: printed, interactive, compared; and pictures and videos of recordings."""

import os
import shutil
import subprocess
from dataclasses import fields, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import yaml
from matplotlib import image
from matplotlib.colors import to_rgb
from matplotlib.text import Text

import rnc_pin as rnc
from browsing import PATIENCE, changed, opened, visit
from rnc_pin.scenario.run import execute, plan
from rnc_pin.visualization import capture, plot_style
from rnc_pin.visualization.interactive import write_plots
from rnc_pin.visualization.plots import plot_learning, plot_outputs, plot_overview, plot_run
from rnc_pin.visualization.recording import Recording


@pytest.fixture(scope="module")
def run():
    """One second of the paper's figure 4."""
    options = {"simulation.duration": 1.0, "simulation.dt": 0.01, "comparisons": {}}
    return execute(plan("space-robot", options)).trajectory


def ink(path):
    """Share of pixels that are not white, of a PNG."""
    assert path.read_bytes().startswith(b"\x89PNG\r\n\x1a\n")
    return float((image.imread(path)[..., :3] < 0.99).any(axis=-1).mean())


def test_no_title_of_a_scenario_is_cut_off(run):
    """The longest, broken into lines, is within the picture."""
    builtin = Path(rnc.__file__).parent / "scenario" / "builtin"
    titles = [yaml.safe_load(path.read_text())["title"] for path in builtin.glob("*.yaml")]
    figure = plot_overview(run, max(titles, key=len))
    figure.draw_without_rendering()
    shown = figure.axes[0].get_title(loc="left")
    assert shown.replace("\n", " ").replace("\\", "") == max(titles, key=len)
    extent = next(text for text in figure.findobj(Text) if text.get_text() == shown).get_window_extent()
    assert 0 <= extent.x0 <= extent.x1 <= figure.bbox.width


def test_a_plot_of_outputs(run, tmp_path):
    path = plot_style.save(plot_outputs(run, ["tip_x", "tip_y", "platform"], "Tip & platform"), tmp_path / "plot.png")
    assert image.imread(path).shape[:2] == (720, 1280)
    assert 0.02 < ink(path) < 0.5


def test_an_overview(run, tmp_path):
    path = plot_style.save(plot_overview(run, "All"), tmp_path / "overview.png")
    assert image.imread(path).shape[:2] == (1280, 1280)
    assert 0.02 < ink(path) < 0.5


def test_every_comparison_is_drawn(run, tmp_path):
    others = {f"run {k}": replace(run, x2=run.x2 + 0.1 * k) for k in range(1, 6)}
    shots = []
    for count in range(6):
        shown = dict(list(others.items())[:count])
        path = plot_style.save(plot_outputs(run, ["tip_x"], comparisons=shown), tmp_path / f"{count}.png")
        shots.append(image.imread(path)[..., :3])
    assert [count for count, (one, other) in enumerate(pairwise(shots), 1) if changed(one, other) < 1000] == []


def test_any_run_plots_itself(run):
    figure = run.plot("Space robot", {"slower": run})
    labels = [axes.get_ylabel() for axes in figure.axes]
    assert labels == ["position [m]", "angle [rad]", "tracking error", "input [N, N m]", "singularity\nmargin [-]"]
    assert figure.axes[-1].get_xlabel() == "time [s]"
    drawn = {line.get_label(): line for line in figure.axes[0].get_lines()}
    np.testing.assert_array_equal(drawn["tip x"].get_ydata(), run.x2[:, 0])
    assert figure._repr_png_().startswith(b"\x89PNG")
    labelled = [text.get_text() for text in figure.axes[0].get_legend().get_texts()]
    assert labelled == ["tip x", "tip y", "desired", "slower"]


def test_a_run_plots_itself_with_another_library(run):
    pytest.importorskip("plotly")
    assert run.plot("Space robot", backend="plotly").layout.title.text == "Space robot"
    with pytest.raises(rnc.ConfigurationError, match=r"no plotting backend 'plotli'; did you mean 'plotly'\?"):
        run.plot(backend="plotli")


def test_what_is_learnt_is_plotted():
    options = {"simulation.duration": 0.2, "simulation.dt": 0.01, "comparisons": {}}
    learning = execute(plan("space-robot-uncertain", options)).trajectory
    labels = [axes.get_ylabel() for axes in learning.plot().axes]
    assert any(label.startswith("estimate [") for label in labels)
    assert any(label.startswith("measured less\npredicted rate [") for label in labels)
    assert len(plot_learning(learning, "estimates").axes[0].get_lines()) == 3


def test_series_differ_without_colour(run):
    """In grey, and for people who see colours differently: marker and lightness tell series apart."""
    lines = [line for line in plot_outputs(run, ["tip_x", "tip_y", "platform"]).axes[0].get_lines() if
             line.get_marker() != "None"]  # fmt: skip
    assert len({line.get_marker() for line in lines}) == len(lines) == 3
    grey = [float(np.dot(to_rgb(color), [0.299, 0.587, 0.114])) for color in plot_style.COLORS]
    assert min(abs(one - other) for one, other in pairwise(grey)) > 0.05


def test_a_run_of_one_sample_has_nothing_to_plot(run):
    short = replace(run, **{each.name: getattr(run, each.name)[:1] for each in fields(run) if each.name != "info"})
    with pytest.raises(rnc.InputError, match="a run of 1 samples has nothing to plot"):
        plot_run(short)


@pytest.mark.parametrize("ending", ["png", "pdf", "svg"])
def test_plots_are_written_by_their_ending(run, tmp_path, ending):
    path = write_plots(run, tmp_path / f"plots.{ending}", "Run")
    assert path.read_bytes()[:5] in (b"\x89PNG\r", b"%PDF-", b"<?xml")
    with pytest.raises(rnc.ConfigurationError, match=r"ends in .png, .pdf, .svg or .html"):
        write_plots(run, tmp_path / "plots.doc", "Run")


def test_interactive_plots_work_offline(run, tmp_path):
    path = write_plots(run, tmp_path / "plots.html", "Run", {"other": run})
    with opened() as browser:
        page, problems = visit(browser, path.as_uri(), offline=True)
        page.wait_for_selector(".main-svg", timeout=1000 * PATIENCE)
        names = page.evaluate("[...document.querySelectorAll('.legendtext')].map(each => each.textContent)")
        assert {"tip x", "tip x, desired", "tip x (other)", "input joint 1"} <= set(names)
        assert page.evaluate("document.querySelectorAll('.scatterlayer .trace').length") >= 10
        assert problems == []


# ---------------------------------------------------------------------- pictures and videos


@pytest.fixture(scope="module")
def recording(run):
    return Recording(rnc.Robot.from_urdf("space_robot.urdf"), run)


@pytest.fixture
def chromium():
    with opened():
        pass


def test_frames_show_the_robot_moving(recording, tmp_path, chromium):
    written = capture.write_frames(recording, tmp_path / "frames", rate=2.0, size=(320, 240))
    assert [path.name for path in written] == ["frame_00000.png", "frame_00001.png", "frame_00002.png"]
    first, last = image.imread(written[0])[..., :3], image.imread(written[-1])[..., :3]
    assert first.shape == (240, 320, 3)
    assert changed(first, last) > 50


@pytest.mark.parametrize("ending", ["mp4", "gif"])
def test_a_video_has_the_runs_length(recording, tmp_path, chromium, ending):
    if shutil.which("ffmpeg") is None:
        if os.environ.get("CI"):
            pytest.fail("ffmpeg is not installed")
        pytest.skip("ffmpeg is not installed")
    path = capture.write_video(recording, tmp_path / f"run.{ending}", rate=5.0, size=(320, 240))
    assert [each.name for each in tmp_path.iterdir()] == [path.name]
    asked = ["-show_entries", "stream=nb_read_frames,width,height", "-count_frames", "-of", "csv=p=0", str(path)]
    told = subprocess.run(["ffprobe", "-v", "error", *asked], capture_output=True, text=True, check=True)
    assert told.stdout.strip().split(",") == ["320", "240", "6"]


def test_what_is_missing_is_named(recording, tmp_path, monkeypatch):
    monkeypatch.setattr(capture.shutil, "which", lambda name: None)
    with pytest.raises(rnc.ConfigurationError, match="needs ffmpeg, which is not installed"):
        capture.write_video(recording, tmp_path / "run.mp4")
    with pytest.raises(rnc.ConfigurationError, match="no browser: none of chromium"):
        capture.write_frames(recording, tmp_path / "frames")
    with pytest.raises(rnc.ConfigurationError, match=r"ends in .mp4 or .gif"):
        capture.write_video(recording, tmp_path / "run.avi")
    assert list(tmp_path.iterdir()) == []
