"""Scenario files before validation: search, safe YAML, and options of the command line.

This module does not import the schema, so that listing and completing names is fast.
"""

from __future__ import annotations

import os.path
import shlex
from collections.abc import Iterable, Mapping
from copy import deepcopy
from functools import lru_cache
from pathlib import Path
from typing import Any

import yaml

from rnc_pin.errors import ConfigurationError, ModelError, closest, nearest, short_text
from rnc_pin.io import Json, load_yaml, read_bytes
from rnc_pin.robots import example_urdfs, find_urdf, shipped_directory

ROBOT_FILES = (".urdf", ".xacro", ".xml", ".mjcf")
_BUILT_IN = Path(__file__).resolve().parent / "builtin"


def built_in_names() -> list[str]:
    """Names of the scenarios in the package."""
    return sorted(path.stem for path in _BUILT_IN.glob("*.yaml"))


def is_built_in(path: Path) -> bool:
    """True if a scenario file is part of the package.

    Args:
        path: path of the file.
    """
    return path.resolve().parent == _BUILT_IN


def find_scenario(name: str) -> Path:
    """Return the file of a built-in scenario, or the named file.

    Args:
        name: a built-in name or a path.

    Raises:
        ConfigurationError: neither exists (gives the nearest name), or it is a robot (gives the command ``init``).
    """
    if name in built_in_names():  # a file of this name is still there as ./NAME
        return _BUILT_IN / f"{name}.yaml"
    if os.path.isfile(name):  # False, not an error, for names that no file can have
        if name.lower().endswith(ROBOT_FILES):
            raise ConfigurationError(f"{name}: {_is_robot(name)}")
        return Path(name)
    if name.lower().endswith((".yaml", ".yml")):
        folder = Path(name).parent
        # Misspelt names of files mean files: the neighbours first.
        there = sorted(each.name for each in folder.glob("*.y*ml")) if os.path.isdir(folder) else []
        raise ConfigurationError(f"no scenario file '{name}'{nearest(Path(name).name, [*there, *built_in_names()])}")
    robots = robot_names()
    if name in robots:
        raise ConfigurationError(f"'{name}': {_is_robot(name)}")
    # A scenario or robot that has this as a part of its name counts before those that are spelt nearly so.
    close = closest(name, built_in_names(), spelling=False)
    robot = None if close else closest(name, robots, spelling=False)
    missing = f"no scenario '{name}': neither built in nor a file"
    if robot is not None:
        raise ConfigurationError(f"{missing}; if you mean the robot '{robot}', {_draft_it(robot)}")
    raise ConfigurationError(f"{missing}{nearest(name, built_in_names())}")


def robot_names() -> list[str]:
    """Names of robots for ``rnc-pin init``: files in the package, and examples if they are installed."""
    shipped = [path.name for path in shipped_directory().glob("*.urdf")]
    try:
        examples = list(example_urdfs())
    except ModelError:
        examples = []
    return sorted(shipped) + sorted(examples)


def urdf_path(robot: Mapping[str, Json], folder: Path) -> Path | None:
    """Path of the URDF or Xacro file in the entry ``robot`` of a scenario; None for an MJCF.

    Args:
        robot: the entry.
        folder: folder of the scenario.
    """
    if robot.get("example") is not None:
        return example_urdfs()[str(robot["example"])]
    return find_urdf(str(robot["urdf"]), folder) if robot.get("urdf") is not None else None


def _is_robot(name: str) -> str:
    return f"that is a robot, not a scenario: {_draft_it(name)}"


def _draft_it(robot: str) -> str:
    return f"draft one with: rnc-pin init {shlex.quote(robot)}"


_parsed = lru_cache(maxsize=8)(load_yaml)
"""Content of a YAML text, which is parsed once: sweeps read the same file again and again."""


def read_yaml(path: Path) -> dict[str, Json]:
    """Read the mapping in a YAML file.

    Args:
        path: path of the file.

    Raises:
        ConfigurationError: the file cannot be read, is not YAML (gives the line), or is not a mapping.
    """
    try:
        text = read_bytes(path).decode()
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigurationError(f"{path}: cannot be read: {error}") from None
    try:
        raw = deepcopy(_parsed(text))  # options change it in place, and the cache keeps it
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        line = f"line {mark.line + 1}" if mark else "somewhere"
        raise ConfigurationError(f"{path}, {line}: {error.problem or error.context}") from None
    except yaml.YAMLError as error:
        raise ConfigurationError(f"{path}: not YAML: {str(error).splitlines()[0]}") from None
    if not isinstance(raw, dict):
        found = "the file is empty" if raw is None else f"found {short_text(raw)}"
        if text.lstrip().startswith("<"):
            found = f"found XML: if this is a URDF, Xacro or MJCF file, {_draft_it(str(path))}"
        raise ConfigurationError(f"{path}: expected a mapping with keys such as 'robot'; {found}")
    return raw


def one_line_yaml(value: object) -> str:
    """Value as YAML in one line, which reads back as the same value.

    Args:
        value: the value.
    """
    text: str = yaml.safe_dump(value, default_flow_style=True, sort_keys=False, width=float("inf"), allow_unicode=True)
    return text.removesuffix("\n").removesuffix("\n...")


def parse_option(option: str) -> tuple[str, Json]:
    """Split ``a.b=c`` into key and value, and read the value as YAML.

    Args:
        option: the text of an option.
    """
    key, equals, text = option.partition("=")
    if not equals or not key.strip():
        raise ConfigurationError(f"option '{option}': expected key=value, e.g. simulation.duration=5")
    try:
        return key.strip(), load_yaml(text)
    except yaml.YAMLError:
        raise ConfigurationError(f"option '{option}': '{text}' is not a value") from None


def parse_options(options: Iterable[str]) -> dict[str, Json]:
    """Return keys and values for ``with_options``. The last value of a repeated key counts.

    Args:
        options: texts of options, such as ``simulation.duration=5``.
    """
    return dict(parse_option(option) for option in options)


def with_options(raw: Mapping[str, Json], options: Mapping[str, Json]) -> dict[str, Json]:
    """Return a copy of a scenario with new values: options, a variant, or the draws of a sweep.

    Args:
        raw: mapping of the scenario.
        options: values by dotted key. Numbers in a key index lists.

    Raises:
        ConfigurationError: a key leads through something that is neither a mapping nor a list.
    """
    result = deepcopy(dict(raw))
    for key, value in options.items():
        where: Any = result
        before = ""
        *parents, last = key.split(".")
        for part in parents:
            place = _place(where, part, key, before)
            # A part that the file omits may be set: the schema checks the result.
            where = where.setdefault(place, {}) if isinstance(where, dict) else where[place]
            before = part
        where[_place(where, last, key, before)] = value
    return result


def _place(where: object, part: str, key: str, before: str) -> Any:
    """Key of a mapping, or index into a list, that a part of a dotted key means."""
    if isinstance(where, dict):
        return part
    if not isinstance(where, list):
        raise ConfigurationError(f"{key}: '{before}' is {short_text(where)}, not a mapping or a list")
    # isdecimal alone takes other scripts, and int takes "-1", which would count from the end.
    if not (part.isascii() and part.isdecimal()) or int(part) >= len(where):
        raise ConfigurationError(f"{key}: '{part}' is not an index into a list of {len(where)}")
    return int(part)


def mapping_of(value: object) -> dict[str, Json]:
    """Return a copy of a mapping in a scenario; an empty one for anything else.

    Args:
        value: a value in a scenario.
    """
    return dict(value) if isinstance(value, Mapping) else {}
