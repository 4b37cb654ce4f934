"""Scenario files: safe YAML, options from the command line, and one line for whatever is wrong."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from copy import deepcopy
from importlib import resources
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import BaseModel, ValidationError

from rnc_pin.errors import ConfigurationError, nearest
from rnc_pin.robots.urdf_files import is_file
from rnc_pin.scenario.schema import Scenario

_BUILT_IN = resources.files("rnc_pin.scenario") / "builtin"


class _Loader(yaml.SafeLoader):
    """Safe YAML that refuses a key given twice, where YAML would quietly keep the last."""


def _mapping(loader: _Loader, node: yaml.MappingNode) -> dict[Hashable, Any]:
    seen: set[Any] = set()
    for key_node, _ in node.value:
        if key_node.tag == "tag:yaml.org,2002:merge":
            continue
        key = loader.construct_object(key_node, deep=True)
        if isinstance(key, Hashable):
            if key in seen:
                raise yaml.constructor.ConstructorError(None, None, f"key '{key}' is there twice", key_node.start_mark)
            seen.add(key)
    return yaml.SafeLoader.construct_mapping(loader, node, deep=True)


_Loader.add_constructor(yaml.resolver.BaseResolver.DEFAULT_MAPPING_TAG, _mapping)


def built_in_names() -> list[str]:
    """Names of the scenarios that come with the package."""
    return sorted(each.name.removesuffix(".yaml") for each in _BUILT_IN.iterdir() if each.name.endswith(".yaml"))


def find_scenario(name: str) -> Path:
    """The file of a built-in scenario, or the file named.

    Raises:
        ConfigurationError: neither exists; says the nearest name.
    """
    if name in built_in_names():
        return Path(str(_BUILT_IN / f"{name}.yaml"))
    path = Path(name)
    if is_file(path):
        return path
    raise ConfigurationError(f"no scenario '{name}': neither built in nor a file{nearest(name, built_in_names())}")


def read_yaml(path: Path) -> dict[str, Any]:
    """The mapping in a YAML file.

    Raises:
        ConfigurationError: cannot be read, is not YAML (says the line), or not a mapping.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigurationError(f"{path}: cannot be read: {error}") from None
    try:
        raw = yaml.load(text, Loader=_Loader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        line = f"line {mark.line + 1}" if mark else "somewhere"
        raise ConfigurationError(f"{path}, {line}: {error.problem or error.context}") from None
    except (yaml.YAMLError, RecursionError, ValueError) as error:
        raise ConfigurationError(f"{path}: not YAML: {str(error).splitlines()[0]}") from None
    if not isinstance(raw, dict):
        raise ConfigurationError(f"{path}: expected a mapping with keys such as 'robot', found {_describe(raw)}")
    return raw


def parse_option(option: str) -> tuple[str, Any]:
    """``a.b=c`` as a key and a value read as YAML."""
    key, equals, text = option.partition("=")
    if not equals or not key.strip():
        raise ConfigurationError(f"option '{option}': expected key=value, e.g. simulation.duration=5")
    try:
        return key.strip(), yaml.load(text, Loader=_Loader)
    except (yaml.YAMLError, RecursionError, ValueError):
        raise ConfigurationError(f"option '{option}': '{text}' is not a value") from None


def with_options(raw: Mapping[str, Any], options: Mapping[str, Any]) -> dict[str, Any]:
    """A copy of a scenario with values at dotted keys replaced; numbers in a key index lists."""
    result = deepcopy(dict(raw))
    for key, value in options.items():
        where: Any = result
        parts = key.split(".")
        for depth, part in enumerate(parts):
            last = depth == len(parts) - 1
            if isinstance(where, list):
                if not (part.isascii() and part.isdecimal()) or int(part) >= len(where):
                    raise ConfigurationError(f"{key}: '{part}' is not an index into a list of {len(where)}")
                if last:
                    where[int(part)] = value
                else:
                    where = where[int(part)]
            elif isinstance(where, dict):
                if last:
                    where[part] = value
                else:
                    where = where.setdefault(part, {})
            else:
                raise ConfigurationError(f"{key}: '{parts[depth - 1]}' holds {_describe(where)}, nothing is inside it")
    return result


def validate(raw: Mapping[str, Any], source: str) -> Scenario:
    """A scenario from its mapping.

    Raises:
        ConfigurationError: one line for the first mistake: file, key, what was found and expected.
    """
    return checked(Scenario, raw, source)


_Model = TypeVar("_Model", bound=BaseModel)


def checked(model: type[_Model], raw: Mapping[str, Any], source: str) -> _Model:
    """A part of a scenario from its mapping, like ``validate``."""
    try:
        return model.model_validate(raw)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        raise ConfigurationError(f"{source}: {_explain(first)}") from None


def _explain(error: Mapping[str, Any]) -> str:
    where = _path(error["loc"])
    kind, context = error["type"], error.get("ctx", {})
    if kind == "union_tag_invalid":
        expected = [each.strip(" '") for each in str(context["expected_tags"]).split(",")]
        words = ", ".join("a joint's name" if each == "name" else each for each in expected)
        found = error["input"]
        if isinstance(found, dict) and len(found) == 1:
            return f"{where}: '{context['tag']}' is not known{nearest(context['tag'], expected)}"
        return f"{where}: expected a mapping with one key of {words}; found {_describe(found)}"
    if kind in ("too_short", "too_long"):
        bound = context.get("min_length", context.get("max_length"))
        most = "at least" if kind == "too_short" else "at most"
        return f"{where}: expected {most} {bound} item{'s' * (bound != 1)}, found {_describe(error['input'])}"
    if kind == "missing":
        return f"{where}: is missing"
    if kind == "value_error":
        return f"{where}: {context['error']}"
    message = "expected a mapping" if kind in ("model_type", "model_attributes_type") else error["msg"]
    message = message.replace("Input should be", "expected").replace("a valid dictionary", "a mapping")
    return f"{where}: {message}, found {_describe(error['input'])}"


_UNION_MEMBERS = {"float", "str", "list[float]", "constrained-list", "name", "unknown_masses", "unknown_wheels"}


def _path(location: Sequence[str | int]) -> str:
    """``outputs.reducing[0].joint`` from pydantic's location, without its words for the members of a union."""
    text, previous = "", None
    for part in location:
        if isinstance(part, int):
            text += f"[{part}]"
        elif part != previous and part not in _UNION_MEMBERS:
            text += f".{part}" if text else part
        previous = part
    return text or "(top level)"


def _describe(value: Any) -> str:
    if isinstance(value, dict):
        return f"a mapping with keys {', '.join(map(str, list(value)[:4]))}" if value else "an empty mapping"
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."
