"""Shapes of a compiled MJCF."""

from __future__ import annotations

from typing import Any, NamedTuple

import coal
import numpy as np
import pinocchio as pin

from rnc_pin.robots.sources.mjcf_meshes import MeshAssets
from rnc_pin.robots.sources.mjcf_model import ModelBuilder, pose

_MESH = 7
_SHAPES = {
    2: lambda size: coal.Sphere(size[0]),
    3: lambda size: coal.Capsule(size[0], 2 * size[1]),
    4: lambda size: coal.Ellipsoid(size),
    5: lambda size: coal.Cylinder(size[0], 2 * size[1]),
    6: lambda size: coal.Box(2 * size),
}
_COLLISION_ONLY = 3  # groups from here on are not drawn if they collide, as Pinocchio has it


class _Shape(NamedTuple):
    """Shape of a body; ``mesh`` and ``scale`` are those of a mesh."""

    name: str
    kinds: tuple[str, ...]
    joint: int
    frame: int
    placement: pin.SE3
    type: int
    size: np.ndarray
    color: np.ndarray
    mesh: str
    scale: np.ndarray


class MjcfGeometry:
    """Function for the geometry of a kind, "visual" or "collision". It reads meshes when it is called.

    An infinite floor is not part of the robot.

    Args:
        compiled: the ``mujoco.MjModel``.
        built: the model.
        assets: meshes of the file.
    """

    def __init__(self, compiled: Any, built: ModelBuilder, assets: MeshAssets) -> None:
        self._assets = assets
        known = [k for k in range(compiled.ngeom) if compiled.geom_type[k] in (*_SHAPES, _MESH)]
        self._shapes = [_read(compiled, k, built) for k in known]

    def __call__(self, kind: str) -> pin.GeometryModel:
        """Return the geometry.

        Raises:
            ModelError: a mesh cannot be used.
        """
        geometry, shapes = pin.GeometryModel(), [each for each in self._shapes if kind in each.kinds]
        meshes = self._assets.load([(each.mesh, each.scale) for each in shapes if each.type == _MESH])
        for each in shapes:
            if each.type == _MESH:
                file, scale, shape = next(meshes)
            else:
                shape, scale = _SHAPES[each.type](each.size), np.ones(3)
                file = type(shape).__name__.upper()  # as Pinocchio names them
            geometry.addGeometryObject(
                pin.GeometryObject(
                    each.name, each.joint, each.frame, each.placement, shape, file, scale, False, each.color
                )
            )
        return geometry


def _read(compiled: Any, k: int, built: ModelBuilder) -> _Shape:
    body, mesh = compiled.geom_bodyid[k], int(compiled.geom_dataid[k])
    carrier = built.carriers[body]
    place = carrier.placement * pose(compiled.geom_pos[k], compiled.geom_quat[k])
    if compiled.geom_type[k] == _MESH:  # MuJoCo rotates meshes to their principal axes
        place = place * pose(compiled.mesh_pos[mesh], compiled.mesh_quat[mesh]).inverse()
    kinds = ("visual", "collision") if compiled.geom_group[k] < _COLLISION_ONLY else ("collision",)
    if not (compiled.geom_contype[k] or compiled.geom_conaffinity[k]):
        kinds = ("visual",)
    material = compiled.geom_matid[k]
    color = compiled.geom_rgba[k] if material < 0 else compiled.mat_rgba[material]
    is_mesh = compiled.geom_type[k] == _MESH
    return _Shape(
        compiled.geom(k).name or f"{'world' if body == 0 else carrier.name}Geom_{k - compiled.body_geomadr[body]}",
        kinds,
        carrier.joint,
        carrier.frame,
        place,
        int(compiled.geom_type[k]),
        np.array(compiled.geom_size[k]),
        np.round(color.astype(float), 6),
        compiled.mesh(mesh).name if is_mesh else "",
        np.array(compiled.mesh_scale[mesh]) if is_mesh else np.ones(3),
    )
