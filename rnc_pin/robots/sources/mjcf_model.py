"""Pinocchio model, shapes and meshes of a compiled MJCF. ``mesh_formats`` reads the files: MuJoCo opens none."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree

import coal
import numpy as np
import pinocchio as pin

from rnc_pin.errors import ModelError, few
from rnc_pin.printing import counted
from rnc_pin.robots.sources import mesh_formats, mesh_readers
from rnc_pin.robots.sources.description import ROOT_JOINTS, check_not_negative, check_numbers, read_numbers
from rnc_pin.robots.sources.mesh_readers import Mesh

if TYPE_CHECKING:
    import mujoco

FREE, BALL, SLIDE, HINGE = range(4)
_ALIGNED = {HINGE: (pin.JointModelRX, pin.JointModelRY, pin.JointModelRZ)}
_ALIGNED[SLIDE] = (pin.JointModelPX, pin.JointModelPY, pin.JointModelPZ)
_SKEW = {HINGE: pin.JointModelRevoluteUnaligned, SLIDE: pin.JointModelPrismaticUnaligned}
SMALLEST = 1e-15
"""Smallest mass [kg] and moment of inertia [kg m^2] of a moving body in MuJoCo (mjMINVAL)."""


class ModelBuilder:
    """Model with one joint for each joint of the file, in order. Bodies and sites are frames.

    Each of several joints of a body carries a body of its own, without mass.

    Args:
        compiled: the ``mujoco.MjModel``.
        name: name of the model.
        base: None keeps the root joints of the file; "fixed", "planar" or "free" replaces its free joint.

    Attributes:
        model: the model.
        frames: indices of the frames of bodies, by their index in MuJoCo, the world first.
        joints: index in MuJoCo to index in the model; a replaced free joint is missing.
        references: values of hinges and slides in the configuration of the file [rad or m].
        notes: texts on what is left out; each can follow the file name.

    Raises:
        ModelError: the base cannot be replaced, or a joint has an impossible name, range or damping.
    """

    def __init__(self, compiled: mujoco.MjModel, name: str, base: str | None) -> None:
        import mujoco

        self._compiled, self._base = compiled, base
        self._make_root = ROOT_JOINTS[base or "fixed"]
        self.model = pin.Model()
        self.model.name = name
        weightless = compiled.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_GRAVITY
        self.model.gravity.linear = np.zeros(3) if weightless else compiled.opt.gravity
        self.joints: dict[int, int] = {}
        self.references: dict[str, float] = {}
        self._check_base()
        names = [compiled.body(k).name for k in range(compiled.nbody)]
        self._free = (each for k in itertools.count(1) if (each := f"body_{k}") not in names)
        self._names = [name or next(self._free) for name in names]
        self.frames = [0]
        for body in range(1, compiled.nbody):
            self.frames.append(self._add_body(body))
        for site in range(compiled.nsite):
            if compiled.site_bodyid[site] or compiled.site(site).name:  # nothing refers to nameless marks in the world
                self._add_site(site)
        springs = [self.model.names[self.joints[k]] for k in self.joints if np.ravel(compiled.jnt_stiffness[k])[0]]
        text = f"springs (stiffness, springdamper) are left out of the model: joint {few(springs)}"
        self.notes = [text] if springs else []

    def joint_name(self, joint: int) -> str:
        """Name of a joint of the file; by default the name of its body with a number.

        Args:
            joint: index of the joint in MuJoCo.
        """
        compiled, body = self._compiled, self._compiled.jnt_bodyid[joint]
        ending = "_free" if compiled.jnt_type[joint] == FREE else f"Joint_{joint - compiled.body_jntadr[body]}"
        return compiled.joint(joint).name or self._names[body] + ending

    def _check_base(self) -> None:
        """Refuse a base that cannot be replaced, and names with which Pinocchio would end the process."""
        compiled = self._compiled
        taken = {"universe"} if self._make_root is None else {"universe", "root_joint"}
        for k in range(compiled.njnt):
            name = compiled.joint(k).name
            if name in taken and (self._base is None or compiled.jnt_type[k] != FREE):
                raise ModelError(f"a joint cannot be called '{name}': it is the base's name")
        if self._make_root is None:
            return
        roots = [k for k in range(1, compiled.nbody) if compiled.body_parentid[k] == 0]
        names = [compiled.body(k).name or "without a name" for k in roots]
        if len(roots) > 1:
            raise ModelError(
                f"base='{self._base}' moves one body, and in <worldbody> there are {len(roots)}: {few(names)}; "
                "take the file's own base (None), or a file of one"
            )
        own = self._own_joints(roots[0])
        if own:
            raise ModelError(
                f"base='{self._base}' would move body '{names[0]}', which has {counted(len(own), 'joint')} of its "
                "own: take the file's own base (None)"
            )

    def _own_joints(self, body: int) -> list[int]:
        """Joints of a body, without a free joint that the base replaces."""
        first, count = self._compiled.body_jntadr[body], self._compiled.body_jntnum[body]
        return [k for k in range(first, first + count) if self._base is None or self._compiled.jnt_type[k] != FREE]

    def frame(self, body: int) -> pin.Frame:
        """Frame of a body.

        Args:
            body: index of the body in MuJoCo.
        """
        return self.model.frames[self.frames[body]]

    def _add_body(self, body: int) -> int:
        compiled, model = self._compiled, self.model
        frame = self.frames[compiled.body_parentid[body]]
        parent, place = model.frames[frame].parentJoint, model.frames[frame].placement.copy()
        joints, name, inertia = self._own_joints(body), self._names[body], self._inertia(body)
        if compiled.body_jntnum[body] == len(joints):  # else the base takes the place of the free joint
            place = place * pose(compiled.body_pos[body], compiled.body_quat[body])
        index = parent
        if frame == 0 and self._make_root is not None:
            index, frame, place = self._add_joint(0, 0, self._make_root(), pin.SE3.Identity(), "root_joint")
        for joint in joints:
            # Several joints of one body follow each other: each needs a frame that carries the next one.
            if joint != joints[0]:
                frame = model.addBodyFrame(next(self._free), index, place, frame)
            index, frame, place = self._add_file_joint(joint, index, frame, place)
        # A body without joints: its frame keeps its inertia, as frames of fixed joints in a URDF do.
        if index == parent:
            frame = model.addFrame(pin.Frame(f"{name}_fixed", index, frame, place, pin.FrameType.FIXED_JOINT, inertia))
        else:
            model.appendBodyToJoint(index, inertia, place)
        return int(model.addBodyFrame(name, index, place, frame))

    def _inertia(self, body: int) -> pin.Inertia:
        compiled = self._compiled
        mass = float(compiled.body_mass[body])
        # ``compile_document`` gives moving bodies the smallest mass of MuJoCo where they have none.
        if mass <= SMALLEST:
            return pin.Inertia.Zero()
        place = pose(compiled.body_ipos[body], compiled.body_iquat[body])
        tensor = place.rotation * compiled.body_inertia[body] @ place.rotation.T
        # Rounding of the rotation makes the product slightly unsymmetric.
        return pin.Inertia(mass, place.translation, (tensor + tensor.T) / 2)

    def _add_joint(
        self, parent: int, frame: int, joint: pin.JointModel, place: pin.SE3, name: str, *limits: np.ndarray
    ) -> tuple[int, int, pin.SE3]:
        """Add a joint with its frame. Return their indices, and the placement of what the joint carries."""
        index = self.model.addJoint(parent, joint, place, name, *limits)
        return index, self.model.addJointFrame(index, frame), pin.SE3.Identity()

    def _add_file_joint(self, k: int, parent: int, frame: int, place: pin.SE3) -> tuple[int, int, pin.SE3]:
        compiled, kind, name = self._compiled, self._compiled.jnt_type[k], self.joint_name(k)
        low, high = compiled.jnt_range[k]
        damping = compiled.dof_damping.reshape(compiled.nv, -1)[compiled.jnt_dofadr[k], 0]
        friction = compiled.dof_frictionloss[compiled.jnt_dofadr[k]]
        check_not_negative({"damping": damping, "friction": friction}, f"joint '{name}'")
        if low > high:
            raise ModelError(f"range of joint '{name}' has a lower limit above the upper: {low:g} {high:g}")
        anchor, rest = pin.SE3(np.eye(3), compiled.jnt_pos[k]), pin.SE3.Identity()
        quaternion_limit = 1.01  # of its entries, as in Pinocchio
        if kind in _SKEW:
            axis, value = compiled.jnt_axis[k], compiled.qpos0[compiled.jnt_qposadr[k]]
            self.references[name] = float(value)
            motion = pin.Motion(np.zeros(6))
            motion.vector = np.r_[np.zeros(3), axis] if kind == HINGE else np.r_[axis, np.zeros(3)]
            # MJCF draws joints at their ref: a turn back makes that configuration q = ref, as in MuJoCo.
            rest = pin.exp6(-value * motion)
            # Pinocchio has faster joints for coordinate axes.
            unit = np.flatnonzero(axis == 1.0)
            joint = _ALIGNED[kind][unit[0]]() if unit.size else _SKEW[kind](axis)
            limits = np.array([[low], [high]]) if compiled.jnt_limited[k] else np.array([[-np.inf], [np.inf]])
        else:
            joint = pin.JointModelFreeFlyer() if kind == FREE else pin.JointModelSpherical()
            highest = np.r_[np.full(3 if kind == FREE else 0, np.inf), np.full(4, quaternion_limit)]
            limits = np.array([-highest, highest])
        if kind == FREE:  # its configuration is the pose in the world
            place = anchor = pin.SE3.Identity()
        endless = np.full(joint.nv, np.inf)
        index, frame, _ = self._add_joint(parent, frame, joint, place * anchor * rest, name, endless, endless, *limits)
        model, added = self.model, self.model.joints[index]
        entries = slice(added.idx_v, added.idx_v + added.nv)
        model.damping[entries], model.armature[entries] = damping, compiled.dof_armature[compiled.jnt_dofadr[k]]
        model.lowerDryFrictionLimit[entries], model.upperDryFrictionLimit[entries] = -friction, friction
        self.joints[k] = index
        return index, frame, anchor.inverse()

    def _add_site(self, site: int) -> None:
        compiled = self._compiled
        body = compiled.site_bodyid[site]
        frame = self.frame(body)
        number = site - next(k for k in range(compiled.nsite) if compiled.site_bodyid[k] == body)
        place = frame.placement * pose(compiled.site_pos[site], compiled.site_quat[site])
        name = compiled.site(site).name or f"{frame.name}Site_{number}"
        self.model.addFrame(pin.Frame(name, frame.parentJoint, self.frames[body], place, pin.FrameType.OP_FRAME))


def pose(position: np.ndarray, quaternion: np.ndarray) -> pin.SE3:
    """Pose of a position (3,) and a quaternion (4,) of MuJoCo, its scalar first.

    Args:
        position: (3,) [m].
        quaternion: (4,), scalar first.
    """
    return pin.XYZQUATToSE3(np.r_[position, quaternion[1:], quaternion[0]])


# ---------------------------------------------------------------------- meshes


_MESH = 7  # type of a shape
_MOVED = {"refpos", "refquat"}


class MeshAssets:
    """Meshes of a file. MuJoCo is given a tetrahedron for each, and the triangles of meshes that have mass.

    Args:
        root: root element of the file, with absolute paths of meshes; changed in place.

    Raises:
        ModelError: the scale of a mesh is not valid.
    """

    def __init__(self, root: ElementTree.Element) -> None:
        self._all_weigh = any(each.get("inertiafromgeom") == "true" for each in root.findall("compiler"))
        self._attributes: dict[str, dict[str, str]] = {}
        kept_keys = ("class", "scale", "inertia", "maxhullvert")
        # Its corners: MuJoCo refuses a mesh without vertices.
        tetrahedron = "100 100 100 100 -100 -100 -100 100 -100 -100 -100 100"
        for mesh in root.findall("asset/mesh"):
            name = mesh.get("name") or Path(mesh.get("file", "")).stem
            if read_numbers(mesh.get("scale", "1 1 1"), 3) is None:
                raise ModelError(f"mesh '{name}': scale takes three numbers, found '{mesh.get('scale')}'")
            self._attributes[name] = dict(mesh.attrib)
            kept = {key: mesh.attrib[key] for key in kept_keys if key in mesh.attrib}
            mesh.attrib.clear()
            mesh.attrib.update(kept, name=name, vertex=tetrahedron)

    def put_in(self, spec: mujoco.MjSpec) -> None:
        """Put triangles into a ``mujoco.MjSpec``, for the meshes that determine a mass or the size of a shape.

        Args:
            spec: the specification, changed in place.

        Raises:
            ModelError: such a mesh cannot be used.
        """
        bodies = [body for body in spec.bodies if self._all_weigh or not body.explicitinertial]
        needed = {geom.meshname for body in bodies[1:] for geom in body.geoms}
        # Primitives that are fitted to a mesh take its size.
        needed |= {geom.meshname for geom in spec.geoms if geom.type != _MESH}
        shapes, flat = mesh_formats.MeshShapes(), set[str]()
        for mesh in spec.meshes:
            if mesh.name not in needed:
                continue
            with ModelError.at(f"mesh '{mesh.name}'"):
                found = self._read(mesh.name)
                shapes.count(found)
                vertices = mesh_formats.scaled_vertices(found, np.array(mesh.scale))
            if mesh_readers.is_flat(vertices.astype(np.float32).astype(float)):  # the precision of MuJoCo
                flat.add(mesh.name)
            mesh.uservert, mesh.userface = found.vertices.ravel(), found.triangles.ravel()
        for geom in spec.geoms:
            if geom.meshname in flat:  # MuJoCo builds convex hulls of colliding meshes; a flat mesh has none
                geom.contype = geom.conaffinity = 0

    def fill(self, geometry: pin.GeometryModel, uses: Mapping[int, tuple[str, np.ndarray]]) -> None:
        """Put meshes in the place of other shapes.

        Args:
            geometry: geometry of the robot, changed in place.
            uses: index of a shape to the name and the scale (3,) of its mesh.

        Raises:
            ModelError: a mesh cannot be used.
        """
        shapes = mesh_formats.MeshShapes()
        for place, (name, factors) in uses.items():
            attributes = self._attributes[name]
            # Viewers share a file as it stands by its path; one that the description moves is a mesh of its own.
            file = "" if _MOVED & set(attributes) else attributes.get("file", "")
            with ModelError.at(f"mesh '{name}'"):
                shapes.put(geometry.geometryObjects[place], name, partial(self._read, name), factors, file)

    def _read(self, name: str) -> Mesh:
        attributes = self._attributes[name]
        file = attributes.get("file")
        mesh = _inline_triangles(attributes) if file is None else mesh_formats.read_mesh(Path(file))
        if not _MOVED & set(attributes):
            return mesh
        place = check_numbers(attributes.get("refpos", "0 0 0"), (3,), "refpos")
        turn = check_numbers(attributes.get("refquat", "1 0 0 0"), (4,), "refquat")
        if not turn.any():
            raise ModelError("refquat is zero")
        rotation = pin.Quaternion(turn[0], *turn[1:]).normalized().matrix()
        # refpos and refquat are the place of the new origin in the file: vertices move the other way.
        return mesh_readers.checked_mesh((mesh.vertices - place) @ rotation, mesh.triangles)


def _inline_triangles(attributes: Mapping[str, str]) -> Mesh:
    """Return the triangles in a description, or the convex hull if it has only points.

    Raises:
        ModelError: no points, or they are not well formed.
    """
    points = read_numbers(attributes.get("vertex", ""))
    corners = read_numbers(attributes.get("face", ""))
    if points is None or corners is None or points.size % 3 or corners.size % 3 or (corners % 1).any():
        raise ModelError("vertex and face take three numbers per entry")
    if not points.size:
        raise ModelError("has neither a file nor vertices")
    # As MuJoCo does for a mesh of vertices without faces.
    if not corners.size:
        return mesh_readers.convex_hull(points)
    if np.abs(corners).max() > points.size:
        raise ModelError("a face has an unknown vertex")
    return mesh_readers.checked_mesh(points, corners.astype(np.int64))


# ---------------------------------------------------------------------- shapes


_SHAPES = {
    2: lambda size: coal.Sphere(size[0]),
    3: lambda size: coal.Capsule(size[0], 2 * size[1]),
    4: lambda size: coal.Ellipsoid(size),
    5: lambda size: coal.Cylinder(size[0], 2 * size[1]),
    6: lambda size: coal.Box(2 * size),
}


class MjcfGeometry:
    """Function for the geometry of a kind, "visual" or "collision". It reads meshes when it is called.

    An infinite floor is not part of the robot.

    Args:
        compiled: the ``mujoco.MjModel``.
        built: the model.
        assets: meshes of the file.
        path: path of the file, for messages.
    """

    def __init__(self, compiled: mujoco.MjModel, built: ModelBuilder, assets: MeshAssets, path: Path) -> None:
        self._assets, self._path = assets, path
        self._models = {kind: pin.GeometryModel() for kind in ("visual", "collision")}
        """Shapes of each kind, with a sphere in place of each mesh."""
        self._meshes: dict[str, dict[int, tuple[str, np.ndarray]]] = {kind: {} for kind in self._models}
        """Of each kind, the meshes by the index of their shape: names may repeat."""
        for k in range(compiled.ngeom):
            if compiled.geom_type[k] in (*_SHAPES, _MESH):
                self._add(compiled, k, built)

    def __call__(self, kind: str) -> pin.GeometryModel:
        """Return the geometry.

        Raises:
            ModelError: a mesh cannot be used.
        """
        geometry = self._models[kind].copy()
        with ModelError.at(self._path):
            self._assets.fill(geometry, self._meshes[kind])
        return geometry

    def _add(self, compiled: mujoco.MjModel, k: int, built: ModelBuilder) -> None:
        body, mesh = compiled.geom_bodyid[k], int(compiled.geom_dataid[k])
        frame = built.frame(body)
        owner = "world" if body == 0 else frame.name
        name = compiled.geom(k).name or f"{owner}Geom_{k - compiled.body_geomadr[body]}"
        place = frame.placement * pose(compiled.geom_pos[k], compiled.geom_quat[k])
        shape = coal.Sphere(1.0)
        is_mesh = compiled.geom_type[k] == _MESH
        if is_mesh:  # MuJoCo rotates meshes to their principal axes
            place = place * pose(compiled.mesh_pos[mesh], compiled.mesh_quat[mesh]).inverse()
        else:
            shape = _SHAPES[compiled.geom_type[k]](np.array(compiled.geom_size[k]))
        collision_only = 3  # groups from here on are not drawn if they collide, as Pinocchio has it
        kinds = ("visual", "collision") if compiled.geom_group[k] < collision_only else ("collision",)
        # Shapes that never collide are drawn, whatever their group.
        if not (compiled.geom_contype[k] or compiled.geom_conaffinity[k]):
            kinds = ("visual",)
        material = compiled.geom_matid[k]
        color = compiled.geom_rgba[k] if material < 0 else compiled.mat_rgba[material]
        # MuJoCo has colours in single precision, in which 0.8 is 0.800000012.
        color, file = np.round(color.astype(float), 6), type(shape).__name__.upper()  # named as Pinocchio names shapes
        at = frame.parentJoint, built.frames[body], place
        made = pin.GeometryObject(name, *at, shape, file, np.ones(3), False, color)
        for kind in kinds:
            index = self._models[kind].addGeometryObject(made)
            if is_mesh:
                self._meshes[kind][index] = compiled.mesh(mesh).name, np.array(compiled.mesh_scale[mesh])
