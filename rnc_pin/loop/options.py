"""Checks of the arguments of a control loop."""

from __future__ import annotations

from typing import Any, Literal, TypedDict

import numpy as np
from numpy import ndarray as Array

from rnc_pin.array_shapes import Float
from rnc_pin.control.controller import Controller
from rnc_pin.errors import ConfigurationError
from rnc_pin.model.reduced_model import ReducedModel


class LoopOptions(TypedDict, total=False):
    """Keyword options of ``ControlLoop``; see there."""

    velocity: Literal["measured", "filtered", "observer"]
    cutoff: float | None
    limits: bool | Float[Array, " p"]
    fallback: Literal["hold", "brake", "zero", "raise"]
    timeout: float | None
    max_speed: float
    min_singular_value: float
    brake: float


def admit_model(reduced: Any) -> ReducedModel:
    """Return the argument if it is a reduced model.

    Raises:
        ConfigurationError: it is not one.
    """
    if isinstance(reduced, ReducedModel):
        return reduced
    hint = ": call reduce() of it" if hasattr(reduced, "reduce") else ""
    raise ConfigurationError(f"expected a ReducedModel, found {type_name(reduced)}{hint}")


def admit_controller(controller: Any, of_measurement: bool = False) -> Any:
    """Return the argument if it is a controller.

    With ``of_measurement`` it may also be a function from the first measurement to a controller.

    Raises:
        ConfigurationError: it is neither.
    """
    if isinstance(controller, type):
        raise ConfigurationError(f"the controller is the class {controller.__name__}: pass an instance of it")
    if isinstance(controller, Controller) or (of_measurement and callable(controller)):
        return controller
    raise ConfigurationError(
        "expected a controller with initial_state and step, such as those of rnc.control, "
        f"found {type_name(controller)}"
    )


def admit_limits(reduced: ReducedModel, limits: Any) -> np.ndarray | None:
    """Input limits (p,); None without limits.

    Raises:
        ConfigurationError: not a boolean and not p non-negative numbers.
    """
    if isinstance(limits, bool):
        return reduced.actuation.limits if limits and np.isfinite(reduced.actuation.limits).any() else None
    try:
        given = np.asarray(limits, dtype=float)
    except (TypeError, ValueError):
        given = np.full(1, np.nan)
    if given.shape != (reduced.p,) or not (given >= 0).all():
        raise ConfigurationError(f"limits of a loop have to be {reduced.p} non-negative numbers")
    return given


def check_number(option: str, value: Any, zero: bool = False) -> None:
    """Raise an error unless the value is a positive number. Infinity is valid, except for dt.

    Raises:
        ConfigurationError: names the option.
    """
    number = isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)
    if not number or not (value > 0 or (zero and value == 0)) or (option == "dt" and value == np.inf):
        wanted = "a number that is not negative" if zero else "positive"
        raise ConfigurationError(f"{option} of a loop has to be {wanted}, found {value!r}")


def check_choice(option: str, value: Any, valid: tuple[str, ...]) -> Any:
    """Return the value if it is valid.

    Raises:
        ConfigurationError: names the option and the valid values.
    """
    if value not in valid:
        raise ConfigurationError(f"{option} of a loop: expected one of {', '.join(valid)}, found {value!r}")
    return value


def type_name(thing: Any) -> str:
    """Name of the type of an object, for error messages."""
    return "None" if thing is None else f"a {type(thing).__name__}"
