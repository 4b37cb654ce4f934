"""Scene of a run of any robot. The outputs, constraints and goals determine its elements."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
from itertools import cycle
from types import MappingProxyType

import numpy as np
import pinocchio as pin

from rnc_pin.errors import SingularityError
from rnc_pin.io.json import Json
from rnc_pin.model.rows import RowStack
from rnc_pin.simulation import RunInfo, Trajectory
from rnc_pin.visualization import elements as e
from rnc_pin.visualization import meshcat_scene
from rnc_pin.visualization.drawn_state import RATE, DrawnModel, DrawnState, View, tracked_frames
from rnc_pin.visualization.elements import Overlay, SceneKinematics
from rnc_pin.visualization.scene_bodies import corners_over_time, draw_robot, ground_elements, obstacle_element

_TRAILS = (e.VERMILLION, e.BLUE, e.GREEN, e.PURPLE)


class RunScene:
    """Scene of a robot with all drawn elements.

    Args:
        model: robot, and its reduced model if there is one.
        info: names of the outputs, goals and provenance of the run.
        view: view options.
        scene: Meshcat scene to draw in.
        first: first state.
        run: trajectory of a finished run; None for a live run.
        comparisons: compared runs by label.

    Raises:
        ModelError: the robot has no geometry, or a frame of the view does not exist.
    """

    def __init__(
        self,
        model: DrawnModel,
        info: RunInfo,
        view: View,
        scene: meshcat_scene.MeshcatScene,
        first: DrawnState,
        run: Trajectory | None = None,
        comparisons: Mapping[str, Trajectory] = MappingProxyType({}),
    ) -> None:
        self.model, self.info, self.view, self.scene = model, info, view, scene
        self.run, self.comparisons = run, comparisons
        self.robot, self.reduced, self.outputs = model.robot, model.reduced, info.outputs
        self.shapes = draw_robot(self.robot, scene)
        self.kinematics = SceneKinematics(self.robot, self.reduced.constraints if self.reduced else None)
        self._known = first.q[None] if run is None else run.q  # configurations (N, nq)
        # All widths and arrows scale with the robot, within what a camera shows.
        self.size = float(np.clip(np.linalg.norm(np.ptp(self.kinematics.corners(first.q), axis=0)) / 2, 0.05, 20.0))
        self._largest_force = 1e-9  # the largest so far scales the arrows of a live view
        self.ground = model.ground_height(view)
        self._path, self._width = info.provenance.path, 0.012 * self.size
        # Tracks are slightly above the grid, otherwise both would flicker.
        self._floor = (self.ground or 0.0) + 0.004 * self.size
        # About sixty pieces of a path appear over a recording of any length: each is an object of the page.
        self._piece = 30 if run is None else max(1, round(run.time[-1] * RATE / 60))
        self._follower: meshcat_scene.Follower | None = None
        times = (first.time,) if run is None else np.linspace(run.time[0], run.time[-1], 5).tolist()
        # The camera needs the extent of the motion only: a dozen configurations show it.
        bodies = [*map(self.kinematics.corners, self._moments(12)), corners_over_time(model.obstacles, times)]
        self._look(first, np.concatenate(bodies))
        self.tracked = tracked_frames(self.outputs, info.goals, self.robot)
        self.elements = self._elements(first)
        self.overlay = Overlay(self.outputs, info.goals, self.kinematics, self.reduced is not None)
        for element in self.elements:
            element.build(scene)
        for entry in self.legend():
            if not entry["visible"]:
                scene.hide(str(entry["path"]))

    def update(self, state: DrawnState) -> None:
        """Draw a state.

        Args:
            state: the state; states come in time order.
        """
        self.shapes.place(self.scene, state.q)
        if self._follower is not None:
            self.scene.follow(self._follower.follow(self.kinematics.center_of_mass(state.q)))
        for element in self.elements:
            element.update(self.scene, state)

    def legend(self) -> list[dict[str, Json]]:
        """Entries of the legend, one per layer, as ``page.js`` reads them."""
        entries = {element.entry.layer: element.entry for element in self.elements}
        return [
            {
                "label": entry.label,
                "path": f"/meshcat/{layer}",
                "color": f"#{entry.color:06x}",
                "sign": entry.sign,
                "visible": layer.split("/")[0] not in self.view.hide,
            }
            for layer, entry in entries.items()
        ]

    def _moments(self, most: int) -> np.ndarray:
        """About this number of known configurations."""
        return self._known[:: max(1, len(self._known) // most)]

    # ------------------------------------------------------------------ camera

    def _look(self, first: DrawnState, points: np.ndarray) -> None:
        """Place the camera for points (N, 3) [m] of the robot along its known motion."""
        view, whole = self.view, np.concatenate([points, self._planned(self.ground or 0.0)])
        camera, target = (np.array(() if each is None else each, dtype=float) for each in (view.camera, view.target))
        radius = float(np.linalg.norm(np.ptp(whole, axis=0))) / 2
        longest_motion = 4.0  # over the robot's size, that the camera shows as a whole
        # In a picture of a motion much longer than the robot, the robot would be only a dot.
        far = self._path is None and radius > longest_motion * self.size
        if view.camera is None:
            shown = meshcat_scene.enlarged_box(self.kinematics.corners(first.q)) if far else whole
            camera, target = meshcat_scene.fitting_camera(shown, np.array(meshcat_scene.VIEW_DIRECTION))
        self.scene.set_camera(camera, target)
        if self.ground is not None:
            self.scene.grid(self.ground, target, max(10.0, 2.5 * radius))
        # A live run has no known end, so that the camera has to be ready to follow.
        if far or view.camera is not None or self.run is None:
            close = view.camera is None and self._path is None
            self._follower = meshcat_scene.Follower(camera, target, self.kinematics.center_of_mass(first.q), close)

    # ------------------------------------------------------------------ elements

    def _elements(self, first: DrawnState) -> list[e.Element]:
        found: list[e.Element] = [obstacle_element(each) for each in self.model.obstacles]
        found += ground_elements(self.reduced, self.kinematics, self._moments(50), self.size)
        for part in (self._plan, self._references, self._paths, self._tracks,
                     self._constraints, self._switching, self._redundancy, self._compared):  # fmt: skip
            found += part(first)
        return found

    def _plan(self, first: DrawnState) -> list[e.Element]:
        plan = self._path
        if plan is None or (self.ground is None and not plan.heights):
            return []
        entry = e.LayerEntry("planned path", "plan", e.BLACK, "dashed")
        return [e.FixedPath(entry, plan.frame, self._planned(self._floor), self._width)]

    def _planned(self, height: float) -> np.ndarray:
        """Points (N, 3) of the planned path [m], at this height if it has none of its own; none without a path."""
        plan = self._path
        if plan is None:
            return np.zeros((0, 3))
        heights = np.array(plan.heights) if plan.heights else np.full(len(plan.poses), height)
        return np.column_stack([np.array(plan.poses)[:, :2], heights])

    def _goal_pose(self, frame: str, columns: Mapping[int, tuple[str, int]]) -> Callable[[DrawnState], np.ndarray]:
        """Pose (4, 4) of a goal; its axes are those of the world without a desired attitude or heading."""
        actual = self.kinematics.point(frame)
        # By name, as in ``tracked_frames``: a run from a file has no outputs, only their names.
        names = {f"{frame}_orientation_x": 3, f"{frame}_yaw": 1}
        turns = [
            (*place, size)
            for name, size in names.items()
            if name in self.info.goals and (place := self.outputs.find(name)) is not None
        ]

        def pose(state: DrawnState) -> np.ndarray:
            matrix = np.eye(4)
            matrix[:3, 3] = actual(state)
            for kind, first, size in turns[:1]:
                turn = np.array([0.0, 0.0, *state.desired(kind)[first : first + size]])[-3:]  # a heading is about z
                if np.isfinite(turn).all():
                    matrix[:3, :3] = pin.exp3(turn)
            for axis, (kind, column) in columns.items():
                value = state.desired(kind)[column]
                # NaN where a controller tells no target: the frame shows its own coordinate there.
                if np.isfinite(value):
                    matrix[axis, 3] = value
            return matrix

        return pose

    def _references(self, first: DrawnState) -> list[e.Element]:
        found: list[e.Element] = []
        run = self.run
        line = e.LayerEntry("reference", "reference", e.BLACK, "dotted")
        goal = e.LayerEntry("goal", "goal", e.BLACK, "dot")
        for frame, columns in self.tracked.items():
            pose = self._goal_pose(frame, columns)
            planned = self._path is not None and self._path.frame == frame and self.ground is not None
            if run is None:
                if not planned:
                    found.append(e.Trail(line, frame, _origin(pose), 0.8 * self._width, self._piece))
                found.append(e.Triad(goal, frame, pose, 0.16 * self.size))
                continue
            desired = {"x1": run.x1_desired, "x2": run.x2_desired}
            wanted = {axis: desired[kind][:, column] for axis, (kind, column) in columns.items()}
            # A page holds each point of a path: a few hundred look smooth.
            every = slice(None, None, max(1, len(run.time) // 400))
            points = self.kinematics.path(frame, run.q[every])
            for axis, values in wanted.items():
                points[:, axis] = values[every]
            if not planned and np.ptp(points, axis=0).max() > 2 * self._width:
                found.append(e.FixedPath(line, frame, points, 0.8 * self._width))
            # A goal that no longer moves at the end of the run is drawn at rest from the start.
            late = slice(-max(2, len(run.time) // 50), None)
            if all(np.ptp(values[late]) < 1e-6 for values in wanted.values()):
                last = first._replace(q=run.q[-1], x1_desired=run.x1_desired[-1], x2_desired=run.x2_desired[-1])
                pose = _constant(pose(last))
            found.append(e.Triad(goal, frame, pose, 0.16 * self.size))
        return found

    def _paths(self, first: DrawnState) -> list[e.Element]:
        frames = self.view.trail or list(self.tracked)
        found: list[e.Element] = []
        for frame, color in zip(frames, cycle(_TRAILS), strict=False):
            entry = e.LayerEntry(f"path of {frame.replace('_', ' ')}", f"path/{frame}", color)
            found.append(e.Trail(entry, frame, self.kinematics.point(frame), self._width, self._piece))
        return found

    def _tracks(self, first: DrawnState) -> list[e.Element]:
        if self.ground is None:
            return []
        entry = e.LayerEntry("wheel tracks", "tracks", e.GREY)
        wheels = self.kinematics.wheels(first, self._floor)
        return [e.Trail(entry, str(k), wheel, self._width, self._piece) for k, wheel in enumerate(wheels.values())]

    def _constraints(self, first: DrawnState) -> list[e.Element]:
        points, _ = self.kinematics.lines_of_action_at(first)
        # A momentum acts on no point, so it has no arrow.
        drawn = np.flatnonzero(~np.isnan(points).any(axis=1)).tolist()
        return self._forces(self.kinematics, {row: row for row in drawn}, "")

    def _switching(self, first: DrawnState) -> list[e.Element]:
        """Forces of constraints that act during a part of the run; the others are drawn already."""
        run, kept = self.run, () if self.reduced is None else self.reduced.constraints.names
        blocks = {rows.names: rows for rows in (kind.bind(self.robot) for kind in self.model.switching)}
        # Only a finished run knows which of them ever act.
        if run is None or not blocks:
            return []
        rows, acting = RowStack(list(blocks.values())), np.nan_to_num(run.multipliers).any(axis=0)
        columns = {
            rows.names.index(name): column
            for column, name in enumerate(self.outputs.multipliers.names)
            if name in rows.names and name not in kept and acting[column]
        }
        return self._forces(SceneKinematics(self.robot, rows), columns, "switching ")

    def _forces(self, kinematics: SceneKinematics, columns: Mapping[int, int], prefix: str) -> list[e.Element]:
        """Forces of the rows of kinematics, each with its multiplier."""
        run, entry = self.run, e.LayerEntry("constraint force", "constraint forces", e.ORANGE, "arrow")
        if run is not None:
            values = np.abs(np.nan_to_num(run.multipliers[:, list(columns.values())]))
            # A finished run is known whole: one scale for all of its arrows.
            self._largest_force = float(values.max(initial=self._largest_force))

        def vectors(state: DrawnState) -> tuple[np.ndarray, np.ndarray]:
            # Multipliers are on the side of the inertia forces, so the constraint force has the opposite sign.
            values = -np.nan_to_num(state.multipliers[list(columns.values())])
            if not values.any():  # the lines of a wheel that flies may be undefined
                return np.zeros((len(columns), 3)), np.zeros((len(columns), 3))
            self._largest_force = max(self._largest_force, float(np.abs(values).max()))
            points, along = (np.nan_to_num(each[list(columns)]) for each in kinematics.lines_of_action_at(state))
            return points, along * (values / self._largest_force * 0.7 * self.size)[:, None]

        return [e.Arrows(entry, f"{prefix}rows", len(columns), vectors, 1.6 * self._width)] if columns else []

    def _redundancy(self, first: DrawnState) -> list[e.Element]:
        """Velocities of bodies in motions that leave the primary outputs alone, each the motion of another output."""
        reduced, task, links_of = self.reduced, self.info.provenance.task, self.robot.links_of
        if reduced is None or not self.view.redundancy:
            return []
        names, primary = reduced.reducing.names, self.info.goals if task is None else task.primary
        # First and last link of each joint: arrows on all of them would cover each other.
        ends = {name for k in range(1, self.robot.model.njoints) for name in (*links_of(k)[:1], *links_of(k)[-1:])}
        frames = [self.robot.frame_id(name) for name in sorted(ends)]

        def vectors(state: DrawnState, column: int) -> tuple[np.ndarray, np.ndarray]:
            here, along = reduced.at(state.q, t=state.time), np.zeros((len(frames), 3))
            # At a singular state R does not exist: the arrows vanish, and the run goes on.
            with suppress(SingularityError):
                along = np.array([here.position.jacobian(frame)[:3] @ here.R[:, column] for frame in frames])
            points = np.array([here.position.placement(frame).translation for frame in frames])
            return points, 0.4 * self.size * along / max(float(np.linalg.norm(along, axis=1).max()), 1e-9)

        found: list[e.Element] = []
        colors = cycle((*_TRAILS, e.SKY, e.YELLOW, e.GREY, e.BLACK))
        for name, color in zip((name for name in names if name not in primary), colors, strict=False):
            entry = e.LayerEntry(f"motion of {name.replace('_', ' ')}", f"redundancy/{name}", color, "arrow")
            # Bound now: a closure would see the last name of the loop.
            motion = partial(vectors, column=names.index(name))
            found.append(e.Arrows(entry, "bodies", len(frames), motion, self._width))
        return found

    def _compared(self, first: DrawnState) -> list[e.Element]:
        found: list[e.Element] = []
        # Without vermillion, which is the colour of this run's own first path.
        colors = cycle((e.BLUE, e.PURPLE, e.GREEN, e.ORANGE))
        for k, ((label, other), color) in enumerate(zip(self.comparisons.items(), colors, strict=False)):
            entry = e.LayerEntry(label, f"compared/{k}", color)
            found.append(e.Ghost(entry, "robot", self.robot, k, self.shapes.node))
            for frame in self.view.trail or self.tracked:
                # At most about 400 points: a page does not show more.
                path = self.kinematics.path(frame, other.q[:: max(1, len(other.q) // 400)])
                found.append(e.FixedPath(entry, f"path of {frame}", path, 0.7 * self._width))
        return found


def _constant(pose: np.ndarray) -> Callable[[DrawnState], np.ndarray]:
    return lambda state: pose


def _origin(pose: Callable[[DrawnState], np.ndarray]) -> Callable[[DrawnState], np.ndarray]:
    return lambda state: pose(state)[:3, 3]
