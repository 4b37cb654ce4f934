"""Files of robots: where descriptions are, shipped with rnc_pin or in example-robot-data."""

from __future__ import annotations

import os
from functools import cache
from pathlib import Path

from rnc_pin.errors import ModelError, nearest


def shipped_directory() -> Path:
    """Folder of the URDFs shipped with rnc_pin (in a wheel, or in a checkout)."""
    package = Path(__file__).resolve().parents[1]
    inside = package / "urdf"
    return inside if inside.is_dir() else package.parent / "urdf"


def find_urdf(path: str | Path, beside: Path | None = None) -> Path:
    """Return the path of a URDF: absolute, relative to ``beside``, or the name of a shipped one.

    Args:
        path: absolute or relative path, or the name of a shipped file.
        beside: folder that a relative path refers to; the working directory by default.

    Raises:
        ModelError: no such file; the message names the nearest shipped one.
    """
    path = Path(path).expanduser()
    # A user's own file comes before a shipped one of the same name.
    candidates = [path] if path.is_absolute() else [(beside or Path()) / path, shipped_directory() / path]
    for candidate in candidates:
        if os.path.isfile(candidate):
            return candidate.resolve()
    if path.is_absolute():
        raise ModelError(f"no URDF file '{path}'")
    shipped = sorted(each.stem for each in shipped_directory().glob("*.urdf"))
    hint = nearest(path.stem, shipped, ".urdf")
    raise ModelError(f"no URDF file '{path}'{hint}")


def find_shipped(path: str, beside: Path) -> Path:
    """Return a path relative to ``beside``, or the path of a file shipped with rnc_pin if there is none.

    Args:
        path: relative path.
        beside: folder that it refers to first.
    """
    found = beside / path
    return found if found.is_file() or not (shipped_directory() / path).is_file() else shipped_directory() / path


def find_mjcf(path: str | Path, beside: Path | None = None) -> Path:
    """Return the path of an MJCF file, relative to ``beside``.

    Args:
        path: absolute or relative path.
        beside: folder that a relative path refers to; the working directory by default.

    Raises:
        ModelError: no such file; the message names the nearest one in the same folder.
    """
    found = (beside or Path()) / Path(path).expanduser()
    if os.path.isfile(found):
        return found.resolve()
    there = sorted(each.name for each in found.parent.glob("*.xml")) if found.parent.is_dir() else []
    raise ModelError(f"no MJCF file '{path}'{nearest(found.name, there) if there else ''}")


@cache
def _example_data() -> Path:
    import importlib.metadata  # it imports email and zipfile, which takes a twentieth of a cold start

    try:
        # The wheel installs outside of Python packages: only its list of files tells where.
        files = importlib.metadata.files("example-robot-data") or []
    except importlib.metadata.PackageNotFoundError:
        raise ModelError("example-robot-data is not installed: pip install example-robot-data") from None
    for file in files:
        if file.suffix == ".urdf":
            located = Path(str(file.locate()))
            for parent in located.parents:
                if parent.name == "robots" and parent.parent.name == "example-robot-data":
                    return parent.resolve()
    raise ModelError("example-robot-data is installed without its robots")


@cache
def example_urdfs() -> dict[str, Path]:
    """All URDFs of example-robot-data by file name without suffix.

    If two robots have files of the same name, the robot's folder precedes it: ``anymal_b_simple/anymal``.
    """
    root = _example_data()
    paths = sorted(root.rglob("*.urdf"))
    stems = [path.stem for path in paths]
    folders = [path.relative_to(root).parts[0].removesuffix("_description") for path in paths]
    return {
        path.stem if stems.count(path.stem) == 1 else f"{folder}/{path.stem}": path
        for path, folder in zip(paths, folders, strict=True)
    }


def find_example(name: str) -> tuple[Path, Path]:
    """Return the URDF and the package folder of a robot in example-robot-data.

    Args:
        name: file name of the URDF without suffix, or with the folder of the robot before it.

    Raises:
        ModelError: no robot or several robots of that name; the message names the nearest.
    """
    urdfs = example_urdfs()
    if name not in urdfs:
        several = [each for each in urdfs if each.endswith(f"/{name}")]
        hint = f"; expected one of {', '.join(several)}" if several else nearest(name, urdfs)
        raise ModelError(f"no robot '{name}' in example-robot-data{hint}")
    return urdfs[name], _example_data().parent.parent
