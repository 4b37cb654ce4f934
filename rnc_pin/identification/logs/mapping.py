"""Mapping of the columns or topics of a log to joints and frames: the keys of a small YAML file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal

import yaml
from pydantic import BeforeValidator, Field

from rnc_pin.errors import ConfigurationError
from rnc_pin.io import Json, Strict, load_yaml, read_bytes, validated

Place = str | Annotated[int, Field(ge=0)]
"""Name of a column, or its number from 0."""
Positive = Annotated[float, Field(gt=0)]


class ColumnKeys(Strict):
    """Numbers of one column: ``scale * number + offset``, or ``scale * 2 pi * count / ticks + offset``."""

    column: Place
    """Name of the column, or its number from 0."""
    scale: float = 1.0
    """Factor to SI units, with the sign and the gear."""
    offset: float = 0.0
    """Value at the number zero [SI]."""
    ticks: Positive | None = None
    """Counts of one turn; the number is then an angle in counts."""
    wrap: Positive | None = None
    """Range after which the number starts again, in the units of the column: 8192, 4294967296, 6.283185307179586."""


def _column(raw: object) -> object:
    return {"column": raw} if isinstance(raw, str | int) and not isinstance(raw, bool) else raw


AColumn = Annotated[ColumnKeys, BeforeValidator(_column)]


class JointColumns(Strict):
    """Columns of one joint."""

    position: AColumn | None = None
    """Position [rad or m]."""
    velocity: AColumn | None = None
    """Velocity [rad/s or m/s]."""
    effort: AColumn | None = None
    """Torque or force [N m or N]."""


class PoseColumns(Strict):
    """Columns of a frame's pose in a fixed frame. Missing numbers are zero; angles or a quaternion, not both."""

    x: AColumn | None = None
    """Position x [m]."""
    y: AColumn | None = None
    """Position y [m]."""
    z: AColumn | None = None
    """Position z [m]."""
    roll: AColumn | None = None
    """Rotation about the fixed x [rad], before pitch and yaw."""
    pitch: AColumn | None = None
    """Rotation about the fixed y [rad]."""
    yaw: AColumn | None = None
    """Rotation about the fixed z [rad]."""
    qx: AColumn | None = None
    """Quaternion x."""
    qy: AColumn | None = None
    """Quaternion y."""
    qz: AColumn | None = None
    """Quaternion z."""
    qw: AColumn | None = None
    """Quaternion w."""


class TwistColumns(Strict):
    """Columns of a frame's velocity in its own axes. Missing numbers are zero."""

    vx: AColumn | None = None
    """Velocity along x [m/s]."""
    vy: AColumn | None = None
    """Velocity along y [m/s]."""
    vz: AColumn | None = None
    """Velocity along z [m/s]."""
    wx: AColumn | None = None
    """Angular velocity about x [rad/s]."""
    wy: AColumn | None = None
    """Angular velocity about y [rad/s]."""
    wz: AColumn | None = None
    """Angular velocity about z [rad/s]."""


class ImuColumns(Strict):
    """Columns of an inertial sensor in its own axes. Missing numbers are zero."""

    wx: AColumn | None = None
    """Angular velocity about x [rad/s]."""
    wy: AColumn | None = None
    """Angular velocity about y [rad/s]."""
    wz: AColumn | None = None
    """Angular velocity about z [rad/s]."""
    ax: AColumn | None = None
    """Acceleration along x [m/s^2]."""
    ay: AColumn | None = None
    """Acceleration along y [m/s^2]."""
    az: AColumn | None = None
    """Acceleration along z [m/s^2]."""


class Topic(Strict):
    """Use of one topic of a bag."""

    joints: dict[str, str] | Literal["all"] | None = None
    """Names in a JointState to joints of the robot; ``all`` if they are the same."""
    pose: str | None = None
    """Frame whose pose an Odometry, PoseStamped or PoseWithCovarianceStamped gives."""
    twist: str | None = None
    """Frame whose velocity an Odometry, Twist or TwistStamped gives."""
    imu: str | None = None
    """Frame of an Imu."""
    frames: dict[str, str] | None = None
    """Child frames of a TFMessage to frames of the robot, whose poses it gives."""
    parent: str | None = None
    """Parent frame of the transforms to read; by default any, which has to be the same in all."""
    stamp: Literal["header", "bag"] = "header"
    """Time of a sample: that of the message's header, or that of its recording."""


class Correction(Strict):
    """Correction of a measured joint, ``scale * position + offset``, or of the clock of a joint or frame.

    Example:
        >>> first = rnc.logs.Correction(scale=2.0, offset=1.0)
        >>> rnc.logs.Correction(scale=3.0).after(first).offset
        3.0
    """

    scale: float = 1.0
    """Factor of positions and velocities of a joint."""
    offset: float = 0.0
    """Value added to the scaled position of a joint [rad or m]."""
    delay: float = 0.0
    """Time by which the stamps of the joint or frame are late [s]."""

    def after(self, first: Correction) -> Correction:
        """Return this correction of a log that has the first one already.

        Args:
            first: the first correction.
        """
        return Correction(
            scale=self.scale * first.scale,
            offset=self.scale * first.offset + self.offset,
            delay=self.delay + first.delay,
        )


class LogMapping(Strict):
    """Columns of a table, or topics of a bag, and the joints and frames that they belong to.

    Example:
        >>> mapping = rnc.logs.LogMapping.of({"joints": {"wheel": {"position": {"column": "ticks", "ticks": 4096}}}})
        >>> mapping.joints["wheel"].position.ticks
        4096.0
    """

    time: AColumn = ColumnKeys(column="time")
    """ColumnKeys of the time stamps [s]."""
    separator: Literal["comma", "semicolon", "tab", "space"] = "comma"
    """Separator of a text table; ``space`` is any number of blanks."""
    comment: str = "#"
    """Beginning of a comment in a text table."""
    header: bool | None = None
    """True if the first line has the names of the columns; by default if a column is given by its name."""
    joints: dict[str, JointColumns] = {}
    """Joints of the robot and their columns."""
    frames: dict[str, PoseColumns] = {}
    """Frames of the robot and the columns of their poses."""
    twists: dict[str, TwistColumns] = {}
    """Frames of the robot and the columns of their velocities."""
    imus: dict[str, ImuColumns] = {}
    """Frames of inertial sensors and their columns."""
    topics: dict[str, Topic] = {}
    """Topics of a bag and their use."""
    corrections: dict[str, Correction] = {}
    """Corrections of measured joints and of clocks, by joint or frame, e.g. from a calibration."""

    @classmethod
    def of(cls, mapping: str | Path | Mapping[str, Json] | LogMapping) -> LogMapping:
        """Return the mapping of a YAML file, of keys, or itself.

        Args:
            mapping: the file, or its keys.

        Raises:
            ConfigurationError: the file cannot be read, or a key or value is wrong.
        """
        if isinstance(mapping, LogMapping):
            return mapping
        if isinstance(mapping, Mapping):
            return validated(cls, dict(mapping), "mapping of the log")
        try:
            raw = load_yaml(read_bytes(Path(mapping)).decode())
        except OSError as error:
            raise ConfigurationError(f"{mapping}: {error.strerror or 'cannot be read'}") from None
        except (yaml.YAMLError, UnicodeDecodeError) as error:
            raise ConfigurationError(f"{mapping}: not YAML: {error}") from None
        if not isinstance(raw, dict):
            raise ConfigurationError(f"{mapping}: expected a mapping with keys such as joints, frames or topics")
        return validated(cls, raw, str(mapping))
