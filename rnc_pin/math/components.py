"""Component formulas that serve one state and many states, and their derivatives.

The components of one vector are Python numbers. The components of a stack of vectors are arrays. The arithmetic is the
same for both, and a single state avoids the cost of arrays with one entry. Dual numbers differentiate a formula.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias, TypeVar

import numpy as np

Component: TypeAlias = "float | np.ndarray"
Entry: TypeAlias = "float | np.ndarray | Dual"
_E = TypeVar("_E", "float | np.ndarray", "float | np.ndarray | Dual")


class Dual:
    """Number ``value + slope e`` with ``e * e = 0``: a value and its derivative along one direction.

    Both may be complex, so that the complex step differentiates a derivative once more.
    """

    __slots__ = ("slope", "value")
    __array_ufunc__ = None  # an array times a dual number is a dual number

    def __init__(self, value: Component, slope: Component) -> None:
        self.value, self.slope = value, slope

    def __add__(self, other: Entry) -> Dual:
        if isinstance(other, Dual):
            return Dual(self.value + other.value, self.slope + other.slope)
        return Dual(self.value + other, self.slope)

    def __neg__(self) -> Dual:
        return Dual(-self.value, -self.slope)

    def __sub__(self, other: Entry) -> Dual:
        return self + -other

    def __rsub__(self, other: Component) -> Dual:
        return -self + other

    def __mul__(self, other: Entry) -> Dual:
        if isinstance(other, Dual):
            return Dual(self.value * other.value, self.slope * other.value + self.value * other.slope)
        return Dual(self.value * other, self.slope * other)

    def __truediv__(self, other: Entry) -> Dual:
        if isinstance(other, Dual):
            ratio = self.value / other.value
            return Dual(ratio, (self.slope - ratio * other.slope) / other.value)
        return Dual(self.value / other, self.slope / other)

    def __rtruediv__(self, other: Component) -> Dual:
        return self**-1 * other

    def __pow__(self, exponent: float) -> Dual:
        return Dual(self.value**exponent, exponent * self.value ** (exponent - 1) * self.slope)

    __radd__, __rmul__ = __add__, __mul__


def components(vectors: np.ndarray) -> Sequence[Component]:
    """Entries of a vector (k,) as numbers, or entries of vectors (..., k) as one array (...) each."""
    if vectors.ndim == 1:
        entries: Sequence[Component] = vectors.tolist()
        return entries
    return [vectors[..., k] for k in range(vectors.shape[-1])]


def packed(rows: Sequence[Sequence[Component]], like: Component) -> np.ndarray:
    """Matrix (..., k, l) of components. A component that is a number is equal in the whole stack.

    Args:
        rows: k times l components.
        like: one of the components; it is an array if there are many states.
    """
    if not isinstance(like, np.ndarray):
        return np.array(rows)
    out = np.empty((*like.shape, len(rows), len(rows[0])), like.dtype)
    for i, row in enumerate(rows):
        for j, entry in enumerate(row):
            out[..., i, j] = entry
    return out


def packed_vector(entries: Sequence[Component], like: Component) -> np.ndarray:
    """Vector (..., k) of components."""
    return np.array(entries) if not isinstance(like, np.ndarray) else np.stack(entries, axis=-1)


def cross(a: Sequence[_E], b: Sequence[_E]) -> tuple[_E, _E, _E]:
    """Vector product of two triples of components."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def dot(a: Sequence[_E], b: Sequence[_E]) -> _E:
    """Scalar product of two triples of components."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def smallest(value: Component) -> float:
    """Smallest entry of a component over all states; infinite if there are no states."""
    return float(value.min(initial=np.inf)) if isinstance(value, np.ndarray) else value
