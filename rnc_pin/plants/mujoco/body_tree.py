"""Bodies and joints of a loaded robot as a MuJoCo specification; it keeps locked joints, snapped axes and masses."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
import pinocchio as pin

from rnc_pin.errors import ConfigurationError
from rnc_pin.plants.mujoco.engine import mujoco
from rnc_pin.plants.mujoco.joint_coordinates import (
    BallJoint,
    ContinuousHinge,
    EqualCoordinates,
    FreeBase,
    FreePlanarBase,
    JointCoordinates,
    PlanarBase,
    scalar_first,
)
from rnc_pin.robots.robot import Robot

Root = Literal["as it is", "free", "level"]
"""Type of a planar base in MuJoCo: planar as it is, six degrees of freedom, or planar with vertical motion."""

_NOTHING = 1e-12  # placeholder mass and inertia for the compiler; ``finish`` writes those of the robot
_STACKS = {"JointModelTranslation": ("slide", "xyz"), "JointModelSphericalZYX": ("hinge", "zyx")}


class _Single(NamedTuple):
    """Joint of one degree of freedom."""

    placement: pin.SE3
    slides: bool
    axis: np.ndarray
    continuous: bool


@dataclass(frozen=True)
class _Planned:
    """Joint conversion whose MuJoCo indices are known after compilation."""

    coordinates: type[JointCoordinates]
    first: str
    """Name of its first MuJoCo joint."""
    name: str
    q: int
    v: int
    nv: int
    more: dict[str, Any]


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
        self._planned: list[_Planned] = []
        spec.compiler.degree = False
        spec.compiler.balanceinertia = True
        spec.compiler.boundmass = spec.compiler.boundinertia = _NOTHING
        spec.option.gravity = robot.model.gravity.linear
        self.bodies: list[Any] = [spec.worldbody]
        """One body per joint of the model; the world is first."""
        for index in range(1, robot.model.njoints):
            self.bodies.append(self._add(index, root))

    # ------------------------------------------------------------------ writing

    def _add(self, index: int, root: Root) -> Any:
        model = self.robot.model
        joint, name, parent = model.joints[index], str(model.names[index]), model.parents[index]
        kind, placement = joint.shortname(), model.jointPlacements[index]
        singles = list(_singles(joint))
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
                self._plan(BallJoint, name, index)
            elif kind in _STACKS:
                moves, axes = _STACKS[kind]
                for axis in axes:
                    _move(body, f"{name}/{axis}", moves == "slide", np.eye(3)["xyz".index(axis)])
                self._plan(EqualCoordinates, f"{name}/{axes[0]}", index)
            else:
                raise ConfigurationError(
                    f"MuJoCo has no joint like '{name}' ({kind}): expected a hinge, slide, ball, planar or free base"
                )
        _weigh(body, model.inertias[index])
        return body

    def _add_single(self, body: Any, single: _Single, joint: Any, number: int, name: str) -> None:
        added = _move(body, name, single.slides, single.axis)
        q, v = joint.idx_q, joint.idx_v + number
        if number:
            q = joint.extract().joints[number].idx_q
        kind = ContinuousHinge if single.continuous else EqualCoordinates
        self._planned.append(_Planned(kind, name, name, q, v, 1, {}))
        if self._limits and not single.continuous:
            model = self.robot.model
            low, high = model.lowerPositionLimit[q], model.upperPositionLimit[q]
            if np.isfinite([low, high]).all() and low < high:
                added.limited, added.range = True, [low, high]

    def _add_planar(self, body: Any, index: int, root: Root) -> None:
        name, placement = str(self.robot.model.names[index]), self.robot.model.jointPlacements[index]
        if root == "free":
            body.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_FREE)
            self._plan(FreePlanarBase, name, index, placement=placement)
            return
        for axis in "xyz" if root == "level" else "xy":
            _move(body, f"{name}/{axis}", True, np.eye(3)["xyz".index(axis)])
        _move(body, f"{name}/yaw", False, np.eye(3)[2])
        self._plan(PlanarBase, f"{name}/x", index, lifted=root == "level")

    def _plan(self, coordinates: type[JointCoordinates], first: str, index: int, **more: Any) -> None:
        joint = self.robot.model.joints[index]
        self._planned.append(
            _Planned(coordinates, first, str(self.robot.model.names[index]), joint.idx_q, joint.idx_v, joint.nv, more)
        )

    # ------------------------------------------------------------------ once it is compiled

    def coordinates(self, model: mujoco.MjModel) -> list[JointCoordinates]:
        """Return the conversions of all joints between Pinocchio and MuJoCo."""
        found = []
        for each in self._planned:
            joint = model.joint(each.first)
            place = (int(joint.qposadr[0]), int(joint.dofadr[0]))
            found.append(each.coordinates(each.name, each.q, each.v, each.nv, *place, **each.more))
        return found

    def finish(self, model: mujoco.MjModel, data: mujoco.MjData, damping: bool) -> list[JointCoordinates]:
        """Set what a specification lacks in a compiled model: zero masses, rotor inertias, damping per axis."""
        own = self.robot.model
        for index in range(1, own.njoints):
            body = model.body(str(own.names[index])).id
            moments = np.linalg.eigvalsh(own.inertias[index].inertia)
            model.body_mass[body], model.body_inertia[body] = own.inertias[index].mass, np.maximum(moments, 0.0)
        joints = self.coordinates(model)
        for joint in joints:
            here, there = slice(joint.v, joint.v + joint.nv), slice(joint.dof, joint.dof + joint.nv)
            if isinstance(joint, PlanarBase | FreePlanarBase | FreeBase):
                if own.armature[here].any() or (damping and own.damping[here].any()):
                    raise ConfigurationError(
                        f"MuJoCo: base '{joint.name}' has rotor inertia or damping, which MuJoCo bases do not support"
                    )
                continue
            model.dof_armature[there] = own.armature[here]
            if damping:
                model.dof_damping[there] = own.damping[here]
        mujoco.mj_setConst(model, data)
        return joints


def _singles(joint: Any) -> Iterator[_Single]:
    """Yield the hinges and slides of a joint; nothing if it has other components."""
    if joint.shortname() == "JointModelComposite":
        whole = joint.extract()
        inner = [_single(each, placement) for each, placement in zip(whole.joints, whole.jointPlacements, strict=True)]
        if all(inner):
            yield from (each for each in inner if each)
    elif single := _single(joint, pin.SE3.Identity()):
        yield single


def _single(joint: Any, placement: pin.SE3) -> _Single | None:
    if joint.nv != 1:
        return None
    alone = pin.Model()
    alone.addJoint(0, joint, pin.SE3.Identity(), "alone")
    motion = pin.computeJointJacobians(alone, alone.createData(), pin.neutral(alone)).reshape(6)
    slide, turn = motion[:3], motion[3:]
    if slide.any() and turn.any():  # a screw
        return None
    return _Single(placement, bool(slide.any()), slide if slide.any() else turn, joint.nq == 2)


def _body(parent: Any, placement: pin.SE3, name: str) -> Any:
    return parent.add_body(
        name=name,
        pos=placement.translation,
        quat=_quaternion(placement.rotation),
        mass=_NOTHING,
        inertia=[_NOTHING] * 3,
        explicitinertial=True,
    )


def _move(body: Any, name: str, slides: bool, axis: np.ndarray) -> Any:
    kind = mujoco.mjtJoint.mjJNT_SLIDE if slides else mujoco.mjtJoint.mjJNT_HINGE
    return body.add_joint(name=name, type=kind, axis=axis)


def _weigh(body: Any, inertia: pin.Inertia) -> None:
    moments, axes = np.linalg.eigh(inertia.inertia)
    if np.linalg.det(axes) < 0:
        axes[:, 0] *= -1
    body.mass, body.ipos, body.iquat = inertia.mass, inertia.lever, _quaternion(axes)
    body.inertia = moments


def _quaternion(rotation: np.ndarray) -> np.ndarray:
    return scalar_first(pin.Quaternion(rotation).coeffs())
