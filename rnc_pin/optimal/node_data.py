"""Data of nodes that costs and bounds read, and the rows that they return."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy import ndarray as Array

from rnc_pin.array_shapes import Float
from rnc_pin.model.cached_property import cached_property
from rnc_pin.model.kinematics import Kinematics, PositionKinematics
from rnc_pin.optimal.action_models import ActionModel, FlowDerivatives, Nodes


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
        return (
            np.zeros((n, k, nx)) if self.x is None else self.x,
            np.zeros((n, k, nu)) if self.u is None else self.u,
        )


def stacked(rows: list[RowValues], n: int, nx: int, nu: int) -> tuple[Array, Array, Array]:
    """Concatenate rows: values (n, k) and derivatives (n, k, nx), (n, k, nu)."""
    if not rows:
        return np.empty((n, 0)), np.empty((n, 0, nx)), np.empty((n, 0, nu))
    x, u = zip(*(each.full(nx, nu) for each in rows), strict=True)
    return np.concatenate([each.value for each in rows], axis=1), np.concatenate(x, 1), np.concatenate(u, 1)
