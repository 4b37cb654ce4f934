"""Annotated types of parameters; type checkers read them, and scenario files are validated against them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Literal

from annotated_types import Ge, Gt, Len

Axis = Literal["x", "y", "z"]
"""Axis of a frame."""
Positive = Annotated[float, Gt(0)]
NotNegative = Annotated[float, Ge(0)]
Vector = Annotated[Sequence[float], Len(3, 3)]
"""Components along x, y and z."""
Numbers = Annotated[Sequence[float], Len(1)]
"""One or more numbers."""
