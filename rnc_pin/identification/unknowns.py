"""Kinds of unknown kinematic parameters: of wheels, of joints, of encoders, of sensors and of clocks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from rnc_pin.errors import ConfigurationError

Axis = Literal["x", "y", "z"]


@dataclass(frozen=True)
class WheelRadius:
    """Radius of a wheel or a ball, or the common radius of several [m].

    Args:
        wheels: frames of ``RollingWheel`` or ``RollingBall`` constraints.

    Example:
        >>> rnc.identification.WheelRadius("left_wheel").name
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
        return _several(self.wheels)


@dataclass(frozen=True)
class JointShift:
    """Place of a joint along an axis of the body that carries it [m]: a wheelbase, or the distance of a wheel.

    Several joints shift together by their shares. ``{"left": 0.5, "right": -0.5}`` along y is the track of two wheels:
    it grows by a metre if each wheel moves half a metre outwards.

    Args:
        joints: a joint, or joints with their shares.
        axis: axis of the body that carries the joints.

    Example:
        >>> rnc.identification.JointShift({"left": 0.5, "right": -0.5}, "y").name
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
        """Shift of each joint for a unit of the parameter."""
        return _shares(self.joints, "place")


@dataclass(frozen=True)
class JointTilt:
    """Rotation of a joint's placement about an axis of the joint [rad], relative to the file: camber, toe, rake.

    Args:
        joints: a joint, or joints with their shares.
        axis: axis of the joint's frame.

    Example:
        >>> rnc.identification.JointTilt("left", "z").name
        'tilt of left about z'
    """

    joints: str | Mapping[str, float]
    axis: Axis

    @property
    def name(self) -> str:
        """Name of the parameter."""
        return f"tilt of {', '.join(self.shares)} about {self.axis}"

    @property
    def shares(self) -> Mapping[str, float]:
        """Rotation of each joint for a unit of the parameter."""
        return _shares(self.joints, "tilt")


@dataclass(frozen=True)
class EncoderScale:
    """Factor of the measured position of a joint, e.g. of a gear.

    Args:
        joint: the joint.

    Example:
        >>> rnc.identification.EncoderScale("steering").name
        'scale of steering'
    """

    joint: str

    @property
    def name(self) -> str:
        """Name of the parameter."""
        return f"scale of {self.joint}"


@dataclass(frozen=True)
class EncoderOffset:
    """Value added to the measured and scaled position of a joint [rad or m].

    Args:
        joint: the joint.

    Example:
        >>> rnc.identification.EncoderOffset("steering").name
        'offset of steering'
    """

    joint: str

    @property
    def name(self) -> str:
        """Name of the parameter."""
        return f"offset of {self.joint}"


@dataclass(frozen=True)
class SensorPlace:
    """Place of the frame whose pose is measured, on its body: along x or y [m], or the angle about z [rad].

    Args:
        axis: "x", "y" or "yaw".

    Example:
        >>> rnc.identification.SensorPlace("yaw").name
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
        >>> rnc.identification.TimeShift("steering").name
        'delay of steering'
    """

    of: str | None = None

    @property
    def name(self) -> str:
        """Name of the parameter."""
        return f"delay of {self.of or 'the sensor'}"


Unknown: TypeAlias = WheelRadius | JointShift | JointTilt | EncoderScale | EncoderOffset | SensorPlace | TimeShift
AXES: Mapping[str, np.ndarray] = dict(zip("xyz", np.eye(3), strict=True))


def _several(names: str | Sequence[str]) -> tuple[str, ...]:
    return (names,) if isinstance(names, str) else tuple(names)


def _shares(joints: str | Mapping[str, float], what: str) -> Mapping[str, float]:
    shares = {joints: 1.0} if isinstance(joints, str) else joints
    if not isinstance(shares, Mapping) or not shares or not all(np.isfinite(each) and each for each in shares.values()):
        raise ConfigurationError(f"{what} of joints: expected a joint, or joints with shares, found {joints!r}")
    return shares
