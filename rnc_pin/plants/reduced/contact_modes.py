"""Models of a system with each set of closed contacts, and the sets that fit contacts that only push.

An impact decides which of the contacts that touch take part in it. If no set of them only pushes, none of them slips.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import combinations
from types import MappingProxyType

import numpy as np
import scipy

from rnc_pin.errors import ConstraintError, SimulationError
from rnc_pin.math.linear_algebra import nonnegative
from rnc_pin.model.impact import Impact, impact
from rnc_pin.model.kinematics import Kinematics, PositionKinematics
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.model.system import NonholonomicSystem
from rnc_pin.plants.reduced.reduced_plant import ReducedPlant
from rnc_pin.plants.reduced.unilateral_contact import BoundContact

_FORCE = 1e-9  # force that counts as zero, relative to the sum of all, plus 1 N
_MOTION = 1e-8  # velocity or acceleration of a gap that counts as zero, relative to those of the robot, plus 1
_SMALL = 1e-9

Closed = frozenset[int]
"""Indices of the closed contacts."""

_CONTRADICTS = 1e-6  # relative velocity by which dependent rows may differ; the exact impact decides


class ContactImpacts:
    """Impacts at one state, in y = L^T (v+ - v-) with M = L L^T: its length measures the kinetic energy of a change.

    Args:
        reduced: model without the contacts, at a constant time.
        q, v: configuration (nq,) and velocity (nv,) before the impact.
        touching: contacts that touch, by number.
    """

    def __init__(
        self, reduced: ReducedModel, q: np.ndarray, v: np.ndarray, touching: Mapping[int, BoundContact]
    ) -> None:
        state = reduced.at(q, v=v)
        at, self._M, self._v, self._contacts = state.position, state.M, np.array(v), touching
        self._L = np.linalg.cholesky(self._M)
        self._names = list(reduced.all_constraints.names)
        self._rows = self._whitened(state.all_rows)
        self._heights = {number: self._whitened(each.jacobian(at)[None]) for number, each in touching.items()}
        self._rates = {number: each.gap_rate(at, v) for number, each in touching.items()}
        self._slips = {}
        for number, each in touching.items():
            rows, speeds, names = each.slip(at)
            self._slips[number] = self._whitened(rows), speeds - rows @ v, names

    def _whitened(self, rows: np.ndarray) -> np.ndarray:
        return np.asarray(scipy.linalg.solve_triangular(self._L, rows.T, lower=True).T)

    def allows(self, closed: Iterable[int], force: float, motion: float) -> bool:
        """True if a set of contacts only pushes in its impact, and the others separate or do not slip.

        Args:
            closed: numbers of the contacts.
            force: impulse that counts as zero, relative to the sum of all, plus 1 N s.
            motion: speed of a gap or a slip that counts as zero [m/s].
        """
        numbers = sorted(closed)
        slips, changes, _ = self._without_slip(numbers)
        rebounds = any(self._contacts[number].rebound(self._rates[number]) for number in numbers)
        for number in numbers:
            coefficient = float(self._contacts[number].contact.restitution) * rebounds
            changes.append(np.array([-(1.0 + coefficient) * self._rates[number]]))
        rows, wanted = np.vstack([*slips, *(self._heights[number] for number in numbers)]), np.concatenate(changes)
        inverse = np.linalg.pinv(rows, rcond=_SMALL)
        y = inverse @ wanted
        if np.abs(rows @ y - wanted).max(initial=0.0) > _CONTRADICTS * (1.0 + np.abs(self._v).max()):
            return False
        normal = (inverse.T @ y)[len(rows) - len(numbers) :]
        if (normal < 0).any():
            normal = nonnegative(normal, scipy.linalg.null_space(rows.T, rcond=_SMALL)[len(rows) - len(numbers) :])
        pushing = (normal >= -force * (1.0 + np.abs(normal).sum())).all()
        return bool(pushing) and all(self._leaves(k, y, motion) for k in self._contacts if k not in numbers)

    def _leaves(self, number: int, y: np.ndarray, motion: float) -> bool:
        """True if a contact separates after a change y, or stays without slip."""
        rows, change, _ = self._slips[number]
        rate, slip = float(self._heights[number][0] @ y) + self._rates[number], rows @ y - change
        return rate > motion or (rate >= -motion and np.abs(slip).max(initial=0.0) <= motion)

    def sticking(self) -> Impact | None:
        """Impact of least change of velocity, measured by kinetic energy, after which no contact slips or comes closer.

        This is Gauss's principle for impacts: a quadratic program whose conditions are Newton's law for the gaps, with
        impulses that only push, and no slip of all contacts.

        Returns:
            The impact; None if no velocity satisfies the conditions.
        """
        slips, changes, names = self._without_slip(list(self._contacts))
        E, wanted = np.vstack(slips), np.concatenate(changes)
        inverse = np.linalg.pinv(E, rcond=_SMALL)
        first = inverse @ wanted
        if np.abs(E @ first - wanted).max(initial=0.0) > _SMALL * (1.0 + np.abs(self._v).max()):
            return None
        G = np.vstack(list(self._heights.values()))
        least = [-(1.0 + each.rebound(self._rates[k])) * self._rates[k] for k, each in self._contacts.items()]
        found = _least_distance(G - (G @ inverse) @ E, np.array(least) - G @ first)
        if found is None:
            return None
        more, normal = found
        y = first + more
        tangential = inverse.T @ (y - G.T @ normal)
        v_after = self._v + scipy.linalg.solve_triangular(self._L, y, lower=True, trans="T")
        for array in (self._v, v_after):
            array.setflags(write=False)
        named = zip(names, tangential.tolist(), strict=True)
        up = {each.row: impulse for each, impulse in zip(self._contacts.values(), normal.tolist(), strict=True)}
        energies = (float(0.5 * each @ self._M @ each) for each in (self._v, v_after))
        return Impact(self._v, v_after, MappingProxyType({**dict(named), **up}), *energies)

    def _without_slip(self, numbers: Iterable[int]) -> tuple[list[np.ndarray], list[np.ndarray], list[str]]:
        """Rows of the system and of contacts that do not slip, the changes of their velocities, and their names."""
        slips = [self._slips[number] for number in numbers]
        names = [*self._names, *(name for each in slips for name in each[2])]
        return (
            [self._rows, *(each[0] for each in slips)],
            [np.zeros(len(self._rows)), *(each[1] for each in slips)],
            names,
        )


def _least_distance(G: np.ndarray, h: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Shortest x with ``G x >= h``, and its multipliers; None if there is none.

    Lawson and Hanson, Solving Least Squares Problems (1974), chapter 23.
    """
    size = max(float(np.abs(h).max(initial=0.0)), 1e-300)
    u, distance = scipy.optimize.nnls(np.vstack([G.T, h / size]), np.append(np.zeros(G.shape[1]), 1.0))
    if distance < _SMALL:
        return None
    multipliers = size * u / (1.0 - (h / size) @ u)
    return G.T @ multipliers, multipliers


class ContactModes:
    """Models of a system with each set of closed contacts, made at their first use.

    Args:
        system: system without the contacts.
        contacts: the contacts.
        plant_of: function from a model to its plant.
    """

    def __init__(
        self,
        system: NonholonomicSystem,
        contacts: list[BoundContact],
        plant_of: Callable[[ReducedModel], ReducedPlant],
    ) -> None:
        self._system, self.contacts, self._plant_of = system, contacts, plant_of
        self._kinematics = Kinematics(system.robot)
        self._plants: dict[Closed, ReducedPlant] = {}

    def plant(self, closed: Closed) -> ReducedPlant:
        """Plant with a set of closed contacts.

        Raises:
            ConstraintError: the constraints of the set cannot act together.
        """
        if closed not in self._plants:
            kinds = [self.contacts[number].contact.constraint for number in sorted(closed)]
            try:
                self._plants[closed] = self._plant_of(self._system.with_constraints(kinds).reduce())
            except ConstraintError as error:
                raise error.within(f"contacts {self.names(closed)} closed") from None
        return self._plants[closed]

    def names(self, closed: Iterable[int]) -> str:
        """Names of contacts in a message."""
        return ", ".join(self.contacts[number].name for number in sorted(closed)) or "none"

    def position(self, q: np.ndarray) -> PositionKinematics:
        """Kinematics at a configuration (nq,)."""
        return self._kinematics.position(q)

    def forces(self, closed: Closed, state: StateEvaluation, T: np.ndarray, external: np.ndarray | None) -> np.ndarray:
        """Normal forces (c,) of the closed contacts in order [N]; none below zero if they can share the load so.

        Args:
            closed: contacts that are closed in the model of the state.
            state: state of that model.
            T: inputs (p,).
            external: generalized forces (nv,) in addition to the inputs, if any.
        """
        rows = self.plant(closed).reduced.all_constraints.names
        up = [rows.index(self.contacts[number].row) for number in sorted(closed)]
        return _shared(state.contact_forces(T, external)[up], state.all_rows, up)

    def after_impact(self, touching: Closed, q: np.ndarray, v: np.ndarray, t: float) -> tuple[Closed, Impact]:
        """Contacts that are closed after an impact, and the impact.

        Contacts that take part push, and those that do not separate. The first such set counts, the largest ones first.
        Friction has no limit, so there may be none. Then no touching contact slips, though not all of them push.
        If no row of the touching contacts is faster than their rest speeds, all of them close: a body that rocks or
        slips ever more slowly comes to rest, although each impact alone would open a contact again.

        Args:
            touching: contacts without a gap.
            q, v: configuration (nq,) and velocity (nv,) before the impact.
            t: time [s].

        Raises:
            SimulationError: no impact is possible.
            ConstraintError: a set of contacts leaves no motion.
        """
        at = self.position(q)
        rates = {number: self.contacts[number].gap_rate(at, v) for number in touching}
        if all(self.contacts[number].at_rest(at, v) for number in touching):
            return touching, self._impact(touching, rates, q, v, t)
        impacts, speed = self._impacts(touching, q, v, t), _MOTION * (1.0 + float(np.abs(v).max()))
        for closed in _subsets(touching):
            if not impacts.allows(closed, _FORCE, speed):
                continue
            jump = self._impact(closed, rates, q, v, t)
            return frozenset(each for each in touching if self.contacts[each].gap_rate(at, jump.v) <= speed), jump
        found = impacts.sticking()
        if found is None or found.loss < -_SMALL * found.energy_before:
            raise SimulationError(
                f"impact of {self.names(touching)} at t = {t:.4f} s: no velocity after it satisfies Newton's law of "
                "restitution without slip: the contacts have to share one coefficient of restitution"
            )
        return frozenset(each for each in touching if self.contacts[each].gap_rate(at, found.v) <= speed), found

    def _impacts(self, touching: Closed, q: np.ndarray, v: np.ndarray, t: float) -> ContactImpacts:
        contacts = {number: self.contacts[number] for number in sorted(touching)}
        return ContactImpacts(self.plant(frozenset()).reduced.frozen(t), q, v, contacts)

    def _impact(self, closed: Closed, rates: dict[int, float], q: np.ndarray, v: np.ndarray, t: float) -> Impact:
        """Impact of a set of contacts, in which all of them take part."""
        reduced, numbers = self.plant(closed).reduced.frozen(t), sorted(closed)
        given = [self.contacts[number] for number in numbers]
        # Below the rest speed no contact rebounds: dependent rows need equal coefficients.
        rebounds = any(each.rebound(rates[number]) for number, each in zip(numbers, given, strict=True))
        return impact(reduced, q, v, {each.row: float(each.contact.restitution) * rebounds for each in given})

    def holds(self, closed: Closed, others: Closed, plant: ReducedPlant) -> bool:
        """True if contacts stay closed by pushing at the state of a plant, and the others do not come closer.

        Args:
            closed: contacts that are closed in the model of the plant.
            others: contacts without a gap that are open.
            plant: the plant, with its inputs.
        """
        state, T, external = plant.state, plant.applied, plant.external
        forces = self.forces(closed, state, T, external)
        if (forces < -force_margin(forces)).any():
            return False
        if not others:
            return True
        v_dot = state.acceleration(T, external)
        at, limit = self.position(state.q).with_velocity(state.v), _MOTION * (1.0 + float(np.abs(v_dot).max()))
        return all(self.contacts[number].gap_acceleration(at, v_dot) >= -limit for number in others)


def force_margin(forces: np.ndarray) -> float:
    """Force [N] that counts as zero beside forces (c,)."""
    return _FORCE * (1.0 + float(np.abs(forces).sum()))


def consistent(candidates: Closed, holds: Callable[[Closed], bool]) -> Closed | None:
    """First set of closed contacts that holds, the largest ones first; None if there is none.

    Args:
        candidates: contacts without a gap.
        holds: function from a set to True if it is consistent.
    """
    return next((closed for closed in _subsets(candidates) if holds(closed)), None)


def _subsets(contacts: Closed) -> Iterator[Closed]:
    for size in range(len(contacts), -1, -1):
        for each in combinations(sorted(contacts), size):
            yield frozenset(each)


def _shared(forces: np.ndarray, rows: np.ndarray, up: list[int]) -> np.ndarray:
    """Forces of the height rows, shared so that none is below zero if that is possible."""
    if not (forces < 0).any():
        return forces
    return nonnegative(forces, scipy.linalg.null_space(rows.T, rcond=_SMALL)[up])
