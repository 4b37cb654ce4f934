"""Files of robots: where descriptions are, the entry of a scenario that names one, and URDFs with many trailers."""

from __future__ import annotations

import os
from functools import cache
from pathlib import Path

from rnc_pin.errors import ModelError, nearest

_PACKAGE = Path(__file__).resolve().parents[1]


def shipped_directory() -> Path:
    """Folder of the URDFs shipped with rnc_pin (in a wheel, or in a checkout)."""
    inside = _PACKAGE / "urdf"
    return inside if inside.is_dir() else _PACKAGE.parent / "urdf"


def find_urdf(path: str | Path, beside: Path | None = None) -> Path:
    """Return the path of a URDF: absolute, relative to ``beside``, or the name of a shipped one.

    Raises:
        ModelError: no such file; the message names the nearest shipped one.
    """
    path = Path(path).expanduser()
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
    """Return a path relative to ``beside``, or that of a file shipped with rnc_pin if there is none."""
    found = beside / path
    return found if found.is_file() or not (shipped_directory() / path).is_file() else shipped_directory() / path


def find_mjcf(path: str | Path, beside: Path | None = None) -> Path:
    """Return the path of an MJCF file, relative to ``beside``.

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

    Raises:
        ModelError: no robot or several robots of that name; the message names the nearest.
    """
    urdfs = example_urdfs()
    if name not in urdfs:
        several = [each for each in urdfs if each.endswith(f"/{name}")]
        hint = f"; expected one of {', '.join(several)}" if several else nearest(name, urdfs)
        raise ModelError(f"no robot '{name}' in example-robot-data{hint}")
    return urdfs[name], _example_data().parent.parent


_COLORS = {
    "orange": "0.93 0.42 0.08 1",
    "dark": "0.13 0.13 0.15 1",
    "glass": "0.35 0.55 0.7 1",
    "chrome": "0.78 0.8 0.83 1",
    "blue": "0.13 0.32 0.56 1",
    "white": "0.93 0.93 0.92 1",
}
_TRAILER_COLORS = ("blue", "white")
_MAX_TRAILERS = 50


def tractor_trailers_urdf(n: int) -> str:
    """URDF of the standard n-trailer system: a car and n trailers, each hitched to the axle in front of it.

    Load it with a planar base. The origin is the middle of the tractor's rear axle, at the height of the axles (0.13 m
    above the ground). All wheelbases are 1 m. Frames for the knife edges are in the middle of each axle, x forward:
    ``front_axle``, ``tractor_axle``, ``axle_1``, ``axle_2``, ... Joints: ``front_steering``, ``hitch_1``, ``hitch_2``,
    ... Trailer ``trailer_1`` has its origin at its hitch.

    Sordalen, "Conversion of the kinematics of a car with n trailers into a chained form", IEEE International Conference
    on Robotics and Automation (1993).

    Args:
        n: number of trailers, 0 to 50.

    Raises:
        ModelError: n is not a whole number from 0 to 50.
    """
    if isinstance(n, bool) or not isinstance(n, int) or not 0 <= n <= _MAX_TRAILERS:
        raise ModelError(f"a tractor has 0 to {_MAX_TRAILERS} trailers, found {n!r}")
    parts = [*_tractor(), *(line for number in range(1, n + 1) for line in _trailer(number))]
    materials = [f'<material name="{name}"><color rgba="{rgba}"/></material>' for name, rgba in _COLORS.items()]
    comment = f"A car with {n} trailers hitched on the axle before, written by tractor_trailers_urdf({n})."
    body = "\n".join(f"  {line}" for line in [*materials, *parts])
    return f'<?xml version="1.0"?>\n<!-- {comment} -->\n<robot name="tractor_trailers_{n}">\n{body}\n</robot>\n'


def _tractor() -> list[str]:
    return [
        '<link name="tractor">',
        _inertia(20.0, "0.4 0 0.15", (0.8, 3.0, 3.2)),
        _box("1.32 0.3 0.08", "0.5 0 0.04", "dark"),
        _box("0.62 0.36 0.26", "0.86 0 0.21", "orange"),
        _box("0.02 0.3 0.16", "1.175 0 0.2", "dark"),
        _box("0.5 0.5 0.3", "0.22 0 0.24", "orange"),
        _box("0.44 0.46 0.32", "0.2 0 0.55", "glass"),
        _box("0.5 0.52 0.04", "0.2 0 0.72", "orange"),
        _cylinder(0.025, 0.34, "0.98 0.12 0.45", "chrome"),
        *(_box("0.14 0.1 0.05", f"0 {side * 0.3} 0.17", "orange") for side in (-1, 1)),
        *_wheels(0.0, 0.13, 0.3, 0.1),
        _cylinder(0.05, 0.1, "-0.02 0 0.12", "chrome"),
        _box("1.32 0.3 0.08", "0.5 0 0.04"),
        _box("0.635 0.36 0.26", "0.8675 0 0.21"),
        _box("0.5 0.5 0.3", "0.22 0 0.24"),
        _box("0.44 0.46 0.32", "0.2 0 0.55"),
        _box("0.5 0.52 0.04", "0.2 0 0.72"),
        _cylinder(0.025, 0.34, "0.98 0.12 0.45"),
        *(_box("0.14 0.1 0.05", f"0 {side * 0.3} 0.17") for side in (-1, 1)),
        *_solid_wheels(0.0, 0.13, 0.3, 0.1),
        _cylinder(0.05, 0.1, "-0.02 0 0.12"),
        "</link>",
        *_fixed("tractor_axle", "tractor"),
        '<link name="front_axle">',
        _inertia(2.0, "0 0 0", (0.05, 0.02, 0.06)),
        *_wheels(0.0, 0.11, 0.24, 0.07),
        *_solid_wheels(0.0, 0.11, 0.24, 0.07),
        "</link>",
        '<joint name="front_steering" type="revolute">',
        '  <parent link="tractor"/><child link="front_axle"/><origin xyz="1 0 -0.02" rpy="0 0 0"/><axis xyz="0 0 1"/>',
        '  <limit lower="-1.2" upper="1.2" effort="100" velocity="10"/><dynamics damping="0.2"/>',
        "</joint>",
    ]


def _trailer(number: int) -> list[str]:
    parent, hitch = ("tractor", "0 0 0") if number == 1 else (f"trailer_{number - 1}", "-1 0 0")
    color = _TRAILER_COLORS[(number - 1) % len(_TRAILER_COLORS)]
    return [
        f'<link name="trailer_{number}">',
        _inertia(10.0, "-0.85 0 0.15", (0.5, 0.9, 1.1)),
        _box("0.5 0.05 0.05", "-0.23 0 0.06", "chrome"),
        _box("0.8 0.46 0.06", "-0.85 0 0.1", "dark"),
        _box("0.78 0.46 0.3", "-0.85 0 0.28", color),
        _box("0.8 0.48 0.03", "-0.85 0 0.44", "chrome"),
        *_wheels(-1.0, 0.13, 0.29, 0.07),
        _cylinder(0.05, 0.1, "-1 0 0.06", "chrome"),
        _box("0.5 0.05 0.05", "-0.23 0 0.06"),
        _box("0.8 0.48 0.385", "-0.85 0 0.2625"),
        *_solid_wheels(-1.0, 0.13, 0.29, 0.07),
        _cylinder(0.05, 0.1, "-1 0 0.06"),
        "</link>",
        *_fixed(f"axle_{number}", f"trailer_{number}", "-1 0 0"),
        f'<joint name="hitch_{number}" type="revolute">',
        f'  <parent link="{parent}"/><child link="trailer_{number}"/>',
        f'  <origin xyz="{hitch}" rpy="0 0 0"/><axis xyz="0 0 1"/>',
        '  <limit lower="-1.57" upper="1.57" effort="0" velocity="10"/><dynamics damping="0.2"/>',
        "</joint>",
    ]


def _fixed(name: str, parent: str, place: str = "0 0 0") -> list[str]:
    joint = f'<joint name="{name}_joint" type="fixed"><parent link="{parent}"/><child link="{name}"/>'
    return [f'<link name="{name}"/>', f'{joint}<origin xyz="{place}" rpy="0 0 0"/></joint>']


def _inertia(mass: float, center: str, principal: tuple[float, float, float]) -> str:
    x, y, z = principal
    tensor = f'<inertia ixx="{x:g}" iyy="{y:g}" izz="{z:g}" ixy="0" ixz="0" iyz="0"/>'
    return f'  <inertial><origin xyz="{center}"/><mass value="{mass:g}"/>{tensor}</inertial>'


def _geometry(shape: str, place: str, turn: str, color: str | None) -> str:
    """Visual geometry of a colour, or collision geometry without one."""
    geometry = f'<origin xyz="{place}" rpy="{turn}"/><geometry>{shape}</geometry>'
    if color is None:
        return f"  <collision>{geometry}</collision>"
    return f'  <visual>{geometry}<material name="{color}"/></visual>'


def _box(size: str, place: str, color: str | None = None) -> str:
    return _geometry(f'<box size="{size}"/>', place, "0 0 0", color)


def _cylinder(radius: float, length: float, place: str, color: str | None = None, turn: str = "0 0 0") -> str:
    return _geometry(f'<cylinder radius="{radius:g}" length="{length:g}"/>', place, turn, color)


def _wheels(x: float, radius: float, half_track: float, width: float) -> list[str]:
    """Two wheels, their hubs and the axle between them."""
    across = "1.5708 0 0"
    parts = [_cylinder(0.025, 2 * half_track, f"{x:g} 0 0", "chrome", across)]
    for y in (half_track, -half_track):
        parts.append(_cylinder(radius, width, f"{x:g} {y:g} 0", "dark", across))
        parts.append(_cylinder(0.5 * radius, width + 0.01, f"{x:g} {y:g} 0", "chrome", across))
    return parts


def _solid_wheels(x: float, radius: float, half_track: float, width: float) -> list[str]:
    """The same for collisions: a wheel is as wide as its hub."""
    across = "1.5707963 0 0"
    wheels = [_cylinder(radius, width + 0.01, f"{x:g} {y:g} 0", turn=across) for y in (half_track, -half_track)]
    return [_cylinder(0.025, 2 * half_track, f"{x:g} 0 0", turn=across), *wheels]
