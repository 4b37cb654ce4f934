"""A run as it happens, in the browser."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from typing import Protocol

import numpy as np

from rnc_pin.errors import RncError
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.plain import Json
from rnc_pin.robots.robot import Robot
from rnc_pin.simulation import Provenance, RunInfo, Sample
from rnc_pin.simulation.info_json import info_from_plain, provenance_of
from rnc_pin.visualization.robot_view import check_drawable
from rnc_pin.visualization.scene_server import LOOPBACK, SceneWindow
from rnc_pin.visualization.show import Show, Shown
from rnc_pin.visualization.stage import Stage
from rnc_pin.visualization.state import State, live_state
from rnc_pin.visualization.subject import Subject
from rnc_pin.visualization.view import View

RATE = 30.0  # pictures per second
_FIGURES_RATE = 10.0


class Screen(Protocol):
    """What draws states: Meshcat's page, or another visualizer's."""

    url: str

    @property
    def browsers(self) -> int: ...
    def open(self) -> None: ...
    def draw(self, state: State) -> None: ...
    def close(self) -> None: ...


class LiveView:
    """Shows samples as they come, at most at display rate and no faster than real time.

    Use it as the ``observer`` of ``simulate``. The loop leaves a sample for the thread that draws, and goes on: what
    comes before that thread or the browser is ready is not drawn, and nothing waits for either.

    Args:
        model: what moves; a reduced model shows its constraints and its null motion too.
        view: what is drawn, and from where.
        meta: where the run to come is from, as ``simulate`` takes it; ``info`` or ``meta`` of a run to be shown again.
        speed: simulated over real time; 0 does not wait.
        open_browser: show the page at once.
        host: address to serve on.
        title: of the page.
        screen: what draws; Meshcat's page by default.
    """

    def __init__(
        self,
        model: ReducedModel | Robot,
        view: View | None = None,
        meta: RunInfo | Provenance | Mapping[str, Json] | None = None,
        speed: float = 1.0,
        open_browser: bool = True,
        host: str = LOOPBACK,
        title: str = "rnc_pin",
        screen: Callable[..., Screen] | None = None,
    ) -> None:
        subject = Subject.of(model)
        check_drawable(subject.robot)
        self._subject, self._speed = subject.for_another_thread(), speed  # the loop uses this one
        self._screen = (screen or MeshcatScreen)(self._subject, view or View(), _info(subject, meta), host, title)
        self.url = self._screen.url
        self._started: float | None = None
        self._next = 0.0
        self._last: Sample | State | None = None
        self._due: deque[Sample | State] = deque(maxlen=1)
        self._wake, self._over = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._draw, name="live view", daemon=True)
        self.problem: Exception | None = None
        self._thread.start()
        if open_browser:
            self._screen.open()

    def wait_for_browser(self, patience: float) -> bool:
        """Wait up to ``patience`` [s] until a browser looks on."""
        end = time.monotonic() + patience
        while not self._screen.browsers and time.monotonic() < end:
            time.sleep(0.05)
        return bool(self._screen.browsers)

    def __call__(self, sample: Sample | State) -> None:
        """Show what is due at a sample's time, or at a state's."""
        t = sample.time
        self._last = sample
        if t < self._next:
            return
        if self._speed > 0:
            now = time.monotonic()
            if self._started is None:
                self._started = now - t / self._speed
            time.sleep(max(0.0, self._started + t / self._speed - now))
        self._next = t + max(self._speed, 1.0) / RATE
        self._due.append(sample)
        self._wake.set()

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
        """Draw what is due, and say whether to go on."""
        while self._due:
            try:
                self._screen.draw(self._state(self._due.popleft()))
            except RncError:
                continue  # a singular configuration: the run itself will say so
            except Exception as error:  # a picture that fails must not take the run along
                self.problem = error
                return False
        return True

    def _state(self, sample: Sample | State) -> State:
        if isinstance(sample, State):
            return sample
        if self._subject.reduced is not None:
            return live_state(self._subject.reduced, sample)
        none = np.empty(0)
        return State(sample.time, sample.measurement.q, none, none, none, none, none, none, float("nan"))

    def close(self) -> None:
        """Draw the last sample, and stop serving."""
        if self._over.is_set():
            return
        if self._last is not None:
            self._due.append(self._last)
        self._over.set()
        self._wake.set()
        self._thread.join(timeout=5)
        self._screen.close()


def _info(subject: Subject, meta: RunInfo | Provenance | Mapping[str, Json] | None) -> RunInfo:
    """What there is to say before a run; a model knows the names of its outputs."""
    if isinstance(meta, RunInfo):
        return meta
    if isinstance(meta, Mapping) and "names" in meta:
        return info_from_plain(meta)
    return RunInfo(subject.outputs, provenance=provenance_of(meta))


class MeshcatScreen:
    """Meshcat's page, served by this process.

    Args:
        subject: what is shown, for the drawing thread alone.
        view: how.
        info: on the run.
        host: address to serve on.
        title: of the page.
    """

    def __init__(self, subject: Subject, view: View, info: RunInfo, host: str, title: str) -> None:
        self._subject, self._view, self._info = subject, view, info
        self._window = SceneWindow(title)
        self._stage = Stage(self._window)
        self._show: Show | None = None
        self._next_figures = 0.0
        self.url = self._window.serve(host=host)

    @property
    def browsers(self) -> int:
        """How many look on."""
        return self._window.browsers

    def open(self) -> None:
        """Show the page in the user's browser."""
        self._window.open()

    def draw(self, state: State) -> None:
        """Show a state; the first one sets the stage."""
        if self._show is None:
            # Which outputs have goals is seen in the first command.
            goals = self._info.goals or [
                name
                for kind, desired in (("x1", state.x1_desired), ("x2", state.x2_desired))
                for name, value in zip(self._info.outputs.of(kind).names, desired, strict=False)
                if np.isfinite(value)
            ]
            self._show = Show(Shown(self._subject, self._info, goals), self._view, self._stage, state)
            title = self._window.title if self._window.title != "rnc_pin" else ""
            self._stage.board(title, self._show.board.labels(), self._show.legend())
        now = time.monotonic()
        with self._window.together():
            self._show.update(state)
            if now >= self._next_figures:
                self._next_figures = now + 1.0 / _FIGURES_RATE
                self._stage.figures(*self._show.board.figures(state))

    def close(self) -> None:
        """Stop serving."""
        self._window.close()
