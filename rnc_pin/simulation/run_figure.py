"""Figure of a run of any system: its paths from above, and its panels over time.

Paths are those of bodies on the ground, and of frames whose x and y are outputs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rnc_pin.errors import InputError
from rnc_pin.figures.ground_path import MIN_HALF_SIZE, GroundPath, GroundPaths, draw_paths
from rnc_pin.figures.panel import MAX_LINES, Labels, Sheet, Size
from rnc_pin.figures.panel_figure import PlaneView, panel_figure
from rnc_pin.figures.style import LegendEntry
from rnc_pin.simulation.run_data import RunData
from rnc_pin.simulation.run_panels import QUANTITIES, TOP_VIEW, Others, panels

_ALL = slice(None)
_SAME_PATH = 1e-3  # largest distance between two paths that count as one, over the extent


def ground_paths(run: RunData) -> list[GroundPath]:
    """Paths of a top view: bodies on the ground, and frames whose x and y are outputs.

    If no body is on the ground, a frame counts only if its z is not an output.
    """
    poses = [run.ground_poses[:, start : start + 3] for start in range(0, run.ground_poses.shape[1], 3)]
    bodies = [
        GroundPath(name, pose[:, :2], pose[:, 2] if np.isfinite(pose[:, 2]).all() else None)
        for name, pose in zip(run.info.outputs.ground_poses, poses, strict=True)
    ]
    frames = _frames(run, bodies)
    scale = max([MIN_HALF_SIZE, *(each.extent for each in (*bodies, *frames))])
    found = list(bodies)
    for frame in frames:
        # A leaning body is drawn at another point than its frame but is the same body.
        same = [
            k
            for k, body in enumerate(found)
            if body.name == frame.name or np.abs(body.points - frame.points).max() < _SAME_PATH * scale
        ]
        if not same:
            found.append(frame)
        elif (one := found[same[0]]).desired is None and (frame.desired is not None or one.name == frame.name):
            # the actual path is that of the point that has a goal or the name, not that of the contact
            found[same[0]] = GroundPath(one.name, frame.points, one.headings, frame.desired)
    return found[:MAX_LINES]


def _frames(run: RunData, bodies: Sequence[GroundPath]) -> list[GroundPath]:
    columns = {
        name: (kind, column)
        for kind in ("x1", "x2")
        for column, name in enumerate(run.info.outputs.of(kind).names)
        if run.info.outputs.of(kind).units[column] == "m"
        and not run.info.outputs.of(kind).is_integral(column)  # integrals along a body's own axes are no place
    }
    found = []
    for name, (kind, column) in columns.items():
        frame = name.removesuffix("_x")
        if frame == name or f"{frame}_y" not in columns or (not bodies and f"{frame}_z" in columns):
            continue
        pair = [(kind, column), columns[f"{frame}_y"]]
        points, desired = (
            np.column_stack([getattr(run, kind + ending)[:, column] for kind, column in pair])
            for ending in ("", "_desired")
        )
        has_goal = f"{frame}_x" in run.info.goals and f"{frame}_y" in run.info.goals
        found.append(GroundPath(frame, points, None, desired if has_goal else None))
    return found


def compared_paths(run: RunData, others: Mapping[str, RunData]) -> GroundPaths:
    """Paths of a run with its planned path, and those of other runs by label."""
    plan = run.info.provenance.path
    planned = None if plan is None else np.array(plan.poses)[:, :2]
    return GroundPaths(ground_paths(run), planned, {label: ground_paths(other) for label, other in others.items()})


def plot_run(
    run: RunData,
    outputs: Sequence[str] | str | None,
    title: str | None,
    comparisons: Others,
    size: Size | None,
    labels: Mapping[str, str],
    name: str | None,
    part: slice = _ALL,
) -> Figure:
    """Figure of ``Trajectory.plot``, which has the same arguments, or of a part of its panels."""
    if len(run.time) < 2:
        raise InputError(f"the run has too few samples to plot: {len(run.time)}, expected at least 2")
    sheet, texts, own = Sheet.of(size), Labels(labels), name or run_name(run, comparisons)
    if labels:
        texts.check([own, *_label_names(run, comparisons)])
    paths = compared_paths(run, comparisons)

    def draw(axes: Axes) -> Sequence[LegendEntry]:
        return draw_paths(axes, paths, texts, own)

    drawn = PlaneView(draw, paths.aspect()) if paths.own and not part.start else None
    chosen = None
    if outputs is not None:
        given = [outputs] if isinstance(outputs, str) else list(outputs)
        if not given:
            raise InputError("outputs: expected at least one name; leave it out to plot all")
        chosen = [each for each in given if each != TOP_VIEW]
        if TOP_VIEW not in given:
            drawn = None
        elif drawn is None:
            raise InputError(f"outputs: the run has no {TOP_VIEW}: no body on the ground, no frame with x and y")
    shown, times = panels(run, comparisons, chosen)[part], {label: each.time for label, each in comparisons.items()}
    if not shown and drawn is None:
        return Figure()  # no panel is in this part
    return panel_figure(shown, run.time, sheet, title=title, labels=texts, name=own, compared=times, view=drawn)


def run_name(run: RunData, comparisons: Others) -> str:
    """Legend entry of a run beside others: the name of its scenario if no other run has it."""
    name = (run.info.provenance.scenario or "this run").replace("-", " ")
    return name if name not in comparisons else "this run"


def _label_names(run: RunData, comparisons: Others) -> list[str]:
    """Names that labels of the figures of a run can replace: axes, lines, paths and runs."""
    words = [word for make in QUANTITIES.values() for panel in make(run, comparisons) for word in panel.words]
    outputs, origin = run.info.outputs, run.info.provenance
    named = [*outputs.x2.names, *outputs.x1.names, *outputs.T, *origin.estimates, *origin.predicted]
    paths = [path.name for path in compared_paths(run, comparisons).own]
    return [*named, *words, *paths, *comparisons, *_FIXED]


_FIXED = ("time", "desired", "planned path", "goal", "x", "y")
