"""Bounds of the contact forces of a plan: wheels stay on the ground, and within friction."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy import ndarray as Array

from rnc_pin.analysis.contact_force_gradients import ContactForceGradients
from rnc_pin.analysis.contact_force_set import ContactForceSet, SolvedForces, dependent_groups, linked_contacts
from rnc_pin.analysis.derivatives import state_derivatives
from rnc_pin.array_shapes import Float
from rnc_pin.errors import ConfigurationError, RncError
from rnc_pin.math.cone_margin import cone_margin
from rnc_pin.model.parameter_types import NotNegative, Positive
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.optimal.action_models import ActionModel
from rnc_pin.optimal.bounds import BoundKind, NodeBound
from rnc_pin.optimal.node_data import NodeData, RowValues

_SAMPLES = 3  # configurations that decide which contacts have a choice


@dataclass(frozen=True)
class NormalForceBound(BoundKind):
    """Smallest normal force of every contact: above zero, no wheel, ball or caster lifts off.

    Rigid bodies do not determine how four wheels share the weight. Contacts that such a choice links have one row: the
    largest least force that the choice leaves possible. Derivatives of the forces are exact.

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
    determine how the wheels of one axle share a lateral force. Contacts that such a choice links have one row: the
    largest least margin that the choice leaves possible, as in ``Grip``. Casters only push. Derivatives are exact.

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
    """Margins of contact forces, one row for each contact, or for contacts whose forces depend on each other."""

    def __init__(self, model: ActionModel, friction: float | None, least: float) -> None:
        reduced, kind = model.reduced, "NormalForceBound" if friction is None else "GripBound"
        if model.form == "kinematic" or not reduced.p:
            raise ConfigurationError(f"{kind}: contact forces need form 'dynamic' or 'acceleration', and actuators")
        if model.form == "acceleration" and reduced.p != reduced.r:
            raise ConfigurationError(
                f"{kind}: {reduced.r} accelerations do not determine {reduced.p} inputs; use form 'dynamic'"
            )
        self._set, self._friction = ContactForceSet(reduced, along=friction is not None), friction
        self._gradients = ContactForceGradients(reduced, self._set)
        if not len(self._set.contacts) or not (friction is None or self._set.gripping.any()):
            raise ConfigurationError(f"{kind}: no contact of this system {'carries' if friction is None else 'grips'}")
        self._groups = _groups(self._set, reduced)
        self._axis = np.where(self._set.gripping, friction or 1.0, 1.0)
        self.quantity = "normal_force" if friction is None else "grip"
        names = [", ".join(self._set.names[each] for each in group) for group in self._groups]
        super().__init__(names, least, None, False, ["N"] * len(names))

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
        solved = self._set.solve(state.q, state.all_rows, self._set.needed(state, T))
        value, z, duals = self._margins(solved, exact=derivatives)
        if not derivatives:
            return RowValues(value)
        y = solved.y[:, None] + np.einsum("nyd,nrd->nry", solved.lift, z)
        by_forces = np.einsum("nrmk,mky->nry", duals, self._set.selection)
        shares = np.einsum("nye,nry->nre", solved.inverse, by_forces)
        q, v2, T_ = self._gradients.at(state, T, y, shares)
        if dynamic:
            return RowValues(value, np.concatenate([q, v2], axis=2), T_)
        motion = state_derivatives(reduced, state.q, w, T)
        inverse = np.linalg.inv(motion.v2_dot_T)
        u = T_ @ inverse
        return RowValues(value, np.concatenate([q - u @ motion.v2_dot_q, v2 - u @ motion.v2_dot_v2], axis=2), u)

    def _margins(self, solved: SolvedForces, exact: bool) -> tuple[Array, Array, Array]:
        """Margins (N, r), the choices z (N, r, d) and derivatives by the contact forces (N, r, m, k).

        Where the margin needs not be exact, a choice that is beyond the limit is enough.
        """
        weights = np.zeros(self._set.selection.shape[:2])
        weights[:, 0], weights[:, 1:] = self._axis, self._set.gripping[:, None]
        forces, free = weights * solved.forces, weights[:, :, None] * solved.free
        N, d = len(forces), free.shape[-1]
        value, z = np.empty((N, len(self._groups))), np.zeros((N, len(self._groups), d))
        duals = np.zeros((N, len(self._groups), *weights.shape))
        for row, group in enumerate(self._groups):
            along = np.linalg.norm(forces[:, group, 1:], axis=2)
            margins = forces[:, group, 0] - along
            value[:, row] = margins.min(axis=1)
            duals[:, row, group[0], 0] = 1.0
            duals[:, row, group[0], 1:] = -forces[:, group[0], 1:] / np.where(along[:, :1] > 0, along[:, :1], 1.0)
            if len(group) == 1 and not np.any(free[:, group[0]]):
                continue
            some = np.flatnonzero(exact | (value[:, row] < self.lower[row]))
            best = cone_margin(forces[np.ix_(some, group)], free[np.ix_(some, group)])
            value[some, row], z[some, row] = best.margin, best.z
            duals[some, row] = 0.0
            duals[np.ix_(some, [row], group)] = best.duals[:, None]
        return value, z, weights * duals


def _groups(forces: ContactForceSet, reduced: ReducedModel) -> list[list[int]]:
    """Contacts whose forces a choice links at some configuration, and each of the others alone."""
    generator, linked = np.random.default_rng(0), np.zeros((len(forces.contacts),) * 2, dtype=bool)
    for q in (reduced.robot.configuration(), *(reduced.robot.random_configuration(generator) for _ in range(_SAMPLES))):
        with suppress(RncError):
            state = reduced.at(reduced.assembled(q))
            linked |= linked_contacts(forces.free(state.q[None], state.all_rows[None]))[0]
    groups = dependent_groups(linked)
    inside = {each for group in groups for each in group}
    return sorted([*groups, *([each] for each in range(len(forces.contacts)) if each not in inside)])
