"""Outputs along a motion: values, rates and accelerations at both ends of every interval."""

from __future__ import annotations

import numpy as np
from numpy import ndarray as Array

from rnc_pin.array_shapes import Float
from rnc_pin.math.coordinates import Coordinates, left_jacobian
from rnc_pin.optimal.action_models import ActionModel, Nodes
from rnc_pin.optimal.transcription import Iterate


def output_nodes(
    model: ActionModel, at: Iterate
) -> tuple[Float[Array, "K 2 k"], Float[Array, "K 2 k"], Float[Array, "K 2 k"]]:
    """Reducing and vertical outputs, their rates and accelerations, with the input of the interval at both ends.

    Rotations are rotation vectors without jumps, with the derivatives of these vectors.
    """
    ends = [_measured(model, Nodes(at.q[k:][: len(at.u)], at.w[k:][: len(at.u)]), at.u) for k in (0, 1)]
    position, velocity, acceleration = (np.stack(each, axis=1) for each in zip(*ends, strict=True))
    h, r = at.duration / len(at.u), model.r
    quasi = np.flatnonzero(model.reduced.reducing.quasi)
    rates, changes = velocity[:, :, quasi], acceleration[:, :, quasi]
    # Integral of the cubic with these rates and accelerations at the ends.
    steps = h / 2 * rates.sum(axis=1) + h**2 / 12 * (changes[:, 0] - changes[:, 1])
    total = np.concatenate([np.zeros((1, len(quasi))), np.cumsum(steps, axis=0)])
    position[:, 0, quasi], position[:, 1, quasi] = total[:-1], total[1:]
    for stack, first in ((model.reduced.reducing, 0), (model.reduced.vertical, r)):
        columns = slice(first, first + stack.size)
        _continue(stack.coordinates, position[:, :, columns], velocity[:, :, columns], acceleration[:, :, columns])
    return position, velocity, acceleration


def _measured(model: ActionModel, nodes: Nodes, u: Array) -> tuple[Array, Array, Array]:
    """Outputs, rates and accelerations at n nodes; quasi-velocities have no value yet."""
    v2 = model.velocity(nodes, u)
    v2_dot = np.zeros_like(v2) if model.form == "kinematic" else model.flow(nodes, u)[1]
    seen = model.reduced.at(nodes.q, v2).measure(np.zeros(v2.shape))
    v1_dot = np.einsum("kij,kj->ki", seen.A_star, v2_dot) + np.einsum("kij,kj->ki", seen.A_star_dot, v2)
    if seen.v1_offset_dot is not None:
        v1_dot = v1_dot + seen.v1_offset_dot
    return (
        np.concatenate([seen.x2, seen.x1], axis=1),
        np.concatenate([v2, seen.v1], axis=1),
        np.concatenate([v2_dot, v1_dot], axis=1),
    )


def _continue(coordinates: Coordinates, position: Array, velocity: Array, acceleration: Array) -> None:
    """Remove jumps of angles and rotation vectors, and turn angular rates into rates of rotation vectors, in place."""
    K = len(position)
    whole = coordinates.unwrap(np.concatenate([position[:, 0], position[-1:, 1]]))
    position[:, 0], position[:, 1] = whole[:-1], whole[1:]
    for first in coordinates.rotations:
        triple = slice(first, first + 3)
        for k in range(K):
            for end in (0, 1):
                r, w, w_dot = (each[k, end, triple].copy() for each in (position, velocity, acceleration))
                J, _ = left_jacobian(r, np.zeros(3))
                r_dot = np.linalg.solve(J, w)
                J_dot = left_jacobian(r, r_dot)[1]
                velocity[k, end, triple] = r_dot
                acceleration[k, end, triple] = np.linalg.solve(J, w_dot - J_dot @ r_dot)
