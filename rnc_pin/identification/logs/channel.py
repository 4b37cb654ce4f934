"""One measured quantity with its own time stamps: put in order, with its gaps, and read at other times."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from rnc_pin.array_shapes import Float
from rnc_pin.errors import ConfigurationError, InputError, nearest
from rnc_pin.printing import counted

Quantity = Literal["position", "velocity", "effort", "pose", "twist", "imu"]
QUANTITIES: tuple[str, ...] = get_args(Quantity)
_SIZES = {"position": 1, "velocity": 1, "effort": 1, "pose": 7, "twist": 6, "imu": 6}
_GAP = 5.0  # intervals longer than so many usual ones are gaps
_UNIT = 1e-3  # accepted deviation of the length of a quaternion from 1


@dataclass(frozen=True, eq=False)
class Channel:
    """Samples of one quantity, in the order of time.

    Duplicate stamps keep their first sample, samples out of order are sorted, and samples with missing numbers are
    left out; ``repairs`` counts them. An interval of more than five usual ones is a gap.

    Args:
        quantity: "position", "velocity" or "effort" of a joint; "pose", "twist" or "imu" of a frame.
        of: name of the joint or the frame.
        time: time stamps (N,) [s].
        values: samples (N, d). Joints have one value [rad or m, rad/s or m/s, N m or N]. A pose is a position [m] and
            a quaternion (x, y, z, w), in a fixed frame; a twist a linear and an angular velocity in the axes of the
            frame [m/s, rad/s]; an imu an angular velocity [rad/s] and an acceleration [m/s^2], both in the same axes.

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
        if self.quantity not in QUANTITIES:
            raise ConfigurationError(f"quantity '{self.quantity}' is not known{nearest(self.quantity, QUANTITIES)}")
        time, values = np.asarray(self.time, dtype=float), np.asarray(self.values, dtype=float)
        size = _SIZES[self.quantity]
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
        return float(np.median(np.diff(self.time)))

    @property
    def gaps(self) -> np.ndarray:
        """Begin and end of each gap (K, 2) [s]."""
        long = np.flatnonzero(np.diff(self.time) > _GAP * self.period)
        return np.stack([self.time[long], self.time[long + 1]], axis=1)

    def part(self, start: float, end: float) -> Channel:
        """Return the samples between two times.

        Args:
            start: first time [s].
            end: last time [s].

        Raises:
            InputError: fewer than two samples are there.
        """
        inside = slice(*np.searchsorted(self.time, [start, np.nextafter(end, np.inf)]))
        return Channel(self.quantity, self.of, self.time[inside], self.values[inside])

    def shifted(self, by: float) -> Channel:
        """Return the channel with other stamps.

        Args:
            by: time to add [s].
        """
        return Channel(self.quantity, self.of, self.time + by, self.values, self.repairs)

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
            found[:, 3:] = _slerp(first[:, 3:], last[:, 3:], share)
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
    if np.abs(lengths - 1.0).max() > _UNIT:
        bad = int(np.argmax(np.abs(lengths - 1.0)))
        raise InputError(f"{name}: quaternion {bad} has length {lengths[bad]:.6g}, expected 1")
    unit = values[:, 3:] / lengths[:, None]
    turned = np.sum(unit[1:] * unit[:-1], axis=1) < 0
    signs = np.where(np.concatenate([[0], np.cumsum(turned)]) % 2, -1.0, 1.0)
    return np.hstack([values[:, :3], unit * signs[:, None]])


def _slerp(first: np.ndarray, last: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Rotations (M, 4) on the arc between two quaternions (M, 4), at shares (M, 1) of it."""
    half = np.arctan2(np.linalg.norm(last - first, axis=1), np.linalg.norm(last + first, axis=1))[:, None]
    angle = 2.0 * half
    return np.asarray(
        ((1 - share) * np.sinc((1 - share) * angle / np.pi) * first + share * np.sinc(share * angle / np.pi) * last)
        / np.sinc(angle / np.pi)
    )
