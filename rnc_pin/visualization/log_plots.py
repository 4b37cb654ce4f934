"""Measured log beside a model: plots, and a page with the measured robot as a ghost."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rnc_pin.figures.ground_path import GroundPath, GroundPaths, draw_paths
from rnc_pin.figures.panel import MAX_LINES, Labels, Panel, Series
from rnc_pin.figures.panel_figure import PlaneView, panel_figure
from rnc_pin.figures.sheet import Sheet, Size
from rnc_pin.figures.style import LegendEntry
from rnc_pin.identification.comparison import Comparison
from rnc_pin.robots.robot import Robot
from rnc_pin.simulation import Trajectory
from rnc_pin.visualization.recording import Recording
from rnc_pin.visualization.view import View


def plot_comparison(found: Comparison, size: Size | None = None, labels: Labels | None = None) -> Figure:
    """Plot a measured log beside a model: paths from above, their distance, slip of the rows, and the power balance.

    Args:
        found: comparison of the log with the model.
        size: "column" or "page" of a paper, or width and height [inches]; for the screen by default.
        labels: texts that replace names.

    Raises:
        InputError: the panels do not fit the size.
    """
    replay, texts = found.replay, labels or Labels()
    paths = GroundPaths(
        [GroundPath("base", replay.predicted[:, :2])],
        compared={"measured": [GroundPath("base", replay.measured[:, :2])]},
    )

    def draw(axes: Axes) -> Sequence[LegendEntry]:
        return draw_paths(axes, paths, texts, "predicted")

    slip = [Series(name, values, time=time) for name, (time, values) in replay.slip.items() if name in found.slip]
    panels = [Panel("distance", "m", (Series("distance", replay.error),), bottom=0.0)]
    panels += [Panel("slip", "m/s", tuple(slip[k : k + MAX_LINES]), zero=True) for k in range(0, len(slip), MAX_LINES)]
    if found.energy is not None:
        energy = found.energy
        parts = {"work": energy.work, "change of energy": energy.change, "residual": energy.residual}
        series = tuple(Series(name, values, time=energy.time) for name, values in parts.items())
        panels.append(Panel("energy in a second", "J", series, zero=True))
    view = PlaneView(draw, paths.aspect())
    return panel_figure(panels, replay.time, Sheet.of(size), title=found.conclusion, labels=texts, view=view)


def record_comparison(robot: Robot, found: Comparison, view: View | None = None, title: str = "rnc_pin") -> Recording:
    """Return the animation of the predicted motion, with the measured robot as a ghost.

    Args:
        robot: robot of the model.
        found: comparison of a log with the model.
        view: view options; by default with the path of the base.
        title: title of the page.

    Raises:
        ModelError: the robot has no visual geometry.
    """
    replay, model, options = found.replay, robot.model, view or View()
    base, measured = model.joints[1].idx_q, replay.q.copy()
    x, y, heading = replay.measured.T
    measured[:, base : base + 4] = np.column_stack([x, y, np.cos(heading), np.sin(heading)])
    predicted, ghost = (
        Trajectory.of_motion(robot, replay.time - replay.time[0], motion) for motion in (replay.q, measured)
    )
    bodies = (each.name for each in model.frames if each.parentJoint == 1 and each.name != "root_joint")
    options = replace(options, trail=options.trail or [*bodies][:1])
    return Recording(robot, predicted, options, title, {"measured": ghost})
