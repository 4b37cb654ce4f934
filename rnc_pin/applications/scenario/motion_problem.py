"""Goals and bounds of optimal control from the settings of a planner or of a controller to a set point."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from rnc_pin.applications.scenario.schema.planner_settings import Limits, MotionProblem
from rnc_pin.collision import CollisionDistances, Obstacle, PairSelection
from rnc_pin.errors import ConfigurationError, nearest
from rnc_pin.model import OutputKind, ReducedModel
from rnc_pin.optimal import (
    BoundKind,
    DistanceBound,
    GripBound,
    InputBound,
    NormalForceBound,
    OutputBound,
    VelocityBound,
)
from rnc_pin.planning import OutputTarget


def goal_of(
    given: Mapping[str, float], outputs: Sequence[OutputKind], reduced: ReducedModel
) -> dict[OutputTarget, ArrayLike]:
    """Goal by output: rows of one output together, so that orientations are whole.

    Args:
        given: goal by names of rows.
        outputs: outputs of the scenario.
        reduced: the model.

    Raises:
        ConfigurationError: a name is unknown.
    """
    names = (*reduced.reducing.names, *reduced.vertical.names)
    check_output_names("goal", given, names)
    goal: dict[OutputTarget, ArrayLike] = {}
    rest, rows = dict(given), iter(names)
    for output in outputs:
        own = [next(rows) for _ in output.bind(reduced.robot).names]
        if len(own) > 1 and all(name in rest for name in own):
            goal[output] = [rest.pop(name) for name in own]
    return goal | rest


def bounds_of(settings: MotionProblem, reduced: ReducedModel, obstacles: Sequence[Obstacle]) -> Iterator[BoundKind]:
    """Hard bounds of the settings.

    Args:
        settings: settings with bounds and a clearance.
        reduced: the model.
        obstacles: bodies in the world.

    Raises:
        ConfigurationError: a name is unknown.
    """
    bounds = settings.bounds
    if bounds.input:
        yield InputBound(*_limits(bounds.input))
    if bounds.velocity:
        yield VelocityBound(*_limits(bounds.velocity))
    if bounds.output:
        check_output_names("bounds.output", bounds.output, (*reduced.reducing.names, *reduced.vertical.names))
        yield OutputBound(list(bounds.output), *_limits(bounds.output))
    if bounds.normal_force is not None:
        yield NormalForceBound(bounds.normal_force)
    if bounds.grip is not None:
        yield GripBound(bounds.grip)
    if settings.clearance is not None and (obstacles or settings.links):
        distances = CollisionDistances(reduced.robot, obstacles, PairSelection(links=settings.links))
        if distances.pairs:
            yield DistanceBound(distances, settings.clearance)


def check_output_names(key: str, given: Iterable[str], names: Sequence[str]) -> None:
    """Refuse names of outputs that a model does not have.

    Args:
        key: key of the file.
        given: names in the file.
        names: names of the model.

    Raises:
        ConfigurationError: a name is unknown.
    """
    for name in given:
        if name not in names:
            raise ConfigurationError(f"{key}: no output '{name}'{nearest(name, names)}")


def _limits(given: Mapping[str, Limits]) -> tuple[dict[str, float], dict[str, float]]:
    """Lower and upper limits by name; null is no limit, not that of the robot's file."""
    lower = {name: -np.inf if low is None else float(low) for name, (low, _) in given.items()}
    return lower, {name: np.inf if high is None else float(high) for name, (_, high) in given.items()}
