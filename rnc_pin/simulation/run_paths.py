"""Paths of a run in the plane: bodies on the ground, and frames whose x and y are outputs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from rnc_pin.figures.ground_path import MIN_HALF_SIZE, GroundPath, GroundPaths
from rnc_pin.figures.panel import MAX_LINES
from rnc_pin.simulation.run_data import RunData

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
        elif found[same[0]].desired is None and frame.desired is not None:
            one = found[same[0]]  # the actual path is that of the point that has a goal
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
