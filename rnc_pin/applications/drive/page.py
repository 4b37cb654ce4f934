"""Page of a driven run: keys, clicks on the ground, sliders, and the status of the run."""

from __future__ import annotations

from dataclasses import asdict, replace

import numpy as np

from rnc_pin.applications.drive.controls import GAINS, DriveControls
from rnc_pin.applications.drive.preparation import PreparedDrive
from rnc_pin.applications.drive.run import CommandQueue, DriveStatus
from rnc_pin.io import Json
from rnc_pin.simulation import RunInfo, Sample
from rnc_pin.verdict import Severity, Verdict, weight_of
from rnc_pin.visualization import DrawnState, LiveView, mg
from rnc_pin.visualization.browser import ControlPanel

_GOAL = 0xE69F00
_MARK = "goal/base"


class DrivePage(LiveView):
    """Page of a driven run on loopback, as a watcher of ``drive``.

    Args:
        prepared: the run.
        queue: queue for the commands of the page.
        title: title of the page.
        open_browser: True to open the page immediately.
    """

    def __init__(self, prepared: PreparedDrive, queue: CommandQueue, title: str, open_browser: bool) -> None:
        experiment, controls = prepared.scenario.experiment, prepared.controls
        drawn, goals = experiment.drawn_model, tuple(experiment.reduced.vertical.names)
        info = RunInfo(drawn.outputs, goals, provenance=experiment.provenance)
        view = experiment.scenario.view
        # The reference of the scenario is not followed here, and goals are drawn instead.
        view = replace(view, hide=[*view.hide, "reference", "constraint forces"])
        self._controls, self._ground = controls, drawn.ground_height(view) or 0.0
        self._status: DriveStatus | None = None  # the loop sets it, and the thread that draws takes it
        self._marked = False
        # The server puts the farewell when the page is gone: then nobody else could stop the robot.
        panel = ControlPanel("drive", queue.put, farewell={"kind": "stop"})
        super().__init__(drawn, view, info, 0.0, open_browser, title=title, panel=panel)
        self.tell("controls", controls_entry(controls, self._ground))

    def show(self, sample: Sample, status: DriveStatus | None) -> None:
        """Show a sample and, if there is one, a status."""
        if status is not None:
            self._status = status
        self(sample)

    def draw(self, state: DrawnState) -> None:
        """Draw a state, and the status if it is new."""
        super().draw(state)
        # Taken once: the page keeps what it was told.
        status, self._status = self._status, None
        if status is not None:
            self._mark(status.goals.base_goal)
            self.tell("status", self._status_entry(status))

    def conclude(self, verdict: Verdict) -> None:
        """Show the verdict of the run in place of its messages: the findings that count, those that fail first."""
        found = [each for each in verdict.findings if each.severity is not Severity.NOTE]
        weights = [weight_of(each.kind, each.severity, verdict.accepted) for each in found]
        lines: list[Json] = [f"{weight}: {each}" for weight, each in zip(weights, found, strict=True)]
        headline = f"The run has ended. Verdict: {verdict.word}"
        self.tell("verdict", {"word": verdict.word, "headline": headline, "findings": lines})

    def _status_entry(self, status: DriveStatus) -> dict[str, Json]:
        return {
            "factor": status.factor,
            "limits": status.limits,
            "messages": status.messages,
            "values": status.goals.posture,
            "places": {name: status.places[name].tolist() for name in self._controls.frames},
            "goals": {name: list(goal.position) for name, goal in status.goals.frames.items()},
        }

    def _mark(self, goal: tuple[float, float] | None) -> None:
        """Draw the goal of the base."""
        goal_size = 0.06  # radius of the mark of the base's goal [m]
        if goal is not None:
            if not self._marked:
                self.scene.mesh(_MARK, mg.Cylinder(0.01, goal_size), _GOAL)
                self._marked = True
            pose = np.eye(4)
            pose[1:3, 1:3] = [[0.0, -1.0], [1.0, 0.0]]  # Meshcat's cylinders have y as their axis
            # Half its height above the ground: it lies on it.
            pose[:3, 3] = *goal, self._ground + 0.005
            self.scene.place(_MARK, pose)
        if self._marked:
            self.scene.root[_MARK].set_property("visible", goal is not None)


def controls_entry(controls: DriveControls, ground: float) -> dict[str, Json]:
    """Controls of a run as ``drive.js`` reads them."""
    base = controls.base
    return {
        "base": None if base is None else {"frame": base.frame, "slides": base.slides},
        "frames": {name: list(axes) for name, axes in controls.frames.items()},
        "joints": {name: asdict(each) for name, each in controls.joints.items()},
        "gains": {name: asdict(each) for name, each in GAINS.items()},
        "ground": ground,
    }
