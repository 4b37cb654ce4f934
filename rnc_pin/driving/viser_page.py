"""Viser page of a driven run: gizmos of frames, base and obstacles, sliders, buttons and keys."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin

from rnc_pin.driving.drive_goals import DriveGoals
from rnc_pin.driving.drive_log import CommandQueue
from rnc_pin.driving.drive_plan import DrivePlan
from rnc_pin.driving.drive_status import DriveStatus
from rnc_pin.driving.limit_bodies import HighlightedBodies, LimitBodies
from rnc_pin.driving.live_drive import LiveDrive
from rnc_pin.robots.robot import Robot
from rnc_pin.robots.sources.mesh_formats import convex_hull
from rnc_pin.simulation import RunInfo
from rnc_pin.visualization.drawn_model import DrawnModel
from rnc_pin.visualization.drawn_obstacles import surface_points
from rnc_pin.visualization.drawn_state import DrawnState
from rnc_pin.visualization.robot_meshes import drawn_scale, drawn_triangles
from rnc_pin.visualization.view import View
from rnc_pin.visualization.viser_viewer import ViserViewer

_ORANGE, _GREY = (213, 94, 0), (125, 138, 150)
_GIZMO = 0.25  # size of a gizmo [m]
_MOVES = {
    "Forward (W)": ("W", (1.0, 0.0, 0.0)),
    "Back (S)": ("S", (-1.0, 0.0, 0.0)),
    "Turn left (A)": ("A", (0.0, 1.0, 0.0)),
    "Turn right (D)": ("D", (0.0, -1.0, 0.0)),
    "Slide left (Q)": ("Q", (0.0, 0.0, 1.0)),
    "Slide right (E)": ("E", (0.0, 0.0, -1.0)),
}
"""Button and key of each motion of the base: shares of forward speed, turn rate and speed to the left."""


class DrivenViserViewer(ViserViewer):
    """Viser viewer with the controls of a driven run.

    Attributes:
        status: latest status; the loop sets it, and the thread that draws reads it.
    """

    def __init__(
        self,
        prepared: DrivePlan,
        queue: CommandQueue,
        drawn: DrawnModel,
        view: View,
        info: RunInfo,
        host: str,
        title: str,
    ) -> None:
        super().__init__(drawn, view, info, host, title)
        self.status: DriveStatus | None = None
        self._shown: DriveStatus | None = None
        self._prepared, self._queue, self._drawn = prepared, queue, drawn
        self._scene, self._gui = self._server.scene, self._server.gui
        self._height = drawn.ground_height(view) or 0.0
        self._bodies = LimitBodies(drawn.robot, prepared.controls.obstacles)
        self._lit: dict[str, Any] = {}
        self._obstacle_meshes: dict[str, Any] = {}
        self._texts = self._gui.add_markdown("")
        controls = prepared.controls
        experiment = prepared.plan.experiment
        at = experiment.reduced.at(experiment.q0).position
        robot = experiment.reduced.robot
        self._frames = {name: robot.frame_id(name) for name in controls.frames}
        self._gizmos = {
            name: self._frame_gizmo(name, np.array(at.placement(frame).translation))
            for name, frame in self._frames.items()
        }
        if controls.base is not None:
            start = np.array(at.placement(robot.frame_id(controls.base.frame)).translation[:2])
            self._add_base(start)
        for obstacle in drawn.obstacles:
            self._add_obstacle(obstacle.name, surface_points(obstacle.shape), obstacle.placement(0.0).translation)
        self._add_buttons()
        self._sliders = self._add_sliders()

    # ------------------------------------------------------------------ controls

    def _frame_gizmo(self, name: str, start: np.ndarray) -> Any:
        turning = self._gui.add_checkbox(f"orientation of {name}", False)
        gizmo = self._scene.add_transform_controls(
            f"/goal/{name}", _GIZMO, position=start, active_axes=(True, True, True), depth_test=False
        )

        def move(event: object) -> None:
            w, x, y, z = np.array(gizmo.wxyz).tolist()
            goal = {"kind": "frame_goal", "frame": name, "position": np.array(gizmo.position).tolist()}
            self._queue.put({**goal, **({"orientation": [x, y, z, w]} if turning.value else {})})

        gizmo.on_update(move)
        return gizmo

    def _add_base(self, start: np.ndarray) -> None:
        """Add the gizmo, the buttons and the keys of the base."""
        base = self._prepared.controls.base
        gizmo = self._scene.add_transform_controls(
            "/goal/base",
            _GIZMO,
            position=(start[0], start[1], self._height),
            active_axes=(True, True, False),
            disable_rotations=True,
        )

        def move(event: object) -> None:
            x, y, _ = np.array(gizmo.position).tolist()
            self._queue.put({"kind": "base_goal", "x": x, "y": y})

        gizmo.on_update(move)
        with self._gui.add_folder("Base"):
            for label, (key, shares) in _MOVES.items():
                if shares[2] and not (base is not None and base.slides):
                    continue
                drive = self._velocity(shares)
                button = self._gui.add_button(label)
                button.on_click(drive)
                button.on_hold(drive)
                self._gui.add_command(label, hotkey=key).on_trigger(drive)  # type: ignore[arg-type]
            stays = self._gui.add_checkbox("base stays while frames move", False)

            def hold(event: object) -> None:
                self._queue.put({"kind": "hold_base", "on": bool(stays.value)})

            stays.on_update(hold)

    def _velocity(self, shares: tuple[float, float, float]) -> Callable[[object], None]:
        forward, turn, left = shares

        def drive(event: object) -> None:
            self._queue.put({"kind": "base_velocity", "forward": forward, "turn": turn, "left": left})

        return drive

    def _add_obstacle(self, name: str, points: np.ndarray, start: np.ndarray) -> None:
        hull = convex_hull(points)
        node = f"/obstacles/{name}"
        vertices, faces = np.asarray(hull.vertices), np.asarray(hull.triangles)
        self._obstacle_meshes[name] = self._scene.add_mesh_simple(node, vertices, faces, color=_GREY, opacity=0.75)
        gizmo = self._scene.add_transform_controls(
            f"/moved/{name}", _GIZMO, position=np.array(start), disable_rotations=True, depth_test=False
        )

        def move(event: object) -> None:
            place = np.array(gizmo.position).tolist()
            self._queue.put({"kind": "obstacle_goal", "obstacle": name, "position": place})

        gizmo.on_update(move)

    def _add_buttons(self) -> None:
        def stop(event: object) -> None:
            self._queue.put({"kind": "stop"})

        self._gui.add_button("Stop", color="red").on_click(stop)
        self._gui.add_command("Stop", hotkey="space").on_trigger(stop)
        if self._frames:
            self._gui.add_button("Release frames").on_click(self._release)
        self._gui.add_button("End run").on_click(self._end)

    def _release(self, event: object) -> None:
        for name in self._frames:
            self._queue.put({"kind": "release_frame", "frame": name})

    def _end(self, event: object) -> None:
        self._queue.put({"kind": "end"})

    def _add_sliders(self) -> dict[str, Any]:
        """Add the sliders of joints and gains; return those of the joints."""
        controls, sliders = self._prepared.controls, {}
        with self._gui.add_folder("Posture"):
            for name, span in controls.joints.items():
                sliders[name] = self._slider(name, span.lower, span.upper, span.start)
                sliders[name].on_update(self._joint_goal(name, sliders[name]))
        with self._gui.add_folder("Gains and speeds", expand_by_default=False):
            for name, span in controls.gains.items():
                slider = self._slider(f"{name} [{span.unit}]", span.lower, span.upper, span.start)
                slider.on_update(self._gain(name, slider))
        return sliders

    def _slider(self, label: str, lower: float, upper: float, start: float) -> Any:
        return self._gui.add_slider(label, lower, upper, (upper - lower) / 400, start)

    def _joint_goal(self, name: str, slider: Any) -> Callable[[Any], None]:
        def move(event: Any) -> None:
            if event.client_id is not None:  # a user, not the program
                span = self._prepared.controls.joints[name]
                position = float(np.clip(slider.value, span.lower, span.upper))  # viser rounds to steps
                self._queue.put({"kind": "joint_goal", "joint": name, "position": position})

        return move

    def _gain(self, name: str, slider: Any) -> Callable[[object], None]:
        def change(event: object) -> None:
            span = self._prepared.controls.gains[name]
            value = float(np.clip(slider.value, span.lower, span.upper))
            self._queue.put({"kind": "gain", "gain": name, "value": value})

        return change

    # ------------------------------------------------------------------ drawing

    def draw(self, state: DrawnState) -> None:
        """Draw a state, and the status if it is new."""
        super().draw(state)
        for obstacle in self._drawn.obstacles:
            mesh = self._obstacle_meshes[obstacle.name]
            pose = obstacle.placement(state.time)
            mesh.position, mesh.wxyz = pose.translation, _wxyz(pose.rotation)
        status = self.status
        if status is not None and status is not self._shown:
            self._shown = status
            self._texts.content = _text(status)
            self._follow_frames(status.goals, state.q)
            for slider, value in zip(self._sliders.values(), status.goals.posture, strict=True):
                if abs(slider.value - value) > 0.51 * slider.step:
                    slider.value = value
            self._highlight(self._bodies.of((*status.report.active, *status.report.exceeded)))

    def _follow_frames(self, goals: DriveGoals, q: np.ndarray) -> None:
        """Keep gizmos without a goal at their frames."""
        assert self._drawn.reduced is not None
        position = self._drawn.reduced.at(q).position
        for (name, frame), goal in zip(self._frames.items(), goals.frames, strict=True):
            if goal is None:
                placed = position.placement(frame)
                self._gizmos[name].position = np.array(placed.translation)
                self._gizmos[name].wxyz = _wxyz(np.array(placed.rotation))

    def _highlight(self, bodies: HighlightedBodies) -> None:
        """Draw the bodies of active limits in orange: obstacles by their colour, links by a shape over them."""
        for name, mesh in self._obstacle_meshes.items():
            mesh.color = _ORANGE if name in bodies.obstacles else _GREY
        for name in bodies.shapes - set(self._lit):
            self._lit[name] = self._over(name)
        for name, mesh in self._lit.items():
            if mesh.visible != (name in bodies.shapes):
                mesh.visible = name in bodies.shapes

    def _over(self, name: str) -> Any:
        """Add an orange shape, slightly larger than a link's own; it moves with the link."""
        vertices, faces = shape_mesh(self._drawn.robot, name)
        center = vertices.mean(axis=0)
        node = f"{self._visualizer.frames[f'robot/visual/{name}'].name}/limit"
        return self._scene.add_mesh_simple(node, center + 1.02 * (vertices - center), faces, color=_ORANGE)


def shape_mesh(robot: Robot, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (n, 3) [m] and triangles (k, 3) of a visual shape, in the axes in which it is placed."""
    assert robot.visual_model is not None
    shape = robot.visual_model.geometryObjects[robot.visual_model.getGeometryId(name)]
    if hasattr(shape.geometry, "num_tris"):
        corners = (drawn_triangles(shape) * drawn_scale(shape)).reshape(-1, 3)
        return corners, np.arange(len(corners)).reshape(-1, 3)
    hull = convex_hull(surface_points(shape.geometry))
    return np.asarray(hull.vertices), np.asarray(hull.triangles)


def _wxyz(rotation: np.ndarray) -> np.ndarray:
    x, y, z, w = pin.Quaternion(np.array(rotation)).coeffs()
    return np.array([w, x, y, z])


def _text(status: DriveStatus) -> str:
    """Status in Markdown. Names come from files, so they stand in code."""
    late = " (behind real time)" if status.factor < 0.95 else ""
    lines = [
        f"**{status.factor:.2f} x real time**{late}",
        "",
        "Active limits:" if status.limits else "No active limits",
    ]
    told = [*status.limits, *status.messages]
    return "\n".join([*lines, "", *(f"* `{line.replace('`', ' ')}`" for line in told)])


class ViserDrivePage(LiveDrive):
    """Page of a driven run in viser.

    Raises:
        ConfigurationError: viser is not installed.
    """

    kind = DrivenViserViewer
