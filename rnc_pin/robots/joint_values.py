"""Joints, frames and configurations of a model by name; joint values (angles, displacements) and the entries of q."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from rnc_pin.errors import ConfigurationError, ModelError, argument, nearest

JointValue = float | Sequence[float] | np.ndarray

_QUATERNION = ("qx", "qy", "qz", "qw")
_KINDS = {
    "JointModelPlanar": (("x", "y", "cos", "sin"), "3 (x, y, yaw)"),
    "JointModelFreeFlyer": (("x", "y", "z", *_QUATERNION), "7 (x, y, z, quaternion x, y, z, w)"),
    "JointModelSpherical": (_QUATERNION, "4 (quaternion x, y, z, w)"),
}
"""Entries of q, and values that a user gives, of joints whose q are no coordinates of their velocity."""

NO_LIMIT = 1e10
"""Value above which a number of a robot file means that there is no limit; Pinocchio writes the largest float."""


def known_velocity_limits(model: pin.Model) -> np.ndarray:
    """Velocity limits (nv,) of a robot file [rad/s or m/s]; infinity where it states none.

    Args:
        model: model of the robot.
    """
    # URDF tools write 0 for an unknown limit, and no joint has a limit of zero.
    limits = np.array(model.upperVelocityLimit, dtype=float)
    return np.where((limits > 0) & (limits < NO_LIMIT), limits, np.inf)


def base_of(model: pin.Model) -> str:
    """Kind of the joint between the root link and the world: "fixed", "planar" or "free".

    Args:
        model: model of the robot.
    """
    bases = {"JointModelPlanar": "planar", "JointModelFreeFlyer": "free"}
    return bases.get(model.joints[1].shortname(), "fixed") if model.njoints > 1 else "fixed"


def fixed_base(model: pin.Model) -> str:
    """Part of an error message about a robot whose base is fixed by mistake.

    Args:
        model: Pinocchio model of the robot.
    """
    return f"the base of robot '{model.name}' is fixed; {argument('base', 'planar')} or 'free' lets it move"


def _goes_round(joint: pin.JointModel) -> bool:
    """True if a joint is continuous with configuration (cos, sin). Its class depends on the axis."""
    return bool(joint.nq == 2 and joint.nv == 1)


def _joint_coordinates(name: str, joint: pin.JointModel, entry: np.ndarray) -> np.ndarray:
    kind = joint.shortname()
    # By the sizes of q and v and not by name: Pinocchio has a class for each axis.
    if _goes_round(joint) and entry.size == 1:
        return np.array([np.cos(entry[0]), np.sin(entry[0])])
    if kind == "JointModelPlanar" and entry.size == 3:
        return np.array([entry[0], entry[1], np.cos(entry[2]), np.sin(entry[2])])
    if kind in ("JointModelFreeFlyer", "JointModelSpherical") and entry.size == joint.nq:
        # Numbers in files are rounded: any quaternion with a direction is taken, and made exact.
        length = np.linalg.norm(entry[-4:])
        if length < 1e-9:
            raise ModelError(f"joint '{name}': the quaternion (x, y, z, w) has zero length")
        return np.r_[entry[:-4], entry[-4:] / length]
    # Joints on a vector space take their coordinates as they are.
    if entry.size == joint.nq == joint.nv:
        return entry
    _, count = _KINDS.get(kind, ((), str(joint.nv)))
    raise ModelError(f"joint '{name}' takes {count} value{'s' * (count != '1')}, found {entry.size}")


class SingleJoint(NamedTuple):
    """Joint with one degree of freedom, as plain numbers: joint models of Pinocchio cannot be pickled or copied."""

    idx_q: int
    """Index of its first value in q."""
    idx_v: int
    """Index in v."""
    continuous: bool
    """True if q holds the cosine and the sine of its angle."""
    unit: str
    """Unit of its velocity: "rad/s" or "m/s"."""

    @classmethod
    def of(cls, joint: pin.JointModel) -> SingleJoint:
        """Return the place of a joint, which has one degree of freedom.

        Args:
            joint: joint of Pinocchio with one degree of freedom.
        """
        unit = "rad/s" if joint.shortname().startswith("JointModelR") else "m/s"
        return cls(joint.idx_q, joint.idx_v, joint.nq == 2, unit)

    def position(self, q: np.ndarray) -> np.ndarray:
        """Position (...,) [rad or m] at q (..., nq).

        Args:
            q: configurations (..., nq).
        """
        if self.continuous:
            return np.asarray(np.arctan2(q[..., self.idx_q + 1], q[..., self.idx_q]))
        return np.asarray(q[..., self.idx_q])

    def put(self, q: np.ndarray, position: np.ndarray) -> None:
        """Write positions (...,) [rad or m] into q (..., nq).

        Args:
            q: configurations (..., nq), changed in place.
            position: positions (...,) [rad or m].
        """
        if self.continuous:
            q[..., self.idx_q], q[..., self.idx_q + 1] = np.cos(position), np.sin(position)
        else:
            q[..., self.idx_q] = position


class NamedModel:
    """Joints, frames and configurations of a model by name.

    Args:
        model: any ``pinocchio.Model``.
    """

    def __init__(self, model: pin.Model) -> None:
        self.model = model
        self.nq: int = model.nq
        self.nv: int = model.nv
        self.name: str = model.name

    def check_unchanged(self) -> None:
        """Raise ``ModelError`` if joints were added to the model, e.g. by ``model.addJoint``."""
        if self.model.nq != self.nq:
            raise ModelError(f"joints were added to the model of robot '{self.name}': make a new Robot of it")

    def joint_id(self, name: str) -> int:
        """Index of a joint. An unknown name raises ModelError with the nearest name.

        Args:
            name: name of the joint.
        """
        model, valid = self.model, self.joint_names
        if name not in valid:
            if name == "root_joint" and base_of(model) == "fixed":
                raise ModelError(f"no joint 'root_joint' in robot '{self.name}': {fixed_base(model)}")
            raise ModelError(f"no joint '{name}' in robot '{self.name}'{nearest(str(name), valid)}")
        return int(model.getJointId(name))

    def frame_id(self, name: str) -> int:
        """Index of a frame (link, joint or operational frame).

        If a link and a joint share the name, the link's frame is returned. An unknown name raises ModelError with the
        nearest name.

        Args:
            name: name of the frame.
        """
        if not isinstance(name, str) or not self.model.existFrame(name):
            valid = [frame.name for frame in self.model.frames]
            raise ModelError(f"no frame '{name}' in robot '{self.name}'{nearest(str(name), valid)}")
        # A link and its joint may share a name; users mean the link, which has the mass and the shapes.
        same = [index for index, frame in enumerate(self.model.frames) if frame.name == name]
        return next((index for index in same if self.model.frames[index].type == pin.FrameType.BODY), same[0])

    @property
    def single_joint_names(self) -> list[str]:
        """Names of the joints with one degree of freedom."""
        return [name for name, joint in self._named_joints if joint.nv == 1]

    @property
    def _named_joints(self) -> list[tuple[str, pin.JointModel]]:
        return list(zip(self.joint_names, list(self.model.joints)[1:], strict=True))

    def links_of(self, joint: int) -> list[str]:
        """Names of the links that a joint moves, in the order of the model.

        Args:
            joint: index of the joint; 0 for the world.
        """
        frames = (frame for frame in self.model.frames if frame.parentJoint == joint)
        return [str(frame.name) for frame in frames if frame.type == pin.FrameType.BODY]

    def velocity_indices(self, joint: str) -> slice:
        """Slice of a joint's velocity in ``v``.

        Args:
            joint: name of the joint.
        """
        model = self.model.joints[self.joint_id(joint)]
        return slice(model.idx_v, model.idx_v + model.nv)

    def single_joint(self, name: str, remedy: str = "expected one") -> SingleJoint:
        """Place in q and v of a joint with one degree of freedom.

        Args:
            name: name of the joint.
            remedy: end of the message for a joint with several.

        Raises:
            ModelError: unknown joint, or one with several degrees of freedom.
        """
        joint = self.model.joints[self.joint_id(name)]
        if joint.nv != 1:
            raise ModelError(f"joint '{name}' has {joint.nv} degrees of freedom: {remedy}")
        return SingleJoint.of(joint)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the movable joints, in model order."""
        return tuple(list(self.model.names)[1:])

    @property
    def velocity_names(self) -> tuple[str, ...]:
        """Names of the entries of ``v``: the joint name, with an index if the joint has several entries."""
        joints = self._named_joints
        return tuple(name if joint.nv == 1 else f"{name}[{k}]" for name, joint in joints for k in range(joint.nv))

    @property
    def configuration_entries(self) -> tuple[tuple[str, str], ...]:
        """Name and unit of each entry of ``q``: the joint name, with the coordinate if the joint has several entries.

        A planar base has ``[x]``, ``[y]``, ``[cos]`` and ``[sin]``; a free base a position and a quaternion. Entries of
        other joints with several coordinates have numbers. Cosines, sines and quaternions have the unit "-".
        """
        found: list[tuple[str, str]] = []
        units = [unit.removesuffix("/s") for unit in self.velocity_units]
        for name, joint in self._named_joints:
            own = units[joint.idx_v : joint.idx_v + joint.nv]
            if joint.nq == 1:
                found.append((name, own[0]))
                continue
            if _goes_round(joint):
                entries = [("cos", "-"), ("sin", "-")]
            elif joint.shortname() in _KINDS:
                entries = [(each, "m" if each in "xyz" else "-") for each in _KINDS[joint.shortname()][0]]
            else:
                # Only with equal numbers do entries of q belong to entries of v.
                entries = [(str(k), unit) for k, unit in enumerate(own if joint.nq == joint.nv else ["-"] * joint.nq)]
            found += [(f"{name}[{entry}]", unit) for entry, unit in entries]
        return tuple(found)

    @property
    def velocity_units(self) -> tuple[str, ...]:
        """Unit of each entry of ``v``: "rad/s" for rotation about any axis, "m/s" for translation."""
        jacobian = pin.computeJointJacobians(self.model, self.model.createData(), pin.neutral(self.model))
        # By the motion that each entry makes, not by the class of its joint: that covers composite joints too.
        turning = jacobian.reshape(6, self.nv)[3:]  # Pinocchio gives (6,) where nv is 1
        return tuple("rad/s" if column.any() else "m/s" for column in turning.T)

    def configuration(self, values: Mapping[str, JointValue] | None = None) -> np.ndarray:
        """Neutral configuration (nq,) with the given joint values.

        Args:
            values: joint name to angle [rad] or displacement [m]. A planar base takes (x, y, yaw), a free base
                (x, y, z) and a quaternion (x, y, z, w), a ball joint the quaternion.

        Raises:
            ModelError: unknown joint, or values of a wrong number or type.
        """
        q, values = pin.neutral(self.model), values or {}
        if not isinstance(values, Mapping):
            example = next(iter(self.joint_names), "joint")
            raise ModelError(f"joint values have to be a mapping such as {{'{example}': 0.0}}, found {values!r}")
        for name, value in values.items():
            joint = self.model.joints[self.joint_id(name)]
            given = np.atleast_1d(np.asarray(value)) if not isinstance(value, Mapping) else np.zeros(1, dtype=object)
            # Truth values and texts would become numbers by the conversion below.
            if given.dtype.kind not in "iuf":
                raise ModelError(f"joint '{name}' takes numbers, found {value!r}")
            entry = given.astype(float)
            if not np.isfinite(entry).all():
                raise ModelError(f"joint '{name}' takes finite numbers, found {value!r}")
            q[joint.idx_q : joint.idx_q + joint.nq] = _joint_coordinates(name, joint, entry)
        return q

    def joint_values(self, q: np.ndarray) -> dict[str, float | list[float]]:
        """Joint name to value(s) [rad or m] at q (nq,), the inverse of ``configuration``.

        Args:
            q: one configuration (nq,).
        """
        values: dict[str, float | list[float]] = {}
        for name, joint in self._named_joints:
            entry = q[joint.idx_q : joint.idx_q + joint.nq]
            if _goes_round(joint):
                values[name] = float(np.arctan2(entry[1], entry[0]))
            elif joint.shortname() == "JointModelPlanar":
                values[name] = [float(entry[0]), float(entry[1]), float(np.arctan2(entry[3], entry[2]))]
            else:
                values[name] = float(entry[0]) if joint.nq == 1 else entry.tolist()
        return values

    def random_configuration(self, generator: np.random.Generator, spread: float = np.pi) -> np.ndarray:
        """Random configuration (nq,) from ``generator``, within joint limits and ``spread`` [rad or m] of neutral.

        Args:
            generator: source of the random numbers.
            spread: largest displacement from the neutral configuration in each entry of v [rad or m].
        """
        self.check_unchanged()
        # On the manifold: entries of a quaternion that are drawn one by one are no rotation.
        q = pin.integrate(self.model, pin.neutral(self.model), generator.uniform(-spread, spread, self.nv))
        # Limits hold for entries of q that are coordinates; others, such as quaternions, have none.
        for _, joint in self._named_joints:
            if joint.nq == joint.nv == 1:
                low = max(self.model.lowerPositionLimit[joint.idx_q], -spread)
                high = min(self.model.upperPositionLimit[joint.idx_q], spread)
                if low < high:
                    q[joint.idx_q] = generator.uniform(low, high)
        return q


class LimitedPositions(NamedTuple):
    """Joints with position limits: entries of q and v, and the limits [rad or m]."""

    q: list[int]
    v: list[int]
    lower: np.ndarray
    upper: np.ndarray


def limited_positions(robot: NamedModel, joints: Sequence[str] | None) -> LimitedPositions:
    """Return the joints with position limits; continuous joints and bases have none.

    Args:
        robot: the robot.
        joints: names; by default all joints of the robot.

    Raises:
        ModelError: unknown joint.
        ConfigurationError: a named joint has no position limits.
    """
    model, found = robot.model, []
    for name in robot.joint_names if joints is None else joints:
        joint = model.joints[robot.joint_id(name)]
        places = range(joint.nq) if joint.nq == joint.nv else ()  # coordinates on a circle or sphere have no limits
        low, high = model.lowerPositionLimit, model.upperPositionLimit
        limited = [i for i in places if -NO_LIMIT < low[joint.idx_q + i] < high[joint.idx_q + i] < NO_LIMIT]
        if joints is not None and not limited:
            raise ConfigurationError(f"joint '{name}' has no position limits")
        found += [(joint.idx_q + i, joint.idx_v + i) for i in limited]
    q, v = [place for place, _ in found], [place for _, place in found]
    return LimitedPositions(q, v, model.lowerPositionLimit[q], model.upperPositionLimit[q])
