"""Surfaces on which bodies roll, other than the plane z = 0 at rest, in pages."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np
import pinocchio as pin

from rnc_pin.model.mechanisms import GroundSurface, carrier_of
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.robots.robot import Robot
from rnc_pin.visualization.drawn_model import grounds_of
from rnc_pin.visualization.drawn_state import DrawnState
from rnc_pin.visualization.elements import GREEN, Element, LayerEntry
from rnc_pin.visualization.meshcat_library import mg
from rnc_pin.visualization.meshcat_scene import MeshcatScene
from rnc_pin.visualization.scene_kinematics import SceneKinematics

_OPACITY = 0.35
_AROUND, _AROUND_CARRIER = 2.0, 0.3  # drawn half width of ground in the world, or on a body, over the size of the robot
_WIDER = 1.3  # drawn half width over the largest distance of the robot from the middle


def seen_from(ground: GroundSurface, kinematics: SceneKinematics, q: np.ndarray) -> np.ndarray:
    """Centre of mass of the robot (3,) [m], in the axes of the body that carries a ground, or of the world."""
    center, carrier = kinematics.center_of_mass(q), carrier_of(ground)
    return center if carrier is None else np.asarray(kinematics.placement(carrier, q).actInv(center))


def carrier_placement(ground: GroundSurface, kinematics: SceneKinematics) -> Callable[[DrawnState], pin.SE3] | None:
    """Placement of the frame that carries a ground, as a function of the state; None for ground in the world."""
    carrier = carrier_of(ground)
    return None if carrier is None else kinematics.frame(carrier)


def is_drawn(ground: GroundSurface, robot: Robot) -> bool:
    """True if a page draws the surface itself: it is in the world, or the body that carries it has no shapes."""
    carrier = carrier_of(ground)
    if carrier is None or robot.visual_model is None:
        return True
    joint = robot.model.frames[robot.frame_id(carrier)].parentJoint
    return all(shape.parentJoint != joint for shape in robot.visual_model.geometryObjects)


def ground_patch(ground: GroundSurface, places: np.ndarray, size: float) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (n, 3) and triangles (m, 3), seen from both sides, of the part of a surface under a motion.

    Each side has its own vertices: a vertex of both would have no normal, and shades at random.

    Args:
        ground: the surface.
        places: centres of mass of the robot over the motion (N, 3) [m]; for ground on a body, in the body's axes.
        size: size of the robot [m].
    """
    middle = (places.min(axis=0) + places.max(axis=0)) / 2
    around = _AROUND if carrier_of(ground) is None else _AROUND_CARRIER
    half = _WIDER * float(np.linalg.norm(places - middle, axis=1).max()) + around * size
    vertices, triangles = ground.mesh(middle, half)
    return np.concatenate([vertices, vertices]), np.concatenate([triangles, triangles[:, ::-1] + len(vertices)])


class GroundElement(Element):
    """Surface in the scene, at rest or on a body.

    Args:
        name: name of the node.
        patch: vertices (n, 3) and triangles (m, 3).
        placement: placement of the body that carries it, as a function of the state.
    """

    def __init__(
        self,
        name: str,
        patch: tuple[np.ndarray, np.ndarray],
        placement: Callable[[DrawnState], pin.SE3] | None = None,
    ) -> None:
        self.entry = LayerEntry("ground", "surface", GREEN, "dot")
        self._node, self._mesh, self._placement = f"surface/{name}", patch, placement

    def build(self, scene: MeshcatScene) -> None:
        scene.mesh(self._node, mg.TriangularMeshGeometry(*self._mesh), GREEN, _OPACITY)

    def update(self, scene: MeshcatScene, state: DrawnState) -> None:
        if self._placement is not None:
            scene.place(self._node, self._placement(state).homogeneous)


def ground_elements(
    reduced: ReducedModel | None, kinematics: SceneKinematics, configurations: Iterable[np.ndarray], size: float
) -> list[Element]:
    """Elements of the surfaces of a system, each as large as a motion and the robot need.

    Args:
        reduced: the system, if any.
        kinematics: kinematics of the drawn robot.
        configurations: configurations (nq,) of the motion.
        size: size of the robot [m].
    """
    moments, found = list(configurations), list[Element]()
    drawn = [each for each in grounds_of(reduced) if is_drawn(each, kinematics.robot)]
    for k, ground in enumerate(drawn):
        places = np.stack([seen_from(ground, kinematics, q) for q in moments])
        found.append(GroundElement(str(k), ground_patch(ground, places, size), carrier_placement(ground, kinematics)))
    return found
