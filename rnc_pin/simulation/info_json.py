"""Conversion between ``RunInfo`` and JSON content, stored under ``meta`` in the file of a run.

The keys are fixed, because other programs read the files too. None values are omitted.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TypeVar

from rnc_pin.errors import ConfigurationError
from rnc_pin.io.json import Json, to_json_mapping
from rnc_pin.simulation.run_info import Columns, Outcome, OutputNames, PlannedPath, Provenance, RunInfo, TaskNames

_Value = TypeVar("_Value")
_OTHERS = ("T", "multipliers", "contact_forces", "v", "friction_used", "ground_poses", "normal_forces")
_OF_THE_RUN = ("names", "units", "angular", "rotations", "quasi", "goals", "dt", "versions", "outcome", "message")
_OF_ITS_ORIGIN = ("scenario", "seed", "config", "folder", "controller", "task", "path", "estimates", "predicted")


def info_to_plain(info: RunInfo) -> dict[str, Json]:
    """Convert the information of a run to JSON content."""
    outputs = info.outputs
    kinds = {"x1": outputs.x1, "x2": outputs.x2}
    others = {name: list(getattr(outputs, name)) for name in _OTHERS}
    return {
        "names": {**{kind: list(each.names) for kind, each in kinds.items()}, **others},
        "units": {**{kind: list(each.units) for kind, each in kinds.items()}, "T": list(outputs.T_units)},
        "angular": {kind: list(each.angular) for kind, each in kinds.items()},
        "rotations": {kind: list(each.rotations) for kind, each in kinds.items()},
        "quasi": {kind: list(each.quasi) for kind, each in kinds.items()},
        "goals": list(info.goals),
        **({} if info.dt is None else {"dt": info.dt}),
        "versions": dict(info.versions),
        **provenance_to_plain(info.provenance),
        "outcome": str(info.outcome),
        **({} if info.message is None else {"message": info.message}),
    }


def provenance_to_plain(origin: Provenance) -> dict[str, Json]:
    """Convert the origin of a run to JSON content."""
    task, path = origin.task, origin.path
    content: dict[str, Json] = {
        "scenario": origin.scenario,
        "seed": origin.seed,
        "config": origin.config,
        "folder": origin.folder,
        "controller": origin.controller,
        "task": None if task is None else {"primary": list(task.primary), "redundant": list(task.redundant)},
        "path": None
        if path is None
        else {"frame": path.frame, "trailer": path.trailer, "poses": [list(pose) for pose in path.poses]},
        "estimates": origin.estimates or None,
        "predicted": origin.predicted or None,
    }
    known = {key: value for key, value in content.items() if value is not None}
    return to_json_mapping({**known, **origin.more}, "meta")


def provenance_of(content: Provenance | Mapping[str, Json] | None) -> Provenance:
    """Return the origin of a run from a ``Provenance``, JSON content or None.

    Keys that describe the run itself, such as names and outcome, are ignored. So the ``meta`` of one run can be passed
    to another.

    Raises:
        ConfigurationError: a known key has a value of the wrong type.
        InputError: a value cannot be written as JSON.
    """
    if isinstance(content, Provenance):
        return content
    if content is not None and not isinstance(content, Mapping):
        raise ConfigurationError(f"meta: expected a Provenance or a mapping, found {type(content).__name__}")
    content = to_json_mapping(content or {}, "meta")
    read = _Reader(content)
    return Provenance(
        scenario=read.optional("scenario", _text),
        seed=read.optional("seed", _whole),
        config=read.optional("config", _mapping),
        folder=read.optional("folder", _text),
        controller=read.optional("controller", _mapping),
        task=read.optional("task", _task),
        path=read.optional("path", _path),
        estimates=read.optional("estimates", _texts_by_name) or {},
        predicted=read.optional("predicted", _texts_by_name) or {},
        more={key: value for key, value in content.items() if key not in (*_OF_THE_RUN, *_OF_ITS_ORIGIN)},
    )


def info_from_plain(content: Json) -> RunInfo:
    """Convert JSON content to the information of a run.

    Raises:
        ConfigurationError: the names of the outputs are missing, or a value has the wrong type.
    """
    parts = ("names", "units", "angular")
    if not isinstance(content, Mapping) or not all(isinstance(content.get(part), Mapping) for part in parts):
        raise ConfigurationError("'meta' does not name the outputs")
    names, units, angular = (_Reader(_mapping(content[part]), f"{part}.") for part in parts)
    read = _Reader(content)
    rotations = _Reader(read.optional("rotations", _mapping) or {}, "rotations.")
    quasi = _Reader(read.optional("quasi", _mapping) or {}, "quasi.")
    x1, x2 = (
        Columns(
            names.optional(kind, _texts) or (),
            units.optional(kind, _texts) or (),
            angular.optional(kind, _flags) or (),
            rotations.optional(kind, _wholes) or (),
            quasi.optional(kind, _flags) or (),
        )
        for kind in ("x1", "x2")
    )
    others = {each: names.optional(each, _texts) or () for each in _OTHERS}
    return RunInfo(
        OutputNames(x1, x2, **others, T_units=units.optional("T", _texts) or ()),
        goals=read.optional("goals", _texts) or (),
        dt=read.optional("dt", _number),
        versions=read.optional("versions", _texts_by_name) or {},
        provenance=provenance_of(content),
        outcome=read.optional("outcome", _outcome) or Outcome.COMPLETED,
        message=read.optional("message", _text),
    )


class _Reader:
    """Typed access to a mapping. Errors name the key.

    Args:
        content: the mapping.
        where: prefix of its keys in error messages.
    """

    def __init__(self, content: Mapping[str, Json], where: str = "") -> None:
        self._content, self._where = content, where

    def optional(self, key: str, read: Callable[[Json], _Value]) -> _Value | None:
        """Return the value of a key, or None if it is absent."""
        return None if self._content.get(key) is None else self.required(key, read)

    def required(self, key: str, read: Callable[[Json], _Value]) -> _Value:
        """Return the value of a key."""
        value = self._content.get(key)
        try:
            return read(value)
        except _Unexpected as error:
            shown = repr(value) if len(repr(value)) < 40 else repr(value)[:37] + "..."
            raise ConfigurationError(f"'meta' has {shown} as '{self._where}{key}', expected {error}") from None


class _Unexpected(Exception):
    """Wrong type; the message has the expected one."""


def _text(value: Json) -> str:
    if not isinstance(value, str):
        raise _Unexpected("text")
    return value


def _outcome(value: Json) -> Outcome:
    if value not in list(Outcome):
        raise _Unexpected(f"one of {', '.join(Outcome)}")
    return Outcome(value)


def _number(value: Json) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise _Unexpected("a number")
    return value


def _whole(value: Json) -> int:
    if isinstance(value, bool) or not isinstance(value, int):
        raise _Unexpected("a whole number")
    return value


def _flag(value: Json) -> bool:
    if not isinstance(value, bool):
        raise _Unexpected("true or false")
    return value


def _mapping(value: Json) -> Mapping[str, Json]:
    if not isinstance(value, Mapping):
        raise _Unexpected("a mapping")
    return value


def _several(value: Json, read: Callable[[Json], _Value]) -> tuple[_Value, ...]:
    if not isinstance(value, list | tuple):
        raise _Unexpected("a list")
    return tuple(read(each) for each in value)


def _texts(value: Json) -> tuple[str, ...]:
    return _several(value, _text)


def _flags(value: Json) -> tuple[bool, ...]:
    return _several(value, _flag)


def _wholes(value: Json) -> tuple[int, ...]:
    return _several(value, _whole)


def _texts_by_name(value: Json) -> dict[str, str]:
    return {key: _text(each) for key, each in _mapping(value).items()}


def _task(value: Json) -> TaskNames:
    read = _Reader(_mapping(value), "task.")
    return TaskNames(read.optional("primary", _texts) or (), read.optional("redundant", _texts) or ())


def _path(value: Json) -> PlannedPath:
    read = _Reader(_mapping(value), "path.")
    return PlannedPath(read.required("frame", _text), read.optional("trailer", _text), read.required("poses", _poses))


def _poses(value: Json) -> tuple[tuple[float, float, float], ...]:
    return _several(value, _pose)


def _pose(value: Json) -> tuple[float, float, float]:
    pose = _several(value, _number)
    if len(pose) != 3:
        raise _Unexpected("poses of x, y and heading")
    return pose[0], pose[1], pose[2]
