"""Limits of the robot's file as bounds of a plan: positions and velocities of joints, efforts of actuators."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy import ndarray as Array

from rnc_pin.analysis.derivatives import state_derivatives
from rnc_pin.control.whole_body.limits.joint_limits import limited_positions, limited_velocities
from rnc_pin.errors import ConfigurationError
from rnc_pin.optimal.bounds import InputBound, NodeBound
from rnc_pin.optimal.node_data import NodeData, RowValues, velocity_rows
from rnc_pin.planning.action_models import ActionModel


@dataclass(frozen=True)
class FileLimits:
    """Limits of the robot's file that a plan keeps. A bound that is stated for the same row replaces one.

    Positions and velocities hold in every form. In the form "kinematic", velocities jump between intervals. Efforts
    hold in the form "dynamic", whose inputs they bound; the other forms know no efforts. An effort limit of 0 in a file
    means that the limit is not stated, as in runs: the verdict of a plan that uses such an actuator has a finding.

    Args:
        position: keep the position limits of joints; continuous joints and bases have none.
        velocity: keep the velocity limits of joints.
        effort: keep the effort limits of actuators; a force on a frame has its ``limit``.
        reserve: share of the range of positions and velocities that a plan keeps free at its nodes. Feedback needs it
            in the run. It ends where the start or the goal of the plan is.

    Raises:
        ConfigurationError: the reserve is not from 0 to below 0.5.

    Example:
        >>> rnc.optimal.FileLimits(effort=False)  # argument of rnc.optimal.plan
        FileLimits(position=True, velocity=True, effort=False, reserve=0.005)
    """

    position: bool = True
    velocity: bool = True
    effort: bool = True
    reserve: float = 0.005

    def __post_init__(self) -> None:
        if not 0 <= self.reserve < 0.5:
            raise ConfigurationError(f"reserve: expected a share from 0 to below 0.5, found {self.reserve!r}")

    def bind(self, model: ActionModel, stated: Sequence[NodeBound]) -> list[NodeBound]:
        """Return the bounds of an action model, without the rows for which other bounds are stated."""
        found = [
            *(_positions(model, _rows_of("output", stated)) if self.position else ()),
            *(_velocities(model, stated) if self.velocity else ()),
            *(_efforts(model, _rows_of("input", stated)) if self.effort and model.form == "dynamic" else ()),
        ]
        for bound in found:
            bound.of_file = True
        return found


def _rows_of(quantity: str, stated: Sequence[NodeBound]) -> set[str]:
    return {
        name
        for bound in stated
        if bound.quantity == quantity
        for name, given in zip(bound.names, bound.stated, strict=True)
        if given
    }


def _positions(model: ActionModel, replaced: set[str]) -> list[NodeBound]:
    found, names = limited_positions(model.reduced.robot, None), model.reduced.robot.velocity_names
    kept = [k for k, place in enumerate(found.v) if names[place] not in replaced]
    if not kept:
        return []
    rows = [found.q[k] for k in kept], [found.v[k] for k in kept]
    return [_Positions([names[place] for place in rows[1]], rows, found.lower[kept], found.upper[kept])]


def _velocities(model: ActionModel, stated: Sequence[NodeBound]) -> list[NodeBound]:
    quantities = ("velocity", "input") if model.form == "kinematic" else ("velocity",)
    replaced = set().union(*(_rows_of(each, stated) for each in quantities))
    places, largest = limited_velocities(model.reduced.robot, None, None)
    names = model.reduced.robot.velocity_names
    kept = [k for k, place in enumerate(places) if names[place] not in replaced]
    return [_Velocities(model, [places[k] for k in kept], largest[kept])] if kept else []


def _efforts(model: ActionModel, replaced: set[str]) -> list[NodeBound]:
    actuation = model.reduced.actuation
    limits = {
        name: float(limit)
        for name, limit in zip(actuation.names, actuation.limits, strict=True)
        if limit < np.inf and name not in replaced
    }
    return [InputBound({name: -limit for name, limit in limits.items()}, limits).bind(model)] if limits else []


class _Positions(NodeBound):
    quantity = "output"
    remedy = "state a bound for it, or limits=FileLimits(position=False); in files limits: {position: null}"

    def __init__(self, names: Sequence[str], places: tuple[list[int], list[int]], lower: Array, upper: Array) -> None:
        self._q, self._v = places
        super().__init__(names, lower, upper, of_state=True)

    def rows(self, nodes: NodeData, derivatives: bool) -> RowValues:
        found = RowValues(nodes.at.q[:, self._q])
        if derivatives:
            found.x = np.zeros((nodes.size, len(self.names), nodes.model.nx))
            found.x[:, np.arange(len(self.names)), self._v] = 1.0
        return found


class _Velocities(NodeBound):
    """Velocities of joints: those that are reducing outputs are entries of v2, others follow from ``v = R v2 + b``."""

    quantity = "velocity"
    remedy = "state a bound for it, or limits=FileLimits(velocity=False); in files limits: {velocity: null}"

    def __init__(self, model: ActionModel, places: Sequence[int], largest: Array) -> None:
        names, own = model.reduced.robot.velocity_names, model.reduced.reducing.names
        reduced = [k for k, place in enumerate(places) if names[place] in own]
        other = [k for k in range(len(places)) if k not in reduced]
        self._own = [own.index(names[places[k]]) for k in reduced]
        self._other = [places[k] for k in other]
        order = [*reduced, *other]
        limits = largest[order]
        super().__init__([names[places[k]] for k in order], -limits, limits, of_state=model.form != "kinematic")

    def rows(self, nodes: NodeData, derivatives: bool) -> RowValues:
        whole = velocity_rows(nodes, derivatives)
        x, u = (None if each is None else each[:, self._own] for each in (whole.x, whole.u))
        own = RowValues(whole.value[:, self._own], x, u)
        if not self._other:
            return own
        if not derivatives:
            return RowValues(np.concatenate([own.value, nodes.velocity[:, self._other]], axis=1))
        v, v_q, v_w = self._slopes(nodes)
        model, size = nodes.model, len(self._other)
        of_state, of_input = np.zeros((nodes.size, size, model.nx)), np.zeros((nodes.size, size, model.nu))
        of_state[:, :, : model.nv] = v_q[:, self._other]
        if model.form == "kinematic":
            of_input[:] = v_w[:, self._other]
        else:
            of_state[:, :, model.nv :] = v_w[:, self._other]
        first = own.full(model.nx, model.nu)
        return RowValues(
            np.concatenate([own.value, v[:, self._other]], axis=1),
            np.concatenate([first[0], of_state], axis=1),
            np.concatenate([first[1], of_input], axis=1),
        )

    def _slopes(self, nodes: NodeData) -> tuple[Array, Array, Array]:
        """Velocity, and its derivatives by the configuration and by v2."""
        if nodes.flow is not None:
            return nodes.flow.v, nodes.flow.v_q, nodes.flow.v_w
        reduced = nodes.model.reduced
        found = state_derivatives(reduced, nodes.at.q, nodes.v2, np.zeros((nodes.size, reduced.p)))
        return found.v, found.v_q, found.v_v2
