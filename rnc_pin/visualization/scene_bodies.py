"""Bodies of a scene: the robot, obstacles and ground.

A file may scale a mesh by negative factors, for example to draw both arms from one mesh. A placement cannot mirror, so
the mesh itself is mirrored. The placement contains only the absolute values of the factors.

A page includes the textures of Collada meshes, so each texture must be an image in a folder of the robot.
"""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from urllib.parse import unquote
from uuid import uuid1
from xml.etree import ElementTree

import coal
import numpy as np
import pinocchio as pin

from rnc_pin.collision import Obstacle
from rnc_pin.errors import ModelError, warn
from rnc_pin.io.json import Json
from rnc_pin.io.safe_read import read_bytes
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.rows import GroundSurface, carrier_of
from rnc_pin.robots.robot import Robot
from rnc_pin.robots.robot_files import is_below
from rnc_pin.robots.sources.mesh_readers import convex_hull
from rnc_pin.visualization.browser.page import mg
from rnc_pin.visualization.drawn_state import DrawnState, grounds_of
from rnc_pin.visualization.elements import GREEN, GREY, Element, LayerEntry, PlacedShapes, SceneKinematics, box_corners
from rnc_pin.visualization.meshcat_scene import MeshcatScene


def check_drawable(robot: Robot) -> None:
    """Check that a robot has geometry to draw.

    Args:
        robot: robot of a view.

    Raises:
        ModelError: the robot has no geometry.
    """
    if robot.drawn_geometry is None:
        raise ModelError(f"robot '{robot.name}' has no visual or collision geometry to draw")


def drawn_triangles(shape: pin.GeometryObject) -> np.ndarray:
    """Triangles (N, 3, 3) of a mesh as drawn, before ``drawn_scale``; corners counterclockwise seen from outside.

    Args:
        shape: shape with a mesh.
    """
    mesh, scale = shape.geometry, np.asarray(shape.meshScale, dtype=float)
    indices = (mesh.tri_indices(k) for k in range(mesh.num_tris))
    triangles = np.array(mesh.vertices())[np.array([(each[0], each[1], each[2]) for each in indices])]
    if scale.prod() < 0:  # mirroring reverses the orientation of every triangle
        triangles = triangles[:, ::-1]
    return np.asarray(triangles / np.abs(scale))


def own_textures(mesh: Path, folders: Sequence[Path]) -> dict[str, str] | None:
    """Images that a Collada file names, as data in addresses; None if one is not allowed, which a ModelWarning names.

    Args:
        mesh: path of the Collada file.
        folders: folders whose files the robot's description may name.

    Raises:
        OSError: the file cannot be read.
        xml.etree.ElementTree.ParseError: the file is not valid XML.
    """
    roots, found = [mesh.resolve().parent, *folders], dict[str, str]()
    for name in _names(ElementTree.fromstring(read_bytes(mesh))):
        places = [mesh.parent / each for each in {name, unquote(name)}]
        image = next(filter(None, (_image(place) for place in places if is_below(place, roots))), None)
        if image is None:
            warn(f"{mesh.name}: texture '{name[:120]}' is not an image below the robot's own folders and is left out")
            return None
        found[name] = f"data:image/png;base64,{b64encode(image).decode()}"  # browsers tell other formats by the content
    return found


def _names(root: ElementTree.Element) -> Iterator[str]:
    for library in root.iter():
        if str(library.tag).endswith("library_images"):
            for element in library.iter():
                if "init_from" in str(element.tag) and (len(element) or (element.text or "").strip()):
                    yield "".join(element.itertext())  # viewers take the text of child elements too
                elif str(element.tag).endswith("ref") and element.text:
                    yield element.text


def _image(path: Path) -> bytes | None:
    """Content of an image; None for any other file."""
    try:
        content = read_bytes(path)
    except (OSError, ValueError):
        return None
    targa_types = (1, 2, 3, 9, 10, 11)  # third byte of a Targa file, which has no magic number
    targa = path.suffix.lower() == ".tga" and len(content) > 18 and content[2] in targa_types
    # Of PNG, JPEG, GIF, BMP, WebP, TIFF in both orders, and DDS.
    beginnings = (b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff", b"GIF8", b"BM", b"RIFF", b"II*\0", b"MM\0*", b"DDS ")
    return content if content.startswith(beginnings) or targa else None


def drawn_mesh(shape: pin.GeometryObject, folders: Sequence[Path]) -> mg.Geometry | dict[str, Json]:
    """Meshcat geometry of a mesh: its file where Meshcat can use it, otherwise its triangles.

    A Collada file is an object of its own, which contains colours.

    Args:
        shape: shape with a mesh.
        folders: folders from which a page may include textures.
    """
    signs = np.sign(np.asarray(shape.meshScale, dtype=float))
    path = Path(shape.meshPath)
    ending = path.suffix.lower()
    readers = {".stl": mg.StlMeshGeometry, ".obj": mg.ObjMeshGeometry}
    try:
        textures = own_textures(path, folders) if ending == ".dae" else None
        if textures is not None:
            # The geometry stays in its file: the object is mirrored as a whole.
            mirror = np.diag([*signs, 1.0]).ravel().tolist()
            file = {"type": "_meshfile_object", "format": "dae", "data": read_bytes(path).decode()}
            whole = {"uuid": str(uuid1()), **file, "resources": textures, "matrix": mirror}
            return {"metadata": {"version": 4.5, "type": "Object"}, "geometries": [], "materials": [], "object": whole}
        # Files of one colour go as they are, which is smaller than triangles; a mirrored one cannot.
        if ending in readers and (signs > 0).all():
            return readers[ending].from_stream(BytesIO(read_bytes(path)))
    except Exception:  # for example a missing texture; the triangles are read already
        pass
    corners = drawn_triangles(shape).reshape(-1, 3)
    return mg.TriangularMeshGeometry(corners, np.arange(len(corners)).reshape(-1, 3))


def draw_robot(robot: Robot, scene: MeshcatScene) -> PlacedShapes:
    """Draw a robot, and return its shapes, which are not placed yet.

    Args:
        robot: robot to draw.
        scene: scene to draw in.

    Raises:
        ModelError: the robot has no geometry.
    """
    check_drawable(robot)
    shapes = PlacedShapes(robot, "robot/visuals")
    for shape in shapes.geometry.geometryObjects:
        is_mesh = isinstance(shape.geometry, coal.BVHModelBase)
        geometry = drawn_mesh(shape, robot.folders) if is_mesh else _drawable(shape.geometry)
        node, rgba = f"{shapes.node}/{shape.name}", np.array(shape.meshColor)
        if isinstance(geometry, dict):
            # A Collada file is an object with materials of its own, which Meshcat's Python classes cannot send.
            scene.window.post({"type": "set_object", "path": f"/meshcat/{node}", "object": geometry})
        else:
            color = int.from_bytes((255 * rgba[:3]).astype(np.uint8).tobytes(), "big")
            # Shiny, as in Pinocchio's own viewer; obstacles and arrows are dull.
            scene.root[node].set_object(geometry, mg.MeshPhongMaterial(color=color, opacity=float(rgba[3])))
    return shapes


_CIRCLE_POINTS = 32  # points of a circle


def surface_points(shape: coal.CollisionGeometry) -> np.ndarray:
    """Points (n, 3) [m] on a convex shape, in its own frame; their hull is the shape, apart from roundness.

    Of a plane or half space, the hull is a square slab below its surface.

    Args:
        shape: any convex shape.
    """
    patch, slab = 10.0, 0.01  # half side and thickness of the drawn part of a half space [m]
    if isinstance(shape, coal.Halfspace | coal.Plane):
        normal = np.ravel(shape.n)
        across = patch * np.linalg.svd(normal[None])[2][1:]
        corners = [a * across[0] + b * across[1] for a in (-1.0, 1.0) for b in (-1.0, 1.0)]
        return np.array([(shape.d - depth) * normal + corner for depth in (0.0, slab) for corner in corners])
    if isinstance(shape, coal.Convex):
        return np.array(shape.points())
    if isinstance(shape, coal.Sphere):
        return _ball(shape.radius)
    if isinstance(shape, coal.Capsule):
        ball, middle = _ball(shape.radius), np.array([0.0, 0.0, shape.halfLength])
        return np.concatenate([ball - middle, ball + middle])
    if isinstance(shape, coal.Cylinder):
        around = np.linspace(0.0, 2 * np.pi, _CIRCLE_POINTS, endpoint=False)
        ring = np.column_stack([shape.radius * np.cos(around), shape.radius * np.sin(around), np.zeros(_CIRCLE_POINTS)])
        middle = np.array([0.0, 0.0, shape.halfLength])
        return np.concatenate([ring - middle, ring + middle])
    return box_corners(shape)  # exact for a box, and around other shapes


def _ball(radius: float) -> np.ndarray:
    around, up = np.meshgrid(
        np.linspace(0.0, 2 * np.pi, _CIRCLE_POINTS, endpoint=False), np.linspace(0.0, np.pi, _CIRCLE_POINTS // 2 + 1)
    )
    points = [np.cos(around) * np.sin(up), np.sin(around) * np.sin(up), np.cos(up)]
    return radius * np.unique(np.stack(points, axis=-1).reshape(-1, 3).round(12), axis=0)


def points_at(shape: coal.CollisionGeometry, pose: pin.SE3) -> np.ndarray:
    """Points (n, 3) on a convex shape in the world [m].

    Args:
        shape: any convex shape.
        pose: its pose.
    """
    return surface_points(shape) @ pose.rotation.T + pose.translation


def outline(obstacle: Obstacle, t: float) -> np.ndarray:
    """Outline (n, 2) of an obstacle from above [m] at time t [s], counterclockwise.

    Args:
        obstacle: the obstacle.
        t: the time.
    """
    return hull_from_above(points_at(obstacle.shape, obstacle.placement(t)))


def hull_from_above(points: np.ndarray) -> np.ndarray:
    """Outline (n, 2) of points (N, 3) from above, counterclockwise.

    Args:
        points: points in the world [m].
    """
    from scipy.spatial import ConvexHull  # the import takes 0.1 s and is seldom needed

    flat = points[:, :2]
    return np.asarray(flat[ConvexHull(flat).vertices])


@dataclass(eq=False)
class Solid(Element):
    """Body in the scene, in the colour of its entry.

    Attributes:
        shape: its geometry.
        opacity: from 0 to 1.
        pose: its pose at a state.
        moves: False if the pose is always the same.
    """

    shape: mg.Geometry
    opacity: float
    pose: Callable[[DrawnState], pin.SE3]
    moves: bool

    def __post_init__(self) -> None:
        self._placed = False

    def build(self, scene: MeshcatScene) -> None:
        scene.mesh(self.node, self.shape, self.entry.color, self.opacity)

    def update(self, scene: MeshcatScene, state: DrawnState) -> None:
        # Placed once if it rests: each command of a live page is sent to all browsers.
        if self.moves or not self._placed:
            scene.place(self.node, self.pose(state).homogeneous)
        self._placed = True


def obstacle_element(obstacle: Obstacle) -> Element:
    """Element of an obstacle, at rest or in motion.

    Args:
        obstacle: the obstacle.
    """
    entry, moves = LayerEntry("obstacles", "obstacles", GREY, "dot"), obstacle.motion is not None
    opacity = 0.3 if obstacle.unbounded else 0.75  # both show the robot behind; a plane would hide most of the picture
    shape = _drawable(obstacle.shape)
    return Solid(entry, obstacle.name, shape, opacity, lambda state: obstacle.placement(state.time), moves)


def _drawable(shape: coal.CollisionGeometry) -> mg.Geometry:
    """Meshcat geometry of a convex shape."""
    if isinstance(shape, coal.Box):
        return mg.Box((2.0 * np.ravel(shape.halfSide)).tolist())
    if isinstance(shape, coal.Sphere):
        return mg.Sphere(float(shape.radius))
    if isinstance(shape, coal.Ellipsoid):
        return mg.Ellipsoid(np.ravel(shape.radii))
    if isinstance(shape, coal.Cylinder | coal.Cone):
        top = 0.0 if isinstance(shape, coal.Cone) else shape.radius
        round_shape = mg.Cylinder(2.0 * shape.halfLength, radiusTop=top, radiusBottom=shape.radius)
        # Three.js has cylinders along y.
        upright = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
        round_shape.intrinsic_transform = lambda: upright
        return round_shape
    # Capsules, half spaces and convex hulls have no shape of their own in Meshcat.
    hull = convex_hull(surface_points(shape))
    return mg.TriangularMeshGeometry(hull.vertices, hull.triangles)


def corners_over_time(obstacles: Sequence[Obstacle], times: Sequence[float]) -> np.ndarray:
    """Points (n, 3) [m] on all bounded obstacles at some times [s], for the camera.

    Args:
        obstacles: the obstacles.
        times: the times.
    """
    points = [points_at(each.shape, each.placement(t)) for each in obstacles if not each.unbounded for t in times]
    return np.concatenate(points) if points else np.zeros((0, 3))


# ---------------------------------------------------------------------- ground


def ground_pose(ground: GroundSurface, kinematics: SceneKinematics, q: np.ndarray) -> pin.SE3:
    """Pose of the body that carries a ground, whose axes the surface has; of the world without one.

    Args:
        ground: the surface.
        kinematics: kinematics of the drawn robot.
        q: configuration (nq,).
    """
    carrier = carrier_of(ground)
    return pin.SE3.Identity() if carrier is None else kinematics.placement(carrier, q)


def is_drawn(ground: GroundSurface, robot: Robot) -> bool:
    """True if a page draws the surface itself: it is in the world, or the body that carries it has no shapes.

    Args:
        ground: the surface.
        robot: the drawn robot.
    """
    carrier, drawn = carrier_of(ground), robot.drawn_geometry
    if carrier is None or drawn is None:
        return True
    # The joint and not the link: a plate may be a link that is fixed to the moving one.
    joint = robot.model.frames[robot.frame_id(carrier)].parentJoint
    return all(shape.parentJoint != joint for shape in drawn.geometryObjects)


def ground_patch(ground: GroundSurface, places: np.ndarray, size: float) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (n, 3) and triangles (m, 3), seen from both sides, of the part of a surface under a motion.

    Each side has its own vertices: a vertex of both would have no normal, and shades at random.

    Args:
        ground: the surface.
        places: centres of mass of the robot over the motion (N, 3) [m]; for ground on a body, in the body's axes.
        size: size of the robot [m].
    """
    middle = (places.min(axis=0) + places.max(axis=0)) / 2
    in_world, on_body = 2.0, 0.3  # drawn half width of ground over the size of the robot
    around = in_world if carrier_of(ground) is None else on_body
    motion_margin = 1.3  # drawn half width over the largest distance of the robot from the middle
    half = motion_margin * float(np.linalg.norm(places - middle, axis=1).max()) + around * size
    vertices, triangles = ground.mesh(middle, half)
    return np.concatenate([vertices, vertices]), np.concatenate([triangles, triangles[:, ::-1] + len(vertices)])


def ground_elements(
    reduced: ReducedModel | None, kinematics: SceneKinematics, configurations: np.ndarray, size: float
) -> list[Element]:
    """Elements of the surfaces of a system, each as large as a motion and the robot need.

    Args:
        reduced: the system, if any.
        kinematics: kinematics of the drawn robot.
        configurations: configurations (N, nq) of the motion.
        size: size of the robot [m].
    """

    def element(name: str, ground: GroundSurface) -> Element:
        poses = ((ground_pose(ground, kinematics, q), kinematics.center_of_mass(q)) for q in configurations)
        places = np.stack([pose.actInv(center) for pose, center in poses])
        patch, moves = mg.TriangularMeshGeometry(*ground_patch(ground, places, size)), carrier_of(ground) is not None
        entry = LayerEntry("ground", "surface", GREEN, "dot")
        return Solid(entry, name, patch, 0.35, lambda state: ground_pose(ground, kinematics, state.q), moves)

    drawn = (each for each in grounds_of(reduced) if is_drawn(each, kinematics.robot))
    return [element(str(k), each) for k, each in enumerate(drawn)]
