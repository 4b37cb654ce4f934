"""Packages of the extras in ``pyproject.toml``, and the message about one that is missing."""

from __future__ import annotations

from importlib.util import find_spec
from typing import NamedTuple

from rnc_pin.errors import ConfigurationError


class _Package(NamedTuple):
    """Package of an extra: the name that people read, and the module."""

    name: str
    module: str


_PACKAGES = {
    "control": _Package("python-control", "control"),
    "dask": _Package("Dask", "distributed"),
    "meshes": _Package("trimesh", "trimesh"),
    "mujoco": _Package("MuJoCo", "mujoco"),
    "ompl": _Package("OMPL", "ompl"),
    "video": _Package("Playwright", "playwright"),
}


def missing_extra(extra: str) -> str:
    """Message about the missing package of an extra; it tells how to install it.

    The package is on no index, so the command is for the folder of the source.
    """
    return f"{_PACKAGES[extra].name} is not installed: pip install '.[{extra}]' in the folder of rnc_pin's source"


def check_extra(extra: str, purpose: str) -> None:
    """Find the package of an extra without importing it.

    Args:
        extra: name of the extra.
        purpose: what needs the package, for the message.

    Raises:
        ConfigurationError: the package is not installed.
    """
    if find_spec(_PACKAGES[extra].module) is None:
        raise ConfigurationError(f"{purpose}: {missing_extra(extra)}")
