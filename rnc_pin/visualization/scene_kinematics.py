"""Kinematics for drawings: frames, shapes and wheels at a state, and forces of constraints."""

from __future__ import annotations

from collections.abc import Callable

import coal
import numpy as np
import pinocchio as pin

from rnc_pin.model.kinematics import Kinematics
from rnc_pin.model.rows import RowStack
from rnc_pin.robots.robot import Robot
from rnc_pin.visualization.drawn_state import DrawnState

Point = Callable[[DrawnState], np.ndarray]


def box_corners(shape: coal.CollisionGeometry) -> np.ndarray:
    """Corners (8, 3) [m] of the bounding box of a shape along its own axes.

    Args:
        shape: shape of coal.
    """
    shape.computeLocalAABB()
    box = shape.aabb_local
    return np.array(np.meshgrid(*zip(box.min_, box.max_, strict=True))).reshape(3, -1).T


class SceneKinematics:
    """Kinematics of a robot, computed once per state.

    Args:
        robot: the robot.
        rows: constraint rows for ``lines`` and ``wheels``.
    """

    def __init__(self, robot: Robot, rows: RowStack | None = None) -> None:
        self.robot = robot
        self._rows = rows
        self._kinematics = Kinematics(robot)
        self._data = robot.model.createData()
        self._masses = robot.model.createData()
        self._q: np.ndarray | None = None

    def _data_at(self, q: np.ndarray) -> pin.Data:
        # Identity is enough: all elements of one picture get the same array.
        if q is not self._q:
            pin.framesForwardKinematics(self.robot.model, self._data, q)
            self._q = q
        return self._data

    def frame(self, name: str) -> Callable[[DrawnState], pin.SE3]:
        """Placement of a frame in the world, as a function of the state.

        Args:
            name: name of the frame.
        """
        index = self.robot.frame_id(name)
        return lambda state: self._data_at(state.q).oMf[index]

    def placement(self, name: str, q: np.ndarray) -> pin.SE3:
        """Placement of a frame in the world at a configuration (nq,).

        Args:
            name: name of the frame.
            q: the configuration.
        """
        return self._data_at(q).oMf[self.robot.frame_id(name)]

    def point(self, name: str) -> Point:
        """Origin (3,) of a frame in the world [m], as a function of the state.

        Args:
            name: name of the frame.
        """
        placement = self.frame(name)
        return lambda state: placement(state).translation

    def path(self, name: str, configurations: np.ndarray) -> np.ndarray:
        """Origins (N, 3) of a frame at configurations (N, nq).

        Args:
            name: name of the frame.
            configurations: configurations of a run.
        """
        index = self.robot.frame_id(name)
        return np.stack([self._data_at(q).oMf[index].translation.copy() for q in configurations])

    def lines_of_action_at(self, state: DrawnState) -> tuple[np.ndarray, np.ndarray]:
        """Lines of action of the constraint rows: points and directions, (m, 3) each.

        Args:
            state: the state.
        """
        none = np.empty((0, 3))
        return (none, none) if self._rows is None else self._rows.lines_of_action(self._kinematics.position(state.q))

    def center_of_mass(self, q: np.ndarray) -> np.ndarray:
        """Centre of mass of the robot (3,) [m].

        Args:
            q: the configuration (nq,).
        """
        return np.array(pin.centerOfMass(self.robot.model, self._masses, q))

    # ------------------------------------------------------------------ size

    def corners(self, q: np.ndarray) -> np.ndarray:
        """Corners (N, 3) of the bounding boxes of all shapes [m], without infinite shapes such as planes.

        Args:
            q: the configuration (nq,).
        """
        drawn = self.robot.drawn_geometry
        assert drawn is not None
        data, found = self._data_at(q), []
        farthest = 1e3  # [m]: boxes of planes are larger, boxes of robots are not
        for shape in drawn.geometryObjects:
            corners = box_corners(shape.geometry)
            if np.abs(corners).max() < farthest:
                placement = data.oMi[shape.parentJoint] * shape.placement
                found.append((placement.rotation @ corners.T).T + placement.translation)
        return np.concatenate(found) if found else np.zeros((1, 3))

    # ------------------------------------------------------------------ wheels

    def wheels(self, state: DrawnState, ground: float) -> dict[str, Point]:
        """Points that leave tracks: wheels, or the points of action of rows without a wheel.

        A wheel is a cylinder whose axis is the line of action of a row and whose lowest point is near the ground.

        Args:
            state: first state of the run.
            ground: height of the tracks [m].
        """
        points, directions = self.lines_of_action_at(state)
        tracks: dict[str, Point] = {}

        def on_ground(joint: int, local: np.ndarray) -> Point:
            def point(state: DrawnState) -> np.ndarray:
                place = self._data_at(state.q).oMi[joint].act(local)
                return np.array([place[0], place[1], ground])

            return point

        def where_row_acts(row: int) -> Point:
            return lambda state: np.r_[self.lines_of_action_at(state)[0][row][:2], ground]

        data, drawn = self._data_at(state.q), self.robot.drawn_geometry
        for row, (point, along) in enumerate(zip(points, directions, strict=True)):
            # A vertical row carries a wheel; rolling and lateral rows of the same wheel find it.
            if np.isnan(point).any() or abs(along[2]) > 0.5:
                continue
            found = False
            for shape in () if drawn is None else drawn.geometryObjects:
                if not isinstance(shape.geometry, coal.Cylinder):
                    continue
                placement = data.oMi[shape.parentJoint] * shape.placement
                radius = shape.geometry.radius
                level = np.array([1.0, 1.0, 0.0])
                # Across the axle, from above: a row may act at the middle of an axle with several wheels.
                aside = np.cross((placement.translation - point) * level, along)
                on_axle = abs(placement.rotation[:, 2] @ along) > 0.99 and np.linalg.norm(aside) < 0.05 * radius
                if on_axle and abs(placement.translation[2] - radius - ground) < 0.25 * radius:
                    tracks[shape.name] = on_ground(shape.parentJoint, shape.placement.translation)
                    found = True
            if not found and not any(np.linalg.norm(track(state)[:2] - point[:2]) < 1e-6 for track in tracks.values()):
                tracks[f"row {row}"] = where_row_acts(row)
        return tracks
