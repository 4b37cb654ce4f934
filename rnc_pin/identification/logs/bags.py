"""ROS 1 and ROS 2 bags and MCAP files, read by ``rosbags`` (extra ``logs``), without ROS."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple, Protocol, TypeAlias

import numpy as np

from rnc_pin.errors import ConfigurationError, nearest
from rnc_pin.extras import check_extra
from rnc_pin.identification.logs.channel import Channel, LogMapping, Quantity, Topic

SUFFIXES = (".bag", ".mcap", ".db3")
_Name = tuple[Quantity, str]


class _Samples(NamedTuple):
    """Stamps [ns] and values of one channel."""

    stamps: list[int]
    values: list[list[float]]


_Store = defaultdict[_Name, _Samples]


def is_bag(path: Path) -> bool:
    """True for the file of a bag, and for the folder of a ROS 2 bag."""
    return path.suffix.lower() in SUFFIXES or (path / "metadata.yaml").is_file()


def read_bag(path: Path, mapping: LogMapping) -> list[Channel]:
    """Channels of a bag. Its stamps are integers; the channels have seconds since the first one.

    Raises:
        ConfigurationError: ``rosbags`` is not installed, the file is broken, or a topic or its use does not fit.
    """
    check_extra("logs", str(path))
    from rosbags.highlevel import AnyReader, AnyReaderError
    from rosbags.typesys import Stores, get_typestore

    if not mapping.topics:
        raise ConfigurationError(f"{path}: its mapping names no topic")
    samples: _Store = defaultdict(lambda: _Samples([], []))
    try:
        with ExitStack() as stack:
            # The types of a bag without definitions are those of ROS 2, which have not changed since.
            reader = stack.enter_context(AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)))
            there = {connection.topic: connection.msgtype for connection in reader.connections}
            uses = {topic: _use(path, topic, use, there) for topic, use in mapping.topics.items()}
            chosen = [connection for connection in reader.connections if connection.topic in uses]
            for connection, stamp, raw in reader.messages(connections=chosen):
                uses[connection.topic](samples, reader.deserialize(raw, connection.msgtype), stamp)
    except ConfigurationError:
        raise
    except FileNotFoundError:
        raise ConfigurationError(f"{path}: No such file or directory") from None
    except AnyReaderError as error:
        raise ConfigurationError(f"{path}: cannot be read as a bag: {error}") from None
    except Exception as error:  # sqlite3, zstandard and struct raise various exceptions on broken files
        raise ConfigurationError(f"{path}: broken bag: {type(error).__name__}: {error}") from None
    if not samples:
        raise ConfigurationError(f"{path}: no message of {', '.join(uses)} has a value that the mapping uses")
    start = min(min(each.stamps) for each in samples.values())
    return [
        Channel(quantity, of, np.array([stamp - start for stamp in each.stamps]) * 1e-9, np.array(each.values))
        for (quantity, of), each in samples.items()
    ]


class _Vector(Protocol):
    x: float
    y: float
    z: float


class _Quaternion(_Vector, Protocol):
    w: float


_Message: TypeAlias = Any  # of a class that rosbags makes at run time, from the definitions in the bag
_Take = Callable[[_Store, _Message, int], None]


def _use(path: Path, topic: str, use: Topic, there: Mapping[str, str]) -> _Take:
    """Function that takes the samples of a message of a topic, with its time of recording [ns]."""
    if topic not in there:
        raise ConfigurationError(f"{path}: no topic '{topic}'{nearest(topic, there)}")
    kind = there[topic].rpartition("/")[2]
    if kind not in _KINDS:
        raise ConfigurationError(f"{path}: topic '{topic}' has messages {there[topic]}{nearest(kind, _KINDS)}")
    keys, take = _KINDS[kind]
    given = [key for key in ("joints", "pose", "frames") if getattr(use, key) is not None]
    wrong = [key for key in given if key not in keys]
    if wrong or not given:
        found = f"found {', '.join(wrong)}" if wrong else "found none"
        raise ConfigurationError(f"{path}: topic '{topic}' with {kind}: expected {' or '.join(keys)}, {found}")

    def taken(samples: _Store, message: _Message, recorded: int) -> None:
        header = None if use.stamp == "bag" else getattr(message, "header", None)
        take(samples, message, recorded if header is None else _nanoseconds(header), use)

    return taken


def _nanoseconds(header: _Message) -> int:
    return int(header.stamp.sec) * 1_000_000_000 + int(header.stamp.nanosec)


def _add(samples: _Store, name: _Name, stamp: int, values: list[float]) -> None:
    found = samples[name]
    found.stamps.append(stamp)
    found.values.append(values)


def _xyz(vector: _Vector) -> list[float]:
    return [vector.x, vector.y, vector.z]


def _pose(position: _Vector, turned: _Quaternion) -> list[float]:
    return [*_xyz(position), turned.x, turned.y, turned.z, turned.w]


def _take_joints(samples: _Store, message: _Message, stamp: int, use: Topic) -> None:
    quantities: tuple[tuple[Quantity, Sequence[float]], ...] = (
        ("position", message.position),
        ("velocity", message.velocity),
        ("effort", message.effort),
    )
    for quantity, numbers in quantities:
        for name, number in zip(message.name, numbers, strict=False):  # empty if it is not measured
            joint = name if use.joints == "all" else (use.joints or {}).get(name)
            if joint is not None:
                _add(samples, (quantity, joint), stamp, [float(number)])


def _take_pose(samples: _Store, message: _Message, stamp: int, use: Topic) -> None:
    pose = getattr(message.pose, "pose", message.pose)  # with a covariance around it, or without
    _add(samples, ("pose", str(use.pose)), stamp, _pose(pose.position, pose.orientation))


def _take_frames(samples: _Store, message: _Message, stamp: int, use: Topic) -> None:
    for each in message.transforms:
        frame = (use.frames or {}).get(each.child_frame_id.lstrip("/"))
        parent = each.header.frame_id.lstrip("/")
        if frame is None or (use.parent is not None and parent != use.parent):
            continue
        place = _pose(each.transform.translation, each.transform.rotation)
        _add(samples, ("pose", frame), stamp if use.stamp == "bag" else _nanoseconds(each.header), place)


_KINDS: dict[str, tuple[tuple[str, ...], Callable[[_Store, _Message, int, Topic], None]]] = {
    "JointState": (("joints",), _take_joints),
    "Odometry": (("pose",), _take_pose),
    "PoseStamped": (("pose",), _take_pose),
    "PoseWithCovarianceStamped": (("pose",), _take_pose),
    "TFMessage": (("frames",), _take_frames),
}
