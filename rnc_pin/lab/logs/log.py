"""Measured log of a robot: channels of joints and frames, each with its own time stamps."""

from __future__ import annotations

import io
import itertools
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import cast

import numpy as np
import pinocchio as pin
from numpy import ndarray as Array
from scipy.spatial.transform import Rotation

from rnc_pin.errors import ConfigurationError, RncError, check_unique, nearest
from rnc_pin.io.json import Json
from rnc_pin.io.safe_npz import ArchiveError, read_npz
from rnc_pin.io.safe_read import open_regular
from rnc_pin.io.strict_mapping import Strict
from rnc_pin.lab.logs.channel import Channel, ColumnKeys, Correction, LogMapping, Place, Quantity
from rnc_pin.model.kinematics import Kinematics
from rnc_pin.printing import Item, ObjectSummary, SummaryMixin, counted
from rnc_pin.robots.robot import Robot


class Log(SummaryMixin):
    """Measured log: channels whose stamps may differ, have gaps, and jitter.

    Times are seconds since the first sample. A log takes 8 bytes for each number, and reading a table twice as many.

    Args:
        channels: channels with stamps of one clock; no two of the same name.

    Attributes:
        channels: the channels by name, e.g. ``position(wheel)``.
        start: stamp of the first sample before it became zero [s].

    Raises:
        ConfigurationError: there is no channel, or two have the same name.

    Example:
        >>> time = np.linspace(0.0, 1.0, 101)
        >>> log = rnc.Log([rnc.logs.Channel("position", "wheel", time + 100.0, 3.0 * time[:, None])])
        >>> print(log)
        Log: 1 s, 1 channel
          position(wheel): 101 samples [0.01 s]
        >>> log.channel("position", "wheel").at([0.555])
        array([[1.665]])
    """

    def __init__(self, channels: Iterable[Channel]) -> None:
        given = list(channels)
        if not given:
            raise ConfigurationError("a log needs at least one channel")
        check_unique([each.name for each in given], "duplicate channel")
        self.start = float(min(each.time[0] for each in given))
        self.channels: Mapping[str, Channel] = {
            each.name: each.shifted(-self.start) if self.start else each for each in given
        }

    @classmethod
    def read(cls, path: str | Path, mapping: str | Path | Mapping[str, Json] | LogMapping) -> Log:
        """Read a table (``.csv``, ``.txt``, ``.npz``).

        Args:
            path: the file.
            mapping: YAML file with the columns of joints and frames, or its keys: ``rnc.logs.LogMapping``.

        Raises:
            ConfigurationError: a file, a column or a number cannot be read; one line says which.
        """
        path, keys = Path(path), LogMapping.of(mapping)
        try:
            return cls(read_table(path, keys)).corrected(keys.corrections)
        except UnicodeDecodeError as error:
            raise ConfigurationError(f"{path}: not a text file: {error.reason} at byte {error.start}") from None
        except OSError as error:
            raise ConfigurationError(f"{path}: {error.strerror or 'cannot be read'}") from None
        except (ArchiveError, RncError) as error:
            raise ConfigurationError(f"{path}: {error}") from None

    @classmethod
    def of_motion(
        cls,
        robot: Robot,
        time: np.ndarray,
        q: np.ndarray,
        v: np.ndarray | None = None,
        efforts: Mapping[str, np.ndarray] | None = None,
        frames: Sequence[str] = (),
    ) -> Log:
        """Return the log of exact sensors on a moving robot, e.g. from ``time``, ``q`` and ``v`` of a ``Trajectory``.

        Args:
            robot: the robot.
            time: times (N,) [s].
            q: configurations (N, nq). Each joint with one value becomes a channel.
            v: velocities (N, nv); None for a log without velocities.
            efforts: efforts (N,) by joint [N m or N].
            frames: names of frames whose poses in the world are measured.

        Raises:
            ModelError: unknown joint or frame.
        """
        # Copies: the caller may change these arrays.
        time, q = np.array(time, dtype=float), np.array(q, dtype=float)
        v = None if v is None else np.array(v, dtype=float)
        channels = []
        for name in robot.single_joint_names:
            joint = robot.single_joint(name)
            # Without jumps by a turn, as an encoder counts.
            position = np.unwrap(joint.position(q)) if joint.continuous else joint.position(q)
            channels.append(Channel("position", name, time, position[:, None]))
            if v is not None:
                channels.append(Channel("velocity", name, time, v[:, joint.idx_v, None]))
        for name, effort in (efforts or {}).items():
            robot.velocity_indices(name)  # an unknown joint is an error
            channels.append(Channel("effort", name, time, np.array(effort, dtype=float)[:, None]))
        # All samples in one call.
        at = Kinematics(robot).position(q)
        for frame in frames:
            place = at.placement(robot.frame_id(frame))
            turned = np.stack([pin.Quaternion(rotation).coeffs() for rotation in place.rotation])
            channels.append(Channel("pose", frame, time, np.hstack([place.translation, turned])))
        return cls(channels)

    def channel(self, quantity: Quantity, of: str) -> Channel:
        """Return one channel.

        Args:
            quantity: "position", "velocity", "effort" or "pose".
            of: name of the joint or frame.

        Raises:
            ConfigurationError: the log has no such channel.
        """
        name = f"{quantity}({of})"
        if name not in self.channels:
            raise ConfigurationError(f"the log has no {name}{nearest(name, self.channels)}")
        return self.channels[name]

    def names(self, quantity: Quantity) -> tuple[str, ...]:
        """Return the joints or frames that a quantity is measured of.

        Args:
            quantity: the quantity.
        """
        return tuple(each.of for each in self.channels.values() if each.quantity == quantity)

    @property
    def duration(self) -> float:
        """Time of the last sample [s]."""
        return float(max(each.time[-1] for each in self.channels.values()))

    def corrected(self, corrections: Mapping[str, Correction]) -> Log:
        """Return the log with corrected joints and clocks.

        Args:
            corrections: corrections by joint or frame, such as ``Calibration.corrections``.

        Raises:
            ConfigurationError: nothing of that name is measured, or a frame has a scale or an offset.

        Example:
            >>> log = rnc.Log([rnc.logs.Channel("position", "wheel", [0.0, 1.0], [[0.0], [2.0]])])
            >>> log.corrected({"wheel": rnc.logs.Correction(scale=1.1, offset=0.5)}).channel("position", "wheel").values
            array([[0.5],
                   [2.7]])
        """
        measured = {each.of for each in self}
        for name, correction in corrections.items():
            if name not in measured:
                raise ConfigurationError(f"corrections.{name}: the log has no such channel{nearest(name, measured)}")
            only_frames = not any(f"{quantity}({name})" in self.channels for quantity in ("position", "velocity"))
            if only_frames and (correction.scale, correction.offset) != (1.0, 0.0):
                raise ConfigurationError(f"corrections.{name}: expected only a delay, '{name}' is no measured joint")
        changed = Log(_corrected(each, corrections.get(each.of)) for each in self)
        # A delay may move the first sample: the new log starts at zero again, and its stamp adds up.
        changed.start += self.start
        return changed

    def __iter__(self) -> Iterator[Channel]:
        return iter(self.channels.values())

    def _summary(self) -> ObjectSummary:
        title = f"Log: {self.duration:.6g} s, {counted(len(self.channels), 'channel')}"
        return ObjectSummary(title, [(each.name, _described(each)) for each in self])


def _corrected(channel: Channel, by: Correction | None) -> Channel:
    if by is None:
        return channel
    values = channel.values
    if channel.quantity in ("position", "velocity"):
        values = by.scale * values + (by.offset if channel.quantity == "position" else 0.0)
    return replace(channel, time=channel.time - by.delay, values=values)


def _described(channel: Channel) -> list[Item]:
    found = [Item(counted(len(channel.time), "sample"), f"{channel.period:.3g} s"), *map(Item, channel.repairs)]
    return [*found, Item(counted(len(channel.gaps), "gap"))] if len(channel.gaps) else found


# ---------------------------------------------------------------------- tables


def unwrapped(counts: Array, span: float, what: str = "encoder") -> Array:
    """Return continuous counts (N,) of a counter that returns to its start after ``span`` counts.

    A step is the shortest of all that agree with the counter: it is less than half the span. The first count keeps its
    value, less the span if that is nearer to zero: an absolute encoder begins within half a turn of its zero.

    Args:
        counts: counts (N,) in the order of time.
        span: number of counts after which the counter returns, e.g. 8192 or ``2**32``.
        what: name of the counter, for messages.

    Raises:
        ConfigurationError: a count is outside the span, or a step is so large that its direction is not known.

    Example:
        >>> rnc.logs.unwrapped(np.array([6.0, 7.0, 1.0, 7.0]), span=8)
        array([-2., -1.,  1., -1.])
    """
    if not len(counts):
        return counts.astype(float)
    low, high = float(np.min(counts)), float(np.max(counts))
    if high - low > span:
        raise ConfigurationError(f"{what}: counts from {low:g} to {high:g} do not wrap after {span:g}")
    continuous = np.unwrap(counts.astype(float), period=span)
    steps = np.diff(continuous)
    most = 0.4  # largest step as a fraction of the range; near one half, its direction is not known
    if len(steps) and np.abs(steps).max() > most * span:
        place = int(np.argmax(np.abs(steps)))
        raise ConfigurationError(
            f"{what}: step {place + 1} is {steps[place]:g} of {span:g} counts, so that its direction is not known; "
            f"expected at most {most:g} of the range between two samples"
        )
    return np.asarray(continuous - span * np.round(continuous[0] / span))


def read_table(path: Path, mapping: LogMapping) -> Iterator[Channel]:
    """Channels of a table. Messages of its errors do not name the file, which the caller knows.

    Args:
        path: the file; an archive if its name ends with .npz, else a text table.
        mapping: columns of joints and frames.

    Raises:
        OSError, UnicodeDecodeError, ArchiveError: the file cannot be read.
        RncError: a column cannot be read.
    """
    groups = (*mapping.joints.values(), *mapping.frames.values())
    chosen = [column for keys in groups for column in _given(keys).values()]
    if not chosen:
        raise ConfigurationError("its mapping names no column of a joint or a frame")
    # Each column once, also one that two channels share.
    places = list(dict.fromkeys([mapping.time.column, *(column.column for column in chosen)]))
    read = _read_archive(path, places) if path.suffix.lower() == ".npz" else _read_text(path, mapping, places)
    numbers = dict(zip(places, read, strict=True))
    return _channels(mapping, numbers[mapping.time.column] * mapping.time.scale + mapping.time.offset, numbers)


def _given(keys: Strict) -> dict[str, ColumnKeys]:
    """Columns that a mapping gives, by key."""
    return {name: column for name, column in keys if column is not None}


def _channels(mapping: LogMapping, time: Array, numbers: Mapping[Place, Array]) -> Iterator[Channel]:
    # Counters are unwrapped in the order of time, and without the samples that have no number.
    order = np.argsort(time, kind="stable")

    def value(column: ColumnKeys, what: str) -> Array:
        found = numbers[column.column].copy()
        if column.wrap is not None:
            whole = order[np.isfinite(found[order])]
            found[whole] = unwrapped(found[whole], column.wrap, f"{what}, column {column.column!r}")
        turn = 1.0 if column.ticks is None else 2.0 * np.pi / column.ticks
        return column.scale * turn * found + column.offset

    def stacked(keys: Strict, names: Sequence[str], what: str) -> Array:
        given = _given(keys)
        zero = np.zeros(len(time))
        return np.stack([value(given[name], f"{what}.{name}") if name in given else zero for name in names], axis=1)

    for joint, columns in mapping.joints.items():
        for quantity, column in _given(columns).items():
            yield Channel(cast(Quantity, quantity), joint, time, value(column, f"{joint}.{quantity}")[:, None])
    pose_keys, quaternion_keys = ("x", "y", "z", "roll", "pitch", "yaw"), ("qx", "qy", "qz", "qw")
    for frame, pose in mapping.frames.items():
        given = _given(pose)
        if any(name in given for name in quaternion_keys):
            missing = [name for name in quaternion_keys if name not in given]
            angles = [name for name in pose_keys[3:] if name in given]
            if missing or angles:
                fault = f"lacks {', '.join(missing)}" if missing else f"has {', '.join(angles)} beside a quaternion"
                raise ConfigurationError(f"frames.{frame}: {fault}")
            values = stacked(pose, (*pose_keys[:3], *quaternion_keys), frame)
        else:
            parts = stacked(pose, pose_keys, frame)
            values = np.hstack([parts[:, :3], Rotation.from_euler("xyz", parts[:, 3:]).as_quat()])
        yield Channel("pose", frame, time, values)


# ---------------------------------------------------------------------- files


def _read_text(path: Path, mapping: LogMapping, places: Sequence[Place]) -> list[Array]:
    # None is any number of blanks.
    separator = {"comma": ",", "semicolon": ";", "tab": "\t", "space": None}[mapping.separator]
    header = any(isinstance(place, str) for place in places) if mapping.header is None else mapping.header
    # Without the byte order mark that spreadsheets write.
    with open_regular(path) as binary, io.TextIOWrapper(binary, encoding="utf-8-sig") as file:
        # Lazily: a table may be larger than the memory that its numbers need.
        lines = (line for line in file if line.strip() and not line.lstrip().startswith(mapping.comment))
        names = [part.strip(' \t\r\n"') for part in next(lines, "").split(separator)] if header else []
        return _numbers(lines, separator, mapping.comment, [_number(place, names) for place in places])


def _number(place: Place, names: Sequence[str]) -> int:
    if isinstance(place, int):
        return place
    if place not in names:
        hint = nearest(place, names) if names else "; the table has no header, give the number of the column"
        raise ConfigurationError(f"no column '{place}'{hint}")
    if names.count(place) > 1:
        raise ConfigurationError(f"{names.count(place)} columns are named '{place}': give the number of one")
    return names.index(place)


def _numbers(lines: Iterator[str], separator: str | None, comment: str, wanted: list[int]) -> list[Array]:
    """Columns of text lines. Empty fields are NaN; only blocks of lines that have some are read slowly."""
    blocks, start = [], 0
    read = partial(np.loadtxt, delimiter=separator, comments=comment, usecols=wanted, ndmin=2, quotechar='"')
    # Blocks, so that one empty field does not make the whole table slow.
    while block := list(itertools.islice(lines, 100_000)):
        try:
            blocks.append(read(block))
        except ValueError:
            try:
                blocks.append(read(block, converters=_field))
            except ValueError as error:
                raise ConfigurationError(_explained(str(error), start)) from None
        start += len(block)
    if not blocks:
        raise ConfigurationError("has no lines with numbers")
    return list(np.concatenate(blocks).T)


def _field(text: str) -> float:
    stripped = text.strip()
    # Words of spreadsheets, databases and NumPy for no number.
    missing = ("", "na", "n/a", "null", "none", "nan", "-nan")
    return np.nan if stripped.lower() in missing else float(stripped)


def _explained(message: str, start: int) -> str:
    """Message of NumPy with the line of the table instead of the line of a block."""
    counted = re.search(r"at row (\d+)", message)
    if counted:
        first = 0 if "column index" in message or "number of columns" in message else 1  # NumPy counts both ways
        message = message.replace(counted[0], f"at data line {start + int(counted[1]) + first}")
    return message.split("; use `usecols`")[0].rstrip(".")


def _read_archive(path: Path, places: Sequence[Place]) -> list[Array]:
    """Columns of an archive: a vector by its name, column k of a matrix by ``name[k]``."""
    parts = [re.fullmatch(r"(.+?)(?:\[(\d+)\])?", str(place)) for place in places]
    names = [part[1] for part in parts if part]
    largest = 16 * 2**30  # size limit of the arrays of an archive [bytes]
    arrays = read_npz(path, names, largest=largest)
    columns = []
    for place, part in zip(places, parts, strict=True):
        if part is None or part[1] not in arrays:
            raise ConfigurationError(f"no array '{place}'")
        array, index = arrays[part[1]], part[2]
        fits = array.ndim == 1 if index is None else array.ndim == 2 and int(index) < array.shape[1]
        if not fits:
            expected = "a vector, or name[k] for column k of a matrix"
            raise ConfigurationError(f"'{place}' has shape {array.shape}, expected {expected}")
        columns.append(_floats(str(place), array if index is None else array[:, int(index)]))
    if len({len(column) for column in columns}) > 1:
        raise ConfigurationError(f"columns of {sorted({len(column) for column in columns})} rows")
    return columns


def _floats(name: str, column: Array) -> Array:
    try:
        return np.asarray(column, dtype=float)
    except (TypeError, ValueError):
        raise ConfigurationError(f"column '{name}' has no numbers, found {column.dtype}") from None
