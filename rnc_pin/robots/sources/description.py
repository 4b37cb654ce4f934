"""Description of a robot file before Pinocchio reads it, and checks of its numbers."""

from __future__ import annotations

import os
import re
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Literal, NamedTuple
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from rnc_pin.errors import ModelError
from rnc_pin.io.safe_read import parse_tree, read_bytes

ROOT_JOINTS: Mapping[str, Callable[[], object] | None] = {
    "fixed": None,
    "planar": pin.JointModelPlanar,
    "free": pin.JointModelFreeFlyer,
}


class Mimic(NamedTuple):
    """Mimic joint of a file: ``q = multiplier q_of + offset``."""

    joint: str
    of: str
    multiplier: float
    offset: float


class Closure(NamedTuple):
    """Two frames that the file connects; ``LoopClosure`` has the same fields.

    Attributes:
        frame_a: name of the first frame.
        frame_b: name of the second frame.
        kind: "frame" or "point".
        offset_a: point in frame a [m].
        offset_b: point in frame b [m].
        rpy: orientation of frame b in frame a [rad].
    """

    frame_a: str
    frame_b: str
    kind: Literal["frame", "point"]
    offset_a: tuple[float, float, float]
    offset_b: tuple[float, float, float]
    rpy: tuple[float, float, float]


class Body(NamedTuple):
    """Single link as in the file.

    Attributes:
        mass: [kg].
        inertia: rotational inertia (3, 3) [kg m^2].
        shaped: True if the link has geometry.
        volume: function for the volume of the box around the geometry [m^3]. It reads meshes: call it only if needed.
    """

    mass: float
    inertia: np.ndarray
    shaped: bool
    volume: Callable[[], float]


@dataclass(frozen=True)
class Description:
    """Content of a description file.

    Attributes:
        model: the model; mimic joints are independent joints of it.
        geometry: function that loads the geometry of a kind, "visual" or "collision", with its meshes.
        lost: kind of geometry to the names of the meshes that ``geometry`` left out, by link.
        mimics: mimic joints of the file.
        bodies: links of a URDF, which can be given masses.
        packages: name to folder of the packages that the file names and that were found.
        folders: folders whose files the description may name, absolute and without symbolic links.
        closures: kinematic loops of an MJCF.
        references: values of the joints of an MJCF in the configuration that the file draws, its ``ref`` [rad or m].
    """

    model: pin.Model
    geometry: Callable[[str], pin.GeometryModel]
    lost: Mapping[str, Mapping[str, tuple[str, ...]]] = field(default_factory=dict)
    mimics: tuple[Mimic, ...] = ()
    bodies: Mapping[str, Body] = field(default_factory=dict)
    packages: Mapping[str, Path] = field(default_factory=dict)
    folders: tuple[Path, ...] = ()
    closures: tuple[Closure, ...] = ()
    references: Mapping[str, float] = field(default_factory=dict)


def parse_xml(path: Path) -> ElementTree.Element:
    """Return the root element of a file.

    Text before the XML declaration, null bytes at the end, and Latin-1 characters in a file declared as UTF-8 are
    tolerated.

    Args:
        path: path of the file.

    Raises:
        ModelError: the file cannot be read, or is not XML.
    """
    try:
        content = read_bytes(path)
    except OSError as error:
        raise ModelError(f"{path}: cannot be read: {error.strerror}") from None
    # A declaration of the wrong encoding is dropped; Latin-1 reads any byte, so it comes last.
    bare = re.sub(rb"<\?xml[^>]*\?>", b"", content.strip(b" \t\r\n\0"), count=1)
    failure: Exception | None = None
    for attempt in (lambda: content, lambda: bare.decode("utf-8"), lambda: bare.decode("latin-1")):
        try:
            return parse_tree(attempt())
        except ModelError as error:
            raise ModelError(f"{path}: {error}") from None
        except (ElementTree.ParseError, ValueError, LookupError) as error:  # also for an unknown encoding
            failure = failure or error  # the first is of the file as it stands
    raise ModelError(f"{path}: not well-formed XML: {failure}")


def brief(error: Exception) -> str:
    """Text of a C++ exception, without its location in Pinocchio's sources.

    Args:
        error: exception of Pinocchio or MuJoCo.
    """
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    place = ("From file:", "in function:", "at line:")
    kept = [line.removeprefix("message:").strip() for line in lines if not line.startswith(place)]
    return " ".join(line for line in kept if line) or type(error).__name__


@contextmanager
def captured_stderr() -> Iterator[list[str]]:
    """Collect what C++ code prints on file descriptor 2, where urdfdom reports errors."""
    lines: list[str] = []
    # Python's own buffer would otherwise be written to the sink, or after the C++ text.
    sys.stderr.flush()
    # urdfdom writes to the descriptor, not to sys.stderr: only a duplicate of the descriptor catches it.
    saved = os.dup(2)
    with tempfile.TemporaryFile() as sink:
        os.dup2(sink.fileno(), 2)
        try:
            yield lines
        finally:
            os.dup2(saved, 2)
            os.close(saved)
            sink.seek(0)
            lines += sink.read().decode(errors="replace").splitlines()


@contextmanager
def unlogged(mujoco: ModuleType) -> Iterator[None]:
    """Prevent MuJoCo from writing MUJOCO_LOG.TXT to the working directory; important faults raise errors here.

    Args:
        mujoco: the module, which only callers that have it can import.
    """
    before = mujoco.get_mju_user_warning()
    # States and models are checked after every step, with messages of this package.
    mujoco.set_mju_user_warning(lambda message: None)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(before)


def read_numbers(text: str | None, count: int | None = None) -> np.ndarray | None:
    """Return the numbers in an attribute, or None if a word is not a finite number.

    Only whitespace, digits and words that parsers in C accept are valid; Python accepts more.

    Args:
        text: the attribute; None if it is missing.
        count: required number of numbers; None for any.
    """
    # float() takes 1_000 and digits of other scripts, which urdfdom and MuJoCo refuse or cut.
    if text is None or not text.isascii() or "_" in text:
        return None
    try:
        numbers = np.array([float(word) for word in text.split()])
    except ValueError:
        return None
    return numbers if np.isfinite(numbers).all() and count in (None, numbers.size) else None


def read_number(text: str | None) -> float | None:
    """Return the single number in an attribute, or None if it does not hold exactly one number.

    Args:
        text: the attribute; None if it is missing.
    """
    numbers = read_numbers(text, 1)
    return None if numbers is None else float(numbers[0])


def check_numbers(text: str | None, counts: tuple[int, ...], what: str) -> np.ndarray:
    """Return the numbers in an attribute.

    Args:
        text: the attribute; None if it is missing.
        counts: valid numbers of numbers, in ascending order.
        what: element and attribute, for the message.

    Raises:
        ModelError: a word is not a finite number, or there are too many or too few.
    """
    numbers = read_numbers(text)
    if numbers is None or numbers.size not in counts:
        few = " or ".join(map(str, counts)) if len(counts) < 3 else f"{counts[0]} to {counts[-1]}"
        words = "a finite number" if counts == (1,) else f"{few} finite numbers"
        raise ModelError(f"{what} takes {words}, found '{text}'")
    return numbers


def check_not_negative(values: Mapping[str, float | None], owner: str) -> None:
    """Raise an error if a quantity that has no sign is negative.

    Args:
        values: quantity to value; None if the file does not give it.
        owner: joint or link, for the message.

    Raises:
        ModelError: a value is negative.
    """
    for quantity, value in values.items():
        if value is not None and value < 0:
            raise ModelError(f"{quantity} of {owner} is negative: {value:g}")


def check_acceleration(gravity: object) -> np.ndarray:
    """Return the acceleration of gravity (3,) [m/s^2].

    Args:
        gravity: acceleration that the user gave.

    Raises:
        ModelError: not three finite numbers.
    """
    try:
        acceleration = np.asarray(gravity, dtype=float)
    except (TypeError, ValueError):
        acceleration = np.empty(0)
    if acceleration.shape != (3,) or not np.isfinite(acceleration).all():
        raise ModelError(f"gravity has to be three finite numbers [m/s^2], found {gravity!r}")
    return acceleration
