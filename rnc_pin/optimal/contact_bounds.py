"""Bounds of the contact forces of a plan: wheels stay on the ground, and within friction.

Rigid bodies leave some forces y with ``W y = b`` undetermined. A plan is possible if some choice is within the bound.
The choice here is that of ``SmoothMargins``: it maximises a smooth least margin of the contacts that it links. So each
contact has a smooth row of its own. The choice moves with the state, as the conditions of its optimum tell.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy import ndarray as Array

from rnc_pin.analysis.contact_forces import ContactForceGradients, ContactForceSet, dependent_groups, linked_contacts
from rnc_pin.analysis.derivatives import state_derivatives
from rnc_pin.array_shapes import Bool, Float
from rnc_pin.errors import ConfigurationError, RncError
from rnc_pin.model.input_validation import NotNegative, Positive
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.optimal.bounds import BoundKind, NodeBound
from rnc_pin.optimal.node_data import NodeData, RowValues
from rnc_pin.planning.action_models import ActionModel

_SAMPLES = 3  # configurations, beside the neutral one, that decide which contacts have a choice
_SHARPNESS = (30.0, 300.0, 2000.0)
_ROUND = 1e-4  # length below which the norm of a vector is rounded off
_SMALL = 1e-3  # weight of the squares of the vectors: which choice, if margins do not tell
_STEPS = 25  # of Newton's method for each sharpness
_LENGTHS = 0.5 ** np.arange(12)
_SOLVED = 1e-13  # slope at which the method ends


class BestMargins(NamedTuple):
    """Margins at the best choice z, and their sensitivity.

    With a cost f of the vectors c, and its Hessian H, the choice satisfies ``gain^T f_c = 0``. A margin with the slope
    g by c changes by g along a change of c that the choice cannot make. The choice itself moves by
    ``-(gain^T H gain)^-1 gain^T (dgain^T f_c + H dc)``.
    """

    margins: Float[Array, "N m"]
    z: Float[Array, "N d"]
    slope: Float[Array, "N m k"]
    """f_c."""
    change: Float[Array, "N m d"]
    """``a = (gain^T H gain)^-1 gain^T g`` for each margin."""
    sensitivity: Float[Array, "N m m k"]
    """``g - H gain a`` for each margin."""


class SmoothMargins:
    """Margins ``axis_i n_i - |t_i|`` of vectors ``[n_i; t_i] = offset_i + gain_i z``.

    The choice z minimises, for each group of vectors that it links, ``log(sum exp(-s margin)) / s``, plus small squares
    of the vectors. The least margin is less than the largest possible one by at most ``log(m) / s``. The norm is
    ``sqrt(t^2 + e^2)``. Vectors should be of the order of one: s is 2000, and e is 1e-4.

    Args:
        axis: factors of the components n, (m,).
        along: False for vectors of which only n counts, (m,).
        groups: indices of the vectors that choices link.
    """

    def __init__(self, axis: Float[Array, " m"], along: Bool[Array, " m"], groups: Sequence[Sequence[int]]) -> None:
        self._axis, self._along = axis, along
        self._member = np.zeros((len(groups), len(axis)))
        for number, group in enumerate(groups):
            self._member[number, list(group)] = 1.0

    def largest(self, offset: Float[Array, "N m k"], gain: Float[Array, "N m k d"]) -> BestMargins:
        """Return the margins at the best choice, for stacks of vectors."""
        N, m, k = offset.shape
        flat = gain.reshape(N, m * k, gain.shape[-1])
        still = np.eye(flat.shape[-1]) * ~np.any(flat, axis=1)[:, None]  # directions without an effect
        z = np.zeros((N, flat.shape[-1]))
        for sharpness in _SHARPNESS if flat.shape[-1] and len(self._member) else ():
            for _ in range(_STEPS):
                c = offset + np.matvec(flat, z).reshape(N, m, k)
                cost, slope, H = self._cost(c, sharpness)
                left = np.vecmat(slope.reshape(N, -1), flat)
                going = np.abs(left).max(axis=1) > _SOLVED
                if not going.any():
                    break
                step = -np.linalg.solve(flat.mT @ H @ flat + still, left[..., None])[..., 0]
                fall = (left * step).sum(axis=1)
                moved = c[None] + _LENGTHS[:, None, None, None] * np.matvec(flat, step).reshape(N, m, k)
                costs = self._cost(moved.reshape(-1, m, k), sharpness, value_only=True)[0].reshape(-1, N)
                lower = costs <= cost + 1e-4 * _LENGTHS[:, None] * fall + 1e-15
                length = np.where(lower.any(axis=0) & going, _LENGTHS[lower.argmax(axis=0)], 0.0)
                if not length.any():
                    break
                z = z + length[:, None] * step
        c = offset + np.matvec(flat, z).reshape(N, m, k)
        _, slope, H = self._cost(c, _SHARPNESS[-1])
        margins, slopes = self._of(c)
        own = np.zeros((N, m, m, k))
        own[:, np.arange(m), np.arange(m)] = slopes
        g = own.reshape(N, m, m * k)
        inner = flat.mT @ H @ flat + still
        change = np.linalg.solve(inner, flat.mT @ g.mT).mT if flat.shape[-1] else np.zeros((N, m, 0))
        sensitivity = g - change @ flat.mT @ H
        return BestMargins(margins, z, slope, change, sensitivity.reshape(N, m, m, k))

    def _of(self, c: Array) -> tuple[Array, Array]:
        """Margins, and their slopes (N, m, k)."""
        t = c[..., 1:]
        length = np.sqrt((t * t).sum(axis=-1) + _ROUND**2)
        margins = self._axis * c[..., 0] - self._along * length
        slopes = np.empty_like(c)
        slopes[..., 0], slopes[..., 1:] = self._axis, -t * (self._along / length)[..., None]
        return margins, slopes

    def _cost(self, c: Array, sharpness: float, value_only: bool = False) -> tuple[Array, Array, Array]:
        """Cost, its slope (N, m, k) and its Hessian (N, m k, m k)."""
        N, m, k = c.shape
        margins, slopes = self._of(c)
        inside = np.where(self._member > 0, -sharpness * margins[:, None], -np.inf)  # (N, groups, m)
        top = inside.max(axis=2, keepdims=True)
        weights = np.exp(inside - top)
        total = weights.sum(axis=2, keepdims=True)
        weights = weights / total
        linked = self._member.sum(axis=0)[:, None]
        cost = ((np.log(total) + top) / sharpness).sum(axis=(1, 2)) + 0.5 * _SMALL * (linked * c * c).sum(axis=(1, 2))
        if value_only:
            return cost, cost, cost
        weight = weights.sum(axis=1)
        slope = -weight[..., None] * slopes + _SMALL * linked * c
        H = np.zeros((N, m, k, m, k))
        t = c[..., 1:]
        length = np.sqrt((t * t).sum(axis=-1) + _ROUND**2)
        scale = weight * self._along / length
        units = t / length[..., None]
        curved = scale[..., None, None] * (np.eye(k - 1) - units[..., :, None] * units[..., None, :])
        each = np.arange(m)
        H[:, each, 1:, each, 1:] = np.moveaxis(curved, 1, 0)
        parts = (weights[..., None] * slopes[:, None]).reshape(N, -1, m * k)
        H = H.reshape(N, m * k, m * k) - sharpness * np.einsum("nga,ngb->nab", parts, parts)
        H += _SMALL * np.diag(np.repeat(linked[:, 0], k))
        blocks = sharpness * weight[..., None, None] * slopes[..., :, None] * slopes[..., None, :]
        H5 = H.reshape(N, m, k, m, k)
        H5[:, each, :, each, :] += np.moveaxis(blocks, 1, 0)
        return cost, slope, H


@dataclass(frozen=True)
class NormalForceBound(BoundKind):
    """Smallest normal force of every contact: above zero, no wheel, ball or caster lifts off.

    Rigid bodies do not determine how four wheels share the weight: the choice with the largest least force counts, to
    0.1 % of the weight. Rows are in units of the robot's weight, and so are the planner's accuracy and its messages.

    Args:
        least: smallest normal force of each contact [N].

    Raises:
        ConfigurationError: the form of the plan has no forces, or no contact carries.

    Example:
        >>> rnc.optimal.NormalForceBound(20.0).least
        20.0
    """

    least: NotNegative = 0.0

    def bind(self, model: ActionModel) -> NodeBound:
        return ContactForceRows(model, None, self.least)


@dataclass(frozen=True)
class GripBound(BoundKind):
    """Friction cones of the contacts: the ground pushes, and friction is at most ``friction`` times the normal force.

    A row is ``friction`` times the normal force minus the norm of the force along the ground. Rigid bodies do not
    determine how the wheels of one axle share a lateral force: the choice with the largest least row counts, to 0.1 %
    of the weight, as in ``Grip``. Casters only push. Rows are in units of the robot's weight, and so are the planner's
    accuracy and its messages.

    Args:
        friction: coefficient of friction of the ground.

    Raises:
        ConfigurationError: the form of the plan has no forces, no contact grips, or the friction is not positive.

    Example:
        >>> rnc.optimal.GripBound(0.6).friction
        0.6
    """

    friction: Positive

    def bind(self, model: ActionModel) -> NodeBound:
        if not 0 < self.friction < np.inf:
            raise ConfigurationError(f"GripBound: friction has to be positive, found {self.friction}")
        return ContactForceRows(model, self.friction, 0.0)


class ContactForceRows(NodeBound):
    """Margins of contact forces, one row for each contact."""

    def __init__(self, model: ActionModel, friction: float | None, least: float) -> None:
        reduced, kind = model.reduced, "NormalForceBound" if friction is None else "GripBound"
        if model.form == "kinematic" or not reduced.p:
            raise ConfigurationError(f"{kind}: contact forces need form 'dynamic' or 'acceleration', and actuators")
        if model.form == "acceleration" and reduced.p != reduced.r:
            raise ConfigurationError(
                f"{kind}: {reduced.r} accelerations do not determine {reduced.p} inputs; use form 'dynamic'"
            )
        if not reduced.reduction_data.kinematics.axes_are_constant:
            raise ConfigurationError(f"{kind}: the axes of a joint depend on its own position (universal, composite)")
        self._set, self._friction = ContactForceSet(reduced, along=friction is not None), friction
        self._gradients = ContactForceGradients(reduced, self._set)
        if not len(self._set.contacts) or not (friction is None or self._set.gripping.any()):
            raise ConfigurationError(f"{kind}: no contact of this system {'carries' if friction is None else 'grips'}")
        self.quantity = "normal_force" if friction is None else "grip"
        mass = sum(inertia.mass for inertia in list(reduced.robot.model.inertias)[1:])
        weight = mass * float(np.linalg.norm(reduced.robot.model.gravity.linear))
        self._unit = weight if weight > 0 else 1.0
        axis = np.where(self._set.gripping, friction or 1.0, 1.0)
        self._margins = SmoothMargins(axis, self._set.gripping, _groups(self._set, reduced))
        units = ["times the weight"] * len(self._set.names)
        super().__init__(self._set.names, least / self._unit, None, False, units)

    @property
    def titles(self) -> tuple[str, ...]:
        word = "normal force" if self._friction is None else "grip"
        return tuple(f"{word} of {name}" for name in self.names)

    def rows(self, nodes: NodeData, derivatives: bool) -> RowValues:
        reduced, w = nodes.model.reduced, nodes.at.w
        assert nodes.u is not None
        state = reduced.at(nodes.at.q, w)
        dynamic = nodes.model.form == "dynamic"
        T = nodes.u if dynamic else state.allocate(state.inverse_dynamics(nodes.u))
        effects, needed = self._set.equations(state, T)
        solved = self._set.solve(effects, needed / self._unit)
        best = self._margins.largest(solved.forces, solved.free)
        if not derivatives:
            return RowValues(best.margins)
        # With y at the optimum of f(y), f_y = W^T p: see ``SmoothMargins`` for the sensitivity of the choice.
        y = solved.y + np.matvec(solved.lift, best.z)
        p = np.matvec(solved.inverse.mT, np.einsum("nmk,mky->ny", best.slope, self._set.selection))
        shares = np.einsum("nye,nrmk,mky->nre", solved.inverse, best.sensitivity, self._set.selection)
        turned = y[:, None] + np.einsum("nyd,nrd->nry", solved.lift, best.change)
        rows = best.margins.shape[1]
        many_y = np.concatenate([np.repeat(y[:, None], rows + 1, axis=1), turned], axis=1) * self._unit
        many_p = np.concatenate([shares, np.repeat(p[:, None], rows + 1, axis=1)], axis=1) / self._unit
        found = self._gradients.at(state, T, many_y, many_p)
        q, v2, by_T = (each[:, :rows] + each[:, rows : rows + 1] - each[:, rows + 1 :] for each in found)
        if dynamic:
            return RowValues(best.margins, np.concatenate([q, v2], axis=2), by_T)
        motion = state_derivatives(reduced, state.q, w, T)
        u = by_T @ np.linalg.inv(motion.v2_dot_T)
        x = np.concatenate([q - u @ motion.v2_dot_q, v2 - u @ motion.v2_dot_v2], axis=2)
        return RowValues(best.margins, x, u)


def _groups(forces: ContactForceSet, reduced: ReducedModel) -> list[list[int]]:
    """Groups of contacts whose forces a choice links at some configuration."""
    generator, linked = np.random.default_rng(0), np.zeros((len(forces.contacts),) * 2, dtype=bool)
    for q in (reduced.robot.configuration(), *(reduced.robot.random_configuration(generator) for _ in range(_SAMPLES))):
        with suppress(RncError):
            state = reduced.at(reduced.assembled(q))
            linked |= linked_contacts(forces.free(state.q[None], state.all_rows[None]))[0]
    return dependent_groups(linked)
