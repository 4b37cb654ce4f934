"""What a file describes: a model, its geometry on demand, and couplings that the model does not have."""

from __future__ import annotations

import os
import re
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, NamedTuple
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from rnc_pin.errors import ModelError
from rnc_pin.regular_files import read_bytes

GEOMETRY = {"visual": pin.GeometryType.VISUAL, "collision": pin.GeometryType.COLLISION}
ROOT_JOINTS: Mapping[str, Callable[[], object] | None] = {
    "fixed": None,
    "planar": pin.JointModelPlanar,
    "free": pin.JointModelFreeFlyer,
}


class Mimic(NamedTuple):
    """A joint that the file says to follow another: ``q = multiplier q_of + offset``."""

    joint: str
    of: str
    multiplier: float
    offset: float


class Closure(NamedTuple):
    """Two frames that the file keeps together; the fields are those of ``LoopClosure``.

    Attributes:
        frame_a: name of a frame.
        frame_b: name of the frame that stays on it.
        kind: "frame" or "point".
        offset_a: the point of frame a, in its own axes [m].
        offset_b: the point of frame b, in its own axes [m].
        rpy: orientation of frame b seen from frame a [rad].
    """

    frame_a: str
    frame_b: str
    kind: Literal["frame", "point"]
    offset_a: tuple[float, float, float]
    offset_b: tuple[float, float, float]
    rpy: tuple[float, float, float]


class Body(NamedTuple):
    """A link by itself, as the file has it.

    Attributes:
        mass: [kg].
        inertia: rotational, (3, 3) [kg m^2].
        shaped: whether it has geometry.
        volume: gives that of the box around it [m^3]; reads meshes, so it is asked only where a mass is wanted.
    """

    mass: float
    inertia: np.ndarray
    shaped: bool
    volume: Callable[[], float]


@dataclass(frozen=True)
class Description:
    """A file, read.

    Attributes:
        model: the model; joints that mimic others are joints of their own in it.
        geometry: makes the geometry of a kind, "visual" or "collision"; meshes are read by it.
        mimics: the couplings that the file asks for.
        bodies: of a URDF its links, which can be given masses.
        packages: name to folder of the packages that the file names and that were found.
        far_packages: those of them that only the environment or the folders given lead to.
        folders: whose files it may name, absolute and without links.
        closures: the loops that an MJCF closes.
    """

    model: pin.Model
    geometry: Callable[[str], pin.GeometryModel]
    mimics: tuple[Mimic, ...] = ()
    bodies: Mapping[str, Body] = field(default_factory=dict)
    packages: Mapping[str, Path] = field(default_factory=dict)
    far_packages: Mapping[str, Path] = field(default_factory=dict)
    folders: tuple[Path, ...] = ()
    closures: tuple[Closure, ...] = ()


_DECLARATION = re.compile(rb"<\?xml[^>]*\?>")
_DEEPEST = 400  # of MJCF, whose bodies are inside one another
_MOST = 1_000_000  # elements: one takes more memory than its letters
_BLANK = b" \t\r\n\0"


def parse_xml(path: Path) -> ElementTree.Element:
    """The outermost element of a file.

    What stands before an XML declaration, zeros at the end and letters of Latin-1 in a file that says UTF-8 are passed
    over.

    Raises:
        ModelError: cannot be read, or is not XML.
    """
    try:
        content = read_bytes(path)
    except OSError as error:
        raise ModelError(f"{path}: cannot be read: {error.strerror}") from None
    try:
        return parse_tree(content)
    except ModelError as error:
        raise ModelError(f"{path}: {error}") from None
    except (ElementTree.ParseError, ValueError, LookupError) as error:  # an encoding that nobody knows among them
        again = _again(content, error)
        if again is not None:
            return again
        raise ModelError(f"{path}: not well-formed XML: {error}") from None


class _Shallow(ElementTree.TreeBuilder):
    """Refuses what is nested so deep that whatever walks through it would break, and what is too much."""

    depth = count = 0

    def start(self, tag: str, attrs: dict[str, str]) -> ElementTree.Element:
        self.depth += 1
        self.count += 1
        if self.depth > _DEEPEST or self.count > _MOST:
            raise ModelError(f"elements are more than {_DEEPEST} deep, or more than {_MOST:,}")
        return super().start(tag, attrs)

    def end(self, tag: str) -> ElementTree.Element:
        self.depth -= 1
        return super().end(tag)


def parse_tree(content: str | bytes) -> ElementTree.Element:
    """The outermost element of a text, without entities of other files.

    Raises:
        ModelError: elements are too deep, or too many.
        xml.etree.ElementTree.ParseError: not well formed.
    """
    return ElementTree.fromstring(content, ElementTree.XMLParser(target=_Shallow()))


def _again(content: bytes, error: Exception) -> ElementTree.Element | None:
    if not isinstance(error, ElementTree.ParseError):
        return None
    bare = _DECLARATION.sub(b"", content.strip(_BLANK), count=1)
    for encoding in ("utf-8", "latin-1"):
        try:
            return parse_tree(bare.decode(encoding))
        except (ElementTree.ParseError, ValueError):
            continue
    return None


def read_numbers(text: str) -> np.ndarray | None:
    """The numbers in an attribute, or None where a word is not a finite number.

    Blanks, digits and words of other kinds than those of C are refused: Python takes them, parsers in C do not.
    """
    if not text.isascii() or "_" in text:
        return None
    try:
        numbers = np.array([float(word) for word in text.split()])
    except ValueError:
        return None
    return numbers if np.isfinite(numbers).all() else None


def read_number(text: str | None) -> float | None:
    """The one number in an attribute, or None where there is none, or something else."""
    numbers = read_numbers(text or "")
    return float(numbers[0]) if numbers is not None and numbers.size == 1 else None


def brief(error: Exception) -> str:
    """What a C++ exception says, without where in Pinocchio's sources it was thrown."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    place = ("From file:", "in function:", "at line:")
    kept = [line.removeprefix("message:").strip() for line in lines if not line.startswith(place)]
    return " ".join(line for line in kept if line) or type(error).__name__


@contextmanager
def geometry_errors(path: Path) -> Iterator[None]:
    """Turn whatever loading geometry throws into one line."""
    try:
        with captured_stderr():
            yield
    except Exception as error:  # Boost.Python raises whatever the C++ side threw
        raise ModelError(f"{path}: geometry cannot be loaded: {brief(error)}") from None


@contextmanager
def captured_stderr() -> Iterator[list[str]]:
    """Collect what C++ code prints on file descriptor 2: urdfdom says there what it refuses."""
    lines: list[str] = []
    sys.stderr.flush()
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
