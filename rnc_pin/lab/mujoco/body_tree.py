"""Bodies, joints and equality constraints of a loaded robot as a MuJoCo specification, and the coordinates of both.

Pinocchio has quaternions (x, y, z, w), (cos, sin) for continuous joints, and velocities of planar and free joints in
the body frame. MuJoCo has (w, x, y, z), a plain angle, and the linear velocity of a free joint in the world frame.
Generalized forces transform by the transpose of the velocity map, since power is the same in both.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
import pinocchio as pin
import scipy

from rnc_pin.errors import ConfigurationError, missing_extra
from rnc_pin.lab.mujoco.contact_bodies import Root
from rnc_pin.model.coordinates import heading_of
from rnc_pin.model.rows import FrameAnchor, JointCoupler, Rows
from rnc_pin.robots.robot import Robot

try:
    import mujoco as mujoco  # other modules of this room have it from here, with one error where it is missing
except ImportError:
    raise ConfigurationError(missing_extra("mujoco")) from None


_PLACEHOLDER_MASS = 1e-12  # placeholder mass and inertia for the compiler; ``finish`` writes the robot's


# ---------------------------------------------------------------------- coordinates


@dataclass(frozen=True)
class JointCoordinates:
    """Place of one joint in the vectors of Pinocchio and of MuJoCo, where its velocities are equal.

    Attributes:
        name: joint name.
        q, v: first indices in Pinocchio's vectors.
        nv: degrees of freedom in Pinocchio.
        qpos, dof: first indices in MuJoCo's vectors.
    """

    name: str
    q: int
    v: int
    nv: int
    qpos: int
    dof: int


@dataclass(frozen=True)
class EqualCoordinates(JointCoordinates):
    """Joint with equal numbers in both: hinges, slides, stacks of them, and quaternions of ball joints."""

    order: tuple[int, ...]
    """Entry in q of each entry in MuJoCo's positions."""


class ContinuousHinge(JointCoordinates):
    """Continuous hinge: (cos, sin) in Pinocchio, an unwrapped angle in MuJoCo."""


@dataclass(frozen=True)
class BaseCoordinates(JointCoordinates, ABC):
    """Conversion of a planar or free base, whose velocities differ: MuJoCo has ``velocity_map(qpos) @ v``."""

    def write(self, q: np.ndarray, v: np.ndarray, qpos: np.ndarray, qvel: np.ndarray) -> None:
        """Write a Pinocchio state to MuJoCo's.

        Args:
            q: configuration (nq,).
            v: velocity (nv,).
            qpos, qvel: vectors of MuJoCo, which receive the base.
        """
        self.write_pose(q[self.q :], qpos[self.qpos :])
        J = self.velocity_map(qpos[self.qpos :])
        qvel[self.dof : self.dof + len(J)] = J @ v[self.v : self.v + self.nv]

    def read(self, qpos: np.ndarray, qvel: np.ndarray, q: np.ndarray, v: np.ndarray) -> None:
        """Write a MuJoCo state to Pinocchio's.

        Args:
            qpos, qvel: vectors of MuJoCo.
            q: configuration (nq,), which receives the base.
            v: velocity (nv,), which receives the base.
        """
        self.read_pose(qpos[self.qpos :], q[self.q :])
        J = self.velocity_map(qpos[self.qpos :])  # its columns are orthonormal
        v[self.v : self.v + self.nv] = qvel[self.dof : self.dof + len(J)] @ J

    def add_force(self, qpos: np.ndarray, force: np.ndarray, applied: np.ndarray) -> None:
        """Add a generalized force of Pinocchio (nv,) to the applied force of MuJoCo.

        Args:
            qpos: positions of MuJoCo.
            force: generalized force (nv,).
            applied: applied force of MuJoCo, which receives it.
        """
        J = self.velocity_map(qpos[self.qpos :])
        applied[self.dof : self.dof + len(J)] += J @ force[self.v : self.v + self.nv]

    @abstractmethod
    def write_pose(self, q: np.ndarray, qpos: np.ndarray) -> None:
        """Write the pose of Pinocchio to MuJoCo's; both begin with the base.

        Args:
            q: configuration.
            qpos: positions of MuJoCo, which receive it.
        """

    @abstractmethod
    def read_pose(self, qpos: np.ndarray, q: np.ndarray) -> None:
        """Write the pose of MuJoCo to Pinocchio's; both begin with the base.

        Args:
            qpos: positions of MuJoCo.
            q: configuration, which receives it.
        """

    @abstractmethod
    def velocity_map(self, qpos: np.ndarray) -> np.ndarray:
        """Velocities of MuJoCo from those of Pinocchio, (k, nv).

        Args:
            qpos: positions of MuJoCo that begin with the base.
        """


@dataclass(frozen=True)
class PlanarBase(BaseCoordinates):
    """Planar base: two slides and a hinge in MuJoCo; ``lifted`` adds a vertical slide before the hinge."""

    lifted: bool = False

    def write_pose(self, q: np.ndarray, qpos: np.ndarray) -> None:
        qpos[:2], qpos[2 + self.lifted] = q[:2], np.arctan2(q[3], q[2])

    def read_pose(self, qpos: np.ndarray, q: np.ndarray) -> None:
        angle = qpos[2 + self.lifted]
        q[:4] = *qpos[:2], np.cos(angle), np.sin(angle)

    def velocity_map(self, qpos: np.ndarray) -> np.ndarray:
        found = np.zeros((3 + self.lifted, 3))
        found[:2, :2], found[-1, 2] = pin.utils.rotate("z", qpos[2 + self.lifted])[:2, :2], 1.0
        return found


@dataclass(frozen=True)
class FreeBase(BaseCoordinates):
    """Free base. ``placement`` is the joint placement in the world."""

    placement: pin.SE3

    def write_pose(self, q: np.ndarray, qpos: np.ndarray) -> None:
        _write_pose(self.placement * pin.XYZQUATToSE3(q[:7]), qpos)

    def read_pose(self, qpos: np.ndarray, q: np.ndarray) -> None:
        q[:7] = pin.SE3ToXYZQUAT(self.placement.actInv(_pose(qpos)))

    def velocity_map(self, qpos: np.ndarray) -> np.ndarray:
        return scipy.linalg.block_diag(_pose(qpos).rotation, np.eye(3))


@dataclass(frozen=True)
class FreePlanarBase(BaseCoordinates):
    """Planar base that has six degrees of freedom in MuJoCo; only x, y and heading are read.

    Writing a planar state keeps height, roll and pitch.
    """

    placement: pin.SE3

    def write_pose(self, q: np.ndarray, qpos: np.ndarray) -> None:
        now = self.placement.actInv(_pose(qpos))
        # About the vertical only: the body keeps the lean that its load gives it.
        turned = pin.utils.rotate("z", np.arctan2(q[3], q[2]) - heading_of(now.rotation)) @ now.rotation
        _write_pose(self.placement * pin.SE3(turned, np.array([*q[:2], now.translation[2]])), qpos)

    def read_pose(self, qpos: np.ndarray, q: np.ndarray) -> None:
        pose = self.placement.actInv(_pose(qpos))
        heading = heading_of(pose.rotation)
        q[:4] = *pose.translation[:2], np.cos(heading), np.sin(heading)

    def read(self, qpos: np.ndarray, qvel: np.ndarray, q: np.ndarray, v: np.ndarray) -> None:
        super().read(qpos, qvel, q, v)
        rotation = self.placement.actInv(_pose(qpos[self.qpos :])).rotation
        forward = rotation[:, 0]
        rate = np.cross(rotation @ qvel[self.dof + 3 : self.dof + 6], forward)
        # The heading is the direction of the body's x axis along the ground, also of a body that leans.
        v[self.v + 2] = (forward[0] * rate[1] - forward[1] * rate[0]) / (forward[0] ** 2 + forward[1] ** 2)

    def velocity_map(self, qpos: np.ndarray) -> np.ndarray:
        rotation, placed = _pose(qpos).rotation, self.placement.rotation
        heading = heading_of(placed.T @ rotation)
        # MuJoCo has the linear velocity in the world, and turns of free bodies in their own axes.
        along, up = placed @ pin.utils.rotate("z", heading)[:, :2], rotation.T @ placed[:, 2:]
        return scipy.linalg.block_diag(along, up)


class RobotCoordinates:
    """Conversion of all joints of a robot.

    Args:
        joints: conversion of each joint.
        nq, nv: sizes of Pinocchio's vectors.
    """

    def __init__(self, joints: Sequence[JointCoordinates], nq: int, nv: int) -> None:
        self._nq, self._nv = nq, nv
        self._bases = [joint for joint in joints if isinstance(joint, BaseCoordinates)]
        equal = [joint for joint in joints if isinstance(joint, EqualCoordinates)]
        turning = [joint for joint in joints if isinstance(joint, ContinuousHinge)]
        # In one call for all joints but bases: they are read and written at each step.
        self._v, self._dof = _paired((each.v + k, each.dof + k) for each in [*equal, *turning] for k in range(each.nv))
        self._q, self._qpos = _paired((each.q + i, each.qpos + k) for each in equal for k, i in enumerate(each.order))
        self._cosine, self._angle = _paired((each.q, each.qpos) for each in turning)

    def write(self, q: np.ndarray, v: np.ndarray, qpos: np.ndarray, qvel: np.ndarray) -> None:
        """Write a Pinocchio state to MuJoCo's vectors.

        Args:
            q: configuration (nq,).
            v: velocity (nv,).
            qpos, qvel: vectors of MuJoCo, which receive the state.
        """
        qpos[self._qpos], qvel[self._dof] = q[self._q], v[self._v]
        qpos[self._angle] = np.arctan2(q[self._cosine + 1], q[self._cosine])
        for base in self._bases:
            base.write(q, v, qpos, qvel)

    def read(self, qpos: np.ndarray, qvel: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return MuJoCo's state as q (nq,) and v (nv,) of Pinocchio.

        Args:
            qpos, qvel: vectors of MuJoCo.
        """
        q, v = np.zeros(self._nq), np.zeros(self._nv)
        q[self._q], v[self._v] = qpos[self._qpos], qvel[self._dof]
        q[self._cosine], q[self._cosine + 1] = np.cos(qpos[self._angle]), np.sin(qpos[self._angle])
        for base in self._bases:
            base.read(qpos, qvel, q, v)
        return q, v

    def add_force(self, qpos: np.ndarray, force: np.ndarray, applied: np.ndarray) -> None:
        """Add a generalized force (nv,) to the applied force of MuJoCo.

        Args:
            qpos: positions of MuJoCo.
            force: generalized force (nv,).
            applied: applied force of MuJoCo, which receives it.
        """
        applied[self._dof] += force[self._v]
        for joint in self._bases:
            # Most forces act on joints: a base is asked for its rotation only where one acts on it.
            if force[joint.v : joint.v + joint.nv].any():
                joint.add_force(qpos, force, applied)


def _paired(pairs: Iterable[tuple[int, int]]) -> np.ndarray:
    """Indices (2, k) of entries in the vectors of Pinocchio and of MuJoCo."""
    return np.array([*pairs], dtype=int).reshape(-1, 2).T


def scalar_first(quaternion: np.ndarray) -> np.ndarray:
    """Convert a quaternion (x, y, z, w) of Pinocchio to (w, x, y, z) of MuJoCo.

    Args:
        quaternion: four numbers (4,).
    """
    return quaternion[[3, 0, 1, 2]]


def _scalar_last(quaternion: np.ndarray) -> np.ndarray:
    return quaternion[[1, 2, 3, 0]]


def _pose(qpos: np.ndarray) -> pin.SE3:
    return pin.XYZQUATToSE3(np.concatenate([qpos[:3], _scalar_last(qpos[3:7])]))


def _write_pose(pose: pin.SE3, qpos: np.ndarray) -> None:
    values = pin.SE3ToXYZQUAT(pose)
    qpos[:3], qpos[3:7] = values[:3], scalar_first(values[3:])


# ---------------------------------------------------------------------- bodies


class _Single(NamedTuple):
    """Joint of one degree of freedom."""

    placement: pin.SE3
    slides: bool
    axis: np.ndarray
    continuous: bool


class BodyTree:
    """Bodies of a robot in a MuJoCo specification.

    Args:
        spec: specification that receives them.
        robot: the robot.
        root: type of a planar base.
        joint_limits: enforce the position limits of the robot file.

    Raises:
        ConfigurationError: a joint has no equivalent in MuJoCo.
    """

    def __init__(self, spec: mujoco.MjSpec, robot: Robot, root: Root, joint_limits: bool) -> None:
        self.robot = robot
        self._limits = joint_limits
        self._planned: list[tuple[str, Callable[[int, int], JointCoordinates]]] = []
        """Name of the first MuJoCo joint of a joint, and its conversion as a function of the indices in MuJoCo."""
        # Angles are radians here, and degrees in MuJoCo's files.
        spec.compiler.degree = False
        spec.option.gravity = robot.model.gravity.linear
        self.bodies: list[mujoco.MjsBody] = [spec.worldbody]
        """One body per joint of the model; the world is first."""
        for index in range(1, robot.model.njoints):
            self.bodies.append(self._add(index, root))

    # ------------------------------------------------------------------ writing

    def _add(self, index: int, root: Root) -> mujoco.MjsBody:
        model = self.robot.model
        joint, name, parent = model.joints[index], str(model.names[index]), model.parents[index]
        kind, placement = joint.shortname(), model.jointPlacements[index]
        singles = _singles(joint)
        # Joints that are several slides or hinges in MuJoCo, in this order.
        stacks = {"JointModelTranslation": ("slide", "xyz"), "JointModelSphericalZYX": ("hinge", "zyx")}
        if singles:
            body = self.bodies[parent]
            for number, single in enumerate(singles):
                last = number == len(singles) - 1
                body = _body(body, placement * single.placement, name if last else f"{name}/{number}")
                self._add_single(body, single, joint, number, name if len(singles) == 1 else f"{name}/{number}")
                placement = pin.SE3.Identity()
        else:
            body = _body(self.bodies[parent], placement, name)
            if kind == "JointModelPlanar":
                self._add_planar(body, index, root)
            elif kind == "JointModelFreeFlyer" and parent == 0:
                body.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_FREE)
                self._plan(FreeBase, name, index, placement=placement)
            elif kind == "JointModelSpherical":
                body.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_BALL)
                self._plan(EqualCoordinates, name, index, order=(3, 0, 1, 2))  # MuJoCo has w first
            elif kind in stacks:
                moves, axes = stacks[kind]
                for axis in axes:
                    _move(body, f"{name}/{axis}", moves == "slide", np.eye(3)["xyz".index(axis)])
                self._plan(EqualCoordinates, f"{name}/{axes[0]}", index, order=(0, 1, 2))
            else:
                raise ConfigurationError(
                    f"MuJoCo has no joint like '{name}' ({kind}): expected a hinge, slide, ball, planar or free base"
                )
        inertia = model.inertias[index]
        _, principal = np.linalg.eigh(inertia.inertia)
        # A rotation and not a reflection, which no quaternion describes.
        principal[:, 0] *= np.sign(np.linalg.det(principal))
        body.ipos, body.iquat = inertia.lever, _quaternion(principal)
        return body

    def _add_single(self, body: mujoco.MjsBody, single: _Single, joint: pin.JointModel, number: int, name: str) -> None:
        added = _move(body, name, single.slides, single.axis)
        # Joints of a composite have places of their own in q: some have two entries.
        q, v = joint.extract().joints[number].idx_q if number else joint.idx_q, joint.idx_v + number
        equal = partial(EqualCoordinates, order=(0,))
        kind = ContinuousHinge if single.continuous else equal
        self._planned.append((name, partial(kind, name, q, v, 1)))
        if self._limits and not single.continuous:
            model = self.robot.model
            low, high = model.lowerPositionLimit[q], model.upperPositionLimit[q]
            if np.isfinite([low, high]).all() and low < high:
                added.limited, added.range = True, [low, high]

    def _add_planar(self, body: mujoco.MjsBody, index: int, root: Root) -> None:
        name, placement = str(self.robot.model.names[index]), self.robot.model.jointPlacements[index]
        if root == "free":
            body.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_FREE)
            self._plan(FreePlanarBase, name, index, placement=placement)
            return
        for axis in "xyz" if root == "level" else "xy":
            _move(body, f"{name}/{axis}", True, np.eye(3)["xyz".index(axis)])
        _move(body, f"{name}/yaw", False, np.eye(3)[2])
        self._plan(PlanarBase, f"{name}/x", index, lifted=root == "level")

    def _plan(self, coordinates: Callable[..., JointCoordinates], first: str, index: int, **more: object) -> None:
        joint = self.robot.model.joints[index]
        name = str(self.robot.model.names[index])
        self._planned.append((first, partial(coordinates, name, joint.idx_q, joint.idx_v, joint.nv, **more)))

    # ------------------------------------------------------------------ once it is compiled

    def finish(self, model: mujoco.MjModel, data: mujoco.MjData, damping: bool) -> list[JointCoordinates]:
        """Set what a specification lacks in a compiled model: inertias, rotor inertias, damping per axis.

        The compiler sees placeholders. It refuses bodies without mass, and moments that violate the triangle
        inequality.

        Args:
            model: compiled model.
            data: its data.
            damping: True to apply the viscous damping of the robot file.

        Returns:
            The conversions of all joints between Pinocchio and MuJoCo.
        """
        own = self.robot.model
        for index in range(1, own.njoints):
            body = model.body(str(own.names[index])).id
            moments = np.linalg.eigvalsh(own.inertias[index].inertia)
            # Rounding can make the smallest moment of a rod negative.
            model.body_mass[body], model.body_inertia[body] = own.inertias[index].mass, np.maximum(moments, 0.0)
        places = ((model.joint(first), make) for first, make in self._planned)
        joints = [make(int(place.qposadr[0]), int(place.dofadr[0])) for place, make in places]
        for joint in joints:
            here, there = slice(joint.v, joint.v + joint.nv), slice(joint.dof, joint.dof + joint.nv)
            if isinstance(joint, BaseCoordinates):
                if own.armature[here].any() or (damping and own.damping[here].any()):
                    raise ConfigurationError(
                        f"MuJoCo: base '{joint.name}' has rotor inertia or damping, which MuJoCo bases do not support"
                    )
                continue
            model.dof_armature[there] = own.armature[here]
            if damping:
                model.dof_damping[there] = own.damping[here]
        # Constants of the compiler belong to the placeholder masses.
        mujoco.mj_setConst(model, data)
        return joints


def _singles(joint: pin.JointModel) -> list[_Single]:
    """Hinges and slides of a joint; none if it has other components."""
    if joint.shortname() == "JointModelComposite":
        whole = joint.extract()
        found = [_single(each, place) for each, place in zip(whole.joints, whole.jointPlacements, strict=True)]
    else:
        found = [_single(joint, pin.SE3.Identity())]
    return [each for each in found if each] if all(found) else []


def _single(joint: pin.JointModel, placement: pin.SE3) -> _Single | None:
    if joint.nv != 1:
        return None
    # By its motion alone: so every kind of hinge and slide has its axis, also inside a composite.
    alone = pin.Model()
    alone.addJoint(0, joint, pin.SE3.Identity(), "alone")
    motion = pin.computeJointJacobians(alone, alone.createData(), pin.neutral(alone)).reshape(6)
    slide, turn = motion[:3], motion[3:]
    if slide.any() and turn.any():  # a screw
        return None
    return _Single(placement, bool(slide.any()), slide if slide.any() else turn, joint.nq == 2)


def _body(parent: mujoco.MjsBody, placement: pin.SE3, name: str) -> mujoco.MjsBody:
    return parent.add_body(
        name=name,
        pos=placement.translation,
        quat=_quaternion(placement.rotation),
        mass=_PLACEHOLDER_MASS,
        inertia=[_PLACEHOLDER_MASS] * 3,
        explicitinertial=True,
    )


def _move(body: mujoco.MjsBody, name: str, slides: bool, axis: np.ndarray) -> mujoco.MjsJoint:
    kind = mujoco.mjtJoint.mjJNT_SLIDE if slides else mujoco.mjtJoint.mjJNT_HINGE
    return body.add_joint(name=name, type=kind, axis=axis)


def _quaternion(rotation: np.ndarray) -> np.ndarray:
    return scalar_first(pin.Quaternion(rotation).coeffs())


# ---------------------------------------------------------------------- equality constraints


class JointEquality:
    """Coupling of two joints; the polynomial of MuJoCo is updated at the current positions.

    Args:
        model: compiled model.
        name: name of the equality constraint.
        coupler: how the joint follows its driver.
    """

    def __init__(self, model: mujoco.MjModel, name: str, coupler: JointCoupler) -> None:
        self._equality, self._coupler = model.equality(name).id, coupler
        self._joint = int(model.joint(coupler.joint).qposadr[0])
        self._driver = None if coupler.driver is None else int(model.joint(coupler.driver).qposadr[0])

    def set(self, model: mujoco.MjModel, qpos: np.ndarray, fresh: bool) -> None:
        """Write the polynomial coefficients; ``fresh`` is True at the start of a run.

        The offset of a constant ratio includes the initial full turns of both joints.

        Args:
            model: compiled model.
            qpos: positions of MuJoCo.
            fresh: True at the start of a run.
        """
        driver = 0.0 if self._driver is None else qpos[self._driver]
        if self._coupler.function is not None:
            position, slope = self._coupler.function(driver)
            period = self._coupler.period
            # The turn nearest to the joint: else a step past pi would pull it back by a turn.
            position += period * np.round((qpos[self._joint] - position) / period)
        elif fresh:
            position, slope = qpos[self._joint], self._coupler.ratio
        else:
            return
        model.eq_data[self._equality, :5] = position - slope * driver, slope, 0.0, 0.0, 0.0


def add_equalities(
    spec: mujoco.MjSpec, tree: BodyTree, blocks: Sequence[Rows], step: float
) -> list[tuple[str, JointCoupler]]:
    """Add joint couplings and loop closures to a specification, which has the bodies of ``tree``.

    Args:
        spec: specification that receives them.
        tree: bodies of the robot.
        blocks: constraints.
        step: time step of MuJoCo [s].

    Returns:
        Names of the couplings with their laws, for ``JointEquality``.

    Raises:
        ConfigurationError: a constraint has no equivalent in MuJoCo.
    """
    impedance = 0.999  # near 1: constraints are as hard as the step allows
    # Two steps: the smallest time constant with which MuJoCo is stable.
    solver = {"solref": [2 * step, 1.0], "solimp": [impedance, impedance, 0.001, 0.5, 2.0]}
    couplers: list[tuple[str, JointCoupler]] = []
    supported = (
        "rolling wheels and balls, knife edges, casters, couplings of joints, Ackermann steering, loops and the "
        "conservation of momentum"
    )
    for block in blocks:
        mechanisms = block.mechanisms()
        if not mechanisms and block.conserved is None:
            what = type(block.kind or block).__name__
            raise ConfigurationError(f"MuJoCo: {block.names[0]} ({what}) has no equivalent; supported are {supported}")
        for number, mechanism in enumerate(mechanisms):
            name = f"{block.names[0]}/{number}" if number else block.names[0]
            if isinstance(mechanism, JointCoupler):
                added = spec.add_equality(name=name, type=mujoco.mjtEq.mjEQ_JOINT, name1=mechanism.joint, **solver)
                if mechanism.driver is not None:
                    added.name2 = mechanism.driver
                couplers.append((name, mechanism))
            elif isinstance(mechanism, FrameAnchor):
                _close(spec, tree, mechanism, name, solver)
    return couplers


def _close(spec: mujoco.MjSpec, tree: BodyTree, anchor: FrameAnchor, name: str, solver: dict[str, list[float]]) -> None:
    sites = [f"{name}/{side}" for side in "ab"]
    for site, parent, offset in zip(sites, anchor.frames, anchor.placements, strict=True):
        frame = tree.robot.model.frames[tree.robot.frame_id(parent)]
        placement, body = frame.placement * offset, tree.bodies[frame.parentJoint]
        body.add_site(name=site, pos=placement.translation, quat=_quaternion(placement.rotation))
    kind = mujoco.mjtEq.mjEQ_CONNECT if anchor.point else mujoco.mjtEq.mjEQ_WELD
    on_sites = {"objtype": mujoco.mjtObj.mjOBJ_SITE, "name1": sites[0], "name2": sites[1]}
    closed = spec.add_equality(name=name, type=kind, **on_sites, **solver)
    if not anchor.point:
        closed.data[10] = 1.0  # rotation and translation have equal weights
