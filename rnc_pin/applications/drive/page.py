"""Page of a driven run: keys, clicks on the ground, sliders, the status of the run, and highlights of active limits."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, replace
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from rnc_pin.applications.drive.controls import Range
from rnc_pin.applications.drive.goals import DriveGoals
from rnc_pin.applications.drive.preparation import PreparedDrive
from rnc_pin.applications.drive.run import CommandQueue, DriveStatus
from rnc_pin.io import Json
from rnc_pin.robots import Robot
from rnc_pin.simulation import RunInfo, Sample
from rnc_pin.verdict import Severity, Verdict, weight_of
from rnc_pin.visualization import DrawnModel, DrawnState, LiveView, MeshcatViewer, View, mg
from rnc_pin.visualization.browser import LOOPBACK, ControlPanel

_GOAL = 0xE69F00
_GOAL_SIZE = 0.06  # radius of the mark of the base's goal [m]
_HAND = [0.3, 0.03, 0.01]  # size of the mark of its heading [m]

_DISTANCE, _JOINT = " distance", (" position", " velocity")


class HighlightedBodies(NamedTuple):
    """Bodies of limits: names of shapes of the robot, and of obstacles."""

    shapes: frozenset[str]
    obstacles: frozenset[str]


class LimitBodies:
    """Map from the names of limits to bodies.

    Args:
        robot: robot with its shapes.
        obstacles: names of the obstacles.
    """

    def __init__(self, robot: Robot, obstacles: Iterable[str]) -> None:
        self._obstacles = frozenset(obstacles)
        model, drawn = robot.model, robot.drawn_geometry
        self._by_joint: dict[int, set[str]] = {}
        self._by_link: dict[str, set[str]] = {}
        for shape in () if drawn is None else drawn.geometryObjects:
            self._by_joint.setdefault(int(shape.parentJoint), set()).add(str(shape.name))
            self._by_link.setdefault(str(model.frames[shape.parentFrame].name), set()).add(str(shape.name))
        names = robot.velocity_names
        self._joints = {names[joint.idx_v + k]: i for i, joint in enumerate(model.joints) if i for k in range(joint.nv)}
        self._frames = {str(frame.name): int(frame.parentJoint) for frame in model.frames}

    def of(self, limits: Iterable[str]) -> HighlightedBodies:
        """Return the bodies of limits by their names; accelerations concern none."""
        joints: set[int] = set()
        shapes: set[str] = set()
        obstacles: set[str] = set()
        for name in limits:
            ending = next((each for each in _JOINT if name.endswith(each)), None)
            if name.endswith(_DISTANCE):
                for body in name.removesuffix(_DISTANCE).split(" / "):
                    if body in self._obstacles:
                        obstacles.add(body)
                    else:
                        shapes |= self._by_link.get(body, set())
            elif ending is not None and name.removesuffix(ending) in self._joints:
                joints.add(self._joints[name.removesuffix(ending)])
            elif not name.endswith(" acceleration") and name.split(" ")[0] in self._frames:
                joints.add(self._frames[name.split(" ")[0]])
        shapes |= {shape for joint in joints for shape in self._by_joint.get(joint, ())}
        return HighlightedBodies(frozenset(shapes), frozenset(obstacles))


class DrivenViewer(MeshcatViewer):
    """Meshcat viewer with the controls of a driven run.

    Attributes:
        status: latest status; the loop sets it, and the thread that draws reads it.
    """

    def __init__(
        self,
        prepared: PreparedDrive,
        queue: CommandQueue,
        drawn: DrawnModel,
        view: View,
        info: RunInfo,
        host: str,
        title: str,
    ) -> None:
        super().__init__(drawn, view, info, host, title, ControlPanel("drive", queue.put))
        self.status: DriveStatus | None = None
        self._shown: DriveStatus | None = None
        self._prepared, self._drawn = prepared, drawn
        self._ground = drawn.ground_height(view) or 0.0
        self._bodies = LimitBodies(drawn.robot, prepared.controls.obstacles)
        self._frames = {name: drawn.robot.frame_id(name) for name in prepared.controls.frames}
        self._marked: set[str] = set()
        controls = controls_entry(prepared, self._ground)
        self.window.post({"type": "drive_controls", "path": "/drive", "controls": controls})

    def draw(self, state: DrawnState) -> None:
        """Draw a state, and the status if it is new."""
        super().draw(state)
        status = self.status
        if status is not None and status is not self._shown:
            self._shown = status
            self._mark(status.goals)
            entry = self._status_entry(status, state.q)
            self.window.post({"type": "drive_status", "path": "/drive", "status": entry})

    def _status_entry(self, status: DriveStatus, q: np.ndarray) -> dict[str, Json]:
        controls, goals = self._prepared.controls, status.goals
        bodies = self._bodies.of((*status.report.active, *status.report.exceeded))
        assert self._drawn.reduced is not None
        position = self._drawn.reduced.at(q).position
        places: dict[str, Json] = {
            name: np.array(position.placement(frame).translation).tolist() for name, frame in self._frames.items()
        }
        aims: dict[str, Json] = {
            name: list(goal.position)
            for name, goal in zip(controls.frames, goals.frames, strict=True)
            if goal is not None
        }
        for name, legs in zip(controls.obstacles, goals.obstacles, strict=True):
            places[name], aims[name] = legs[-1].at(status.time)[0].tolist(), list(legs[-1].goal)
        return {
            "factor": status.factor,
            "limits": status.limits,
            "messages": status.messages,
            "posture": dict(zip(controls.joints, goals.posture, strict=True)),
            "places": places,
            "goals": aims,
            "highlighted": [
                *(f"/meshcat/robot/visuals/{name}" for name in sorted(bodies.shapes)),
                *(f"/meshcat/obstacles/{name}" for name in sorted(bodies.obstacles)),
            ],
        }

    def _mark(self, goals: DriveGoals) -> None:
        """Draw the goal of the base, and its heading if it has one."""
        goal, heading = goals.base_goal, goals.heading
        disk = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # Meshcat's cylinders have y as their axis
        hand = np.eye(3) if heading is None else np.array(pin.AngleAxis(heading, np.array([0.0, 0.0, 1.0])).matrix())
        self._show_mark("goal/base", mg.Cylinder(0.01, _GOAL_SIZE), None if goal is None else (*goal, disk))
        ahead = None if goal is None or heading is None else (*(goal + hand[:2, 0] * _HAND[0] / 2), hand)
        self._show_mark("goal/heading", mg.Box(_HAND), ahead)

    def _show_mark(self, node: str, shape: mg.Geometry, placed: tuple[float, float, np.ndarray] | None) -> None:
        """Draw a mark on the ground at x, y with a rotation; None hides it."""
        if placed is not None:
            if node not in self._marked:
                self.scene.mesh(node, shape, _GOAL)
                self._marked.add(node)
            pose = np.eye(4)
            pose[:3, :3] = placed[2]
            pose[:3, 3] = *placed[:2], self._ground + 0.005
            self.scene.place(node, pose)
        if node in self._marked:
            self.scene.root[node].set_property("visible", placed is not None)


class DrivePage:
    """Page of a driven run on loopback, as a watcher of ``drive``.

    Args:
        prepared: the run.
        queue: queue for the commands of the page.
        title: title of the page.
        open_browser: True to open the page immediately.

    Attributes:
        live: the view that serves the page.
    """

    def __init__(self, prepared: PreparedDrive, queue: CommandQueue, title: str, open_browser: bool) -> None:
        experiment = prepared.scenario.experiment
        reduced = experiment.reduced
        drawn = DrawnModel(reduced.robot, reduced, experiment.obstacles)
        info = RunInfo(drawn.outputs, tuple(reduced.vertical.names), provenance=experiment.provenance)
        view = experiment.scenario.view
        view = replace(view, hide=[*view.hide, "reference", "constraint forces"])
        self._viewer: DrivenViewer

        def viewer(drawn: DrawnModel, view: View, info: RunInfo, host: str, title: str) -> DrivenViewer:
            self._viewer = DrivenViewer(prepared, queue, drawn, view, info, host, title)
            return self._viewer

        self.live = LiveView(drawn, view, info, 0.0, open_browser, LOOPBACK, title, viewer)

    def show(self, sample: Sample, status: DriveStatus | None) -> None:
        """Show a sample and, if there is one, a status."""
        if status is not None:
            self._viewer.status = status
        self.live(sample)

    def conclude(self, verdict: Verdict) -> None:
        """Show the verdict of the run in place of its messages: the findings that count, those that fail first."""
        found = [each for each in verdict.findings if each.severity is not Severity.NOTE]
        weights = [weight_of(each.kind, each.severity, verdict.accepted) for each in found]
        lines = [f"{weight}: {each}" for weight, each in zip(weights, found, strict=True)]
        headline = f"The run has ended. Verdict: {verdict.word}"
        entry = {"word": verdict.word, "headline": headline, "findings": lines}
        self._viewer.window.post({"type": "drive_verdict", "path": "/drive", "verdict": entry})


def controls_entry(prepared: PreparedDrive, ground: float) -> dict[str, Json]:
    """Controls of a run as ``drive.js`` reads them."""
    controls = prepared.controls

    def ranges(given: Mapping[str, Range]) -> dict[str, Json]:
        return {name: asdict(each) for name, each in given.items()}

    base = controls.base
    return {
        "base": None if base is None else {"frame": base.frame, "slides": base.slides},
        "frames": {name: list(axes) for name, axes in controls.frames.items()},
        "joints": ranges(controls.joints),
        "gains": ranges(controls.gains),
        "obstacles": {name: list(place) for name, place in controls.obstacles.items()},
        "ground": ground,
    }
