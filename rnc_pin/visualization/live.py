"""Live view of a run in the browser."""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Mapping

import numpy as np

from rnc_pin.errors import RncError
from rnc_pin.io.json import Json
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.robots.robot import Robot
from rnc_pin.simulation import Provenance, RunInfo, Sample
from rnc_pin.simulation.run_info import provenance_of
from rnc_pin.visualization.browser.page import LOOPBACK
from rnc_pin.visualization.browser.scene_server import ControlPanel, SceneWindow
from rnc_pin.visualization.drawn_state import DrawnModel, DrawnState, View, live_state
from rnc_pin.visualization.meshcat_scene import MeshcatScene
from rnc_pin.visualization.run_scene import RunScene, ShownRun
from rnc_pin.visualization.scene_bodies import check_drawable

RATE = 30.0  # frames per second


class LiveView:
    """Live view that shows samples at most at display rate and no faster than real time times ``speed``.

    Use it as the ``observer`` of ``simulate``. The loop hands a sample to the drawing thread and continues. It never
    waits for that thread or the browser; samples that arrive before both are ready are not drawn.

    Args:
        model: reduced model or robot; a reduced model also shows its constraints.
        view: view options.
        meta: provenance of the coming run, as for ``simulate``; or ``info`` or ``meta`` of a run to show again.
        speed: simulated time over real time; 0 does not wait.
        open_browser: open the page immediately.
        host: address to serve on.
        title: title of the page.
        panel: panel of controls; see ``SceneServer``.

    Attributes:
        window: window of the page.
        url: address of the page.
        problem: error of the last state that was not drawn, None if it was.
    """

    def __init__(
        self,
        model: DrawnModel | ReducedModel | Robot,
        view: View | None = None,
        meta: RunInfo | Provenance | Mapping[str, Json] | None = None,
        speed: float = 1.0,
        open_browser: bool = True,
        host: str = LOOPBACK,
        title: str = "rnc_pin",
        panel: ControlPanel | None = None,
    ) -> None:
        drawn_model = DrawnModel.of(model)
        check_drawable(drawn_model.robot)
        self._model, self._speed = drawn_model.with_own_model(), speed  # the loop uses the original
        self._view, self._info = view or View(), _info(drawn_model, meta)
        self.window = SceneWindow(title)
        self.scene = MeshcatScene(self.window)
        self._run_scene: RunScene | None = None
        self._next_values = 0.0
        self.url = self.window.serve(host=host, panel=panel)
        self._started: float | None = None
        self._next = 0.0
        self._last: Sample | DrawnState | None = None
        # Only the newest sample waits: a slow browser does not delay the run, nor does the view lag behind.
        self._due: deque[Sample | DrawnState] = deque(maxlen=1)
        self._wake, self._over = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._draw, name="live view", daemon=True)
        self.problem: Exception | None = None
        self._thread.start()
        if open_browser:
            self.open()

    def wait_for_browser(self, timeout: float) -> bool:
        """Wait up to ``timeout`` [s] for a browser to connect. Return True if one is connected.

        Args:
            timeout: longest wait [s].
        """
        end = time.monotonic() + timeout
        while not self.watched and time.monotonic() < end:
            time.sleep(0.05)
        return self.watched

    @property
    def watched(self) -> bool:
        """True if a browser is connected."""
        return bool(self.window.browsers)

    @property
    def closed(self) -> bool:
        """True after ``close``."""
        return self._over.is_set()

    def open(self) -> None:
        """Show the page in the user's browser."""
        self.window.open()

    def tell(self, kind: str, content: Mapping[str, Json]) -> None:
        """Send the controls, the status or the verdict to the panel of the page: a later one replaces it.

        Args:
            kind: "controls", "status" or "verdict".
            content: JSON content.
        """
        self.window.post({"type": f"panel_{kind}", "path": "/panel", "content": content})

    def restart(self) -> None:
        """Show the next sample whatever its time is, and count real time from it."""
        self._started, self._next = None, -math.inf

    def __call__(self, sample: Sample | DrawnState) -> None:
        """Show a sample or a state, if the next frame is due at its time."""
        t = sample.time
        self._last = sample
        if t < self._next:
            return
        if self._speed > 0:
            now = time.monotonic()
            # The clock of the wall starts with the first frame: what came before it took time of its own.
            if self._started is None:
                self._started = now - t / self._speed
            time.sleep(max(0.0, self._started + t / self._speed - now))
        self._next = t + max(self._speed, 1.0) / RATE
        self._due.append(sample)
        self._wake.set()

    def draw(self, state: DrawnState) -> None:
        """Draw a state, in the drawing thread; the first state creates the scene.

        Args:
            state: the state.
        """
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
        values_rate = 10.0  # updates per second: numbers that change faster cannot be read
        with self.window.batched():
            self._run_scene.update(state)
            if now >= self._next_values:
                self._next_values = now + 1.0 / values_rate
                self.scene.overlay_values(*self._run_scene.overlay.values(state))

    def _draw(self) -> None:
        while not self._over.is_set():
            self._wake.wait()
            self._wake.clear()
            begin = time.monotonic()
            if not self._draw_due():
                return
            self._over.wait(max(0.0, 1.0 / RATE - (time.monotonic() - begin)))
        self._draw_due()

    def _draw_due(self) -> bool:
        """Draw the pending samples. Return False if drawing failed."""
        while self._due:
            try:
                self.draw(self._state(self._due.popleft()))
                self.problem = None
            except RncError as error:  # for example a singular configuration; the next state may be drawn
                self.problem = error
            except Exception as error:  # a drawing error must not stop the run
                self.problem = error
                return False
        return True

    def _state(self, sample: Sample | DrawnState) -> DrawnState:
        if isinstance(sample, DrawnState):
            return sample
        if self._model.reduced is not None:
            return live_state(self._model.reduced, sample)
        none = np.empty(0)
        return DrawnState(sample.time, sample.measurement.q, none, none, none, none, none, none, float("nan"))

    def close(self) -> None:
        """Draw the last sample, and stop serving."""
        if self._over.is_set():
            return
        if self._last is not None:
            self._due.append(self._last)
        self._over.set()
        self._wake.set()
        # A browser that no longer answers must not hold the process.
        self._thread.join(timeout=5)
        self.window.close()


def _info(drawn_model: DrawnModel, meta: RunInfo | Provenance | Mapping[str, Json] | None) -> RunInfo:
    """Run information from ``meta``, or from the model's output names before a run."""
    if isinstance(meta, RunInfo):
        return meta
    if isinstance(meta, Mapping) and "names" in meta:
        return RunInfo.from_json(meta)
    return RunInfo(drawn_model.outputs, provenance=provenance_of(meta))
