"""Symbols that record arithmetic: derivatives of a formula, and C that computes it.

A formula of plain arithmetic that gets symbols gives a graph without repeated parts. Rates go forward through the graph
and gradients go back, so that they cost little more than the formula itself. (Expressions of a computer algebra system
grow with each derivative.)
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import ClassVar, TypeAlias

import numpy as np

Operand: TypeAlias = "Symbol | float"


class Symbol:
    """Number in a formula: an input, or the result of an operation.

    Attributes:
        operation: "+", "*", "-" (the opposite), "/" (the reciprocal), "sqrt"; else the C of an input or a number.
        operands: its operands.
        number: place in the order in which symbols were made.
    """

    __slots__ = ("number", "operands", "operation")
    _known: ClassVar[dict[tuple[str, tuple[int, ...]], Symbol]] = {}

    operation: str
    operands: tuple[Symbol, ...]
    number: int

    def __new__(cls, operation: str, *operands: Symbol) -> Symbol:
        """Return the one symbol of an operation on these operands."""
        if operation in "+*":
            operands = tuple(sorted(operands, key=lambda each: each.number))
        key = operation, tuple(each.number for each in operands)
        if key not in cls._known:
            made = super().__new__(cls)
            made.operation, made.operands, made.number = operation, operands, len(cls._known)
            cls._known[key] = made
        return cls._known[key]

    def __add__(self, other: Operand) -> Symbol:
        if isinstance(other, np.ndarray):
            return NotImplemented  # an array of symbols
        other = symbol(other)
        if ZERO in (self, other):
            return self if other is ZERO else other
        if other is self:
            return 2.0 * self
        return Symbol("+", self, other)

    def __neg__(self) -> Symbol:
        if self is ZERO:
            return ZERO
        return self.operands[0] if self.operation == "-" else Symbol("-", self)

    def __sub__(self, other: Operand) -> Symbol:
        return self + -symbol(other)

    def __rsub__(self, other: Operand) -> Symbol:
        return symbol(other) - self

    def __mul__(self, other: Operand) -> Symbol:
        if isinstance(other, np.ndarray):
            return NotImplemented  # an array of symbols
        other = symbol(other)
        if ZERO in (self, other):
            return ZERO
        if ONE in (self, other):
            return other if self is ONE else self
        for one, two in ((self, other), (other, self)):
            if one.operation == "-":
                return -(one.operands[0] * two)
        return Symbol("*", self, other)

    def __truediv__(self, other: Operand) -> Symbol:
        return self * symbol(other) ** -1

    def __rtruediv__(self, other: Operand) -> Symbol:
        return symbol(other) / self

    def __pow__(self, exponent: float) -> Symbol:
        if exponent not in (-1, 0.5):
            raise ValueError(f"power {exponent} of a symbol: expected -1 or 0.5")
        return Symbol("/" if exponent == -1 else "sqrt", self)

    __radd__, __rmul__ = __add__, __mul__


def symbol(value: Operand) -> Symbol:
    """Symbol of a number."""
    return value if isinstance(value, Symbol) else Symbol(repr(float(value)))


ZERO, ONE = symbol(0.0), symbol(1.0)


def forget() -> None:
    """Forget all symbols but zero and one: what follows does not depend on what was before."""
    Symbol._known = {(each.operation, ()): each for each in (ZERO, ONE)}


def inputs(array: str, size: int) -> list[Symbol]:
    """Entries of an array that the C function gets."""
    return [Symbol(f"{array}[{i}]") for i in range(size)]


def total(terms: Iterable[Operand]) -> Symbol:
    """Sum of terms."""
    return sum(map(symbol, terms), ZERO)


def ordered(formulas: Iterable[Symbol]) -> list[Symbol]:
    """All symbols of formulas, each after its operands."""
    found: dict[Symbol, None] = {}

    def visit(each: Symbol) -> None:
        if each not in found:
            for operand in each.operands:
                visit(operand)
            found[each] = None

    for formula in formulas:
        visit(formula)
    return list(found)


def _partials(of: Symbol) -> list[Symbol]:
    """Derivatives of an operation by its operands."""
    match of.operation:
        case "+":
            return [ONE, ONE]
        case "-":
            return [-ONE]
        case "*":
            return list(reversed(of.operands))
        case "/":
            return [-(of * of)]
        case "sqrt":
            return [0.5 * of**-1]
    return []


def rate(formula: Symbol, rates: dict[Symbol, Symbol]) -> Symbol:
    """Rate of a formula for rates of its inputs."""
    found: dict[Symbol, Symbol] = {}
    for each in ordered([formula]):
        parts = zip(_partials(each), each.operands, strict=True)
        found[each] = rates.get(each, total(partial * found[operand] for partial, operand in parts))
    return found[formula]


def gradient(formula: Symbol, by: Sequence[Symbol]) -> list[Symbol]:
    """Derivatives of a formula by inputs."""
    found = {formula: ONE}
    for each in reversed(ordered([formula])):
        for partial, operand in zip(_partials(each), each.operands, strict=True):
            found[operand] = found.get(operand, ZERO) + found.get(each, ZERO) * partial
    return [found.get(each, ZERO) for each in by]


def c_statements(outputs: dict[str, Symbol]) -> list[str]:
    """C statements that compute outputs; parts that are used more than once have names.

    Args:
        outputs: formulas by what stands before them, such as "x =" or "return".
    """
    symbols, uses = ordered(outputs.values()), dict[Symbol, int]()
    for each in (*(operand for of in symbols for operand in of.operands), *outputs.values()):
        uses[each] = uses.get(each, 0) + 1
    lines: list[str] = []
    written: dict[Symbol, str] = {}
    for each in symbols:
        text = _c(each, [written[operand] for operand in each.operands])
        if each.operands and uses[each] > 1:
            name = f"x{len(lines)}"
            lines.append(f"{name} = {text},")
            text = name
        written[each] = text
    if lines:  # of one declaration
        lines[-1] = f"{lines[-1][:-1]};"
        lines[0] = f"const double {lines[0]}"
    return [*lines, *(f"{out} {written[each]};" for out, each in outputs.items())]


def _c(of: Symbol, operands: Sequence[str]) -> str:
    """Expression of an operation, which binds as tightly as a factor, or a sum."""
    match of.operation:
        case "+":
            left, right = sorted(operands, key=lambda text: text.startswith("-"))
            return f"{left} - {right[1:]}" if right.startswith("-") else f"{left} + {right}"
        case "-":
            return f"-{_factor(operands[0], of.operands[0])}"
        case "*":
            return " * ".join(_factor(*both) for both in zip(operands, of.operands, strict=True))
        case "/":
            return f"1.0 / {_factor(operands[0], of.operands[0], tight=True)}"
        case "sqrt":
            return f"sqrt({operands[0]})"
    return of.operation


def _factor(text: str, of: Symbol, tight: bool = False) -> str:
    loose = of.operation in "+-/" or (tight and of.operation == "*")
    return f"({text})" if (loose and " " in text) or text.startswith("-") else text
