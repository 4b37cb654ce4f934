"""Limits of a program, their relaxation if they exclude each other, and conditions of the ground on contact forces."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, cast

import numpy as np
from scipy.linalg import null_space

from rnc_pin.analysis.contact_forces import ContactForceSet
from rnc_pin.array_shapes import Array, Float, Int
from rnc_pin.errors import ConfigurationError
from rnc_pin.math.convex_programs import ROUNDING, nearest_point
from rnc_pin.model.cached_property import cached_property
from rnc_pin.model.evaluator import evaluator_for
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.rows import OutputStack
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.motion.whole_body.limits.control_limit import (
    BoundLimit,
    ControlLimit,
    ControlSample,
    HeldMotion,
    LimitRows,
)

_SIDES = 8  # of the pyramid inside a friction cone
_RANK = 1e-10


class ContactBounds(NamedTuple):
    """Conditions ``rows [T; z] <= upper`` of the ground on inputs T and on undetermined contact forces z."""

    rows: Float[Array, "k x"]
    upper: Float[Array, " k"]


class ContactCones:
    """Conditions of the ground on the contact forces of a model: normal forces push, friction stays in its cone.

    With the constraint forces ``A^T lambda`` of the dynamics, and the balance of a planar base upwards and about the
    axes along the ground, the forces y of all contacts satisfy ``W y = y0 + Y T``. Rigid bodies leave some of them
    undetermined, e.g. for two wheels on one axle. So the program has these undetermined parts as unknowns beside the
    inputs.

    The cone is a pyramid of eight sides inside the true cone. Contacts are those of ``NormalForces``: wheels, balls,
    blades, casters.

    Args:
        reduced: the model.
        friction: coefficient of friction of the ground; None if only the normal forces matter.

    Attributes:
        names: name of each condition, (k,).
    """

    def __init__(self, reduced: ReducedModel, friction: float | None) -> None:
        self._reduced, self._friction = reduced, friction or 0.0
        self._forces = ContactForceSet(reduced)
        self._normal = self._forces.normal
        self._carrying = [self._forces.contacts.index(each) for each in self._normal.contacts]
        self._gripping = [
            (place, len(contact.along))
            for place, contact in enumerate(self._forces.contacts)
            if friction is not None and place in self._carrying and contact.along
        ]
        # Without friction, forces along the ground have no condition: the balance of upward forces is enough.
        self._upward = not (self._gripping or self._normal.carried_by_row.any())
        names = [f"{name} normal force" for name in self._normal.names]
        for place, along in self._gripping:
            names += [f"{self._forces.names[place]} friction"] * (2 if along == 1 else _SIDES)
        self.names = tuple(names)
        self._none = ContactBounds(np.zeros((0, reduced.p)), np.zeros(0))
        if self.names:  # with all constraint rows as outputs; made now, as it takes longer than a sample
            rows = cast("OutputStack", reduced.all_constraints)
            self._measuring = evaluator_for(reduced.reduction_data.measuring(rows), reduced.evaluator)

    def at(self, state: StateEvaluation) -> ContactBounds:
        """Return the conditions at one state."""
        p = self._reduced.p
        if not self.names:
            return self._none
        effects, needed = self._forces.equations(state, self._rows(state), np.eye(p + 1, p, -1))
        # Rigid bodies leave some forces undetermined: these become unknowns beside the inputs.
        left, values, right = np.linalg.svd(effects[0])
        rank = int((values > _RANK * values[0]).sum())
        inverse = right[:rank].T @ (left[:, :rank] / values[:rank]).T
        # All contact forces: constant part, gain of T, gain of z.
        unknowns = np.column_stack([inverse @ needed[0], inverse @ (needed[1:] - needed[0]).T, right[rank:].T])
        whole = self._conditions @ unknowns
        return ContactBounds(whole[:, 1:], -whole[:, 0])

    def excess(self, states: StateEvaluation, T: Float[Array, "N p"]) -> Float[Array, " k"]:
        """Largest amount by which each condition fails at states (N,) under inputs, for the best forces."""
        effects, needed = self._forces.equations(states, self._rows(states), T)
        found = np.matvec(np.linalg.pinv(effects, _RANK), needed) @ self._conditions.T
        # The forces of least norm need not be the best ones: undetermined forces may mend what these violate.
        for number in np.flatnonzero((found > 0.0).any(axis=1)):
            free = self._conditions @ null_space(effects[number], _RANK)
            point = nearest_point(np.zeros(free.shape[1]), free, np.full(len(free), -np.inf), -found[number])
            if free.shape[1] and point is not None:
                found[number] += free @ point.point
        return np.asarray(found.max(axis=0))

    def _rows(self, state: StateEvaluation) -> Float[Array, "*batch l nv"]:
        """All constraint rows at states; none if only upward forces matter."""
        if self._upward:
            return np.zeros((*state.batch, 0, 0))
        # Moving ground is not among the outputs that the kernel measures.
        return state.all_rows if self._reduced.affine else state.configuration.in_reduction(self._measuring).J1

    @cached_property
    def _conditions(self) -> Float[Array, "k y"]:
        """Conditions on all contact forces: rows that are not positive."""
        forces = self._forces.selection[..., self._reduced.all_constraints.size if self._upward else 0 :]
        rows = [-forces[self._carrying, 0]]
        for place, along in self._gripping:
            sides = 2 if along == 1 else _SIDES
            angles = 2 * np.pi * np.arange(sides) / sides
            across = np.cos(angles)[:, None] * forces[place, 1]
            if along > 1:
                across = across + np.sin(angles)[:, None] * forces[place, 2]
            # Corners of the pyramid are on the cone: no force inside it slips.
            inside = self._friction * (1.0 if sides == 2 else np.cos(np.pi / sides))
            rows.append(across - inside * forces[place, 0])
        return np.vstack(rows)


_VELOCITY_COST = 1e-4  # of a velocity, beside the cost 1 of exceeding a limit
_ROUNDING = 1e-9  # [of a row] by which bounds are widened after they gave way


class ProgramBounds(NamedTuple):
    """Limits on the reduced velocity, without idle rows: ``lower <= rows v2 <= upper``."""

    rows: Float[Array, "k r"]
    lower: Float[Array, " k"]
    upper: Float[Array, " k"]
    places: Int[Array, " k"]
    """Indices of the rows among the names of all limits."""
    total: int
    """Number of names."""

    def shifted(self, shifts: Float[Array, "2 total"]) -> ProgramBounds:
        """Return bounds that are changed by these amounts."""
        lower, upper = shifts[:, self.places]
        return self._replace(lower=self.lower + lower, upper=self.upper + upper)


class LimitStack:
    """All limits of a program.

    Limits give way in groups: soft limits with the largest ``priority`` first, hard limits last.

    Args:
        limits: the limits.
        reduced: the model.

    Attributes:
        names: name of each row, (k,).
        throughout: mask of the rows whose bounds hold for all velocities within the sample, (k,).
        spacing: longest motion of a velocity between two checks of a braking motion [m, rad]; infinite if all limits
            know each of its steps.
        judged_by_rows: mask of the rows that a velocity exceeds if it violates them in its sample, (k,).
        ends_judged_by_rows: True if there are such rows of limits that do not know each step of a braking motion.
    """

    def __init__(self, limits: Sequence[ControlLimit], reduced: ReducedModel) -> None:
        for each in limits:
            if not isinstance(each, ControlLimit):
                raise ConfigurationError(f"a limit has to be a ControlLimit, found {type(each).__name__}")
        self._bound = [each.bind(reduced) for each in limits]
        sizes = [len(each.names) for each in self._bound]
        self.names = distinct([name for each in self._bound for name in each.names])
        self.throughout = np.repeat([each.throughout for each in self._bound], sizes).astype(bool)
        stops = np.cumsum([0, *sizes])
        self._places = [np.arange(stop - size, stop) for stop, size in zip(stops[1:], sizes, strict=True)]
        # Hard limits are the first group: they give way last.
        ranks = np.repeat([-1 if each.hard else each.priority for each in limits], sizes).astype(int)
        hard = np.repeat([each.hard for each in limits], sizes).astype(bool)
        self._groups = [np.flatnonzero(hard), *(np.flatnonzero(~hard & (ranks == p)) for p in sorted({*ranks[~hard]}))]
        constant = [each.jacobian for each in self._bound if each.jacobian is not None]
        # Limits of joints have the same rows in each sample: stacked once, they are not copied again.
        all_constant = constant and len(constant) == len(limits)
        self._constant = (np.vstack(constant), np.arange(stops[-1])) if all_constant else None
        self._nothing, self._none, self._nowhere = np.zeros((0, reduced.n)), np.zeros(0), np.zeros(0, dtype=int)
        self._affine = reduced.affine
        by_rows = [type(each).exceeded_by is BoundLimit.exceeded_by for each in self._bound]
        self.judged_by_rows = np.repeat(by_rows, sizes).astype(bool)
        self._along = [type(each).along is not BoundLimit.along for each in self._bound]
        at_ends = [each for each, along in zip(self._bound, self._along, strict=True) if not along]
        self.spacing = min((each.spacing for each in at_ends), default=np.inf)
        self.ends_judged_by_rows = bool((self.judged_by_rows & ~np.repeat(self._along, sizes).astype(bool)).any())

    def rows(self, sample: ControlSample, braking: bool = False) -> LimitRows:
        """Return the limits at the end of a sample on the full velocity, without idle rows.

        Args:
            sample: the sample.
            braking: True for the rows of a braking motion.
        """
        each = [limit.braking_rows(sample) if braking else limit.rows(sample) for limit in self._bound]
        found = [(rows, where) for rows, where in zip(each, self._places, strict=True) if rows is not None]
        if self._constant:
            whole, chosen = self._constant
        else:
            whole = np.concatenate([self._nothing, *(rows.jacobian for rows, _ in found)])
            places = [where if rows.places is None else where[rows.places] for rows, where in found]
            chosen = np.concatenate([self._nowhere, *places])
        sides = np.concatenate([self._none, *(rows.lower for rows, _ in found), *(rows.upper for rows, _ in found)])
        low, high = sides[: len(chosen)], sides[len(chosen) :]
        # One product finds whether any bound is missing; most programs have all.
        if not sides.dot(sides) < np.inf:
            used = np.isfinite(low) | np.isfinite(high)
            whole, low, high, chosen = whole[used], low[used], high[used], chosen[used]
        return LimitRows(whole, low, high, chosen)

    def bounds(self, sample: ControlSample) -> ProgramBounds:
        """Return the limits at the end of a sample, with ``v = R v2 + b``."""
        J, low, high, places = self.rows(sample)
        assert places is not None
        # Moving constraints carry the robot along: the program has what is left of each bound.
        if self._affine:
            offset = J @ sample.end.b
            low, high = low - offset, high - offset
        return ProgramBounds(J.dot(sample.end.R), low, high, places, len(self.names))

    def exceeded(
        self,
        state: StateEvaluation,
        time: float,
        rows: LimitRows | None = None,
        turning: Array | None = None,
        at_ends: bool = False,
    ) -> Float[Array, " k"]:
        """Return the amount by which a state exceeds each limit (k,); zero if it satisfies the limit.

        Args:
            state: the state.
            time: its time [s].
            rows: rows of the sample that led to the state, for limits that its velocity decides; None for a start.
            turning: velocities (nv,) at which the joints turned within this sample; None for a start.
            at_ends: True for the limits that do not know each step of a braking motion; the others are left out.
        """
        found = np.zeros(len(self.names))
        # At a start, no sample has led to the state: its velocity may have any cause.
        if rows is not None:
            reached = rows.jacobian @ state.v
            found[rows.places] = np.maximum(reached - rows.upper, rows.lower - reached)
        for limit, where, along in zip(self._bound, self._places, self._along, strict=True):
            own = None if at_ends and along else limit.exceeded_by(state, time, turning)
            if own is not None:
                found[where] = own
        return np.maximum(found, 0.0)

    def along(self, motion: HeldMotion) -> Float[Array, "K k"]:
        """Return the amount by which each step of a braking motion exceeds each limit; -inf if its states decide.

        Args:
            motion: the motion.
        """
        found = np.full((len(motion.mean), len(self.names)), -np.inf)
        for limit, where, along in zip(self._bound, self._places, self._along, strict=True):
            if along:
                found[:, where] = limit.along(motion)
        return found

    def relaxed(self, bounds: ProgramBounds, before: Sequence[Array] = ()) -> tuple[ProgramBounds, Array] | None:
        """Return bounds that some velocity satisfies, and such a velocity; None if the solver finds none.

        Groups are added one by one: those of ``before``, hard limits, soft ones. Each gives way by the least sum of
        squares that the groups before it allow.

        Args:
            bounds: the bounds; their first places are those of the limits.
            before: groups of further places, which give way after all limits.
        """
        rows, lower, upper = bounds.rows, bounds.lower.copy(), bounds.upper.copy()
        r = rows.shape[1]
        fixed, inside = np.zeros(0, dtype=int), np.zeros(r)
        for members in (*before, *self._groups):
            belongs = np.zeros(bounds.total, dtype=bool)
            belongs[members] = True
            group = np.flatnonzero(belongs[bounds.places])
            both = np.concatenate([fixed, group])
            # A coarse solution would count a group as compatible that is not.
            found = nearest_point(np.zeros(r), rows[both], lower[both], upper[both], coarse=False)
            if found is not None:
                inside = found.point
            else:
                v2 = self._least_excess(bounds._replace(lower=lower, upper=upper), fixed, group)
                if v2 is None:
                    return None
                inside = v2
                # Room for the tolerance of the solver, or the next group finds no velocity within these bounds.
                values, room = rows[group] @ v2, _ROUNDING * (1.0 + np.abs(rows[group]).sum(axis=1))
                lower[group] = np.where(values < lower[group], values - room, lower[group])
                upper[group] = np.where(values > upper[group], values + room, upper[group])
            fixed = both
        return bounds._replace(lower=lower, upper=upper), inside

    @staticmethod
    def _least_excess(bounds: ProgramBounds, fixed: Array, group: Array) -> Array | None:
        """Velocity (r,) that exceeds the rows of a group least, within the rows before it; None if it is not found."""
        r, k = bounds.rows.shape[1], len(group)
        # Without a cost of the velocity, the least excess would leave it undetermined.
        # Variables: the velocity times its cost, and the excess of each row of the group.
        free = np.zeros((len(fixed) + 2 * k, r + k))
        both = np.concatenate([fixed, group, group])
        free[:, :r] = bounds.rows[both] / _VELOCITY_COST
        above, below = slice(len(fixed), len(fixed) + k), slice(len(fixed) + k, None)
        free[above, r:], free[below, r:] = -np.eye(k), np.eye(k)
        lower, upper = bounds.lower[both], bounds.upper[both]
        lower[above], upper[below] = -np.inf, np.inf
        found = nearest_point(np.zeros(r + k), free, lower, upper)
        if found is None:
            return None
        v2 = found.point[:r] / _VELOCITY_COST
        # The tolerance of the solver may exceed bounds of groups that come first: then the answer is of no use.
        values, room = bounds.rows[fixed] @ v2, ROUNDING * (1.0 + np.abs(free[: len(fixed)]).sum(axis=1))
        kept = (values <= bounds.upper[fixed] + room).all() and (values >= bounds.lower[fixed] - room).all()
        return v2 if kept else None


def distinct(names: Sequence[str]) -> tuple[str, ...]:
    """Return names with a number behind every repeated one: "hand x upper", "hand x upper (2)"."""
    numbers = [list(names[: place + 1]).count(name) for place, name in enumerate(names)]
    return tuple(name if k == 1 else f"{name} ({k})" for name, k in zip(names, numbers, strict=True))
