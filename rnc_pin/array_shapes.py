"""Types of arrays with shapes in annotations: ``Float[Array, "*batch nv r"]``.

They are those of jaxtyping for type checkers, and where jaxtyping is imported already: tests check shapes with it. Else
an annotation means the array alone, because the import of jaxtyping takes a tenth of a cold start.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from numpy import ndarray as Array

if TYPE_CHECKING or "jaxtyping" in sys.modules:
    from jaxtyping import Bool, Float, Int
else:

    class _AnyShape:
        def __class_getitem__(cls, item: tuple[type, str]) -> type:
            return item[0]

    Bool = Float = Int = _AnyShape

__all__ = ["Array", "Bool", "Float", "Int"]
