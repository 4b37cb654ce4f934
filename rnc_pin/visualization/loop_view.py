"""Live view of a loop of one's own: states to draw, pause, single steps, and sliders for gains."""

from __future__ import annotations

import importlib
import math
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from rnc_pin.control.controller import Command
from rnc_pin.errors import InputError, RncError
from rnc_pin.io.json import Json, to_json_mapping
from rnc_pin.model.evaluation_results import Measurement
from rnc_pin.model.input_validation import is_number, vector
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.printing import Item, ObjectSummary, SummaryMixin
from rnc_pin.robots.robot import Robot
from rnc_pin.simulation import RunInfo, Sample
from rnc_pin.visualization.browser.page import LOOPBACK
from rnc_pin.visualization.browser.scene_server import ControlPanel, SceneWindow
from rnc_pin.visualization.drawn_state import DrawnModel, DrawnState, View, live_state
from rnc_pin.visualization.meshcat_scene import MeshcatScene
from rnc_pin.visualization.run_scene import RunScene
from rnc_pin.visualization.scene_bodies import check_drawable

RATE = 30.0  # frames per second


class LiveView:
    """Live view that shows samples at most at display rate and no faster than real time times ``speed``.

    Use it as the ``observer`` of ``simulate``. The loop hands a sample to the drawing thread and continues. It never
    waits for that thread or the browser; samples that arrive before both are ready are not drawn.

    Args:
        model: reduced model or robot; a reduced model also shows its constraints.
        view: view options.
        info: names and provenance of the run; by default the names of the model's outputs.
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
        info: RunInfo | None = None,
        speed: float = 1.0,
        open_browser: bool = True,
        host: str = LOOPBACK,
        title: str = "rnc_pin",
        panel: ControlPanel | None = None,
    ) -> None:
        drawn_model = DrawnModel.of(model)
        check_drawable(drawn_model.robot)
        self._model, self._speed = drawn_model.with_own_model(), speed  # the loop uses the original
        self._view, self._info = view or View(), info or RunInfo(drawn_model.outputs)
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
        # A browser takes a second to start, and a short run would be over.
        while not self.watched and time.monotonic() < end:
            time.sleep(0.05)
        return self.watched

    @property
    def watched(self) -> bool:
        """True if a browser is connected."""
        return bool(self.window.browsers)

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
        # At twice the speed, twice the simulated time passes between two frames.
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
            goals = self._info.goals or tuple(
                name
                for kind in ("x1", "x2")
                for name, value in zip(self._info.outputs.of(kind).names, state.desired(kind), strict=False)
                if np.isfinite(value)
            )
            info = replace(self._info, goals=goals)
            self._run_scene = RunScene(self._model, info, self._view, self.scene, state)
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
            # Not a sleep: closing the view ends the wait at once.
            self._over.wait(max(0.0, 1.0 / RATE - (time.monotonic() - begin)))
        self._draw_due()

    def _draw_due(self) -> bool:
        """Draw the pending samples. Return False if drawing failed."""
        while self._due:
            try:
                due = self._due.popleft()
                self.draw(due if isinstance(due, DrawnState) else live_state(self._model, due))
                self.problem = None
            except RncError as error:  # for example a singular configuration; the next state may be drawn
                self.problem = error
            except Exception as error:  # a drawing error must not stop the run
                self.problem = error
                return False
        return True

    def close(self) -> None:
        """Draw the last sample, and stop serving."""
        if self._over.is_set():
            return
        if self._last is not None:
            # The last sample may have been between two frames: a page that stays open shows the end.
            self._due.append(self._last)
        self._over.set()
        self._wake.set()
        # A browser that no longer answers must not hold the process.
        self._thread.join(timeout=5)
        self.window.close()


# ---------------------------------------------------------------------- view of a loop


Made = TypeVar("Made")

_ABSENCE = 5.0  # time without a browser after which a paused loop continues [s]; a page may be loaded again


class LoopView(SummaryMixin, LiveView, Generic[Made]):
    """Live view of a loop; ``rnc.show`` makes it.

    Attributes:
        running: True until the user ends the loop on the page, or ``close`` is called.
        paused: True while the page pauses the loop.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> with rnc.show(robot, open_browser=False) as view:
        ...     view.update(robot.configuration({"joint_1": 0.5}))
        >>> view.running, view.url.startswith("http://127.0.0.1:")
        (False, True)
    """

    def __init__(
        self,
        model: DrawnModel | ReducedModel | Robot,
        gains: Mapping[str, tuple[float, float, float]],
        controller: Callable[..., Made] | None,
        view: View | None,
        speed: float,
        title: str,
    ) -> None:
        self._ranges = {name: _admit_range(name, values) for name, values in gains.items()}
        self._gains = {name: start for name, (_, _, start) in self._ranges.items()}
        self._make = controller
        self._made = None if controller is None else controller(**self._gains)
        # A copy: the page changes the gains in the thread of its server.
        self._made_of = dict(self._gains)
        self._condition = threading.Condition()
        self.running, self.paused, self._steps, self._message = True, False, 0, ""
        self._last_time, self._begin = -math.inf, time.monotonic()
        panel = ControlPanel("loop", self._receive)
        super().__init__(model, view, speed=speed, open_browser=False, title=title, panel=panel)
        keys = ("lower", "upper", "start")
        ranges = {name: dict(zip(keys, values, strict=True)) for name, values in self._ranges.items()}
        self.tell("controls", to_json_mapping({"gains": ranges}, "controls"))
        self._tell_status()

    def __enter__(self) -> LoopView[Made]:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    # ------------------------------------------------------------------ for the loop

    def update(
        self,
        q: ArrayLike,
        v2: ArrayLike | None = None,
        *,
        t: float | None = None,
        T: ArrayLike | None = None,
        command: Command | None = None,
    ) -> None:
        """Show a state. While the page pauses the loop, this call waits; a step lets one call pass.

        Args:
            q: configuration (nq,).
            v2: reduced velocity (r,) [rad/s or m/s]; zero by default. The view needs it for forces of constraints.
            t: time of the state [s]. The loop is then no faster than real time times ``speed``; a time before the last
                one starts again. By default the time since the view was made, without a wait.
            T: actuator inputs (p,) [N or N m], for forces of constraints.
            command: command of the controller; its desired outputs are shown as goals.

        Raises:
            InputError: a wrong shape, a number that is not finite, ``v2`` or ``T`` for a robot without a reduced
                model, or the view is closed.
        """
        sample = self._sample(q, v2, t, T, command)
        # A loop that starts again, such as an episode of learning, would wait for its old time.
        if sample.time < self._last_time:
            self.restart()
        self._last_time = sample.time
        self(sample)
        if self.paused:
            self._wait(sample)

    @property
    def gains(self) -> Mapping[str, float]:
        """Present values of the sliders by name."""
        with self._condition:
            return MappingProxyType(dict(self._gains))

    @property
    def controller(self) -> Made:
        """Controller with the present gains; a new one after a slider has moved.

        A controller holds gains only, and its state is explicit. So the loop continues with the state that it has.
        If the function of the gains raises an RncError, the page shows it and the last controller remains.

        Raises:
            InputError: ``show`` got no controller.
        """
        if self._make is None or self._made is None:
            raise InputError("the view has no controller: show(..., controller=function of the gains) gives it one")
        gains = dict(self.gains)
        if gains != self._made_of:
            # Before the call: gains that are refused are not tried again at every sample.
            self._made_of = gains
            try:
                self._made, self._message = self._make(**gains), ""
            except RncError as error:
                self._message = str(error)
            self._tell_status()
        return self._made

    def open(self) -> None:
        """Show the page: in a notebook under the cell, otherwise in the user's browser."""
        # Not imported for the question: a process that has no IPython is no notebook.
        shell = sys.modules.get("IPython")
        if shell is not None and hasattr(shell.get_ipython(), "kernel"):
            importlib.import_module("IPython.display").display(self)
        else:
            super().open()

    def close(self) -> None:
        """Draw the last state, and stop serving."""
        with self._condition:
            self.running = self.paused = False
            self._condition.notify_all()
        super().close()

    # ------------------------------------------------------------------ inside

    def _sample(
        self, q: ArrayLike, v2: ArrayLike | None, t: float | None, T: ArrayLike | None, command: Command | None
    ) -> Sample:
        if not self.running and self._over.is_set():
            raise InputError("the view is closed")
        reduced = self._model.reduced
        # Checked in the caller's thread: in the drawing thread an error would reach nobody.
        configuration = vector(np.asarray(q), self._model.robot.nq, "q")
        velocity, inputs = np.empty(0), np.empty(0)
        if reduced is None:
            if v2 is not None or T is not None:
                raise InputError("a robot without a reduced model has no v2 and no T: show(reduced) has them")
        else:
            velocity = np.zeros(reduced.r) if v2 is None else vector(np.asarray(v2), reduced.r, "v2")
            # Without a velocity, the forces of constraints would be those at rest.
            known = T is not None and v2 is not None
            inputs = vector(np.asarray(T), reduced.p, "T") if known else np.full(reduced.p, np.nan)
        at = time.monotonic() - self._begin if t is None else float(t)
        if not math.isfinite(at):
            raise InputError(f"t has to be finite, found {t}")
        return Sample(at, Measurement(q=configuration, v2=velocity), command or Command(), inputs)

    def _wait(self, sample: Sample) -> None:
        """Show exactly this state, and wait until the page continues, takes a step, ends the loop, or is gone."""
        # The state of a pause is shown whether or not a frame was due.
        self.restart()
        self(sample)
        begin = seen = time.monotonic()
        poll = 0.1  # period at which a paused loop looks for a browser [s]
        with self._condition:
            while self.paused and not self._steps:
                self._condition.wait(poll)
                if self.watched:
                    seen = time.monotonic()
                elif time.monotonic() - seen > _ABSENCE:
                    self.paused = False
            self._steps = max(0, self._steps - 1)
        # The loop's own time stands still while it waits.
        self._begin += time.monotonic() - begin
        self.restart()

    def _receive(self, message: object) -> None:
        """Take a message of the page; anything that the page does not send is ignored."""
        if not isinstance(message, dict):
            return
        kind, name, value = (message.get(key) for key in ("kind", "name", "value"))
        with self._condition:
            # Each field is checked: another program of this user may send anything.
            if kind == "pause" and isinstance(value, bool):
                self.paused, self._steps = value and self.running, 0
            elif kind == "step" and self.paused:
                self._steps += 1
            elif kind == "end":
                self.running = self.paused = False
            elif kind == "gain" and isinstance(name, str) and name in self._ranges:
                lower, upper, _ = self._ranges[name]
                if is_number(value) and lower <= value <= upper:
                    self._gains[name] = float(value)
            self._condition.notify_all()
        self._tell_status()

    def _tell_status(self) -> None:
        messages = [*([] if self.running else ["the loop ends"]), *filter(None, [self._message])]
        status = {"paused": self.paused, "messages": messages, "values": self._gains}
        self.tell("status", to_json_mapping(status, "status"))

    def _summary(self) -> ObjectSummary:
        state = "paused" if self.paused else "running" if self.running else "ended"
        gains = [Item(name, f"{value:.4g}") for name, value in self.gains.items()]
        title = f"LoopView of '{self._model.robot.name}': {state}, {self.url}"
        return ObjectSummary(title, [("gains", gains)] if gains else [])

    def _repr_html_(self) -> str:
        return f'<iframe src="{self.url}" style="width: 100%; height: 560px; border: 0"></iframe>'


def show(
    model: DrawnModel | ReducedModel | Robot,
    *,
    gains: Mapping[str, tuple[float, float, float]] | None = None,
    controller: Callable[..., Made] | None = None,
    view: View | None = None,
    speed: float = 1.0,
    title: str = "rnc_pin",
    open_browser: bool = True,
) -> LoopView[Made]:
    """Show a loop of your own in a browser or a notebook, with pause, single steps and sliders.

    The page is on this computer only. The loop never waits for drawing: states that come too fast are not drawn.

    Args:
        model: reduced model or robot; a reduced model also shows its constraints.
        gains: sliders by name: smallest value, largest value, and value at the start.
        controller: function of the gains, by name, that returns a controller; ``view.controller`` is its result for
            the present gains.
        view: view options.
        speed: simulated time over real time, for states with a time; 0 does not wait.
        title: title of the page.
        open_browser: True to show the page immediately; in a notebook it is under the cell.

    Raises:
        InputError: the range of a gain is no range, or its start is outside.
        ModelError: the robot has no geometry.

    Example:
        >>> import pinocchio as pin
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")]).reduce()
        >>> q, v2 = robot.configuration({"joint_2": 1.0}), np.array([0.0, 0.1, 0.0])
        >>> with rnc.show(reduced, gains={"speed": (0.0, 2.0, 1.0)}, open_browser=False) as view:
        ...     for k in range(3):
        ...         view.update(q, v2, t=0.02 * k)
        ...         q = pin.integrate(robot.model, q, 0.02 * view.gains["speed"] * reduced.at(q, v2).v)
        >>> view.running
        False
    """
    made = LoopView(model, gains or {}, controller, view, speed, title)
    if open_browser:
        made.open()
    return made


def _admit_range(name: str, values: tuple[float, float, float]) -> tuple[float, float, float]:
    try:
        lower, upper, start = (float(each) for each in values)
    except (TypeError, ValueError):
        raise InputError(f"gain '{name}': expected (smallest, largest, start), found {values!r}") from None
    if not (math.isfinite(lower) and math.isfinite(upper) and lower < upper and lower <= start <= upper):
        raise InputError(f"gain '{name}': expected smallest <= start <= largest, found {values!r}")
    return lower, upper, start
