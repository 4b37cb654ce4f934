"""Values that fields take: type checkers read them as people do, and scenario files are held to them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Literal

from annotated_types import Ge, Gt, Len

Axis = Literal["x", "y", "z"]
"""One of a frame's own axes."""
Positive = Annotated[float, Gt(0)]
NotNegative = Annotated[float, Ge(0)]
Vector = Annotated[Sequence[float], Len(3, 3)]
"""Along x, y and z."""
Numbers = Annotated[Sequence[float], Len(1)]
"""One or more."""
