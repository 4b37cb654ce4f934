"""Component formulas that serve one state and many states.

The components of one vector are Python numbers. The components of a stack of vectors are arrays. The arithmetic is the
same for both, and a single state avoids the cost of arrays with one entry.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np

Component: TypeAlias = "float | np.ndarray"
Triple: TypeAlias = "tuple[Component, Component, Component]"


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
    out = np.empty((*like.shape, len(rows), len(rows[0])))
    for i, row in enumerate(rows):
        for j, entry in enumerate(row):
            out[..., i, j] = entry
    return out


def packed_vector(entries: Sequence[Component], like: Component) -> np.ndarray:
    """Vector (..., k) of components."""
    return np.array(entries) if not isinstance(like, np.ndarray) else np.stack(entries, axis=-1)


def cross(a: Sequence[Component], b: Sequence[Component]) -> Triple:
    """Vector product of two triples of components."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def dot(a: Sequence[Component], b: Sequence[Component]) -> Component:
    """Scalar product of two triples of components."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def smallest(value: Component) -> float:
    """Smallest entry of a component over all states; infinite if there are no states."""
    return float(value.min(initial=np.inf)) if isinstance(value, np.ndarray) else value
