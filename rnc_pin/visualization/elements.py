"""Elements of a scene, drawn with Meshcat, and the text and bars that lie over it.

Elements receive the states in time order. Live views and recordings use the same elements.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import coal
import numpy as np
import pinocchio as pin

from rnc_pin.io.json import Json
from rnc_pin.model.kinematics import Kinematics, PositionKinematics
from rnc_pin.model.rows import RowStack
from rnc_pin.robots.robot import Robot
from rnc_pin.simulation import OutputNames
from rnc_pin.visualization.browser.page import mg
from rnc_pin.visualization.drawn_state import DrawnState, output_error, tracked_frames
from rnc_pin.visualization.meshcat_scene import MeshcatScene

# Okabe and Ito
BLACK, ORANGE, SKY, GREEN, YELLOW, BLUE, VERMILLION, PURPLE = (
    *(0x000000, 0xE69F00, 0x56B4E9, 0x009E73),
    *(0xF0E442, 0x0072B2, 0xD55E00, 0xCC79A7),
)
GREY = 0x7A8794


class LayerEntry(NamedTuple):
    """Entry of the legend."""

    label: str
    layer: str
    color: int
    sign: str = "line"
    """"line", "dashed", "dotted", "arrow" or "dot"."""


@dataclass(eq=False)
class Element:
    """Drawn element of the scene. Some have nothing to build, and some never change.

    Attributes:
        entry: its entry in the legend; elements of one layer share an entry.
        name: name of its node on the layer.
    """

    entry: LayerEntry
    name: str

    @property
    def node(self) -> str:
        """Path of its node in the scene."""
        return f"{self.entry.layer}/{self.name}"

    def build(self, scene: MeshcatScene) -> None:
        """Draw the initial content.

        Args:
            scene: scene to draw in.
        """

    def update(self, scene: MeshcatScene, state: DrawnState) -> None:
        """Show a state.

        Args:
            scene: scene to draw in.
            state: the state.
        """


@dataclass(eq=False)
class FixedPath(Element):
    """Path through points (N, 3) [m] that are known in advance."""

    points: np.ndarray
    width: float

    def build(self, scene: MeshcatScene) -> None:
        scene.path(self.node, self.points, self.entry.color, self.width, self.entry.sign)


@dataclass(eq=False)
class Trail(Element):
    """Path of a moving point, drawn piece by piece.

    Attributes:
        point: position (3,) [m] at a state.
        width: width of the path [m].
        piece: frames per piece.
    """

    point: Callable[[DrawnState], np.ndarray]
    width: float
    piece: int

    def __post_init__(self) -> None:
        self._points: list[np.ndarray] = []
        self._count = 0

    def update(self, scene: MeshcatScene, state: DrawnState) -> None:
        self._points.append(np.array(self.point(state)))
        # In pieces: a page cannot extend a path, and a path per frame would be sent whole each time.
        if len(self._points) <= self.piece:
            return
        node = f"{self.node}/{self._count:03d}"
        scene.path(node, np.stack(self._points), self.entry.color, self.width, self.entry.sign)
        scene.appear(node)
        # The last point begins the next piece, or there would be gaps.
        self._points, self._count = self._points[-1:], self._count + 1


@dataclass(eq=False)
class Triad(Element):
    """Coordinate axes at a pose (4, 4), with a sphere in the colour of the entry at the origin."""

    pose: Callable[[DrawnState], np.ndarray]
    size: float

    def build(self, scene: MeshcatScene) -> None:
        size = self.size
        # x, y and z in red, green and blue, as in Meshcat and RViz.
        for axis, color in enumerate((VERMILLION, GREEN, BLUE)):
            shape = [0.06 * size] * 3
            shape[axis] = size
            offset = np.eye(4)
            offset[axis, 3] = size / 2
            scene.mesh(f"{self.node}/{'xyz'[axis]}", mg.Box(shape), color)
            scene.root[f"{self.node}/{'xyz'[axis]}"].set_transform(offset)
        scene.mesh(f"{self.node}/point", mg.Sphere(0.14 * size), self.entry.color)

    def update(self, scene: MeshcatScene, state: DrawnState) -> None:
        scene.place(self.node, self.pose(state))


@dataclass(eq=False)
class Arrows(Element):
    """Arrows from points along vectors, both (n, 3) [m]; almost invisible where the vector is zero."""

    count: int
    vectors: Callable[[DrawnState], tuple[np.ndarray, np.ndarray]]
    width: float

    def build(self, scene: MeshcatScene) -> None:
        for k in range(self.count):
            scene.mesh(f"{self.node}/{k}/shaft", mg.Cylinder(1.0, 1.0), self.entry.color)
            scene.mesh(f"{self.node}/{k}/head", mg.Cylinder(1.0, radiusTop=0.0, radiusBottom=1.0), self.entry.color)

    def update(self, scene: MeshcatScene, state: DrawnState) -> None:
        for k, (point, vector) in enumerate(zip(*map(np.nan_to_num, self.vectors(state)), strict=True)):
            length = float(np.linalg.norm(vector))
            # A transform of size zero is singular, and Three.js would warn: the arrow gets invisibly small instead.
            seen = length > 0.2 * self.width
            along = vector / length if seen else np.eye(3)[1]
            head = min(3.5 * self.width, length) if seen else 1e-4
            shaft = max(length - head, 1e-4)
            place = _cylinder(point + along * shaft / 2, along, shaft, self.width / 2 if seen else 1e-4)
            scene.place(f"{self.node}/{k}/shaft", place)
            scene.place(f"{self.node}/{k}/head", _cylinder(point + along * (shaft + head / 2), along, head, 0.4 * head))


def drawn_scale(shape: pin.GeometryObject) -> np.ndarray:
    """Absolute scale factors (3,) in the placement of a shape.

    Args:
        shape: shape of a geometry model.
    """
    return np.abs(np.asarray(shape.meshScale, dtype=float))


class PlacedShapes:
    """Drawn shapes of a robot, placed at its configurations.

    Args:
        robot: the robot.
        node: path of the node above the shapes.

    Attributes:
        node: the same path.
        geometry: the shapes.
        names: their names.
    """

    def __init__(self, robot: Robot, node: str) -> None:
        drawn = robot.drawn_geometry
        assert drawn is not None
        self._robot, self.geometry = robot, drawn
        self._data, self._shapes = robot.model.createData(), drawn.createData()
        self.node, self.names = node, [shape.name for shape in drawn.geometryObjects]
        self._own = [np.diag([*drawn_scale(shape), 1.0]) for shape in drawn.geometryObjects]

    def place(self, scene: MeshcatScene, q: np.ndarray) -> None:
        """Place all shapes at a configuration (nq,).

        Args:
            scene: scene to draw in.
            q: the configuration.
        """
        # With data of its own: a ghost has another configuration than the robot.
        pin.updateGeometryPlacements(self._robot.model, self._data, self.geometry, self._shapes, q)
        for name, own, placement in zip(self.names, self._own, self._shapes.oMg, strict=True):
            scene.place(f"{self.node}/{name}", placement.homogeneous @ own)


@dataclass(eq=False)
class Ghost(Element):
    """Pale copy of the robot at the configuration of a compared run.

    Attributes:
        robot: robot to copy.
        index: its number among the compared runs.
        source: group of the shapes to copy.
    """

    robot: Robot
    index: int
    source: str

    def __post_init__(self) -> None:
        self._shapes = PlacedShapes(self.robot, self.node)

    def build(self, scene: MeshcatScene) -> None:
        for name in self._shapes.names:
            # The page copies: meshes of a second robot would double the file.
            scene.copy(f"{self.node}/{name}", f"{self.source}/{name}", self.entry.color, 0.4)

    def update(self, scene: MeshcatScene, state: DrawnState) -> None:
        self._shapes.place(scene, state.others[self.index])


def _cylinder(middle: np.ndarray, along: np.ndarray, height: float, radius: float) -> np.ndarray:
    """Transform (4, 4) of a cylinder of unit height and radius whose axis is y."""
    # The axis that is least along it: the product with another one may vanish.
    side = np.cross(along, np.eye(3)[int(np.argmin(np.abs(along)))])
    side /= np.linalg.norm(side)
    matrix = np.eye(4)
    matrix[:3, 0], matrix[:3, 1] = radius * side, height * along
    matrix[:3, 2] = radius * np.cross(side, along)
    matrix[:3, 3] = middle
    return matrix


class OverlayRow(NamedTuple):
    """Number on the overlay: its label, unit and value, and whether a chip shows it in the colour of a margin."""

    label: str
    unit: str
    value: Callable[[DrawnState], float]
    chip: bool = False


class Overlay:
    """Rows of the overlay.

    Args:
        outputs: names of the outputs.
        goals: outputs that have goals.
        kinematics: kinematics of the robot.
        margin: True if the states have a singularity margin.
    """

    def __init__(self, outputs: OutputNames, goals: Sequence[str], kinematics: SceneKinematics, margin: bool) -> None:
        errors: list[OverlayRow] = []
        shown: set[tuple[str, int]] = set()

        def add(label: str, unit: str, places: Sequence[tuple[str, int]]) -> None:
            def size(state: DrawnState) -> float:
                return float(np.linalg.norm([output_error(outputs, state, kind)[k] for kind, k in places]))

            shown.update(places)
            # The length of the error: its parts depend on axes that a viewer does not see.
            errors.append(OverlayRow(f"error of {label.replace('_', ' ')}", unit, size))

        for frame, places in tracked_frames(outputs, goals, kinematics.robot).items():
            add(frame, "m", list(places.values()))
        for name in goals:
            place = outputs.find(name)
            if place is None or place in shown:
                continue
            kind, k = place
            columns = outputs.of(kind)
            # Three outputs are one attitude, whose error is one angle.
            if k in columns.rotations:
                add(name.removesuffix("_x"), "rad", [(kind, k), (kind, k + 1), (kind, k + 2)])
            else:
                add(f"integral of {name}" if columns.is_integral(k) else name, columns.units[k], [place])
        most_errors = 5  # the overlay covers a part of the picture
        self.rows = [OverlayRow("time", "s", lambda state: state.time), *errors[:most_errors]]
        if margin:
            self.rows.append(OverlayRow("singularity margin", "", lambda state: state.margin, chip=True))

    def labels(self) -> list[dict[str, Json]]:
        """Labels of the rows, as ``page.js`` reads them."""
        return [{"label": row.label, "unit": row.unit, "chip": row.chip} for row in self.rows]

    def values(self, state: DrawnState) -> tuple[list[float], list[str | None]]:
        """Values and colours of the rows at a state.

        Args:
            state: the state.
        """
        values = [float(row.value(state)) for row in self.rows]
        pairs = zip(self.rows, values, strict=True)
        return values, [margin_color(value) if row.chip else None for row, value in pairs]


def margin_color(margin: float) -> str:
    """Colour "#rrggbb" for the smallest singular value of E, on a log scale: vermillion near a singularity, else blue.

    Args:
        margin: smallest singular value of E; NaN if it is unknown.
    """
    stops = np.array([[0xD5, 0x5E, 0x00], [0xE6, 0x9F, 0x00], [0x56, 0xB4, 0xE9], [0x00, 0x72, 0xB2]])
    where = np.interp(np.log10(max(margin, 1e-6) if np.isfinite(margin) else 1e-6), [-2.3, -0.3], [0.0, 3.0])
    color = np.array([np.interp(where, np.arange(4), channel) for channel in stops.T])
    return f"#{color.round().astype(np.uint8).tobytes().hex()}"


# ---------------------------------------------------------------------- kinematics of a scene


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
        self.robot, self._rows, self._kinematics = robot, rows or RowStack(()), Kinematics(robot)
        self._at = self._kinematics.position(robot.configuration())

    def at(self, q: np.ndarray) -> PositionKinematics:
        """Kinematics of the robot at a configuration (nq,).

        Args:
            q: the configuration.
        """
        # Identity is enough: all elements of one picture get the same array.
        if q is not self._at.q:
            self._at = self._kinematics.position(q)
        return self._at

    def placement(self, name: str, q: np.ndarray) -> pin.SE3:
        """Placement of a frame in the world at a configuration (nq,).

        Args:
            name: name of the frame.
            q: the configuration.
        """
        return pin.SE3(*self.at(q).placement(self.robot.frame_id(name)))

    def point(self, name: str) -> Point:
        """Origin (3,) of a frame in the world [m], as a function of the state.

        Args:
            name: name of the frame.
        """
        index = self.robot.frame_id(name)
        return lambda state: self.at(state.q).placement(index).translation

    def path(self, name: str, configurations: np.ndarray) -> np.ndarray:
        """Origins (N, 3) of a frame at configurations (N, nq).

        Args:
            name: name of the frame.
            configurations: configurations of a run.
        """
        return np.array(self._kinematics.position(configurations).placement(self.robot.frame_id(name)).translation)

    def lines_of_action_at(self, state: DrawnState) -> tuple[np.ndarray, np.ndarray]:
        """Lines of action of the constraint rows: points and directions, (m, 3) each.

        Args:
            state: the state.
        """
        return self._rows.lines_of_action(self.at(state.q))

    def center_of_mass(self, q: np.ndarray) -> np.ndarray:
        """Centre of mass of the robot (3,) [m].

        Args:
            q: the configuration (nq,).
        """
        return self.at(q).center_of_mass[:, 0]  # its Jacobian follows

    def shape_placement(self, shape: pin.GeometryObject, q: np.ndarray) -> pin.SE3:
        """Placement of a shape in the world at a configuration (nq,).

        Args:
            shape: shape of the robot.
            q: the configuration.
        """
        return pin.SE3(*self.at(q).joint_placement(shape.parentJoint)) * shape.placement

    # ------------------------------------------------------------------ size

    def corners(self, q: np.ndarray) -> np.ndarray:
        """Corners (N, 3) of the bounding boxes of all shapes [m], without infinite shapes such as planes.

        Args:
            q: the configuration (nq,).
        """
        drawn = self.robot.drawn_geometry
        assert drawn is not None
        found = []
        farthest = 1e3  # [m]: boxes of planes are larger, boxes of robots are not
        for shape in drawn.geometryObjects:
            corners = box_corners(shape.geometry)
            if np.abs(corners).max() < farthest:
                placement = self.shape_placement(shape, q)
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

        def under(shape: pin.GeometryObject) -> Point:
            return lambda state: np.r_[self.shape_placement(shape, state.q).translation[:2], ground]

        def where_row_acts(row: int) -> Point:
            return lambda state: np.r_[self.lines_of_action_at(state)[0][row][:2], ground]

        drawn = self.robot.drawn_geometry
        shapes = [] if drawn is None else [s for s in drawn.geometryObjects if isinstance(s.geometry, coal.Cylinder)]

        def on_axle(shape: pin.GeometryObject, point: np.ndarray, along: np.ndarray) -> bool:
            placement, radius = self.shape_placement(shape, state.q), shape.geometry.radius
            # Across the axle, from above: a row may act at the middle of an axle with several wheels.
            aside = np.cross((placement.translation - point) * [1.0, 1.0, 0.0], along)
            parallel = abs(placement.rotation[:, 2] @ along) > 0.99
            low = abs(placement.translation[2] - radius - ground) < 0.25 * radius
            return bool(parallel and low and np.linalg.norm(aside) < 0.05 * radius)

        for row, (point, along) in enumerate(zip(points, directions, strict=True)):
            # A vertical row carries a wheel; rolling and lateral rows of the same wheel find it.
            if np.isnan(point).any() or abs(along[2]) > 0.5:
                continue
            wheels = {shape.name: under(shape) for shape in shapes if on_axle(shape, point, along)}
            tracks |= wheels
            # Rows of one contact share a point, which leaves one track.
            if not wheels and not any(np.linalg.norm(track(state)[:2] - point[:2]) < 1e-6 for track in tracks.values()):
                tracks[f"row {row}"] = where_row_acts(row)
        return tracks
