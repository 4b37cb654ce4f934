"""State of a control loop between two steps, its checks, and its file.

A state may come from an untrusted file. A file holds numbers, text and tuples of them, bit for bit; reading it executes
no code. Before the loop resumes from it, the controller takes one trial step.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple, TypeAlias, TypedDict

import numpy as np

from rnc_pin.array_shapes import Array, Float
from rnc_pin.control.controller import Controller, State
from rnc_pin.control.loop.options import input_of, unpack_step
from rnc_pin.errors import ConfigurationError, InputError, RncError, printable
from rnc_pin.io.json import atomic_file
from rnc_pin.io.safe_npz import ArchiveError, read_npz
from rnc_pin.model.input_validation import admit_configurations
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.printing import printed

_MAX_VALUE = 1e15
"""Largest valid absolute value of a time, velocity or input."""

_STRUCTURE = "structure"
_MOST_BYTES = 64 * 2**20  # largest size of all arrays of a state [bytes]


class VelocityEstimate(NamedTuple):
    """State of a velocity observer."""

    q: Float[Array, " nq"]
    v: Float[Array, " nv"]
    """Estimated velocity."""
    acceleration: Float[Array, " nv"]
    """Estimated acceleration [rad/s^2, m/s^2]."""


class LateTicks(NamedTuple):
    """Steps whose computation took longer than they may. Times of a clock: no two runs have the same."""

    ticks: int
    """Number of all steps."""
    late: int
    """Number of late ones."""
    largest: float
    """Longest computing time of a late one [s]."""
    first: float
    """Time of the first late one, or of the last valid measurement before it [s]."""

    def __str__(self) -> str:
        share = 100 * self.late / max(self.ticks, 1)
        return (
            f"{self.late} steps ({share:.3g} %) took longer to compute than they may, up to {1e3 * self.largest:.3g} "
            f"ms, the first at t = {self.first:.3f} s"
        )


def with_late_tick(before: LateTicks | None, t: float, spent: float, deadline: float) -> LateTicks:
    """Count a step at time t [s] that took so long [s]."""
    ticks, late, largest, first = before or (0, 0, 0.0, t)
    if not spent > deadline:
        return LateTicks(ticks + 1, late, largest, first)
    return LateTicks(ticks + 1, late + 1, max(largest, spent), first if late else t)


@printed(invalid_since="s")
class LoopState(NamedTuple):
    """All data that a control loop keeps from one step to the next.

    Example:
        >>> rnc.loop.LoopState().fault is None  # before the first step
        True
    """

    begin: float | None = None
    """Time of the first step [s]; it is the controller's time zero."""
    time: float | None = None
    """Time of the last valid measurement [s]."""
    q: Float[Array, " nq"] | None = None
    """Last measured configuration."""
    v2: Float[Array, " r"] | None = None
    """Reducing velocities of the last measurement."""
    integrals: Float[Array, " r"] | None = None
    """Integrals of the reducing velocities since the first step."""
    motion: VelocityEstimate | None = None
    """State of the velocity estimate; None if velocity is measured."""
    T: Float[Array, " p"] | None = None
    """Last inputs."""
    input_deficit: Float[Array, " p"] | None = None
    """Requested minus applied inputs. None if it is zero."""
    controller: State = None
    """State of the controller."""
    invalid_since: float | None = None
    """Time of the first invalid measurement since the last valid one [s]."""
    fault: str | None = None
    """Reason for the safe command, as text; None in normal operation."""
    failed: bool = False
    """True after an error of the controller: the safe command is permanent."""
    late: LateTicks | None = None
    """Steps that took longer than ``deadline``; None without a deadline. Nothing else in a state depends on a clock."""


# ------------------------------------------------------------------ checks


def check_state(state: LoopState, reduced: ReducedModel) -> None:
    """Check the types, shapes and values of a loop's state, apart from the controller's state.

    Args:
        state: state of a loop.
        reduced: model of the loop.

    Raises:
        InputError: names the field and the expected value.
    """
    if not isinstance(state, LoopState):
        raise InputError(f"expected a LoopState, found {type(state).__name__}")
    r, p, q, v = np.zeros(reduced.r), np.zeros(reduced.p), reduced.robot.configuration(), np.zeros(reduced.n)
    motion, late = VelocityEstimate(q, v, v), LateTicks(0, 0, 0.0, 0.0)
    # A valid value of each field: types and shapes are compared with it.
    valid = LoopState(0.0, 0.0, q, r, r, motion, p, p, None, 0.0, "", False, late)
    for name, found, model in zip(LoopState._fields, state, valid, strict=True):
        if name != "controller":
            _check_memory(found, model, model, name)
    for each in (state, state.motion):
        if each is not None and each.q is not None:
            admit_configurations(each.q, reduced.robot)


def _check_memory(found: object, initial: object, after: object, where: str = "controller") -> None:
    """Check a stored value against two valid ones.

    Args:
        found: stored value, such as the state of a controller. None is valid.
        initial: its initial value.
        after: its value after one step from ``found``. If its shape differs from that of ``initial``, it is a history:
            the first axis may have any length.
        where: name of the field, for error messages.

    Raises:
        InputError: the type or shape differs, or a number is not finite or too large.
    """
    known = _parts(initial, where), _parts(after, where)
    for name, value in _parts(found, where).items():
        start, *_ = both = [parts.get(name) for parts in known]
        _check_value(value, [each for each in both if each is not None], start, name)


def _check_value(found: object, models: Sequence[object], initial: object, where: str) -> None:
    """Check a part of a stored value against the parts of valid ones; ``initial`` may have unknown values."""
    if found is None or (not models and not isinstance(found, tuple | dict | np.ndarray | float | int | str)):
        return
    if isinstance(found, dict | tuple | str):
        if models and not any(type(each) is type(found) for each in models):
            raise InputError(f"{where} is a {type(found).__name__}, expected a {type(models[0]).__name__}")
        return
    numbers = [each for each in models if not isinstance(each, str | tuple | dict)]
    if models and not numbers:
        raise InputError(f"{where} is a number or an array, expected a {type(models[0]).__name__}")
    # An initial state may use NaN for unknown values.
    unknown = any(each is initial and np.isnan(np.asarray(each)).any() for each in numbers)
    if not unknown and not _is_number(found):
        raise InputError(f"{where} is not finite, or beyond {_MAX_VALUE:g}")
    if numbers and isinstance(found, bool) not in {isinstance(each, bool) for each in numbers}:
        raise InputError(f"{where} is {found!r}, expected a {type(numbers[0]).__name__}")
    shape, *shapes = (np.asarray(each).shape for each in (found, *numbers))
    varies = len({*shapes}) > 1 and len(shape) == len(shapes[-1]) and shape[1:] == shapes[-1][1:]
    if shapes and shape not in shapes and not varies:
        raise InputError(f"{where} has shape {shape}, expected {shapes[0]}")


def _parts(value: object, name: str) -> dict[str, object]:
    """A value and all parts of its tuples and mappings, by name, the whole before its parts."""
    entries = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, tuple) else ()
    names, found = getattr(value, "_fields", None), {name: value}
    for key, each in entries:
        found |= _parts(each, f"{name}.{key if names is None else names[key]}")
    return found


def _is_number(value: object) -> bool:
    """True if the value is a number within bounds, or an array of them."""
    array = np.asarray(value)  # integers without bound are objects
    return array.dtype.kind in "fiub" and bool((np.abs(array.astype(float)) <= _MAX_VALUE).all())


# ------------------------------------------------------------------ file


class _Packed(TypedDict, total=False):
    """Value of a state in the JSON of a file, unless it is a number, text or None: an array, a mapping, or a tuple."""

    array: str
    """Name of the array in the file."""
    mapping: dict[str, _Value]
    items: list[_Value]
    kind: str
    """Type of the tuple of ``items``."""


_Value: TypeAlias = "bool | int | float | str | _Packed | None"


def write_state(state: LoopState, path: Path) -> None:
    """Write a state. An existing file is replaced only when the new one is complete.

    Raises:
        ConfigurationError: the state holds another type than numbers, arrays, text, and tuples or mappings of them.
    """
    arrays: dict[str, Array] = {}
    structure = json.dumps(_pack(state, arrays, "state"))
    # Without pickle, so that reading a file executes nothing.
    with atomic_file(path) as partial, partial.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, **arrays, **{_STRUCTURE: np.array(structure)})


def _pack(value: object, arrays: dict[str, Array], where: str) -> _Value:
    # JSON of Python has all digits of a float, and NaN and infinity: no bit is lost.
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, np.ndarray | np.generic):
        array = np.asarray(value)
        if array.dtype.kind not in "fiub":
            raise ConfigurationError(f"{where}: an array of {array.dtype} cannot be saved")
        name = f"a{len(arrays)}"
        arrays[name] = array
        return {"array": name}
    if isinstance(value, tuple):
        names = getattr(value, "_fields", range(len(value)))
        items = [_pack(each, arrays, f"{where}.{name}") for name, each in zip(names, value, strict=True)]
        return {"items": items, "kind": type(value).__qualname__}
    if isinstance(value, dict):
        return {"mapping": {str(key): _pack(each, arrays, f"{where}.{key}") for key, each in value.items()}}
    raise ConfigurationError(f"{where}: a {type(value).__name__} cannot be saved")


def _unpack(content: _Value, arrays: dict[str, Array], known: dict[str, type]) -> object:
    if not isinstance(content, dict):
        return content
    if "array" in content:
        return arrays[content["array"]]
    if "mapping" in content:
        return {key: _unpack(each, arrays, known) for key, each in content["mapping"].items()}
    items = [_unpack(each, arrays, known) for each in content["items"]]
    kind = known.get(content["kind"])
    if kind is None:
        raise ConfigurationError(f"it is that of another controller: it holds a '{content['kind']}'")
    return tuple(items) if kind is tuple else kind(*items)


def _read_state(path: Path, reduced: ReducedModel, controller: Controller) -> tuple[LoopState, State]:
    """Read a file of ``write_state``; also return the initial state of the controller at its configuration.

    Raises:
        Exception: the file does not exist, is no archive, has any other structure, or holds tuples of another
            controller; or the controller raises it at that configuration.
    """
    arrays = read_npz(path, text=[_STRUCTURE], largest=_MOST_BYTES)
    # The only types that a file can name: it may come from anywhere.
    known: dict[str, type] = {each.__qualname__: each for each in (tuple, LateTicks, VelocityEstimate)}
    packed = json.loads(str(arrays.pop(_STRUCTURE)))["items"]
    fields = dict(zip(LoopState._fields, packed, strict=True))
    initial: State = None
    if fields["q"] is not None:
        here = reduced.at(_unpack(fields["q"], arrays, known), v=np.zeros(reduced.n), t=0.0)
        initial = controller.initial_state(here.measure(np.zeros(reduced.r)))
        # The controller's own tuples are valid too: only it can tell their types.
        own = (type(each) for each in _parts(initial, "").values() if isinstance(each, tuple))
        known |= {each.__qualname__: each for each in own}
    found = {name: _unpack(each, arrays, known) for name, each in fields.items()}
    return LoopState(**found), initial  # type: ignore[arg-type]  # ``check_state`` checks each field


def restore(path: Path, reduced: ReducedModel, controller: Controller) -> LoopState:
    """Return the state of a loop from a file.

    Args:
        path: path of the file.
        reduced: model of the loop.
        controller: controller of the loop.

    Raises:
        ConfigurationError: the file does not exist, or its state does not fit this model and controller.
    """
    try:
        state, initial = _read_state(path, reduced, controller)
        check_state(state, reduced)
        # A controller that failed takes no further step, so its state is never used.
        if state.q is not None and not state.failed:
            _check_trial_step(state, reduced, controller, initial)
    except FileNotFoundError:
        raise ConfigurationError(f"no file '{path}'") from None
    except ArchiveError as error:
        raise ConfigurationError(f"{path}: not the state of a loop: {error}") from None
    except RncError as error:
        raise ConfigurationError(f"{path}: the state does not fit this loop: {error}") from None
    except Exception:  # a broken file can hold any structure
        raise ConfigurationError(f"{path}: not the state of a loop") from None
    # This text comes from a file, and terminals obey control characters.
    return state if state.fault is None else state._replace(fault=printable(state.fault))


def _check_trial_step(state: LoopState, reduced: ReducedModel, controller: Controller, initial: State) -> None:
    """Check the stored state of a controller by one step.

    Raises:
        RncError: its type or shape is wrong, it is not finite, or the step fails.
    """
    nothing = np.zeros(reduced.r)
    elapsed = 0.0 if state.time is None else state.time - (state.time if state.begin is None else state.begin)
    here = reduced.at(state.q, nothing if state.v2 is None else state.v2, t=elapsed)
    measurement = here.measure(nothing if state.integrals is None else state.integrals)
    try:
        command, after = unpack_step(controller.step(elapsed, measurement, state.controller))
    except RncError:
        raise
    except Exception as error:  # a state of the wrong shape can raise any error
        raise InputError(f"the controller raises {type(error).__name__}: {error}") from None
    # The shapes of a controller's state are known from itself alone: at its start, and after a step.
    _check_memory(state.controller, initial, after)
    input_of(reduced, here, command)
