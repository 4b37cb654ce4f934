"""Measured log of a robot: channels of joints and frames, each with its own time stamps."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
import pinocchio as pin

from rnc_pin.errors import ConfigurationError, InputError, nearest
from rnc_pin.io.json import Json
from rnc_pin.lab.logs.channel import Channel, Correction, LogMapping, Quantity
from rnc_pin.lab.logs.tables import read_table
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
        names = [each.name for each in given]
        for name in names:
            if names.count(name) > 1:
                raise ConfigurationError(f"duplicate channel '{name}'")
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
        except InputError as error:
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
        time, q, model = np.array(time, dtype=float), np.array(q, dtype=float), robot.model
        v = None if v is None else np.array(v, dtype=float)
        channels = []
        for name in robot.joint_names:
            joint = model.joints[model.getJointId(name)]
            if joint.nv == 1:
                entries = q[:, joint.idx_q : joint.idx_q + joint.nq]
                angle = entries if joint.nq == 1 else np.unwrap(np.arctan2(entries[:, 1], entries[:, 0]))[:, None]
                channels.append(Channel("position", name, time, angle))
                if v is not None:
                    channels.append(Channel("velocity", name, time, v[:, joint.idx_v : joint.idx_v + 1]))
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
    return Channel(channel.quantity, channel.of, channel.time - by.delay, values, channel.repairs)


def _described(channel: Channel) -> list[Item]:
    gaps = len(channel.gaps)
    notes = [*channel.repairs, *([counted(gaps, "gap")] if gaps else [])]
    return [Item(counted(len(channel.time), "sample"), f"{channel.period:.3g} s"), *map(Item, notes)]
