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
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from typing import Any, TypeAlias

from rnc_pin.errors import ModelError, nearest

LETTERS = 100_000
"""Largest number of characters of a text."""

ITEMS = 20_000
"""Largest number of items in a list or dictionary, nested items included; 16 characters count as one item."""

BITS = 4096
"""Largest number of bits of an integer."""

_MAX_STEPS = 1_000_000  # about two seconds

Value: TypeAlias = Any  # None, bool, int, float, str, list, tuple, dict, range, a Function or a Namespace


class Function:
    """Function that expressions may call. It computes a value and has no side effects.

    Args:
        run: implementation; it refuses arguments that would take too long.
        cost: steps of each call, in addition to those for its arguments.
    """

    def __init__(self, run: Callable[..., Value], *, cost: int = 1) -> None:
        self._run, self.cost = run, cost

    def __call__(self, *arguments: Value, **named: Value) -> Value:
        return self._run(*arguments, **named)


class Namespace:
    """Named values with attribute access: ``math.pi``."""

    def __init__(self, name: str, members: Mapping[str, Value]) -> None:
        self.name, self._members = name, members

    def member(self, name: str) -> Value:
        """Return a member; an unknown name raises NameError.

        Args:
            name: name of the member.
        """
        if name not in self._members:
            raise NameError(f"'{self.name}' has no '{name}'")
        return self._members[name]


class Budget:
    """Counter of evaluation steps that bounds the time for a file."""

    def __init__(self) -> None:
        self._left = _MAX_STEPS

    def spend(self, steps: int = 1) -> None:
        """Count steps; raise ModelError if they exceed the limit.

        Args:
            steps: number of steps.
        """
        self._left -= steps
        if self._left < 0:
            raise ModelError(f"takes more than {_MAX_STEPS:,} steps to expand")


def admit(value: Value) -> int:
    """Return the size of a value in items.

    Args:
        value: the value.

    Raises:
        ModelError: the value is too large, or its type is not allowed.
    """
    return _weight(value, 0)


def _weight(value: Value, depth: int) -> int:
    deepest = 50  # nested lists are visited by recursion
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
    elif isinstance(value, list | tuple | dict):
        if depth > deepest:
            raise ModelError(f"lists are nested more than {deepest} deep")
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


_MATH = (
    *("acos", "asin", "atan", "atan2", "ceil", "copysign", "cos", "cosh", "degrees", "exp", "fabs", "floor", "fmod"),
    *("hypot", "isclose", "isfinite", "isinf", "isnan", "log", "log10", "log2", "pow", "radians", "sin", "sinh"),
    *("sqrt", "tan", "tanh", "trunc"),
)

_TEXT_METHODS = (
    *("capitalize", "count", "endswith", "find", "index", "isdigit", "lower", "lstrip", "partition", "removeprefix"),
    *("removesuffix", "rfind", "rpartition", "rsplit", "rstrip", "split", "startswith", "strip", "title", "upper"),
)
_METHODS: Mapping[type, tuple[str, ...]] = {
    str: _TEXT_METHODS,
    list: ("count", "index"),
    tuple: ("count", "index"),
    dict: ("get",),
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
    number_kinds = (bool, int, float)
    if not all(isinstance(number, number_kinds) for number in (start, *numbers)):
        raise TypeError("sum() takes numbers")
    return sum(numbers, start)


def _listing(function: Callable[..., Iterable[Value]]) -> Callable[..., Value]:
    """Wrap a function so that it returns a list, not a generator."""
    return lambda *arguments: list(function(*arguments))


_FUNCTIONS: Mapping[str, Callable[..., Value]] = {
    "abs": abs,
    "all": all,
    "any": any,
    "enumerate": _listing(enumerate),
    "len": len,
    "max": max,
    "min": min,
    "range": _range,
    "reversed": _listing(reversed),
    "round": _round,
    "sorted": sorted,
    "sum": _sum,
    "zip": _listing(zip),
}
_KINDS: Mapping[str, type] = {each.__name__: each for each in (bool, dict, float, int, list, str, tuple)}


def builtins() -> dict[str, Value]:
    """Predefined names of ``${...}``; a new dictionary for each file."""
    python: dict[str, Value] = {name: Function(run) for name, run in _FUNCTIONS.items()}
    python |= {name: Function(kind) for name, kind in _KINDS.items()}
    mathematics = mathematical()
    known = {"math": Namespace("math", mathematics), "python": Namespace("python", python)}
    global_names = ("list", "dict", "len", "str", "float", "int", "bool", "min", "max", "round", "sorted", "range")
    return mathematics | {name: python[name] for name in global_names} | known


def mathematical() -> dict[str, Value]:
    """Functions and constants of ``math``, without functions whose result has no bounded length."""
    constants = {"e": math.e, "inf": math.inf, "nan": math.nan, "pi": math.pi, "tau": math.tau}
    return constants | {name: Function(getattr(math, name)) for name in _MATH}


def attribute(owner: Value, name: str) -> Value:
    """Return an attribute: a member of a namespace, a listed method, or an entry of a dictionary.

    Args:
        owner: value before the point.
        name: name after it.

    Raises:
        ModelError: the attribute does not exist, or could do more than compute a value.
        NameError: a namespace has no such member.
    """
    # Names with an underscore lead from any value to Python's internals.
    if not name.startswith("_"):
        if isinstance(owner, Namespace):
            return owner.member(name)
        method = _method(owner, name)
        if method is not None:
            return Function(method, cost=admit(owner))
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


def _zfill(text: str, width: int) -> str:
    _check_length(width)
    return text.zfill(width)


_GROWING: Mapping[str, Callable[..., str]] = {"join": _join, "replace": _replace, "zfill": _zfill}


def _check_length(length: int) -> None:
    if length > LETTERS:
        raise ModelError(f"a text of more than {LETTERS:,} characters")


# ---------------------------------------------------------------------- evaluation of the syntax tree


_BINARY: Mapping[type[ast.operator], Callable[[Value, Value], Value]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.FloorDiv: operator.floordiv,
    ast.Mod: operator.mod,
    ast.Pow: operator.pow,
}
_UNARY: Mapping[type[ast.unaryop], Callable[[Value], Value]] = {
    ast.UAdd: operator.pos,
    ast.USub: operator.neg,
    ast.Not: operator.not_,
}
_COMPARISONS: Mapping[type[ast.cmpop], Callable[[Value, Value], bool]] = {
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.Is: operator.is_,
    ast.IsNot: operator.is_not,
    ast.In: lambda one, many: one in many,
    ast.NotIn: lambda one, many: one not in many,
}
_UNBOUNDED_FIELD = re.compile(r"\*|\d{6}")  # in a text before %: a field of unbounded width


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
    except ModelError as error:
        raise ModelError(f"cannot evaluate '{shown}': {error}") from None
    except RecursionError:
        raise ModelError(f"cannot evaluate '{shown}': too deep") from None
    except (ArithmeticError, AttributeError, LookupError, MemoryError, NameError, TypeError, ValueError) as error:
        words = f"no key {error}" if isinstance(error, KeyError) else str(error) or type(error).__name__
        raise ModelError(f"cannot evaluate '{shown}': {words}") from None


class _Refusal(Exception):
    """Error for an expression that could do more than compute a value."""

    def __init__(self, words: str = "it could do more than compute a value") -> None:
        super().__init__(words)


class _Evaluation:
    """Evaluation of one expression."""

    def __init__(self, names: Mapping[str, Value], budget: Budget) -> None:
        self._names, self._budget = names, budget
        self._local: dict[str, Value] = {}

    def value(self, node: ast.expr) -> Value:
        """Return the value of a node; a kind of node without a method of its name is refused."""
        self._budget.spend()
        # A list of what is allowed, not of what is refused: a new kind of node in Python stays refused.
        compute: Callable[[ast.expr], Value] | None = getattr(self, f"visit_{type(node).__name__}", None)
        if compute is None:
            raise _Refusal
        return compute(node)

    def _made(self, value: Value) -> Value:
        """Return a new value after the check of its size."""
        self._budget.spend(admit(value))
        return value

    def visit_Constant(self, node: ast.Constant) -> Value:
        if not (node.value is None or isinstance(node.value, bool | int | float | str)):
            raise _Refusal
        return self._made(node.value)

    def visit_Name(self, node: ast.Name) -> Value:
        if node.id.startswith("__"):
            raise _Refusal
        if node.id in self._local:
            return self._local[node.id]
        if node.id not in self._names:
            raise ModelError(f"name '{node.id}' is not defined{_close(node.id, self._names)}")
        return self._names[node.id]

    def visit_List(self, node: ast.List) -> Value:
        return self._made([self.value(each) for each in node.elts])

    def visit_Tuple(self, node: ast.Tuple) -> Value:
        return self._made(tuple(self.value(each) for each in node.elts))

    def visit_Dict(self, node: ast.Dict) -> Value:
        if any(key is None for key in node.keys):
            raise _Refusal
        pairs = zip(node.keys, node.values, strict=True)
        return self._made({self.value(key): self.value(value) for key, value in pairs if key is not None})

    def visit_BinOp(self, node: ast.BinOp) -> Value:
        compute = _BINARY.get(type(node.op))
        if compute is None:
            raise _Refusal
        left, right = self.value(node.left), self.value(node.right)
        whole = isinstance(left, int) and isinstance(right, int)
        # Sizes are checked before they are computed: 9**9**9 would fill the memory.
        if isinstance(node.op, ast.Pow) and whole and left.bit_length() * right > BITS:
            raise _Refusal(f"a power of more than {BITS} bits")
        if isinstance(node.op, ast.Mult):
            _check_repetition(left, right)
        if isinstance(node.op, ast.Mod) and isinstance(left, str):
            if _UNBOUNDED_FIELD.search(left):
                raise _Refusal("a text field of unbounded width")
            self._budget.spend(left.count("%") * admit(right))
        return self._made(compute(left, right))

    def visit_UnaryOp(self, node: ast.UnaryOp) -> Value:
        compute = _UNARY.get(type(node.op))
        if compute is None:
            raise _Refusal
        return self._made(compute(self.value(node.operand)))

    def visit_BoolOp(self, node: ast.BoolOp) -> Value:
        stops = isinstance(node.op, ast.Or)
        result: Value = None
        for each in node.values:
            result = self.value(each)
            if bool(result) == stops:
                break
        return result

    def visit_Compare(self, node: ast.Compare) -> Value:
        left = self.value(node.left)
        for comparison, right_node in zip(node.ops, node.comparators, strict=True):
            right = self.value(right_node)
            self._budget.spend(min(admit(left), admit(right)))
            if not _COMPARISONS[type(comparison)](left, right):
                return False
            left = right
        return True

    def visit_IfExp(self, node: ast.IfExp) -> Value:
        return self.value(node.body if self.value(node.test) else node.orelse)

    def visit_Subscript(self, node: ast.Subscript) -> Value:
        owner = self.value(node.value)
        if isinstance(node.slice, ast.Slice):
            bounds = node.slice.lower, node.slice.upper, node.slice.step
            ends = [None if end is None else self.value(end) for end in bounds]
            return self._made(owner[slice(*ends)])
        key = self.value(node.slice)
        return owner.member(key) if isinstance(owner, Namespace) else owner[key]

    def visit_Attribute(self, node: ast.Attribute) -> Value:
        owner = self.value(node.value)
        try:
            return attribute(owner, node.attr)
        except ModelError as error:
            if "could do more" in str(error):
                raise _Refusal(str(error)) from None
            raise

    def visit_Call(self, node: ast.Call) -> Value:
        function = self.value(node.func)
        if not isinstance(function, Function):
            raise ModelError(f"a value of type {type(function).__name__} cannot be called")
        arguments = [self.value(each) for each in node.args]
        named = {}
        for keyword in node.keywords:
            # ** takes names from a value that this evaluator has not seen.
            if keyword.arg is None:
                raise _Refusal
            named[keyword.arg] = self.value(keyword.value)
        given = (*arguments, *named.values())
        # A function as an argument, e.g. a key of sorted(), would be called without being counted.
        if any(isinstance(each, Function) for each in given):
            raise _Refusal("a function as an argument")
        self._budget.spend(sum(map(admit, given)) + function.cost)
        return self._made(function(*arguments, **named))

    def visit_ListComp(self, node: ast.ListComp) -> Value:
        # Names of a comprehension end with it, as in Python.
        outside = dict(self._local)
        try:
            return self._made(list(self._each(node.elt, node.generators)))
        finally:
            self._local = outside

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
            self._local[target.id] = value
        elif isinstance(target, ast.Tuple | ast.List):
            for part, item in zip(target.elts, value, strict=True):
                self._assign(part, item)
        else:
            raise _Refusal


def _check_repetition(left: Value, right: Value) -> None:
    for one, times in ((left, right), (right, left)):
        if not isinstance(times, int):
            continue
        if isinstance(one, str) and len(one) * times > LETTERS:
            raise _Refusal(f"a text of more than {LETTERS:,} characters")
        if isinstance(one, list | tuple) and admit(one) * times > ITEMS:
            raise _Refusal(f"a list of more than {ITEMS:,} items")


def _close(name: str, names: Mapping[str, Value]) -> str:
    hint = nearest(name, [each for each in names if isinstance(each, str)])
    return hint if "did you mean" in hint else ""
