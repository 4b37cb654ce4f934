"""Types and size limits of the values in xacro expressions; no value gives access to objects of this process."""

from __future__ import annotations

from collections.abc import Callable, Mapping
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
