"""Kinds of unknown parameters: of wheels, joints, encoders, sensors and clocks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal, NamedTuple, TypeAlias

import numpy as np

from rnc_pin.errors import ConfigurationError
from rnc_pin.lab.calibration.row_geometry import Virtual
from rnc_pin.lab.logs.channel import Correction
from rnc_pin.model.system import NonholonomicSystem

Axis = Literal["x", "y", "z"]


@dataclass(frozen=True)
class JointNumber:
    """Unknown number of one joint; a subclass has the words before the joint in its name.

    Args:
        joint: the joint.
    """

    joint: str
    words: ClassVar[str]

    @property
    def name(self) -> str:
        """Name of the parameter."""
        return f"{self.words} of {self.joint}"


@dataclass(frozen=True)
class WheelRadius:
    """Radius of a wheel or a ball, or the common radius of several [m].

    Args:
        wheels: frames of ``RollingWheel`` or ``RollingBall`` constraints.

    Example:
        >>> rnc.calibration.WheelRadius("left_wheel").name
        'radius of left_wheel'
    """

    wheels: str | Sequence[str]

    @property
    def name(self) -> str:
        """Name of the parameter."""
        return f"radius of {', '.join(self.frames)}"

    @property
    def frames(self) -> tuple[str, ...]:
        """Frames of the wheels."""
        return (self.wheels,) if isinstance(self.wheels, str) else tuple(self.wheels)


@dataclass(frozen=True)
class JointShift:
    """Place of a joint along an axis of the body that carries it [m]: a wheelbase, or the distance of a wheel.

    Several joints shift together by their shares. ``{"left": 0.5, "right": -0.5}`` along y is the track of two wheels:
    it grows by a metre if each wheel moves half a metre outwards.

    Args:
        joints: a joint, or joints with their shares.
        axis: axis of the body that carries the joints.

    Example:
        >>> rnc.calibration.JointShift({"left": 0.5, "right": -0.5}, "y").name
        'place of left, right along y'
    """

    joints: str | Mapping[str, float]
    axis: Axis

    @property
    def name(self) -> str:
        """Name of the parameter."""
        return f"place of {', '.join(self.shares)} along {self.axis}"

    @property
    def shares(self) -> Mapping[str, float]:
        """Shift of each joint for a unit of the parameter.

        Raises:
            ConfigurationError: no joint, or a share that is zero or not finite.
        """
        shares = {self.joints: 1.0} if isinstance(self.joints, str) else self.joints
        if (
            not isinstance(shares, Mapping)
            or not shares
            or not all(np.isfinite(each) and each for each in shares.values())
        ):
            raise ConfigurationError(f"place of joints: expected a joint, or joints with shares, found {shares!r}")
        return shares


class EncoderScale(JointNumber):
    """Factor of the measured position of a joint, e.g. of a gear.

    Args:
        joint: the joint.

    Example:
        >>> rnc.calibration.EncoderScale("steering").name
        'scale of steering'
    """

    words: ClassVar[str] = "scale"


class EncoderOffset(JointNumber):
    """Value added to the measured and scaled position of a joint [rad or m].

    Args:
        joint: the joint.

    Example:
        >>> rnc.calibration.EncoderOffset("steering").name
        'offset of steering'
    """

    words: ClassVar[str] = "offset"


@dataclass(frozen=True)
class SensorPlace:
    """Place of the frame whose pose is measured, on its body: along x or y [m], or the angle about z [rad].

    Args:
        axis: "x", "y" or "yaw".

    Example:
        >>> rnc.calibration.SensorPlace("yaw").name
        'yaw of the sensor'
    """

    axis: Literal["x", "y", "yaw"]

    @property
    def name(self) -> str:
        """Name of the parameter."""
        return f"{self.axis} of the sensor"


@dataclass(frozen=True)
class TimeShift:
    """Time by which the stamps of a joint or of the sensor are later than the measurement [s].

    Args:
        of: a joint, or None for the sensor of the pose.

    Example:
        >>> rnc.calibration.TimeShift("steering").name
        'delay of steering'
    """

    of: str | None = None

    @property
    def name(self) -> str:
        """Name of the parameter."""
        return f"delay of {self.of or 'the sensor'}"


Unknown: TypeAlias = WheelRadius | JointShift | EncoderScale | EncoderOffset | SensorPlace | TimeShift


class UnknownNumber(NamedTuple):
    """Unknown number with its value in the robot's file."""

    kind: Unknown
    name: str
    unit: str
    nominal: float
    scale: float
    """Typical size: a radius, a length of the robot, one radian, one."""
    displaced: Mapping[Virtual, float]
    """Displacements of joints for a unit of the parameter."""
    wheels: tuple[str, ...] = ()
    """Wheels of a radius."""

    @property
    def shares(self) -> Mapping[Virtual | str, float]:
        """Displacements of joints, and changes of the radii of wheels, for a unit of the parameter."""
        found: dict[Virtual | str, float] = dict(self.displaced.items())
        return found | dict.fromkeys(self.wheels, 1.0)


def radii_of(parameters: Sequence[UnknownNumber], p: np.ndarray) -> dict[str, float]:
    """Radius of each wheel that parameters p (P,) concern; a second parameter of a wheel adds its change.

    Args:
        parameters: the unknown numbers.
        p: their values (P,).
    """
    radii: dict[str, float] = {}
    for value, each in zip(p, parameters, strict=True):
        for wheel in each.wheels:
            radii[wheel] = float(radii[wheel] + value - each.nominal if wheel in radii else value)
    return radii


def number_of(kind: Unknown, system: NonholonomicSystem, mount: np.ndarray) -> UnknownNumber:
    """Unknown number of a system, whose sensor has a place (3,) on the base: x, y [m] and heading [rad].

    Args:
        kind: the unknown.
        system: the robot and its constraints, with the value of the file.
        mount: place of the sensor on the base: x, y [m] and heading [rad].

    Raises:
        ConfigurationError: a frame or joint is not there, or has no such number.
    """
    robot, model = system.robot, system.robot.model
    distances = [float(np.linalg.norm(model.jointPlacements[k].translation)) for k in range(2, model.njoints)]
    length = max(distances or [1.0]) or 1.0
    if isinstance(kind, WheelRadius):
        sizes = [getattr(each, "radius", None) for each in system.kinds
                 if getattr(each, "frame", None) in kind.frames]  # fmt: skip
        for wheel in kind.frames:
            robot.frame_id(wheel)
        radii = [size for size in sizes if size is not None]
        if not radii:
            raise ConfigurationError(f"{kind.name}: no wheel or ball rolls there")
        nominal = float(np.mean(radii))
        return UnknownNumber(kind, kind.name, "m", nominal, nominal, {}, kind.frames)
    if isinstance(kind, JointShift):
        for joint in kind.shares:
            if robot.joint_id(joint) == 1:
                raise ConfigurationError(f"{kind.name}: '{joint}' is the base")
        displaced = {Virtual(joint, kind.axis): share for joint, share in kind.shares.items()}
        axis = "xyz".index(kind.axis)
        places = {joint: model.jointPlacements[robot.joint_id(joint)].translation[axis] for joint in kind.shares}
        # The least-squares solution of place = share * nominal: exact where the joints are symmetric.
        nominal = sum(share * places[joint] for joint, share in kind.shares.items())
        nominal /= sum(share**2 for share in kind.shares.values())
        return UnknownNumber(kind, kind.name, "m", float(nominal), length, displaced)
    if isinstance(kind, SensorPlace):
        axis = ("x", "y", "yaw").index(kind.axis)
        unit, scale = ("rad", 1.0) if axis == 2 else ("m", length)
        return UnknownNumber(kind, kind.name, unit, float(mount[axis]), scale, {})
    if isinstance(kind, TimeShift):
        if kind.of is not None:
            robot.joint_id(kind.of)
        return UnknownNumber(kind, kind.name, "s", 0.0, 1.0, {})
    robot.single_joint(kind.joint)
    unit = robot.velocity_units[robot.velocity_indices(kind.joint).start].removesuffix("/s")
    if isinstance(kind, EncoderScale):
        return UnknownNumber(kind, kind.name, "", 1.0, 1.0, {})
    return UnknownNumber(kind, kind.name, unit, 0.0, 1.0 if unit == "rad" else length, {})


def corrections_of(parameters: Sequence[UnknownNumber], p: np.ndarray, sensor: str) -> dict[str, Correction]:
    """Corrections of joints and clocks that parameters p (P,) say, by joint or frame.

    Args:
        parameters: the unknown numbers.
        p: their estimates (P,).
        sensor: frame whose pose was measured; its clock is corrected under this name.
    """
    found: dict[str, Correction] = {}
    for value, each in zip(p.tolist(), parameters, strict=True):
        kind = each.kind
        key = {EncoderScale: "scale", EncoderOffset: "offset", TimeShift: "delay"}.get(type(kind))
        if key is not None:
            name = (kind.of or sensor) if isinstance(kind, TimeShift) else str(getattr(kind, "joint", ""))
            found[name] = found.get(name, Correction()).model_copy(update={key: value})
    return found
