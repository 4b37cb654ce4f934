"""Bodies, joints and equality constraints of a loaded robot as a MuJoCo specification, and the coordinates of both.

Pinocchio has quaternions (x, y, z, w), (cos, sin) for continuous joints, and velocities of planar and free joints in
the body frame. MuJoCo has (w, x, y, z), a plain angle, and the linear velocity of a free joint in the world frame.
Generalized forces transform by the transpose of the velocity map, since power is the same in both.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np
import pinocchio as pin
import scipy

from rnc_pin.errors import ConfigurationError, missing_extra
from rnc_pin.lab.mujoco.contact_bodies import Root
from rnc_pin.model.coordinates import heading_of
from rnc_pin.model.rows import FrameAnchor, JointCoupler, Rows
from rnc_pin.robots.robot import Robot
from rnc_pin.robots.sources.mjcf_model import pose

try:
    import mujoco as mujoco  # other modules of this room have it from here, with one error where it is missing
except ImportError:
    raise ConfigurationError(missing_extra("mujoco")) from None


_PLACEHOLDER_MASS = 1e-12  # placeholder mass and inertia for the compiler; ``finish`` writes the robot's
_HINGE, _SLIDE = mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE


# ---------------------------------------------------------------------- coordinates


@dataclass(frozen=True)
class BaseCoordinates(ABC):
    """Conversion of a planar or free base, whose velocities differ: MuJoCo has ``velocity_map(qpos) @ v``.

    Attributes:
        name: joint name.
        q, v: first indices in Pinocchio's vectors.
        nv: degrees of freedom in Pinocchio.
        qpos, dof: first indices in MuJoCo's vectors.
        placement: placement of the joint in the world.
    """

    name: str
    q: int
    v: int
    nv: int
    qpos: int
    dof: int
    placement: pin.SE3

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


class PlanarBase(BaseCoordinates):
    """Planar base: slides and a hinge in MuJoCo."""

    slides: ClassVar[str] = "xy"

    def write_pose(self, q: np.ndarray, qpos: np.ndarray) -> None:
        qpos[:2], qpos[len(self.slides)] = q[:2], np.arctan2(q[3], q[2])

    def read_pose(self, qpos: np.ndarray, q: np.ndarray) -> None:
        angle = qpos[len(self.slides)]
        q[:4] = *qpos[:2], np.cos(angle), np.sin(angle)

    def velocity_map(self, qpos: np.ndarray) -> np.ndarray:
        found = np.zeros((len(self.slides) + 1, 3))
        found[:2, :2], found[-1, 2] = pin.utils.rotate("z", qpos[len(self.slides)])[:2, :2], 1.0
        return found


class LevelBase(PlanarBase):
    """Planar base that also moves vertically in MuJoCo."""

    slides = "xyz"


class FreeBase(BaseCoordinates):
    """Free base."""

    def write_pose(self, q: np.ndarray, qpos: np.ndarray) -> None:
        _write_pose(self.placement * pin.XYZQUATToSE3(q[:7]), qpos)

    def read_pose(self, qpos: np.ndarray, q: np.ndarray) -> None:
        q[:7] = pin.SE3ToXYZQUAT(self.placement.actInv(pose(qpos[:3], qpos[3:7])))

    def velocity_map(self, qpos: np.ndarray) -> np.ndarray:
        return scipy.linalg.block_diag(pose(qpos[:3], qpos[3:7]).rotation, np.eye(3))


class FreePlanarBase(BaseCoordinates):
    """Planar base that has six degrees of freedom in MuJoCo; only x, y and heading are read.

    Writing a planar state keeps height, roll and pitch.
    """

    def write_pose(self, q: np.ndarray, qpos: np.ndarray) -> None:
        now = self.placement.actInv(pose(qpos[:3], qpos[3:7]))
        # About the vertical only: the body keeps the lean that its load gives it.
        turned = pin.utils.rotate("z", np.arctan2(q[3], q[2]) - heading_of(now.rotation)) @ now.rotation
        _write_pose(self.placement * pin.SE3(turned, np.array([*q[:2], now.translation[2]])), qpos)

    def read_pose(self, qpos: np.ndarray, q: np.ndarray) -> None:
        now = self.placement.actInv(pose(qpos[:3], qpos[3:7]))
        heading = heading_of(now.rotation)
        q[:4] = *now.translation[:2], np.cos(heading), np.sin(heading)

    def read(self, qpos: np.ndarray, qvel: np.ndarray, q: np.ndarray, v: np.ndarray) -> None:
        super().read(qpos, qvel, q, v)
        rotation = self.placement.actInv(
            pose(qpos[self.qpos : self.qpos + 3], qpos[self.qpos + 3 : self.qpos + 7])
        ).rotation
        forward = rotation[:, 0]
        rate = np.cross(rotation @ qvel[self.dof + 3 : self.dof + 6], forward)
        # The heading is the direction of the body's x axis along the ground, also of a body that leans.
        v[self.v + 2] = (forward[0] * rate[1] - forward[1] * rate[0]) / (forward[0] ** 2 + forward[1] ** 2)

    def velocity_map(self, qpos: np.ndarray) -> np.ndarray:
        rotation, placed = pose(qpos[:3], qpos[3:7]).rotation, self.placement.rotation
        heading = heading_of(placed.T @ rotation)
        # MuJoCo has the linear velocity in the world, and turns of free bodies in their own axes.
        along, up = placed @ pin.utils.rotate("z", heading)[:, :2], rotation.T @ placed[:, 2:]
        return scipy.linalg.block_diag(along, up)


class RobotCoordinates:
    """Conversion of all joints of a robot.

    Args:
        tree: bodies and joints of the robot.
    """

    def __init__(self, tree: BodyTree) -> None:
        self._nq, self._nv, self._bases = tree.robot.nq, tree.robot.nv, tree.bases
        # In one call for all joints but bases: they are read and written at each step.
        self._q, self._qpos = _columns(tree.equal)
        self._cosine, self._angle = _columns(tree.turning)
        self._v, self._dof = _columns(tree.speeds)

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
        for base in self._bases:
            # Most forces act on joints: a base is asked for its rotation only where one acts on it.
            if force[base.v : base.v + base.nv].any():
                base.add_force(qpos, force, applied)


def _columns(pairs: Sequence[tuple[int, int]]) -> np.ndarray:
    """Indices (2, k) of entries in the vectors of Pinocchio and of MuJoCo."""
    return np.array(pairs, dtype=int).reshape(-1, 2).T


def scalar_first(quaternion: np.ndarray) -> np.ndarray:
    """Convert a quaternion (x, y, z, w) of Pinocchio to (w, x, y, z) of MuJoCo.

    Args:
        quaternion: four numbers (4,).
    """
    return quaternion[[3, 0, 1, 2]]


def _write_pose(pose: pin.SE3, qpos: np.ndarray) -> None:
    values = pin.SE3ToXYZQUAT(pose)
    qpos[:3], qpos[3:7] = values[:3], scalar_first(values[3:])


# ---------------------------------------------------------------------- bodies


class BodyTree:
    """Bodies of a robot in a MuJoCo specification.

    Args:
        spec: specification that receives them.
        robot: the robot.
        root: type of a planar base.
        joint_limits: enforce the position limits of the robot file.

    Attributes:
        bodies: one body per joint of the model, the world first.
        bases: conversions of planar and free bases.
        equal: indices in q and in MuJoCo's positions of entries that are equal.
        turning: index in q of the cosine of a continuous hinge, which has an unwrapped angle in MuJoCo, and of that.
        speeds: indices in v and in MuJoCo's velocities, which are equal for all joints but bases.

    Raises:
        ConfigurationError: a joint has no equivalent in MuJoCo.
    """

    def __init__(self, spec: mujoco.MjSpec, robot: Robot, root: Root, joint_limits: bool) -> None:
        self.robot = robot
        self._root, self._limits = root, joint_limits
        self.bases: list[BaseCoordinates] = []
        self.equal: list[tuple[int, int]] = []
        self.turning: list[tuple[int, int]] = []
        self.speeds: list[tuple[int, int]] = []
        # Sizes of MuJoCo's vectors so far: the model has its joints branch by branch, which is MuJoCo's order too.
        self._qpos = self._dof = 0
        # Angles are radians here, and degrees in MuJoCo's files.
        spec.compiler.degree = False
        spec.option.gravity = robot.model.gravity.linear
        self.bodies: list[mujoco.MjsBody] = [spec.worldbody]
        for index in range(1, robot.model.njoints):
            self.bodies.append(self._add(index))

    def _add(self, index: int) -> mujoco.MjsBody:
        """Add a joint of the model with its body."""
        model = self.robot.model
        joint, name, kind = model.joints[index], str(model.names[index]), model.joints[index].shortname()
        parent, placement = self.bodies[model.parents[index]], model.jointPlacements[index]
        planar = {"free": FreePlanarBase, "level": LevelBase}.get(self._root, PlanarBase)
        moves = _moves(joint)
        if moves:
            body = parent
            for number, move in enumerate(moves):
                last = number == len(moves) - 1
                body = _body(body, placement * move.placement, name if last else f"{name}/{number}")
                self._add_move(body, move, name if len(moves) == 1 else f"{name}/{number}")
                placement = pin.SE3.Identity()
        else:
            body = _body(parent, placement, name)
            if kind == "JointModelPlanar":
                self._add_base(body, planar(name, joint.idx_q, joint.idx_v, 3, self._qpos, self._dof, placement))
            elif kind == "JointModelFreeFlyer" and model.parents[index] == 0:
                self._add_base(body, FreeBase(name, joint.idx_q, joint.idx_v, 6, self._qpos, self._dof, placement))
            elif kind == "JointModelSpherical":
                self.equal += [(joint.idx_q + k, self._qpos + (k + 1) % 4) for k in range(4)]  # MuJoCo has w first
                self.speeds += [(joint.idx_v + k, self._dof + k) for k in range(3)]
                self._add_joint(body, name, mujoco.mjtJoint.mjJNT_BALL)
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

    def _add_joint(
        self,
        body: mujoco.MjsBody,
        name: str,
        kind: mujoco.mjtJoint,
        axis: Sequence[float] | np.ndarray = (0.0, 0.0, 1.0),
    ) -> mujoco.MjsJoint:
        sizes = {mujoco.mjtJoint.mjJNT_FREE: (7, 6), mujoco.mjtJoint.mjJNT_BALL: (4, 3)}.get(kind, (1, 1))
        self._qpos, self._dof = self._qpos + sizes[0], self._dof + sizes[1]
        return body.add_joint(name=name, type=kind, axis=axis)

    def _add_move(self, body: mujoco.MjsBody, move: _Move, name: str) -> None:
        self.speeds.append((move.v, self._dof))
        (self.turning if move.continuous else self.equal).append((move.q, self._qpos))
        added = self._add_joint(body, name, _SLIDE if move.slides else _HINGE, move.axis)
        limits = [each[move.q] for each in (self.robot.model.lowerPositionLimit, self.robot.model.upperPositionLimit)]
        if self._limits and not move.continuous and np.isfinite(limits).all() and limits[0] < limits[1]:
            added.limited, added.range = True, limits

    def _add_base(self, body: mujoco.MjsBody, base: BaseCoordinates) -> None:
        self.bases.append(base)
        if isinstance(base, PlanarBase):
            for axis, direction in zip(base.slides, np.eye(3), strict=False):
                self._add_joint(body, f"{base.name}/{axis}", _SLIDE, direction)
            self._add_joint(body, f"{base.name}/yaw", _HINGE)
        else:
            self._add_joint(body, base.name, mujoco.mjtJoint.mjJNT_FREE)

    # ------------------------------------------------------------------ once it is compiled

    def finish(self, model: mujoco.MjModel, data: mujoco.MjData, damping: bool) -> None:
        """Set what a specification lacks in a compiled model: inertias, rotor inertias, damping per axis.

        The compiler sees placeholders. It refuses bodies without mass, and moments that violate the triangle
        inequality.

        Args:
            model: compiled model.
            data: its data.
            damping: True to apply the viscous damping of the robot file.

        Raises:
            ConfigurationError: a base has rotor inertia or damping.
        """
        own = self.robot.model
        for index in range(1, own.njoints):
            body = model.body(str(own.names[index])).id
            moments = np.linalg.eigvalsh(own.inertias[index].inertia)
            # Rounding can make the smallest moment of a rod negative.
            model.body_mass[body], model.body_inertia[body] = own.inertias[index].mass, np.maximum(moments, 0.0)
        for base in self.bases:
            entries = slice(base.v, base.v + base.nv)
            if own.armature[entries].any() or (damping and own.damping[entries].any()):
                raise ConfigurationError(
                    f"MuJoCo: base '{base.name}' has rotor inertia or damping, which MuJoCo bases do not support"
                )
        v, dof = _columns(self.speeds)
        model.dof_armature[dof] = own.armature[v]
        if damping:
            model.dof_damping[dof] = own.damping[v]
        # Constants of the compiler belong to the placeholder masses.
        mujoco.mj_setConst(model, data)


class _Move(NamedTuple):
    """Hinge or slide that a joint consists of."""

    placement: pin.SE3
    """Its place in the joint, or behind the one before it."""
    q: int
    v: int
    slides: bool
    axis: np.ndarray
    continuous: bool


def _moves(joint: pin.JointModel) -> list[_Move]:
    """Hinges and slides of a joint in their order; none if it has other components."""
    parts = [(joint, pin.SE3.Identity())]
    if joint.shortname() == "JointModelComposite":
        whole = joint.extract()
        parts = [*zip(whole.joints, whole.jointPlacements, strict=True)]
    found: list[_Move] = []
    for part, placement in parts:
        # By its motions alone: so every kind of hinge and slide has its axis.
        alone = pin.Model()
        alone.addJoint(0, part, pin.SE3.Identity(), "alone")
        motions = pin.computeJointJacobians(alone, alone.createData(), pin.neutral(alone)).reshape(6, -1).T
        stacks = ("JointModelTranslation", "JointModelSphericalZYX")
        if part.nv > 1 and part.shortname() not in stacks:
            return []
        for k, (slide, turn) in enumerate(motions.reshape(-1, 2, 3)):
            if slide.any() and turn.any():  # a screw
                return []
            slides = bool(slide.any())
            found.append(_Move(placement, part.idx_q + k, part.idx_v + k, slides, slide + turn, part.nq > part.nv))
            placement = pin.SE3.Identity()
    return found


def _body(parent: mujoco.MjsBody, placement: pin.SE3, name: str) -> mujoco.MjsBody:
    return parent.add_body(
        name=name,
        pos=placement.translation,
        quat=_quaternion(placement.rotation),
        mass=_PLACEHOLDER_MASS,
        inertia=[_PLACEHOLDER_MASS] * 3,
        explicitinertial=True,
    )


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
