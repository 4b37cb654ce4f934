"""Entry ``robot`` of a scenario file for the arguments with which a robot was loaded."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from rnc_pin.io.json import Json


def source_entry(
    base: str | None,
    package_dirs: Sequence[str | Path] = (),
    snap: bool = True,
    gravity: Sequence[float] | None = None,
    **others: object,
) -> dict[str, Json]:
    """Return the entry ``robot`` of a scenario file for the arguments of a loader. Those at their defaults are missing.

    Args:
        base: base of the robot; None for that of the file.
        package_dirs: further folders of packages.
        snap: True to correct rounded angles.
        gravity: acceleration of gravity (3,) [m/s^2].
        others: the file and mappings, by key.
    """
    entry: dict[str, Json] = {key: _plain(value) for key, value in others.items() if value}
    if base is not None:
        entry["base"] = base
    if package_dirs:
        entry["package_dirs"] = [str(Path(each).expanduser().resolve()) for each in package_dirs]
    if not snap:
        entry["snap"] = False
    if gravity is not None:
        entry["gravity"] = [float(each) for each in gravity]
    return entry


def _plain(value: object) -> Json:
    if isinstance(value, Mapping):
        return {str(name): _plain(each) for name, each in value.items()}
    found: Json = np.asarray(value).tolist()
    return found
