"""Values, functions and evaluation of xacro expressions, limited to the operations in this file, with bounded sizes.

Expressions use Python syntax. Allowed are numbers, text, lists, tuples and dictionaries, arithmetic, comparisons,
conditions, subscripts, list comprehensions, and calls of the functions and methods below. Everything else is refused.
Python's own ``eval`` is never used.
"""

from __future__ import annotations

import ast
import math
import operator
import re
from collections import ChainMap
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from itertools import chain
from typing import Any, TypeAlias

from rnc_pin.errors import ModelError, closest

LETTERS = 100_000
"""Largest number of characters of a text."""

ITEMS = 20_000
"""Largest number of items in a list or dictionary, nested items included; 16 characters count as one item."""

BITS = 4096
"""Largest number of bits of an integer."""

Value: TypeAlias = Any  # None, bool, int, float, str, list, tuple, dict, range, a Function or a Namespace


@dataclass(frozen=True, eq=False)
class Function:
    """Function that expressions may call. It computes a value and has no side effects.

    Attributes:
        run: implementation; it refuses arguments that would take too long.
    """

    run: Callable[..., Value]


@dataclass(frozen=True, eq=False)
class Namespace:
    """Named values with attribute access: ``math.pi``."""

    name: str
    members: Mapping[str, Value]

    def member(self, name: str) -> Value:
        """Return a member; an unknown name raises NameError.

        Args:
            name: name of the member.
        """
        if name not in self.members:
            raise NameError(f"'{self.name}' has no '{name}'")
        return self.members[name]


class Budget:
    """Counter of evaluation steps that bounds the time for a file."""

    def __init__(self) -> None:
        self._most = self._left = 1_000_000  # steps, about two seconds

    def spend(self, steps: int = 1) -> None:
        """Count steps; raise ModelError if they exceed the limit.

        Args:
            steps: number of steps.
        """
        self._left -= steps
        if self._left < 0:
            raise ModelError(f"takes more than {self._most:,} steps to expand")


def admit(value: Value, depth: int = 0) -> int:
    """Return the size of a value in items.

    Args:
        value: the value.
        depth: number of lists around it.

    Raises:
        ModelError: the value is too large, or its type is not allowed.
    """
    deepest = 50  # nested lists are visited by recursion
    weight = 1
    match value:
        case None | bool() | float() | Function() | Namespace():
            pass
        case int():
            if value.bit_length() > BITS:
                raise ModelError(f"a whole number of more than {BITS} bits")
        case str():
            check_length(len(value))
            weight += len(value) // 16
        case range():
            weight = len(value)
        case list() | tuple() | dict():
            if depth > deepest:
                raise ModelError(f"lists are nested more than {deepest} deep")
            for item in chain.from_iterable(value.items()) if isinstance(value, dict) else value:
                weight += admit(item, depth + 1)
                # Before the next item: a list of long lists would be walked to its end.
                if weight > ITEMS:
                    break
        case _:
            raise ModelError(f"a value of type {type(value).__name__}")
    if weight > ITEMS:
        raise ModelError(f"a list of more than {ITEMS:,} items")
    return weight


def check_length(length: int) -> None:
    """Raise ModelError for a text of more than ``LETTERS`` characters.

    Args:
        length: number of characters.
    """
    if length > LETTERS:
        raise ModelError(f"a text of more than {LETTERS:,} characters")


# ---------------------------------------------------------------------- functions and methods


def _round(number: float, ndigits: int | None = None) -> float:
    # Python computes ten to that power, which takes as long as its digits are many.
    if ndigits is not None and abs(ndigits) > 400:
        raise ModelError("rounds to more than 400 digits")
    return round(number, ndigits)


def _sum(items: Iterable[Value], start: float = 0) -> Value:
    # A sum of lists copies all of them for each item.
    if not all(isinstance(number, int | float) for number in (start, *items)):
        raise TypeError("sum() takes numbers")
    return sum(items, start)


def _listing(function: Callable[..., Iterable[Value]]) -> Callable[..., Value]:
    """Wrap a function so that it returns a list, not a generator, whose items nobody would count."""
    return lambda *arguments: list(function(*arguments))


def _join(separator: str, items: Iterable[str]) -> str:
    parts = list(items)
    check_length(len(separator) * len(parts) + sum(len(part) for part in parts))
    return separator.join(parts)


def _replace(text: str, old: str, new: str, count: int = -1) -> str:
    check_length(len(text) + text.count(old) * len(new))
    return text.replace(old, new, count)


def _zfill(text: str, width: int) -> str:
    check_length(width)
    return text.zfill(width)


_PLAIN: tuple[Callable[..., Value], ...] = (
    *(abs, all, any, bool, dict, float, int, len, list, max, min, range, sorted, str, tuple),
)
_FUNCTIONS = {each.__name__: each for each in _PLAIN} | {"round": _round, "sum": _sum}
_FUNCTIONS |= {each.__name__: _listing(each) for each in (enumerate, reversed, zip)}

_MATH = (
    *("acos", "asin", "atan", "atan2", "ceil", "copysign", "cos", "cosh", "degrees", "exp", "fabs", "floor", "fmod"),
    *("hypot", "isclose", "isfinite", "isinf", "isnan", "log", "log10", "log2", "pow", "radians", "sin", "sinh"),
    *("sqrt", "tan", "tanh", "trunc"),
)
_TEXT_METHODS = (
    *("capitalize", "count", "endswith", "find", "index", "isdigit", "lower", "lstrip", "partition", "removeprefix"),
    *("removesuffix", "rfind", "rpartition", "rsplit", "rstrip", "split", "startswith", "strip", "title", "upper"),
)
_METHODS: Mapping[type, Mapping[str, Callable[..., Value]]] = {
    str: {name: getattr(str, name) for name in _TEXT_METHODS} | {"join": _join, "replace": _replace, "zfill": _zfill},
    list: {"count": list.count, "index": list.index},
    tuple: {"count": tuple.count, "index": tuple.index},
    dict: {"get": dict.get} | {each.__name__: _listing(each) for each in (dict.items, dict.keys, dict.values)},
}


MATHEMATICAL: Mapping[str, Value] = {
    "e": math.e,
    "inf": math.inf,
    "nan": math.nan,
    "pi": math.pi,
    "tau": math.tau,
    **{name: Function(getattr(math, name)) for name in _MATH},
}
"""Functions and constants of ``math``, without functions whose result has no bounded length."""

_PYTHON = {name: Function(run) for name, run in _FUNCTIONS.items()}
_GLOBAL = ("list", "dict", "len", "str", "float", "int", "bool", "min", "max", "round", "sorted", "range")

BUILTINS: Mapping[str, Value] = {
    **MATHEMATICAL,
    **{name: _PYTHON[name] for name in _GLOBAL},
    "math": Namespace("math", MATHEMATICAL),
    "python": Namespace("python", _PYTHON),
}
"""Predefined names of ``${...}``."""


# ---------------------------------------------------------------------- evaluation of the syntax tree


class _Refusal(ModelError):
    """Error for an expression that could do more than compute a value."""


_MORE = "it could do more than compute a value"
_FAULTS = (ArithmeticError, AttributeError, LookupError, MemoryError, NameError, RecursionError, TypeError, ValueError)


# Sizes are checked before they are computed: 9**9**9 would fill the memory.
def _power(base: Value, exponent: Value) -> Value:
    if isinstance(base, int) and isinstance(exponent, int) and base.bit_length() * exponent > BITS:
        raise _Refusal(f"a power of more than {BITS} bits")
    return base**exponent


def _product(left: Value, right: Value) -> Value:
    for one, times in ((left, right), (right, left)):
        if isinstance(one, str | list | tuple) and isinstance(times, int) and admit(one) * times > ITEMS:
            raise _Refusal(f"a list of more than {ITEMS:,} items, or a text of that size")
    return left * right


def _modulo(left: Value, right: Value) -> Value:
    # Each field of a text can hold the whole value.
    if isinstance(left, str) and (re.search(r"\*|\d{6}", left) or left.count("%") * admit(right) > ITEMS):
        raise _Refusal("text fields of unbounded width")
    return left % right


_OPERATORS: Mapping[type[ast.AST], Callable[..., Value]] = {
    ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: _product, ast.Div: operator.truediv,
    ast.FloorDiv: operator.floordiv, ast.Mod: _modulo, ast.Pow: _power,
    ast.UAdd: operator.pos, ast.USub: operator.neg, ast.Not: operator.not_,
    ast.Eq: operator.eq, ast.NotEq: operator.ne, ast.Lt: operator.lt, ast.LtE: operator.le, ast.Gt: operator.gt,
    ast.GtE: operator.ge, ast.Is: operator.is_, ast.IsNot: operator.is_not,
    ast.In: lambda one, many: one in many, ast.NotIn: lambda one, many: one not in many,
}  # fmt: skip


def evaluate(text: str, names: Mapping[str, Value], budget: Budget | None = None) -> Value:
    """Return the value of an expression.

    Args:
        text: the expression.
        names: name to value.
        budget: remaining steps for the file.

    Raises:
        ModelError: the expression is invalid, could do more than compute a value, takes too many steps, or fails.
    """
    shown = text if len(text) <= 80 else f"{text[:77]}..."
    most_characters = 4000  # bounds the parser of Python, which is not counted in steps
    if len(text) > most_characters:
        raise ModelError(f"an expression of more than {most_characters} characters: '{shown}'")
    try:
        tree = ast.parse(text.strip(), mode="eval")
    except (SyntaxError, ValueError, MemoryError, RecursionError):
        raise ModelError(f"'{shown}' is not an expression") from None
    try:
        return _Evaluation(names, budget or Budget()).value(tree.body)
    except _Refusal as refusal:
        raise ModelError(f"refuses to evaluate '{shown}': {refusal}") from None
    except KeyError as error:
        raise ModelError(f"cannot evaluate '{shown}': no key {error}") from None
    except (ModelError, *_FAULTS) as error:
        raise ModelError(f"cannot evaluate '{shown}': {str(error) or type(error).__name__}") from None


class _Evaluation:
    """Evaluation of one expression, or of a comprehension in it."""

    def __init__(self, names: Mapping[str, Value], budget: Budget) -> None:
        # Names of a comprehension end with it, as in Python.
        self._names, self._budget = ChainMap(dict[str, Value](), names), budget  # type: ignore[arg-type]

    def value(self, node: ast.expr) -> Value:
        """Return the value of a node."""
        self._budget.spend()
        match node:
            case ast.Constant(value=None | bool() | int() | float() | str()):
                return self._made(node.value)
            case ast.Name() if not node.id.startswith("__"):
                return self._named(node.id)
            case ast.List():
                return self._made([self.value(each) for each in node.elts])
            case ast.Tuple():
                return self._made(tuple(self.value(each) for each in node.elts))
            case ast.Dict() if None not in node.keys:  # without **, which copies what nobody has counted
                keys = [self.value(each) for each in node.keys if each is not None]
                return self._made(dict(zip(keys, map(self.value, node.values), strict=True)))
            case ast.UnaryOp() if type(node.op) in _OPERATORS:
                return self._made(_OPERATORS[type(node.op)](self.value(node.operand)))
            case ast.BinOp() if type(node.op) in _OPERATORS:
                return self._made(_OPERATORS[type(node.op)](self.value(node.left), self.value(node.right)))
            case ast.BoolOp():
                return self._boolean(node)
            case ast.Compare():
                return self._compared(node)
            case ast.IfExp():
                return self.value(node.body if self.value(node.test) else node.orelse)
            case ast.Subscript():
                return self._item(self.value(node.value), node.slice)
            case ast.Attribute():
                return self._attribute(self.value(node.value), node.attr)
            case ast.Call():
                return self._called(node)
            case ast.ListComp():
                inner = _Evaluation(self._names, self._budget)
                return self._made(list(inner._each(node.elt, node.generators)))
        # This is a list of what is allowed, not of what is refused: a new kind of node in Python stays refused.
        raise _Refusal(_MORE)

    def _made(self, value: Value) -> Value:
        """Return a new value after the check of its size."""
        self._budget.spend(admit(value))
        return value

    def _named(self, name: str) -> Value:
        if name not in self._names:
            close = closest(name, map(str, self._names))
            raise ModelError(f"name '{name}' is not defined" + (f"; did you mean '{close}'?" if close else ""))
        return self._names[name]

    def _boolean(self, node: ast.BoolOp) -> Value:
        result: Value = None
        for each in node.values:
            result = self.value(each)
            if bool(result) == isinstance(node.op, ast.Or):
                break
        return result

    def _compared(self, node: ast.Compare) -> bool:
        left = self.value(node.left)
        for comparison, right_node in zip(node.ops, node.comparators, strict=True):
            right = self.value(right_node)
            # Equal lists are compared to the end of the shorter one.
            self._budget.spend(min(admit(left), admit(right)))
            if not _OPERATORS[type(comparison)](left, right):
                return False
            left = right
        return True

    def _item(self, owner: Value, place: ast.expr) -> Value:
        if isinstance(place, ast.Slice):
            ends = [None if end is None else self.value(end) for end in (place.lower, place.upper, place.step)]
            return self._made(owner[slice(*ends)])
        key = self.value(place)
        return owner.member(key) if isinstance(owner, Namespace) else owner[key]

    def _attribute(self, owner: Value, name: str) -> Value:
        """Member of a namespace, listed method, or entry of a dictionary."""
        # Names with an underscore lead from any value to Python's internals.
        if not name.startswith("_"):
            if isinstance(owner, Namespace):
                return owner.member(name)
            if name in _METHODS.get(type(owner), ()):
                self._budget.spend(admit(owner))
                return Function(partial(_METHODS[type(owner)][name], owner))
            if isinstance(owner, dict) and name in owner:
                return owner[name]
            if isinstance(owner, dict):
                raise ModelError(f"the dictionary has no key '{name}'")
        raise _Refusal(f"attribute '{name}' could do more than compute a value")

    def _called(self, node: ast.Call) -> Value:
        function = self.value(node.func)
        if not isinstance(function, Function):
            raise ModelError(f"a value of type {type(function).__name__} cannot be called")
        # ** takes names from a value that this evaluator has not seen.
        if any(keyword.arg is None for keyword in node.keywords):
            raise _Refusal(_MORE)
        arguments = [self.value(each) for each in node.args]
        named = {str(keyword.arg): self.value(keyword.value) for keyword in node.keywords}
        given = (*arguments, *named.values())
        # A function as an argument, e.g. a key of sorted(), would be called without being counted.
        if any(isinstance(each, Function) for each in given):
            raise _Refusal("a function as an argument")
        self._budget.spend(1 + sum(map(admit, given)))
        return self._made(function.run(*arguments, **named))

    def _each(self, element: ast.expr, generators: list[ast.comprehension]) -> Iterator[Value]:
        if not generators:
            yield self.value(element)
            return
        first, *others = generators
        items = self.value(first.iter)
        # Before the loop: nested comprehensions over long lists end by the budget.
        self._budget.spend(admit(items))
        for item in items:
            self._assign(first.target, item)
            if all(self.value(condition) for condition in first.ifs):
                yield from self._each(element, others)

    def _assign(self, target: ast.expr, value: Value) -> None:
        if isinstance(target, ast.Name) and not target.id.startswith("__"):
            self._names[target.id] = value
        elif isinstance(target, ast.Tuple | ast.List):
            for part, item in zip(target.elts, value, strict=True):
                self._assign(part, item)
        else:
            raise _Refusal(_MORE)
