"""Data of nodes that costs and bounds read: outputs of a model among them, and the rows that they return."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rnc_pin.array_shapes import Array, Float
from rnc_pin.errors import ConfigurationError, InputError, nearest
from rnc_pin.model.cached_property import cached_property
from rnc_pin.model.kinematics import Kinematics, PositionKinematics
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.task import OutputTarget, SelectedOutputs, find_output
from rnc_pin.motion.planning.action_models import ActionModel, FlowDerivatives, Nodes
from rnc_pin.references.reference import Reference


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
            if name not in names:
                raise ConfigurationError(f"{what}: no '{name}'{nearest(str(name), names)}")
        given = [given.get(name, missing) for name in names]
    try:
        found = np.asarray(given, dtype=float)
    except (TypeError, ValueError):
        found = np.full((), np.nan)  # refused below, with what was given
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
        self, model: ActionModel, at: Nodes, u: Array | None, time: Array, flow: FlowDerivatives | None = None
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
        return self.model.flow(self.at, self.u)[1] if self.flow is None else self.flow.a


@dataclass
class RowValues:
    """Rows at n nodes, with derivatives by the state and the input; None where they vanish or are not needed."""

    value: Float[Array, "n k"]
    x: Float[Array, "n k nx"] | None = None
    u: Float[Array, "n k nu"] | None = None

    def full(self, nx: int, nu: int) -> tuple[Array, Array]:
        """Both derivatives as arrays."""
        n, k = self.value.shape
        return (np.zeros((n, k, nx)) if self.x is None else self.x, np.zeros((n, k, nu)) if self.u is None else self.u)


NodeFunction = Callable[[NodeData, bool], RowValues]
"""Function of nodes that returns rows; the flag tells whether their derivatives are needed."""


def input_rows(nodes: NodeData, derivatives: bool) -> RowValues:
    """Inputs at nodes."""
    assert nodes.u is not None
    n, nu = nodes.u.shape
    return RowValues(nodes.u, None, np.broadcast_to(np.eye(nu), (n, nu, nu)))


def velocity_rows(nodes: NodeData, derivatives: bool) -> RowValues:
    """Reduced velocities at nodes."""
    model, n = nodes.model, nodes.size
    eye = np.eye(model.r)
    if model.form == "kinematic":
        return RowValues(nodes.v2, None, np.broadcast_to(eye, (n, model.r, model.r)))
    x = np.concatenate([np.zeros((model.r, model.nv)), eye], axis=1)
    return RowValues(nodes.v2, np.broadcast_to(x, (n, model.r, model.nx)))


def acceleration_rows(nodes: NodeData, derivatives: bool) -> RowValues:
    """Reduced accelerations at nodes."""
    # The last state has no input, and so no acceleration with derivatives.
    if not derivatives or nodes.flow is None:
        return RowValues(nodes.acceleration)
    return RowValues(nodes.acceleration, np.concatenate([nodes.flow.a_q, nodes.flow.a_w], axis=2), nodes.flow.a_u)


def displacement_rows(q: Array, nodes: NodeData, derivatives: bool) -> RowValues:
    """Tangent vectors from a configuration (nq,) to nodes."""
    start, manifold = np.broadcast_to(q, nodes.at.q.shape), nodes.model.manifold
    found = RowValues(manifold.difference(start, nodes.at.q))
    if derivatives:
        found.x = _by_position(nodes, manifold.difference_derivative(start, nodes.at.q))
    return found


def _by_position(nodes: NodeData, J: Array) -> Array:
    """Derivative by the whole state, from the derivative by q."""
    return np.concatenate([J, np.zeros((*J.shape[:2], nodes.model.nw))], axis=2)


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
        try:
            array = np.atleast_1d(np.array(value, dtype=float))
        except (TypeError, ValueError):
            raise InputError(f"{what}: expected {self.size} numbers, found {value!r}") from None
        if array.shape != (self.size,) or not np.isfinite(array).all():
            raise InputError(f"{what}: expected {self.size} finite numbers ({', '.join(self.names)}), found {value!r}")
        return array

    def value_rows(self, nodes: NodeData, derivatives: bool) -> RowValues:
        """Values at nodes."""
        at = nodes.position
        return RowValues(self.value(at), _by_position(nodes, self.jacobian(at)) if derivatives else None)

    def error_rows(self, target: Array | Reference, nodes: NodeData, derivatives: bool) -> RowValues:
        """Values minus a target, or minus a reference at the times of the nodes."""
        if not isinstance(target, Array):
            target = np.array([target.at(float(t)).position for t in nodes.time])
        # The difference on the manifold: an angle or an orientation goes the short way round.
        at, error = nodes.position, self.error(nodes.position, target)
        return RowValues(-error, _by_position(nodes, self.error_jacobian(at, error)) if derivatives else None)
