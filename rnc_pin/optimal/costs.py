"""Costs of optimal control: weighted squares of residuals, integrated over time or taken at the end.

    cost = 1/2 sum_k h |sqrt(w(t_k)) r(x_k, u_k)|^2     over the motion
    cost = 1/2 |sqrt(w) r(x_K)|^2                       at the end

Every residual has an exact first derivative; the planner uses the Gauss-Newton Hessian.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy import ndarray as Array
from numpy.typing import ArrayLike

from rnc_pin.errors import ConfigurationError, InputError, nearest
from rnc_pin.optimal.action_models import ActionModel
from rnc_pin.optimal.node_data import NodeData, NodeOutputs, OutputChoice, RowValues
from rnc_pin.planning.references import Reference

Weight = float | Sequence[float] | Mapping[str, float] | Callable[[float], "Weight"]
"""A number, one for each row, weights by name (zero for the others), or a function of time that returns these."""
Phase = Literal["running", "terminal", "both"]


class BoundCost(ABC):
    """Residual of a cost for one action model, with its weights."""

    def __init__(self, names: Sequence[str], weight: Weight, phase: Phase) -> None:
        if phase not in ("running", "terminal", "both"):
            raise ConfigurationError(f"cost: phase '{phase}', expected 'running', 'terminal' or 'both'")
        self.names, self._weight = tuple(names), weight
        self.running, self.terminal = phase != "terminal", phase != "running"
        self._constant = None if callable(weight) else weights_of(weight, self.names)

    def root_weights(self, time: Array) -> Array:
        """Square roots of the weights (n, k) at times (n,)."""
        if self._constant is not None:
            return np.sqrt(np.broadcast_to(self._constant, (len(time), len(self.names))))
        assert callable(self._weight)
        return np.sqrt([weights_of(self._weight(float(t)), self.names) for t in time])

    @abstractmethod
    def rows(self, nodes: NodeData, derivatives: bool) -> RowValues:
        """Residuals at nodes."""


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
        return _Output(self, model)


class _Output(BoundCost):
    def __init__(self, cost: OutputCost, model: ActionModel) -> None:
        self._outputs = NodeOutputs(model.reduced, cost.output)
        super().__init__(self._outputs.names, cost.weight, cost.phase)
        self._reference: Reference | None = None
        if isinstance(cost.target, Reference):
            self._reference = cost.target
            if cost.target.size != self._outputs.size:
                raise ConfigurationError(
                    f"cost of {', '.join(self.names)}: the reference has {cost.target.size} values"
                )
        else:
            self._target = self._outputs.target(cost.target, "cost")

    def rows(self, nodes: NodeData, derivatives: bool) -> RowValues:
        target = (
            self._target
            if self._reference is None
            else np.array([self._reference.at(float(t)).position for t in nodes.time])
        )
        error = self._outputs.error(nodes, target)
        if not derivatives:
            return RowValues(error)
        return RowValues(error, _by_position(nodes, self._outputs.error_jacobian(nodes, error)))


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
        return _Posture(self, model)


class _Posture(BoundCost):
    def __init__(self, cost: PostureCost, model: ActionModel) -> None:
        robot = model.reduced.robot
        super().__init__(robot.velocity_names, cost.weight, cost.phase)
        self._q = np.array(model.reduced.at(cost.q).q)

    def rows(self, nodes: NodeData, derivatives: bool) -> RowValues:
        start = np.broadcast_to(self._q, nodes.at.q.shape)
        manifold = nodes.model.manifold
        found = RowValues(manifold.difference(start, nodes.at.q))
        if derivatives:
            found.x = _by_position(nodes, manifold.difference_derivative(start, nodes.at.q))
        return found


@dataclass(frozen=True)
class EffortCost(CostKind):
    """Squared inputs of the action model: v2, v2_dot or T.

    Args:
        weight: of each input.
        target: inputs without cost (nu,).

    Example:
        >>> rnc.optimal.EffortCost(weight=[1.0, 0.1]).target
        0.0
    """

    weight: Weight = 1.0
    target: ArrayLike = 0.0

    def bind(self, model: ActionModel) -> BoundCost:
        return _Effort(self, model)


class _Effort(BoundCost):
    def __init__(self, cost: EffortCost, model: ActionModel) -> None:
        super().__init__(model.input_names, cost.weight, "running")
        self._target = _entries(cost.target, model.nu, "target of the effort cost")

    def rows(self, nodes: NodeData, derivatives: bool) -> RowValues:
        assert nodes.u is not None
        n, nu = nodes.u.shape
        return RowValues(nodes.u - self._target, None, np.broadcast_to(np.eye(nu), (n, nu, nu)))


@dataclass(frozen=True)
class VelocityCost(CostKind):
    """Squared distance of the reduced velocities from a target.

    Args:
        weight: of each reducing output.
        target: velocities (r,).
        phase: "running", "terminal" or "both"; the kinematic form has no velocity at the end.

    Example:
        >>> rnc.optimal.VelocityCost(weight=0.1, phase="both").target
        0.0
    """

    weight: Weight = 1.0
    target: ArrayLike = 0.0
    phase: Phase = "running"

    def bind(self, model: ActionModel) -> BoundCost:
        if model.form == "kinematic" and self.phase != "running":
            raise ConfigurationError("VelocityCost: the kinematic form has no velocity at the end; use 'running'")
        return _Velocity(self, model)


class _Velocity(BoundCost):
    def __init__(self, cost: VelocityCost, model: ActionModel) -> None:
        super().__init__(model.reduced.reducing.names, cost.weight, cost.phase)
        self._target = _entries(cost.target, model.r, "target of the velocity cost")

    def rows(self, nodes: NodeData, derivatives: bool) -> RowValues:
        x, u = velocity_rows(nodes)
        return RowValues(nodes.v2 - self._target, x, u)


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
        return _Acceleration(self, model)


class _Acceleration(BoundCost):
    def __init__(self, cost: AccelerationCost, model: ActionModel) -> None:
        super().__init__(model.reduced.reducing.names, cost.weight, "running")

    def rows(self, nodes: NodeData, derivatives: bool) -> RowValues:
        if not derivatives or nodes.flow is None:
            return RowValues(nodes.acceleration)
        return RowValues(nodes.acceleration, np.concatenate([nodes.flow.a_q, nodes.flow.a_w], axis=2), nodes.flow.a_u)


def velocity_rows(nodes: NodeData) -> tuple[Array | None, Array | None]:
    """Derivatives of the reduced velocities by the state and by the input."""
    model, n = nodes.model, nodes.size
    eye = np.eye(model.r)
    if model.form == "kinematic":
        return None, np.broadcast_to(eye, (n, model.r, model.r))
    x = np.concatenate([np.zeros((model.r, model.nv)), eye], axis=1)
    return np.broadcast_to(x, (n, model.r, model.nx)), None


def _by_position(nodes: NodeData, J: Array) -> Array:
    """Derivative by the whole state, from the derivative by q."""
    n, k, _ = J.shape
    return np.concatenate([J, np.zeros((n, k, nodes.model.nw))], axis=2)


def weights_of(given: Weight, names: Sequence[str]) -> Array:
    """Weights (k,) from a number, a list, or weights by name."""
    if isinstance(given, Mapping):
        for name in given:
            if name not in names:
                raise ConfigurationError(f"weight: no '{name}'{nearest(str(name), names)}")
        given = [given.get(name, 0.0) for name in names]
    weights = _entries(given, len(names), f"weight of {', '.join(names)}")
    if (weights < 0).any():
        raise ConfigurationError(f"weight of {', '.join(names)}: no weight may be negative, found {given!r}")
    return weights


def _entries(given: object, size: int, what: str) -> Array:
    try:
        array = np.asarray(given, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"{what}: expected {size} numbers, found {given!r}") from None
    if array.shape not in ((), (size,)) or not np.isfinite(array).all():
        raise InputError(f"{what}: expected a finite number, or {size}, found {given!r}")
    return np.broadcast_to(array, (size,)).copy()
