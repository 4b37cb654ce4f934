"""A trajectory as one HTML file that plays anywhere, offline."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from pathlib import Path

import numpy as np
import pinocchio as pin

from rnc_pin.robot import Robot
from rnc_pin.simulation import Trajectory
from rnc_pin.visualization.scene import Scene

RATE = 25.0  # frames per second


def sample_configurations(robot: Robot, trajectory: Trajectory, rate: float = RATE) -> np.ndarray:
    """Configurations (frames, nq) at an even rate, interpolated on the manifold."""
    time = trajectory.time
    wanted = np.arange(0.0, time[-1] + 0.5 / rate, 1.0 / rate).clip(max=time[-1])
    index = np.clip(np.searchsorted(time, wanted, side="right") - 1, 0, max(len(time) - 2, 0))
    frames = []
    for t, i in zip(wanted, index, strict=True):
        j = min(i + 1, len(time) - 1)
        fraction = 0.0 if time[j] <= time[i] else float((t - time[i]) / (time[j] - time[i]))
        frames.append(pin.interpolate(robot.model, trajectory.q[i], trajectory.q[j], fraction))
    return np.stack(frames)


def record_html(
    robot: Robot,
    trajectory: Trajectory,
    path: str | Path,
    trail: Sequence[str] = (),
    camera: Sequence[float] | None = None,
    target: Sequence[float] = (0.0, 0.0, 0.0),
    ground: float | None = 0.0,
    title: str = "rnc_pin",
) -> Path:
    """Write an animation that needs nothing but a browser.

    Args:
        robot: what moved.
        trajectory: how it moved.
        path: of the HTML file.
        trail: frames whose paths are drawn.
        camera: position of the camera in the world [m].
        target: what it looks at [m].
        ground: height of the grid [m]; None for no grid.
        title: of the page.
    """
    scene = Scene(robot, camera=camera, target=target, ground=ground)
    scene.animate(sample_configurations(robot, trajectory), RATE, trail)
    html = scene.window.get_scene().replace("<title> MeshCat </title>", "<title>MeshCat</title>")
    html = html.replace("<title>MeshCat</title>", f"<title>{escape(title)}</title>")
    path = Path(path)
    partial = path.with_name(path.name + ".partial")
    partial.write_text(html.strip(), encoding="utf-8")
    partial.replace(path)
    return path
