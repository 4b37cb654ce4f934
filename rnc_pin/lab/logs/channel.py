"""Channels of a log, and the mapping that names them in a file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal, get_args

import numpy as np
import yaml
from pydantic import BeforeValidator, Field
from scipy.spatial.transform import Rotation, Slerp

from rnc_pin.array_shapes import Float
from rnc_pin.errors import ConfigurationError, InputError, check_known
from rnc_pin.io import Json, Strict, load_yaml, read_bytes, validated
from rnc_pin.printing import counted

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
    """Columns of a table, and the joints and frames that they belong to.

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
            raise ConfigurationError(f"{mapping}: expected a mapping with keys such as joints or frames")
        return validated(cls, raw, str(mapping))


Quantity = Literal["position", "velocity", "effort", "pose"]
QUANTITIES: tuple[str, ...] = get_args(Quantity)
_GAP = 5.0  # intervals longer than so many usual ones are gaps


@dataclass(frozen=True, eq=False)
class Channel:
    """Samples of one quantity, in the order of time.

    Duplicate stamps keep their first sample, samples out of order are sorted, and samples with missing numbers are
    left out; ``repairs`` counts them. An interval of more than five usual ones is a gap.

    Args:
        quantity: "position", "velocity" or "effort" of a joint; "pose" of a frame.
        of: name of the joint or the frame.
        time: time stamps (N,) [s].
        values: samples (N, d). Joints have one value [rad or m, rad/s or m/s, N m or N]. A pose is a position [m] and
            a quaternion (x, y, z, w), in a fixed frame.

    Attributes:
        repairs: changes that were necessary, in words.

    Raises:
        InputError: shapes do not match, no two samples are left, or a stamp is not finite.
        ConfigurationError: unknown quantity.

    Example:
        >>> encoder = rnc.logs.Channel("position", "wheel", [0.0, 0.2, 0.1, 0.1], [[0.0], [2.0], [1.0], [1.0]])
        >>> encoder.repairs
        ('1 sample out of order', '1 duplicate stamp')
        >>> encoder.at([0.05])
        array([[0.5]])
    """

    quantity: Quantity
    of: str
    time: Float[np.ndarray, " N"]
    values: Float[np.ndarray, "N d"]
    repairs: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        check_known(self.quantity, QUANTITIES, "quantity")
        time, values = np.asarray(self.time, dtype=float), np.asarray(self.values, dtype=float)
        size = 7 if self.quantity == "pose" else 1  # numbers of a sample
        if time.ndim != 1 or values.shape != (len(time), size):
            raise InputError(f"{self.name}: {time.shape} stamps with values {values.shape}, expected (N,), (N, {size})")
        if not np.isfinite(time).all():
            bad = int(np.argmin(np.isfinite(time)))
            raise InputError(f"{self.name}: stamp {bad} is {time[bad]}, expected a finite time")
        time, values, repairs = _in_order(time, values)
        if len(time) < 2:
            raise InputError(f"{self.name}: {counted(len(time), 'sample')} left, expected at least 2")
        object.__setattr__(self, "repairs", (*self.repairs, *repairs))
        if self.quantity == "pose":
            values = _with_unit_quaternions(values, self.name)
        for name, array in (("time", time), ("values", values)):
            # A view: the array of the caller stays writable.
            array = array.view()
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    @property
    def name(self) -> str:
        """Quantity and name, e.g. ``position(wheel)``."""
        return f"{self.quantity}({self.of})"

    @property
    def period(self) -> float:
        """Usual interval between samples: the median [s]."""
        # The median: gaps and jitter hardly move it.
        return float(np.median(np.diff(self.time)))

    @property
    def gaps(self) -> np.ndarray:
        """Begin and end of each gap (K, 2) [s]."""
        long = np.flatnonzero(np.diff(self.time) > _GAP * self.period)
        return np.stack([self.time[long], self.time[long + 1]], axis=1)

    def shifted(self, by: float) -> Channel:
        """Return the channel with other stamps.

        Args:
            by: time to add [s].
        """
        return replace(self, time=self.time + by)

    def at(self, times: Sequence[float] | np.ndarray) -> np.ndarray:
        """Return values (M, d) at other times, linear between samples; NaN in gaps and outside the samples.

        Rotations of poses follow the shortest arc between two samples.

        Args:
            times: times (M,) [s].
        """
        times = np.asarray(times, dtype=float)
        before = np.clip(np.searchsorted(self.time, times, side="right") - 1, 0, len(self.time) - 2)
        interval = self.time[before + 1] - self.time[before]
        share = ((times - self.time[before]) / interval)[:, None]
        first, last = self.values[before], self.values[before + 1]
        found = first + share * (last - first)
        if self.quantity == "pose":
            # Along the arc: a mean of two quaternions is shorter than 1, and turns unevenly.
            arc = Slerp(self.time, Rotation.from_quat(self.values[:, 3:]))
            found[:, 3:] = arc(np.clip(times, self.time[0], self.time[-1])).as_quat()
        # A time that rounding moves past the last sample, or into a gap, still has the value of that sample.
        inside = (share[:, 0] >= -1e-9) & (share[:, 0] <= 1 + 1e-9)
        in_gap = (interval > _GAP * self.period) & (share[:, 0] > 1e-9) & (share[:, 0] < 1 - 1e-9)
        found[~inside | in_gap] = np.nan
        return found


def _in_order(time: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Samples in the order of time, without duplicates and missing numbers, and the repairs in words."""
    repairs = []
    whole = np.isfinite(values).all(axis=1)
    if not whole.all():
        repairs.append(counted(int(np.sum(~whole)), "sample") + " without a number")
        time, values = time[whole], values[whole]
    late = int(np.sum(time < np.maximum.accumulate(time))) if len(time) else 0
    if late:
        repairs.append(counted(late, "sample") + " out of order")
        # Stable: of duplicate stamps, the first one in the file stays first.
        order = np.argsort(time, kind="stable")
        time, values = time[order], values[order]
    new = np.concatenate([[True], np.diff(time) > 0]) if len(time) else np.zeros(0, dtype=bool)
    if not new.all():
        repairs.append(counted(int(np.sum(~new)), "duplicate stamp"))
        time, values = time[new], values[new]
    return time, values, repairs


def _with_unit_quaternions(values: np.ndarray, name: str) -> np.ndarray:
    """Poses whose quaternions have length 1 and no jumps of sign."""
    lengths = np.linalg.norm(values[:, 3:], axis=1)
    deviation = 1e-3  # of the length of a quaternion from 1 that digits of a file explain
    if np.abs(lengths - 1.0).max() > deviation:
        bad = int(np.argmax(np.abs(lengths - 1.0)))
        raise InputError(f"{name}: quaternion {bad} has length {lengths[bad]:.6g}, expected 1")
    unit = values[:, 3:] / lengths[:, None]
    # q and -q are one rotation: numbers that jump between them could not be interpolated or plotted.
    turned = np.sum(unit[1:] * unit[:-1], axis=1) < 0
    signs = np.where(np.concatenate([[0], np.cumsum(turned)]) % 2, -1.0, 1.0)
    return np.hstack([values[:, :3], unit * signs[:, None]])
