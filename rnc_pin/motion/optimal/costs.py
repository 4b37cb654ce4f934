"""Costs of optimal control: weighted squares of residuals, integrated over time or taken at the end.

    cost = 1/2 sum_k h |sqrt(w(t_k)) r(x_k, u_k)|^2     over the motion
    cost = 1/2 |sqrt(w) r(x_K)|^2                       at the end

Every residual has an exact first derivative; the planner uses the Gauss-Newton Hessian. Residuals and bounds are rows
of ``NodeData``.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from rnc_pin.analysis.derivatives import StateDerivatives
from rnc_pin.array_shapes import Array, Float
from rnc_pin.errors import ConfigurationError, InputError, place_of
from rnc_pin.model.cached_property import cached_property
from rnc_pin.model.input_validation import numbers_or_nan
from rnc_pin.model.kinematics import Kinematics, PositionKinematics
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.task import OutputTarget, SelectedOutputs, find_output
from rnc_pin.motion.planning.action_models import ActionModel, Nodes
from rnc_pin.references.reference import Reference

Weight = float | Sequence[float] | Mapping[str, float] | Callable[[float], "Weight"]
"""A number, one for each row, weights by name (zero for the others), or a function of time that returns these."""
Phase = Literal["running", "terminal", "both"]


def row_numbers(given: object, names: Sequence[str], what: str, missing: float = 0.0) -> Float[Array, " k"]:
    """Numbers of rows, from one for all, one for each, or numbers by name.

    Args:
        given: the numbers.
        names: names of the rows (k,).
        what: the numbers in messages.
        missing: number of rows that are not named. If it is finite, the numbers have to be finite too.

    Raises:
        ConfigurationError: unknown name.
        InputError: no numbers, or another count of them.
    """
    if isinstance(given, Mapping):
        for name in given:
            place_of(name, names, f"{what}: no")
        given = [given.get(name, missing) for name in names]
    found = numbers_or_nan(given)
    allowed = np.isfinite(found) if np.isfinite(missing) else ~np.isnan(found)
    if found.shape not in ((), (len(names),)) or not allowed.all():
        kind = "a finite number" if np.isfinite(missing) else "a number"
        raise InputError(f"{what} of {', '.join(names)}: expected {kind}, or {len(names)}, found {given!r}")
    return np.broadcast_to(found, len(names)).copy()


OutputChoice = OutputTarget | Sequence[OutputTarget]
"""Output object, name of an output of the model, or a list of these."""


class NodeData:
    """States, inputs and times of n nodes, with quantities that several costs share.

    Args:
        model: action model.
        at: states.
        u: inputs (n, nu); None at the last state.
        time: times (n,) [s].
        flow: velocity, acceleration and derivatives at the nodes; None if only values are needed.
    """

    def __init__(
        self, model: ActionModel, at: Nodes, u: Array | None, time: Array, flow: StateDerivatives | None = None
    ) -> None:
        self.model, self.at, self.u, self.time, self.flow = model, at, u, time, flow
        self.size = len(at.q)

    @cached_property
    def position(self) -> PositionKinematics:
        """Kinematics at the configurations."""
        return Kinematics(self.model.reduced.robot).position(self.at.q)

    @cached_property
    def v2(self) -> Float[Array, "n r"]:
        """Reduced velocities."""
        return self.model.velocity(self.at, self.u)

    @cached_property
    def velocity(self) -> Float[Array, "n nv"]:
        """Velocities."""
        # A linearization has evaluated the states already.
        return self.model.reduced.at(self.at.q, self.v2).v if self.flow is None else self.flow.v

    @cached_property
    def acceleration(self) -> Float[Array, "n nw"]:
        """Reduced accelerations."""
        assert self.u is not None
        return self.model.flow(self.at, self.u)[1] if self.flow is None else self.flow.v2_dot

    def slopes(self, J: Float[Array, "*n k j"], first: int = 0) -> Float[Array, "n k nz"]:
        """Derivatives by (x, u), from those by some of its entries: all others are zero.

        Args:
            J: derivatives, of each node or of all.
            first: entry of (x, u) at which they begin.
        """
        found = np.zeros((self.size, J.shape[-2], self.model.nx + self.model.nu))
        found[:, :, first : first + J.shape[-1]] = J
        return found


@dataclass
class RowValues:
    """Rows at n nodes, with derivatives by (x, u)."""

    value: Float[Array, "n k"]
    J: Float[Array, "n k nz"] | None = None
    """None if they are not needed."""


NodeFunction = Callable[[NodeData, bool], RowValues]
"""Function of nodes that returns rows; the flag tells whether their derivatives are needed."""


def input_rows(nodes: NodeData, derivatives: bool) -> RowValues:
    """Inputs at nodes."""
    assert nodes.u is not None
    return RowValues(nodes.u, nodes.slopes(np.eye(nodes.model.nu), nodes.model.nx))


def velocity_rows(nodes: NodeData, derivatives: bool) -> RowValues:
    """Reduced velocities at nodes."""
    # They follow the configuration in (x, u): as inputs in the kinematic form, as states in the others.
    return RowValues(nodes.v2, nodes.slopes(np.eye(nodes.model.r), nodes.model.nv))


def acceleration_rows(nodes: NodeData, derivatives: bool) -> RowValues:
    """Reduced accelerations at nodes."""
    # The last state has no input, and so no acceleration with derivatives.
    if not derivatives or nodes.flow is None:
        return RowValues(nodes.acceleration)
    parts = nodes.flow.v2_dot_q, nodes.flow.v2_dot_v2, nodes.flow.v2_dot_T
    return RowValues(nodes.acceleration, np.concatenate(parts, axis=2))


def displacement_rows(q: Array, nodes: NodeData, derivatives: bool) -> RowValues:
    """Tangent vectors from a configuration (nq,) to nodes."""
    start, manifold = np.broadcast_to(q, nodes.at.q.shape), nodes.model.manifold
    J = nodes.slopes(manifold.difference_derivative(start, nodes.at.q)) if derivatives else None
    return RowValues(manifold.difference(start, nodes.at.q), J)


def stacked(parts: Sequence[RowValues]) -> RowValues:
    """All rows of several parts."""
    slopes = [each.J for each in parts if each.J is not None]
    return RowValues(
        np.concatenate([each.value for each in parts], axis=1), np.concatenate(slopes, axis=1) if slopes else None
    )


class NodeOutputs(SelectedOutputs):
    """Selected outputs with values at stacks of nodes.

    Args:
        reduced: the model.
        outputs: an output object, the name of a scalar output of the model or of a joint output, or a list of these.

    Attributes:
        units: unit of each row, such as "rad".
        angular: True for rows whose values repeat every turn.

    Raises:
        ConfigurationError: unknown output, or an output without a value.
    """

    def __init__(self, reduced: ReducedModel, outputs: OutputChoice) -> None:
        chosen = list(outputs) if isinstance(outputs, list | tuple) else [outputs]
        found = [find_output(reduced, each, "expected") for each in chosen]
        for stack, rows in found:
            # A quasi-velocity has an integral along a motion, and no value at a node.
            for row in rows[stack.quasi[rows]]:
                instead = "use VelocityCost or VelocityBound"
                raise ConfigurationError(f"output '{stack.names[row]}' is a speed: it has no value; {instead}")
        super().__init__(found)
        self.units = tuple(stack.units[row].removesuffix("/s") for stack, rows in found for row in rows)
        self.angular = tuple(bool(stack.angular[row]) for stack, rows in found for row in rows)

    def target(self, value: object, what: str) -> Array:
        """Target (size,) from numbers.

        Raises:
            InputError: the wrong number of values, or one that is not finite.
        """
        array = np.atleast_1d(numbers_or_nan(value))
        if array.shape != (self.size,) or not np.isfinite(array).all():
            raise InputError(f"{what}: expected {self.size} finite numbers ({', '.join(self.names)}), found {value!r}")
        return array

    def value_rows(self, nodes: NodeData, derivatives: bool) -> RowValues:
        """Values at nodes."""
        at = nodes.position
        return RowValues(self.value(at), nodes.slopes(self.jacobian(at)) if derivatives else None)

    def error_rows(self, target: Array | Reference, nodes: NodeData, derivatives: bool) -> RowValues:
        """Values minus a target, or minus a reference at the times of the nodes."""
        if not isinstance(target, Array):
            target = np.array([target.at(float(t)).position for t in nodes.time])
        # The difference on the manifold: an angle or an orientation goes the short way round.
        at, error = nodes.position, self.error(nodes.position, target)
        return RowValues(-error, nodes.slopes(self.error_jacobian(at, error)) if derivatives else None)


# ------------------------------------------------------------------ costs


class BoundCost:
    """Residual of a cost for one action model, with its weights.

    Args:
        names: names of the rows.
        weight: their weights.
        phase: "running", "terminal" or "both".
        rows: function of nodes that returns the residuals.
    """

    def __init__(self, names: Sequence[str], weight: Weight, phase: Phase, rows: NodeFunction) -> None:
        if phase not in ("running", "terminal", "both"):
            raise ConfigurationError(f"cost: phase '{phase}', expected 'running', 'terminal' or 'both'")
        self.names, self.rows = tuple(names), rows
        self.running, self.terminal = phase != "terminal", phase != "running"
        # Constant weights are checked here, where the cost is stated; functions of time only when a node asks.
        self._weight = weight if callable(weight) else np.sqrt(weights_of(weight, self.names))

    def root_weights(self, time: Array) -> Array:
        """Square roots of the weights (n, k) at times (n,)."""
        if callable(self._weight):
            return np.sqrt([weights_of(self._weight(float(t)), self.names) for t in time])
        return np.broadcast_to(self._weight, (len(time), len(self.names)))


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

    output: OutputChoice
    target: ArrayLike | Reference
    weight: Weight = 1.0
    phase: Phase = "running"

    def bind(self, model: ActionModel) -> BoundCost:
        outputs = NodeOutputs(model.reduced, self.output)
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
        rows = partial(displacement_rows, np.array(model.reduced.at(self.q).q))
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
        return BoundCost(model.input_names, self.weight, "running", input_rows)


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
        return BoundCost(model.reduced.reducing.names, self.weight, self.phase, velocity_rows)


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
        return BoundCost(model.reduced.reducing.names, self.weight, "running", acceleration_rows)


def weights_of(given: Weight, names: Sequence[str]) -> Array:
    """Weights (k,) from a number, a list, or weights by name."""
    # Rows that a mapping does not name cost nothing.
    weights = row_numbers(given, names, "weight")
    if (weights < 0).any():
        raise ConfigurationError(f"weight of {', '.join(names)}: no weight may be negative, found {given!r}")
    return weights
