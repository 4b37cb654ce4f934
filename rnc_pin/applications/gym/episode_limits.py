"""Limits of an environment: the boxes of its spaces, and the distance to singular configurations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from rnc_pin.applications.scenario.controllers.context import MIN_SINGULAR_VALUE
from rnc_pin.applications.scenario.execution import execute
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.errors import InputError
from rnc_pin.io import Json
from rnc_pin.model import ReducedModel

_INPUT, _SPEED, _OUTPUT = 2.0, 10.0, 2.0  # multiples of what the scenario's own run needs
_SMALLEST = 0.1  # smallest limit relative to the largest one of the same unit


@dataclass(frozen=True)
class EpisodeLimits:
    """Symmetric limits of an environment; None for the default of each.

    A default comes from the model where it has effort limits. The others come from one run of the scenario with its
    own controller: twice its largest inputs and outputs, and ten times its largest velocities. Of quantities with the
    same unit, no limit is below a tenth of the largest one. A limit that is still zero becomes one unit.

    Args:
        input: largest actuator inputs (p,) [N or N m], or one number: the action space. The effort limits of
            the model hold too.
        speed: largest reduced velocities (r,), or one number; a larger one ends the episode as diverged.
        output: largest outputs x1 and x2 (k + r,), or one number; larger observations are clipped. Angles have pi.
        singular_value: smallest singular value of ``E = [A; J2]`` with scaled rows; below it the episode ends.

    Example:
        >>> rnc.gym.EpisodeLimits(input=20.0, speed=4.0, output=[1.0, 1.0, 3.0]).speed
        4.0
    """

    input: ArrayLike | None = None
    speed: ArrayLike | None = None
    output: ArrayLike | None = None
    singular_value: float = MIN_SINGULAR_VALUE

    def completed(self, reduced: ReducedModel, scenario: str, options: Mapping[str, Json]) -> SpaceBounds:
        """Return all limits as arrays; a run of the scenario gives the missing ones.

        Args:
            reduced: model of the scenario.
            scenario: a built-in name or a file.
            options: dotted keys and values to replace.

        Raises:
            InputError: a limit has the wrong size or is not positive.
            RncError: a limit is missing, and the scenario cannot run.
        """
        effort = reduced.actuation.limits
        x1, x2 = reduced.vertical, reduced.reducing
        sizes = {"input": reduced.p, "speed": reduced.r, "output": x1.size + x2.size}
        limits = {name: _admitted(name, getattr(self, name), size) for name, size in sizes.items()}
        if limits["input"] is None and np.isfinite(effort).all():
            limits["input"] = np.array(effort)
        if any(limit is None for limit in limits.values()):
            run = execute(Scenario.load(scenario, {**options, "comparisons": {}})).trajectory
            position_units = tuple(unit.removesuffix("/s") for unit in (*x1.units, *x2.units))
            needed = {
                "input": _INPUT * _largest(run.T, reduced.actuation.units),
                "speed": _SPEED * _largest(run.v2, x2.units),
                "output": _OUTPUT * _largest(np.hstack([run.x1, run.x2]), position_units),
            }
            needed["input"] = np.where(np.isfinite(effort), effort, needed["input"])
            limits = {name: needed[name] if limit is None else limit for name, limit in limits.items()}
        largest = np.minimum(np.array(limits["input"]), effort)
        output = np.array(limits["output"])
        output[np.concatenate([x1.coordinates.kinds, x2.coordinates.kinds]) > 0] = np.pi  # angles, rotation vectors
        return SpaceBounds(largest, np.array(limits["speed"]), output)


@dataclass(frozen=True)
class SpaceBounds:
    """Completed limits.

    Attributes:
        input: largest inputs (p,).
        speed: largest reduced velocities (r,).
        output: largest outputs x1 and x2 (k + r,).
    """

    input: np.ndarray
    speed: np.ndarray
    output: np.ndarray


def _admitted(name: str, value: ArrayLike | None, size: int) -> np.ndarray | None:
    if value is None:
        return None
    try:
        limit = np.array(np.broadcast_to(np.asarray(value, dtype=float), (size,)))
    except (TypeError, ValueError):
        raise InputError(f"limits.{name}: expected a number or {size} numbers, found {value!r}") from None
    if not (limit > 0).all() or not np.isfinite(limit).all():
        raise InputError(f"limits.{name}: expected positive finite numbers, found {value!r}")
    return limit


def _largest(series: np.ndarray, units: tuple[str, ...]) -> np.ndarray:
    """Largest magnitude of each column of a series (N, size)."""
    largest = np.nan_to_num(np.abs(series)).max(axis=0, initial=0.0)
    for unit in set(units):
        same = np.array([each == unit for each in units])
        largest[same] = np.maximum(largest[same], _SMALLEST * largest[same].max())
    return np.where(largest > 0, largest, 1.0)
