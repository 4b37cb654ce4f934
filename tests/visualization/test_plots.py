"""Plots: printed and compared; and pictures and videos of recordings."""

import os
import shutil
import subprocess
from dataclasses import replace

import coal
import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.path import Path as MarkerPath

import rnc_pin as rnc
from browsing import give_up
from rnc_pin.applications.scenario.execution import execute
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.figures import save
from rnc_pin.simulation.run_figure import learning_panels, panels, plot_run
from rnc_pin.visualization import recording as capture
from rnc_pin.visualization.plots import draw_footprints, draw_obstacles, footprints, plot_top_view
from rnc_pin.visualization.recording import Recording
from systems import mecanum


@pytest.fixture(scope="module")
def run():
    """One second of the paper's figure 4."""
    options = {"simulation.duration": 1.0, "simulation.dt": 0.01, "comparisons": {}}
    return execute(Scenario.load("space-robot", options)).trajectory


def test_every_comparison_is_drawn(run):
    others = {f"run {k}": replace(run, x2=run.x2 + 0.1 * k) for k in range(1, 6)}
    (axes,) = run.plot("tip_x", comparisons=others).axes[:1]
    drawn = [line.get_ydata() for line in axes.get_lines()]
    for each in others.values():
        assert any(np.array_equal(line, each.x2[:, 0]) for line in drawn)


def test_what_is_learnt_is_plotted():
    options = {"simulation.duration": 0.2, "simulation.dt": 0.01, "comparisons": {}}
    learning = execute(Scenario.load("space-robot-uncertain", options)).trajectory
    labels = [axes.get_ylabel() for axes in learning.plot().axes]
    assert any(label.startswith("estimate [") for label in labels)
    assert any(label.startswith("prediction error [") for label in labels)
    assert len(learning.plot("estimates").axes[0].get_lines()) == 3
    (panel,) = learning_panels(learning, {}, "estimates")
    assert (panel.quantity, panel.unit) == ("estimate", "kg")  # the paper counts masses in units of 10 kg
    np.testing.assert_array_equal(panel.series[1].values, 10.0 * learning.estimates[:, 1])


def test_a_second_picture_has_the_other_panels_and_no_top_view(drive):
    first, second = (plot_run(drive[0], None, None, {}, None, {}, None, part) for part in (slice(2), slice(2, None)))
    labels = [[axes.get_ylabel() for axes in each.axes] for each in (first, second)]
    assert (len(labels[0]), [*labels[0], *labels[1]]) == (3, [each.get_ylabel() for each in drive[0].plot().axes])


def test_a_run_of_one_sample_has_nothing_to_plot(run):
    short = replace(run, **{name: values[:1] for name, values in run.arrays.items()})
    with pytest.raises(rnc.InputError, match="too few samples to plot: 1, expected at least 2"):
        short.plot()


@pytest.mark.parametrize(("ending", "start"), [("png", b"\x89PNG\r"), ("pdf", b"%PDF-"), ("svg", b"<?xml")])
def test_plots_are_written_by_their_ending(tmp_path, ending, start):
    assert save(Figure(figsize=(1, 1)), tmp_path / f"plots.{ending}").read_bytes()[:5] == start
    with pytest.raises(rnc.ConfigurationError, match=r"ends in .png, .pdf or .svg"):
        save(Figure(figsize=(1, 1)), tmp_path / "plots.doc")


@pytest.fixture(scope="module")
def drive():
    """A second and a half of three trailers that turn off, and the same with another path."""
    options = {"simulation.dt": 0.01, "simulation.duration": 1.5, "reference.path.duration": 3.0, "comparisons": {}}
    short = execute(Scenario.load("tractor-trailers", options)).trajectory
    return short, execute(Scenario.load("tractor-trailers", {**options, "reference.path.to": [5, 3, 0]})).trajectory


@pytest.fixture(scope="module")
def figure(drive):
    """Plots of the first one; look at them only."""
    return drive[0].plot()


def column(run, kind, name):
    outputs = run.info.outputs.of(kind.removesuffix("_desired").replace("v2", "x2"))
    return getattr(run, kind)[:, outputs.names.index(name)]


def test_a_speed_is_no_position(drive, figure):
    """The integral of a speed is a distance, and the speed itself is shown with its reference."""
    run, _ = drive
    axes = {each.get_ylabel(): each for each in figure.axes}
    np.testing.assert_array_equal(axes["speed [m/s]"].get_lines()[0].get_ydata(), column(run, "v2", "tractor_speed_x"))
    (driven, desired) = axes["distance [m]"].get_lines()
    np.testing.assert_array_equal(driven.get_ydata(), column(run, "x2", "tractor_speed_x"))
    np.testing.assert_array_equal(desired.get_ydata(), column(run, "x2_desired", "tractor_speed_x"))
    named = [text.get_text() for text in axes["distance [m]"].get_legend().get_texts()]
    assert named == ["integral of tractor speed x", "desired"]
    position = [text.get_text() for text in axes["position [m]"].get_legend().get_texts()]
    assert not any("speed" in name for name in position)


def test_vehicles_are_seen_from_above_with_their_headings(drive):
    """Marks lie on the path and point where the body looks, which its output of yaw knows too."""
    run, _ = drive
    axes = plot_top_view(run).axes[0]
    assert (axes.get_xlabel(), axes.get_ylabel(), axes.get_aspect()) == ("x [m]", "y [m]", 1.0)
    named = [text.get_text() for text in axes.get_legend().get_texts()]
    assert named == ["planned path", "tractor", "trailer 1", "trailer 2", "trailer 3", "desired"]
    x, y = column(run, "x1", "axle_3_x"), column(run, "x1", "axle_3_y")
    lines = (each for each in axes.get_lines() if len(each.get_xdata()) == len(x))
    last = next(each for each in lines if np.allclose(each.get_xdata(), x))
    np.testing.assert_allclose(last.get_ydata(), y, atol=1e-12)
    marks = [line for line in axes.get_lines() if isinstance(line.get_marker(), MarkerPath)]
    own = [mark for mark in marks if mark.get_color() == last.get_color()]
    assert len(own) > 5
    for mark in own:
        sample, *_ = np.flatnonzero((x == mark.get_xdata()[0]) & (y == mark.get_ydata()[0]))
        tip = mark._marker.get_user_transform().transform((1.0, 0.0))
        yaw = column(run, "x1", "trailer_3_yaw")[sample]
        np.testing.assert_allclose(tip, [np.cos(yaw), np.sin(yaw)], atol=1e-12)


def test_no_panel_has_more_lines_than_can_be_told_apart(drive):
    run, other = drive
    for others in ({}, {"one": other}, {"one": other, "two": other}):
        for panel in panels(run, others):
            assert 1 <= len(panel.series) <= 6
            assert len(panel.series) * (1 + len(panel.series[0].compared)) <= 6
            assert len({each.name for each in panel.series}) == len(panel.series)


def test_of_a_hundred_joints_those_are_shown_that_move_most(run):
    """A humanoid with hands: three panels of angles, and a word about the others."""
    names = tuple(f"joint_{k}" for k in range(100))
    columns = replace(run.info.outputs.x2, names=names, units=("rad",) * 100, angular=(False,) * 100, quasi=())
    x2 = np.linspace(0.0, 1.0, len(run.time))[:, None] * np.arange(100)
    info = replace(run.info, outputs=replace(run.info.outputs, x2=columns), goals=())
    none = dict.fromkeys(("x2_desired", "v2", "v2_desired", "F"), np.full_like(x2, np.nan))
    crowd = replace(run, info=info, x2=x2, **none)
    angles = [panel for panel in panels(crowd, {}) if panel.quantity == "angle"]
    assert [panel.note for panel in angles] == ["18 of 101, moving most"] * 3
    assert [each.name for panel in angles for each in panel.series] == [f"joint_{k}" for k in range(82, 100)]


@pytest.fixture(scope="module")
def recording(run):
    return Recording(rnc.Robot.from_urdf("space_robot.urdf"), run)


@pytest.fixture(scope="module")
def chromium():
    pytest.importorskip("playwright", reason="playwright is an optional extra and not installed")
    if not any(map(shutil.which, capture.BROWSERS)):
        give_up("no browser is installed")


@pytest.fixture(scope="module")
def pictures(recording, chromium):
    """Arguments of the pictures that ``write_video`` takes, and the pictures."""
    times, size = [0.0, 0.5, 1.0], (320, 240)
    return (times, size, "jpeg"), list(capture.take_pictures(recording, times, size, "jpeg"))


@pytest.mark.parametrize("ending", ["mp4", "gif"])
def test_a_video_has_the_runs_length(recording, pictures, tmp_path, monkeypatch, ending):
    if shutil.which("ffmpeg") is None:
        if os.environ.get("CI"):
            pytest.fail("ffmpeg is not installed")
        pytest.skip("ffmpeg is not installed")
    asked_for, taken = pictures
    asked = []
    monkeypatch.setattr(capture, "take_pictures", lambda _, *which: asked.append(which) or taken)
    path = capture.write_video(recording, tmp_path / f"run.{ending}", rate=2.0, size=(320, 240))
    ((times, *others),) = asked
    assert ((list(times), *others), [each.name for each in tmp_path.iterdir()]) == (asked_for, [path.name])
    wanted = ["-show_entries", "stream=nb_read_frames,width,height", "-count_frames", "-of", "csv=p=0", str(path)]
    told = subprocess.run(["ffprobe", "-v", "error", *wanted], capture_output=True, text=True, check=True)
    assert told.stdout.strip().split(",") == ["320", "240", "3"]


def test_what_is_missing_is_named(recording, tmp_path, monkeypatch):
    monkeypatch.setattr(capture.shutil, "which", lambda name: None)
    with pytest.raises(rnc.ConfigurationError, match="needs ffmpeg, which is not installed"):
        capture.write_video(recording, tmp_path / "run.mp4")
    with pytest.raises(rnc.ConfigurationError, match="no browser: none of chromium"):
        next(capture.take_pictures(recording, [0.0]))
    with pytest.raises(rnc.ConfigurationError, match=r"ends in .mp4 or .gif"):
        capture.write_video(recording, tmp_path / "run.avi")
    assert list(tmp_path.iterdir()) == []


def test_integrals_of_speeds_are_no_path_on_the_ground():
    """Of a Mecanum base, both speeds along its own axes are outputs; their integrals are metres, but no place."""
    reduced = mecanum()
    run = rnc.free_motion(reduced, reduced.robot.configuration(), [0.5, 0.2, 1.0], duration=0.2)
    assert reduced.reducing.names[:2] == ("base_speed_x", "base_speed_y")
    assert [path.name for path in rnc.simulation.ground_paths(run)] == ["root_joint"]


def area(points):
    x, y = points.T
    return 0.5 * abs(x @ np.roll(y, -1) - y @ np.roll(x, -1))


def test_outlines_move_with_the_robot_and_keep_their_area():
    robot = rnc.Robot.from_urdf("car.urdf", base="planar")
    at_origin = footprints(robot, robot.configuration())
    assert len(at_origin) == 2  # chassis and steered axle
    # Chassis with its wheels: 1.68 m long, 0.7 m wide at the wheels, 0.62 m elsewhere.
    assert np.ptp(at_origin[0], axis=0).round(3).tolist() == [1.68, 0.7]
    moved = footprints(robot, robot.configuration({"root_joint": [3.0, 1.0, np.pi / 2]}))
    for before, after in zip(at_origin, moved, strict=True):
        assert np.isclose(area(before), area(after))
    np.testing.assert_allclose(np.sort(moved[0][:, 1]), np.sort(at_origin[0][:, 0]) + 1.0, atol=1e-12)
    (entry,) = draw_footprints(Figure().subplots(), robot, np.repeat(robot.configuration()[None], 3, axis=0))
    assert entry.text == "robot"
    (post,) = draw_obstacles(Figure().subplots(), [rnc.collision.Obstacle(coal.Sphere(0.2))], np.zeros(2))
    assert post.text == "obstacles"
    assert [isinstance(each.lines[0], Patch) for each in (post, entry)] == [True, False]  # told apart in the legend
