"""A run as it happens, in the browser."""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

from rnc_pin.robot import Robot
from rnc_pin.visualization.scene import ACTUAL, Scene
from rnc_pin.visualization.scene_server import SceneWindow

RATE = 30.0  # pictures per second
_TRAIL_RATE = 5.0


class LiveView:
    """Shows configurations as they come, at most at display rate and no faster than real time.

    Call it with (t, q) at every sample. Pictures are handed to the server's thread, so a slow or
    closed browser does not hold the run up.

    Args:
        robot: what moves.
        trail: frames whose paths are drawn.
        camera: position of the camera in the world [m].
        target: what it looks at [m].
        ground: height of the grid [m]; None for no grid.
        speed: simulated over real time; 0 does not wait.
        open_browser: show the page at once.
    """

    def __init__(
        self,
        robot: Robot,
        trail: Sequence[str] = (),
        camera: Sequence[float] | None = None,
        target: Sequence[float] = (0.0, 0.0, 0.0),
        ground: float | None = 0.0,
        speed: float = 1.0,
        open_browser: bool = True,
    ) -> None:
        self._window = SceneWindow()
        self.scene = Scene(robot, self._window, camera, target, ground)
        self.url = self._window.serve()
        self._trail, self._speed = list(trail), speed
        self._path: list[np.ndarray] = []
        self._started: float | None = None
        self._next_picture = self._next_trail = 0.0
        if open_browser:
            self._window.open()

    def wait_for_browser(self, patience: float) -> bool:
        """Wait up to ``patience`` [s] until a browser looks on."""
        end = time.monotonic() + patience
        while not self._window.browsers and time.monotonic() < end:
            time.sleep(0.05)
        return bool(self._window.browsers)

    def __call__(self, t: float, q: np.ndarray) -> None:
        """Show what is due at time t."""
        if t < self._next_picture:
            return
        now = time.monotonic()
        if self._started is None:
            self._started = now - (t / self._speed if self._speed > 0 else 0.0)
        if self._speed > 0:
            time.sleep(max(0.0, self._started + t / self._speed - now))
        self._next_picture = t + max(self._speed, 1.0) / RATE
        self.scene.display(q)
        if self._trail:
            self._path.append(q.copy())
            if t >= self._next_trail and len(self._path) > 1:
                self._next_trail = t + 1.0 / _TRAIL_RATE
                for name, points in self.scene.paths(np.stack(self._path), self._trail).items():
                    self.scene.draw_path(f"trail/{name}", points, ACTUAL)

    def close(self) -> None:
        """Stop serving."""
        self._window.close()
