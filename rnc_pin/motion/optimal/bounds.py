"""Hard bounds of optimal control, ``lower <= c(x, u) <= upper`` at every node: stated ones, and limits of a file."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from rnc_pin.analysis.derivatives import state_derivatives
from rnc_pin.array_shapes import Array, Float
from rnc_pin.collision import CollisionDistances, PairDistances
from rnc_pin.constraints.wheeled_base import SIDE_SLIP, missing_lateral_rows
from rnc_pin.errors import ConfigurationError, InputError, check_classes
from rnc_pin.model.input_validation import admit_configuration
from rnc_pin.model.rows import RowStack
from rnc_pin.model.task import OutputTarget
from rnc_pin.motion.optimal.costs import (
    NodeData,
    NodeFunction,
    NodeOutputs,
    OutputChoice,
    RowValues,
    displacement_rows,
    input_rows,
    row_numbers,
    stacked,
    velocity_rows,
)
from rnc_pin.motion.planning.action_models import ActionModel, Nodes
from rnc_pin.motion.whole_body.limits.control_limit import limited_velocities
from rnc_pin.robots.joint_values import limited_positions

DISTANCE = "distance"
GOAL = "goal"
_REMEDY = "state a bound for it, or limits=FileLimits({0}=False); in files limits: {{{0}: null}}"
_WORDS = {"input": "input", "velocity": "velocity", "output": "value", "slip": "speed"}

Limit = ArrayLike | Mapping[str, float] | None
"""A number, one for each row, or limits by name (none for the others); None for no limit."""
Goal = Mapping[OutputTarget, ArrayLike] | ArrayLike
"""Values by output, or a configuration (nq,)."""


class NodeBound:
    """Bounded rows for one action model.

    Attributes:
        quantity: "input", "velocity", "output", "slip", "distance" or "goal" for limits of these.
        names: names of the rows.
        lower, upper: limits (k,).
        rows: function of nodes that returns the rows.
        of_state: True if the rows depend on the state only, so that they also hold at the end.
        of_file: True for limits of the robot's file, for distances of its links from each other, and for side slips.
        stated: True for rows with a limit on at least one side, or with an infinite one by name (k,).
        units: unit of each row, (k,); empty if it is not known.
        remedy: remedy that removes a limit of the robot's file; "" for bounds that are stated.
    """

    of_file = False

    def __init__(
        self,
        quantity: str,
        names: Sequence[str],
        limits: tuple[Limit, Limit],
        rows: NodeFunction,
        of_state: bool = True,
        units: Sequence[str] | None = None,
        remedy: str = "",
    ) -> None:
        self.quantity, self.names, self.rows = quantity, tuple(names), rows
        self.of_state, self.remedy = of_state, remedy
        self.units = ("",) * len(self.names) if units is None else tuple(units)
        # Infinity by name is a statement too: it takes the place of the limit of the file.
        self.stated = _stated(limits[0], self.names) | _stated(limits[1], self.names)
        lower, upper = (-np.inf if limits[0] is None else limits[0]), (np.inf if limits[1] is None else limits[1])
        self.lower = row_numbers(lower, self.names, "bound", -np.inf)
        self.upper = row_numbers(upper, self.names, "bound", np.inf)
        for name, low, high in zip(self.names, self.lower, self.upper, strict=True):
            if not low <= high:
                raise InputError(f"bound of {name}: lower limit {low:g} is above upper limit {high:g}")

    @property
    def titles(self) -> tuple[str, ...]:
        """Names of the rows in messages, such as "velocity of lift_joint"."""
        word = _WORDS.get(self.quantity)
        return self.names if word is None else tuple(f"{word} of {name}" for name in self.names)


class BoundKind(ABC):
    """Family of the bounds. Each binds to an action model."""

    @abstractmethod
    def bind(self, model: ActionModel) -> NodeBound:
        """Return the bound of an action model."""


@dataclass(frozen=True)
class InputBound(BoundKind):
    """Limits of the inputs of the action model: v2, v2_dot or T.

    Args:
        lower: limits: a number, one for each input, or limits by name; no limit by default.
        upper: largest values, in the same forms.

    Example:
        >>> rnc.optimal.InputBound(-1.0, {"sleigh_yaw": 0.5}).upper
        {'sleigh_yaw': 0.5}
    """

    lower: Limit = None
    upper: Limit = None

    def bind(self, model: ActionModel) -> NodeBound:
        return NodeBound("input", model.input_names, (self.lower, self.upper), input_rows, of_state=False)


@dataclass(frozen=True)
class VelocityBound(BoundKind):
    """Limits of the reduced velocities.

    Args:
        lower: limits: a number, one for each reducing output, or limits by name; no limit by default.
        upper: largest values, in the same forms.

    Example:
        >>> rnc.optimal.VelocityBound(-0.5, 0.5).lower
        -0.5
    """

    lower: Limit = None
    upper: Limit = None

    def bind(self, model: ActionModel) -> NodeBound:
        names, limits = model.reduced.reducing.names, (self.lower, self.upper)
        # In the kinematic form velocities are inputs, which the last node does not have.
        return NodeBound("velocity", names, limits, velocity_rows, of_state=model.form != "kinematic")


@dataclass(frozen=True)
class OutputBound(BoundKind):
    """Limits of outputs, for example of joint positions.

    Args:
        output: an output object, the name of an output of the model, or a list of these.
        lower: limits: a number, one for each row, or limits by name; no limit by default.
        upper: largest values, in the same forms.

    Example:
        >>> rnc.optimal.OutputBound(rnc.JointPosition("front_steering"), -0.6, 0.6).upper
        0.6
    """

    output: OutputChoice
    lower: Limit = None
    upper: Limit = None

    def bind(self, model: ActionModel) -> NodeBound:
        outputs = NodeOutputs(model.reduced, self.output)
        limits = self.lower, self.upper
        return NodeBound("output", outputs.names, limits, outputs.value_rows, units=outputs.units)


@dataclass(frozen=True)
class DistanceBound(BoundKind):
    """Smallest distance of links from each other and from obstacles, of the nearest pairs at each node.

    Args:
        distances: distances of a robot with its obstacles.
        clearance: smallest allowed distance [m].
        pairs: number of pairs that count at each node; the nearest ones.

    Example:
        >>> import coal
        >>> robot = rnc.Robot.from_example("panda")
        >>> shelf = rnc.collision.Obstacle(coal.Box(0.2, 0.8, 0.4), position=(0.6, 0.0, 0.2), name="shelf")
        >>> rnc.optimal.DistanceBound(rnc.collision.CollisionDistances(robot, [shelf]), clearance=0.05).pairs
        6
    """

    distances: CollisionDistances
    clearance: float = 0.0
    pairs: int = 6

    def __post_init__(self) -> None:
        # Others would fail in calls that know the bound alone.
        check_classes("DistanceBound", DistanceBound.__init__, (self,), vars(self))

    def bind(self, model: ActionModel) -> NodeBound:
        return DistanceRows(self)


class DistanceRows(NodeBound):
    """Distances of the nearest pairs at each node."""

    def __init__(self, bound: DistanceBound) -> None:
        self.distances, self.clearance = bound.distances, bound.clearance
        horizon = 0.5  # [m], distance beyond the clearance from which pairs have no row
        within = bound.clearance + horizon
        self._count = min(bound.pairs, len(bound.distances.pairs))
        names = [f"distance ({'nearest' if k == 0 else f'nearest {k + 1}'})" for k in range(self._count)]
        super().__init__(DISTANCE, names, (bound.clearance, None), self.measured, units=["m"] * self._count)
        self._bound, self.of_file = bound, not bound.distances.obstacles
        # A solver takes values of the nodes and of the end, and derivatives at the same places after that. Distances
        # are the largest part of an iteration, so the last ones are kept.
        self._known = lru_cache(maxsize=1000)(lambda q, t: self.distances.at(np.frombuffer(q), t, within=within))

    def beyond(self, accuracy: float, start: float, goal: float) -> DistanceRows:
        """Return distances that are larger by the accuracy: a motion that falls short by as much keeps the clearance.

        Args:
            accuracy: shortfall that is accepted [m].
            start, goal: smallest distances there, or infinity: no node keeps more, and no motion more than its start.
        """
        found = DistanceRows(replace(self._bound, clearance=min(self.clearance, start) + accuracy))
        # The start and the goal cannot be moved: a bound beyond their own distances would have no solution.
        found.lower = np.minimum(found.lower, min(start, goal))
        return found

    def at(self, q: Array, t: float) -> PairDistances:
        """Distances up to a little more than the clearance."""
        return self._known(q.tobytes(), t)  # equal bits only: a node that has moved a little is another place

    def measured(self, nodes: NodeData, derivatives: bool) -> RowValues:
        """Distances of the nearest pairs, with their derivatives in any case."""
        model = nodes.model
        far = 1e3  # [m], distance of a row without a pair
        # A node with fewer near pairs has rows without effect: all nodes have the same number.
        value = np.full((nodes.size, self._count), far)
        J = np.zeros((nodes.size, self._count, model.nx + model.nu))
        for k, (q, t) in enumerate(zip(nodes.at.q, nodes.time.tolist(), strict=True)):
            found = self.at(q, t)
            # Pairs change their places as they pass each other, which costs the rows their smoothness there; a row for
            # each pair of a robot would be a hundred rows at each node.
            nearest_first = np.argsort(found.distance, kind="stable")[: self._count]
            value[k, : len(nearest_first)] = found.distance[nearest_first]
            J[k, : len(nearest_first), : model.nv] = found.jacobian[nearest_first]
        return RowValues(value, J)


class GoalRows(NodeBound):
    """Goal at the end: outputs with values, or a configuration, and rest.

    Args:
        model: action model.
        goal: values by output, or a configuration (nq,).
        at_rest: True if the reduced velocities vanish at the end; no effect in the kinematic form.

    Attributes:
        configuration: configuration (nq,) of the goal; None if it consists of outputs.

    Raises:
        ConfigurationError: the goal is empty, or names an unknown output.
        InputError: a value has the wrong shape or is not finite.
    """

    def __init__(self, model: ActionModel, goal: Goal, at_rest: bool) -> None:
        robot = model.reduced.robot
        self._model = model
        self.configuration: Array | None = None
        self._outputs: list[tuple[NodeOutputs, Array]] = []
        names, units = list[str](), list[str]()
        if isinstance(goal, Mapping):
            for output, value in goal.items():
                found = NodeOutputs(model.reduced, output)
                # Rows of an orientation are rotation vectors, whose error is the logarithm of a rotation.
                value = pin.log3(np.asarray(value)) if np.shape(value) == (3, 3) else value
                self._outputs.append((found, found.target(value, "goal")))
                names += found.names
                units += found.units
        else:
            self.configuration = admit_configuration(goal, robot, "goal")
            names += robot.velocity_names
            units += [""] * robot.nv
        if not names:
            raise ConfigurationError("goal: expected values of at least one output, or a configuration")
        self._rest = at_rest and model.form != "kinematic"
        if self._rest:
            names += [f"{name} (rest)" for name in model.reduced.reducing.names]
            units += model.reduced.reducing.units
        super().__init__(GOAL, [f"goal {name}" for name in names], (0.0, 0.0), self._missed, units=units)

    def errors(self, q: Float[Array, " nq"]) -> dict[str, float]:
        """Errors of a configuration by name of the rows [m or rad], in the kinematic form.

        Args:
            q: configuration (nq,).
        """
        at = NodeData(self._model, Nodes(np.asarray(q)[None], np.empty((1, 0))), None, np.zeros(1))
        names = (name.removeprefix("goal ") for name in self.names)
        return dict(zip(names, np.abs(self.rows(at, False).value[0]).tolist(), strict=True))

    def values_of(self, bound: NodeBound) -> dict[str, float]:
        """Values that the goal states for rows of an output bound, by name, but for angles that repeat every turn."""
        if self.configuration is None:
            found = (zip(outputs.names, target, outputs.angular, strict=True) for outputs, target in self._outputs)
            return {name: float(value) for each in found for name, value, angular in each if not angular}
        nodes = NodeData(self._model, Nodes(self.configuration[None], np.zeros((1, self._model.nw))), None, np.zeros(1))
        return dict(zip(bound.names, bound.rows(nodes, False).value[0].tolist(), strict=True))

    def _missed(self, nodes: NodeData, derivatives: bool) -> RowValues:
        """Errors of the goal."""
        parts = [outputs.error_rows(target, nodes, derivatives) for outputs, target in self._outputs]
        if self.configuration is not None:
            parts = [displacement_rows(self.configuration, nodes, derivatives)]
        if self._rest:
            parts.append(velocity_rows(nodes, derivatives))
        return stacked(parts)


def _stated(given: Limit, names: Sequence[str]) -> Array:
    """Mask (k,) of the rows for which a limit is given."""
    return np.array([given is not None and (not isinstance(given, Mapping) or name in given) for name in names], bool)


# ------------------------------------------------------------------ limits of the robot's file


@dataclass(frozen=True)
class FileLimits:
    """Limits of the robot's file that a plan keeps. A bound that is stated for the same row replaces one.

    Positions and velocities hold in every form. In the form "kinematic", velocities jump between intervals. Efforts
    hold in the form "dynamic", whose inputs they bound; the other forms know no efforts. An effort limit of 0 in a file
    means that the limit is not stated, as in runs: the verdict of a plan that uses such an actuator has a finding.
    Steered wheels without a lateral row do not slide, whatever is chosen here: a plan aims them.

    Args:
        position: keep the position limits of joints; continuous joints and bases have none.
        velocity: keep the velocity limits of joints.
        effort: keep the effort limits of actuators; a force on a frame has its ``limit``.

    Example:
        >>> rnc.optimal.FileLimits(effort=False)  # argument of rnc.optimal.plan
        FileLimits(position=True, velocity=True, effort=False)
    """

    position: bool = True
    velocity: bool = True
    effort: bool = True

    def bind(self, model: ActionModel, stated: Sequence[NodeBound]) -> list[NodeBound]:
        """Return the bounds of an action model, without the rows for which other bounds are stated."""
        found = [
            *([_positions(model, _rows_of(stated, "output"))] if self.position else ()),
            *([_velocities(model, stated)] if self.velocity else ()),
            *(_efforts(model, _rows_of(stated, "input")) if self.effort and model.form == "dynamic" else ()),
            _side_slips(model),
        ]
        for bound in found:
            bound.of_file = True
        return [bound for bound in found if bound.names]


def _rows_of(stated: Sequence[NodeBound], *quantities: str) -> set[str]:
    """Names of the rows for which bounds of some quantities state a limit."""
    found = (zip(bound.names, bound.stated, strict=True) for bound in stated if bound.quantity in quantities)
    return {name for each in found for name, given in each if given}


def _positions(model: ActionModel, replaced: set[str]) -> NodeBound:
    found = limited_positions(model.reduced.robot, None)
    kept, names = _kept(model, found.v, replaced)
    rows = partial(_position_rows, [found.q[k] for k in kept], [found.v[k] for k in kept])
    limits = found.lower[kept], found.upper[kept]
    return NodeBound("output", names, limits, rows, remedy=_REMEDY.format("position"))


def _velocities(model: ActionModel, stated: Sequence[NodeBound]) -> NodeBound:
    kinematic = model.form == "kinematic"  # there the inputs are the velocities
    places, largest = limited_velocities(model.reduced.robot, None, None)
    kept, names = _kept(model, places, _rows_of(stated, "velocity", *(("input",) if kinematic else ())))
    rows = partial(_linear_rows, np.eye(model.nv)[[places[k] for k in kept]])
    limits = -largest[kept], largest[kept]
    return NodeBound("velocity", names, limits, rows, not kinematic, remedy=_REMEDY.format("velocity"))


def _kept(model: ActionModel, places: Sequence[int], replaced: set[str]) -> tuple[list[int], list[str]]:
    """Limits of entries of v that no bound replaces, row by row: a bound for one joint leaves those of the others."""
    names = [model.reduced.robot.velocity_names[place] for place in places]
    kept = [k for k, name in enumerate(names) if name not in replaced]
    return kept, [names[k] for k in kept]


def _efforts(model: ActionModel, replaced: set[str]) -> list[NodeBound]:
    actuation = model.reduced.actuation
    of_file = zip(actuation.names, actuation.limits.tolist(), strict=True)
    limits = {name: limit for name, limit in of_file if limit < np.inf and name not in replaced}
    return [InputBound({name: -limit for name, limit in limits.items()}, limits).bind(model)] if limits else []


def _side_slips(model: ActionModel) -> NodeBound:
    """Lateral speeds of steered wheels without a lateral row, which are aimed by this bound."""
    aimed = missing_lateral_rows(model.reduced, steered=True)
    # Half of the speed from which the verdict of a run counts a wheel as sliding: the loop adds some of its own.
    limits, rows = (-SIDE_SLIP / 2, SIDE_SLIP / 2), partial(_slip_rows, aimed)
    return NodeBound("slip", aimed.names, limits, rows, model.form != "kinematic")


def _position_rows(q: list[int], v: list[int], nodes: NodeData, derivatives: bool) -> RowValues:
    """Positions of joints (k,) by their places in q and in v."""
    # q and v of joints with limits have the same entries.
    return RowValues(nodes.at.q[:, q], nodes.slopes(np.eye(nodes.model.nv)[v]) if derivatives else None)


def _slip_rows(rows: RowStack, nodes: NodeData, derivatives: bool) -> RowValues:
    """Lateral speeds of wheels."""
    found, v = _linear_rows(rows.jacobian(nodes.position), nodes, derivatives), nodes.velocity
    if found.J is not None:
        # The slip is A(q) v. By q, it changes by the rate of A at a unit velocity along each entry of v, times v.
        for k, along in enumerate(np.eye(v.shape[1])):
            turned = nodes.position.with_velocity(np.broadcast_to(along, v.shape))
            found.J[:, :, k] += np.matvec(rows.jacobian_dot(turned), v)
    return found


def _linear_rows(A: Array, nodes: NodeData, derivatives: bool) -> RowValues:
    """Rows ``A v`` of velocities ``v = R v2 + b``, with derivatives for a constant A."""
    if not derivatives:
        return RowValues((A @ nodes.velocity[..., None])[..., 0])
    # At the last node there is no flow; zero efforts, because only the velocity is read.
    none = np.zeros((nodes.size, nodes.model.reduced.p))
    flow = nodes.flow or state_derivatives(nodes.model.reduced, nodes.at.q, nodes.v2, none)
    return RowValues((A @ flow.v[..., None])[..., 0], nodes.slopes(A @ np.concatenate([flow.v_q, flow.v_v2], axis=2)))
