"""Viewer of live runs: the page of Meshcat with the scene and the overlay."""

from __future__ import annotations

import time

import numpy as np

from rnc_pin.simulation import RunInfo
from rnc_pin.visualization.browser.command_socket import Receiver
from rnc_pin.visualization.browser.drawing_commands import SceneWindow
from rnc_pin.visualization.drawn_model import DrawnModel
from rnc_pin.visualization.drawn_state import DrawnState
from rnc_pin.visualization.meshcat_scene import MeshcatScene
from rnc_pin.visualization.run_scene import RunScene, ShownRun
from rnc_pin.visualization.view import View

_VALUES_RATE = 10.0  # updates of the overlay per second


class MeshcatViewer:
    """Meshcat page served by this process.

    Args:
        drawn_model: robot to show, and its reduced model; only the drawing thread may use it.
        view: view options.
        info: information on the run.
        host: address to serve on.
        title: title of the page.
        receive: function for the messages of the page's user; see ``SceneServer``.
    """

    def __init__(
        self,
        drawn_model: DrawnModel,
        view: View,
        info: RunInfo,
        host: str,
        title: str,
        receive: Receiver | None = None,
    ) -> None:
        self._model, self._view, self._info = drawn_model, view, info
        self.window = SceneWindow(title)
        self.scene = MeshcatScene(self.window)
        self._run_scene: RunScene | None = None
        self._next_values = 0.0
        self.url = self.window.serve(host=host, receive=receive)

    @property
    def browsers(self) -> int:
        """Number of connected browsers."""
        return self.window.browsers

    def open(self) -> None:
        """Show the page in the user's browser."""
        self.window.open()

    def draw(self, state: DrawnState) -> None:
        """Draw a state; the first state creates the scene."""
        if self._run_scene is None:
            # The first command shows which outputs have goals.
            goals = self._info.goals or [
                name
                for kind, desired in (("x1", state.x1_desired), ("x2", state.x2_desired))
                for name, value in zip(self._info.outputs.of(kind).names, desired, strict=False)
                if np.isfinite(value)
            ]
            self._run_scene = RunScene(ShownRun(self._model, self._info, goals), self._view, self.scene, state)
            title = self.window.title if self.window.title != "rnc_pin" else ""
            self.scene.overlay(title, self._run_scene.overlay.labels(), self._run_scene.legend())
        now = time.monotonic()
        with self.window.batched():
            self._run_scene.update(state)
            if now >= self._next_values:
                self._next_values = now + 1.0 / _VALUES_RATE
                self.scene.overlay_values(*self._run_scene.overlay.values(state))

    def close(self) -> None:
        """Stop serving."""
        self.window.close()
