"""Annotated types of parameters; type checkers read them, and scenario files are validated against them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Literal

from annotated_types import Ge, Gt, Len

from rnc_pin.errors import ConfigurationError

Axis = Literal["x", "y", "z"]
"""Axis of a frame."""
Positive = Annotated[float, Gt(0)]
NotNegative = Annotated[float, Ge(0)]
Vector = Annotated[Sequence[float], Len(3, 3)]
"""Components along x, y and z."""
Numbers = Annotated[Sequence[float], Len(1)]
"""One or more numbers."""


def check_positive_settings(**numbers: float) -> None:
    """Raise an error unless numbers, by name of their parameter, are positive and finite.

    Raises:
        ConfigurationError: one is not.
    """
    for name, value in numbers.items():
        if not 0 < value < float("inf"):
            raise ConfigurationError(f"{name}: expected a positive number, found {value:g}")
