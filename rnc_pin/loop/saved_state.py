"""Bit-exact file format of a loop's state: numbers, text and tuples of them. Reading executes no code."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rnc_pin.errors import ConfigurationError, RncError
from rnc_pin.io.atomic_write import atomic_file
from rnc_pin.io.json import Json
from rnc_pin.io.safe_npz import ArchiveError, read_npz

_STRUCTURE = "structure"
_ROOM = 64 * 2**20  # largest size of all arrays of a controller's state [bytes]


def write_state(state: Any, path: Path) -> None:
    """Write a state. An existing file is replaced only when the new one is complete.

    Raises:
        ConfigurationError: the state holds another type than numbers, arrays, text, and tuples or mappings of them.
    """
    arrays: dict[str, np.ndarray] = {}
    structure = json.dumps(_plain(state, arrays, "state"))
    with atomic_file(path) as partial, partial.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, **arrays, **{_STRUCTURE: np.array(structure)})


def _plain(value: Any, arrays: dict[str, np.ndarray], where: str) -> Json:
    if value is None or isinstance(value, bool | int | str):
        return {"value": value}
    if isinstance(value, float | np.ndarray | np.generic):
        array = np.asarray(value)
        if array.dtype.kind not in "fiub":
            raise ConfigurationError(f"{where}: an array of {array.dtype} cannot be saved")
        name = f"a{len(arrays)}"
        arrays[name] = array
        return {"number" if isinstance(value, float) else "array": name}
    if isinstance(value, tuple):
        names = getattr(value, "_fields", range(len(value)))
        items = [_plain(each, arrays, f"{where}.{name}") for name, each in zip(names, value, strict=True)]
        return {"items": items, "kind": type(value).__qualname__}
    if isinstance(value, dict):
        return {"mapping": {str(key): _plain(each, arrays, f"{where}.{key}") for key, each in value.items()}}
    raise ConfigurationError(f"{where}: a {type(value).__name__} cannot be saved")


def read_state(path: Path, kinds: Sequence[type], template: Callable[[np.ndarray], Any]) -> Any:
    """Read a file of ``write_state``.

    Args:
        path: path of the file.
        kinds: types of named tuples. The first is the type of the whole state and has a field ``q``.
        template: function from a configuration to an initial state of the controller; its tuple types are allowed too.

    Raises:
        ConfigurationError: the file does not exist, has another format, or holds tuples of another controller.
        RncError: ``template`` raises it at q.
    """
    kind = kinds[0]
    try:
        arrays = read_npz(path, text=[_STRUCTURE], largest=_ROOM)
        structure = json.loads(str(arrays.pop(_STRUCTURE)))
        known = {"tuple": tuple, **{each.__qualname__: each for each in kinds}}
        fields = dict(zip(kind._fields, structure["items"], strict=True))  # type: ignore[attr-defined]
        q = _value(fields["q"], arrays, known)
        if q is not None:
            _collect(template(q), known)
        state = _value(structure, arrays, known)
    except FileNotFoundError:
        raise ConfigurationError(f"no file '{path}'") from None
    except ArchiveError as error:
        raise ConfigurationError(f"{path}: not the state of a loop: {error}") from None
    except ConfigurationError as error:
        raise ConfigurationError(f"{path}: {error}") from None
    except RncError:
        raise
    except Exception:  # a broken file can hold any structure
        raise ConfigurationError(f"{path}: not the state of a loop") from None
    if not isinstance(state, kind):
        raise ConfigurationError(f"{path}: not the state of a loop")
    return state


def _collect(value: Any, known: dict[str, type]) -> None:
    """Add the tuple types of a value to ``known``."""
    if isinstance(value, tuple | list):
        if isinstance(value, tuple):
            known[type(value).__qualname__] = type(value)
        for each in value:
            _collect(each, known)
    elif isinstance(value, dict):
        _collect(list(value.values()), known)


def _value(content: Any, arrays: dict[str, np.ndarray], known: dict[str, type]) -> Any:
    if "value" in content:
        if not isinstance(content["value"], bool | int | str | None):
            raise ValueError(content)
        return content["value"]
    if "number" in content:
        return arrays[content["number"]].item()
    if "array" in content:
        return arrays[content["array"]]
    if "mapping" in content:
        return {key: _value(each, arrays, known) for key, each in content["mapping"].items()}
    items = [_value(each, arrays, known) for each in content["items"]]
    kind = known.get(content["kind"])
    if kind is None:
        raise ConfigurationError(f"the state is that of another controller: it holds a '{content['kind']}'")
    return tuple(items) if kind is tuple else kind(*items)
