"""Costs of optimal control: weighted squares of residuals, integrated over time or taken at the end.

    cost = 1/2 sum_k h |sqrt(w(t_k)) r(x_k, u_k)|^2     over the motion
    cost = 1/2 |sqrt(w) r(x_K)|^2                       at the end

Every residual has an exact first derivative; the planner uses the Gauss-Newton Hessian.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np
from numpy import ndarray as Array
from numpy.typing import ArrayLike

from rnc_pin.errors import ConfigurationError
from rnc_pin.motion.optimal import node_data
from rnc_pin.motion.planning.action_models import ActionModel
from rnc_pin.references.reference import Reference

Weight = float | Sequence[float] | Mapping[str, float] | Callable[[float], "Weight"]
"""A number, one for each row, weights by name (zero for the others), or a function of time that returns these."""
Phase = Literal["running", "terminal", "both"]


class BoundCost:
    """Residual of a cost for one action model, with its weights.

    Args:
        names: names of the rows.
        weight: their weights.
        phase: "running", "terminal" or "both".
        rows: function of nodes that returns the residuals.
    """

    def __init__(self, names: Sequence[str], weight: Weight, phase: Phase, rows: node_data.NodeFunction) -> None:
        if phase not in ("running", "terminal", "both"):
            raise ConfigurationError(f"cost: phase '{phase}', expected 'running', 'terminal' or 'both'")
        self.names, self._weight, self.rows = tuple(names), weight, rows
        self.running, self.terminal = phase != "terminal", phase != "running"
        # Constant weights are checked here, where the cost is stated; functions of time only when a node asks.
        self._roots = None if callable(weight) else np.sqrt(weights_of(weight, self.names))

    def root_weights(self, time: Array) -> Array:
        """Square roots of the weights (n, k) at times (n,)."""
        if self._roots is not None:
            return np.broadcast_to(self._roots, (len(time), len(self._roots)))
        assert callable(self._weight)
        return np.sqrt([weights_of(self._weight(float(t)), self.names) for t in time])


class CostKind(ABC):
    """Family of the costs. Each binds to an action model."""

    @abstractmethod
    def bind(self, model: ActionModel) -> BoundCost:
        """Return the cost of an action model."""


@dataclass(frozen=True)
class OutputCost(CostKind):
    """Squared distance of outputs from a target.

    Args:
        output: an output object, the name of an output of the model, or a list of these.
        target: numbers, or a reference of as many outputs.
        weight: weight of each row [1/(unit^2 s) over time, 1/unit^2 at the end].
        phase: "running" for over the motion, "terminal" for at its end, or "both".

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")]).reduce(
        ...     [rnc.FrameSpeed("sleigh"), rnc.FrameYaw("sleigh")])
        >>> cost = rnc.optimal.OutputCost(rnc.FramePosition("sleigh", "xy"), [1.0, 0.0], weight=10.0)
        >>> cost.bind(rnc.optimal.action_model(reduced, "kinematic")).names
        ('sleigh_x', 'sleigh_y')
    """

    output: node_data.OutputChoice
    target: ArrayLike | Reference
    weight: Weight = 1.0
    phase: Phase = "running"

    def bind(self, model: ActionModel) -> BoundCost:
        outputs = node_data.NodeOutputs(model.reduced, self.output)
        if not isinstance(self.target, Reference):
            target: Array | Reference = outputs.target(self.target, "cost")
        elif self.target.size == outputs.size:
            target = self.target
        else:
            raise ConfigurationError(f"cost of {', '.join(outputs.names)}: the reference has {self.target.size} values")
        return BoundCost(outputs.names, self.weight, self.phase, partial(outputs.error_rows, target))


@dataclass(frozen=True)
class PostureCost(CostKind):
    """Squared distance from a configuration, along the tangent space.

    Args:
        q: the configuration (nq,).
        weight: of each entry of v; by name of ``robot.velocity_names``.
        phase: "running", "terminal" or "both".

    Example:
        >>> rnc.optimal.PostureCost(np.zeros(3), weight={"joint_1": 1.0}).phase
        'running'
    """

    q: ArrayLike
    weight: Weight = 1.0
    phase: Phase = "running"

    def bind(self, model: ActionModel) -> BoundCost:
        rows = partial(node_data.displacement_rows, np.array(model.reduced.at(self.q).q))
        return BoundCost(model.reduced.robot.velocity_names, self.weight, self.phase, rows)


@dataclass(frozen=True)
class EffortCost(CostKind):
    """Squared inputs of the action model: v2, v2_dot or T.

    Args:
        weight: of each input.

    Example:
        >>> rnc.optimal.EffortCost(weight=[1.0, 0.1]).weight
        [1.0, 0.1]
    """

    weight: Weight = 1.0

    def bind(self, model: ActionModel) -> BoundCost:
        return BoundCost(model.input_names, self.weight, "running", node_data.input_rows)


@dataclass(frozen=True)
class VelocityCost(CostKind):
    """Squared reduced velocities.

    Args:
        weight: of each reducing output.
        phase: "running", "terminal" or "both"; the kinematic form has no velocity at the end.

    Example:
        >>> rnc.optimal.VelocityCost(weight=0.1, phase="both").weight
        0.1
    """

    weight: Weight = 1.0
    phase: Phase = "running"

    def bind(self, model: ActionModel) -> BoundCost:
        if model.form == "kinematic" and self.phase != "running":
            raise ConfigurationError("VelocityCost: the kinematic form has no velocity at the end; use 'running'")
        return BoundCost(model.reduced.reducing.names, self.weight, self.phase, node_data.velocity_rows)


@dataclass(frozen=True)
class AccelerationCost(CostKind):
    """Squared reduced accelerations, for the forms "acceleration" and "dynamic".

    Args:
        weight: of each reducing output.

    Example:
        >>> rnc.optimal.AccelerationCost(weight=0.01).weight
        0.01
    """

    weight: Weight = 1.0

    def bind(self, model: ActionModel) -> BoundCost:
        if model.form == "kinematic":
            raise ConfigurationError("AccelerationCost: the kinematic form has no acceleration; use 'acceleration'")
        return BoundCost(model.reduced.reducing.names, self.weight, "running", node_data.acceleration_rows)


def weights_of(given: Weight, names: Sequence[str]) -> Array:
    """Weights (k,) from a number, a list, or weights by name."""
    # Rows that a mapping does not name cost nothing.
    weights = node_data.row_numbers(given, names, "weight")
    if (weights < 0).any():
        raise ConfigurationError(f"weight of {', '.join(names)}: no weight may be negative, found {given!r}")
    return weights
