"""Small dense solves, and formulas of components, over leading batch axes; fast for a single state.

A single state calls the compiled kernel: for small matrices, NumPy's wrapper costs several times the factorisation.
A stack uses NumPy's batched routines. The algorithm is the same.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import lru_cache
from typing import TypeAlias, TypeVar

import numpy as np

from rnc_pin import _kernel


def apply(matrix: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """``matrix @ vector`` for (..., n, k) and (..., k).

    Args:
        matrix: (..., n, k).
        vector: (..., k); its leading axes follow the rules of broadcasting.
    """
    if vector.ndim == 1:
        return matrix.dot(vector)
    return np.matvec(matrix, vector)


def apply_transposed(matrix: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """``matrix^T @ vector`` for (..., n, k) and (..., n), without conjugation.

    Args:
        matrix: (..., n, k).
        vector: (..., n), real or complex.
    """
    if vector.ndim == 1:
        return vector.dot(matrix)
    return np.vecmat(vector.conj(), matrix)  # it conjugates the vector


def as_slice(places: np.ndarray) -> np.ndarray | slice:
    """Slice of places that follow each other, which selects without a copy; other places (k,) as they are.

    Args:
        places: indices (k,), in any order.
    """
    first = int(places[0]) if len(places) else 0
    return slice(first, first + len(places)) if np.array_equal(places, first + np.arange(len(places))) else places


def clipped(values: np.ndarray, limits: np.ndarray | float) -> np.ndarray:
    """Values (...) within -limits and limits; for few numbers this is faster than ``numpy.clip``.

    Args:
        values: (...).
        limits: largest magnitudes, a number or (...); not negative.
    """
    return np.minimum(np.maximum(values, -limits), limits)


def inverse(matrix: np.ndarray) -> np.ndarray:
    """Inverse of (..., n, n); NaN for matrices that are exactly singular.

    The inverse of a single matrix is stored by columns, so that a block of columns is contiguous.

    Args:
        matrix: (..., n, n).
    """
    if matrix.ndim > 2:
        return _each_solved(matrix, _unit(matrix.shape[-1]))
    found = np.empty(matrix.shape)
    if not _kernel.library.solve(np.ascontiguousarray(matrix), _unit(len(matrix)), 0.0, found):
        found = _each_solved(matrix, _unit(len(matrix)))
    return np.asfortranarray(found)


@lru_cache
def _unit(n: int) -> np.ndarray:
    return np.eye(n)


def solve(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solve ``matrix @ x = right`` for (..., n, n) and (..., n); NaN for matrices that are exactly singular.

    Args:
        matrix: (..., n, n).
        right: right sides (..., n).
    """
    if matrix.ndim == 2 and right.ndim == 1:
        found = np.empty(right.shape)
        if _kernel.library.solve(np.ascontiguousarray(matrix), np.ascontiguousarray(right), 0.0, found):
            return found
    return _each_solved(matrix, right[..., None])[..., 0]


def solve_positive_definite(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solve ``matrix @ x = right`` for symmetric positive definite (..., n, n) and (..., n).

    The solution is NaN if one matrix is not positive definite, or if one of a stack is singular.

    Args:
        matrix: (..., n, n).
        right: right sides (..., n).
    """
    if matrix.ndim == 2 and right.ndim < 3:
        found = np.empty(right.T.shape)
        if _kernel.library.solve(np.ascontiguousarray(matrix), np.ascontiguousarray(right.T), 1.0, found):
            return found.T
        try:
            np.linalg.cholesky(matrix)
            return np.linalg.solve(matrix, right.T).T
        except np.linalg.LinAlgError:
            return np.full(right.shape, np.nan)
    return _each_solved(matrix, right[..., None])[..., 0]


def _each_solved(matrix: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Solutions (..., n, k) of many systems, by one call; NaN takes the place of solutions that do not exist."""
    try:
        return np.linalg.solve(matrix, columns)
    except np.linalg.LinAlgError:  # one singular matrix fails the whole call
        batch = np.broadcast_shapes(matrix.shape[:-2], columns.shape[:-2])
        found = np.full((*batch, *columns.shape[-2:]), np.nan)
        matrices, right = np.broadcast_to(matrix, (*batch, *matrix.shape[-2:])), np.broadcast_to(columns, found.shape)
        for i in np.ndindex(batch):
            with suppress(np.linalg.LinAlgError):
                found[i] = np.linalg.solve(matrices[i], right[i])
        return found


def product(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """``left @ right`` for (..., n, k) and (..., k, l).

    Args:
        left: (..., n, k).
        right: (..., k, l).
    """
    if left.ndim == right.ndim == 2:
        return left.dot(right)
    return left @ right


def vector_product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Vector product (..., 3); of two vectors without the overhead of NumPy's.

    Args:
        a: first factor (..., 3).
        b: second factor (..., 3).
    """
    return np.array(cross(a.tolist(), b.tolist())) if a.ndim == b.ndim == 1 else np.cross(a, b)


def null_space(matrix: np.ndarray, tolerance: float | None = None) -> np.ndarray:
    """Orthonormal basis (n, n - rank) of the null space of (m, n), which may have no rows.

    Args:
        matrix: (m, n).
        tolerance: singular value that counts as zero, relative to the largest; rounding by default.
    """
    if not len(matrix):
        return np.eye(matrix.shape[1])
    _, values, right = np.linalg.svd(matrix)
    # The limit of numpy.linalg.matrix_rank: a smaller singular value is rounding of the matrix's entries.
    share = np.finfo(float).eps * max(matrix.shape) if tolerance is None else tolerance
    return right[int((values > share * values.max(initial=0.0)).sum()) :].T


def pivot_columns(matrix: np.ndarray, count: int) -> tuple[list[int], np.ndarray]:
    """Columns of (m, n) that column-pivoted QR takes first, and the sizes of their pivots, (count,) each.

    Args:
        matrix: (m, n); it is not changed.
        count: number of columns to take, at most n.
    """
    rest, chosen, sizes = np.array(matrix, dtype=float), list[int](), np.zeros(count)
    for k in range(count):
        lengths = np.linalg.norm(rest, axis=0)
        # Rounding leaves a rest of a column that was taken: it must not be taken again.
        lengths[chosen] = -1.0
        best = int(np.argmax(lengths))
        chosen.append(best)
        sizes[k] = lengths[best]
        if sizes[k] > 0:
            direction = rest[:, best] / sizes[k]
            rest -= np.outer(direction, direction @ rest)
    return chosen, sizes


def unit_rows(matrix: np.ndarray) -> np.ndarray:
    """Matrix with every nonzero row scaled to unit length.

    Args:
        matrix: (..., n, k).
    """
    lengths = np.linalg.norm(matrix, axis=-1, keepdims=True)
    return matrix / np.where(lengths > 0, lengths, 1.0)


def unit_diagonal(matrix: np.ndarray) -> np.ndarray:
    """Symmetric matrix (..., n, n) with positive diagonal, scaled from both sides to a unit diagonal.

    Args:
        matrix: (..., n, n).
    """
    sizes = np.sqrt(np.diagonal(matrix, axis1=-2, axis2=-1))
    return matrix / (sizes[..., :, None] * sizes[..., None, :])


def complex_step(function: Callable[..., np.ndarray], *parts: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Derivative (k, n) of a closed formula by the complex step, exact to rounding (Squire and Trapp 1998).

    Args:
        function: analytic function of one vector for each part, over leading axes; returns a vector (k,).
        parts: value (d,) and derivative (d, n) of each argument.
    """
    # A step of 1e-30 loses nothing: no difference is taken, and its square is below rounding of every value.
    moved = function(*(value + 1e-30j * gradient.T for value, gradient in parts))
    return np.asarray(np.imag(moved).T / 1e-30)


def weakest_rows(matrix: np.ndarray, names: Sequence[str]) -> tuple[str, ...]:
    """Names of the rows of a matrix (k, n) that take part in its weakest combination.

    A row takes part if its weight is at least a tenth of the largest one.

    Args:
        matrix: (k, n).
        names: name of each row, (k,).
    """
    # The left singular vector of the smallest singular value is the combination of rows that is nearest to zero.
    left, values, _ = np.linalg.svd(matrix)
    weights = np.abs(left[:, min(len(values), len(left)) - 1])
    return tuple(name for name, weight in zip(names, weights, strict=True) if weight > 0.1 * weights.max())


# ------------------------------------------------------------------ components
#
# Components of one vector are Python numbers, components of a stack of vectors are arrays. The arithmetic is the same,
# and a single state avoids the cost of arrays with one entry. Dual numbers differentiate a formula.

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
            # (a/b)' = (a' - (a/b) b') / b needs no square of b, which could overflow or vanish.
            ratio = self.value / other.value
            return Dual(ratio, (self.slope - ratio * other.slope) / other.value)
        return Dual(self.value / other, self.slope / other)

    def __rtruediv__(self, other: Component) -> Dual:
        # The slope of x**-1 is -x**-2 times the slope of x.
        return self**-1 * other

    def __pow__(self, exponent: float) -> Dual:
        return Dual(self.value**exponent, exponent * self.value ** (exponent - 1) * self.slope)

    __radd__, __rmul__ = __add__, __mul__


def components(vectors: np.ndarray) -> Sequence[Component]:
    """Entries of a vector (k,) as numbers, or entries of vectors (..., k) as one array (...) each.

    Args:
        vectors: (k,), or (..., k) for many states.
    """
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


def cross(a: Sequence[_E], b: Sequence[_E]) -> tuple[_E, _E, _E]:
    """Vector product of two triples of components.

    Args:
        a: three components, the first factor.
        b: three components, the second factor.
    """
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def dot(a: Sequence[_E], b: Sequence[_E]) -> _E:
    """Scalar product of two triples of components.

    Args:
        a: three components.
        b: three components.
    """
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
