"""Values and functions of xacro expressions, with bounded sizes."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from string import Formatter
from typing import Any, TypeAlias

from rnc_pin.errors import ModelError

LETTERS = 100_000
"""Largest number of characters of a text."""

ITEMS = 20_000
"""Largest number of items in a list or dictionary, nested items included; 16 characters count as one item."""

BITS = 4096
"""Largest number of bits of an integer."""

_MAX_NESTING = 50
_MAX_STEPS = 1_000_000  # about two seconds

Value: TypeAlias = Any  # None, bool, int, float, str, list, tuple, dict, set, range, a Function or a Namespace


class Function:
    """Function that expressions may call. It computes a value and has no side effects.

    Args:
        name: name in expressions.
        run: implementation; it refuses arguments that would take too long.
        kind: class of a type name such as ``str``.
        cost: steps of each call, in addition to those for its arguments.
        higher: True if it calls functions given as arguments.
    """

    def __init__(
        self,
        name: str,
        run: Callable[..., Value],
        kind: type | None = None,
        *,
        cost: int = 1,
        higher: bool = False,
    ) -> None:
        self.name, self._run, self.kind, self.cost, self.higher = name, run, kind, cost, higher

    def __call__(self, *arguments: Value, **named: Value) -> Value:
        return self._run(*arguments, **named)

    def __repr__(self) -> str:
        return f"{self.name}()"


class Namespace:
    """Named values with attribute access: ``math.pi``."""

    def __init__(self, name: str, members: Mapping[str, Value]) -> None:
        self.name, self._members = name, members

    def member(self, name: str) -> Value:
        """Return a member; an unknown name raises NameError."""
        if name not in self._members:
            raise NameError(f"'{self.name}' has no '{name}'")
        return self._members[name]

    def __repr__(self) -> str:
        return f"namespace {self.name}"


class Budget:
    """Counter of evaluation steps that bounds the time for a file."""

    def __init__(self) -> None:
        self._left = _MAX_STEPS

    def spend(self, steps: int = 1) -> None:
        """Count steps; raise ModelError if they exceed the limit."""
        self._left -= steps
        if self._left < 0:
            raise ModelError(f"takes more than {_MAX_STEPS:,} steps to expand")


def admit(value: Value) -> int:
    """Return the size of a value in items.

    Raises:
        ModelError: the value is too large, or its type is not allowed.
    """
    return _weight(value, 0)


def _weight(value: Value, depth: int) -> int:
    if value is None or isinstance(value, bool | float | Function | Namespace | range):
        weight = len(value) if isinstance(value, range) else 1
    elif isinstance(value, int):
        if value.bit_length() > BITS:
            raise ModelError(f"a whole number of more than {BITS} bits")
        weight = 1
    elif isinstance(value, str):
        if len(value) > LETTERS:
            raise ModelError(f"a text of more than {LETTERS:,} characters")
        weight = 1 + len(value) // 16
    elif isinstance(value, list | tuple | set | dict):
        if depth > _MAX_NESTING:
            raise ModelError(f"lists are nested more than {_MAX_NESTING} deep")
        weight = 1
        for item in value:
            weight += _weight(item, depth + 1)
            if isinstance(value, dict):
                weight += _weight(value[item], depth + 1)
            if weight > ITEMS:
                break
    else:
        raise ModelError(f"a value of type {type(value).__name__}")
    if weight > ITEMS:
        raise ModelError(f"a list of more than {ITEMS:,} items")
    return weight


_NUMBER = (bool, int, float)
_MAX_WIDTH = 1000  # characters of a field in a format
_CONVERSIONS: Mapping[str, Callable[[Value], str]] = {"s": str, "r": repr, "a": ascii}
_MATH = (
    *("acos", "acosh", "asin", "asinh", "atan", "atan2", "atanh", "ceil", "copysign", "cos", "cosh", "degrees"),
    *("dist", "erf", "erfc", "exp", "expm1", "fabs", "floor", "fmod", "fsum", "gamma", "gcd", "hypot", "isclose"),
    *("isfinite", "isinf", "isnan", "isqrt", "ldexp", "lgamma", "log", "log10", "log1p", "log2", "pow", "radians"),
    *("remainder", "sin", "sinh", "sqrt", "tan", "tanh", "trunc"),
)
_CONSTANTS = {"e": math.e, "inf": math.inf, "nan": math.nan, "pi": math.pi, "tau": math.tau}
_GLOBAL = (
    *("list", "dict", "map", "len", "str", "float", "int", "bool", "min", "max", "round"),
    *("sorted", "range"),
)

_TEXT_METHODS = (
    *("capitalize", "casefold", "count", "endswith", "find", "index", "isalnum", "isalpha", "isdecimal", "isdigit"),
    *("isidentifier", "islower", "isnumeric", "isspace", "istitle", "isupper", "lower", "lstrip", "partition"),
    *("removeprefix", "removesuffix", "rfind", "rindex", "rpartition", "rsplit", "rstrip", "split", "splitlines"),
    *("startswith", "strip", "swapcase", "title", "upper"),
)
_METHODS: Mapping[type, tuple[str, ...]] = {
    str: _TEXT_METHODS,
    list: ("copy", "count", "index"),
    tuple: ("count", "index"),
    dict: ("copy", "get"),
    set: ("copy", "difference", "intersection", "issubset", "issuperset", "union"),
    float: ("is_integer",),
}


def _few(items: Iterable[Value]) -> list[Value]:
    """Return the items as a list; refuse a range that is too long."""
    if isinstance(items, range) and len(items) > ITEMS:
        raise ModelError(f"a range of more than {ITEMS:,} numbers")
    return list(items)


def _range(*bounds: int) -> range:
    made = range(*bounds)
    _few(made)
    return made


def _round(number: float, ndigits: int | None = None) -> float:
    if ndigits is not None and abs(ndigits) > 400:
        raise ModelError("rounds to more than 400 digits")
    return round(number, ndigits)


def _sum(items: Iterable[Value], start: float = 0) -> Value:
    numbers = _few(items)
    if not all(isinstance(number, _NUMBER) for number in (start, *numbers)):
        raise TypeError("sum() takes numbers")
    return sum(numbers, start)


def _is_instance(value: Value, kinds: Value) -> bool:
    functions = kinds if isinstance(kinds, tuple) else (kinds,)
    classes = [each.kind for each in functions if isinstance(each, Function) and each.kind is not None]
    if len(classes) != len(functions):
        raise TypeError("isinstance() takes names of types, such as python.str")
    return isinstance(value, tuple(classes))


def _listing(function: Callable[..., Iterable[Value]]) -> Callable[..., Value]:
    """Wrap a function so that it returns a list, not a generator."""
    return lambda *arguments, **named: list(function(*arguments, **named))


_FUNCTIONS: Mapping[str, Callable[..., Value]] = {
    "abs": abs,
    "all": all,
    "any": any,
    "divmod": divmod,
    "enumerate": _listing(enumerate),
    "filter": _listing(filter),
    "frozenset": set,
    "isinstance": _is_instance,
    "len": len,
    "map": _listing(map),
    "max": max,
    "min": min,
    "ord": ord,
    "range": _range,
    "repr": repr,
    "reversed": _listing(reversed),
    "round": _round,
    "sorted": sorted,
    "sum": _sum,
    "zip": _listing(zip),
}
_HIGHER = ("filter", "map", "max", "min", "sorted")
_KINDS: Mapping[str, type] = {each.__name__: each for each in (bool, dict, float, int, list, set, str, tuple)}


def builtins() -> dict[str, Value]:
    """Predefined names of ``${...}``; a new dictionary for each file."""
    python: dict[str, Value] = {name: Function(name, run, higher=name in _HIGHER) for name, run in _FUNCTIONS.items()}
    python |= {name: Function(name, kind, kind) for name, kind in _KINDS.items()}
    mathematics = mathematical()
    known = {"math": Namespace("math", mathematics), "python": Namespace("python", python)}
    return mathematics | {name: python[name] for name in _GLOBAL} | known


def mathematical() -> dict[str, Value]:
    """Functions and constants of ``math``, without functions whose result has no bounded length."""
    return _CONSTANTS | {name: Function(name, getattr(math, name)) for name in _MATH}


def tokenize(text: str, sep: str = ",; ", skip_empty: bool = True) -> list[str]:
    """Split a text at any of the separators."""
    parts = re.split(f"[{re.escape(sep)}]", text) if sep else [text]
    return [part for part in parts if part or not skip_empty]


def attribute(owner: Value, name: str) -> Value:
    """Return an attribute: a member of a namespace, a listed method, or an entry of a dictionary.

    Raises:
        ModelError: the attribute does not exist, or could do more than compute a value.
        NameError: a namespace has no such member.
    """
    if not name.startswith("_"):
        if isinstance(owner, Namespace):
            return owner.member(name)
        method = _method(owner, name)
        if method is not None:
            return Function(name, method, cost=admit(owner))
        if isinstance(owner, dict) and name in owner:
            return owner[name]
        if isinstance(owner, dict):
            raise ModelError(f"the dictionary has no key '{name}'")
    raise ModelError(f"attribute '{name}' could do more than compute a value")


def _method(owner: Value, name: str) -> Callable[..., Value] | None:
    if name in _METHODS.get(type(owner), ()):
        return getattr(owner, name)
    if isinstance(owner, dict) and name in ("items", "keys", "values"):
        return _listing(getattr(owner, name))
    if isinstance(owner, str) and name in _GROWING:
        return partial(_GROWING[name], owner)
    return None


def _join(separator: str, items: Iterable[str]) -> str:
    parts = _few(items)
    _check_length(len(separator) * len(parts) + sum(len(part) for part in parts))
    return separator.join(parts)


def _replace(text: str, old: str, new: str, count: int = -1) -> str:
    _check_length(len(text) + text.count(old) * len(new))
    return text.replace(old, new, count)


def _format(text: str, *arguments: Value, **named: Value) -> str:
    """``str.format`` whose fields name arguments only; their attributes would give access to this process."""
    parts: list[str] = []
    length = automatic = 0
    numbered = False
    for literal, field, spec, conversion in Formatter().parse(text):
        parts.append(literal)
        if field is None:
            continue
        if not re.fullmatch(r"\w*", field, re.ASCII):
            raise ModelError(f"field '{{{field}}}' of a format could do more than compute a value")
        numbered |= field.isdigit()
        automatic += not field
        if numbered and automatic:
            raise ValueError("a format has fields with and without numbers")
        value = named[field] if field and not field.isdigit() else arguments[int(field or automatic - 1)]
        length += 16 * admit(value)
        _check_length(length)
        parts.append(_formatted(value, spec or "", conversion))
        length += len(parts[-1])
        _check_length(length)
    return "".join(parts)


def _formatted(value: Value, spec: str, conversion: str | None) -> str:
    """Format a value by a format specification."""
    sizes = re.fullmatch(r"(?:.?[<>=^])?[-+ ]?z?#?0?(\d*)[,_]?(?:\.(\d+))?[a-zA-Z%]?", spec, re.ASCII | re.DOTALL)
    if sizes is None:
        raise ModelError(f"specification '{spec}' of a format is not known")
    for size in sizes.groups():
        if size and (len(size) > 4 or int(size) > _MAX_WIDTH):
            raise ModelError(f"a format of more than {_MAX_WIDTH} characters")
    if conversion is not None:
        value = _CONVERSIONS[conversion](value)
    return format(value, spec)


def _padding(name: str) -> Callable[..., str]:
    def pad(text: str, width: int, *fill: str) -> str:
        _check_length(width)
        return getattr(text, name)(width, *fill)

    return pad


_GROWING: Mapping[str, Callable[..., str]] = {
    "format": _format,
    "join": _join,
    "replace": _replace,
    **{name: _padding(name) for name in ("center", "ljust", "rjust", "zfill")},
}


def _check_length(length: int) -> None:
    if length > LETTERS:
        raise ModelError(f"a text of more than {LETTERS:,} characters")
