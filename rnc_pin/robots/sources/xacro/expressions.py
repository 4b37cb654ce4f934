"""Evaluation of xacro expressions over their syntax tree, limited to the operations in this file.

Expressions use Python syntax. Allowed are numbers, text, lists, tuples, dictionaries and sets, arithmetic, comparisons,
conditions, subscripts, list comprehensions, and calls of the functions and methods of ``functions``. Everything else is
refused. Python's own ``eval`` is never used, and the size of every value is bounded.
"""

from __future__ import annotations

import ast
import operator
import re
from collections.abc import Callable, Iterator, Mapping

from rnc_pin.errors import ModelError, nearest
from rnc_pin.robots.sources.xacro.functions import (
    BITS,
    ITEMS,
    LETTERS,
    Budget,
    Function,
    Namespace,
    Value,
    admit,
    attribute,
)

_MAX_CHARACTERS = 4000
_BINARY: Mapping[type[ast.operator], Callable[[Value, Value], Value]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.FloorDiv: operator.floordiv,
    ast.Mod: operator.mod,
    ast.Pow: operator.pow,
    ast.BitAnd: operator.and_,
    ast.BitOr: operator.or_,
    ast.BitXor: operator.xor,
    ast.RShift: operator.rshift,
}
_UNARY: Mapping[type[ast.unaryop], Callable[[Value], Value]] = {
    ast.UAdd: operator.pos,
    ast.USub: operator.neg,
    ast.Not: operator.not_,
    ast.Invert: operator.invert,
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
    if len(text) > _MAX_CHARACTERS:
        raise ModelError(f"an expression of more than {_MAX_CHARACTERS} characters: '{shown}'")
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

    def _items(self, nodes: list[ast.expr]) -> Iterator[Value]:
        for node in nodes:
            if isinstance(node, ast.Starred):
                yield from self.value(node.value)
            else:
                yield self.value(node)

    def visit_List(self, node: ast.List) -> Value:
        return self._made(list(self._items(node.elts)))

    def visit_Tuple(self, node: ast.Tuple) -> Value:
        return self._made(tuple(self._items(node.elts)))

    def visit_Set(self, node: ast.Set) -> Value:
        return self._made(set(self._items(node.elts)))

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
        return self._made(_UNARY[type(node.op)](self.value(node.operand)))

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
        arguments = list(self._items(node.args))
        named = {}
        for keyword in node.keywords:
            if keyword.arg is None:
                raise _Refusal
            named[keyword.arg] = self.value(keyword.value)
        given = (*arguments, *named.values())
        called = [each for each in given if isinstance(each, Function)]
        if any(each.higher for each in called):
            raise _Refusal
        self._budget.spend(max((each.cost for each in called), default=1) * sum(map(admit, given)) + function.cost)
        return self._made(function(*arguments, **named))

    def visit_ListComp(self, node: ast.ListComp) -> Value:
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
