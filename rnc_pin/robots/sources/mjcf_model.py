"""Pinocchio model of a compiled MJCF."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import pinocchio as pin

from rnc_pin.errors import ModelError, few
from rnc_pin.printing import counted
from rnc_pin.robots.sources.description import ROOT_JOINTS, check_not_negative

if TYPE_CHECKING:
    import mujoco

FREE, BALL, SLIDE, HINGE = range(4)
_ALIGNED = {HINGE: (pin.JointModelRX, pin.JointModelRY, pin.JointModelRZ)}
_ALIGNED[SLIDE] = (pin.JointModelPX, pin.JointModelPY, pin.JointModelPZ)
_SKEW = {HINGE: pin.JointModelRevoluteUnaligned, SLIDE: pin.JointModelPrismaticUnaligned}
SMALLEST = 1e-15
"""Smallest mass [kg] and moment of inertia [kg m^2] of a moving body in MuJoCo (mjMINVAL)."""
_QUATERNION = 1.01  # limit of its entries, as in Pinocchio


class Carrier(NamedTuple):
    """Body of the file in the model.

    Attributes:
        name: name of its frame.
        joint: index of the joint that carries it.
        frame: index of its frame.
        placement: its placement in the joint.
    """

    name: str
    joint: int
    frame: int
    placement: pin.SE3


class ModelBuilder:
    """Model with one joint for each joint of the file, in order. Bodies and sites are frames.

    Each of several joints of a body carries a body of its own, without mass.

    Args:
        compiled: the ``mujoco.MjModel``.
        name: name of the model.
        base: None keeps the root joints of the file; "fixed", "planar" or "free" replaces its free joint.

    Attributes:
        model: the model.
        carriers: bodies by their index in MuJoCo, the world first.
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
        self._check_joint_names()
        self._check_roots()
        names = [compiled.body(k).name for k in range(compiled.nbody)]
        self._free = (each for k in itertools.count(1) if (each := f"body_{k}") not in names)
        self._names = [name or next(self._free) for name in names]
        self.carriers = [Carrier("universe", 0, 0, pin.SE3.Identity())]
        for body in range(1, compiled.nbody):
            self.carriers.append(self._add_body(body))
        for site in range(compiled.nsite):
            self._add_site(site)
        springs = [self.model.names[self.joints[k]] for k in self.joints if np.ravel(compiled.jnt_stiffness[k])[0]]
        text = f"springs (stiffness, springdamper) are left out of the model: joint {few(springs)}"
        self.notes = [text] if springs else []

    def joint_name(self, joint: int) -> str:
        """Name of a joint of the file; by default that of its body with a number."""
        compiled, body = self._compiled, self._compiled.jnt_bodyid[joint]
        ending = "_free" if compiled.jnt_type[joint] == FREE else f"Joint_{joint - compiled.body_jntadr[body]}"
        return compiled.joint(joint).name or self._names[body] + ending

    def _check_joint_names(self) -> None:
        """Refuse names with which Pinocchio would end the process, or add joints endlessly."""
        taken = {"universe"} if self._make_root is None else {"universe", "root_joint"}
        for k in range(self._compiled.njnt):
            name = self._compiled.joint(k).name
            if name in taken and (self._base is None or self._compiled.jnt_type[k] != FREE):
                raise ModelError(f"a joint cannot be called '{name}': it is the base's name")

    def _check_roots(self) -> None:
        roots = [k for k in range(1, self._compiled.nbody) if self._compiled.body_parentid[k] == 0]
        if self._make_root is None:
            return
        names = [self._compiled.body(k).name or "without a name" for k in roots]
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
        joints = range(first, first + count)
        return [k for k in joints if self._base is None or self._compiled.jnt_type[k] != FREE]

    def _add_body(self, body: int) -> Carrier:
        compiled, model = self._compiled, self.model
        parent = self.carriers[compiled.body_parentid[body]]
        joints, name, inertia = self._own_joints(body), self._names[body], self._inertia(body)
        place = pose(compiled.body_pos[body], compiled.body_quat[body])
        if compiled.body_jntnum[body] > len(joints):
            place = pin.SE3.Identity()  # the base takes the place of the free joint
        index, frame, place = parent.joint, parent.frame, parent.placement * place
        if parent.joint == 0 and parent.frame == 0 and self._make_root is not None:
            index, frame, place = self._add_joint(0, 0, self._make_root(), pin.SE3.Identity(), "root_joint")
        for joint in joints:
            if joint != joints[0]:
                frame = model.addBodyFrame(next(self._free), index, place, frame)
            index, frame, place = self._add_file_joint(joint, index, frame, place)
        if index == parent.joint:
            frame = model.addFrame(pin.Frame(f"{name}_fixed", index, frame, place, pin.FrameType.FIXED_JOINT, inertia))
        else:
            model.appendBodyToJoint(index, inertia, place)
        return Carrier(name, index, model.addBodyFrame(name, index, place, frame), place)

    def _inertia(self, body: int) -> pin.Inertia:
        compiled = self._compiled
        mass = float(compiled.body_mass[body])
        if mass <= SMALLEST:
            return pin.Inertia.Zero()
        place = pose(compiled.body_ipos[body], compiled.body_iquat[body])
        tensor = place.rotation * compiled.body_inertia[body] @ place.rotation.T
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
        if kind in _SKEW:
            axis, value = compiled.jnt_axis[k], compiled.qpos0[compiled.jnt_qposadr[k]]
            self.references[name] = float(value)
            motion = pin.Motion(np.zeros(6))
            motion.vector = np.r_[np.zeros(3), axis] if kind == HINGE else np.r_[axis, np.zeros(3)]
            rest = pin.exp6(-value * motion)
            unit = np.flatnonzero(axis == 1.0)
            joint = _ALIGNED[kind][unit[0]]() if unit.size else _SKEW[kind](axis)
            limits = np.array([[low], [high]]) if compiled.jnt_limited[k] else np.array([[-np.inf], [np.inf]])
        else:
            joint = pin.JointModelFreeFlyer() if kind == FREE else pin.JointModelSpherical()
            highest = np.r_[np.full(3 if kind == FREE else 0, np.inf), np.full(4, _QUATERNION)]
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
        carrier = self.carriers[body]
        if body == 0 and not compiled.site(site).name:
            return
        number = site - next(k for k in range(compiled.nsite) if compiled.site_bodyid[k] == body)
        place = carrier.placement * pose(compiled.site_pos[site], compiled.site_quat[site])
        name = compiled.site(site).name or f"{carrier.name}Site_{number}"
        self.model.addFrame(pin.Frame(name, carrier.joint, carrier.frame, place, pin.FrameType.OP_FRAME))


def pose(position: np.ndarray, quaternion: np.ndarray) -> pin.SE3:
    """Pose of a position (3,) and a quaternion (4,) of MuJoCo, its scalar first."""
    return pin.XYZQUATToSE3(np.r_[position, quaternion[1:], quaternion[0]])
