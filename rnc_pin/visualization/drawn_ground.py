"""Surfaces on which bodies roll, other than the plane z = 0 at rest, in pages."""

from __future__ import annotations

import numpy as np

from rnc_pin.model.mechanisms import GroundSurface
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.visualization.drawn_state import DrawnState
from rnc_pin.visualization.elements import GREEN, Element, LayerEntry
from rnc_pin.visualization.meshcat_library import mg
from rnc_pin.visualization.meshcat_scene import MeshcatScene

_OPACITY = 0.35
_WIDER = 1.3  # drawn half width over the largest distance of the robot from the middle


def grounds_of(reduced: ReducedModel | None) -> list[GroundSurface]:
    """Surfaces of all constraints of a system, each once."""
    found: list[GroundSurface] = []
    for place in () if reduced is None else reduced.all_constraints.places:
        if place.block.ground is not None and not any(place.block.ground is each for each in found):
            found.append(place.block.ground)
    return found


def ground_patch(ground: GroundSurface, places: np.ndarray, size: float) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (n, 3) and triangles (m, 3), seen from both sides, of the part of a surface under a motion.

    Each side has its own vertices: a vertex of both would have no normal, and shades at random.

    Args:
        ground: the surface.
        places: centres of mass of the robot over the motion (N, 3) [m].
        size: size of the robot [m].
    """
    middle = (places.min(axis=0) + places.max(axis=0)) / 2
    half = _WIDER * float(np.linalg.norm(places - middle, axis=1).max()) + 2.0 * size
    vertices, triangles = ground.mesh(middle, half)
    return np.concatenate([vertices, vertices]), np.concatenate([triangles, triangles[:, ::-1] + len(vertices)])


class GroundElement(Element):
    """Surface in the scene."""

    def __init__(self, name: str, vertices: np.ndarray, triangles: np.ndarray) -> None:
        self.entry = LayerEntry("ground", "surface", GREEN, "dot")
        self._node, self._mesh = f"surface/{name}", (vertices, triangles)

    def build(self, scene: MeshcatScene) -> None:
        scene.mesh(self._node, mg.TriangularMeshGeometry(*self._mesh), GREEN, _OPACITY)

    def update(self, scene: MeshcatScene, state: DrawnState) -> None:
        pass
