"""Description of a robot file before Pinocchio reads it, checks of its numbers, and the files that it may name.

Every reader checks a file that a description names before it opens it, after symbolic links are resolved. Otherwise a
description from an untrusted source could name any file of the computer. The content of that file would appear in a
draft, a picture or an error.
"""

from __future__ import annotations

import os
import re
import stat
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import islice
from pathlib import Path
from types import ModuleType
from typing import Literal, NamedTuple
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from rnc_pin.errors import ModelError, nearest
from rnc_pin.io.safe_read import parse_tree, read_bytes

ROOT_JOINTS: Mapping[str, Callable[[], object] | None] = {
    "fixed": None,
    "planar": pin.JointModelPlanar,
    "free": pin.JointModelFreeFlyer,
}


def check_base(base: object) -> None:
    """Raise an error if a base is none of ``ROOT_JOINTS``.

    Args:
        base: base that the user gave.

    Raises:
        ModelError: unknown base.
    """
    if not isinstance(base, str) or base not in ROOT_JOINTS:
        raise ModelError(f"base '{base}' is not known{nearest(str(base), ROOT_JOINTS)}")


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
        lost: function for the names of the meshes that ``geometry`` of a kind left out, by link.
        mimics: mimic joints of the file.
        bodies: links of a URDF, which can be given masses.
        packages: name to folder of the packages that the file names and that were found.
        far_packages: ``packages`` that were found only by the environment or the given folders.
        folders: folders whose files the description may name, absolute and without symbolic links.
        closures: kinematic loops of an MJCF.
        references: values of the joints of an MJCF in the configuration that the file draws, its ``ref`` [rad or m].
    """

    model: pin.Model
    geometry: Callable[[str], pin.GeometryModel]
    lost: Callable[[str], Mapping[str, tuple[str, ...]]] | None = None
    mimics: tuple[Mimic, ...] = ()
    bodies: Mapping[str, Body] = field(default_factory=dict)
    packages: Mapping[str, Path] = field(default_factory=dict)
    far_packages: Mapping[str, Path] = field(default_factory=dict)
    folders: tuple[Path, ...] = ()
    closures: tuple[Closure, ...] = ()
    references: Mapping[str, float] = field(default_factory=dict)


_DECLARATION = re.compile(rb"<\?xml[^>]*\?>")


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
    try:
        return parse_tree(content)
    except ModelError as error:
        raise ModelError(f"{path}: {error}") from None
    except (ElementTree.ParseError, ValueError, LookupError) as error:  # also for an unknown encoding
        again = _again(content, error)
        if again is not None:
            return again
        raise ModelError(f"{path}: not well-formed XML: {error}") from None


def _again(content: bytes, error: Exception) -> ElementTree.Element | None:
    if not isinstance(error, ElementTree.ParseError):
        return None
    blank = b" \t\r\n\0"
    # A declaration of the wrong encoding is dropped; Latin-1 reads any byte, so it comes last.
    bare = _DECLARATION.sub(b"", content.strip(blank), count=1)
    for encoding in ("utf-8", "latin-1"):
        try:
            return parse_tree(bare.decode(encoding))
        except (ElementTree.ParseError, ValueError):
            continue
    return None


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
    mujoco.set_mju_user_warning(_ignore)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(before)


def _ignore(message: str) -> None:
    """Ignore a warning: states and models are checked after every step, with own error messages."""


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


def check_not_negative(values: Mapping[str, float | None], owner: str, prefix: str = "") -> None:
    """Raise an error if a quantity that has no sign is negative.

    Args:
        values: quantity to value; None if the file does not give it.
        owner: joint or link, for the message.
        prefix: start of the message.

    Raises:
        ModelError: a value is negative.
    """
    for quantity, value in values.items():
        if value is not None and value < 0:
            raise ModelError(f"{prefix}{quantity} of {owner} is negative: {value:g}")


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


# ---------------------------------------------------------------------- files that a description may name


REMEDY = "give its folder in package_dirs (--package-dir) if you trust the description with it"
_DATA = (
    *("assets", "collision", "collisions", "common", "dae", "materials", "media", "mesh", "meshes", "mjcf", "obj"),
    *("robots", "stl", "stls", "textures", "urdf", "urdfs", "visual", "visuals", "xacro"),
)
"""Customary names of folders beside the folder of a description without a package."""


class AllowedFolders:
    """Folders whose files a description may name.

    These are its own folder, its ROS package, and the added folders. A description without a package may also use
    folders beside its own with customary names, such as ``../meshes``.

    Args:
        beside: folder of the description.
        given: folders that the user allows.
    """

    def __init__(self, beside: Path, given: Iterable[Path] = ()) -> None:
        own, *above = folders_above(beside.resolve())
        self._folders = [own, *(folder.resolve() for folder in given)]
        package = next((folder for folder in (own, *above) if package_name(folder) is not None), None)
        if package is not None:
            self._folders.append(package)
        elif above:
            self._folders += [above[0] / name for name in _DATA]

    @property
    def folders(self) -> tuple[Path, ...]:
        """Absolute paths without symbolic links."""
        return tuple(dict.fromkeys(self._folders))

    def add(self, path: Path) -> None:
        """Allow an additional folder, or a single file.

        Args:
            path: folder or file.
        """
        self._folders.append(path.resolve())

    def has(self, file: Path) -> bool:
        """True if a description may name this file.

        Args:
            file: any path.
        """
        return is_below(file, self._folders)

    def admit(self, file: Path, what: str) -> Path:
        """Return the absolute path of a file, without symbolic links.

        Args:
            file: path as in the description.
            what: name of the file in messages.

        Raises:
            ModelError: the file is in none of the folders.
        """
        if not self.has(file):
            raise ModelError(f"{what} is outside the folders of the description: {REMEDY}")
        return file.resolve()


def is_below(file: Path, folders: Iterable[Path]) -> bool:
    """True if a file is in one of these folders or below, after symbolic links are resolved.

    Args:
        file: any path.
        folders: absolute paths without symbolic links; one may be the file itself.
    """
    try:
        found = file.resolve()
    except (OSError, RuntimeError, ValueError):  # circular links, or an invalid file name
        return False
    return any(found.is_relative_to(folder) for folder in folders)


def folders_above(folder: Path) -> Iterator[Path]:
    """Yield a folder and the folders above it that can belong to the same project, the nearest first.

    The search stops before the root of the file system, the home directory or a folder above it, another file system,
    and a folder where all users may write.

    Args:
        folder: absolute path without symbolic links.
    """
    yield folder
    home = Path(os.path.expanduser("~")).resolve()
    levels = 8  # folders above: in ROS a package is a few folders above its description
    try:
        device = folder.stat().st_dev
        for above in islice(folder.parents, levels):
            status = above.stat()
            # Anybody could put a package.xml in /tmp, and so open files beside it to a description.
            shared = status.st_mode & stat.S_ISVTX and status.st_mode & stat.S_IWOTH
            if above == Path(above.anchor) or home.is_relative_to(above) or shared or status.st_dev != device:
                return
            yield above
    except OSError:
        return


@lru_cache(maxsize=1024)
def package_name(folder: Path) -> str | None:
    """Name in the ``package.xml`` of a folder, or None if the folder is no ROS package.

    Args:
        folder: any folder.
    """
    largest = 2**20  # [bytes]: a manifest is a page of text
    try:
        root = parse_tree(read_bytes(folder / "package.xml", largest))
    except (OSError, ModelError, SyntaxError, ValueError, LookupError):  # XML errors are SyntaxErrors
        return None
    return (root.findtext("name") or "").strip() if root.tag == "package" else None


# ---------------------------------------------------------------------- packages


_FOUND = re.compile(r"(?:file://)?\$\(find\s+([^\s()]+)\s*\)/*")


def package_uri(name: str) -> str:
    """Return ``package://name/path`` for a file name ``$(find name)/path``, as xacro has it; others do not change.

    Args:
        name: name of a file in a description.
    """
    return _FOUND.sub(r"package://\1/", name, count=1) if _FOUND.match(name) else name


class Packages(AllowedFolders):
    """Search for ROS packages by name, and the folders whose files the description may name.

    The search order is: the given folders (a folder of packages, or a package itself), the environment variables
    ``ROS_PACKAGE_PATH`` and ``AMENT_PREFIX_PATH``, then the file's own folder and those above (``folders_above``). A
    folder there matches if it is the package, by its name or its ``package.xml``, or if it contains the package. Of
    these, only a folder with a ``package.xml`` is allowed as a whole.

    Args:
        beside: folder of the file that names packages.
        given: folders given by the user.
    """

    def __init__(self, beside: Path, given: Iterable[str | Path] = ()) -> None:
        self._beside = beside.resolve()
        self._given = [Path(folder).expanduser().resolve() for folder in given]
        self._found: dict[str, Path] = {}
        self._known: dict[str, list[Path]] = {}  # candidates by name: a robot has dozens of meshes in one package
        super().__init__(self._beside, self._given)

    def candidates(self, name: str) -> Iterator[Path]:
        """Yield the folders that can be this package, the most likely first.

        Args:
            name: name of the package.
        """
        # A package with a path as its name would lead out of the allowed folders.
        if name in ("", "..") or Path(name).name != name:
            return
        for folder in self._given:
            yield from _at(folder, name)
        prefixes = (prefix / "share" for prefix in _environment("AMENT_PREFIX_PATH"))
        for folder in (*_environment("ROS_PACKAGE_PATH"), *prefixes):
            for package in _at(folder, name):
                self.add(package)
                yield package
        yield from self._near(name)

    def folder(self, name: str) -> Path | None:
        """Return the folder of a package, or None.

        Args:
            name: name of the package.
        """
        return self._recorded(name, self.candidates(name))

    @property
    def found(self) -> Mapping[str, Path]:
        """Name to folder of each package that was requested and found."""
        return dict(self._found)

    @property
    def far(self) -> Mapping[str, Path]:
        """Those of ``found`` that a search only in the folders above the file does not find, or finds elsewhere."""
        return {name: folder for name, folder in self._found.items() if next(self._near(name), None) != folder}

    def _near(self, name: str) -> Iterator[Path]:
        for folder in folders_above(self._beside):
            for package in _at(folder, name):
                # A link to a folder elsewhere would otherwise open that folder by its own package.xml.
                if package_name(package) is not None and package.resolve().is_relative_to(folder):
                    self.add(package)
                yield package

    def _recorded(self, name: str, candidates: Iterable[Path]) -> Path | None:
        folder = next(iter(candidates), None)
        if folder is not None:
            self._found.setdefault(name, folder)
        return folder

    def file(self, uri: str) -> Path | None:
        """Return the file of ``package://name/path``, ``file://path`` or a relative path, or None.

        Args:
            uri: name of a file in a description.

        Raises:
            ModelError: the file exists, but not in a folder whose files the description may name.
        """
        scheme, separator, rest = uri.partition("://")
        if separator and scheme in ("package", "model"):
            name, _, inside = rest.partition("/")
            if name not in self._known:
                self._known[name] = list(self.candidates(name))
            candidates = self._known[name]
            having = [each for each in candidates if os.path.isfile(each / inside)]
            # A stable sort: allowed folders first, each group in the order of the search.
            having.sort(key=lambda each: not self.has(each / inside))
            self._recorded(name, [*having, *candidates])
            return self.admit(having[0] / inside, f"file '{uri}'") if having else None
        # http and other schemes are never fetched.
        if separator and scheme != "file":
            return None
        path = Path(rest if separator else uri)
        places = [folder / path for folder in (self._beside, *self._given)]
        place = next((place for place in places if os.path.isfile(place)), None)
        return None if place is None else self.admit(place, f"file '{uri}'")


def _environment(variable: str) -> list[Path]:
    return [Path(each) for each in os.environ.get(variable, "").split(os.pathsep) if each]


def _at(folder: Path, name: str) -> Iterator[Path]:
    if (folder.name == name or package_name(folder) == name) and os.path.isdir(folder):
        yield folder
    if os.path.isdir(folder / name):  # unlike Path.is_dir, False for an invalid file name
        yield folder / name
