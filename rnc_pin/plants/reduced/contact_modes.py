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
from rnc_pin.model.rows import ConstraintKind
from rnc_pin.model.system import NonholonomicSystem
from rnc_pin.plants.reduced.reduced_plant import ReducedPlant
from rnc_pin.plants.reduced.unilateral_contact import BoundContact

_FORCE = 1e-9  # force that counts as zero, relative to the sum of all, plus 1 N
_MOTION = 1e-8  # velocity or acceleration of a gap that counts as zero, relative to those of the robot, plus 1
_SMALL = 1e-9

Closed = frozenset[int]
"""Indices of the closed contacts."""
NONE: Closed = frozenset()

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
        found = self._change(sorted(closed))
        if found is None:
            return False
        _, y, _, normal = found
        pushing = (normal >= -force * (1.0 + np.abs(normal).sum())).all()
        return bool(pushing) and all(self._leaves(k, y, motion) for k in self._contacts if k not in closed)

    def together(self, closed: Iterable[int]) -> Impact:
        """Impact in which all contacts of a set take part: they do not slip, and rebound by the energetic law.

        Slip stops first. The gap rate that remains is compressed to zero; the rebound returns the share ``e^2`` of the
        work of the compression (Stronge 1990). So no coefficient creates energy. Without slip this is Newton's law.

        Raises:
            SimulationError: the rows of the set contradict each other.
        """
        numbers = sorted(closed)
        found = self._change(numbers)
        if found is None:
            raise SimulationError("the rows of contacts that close together contradict each other")
        names, y, tangential, normal = found
        return self._impact(numbers, names, y, tangential, normal)

    def _change(self, numbers: list[int]) -> tuple[list[str], np.ndarray, np.ndarray, np.ndarray] | None:
        """Names of the rows besides the gaps, change y, impulses of both kinds of rows; None if these contradict."""
        slips, changes, names = self._without_slip(numbers)
        E, stop = np.vstack(slips), np.concatenate(changes)
        G = np.vstack([E[:0], *(self._heights[number] for number in numbers)])
        rates = np.array([self._rates[number] for number in numbers])
        left = rates + G @ (np.linalg.pinv(E, rcond=_SMALL) @ stop)  # once slip has stopped
        rows = np.vstack([E, G])
        inverse = np.linalg.pinv(rows, rcond=_SMALL)
        coefficients = self._coefficients(numbers)
        wanted = np.concatenate([stop, -rates])
        plastic = inverse @ wanted
        rebound = np.concatenate([np.zeros(len(E)), -coefficients * left])
        compression = inverse @ np.concatenate([np.zeros(len(E)), -left])
        rebound = rebound * _least_scale(coefficients, compression, inverse @ rebound)
        wanted = wanted + rebound
        y = plastic + inverse @ rebound
        if np.abs(rows @ y - wanted).max(initial=0.0) > _CONTRADICTS * (1.0 + np.abs(self._v).max()):
            return None
        impulses = inverse.T @ y
        if (impulses[len(E) :] < 0).any():
            impulses = impulses + _shift(impulses[len(E) :], scipy.linalg.null_space(rows.T, rcond=_SMALL), len(E))
        return names, y, impulses[: len(E)], impulses[len(E) :]

    def _coefficients(self, numbers: list[int]) -> np.ndarray:
        """Coefficient of each contact (c,); zero if all are slow."""
        rebounds = any(self._contacts[number].rebound(self._rates[number]) for number in numbers)
        return np.array([float(self._contacts[number].contact.restitution) * rebounds for number in numbers])

    def _impact(
        self, numbers: list[int], names: list[str], y: np.ndarray, tangential: np.ndarray, normal: np.ndarray
    ) -> Impact:
        v_after = self._v + scipy.linalg.solve_triangular(self._L, y, lower=True, trans="T")
        for array in (self._v, v_after):
            array.setflags(write=False)
        named = dict(zip(names, tangential.tolist(), strict=True))
        named |= {self._contacts[number].row: impulse for number, impulse in zip(numbers, normal.tolist(), strict=True)}
        energies = (float(0.5 * each @ self._M @ each) for each in (self._v, v_after))
        return Impact(self._v, v_after, MappingProxyType(named), *energies)

    def _leaves(self, number: int, y: np.ndarray, motion: float) -> bool:
        """True if a contact separates after a change y, or stays without slip."""
        rows, change, _ = self._slips[number]
        rate, slip = float(self._heights[number][0] @ y) + self._rates[number], rows @ y - change
        return rate > motion or (rate >= -motion and np.abs(slip).max(initial=0.0) <= motion)

    def sticking(self) -> Impact | None:
        """Impact of least change of velocity, measured by kinetic energy, after which no contact slips or comes closer.

        This is Gauss's principle for impacts: a quadratic program with impulses that only push, and no slip of all
        contacts. Its impulses of the gaps are those of the compression. Rebounds follow as in ``together``, unless
        another contact would come closer by them.

        Returns:
            The impact; None if no velocity satisfies the conditions.
        """
        numbers = list(self._contacts)
        slips, changes, names = self._without_slip(numbers)
        E, wanted = np.vstack(slips), np.concatenate(changes)
        inverse = np.linalg.pinv(E, rcond=_SMALL)
        first = inverse @ wanted
        if np.abs(E @ first - wanted).max(initial=0.0) > _SMALL * (1.0 + np.abs(self._v).max()):
            return None
        G = np.vstack(list(self._heights.values()))
        free = G - (G @ inverse) @ E
        rates = np.array(list(self._rates.values()))
        found = _least_distance(free, -rates - G @ first)
        if found is None:
            return None
        more, normal = found
        coefficients = self._coefficients(numbers)
        rebound = free.T @ (coefficients * normal)
        scale = _least_scale(coefficients, more, rebound)
        y, pushes = first + more + scale * rebound, (1.0 + scale * coefficients) * normal
        if (G @ y + rates < -_MOTION * (1.0 + np.abs(self._v).max())).any():
            y, pushes = first + more, normal
        return self._impact(numbers, names, y, inverse.T @ (y - G.T @ pushes), pushes)

    def _without_slip(self, numbers: Iterable[int]) -> tuple[list[np.ndarray], list[np.ndarray], list[str]]:
        """Rows of the system and of contacts that do not slip, the changes of their velocities, and their names."""
        slips = [self._slips[number] for number in numbers]
        names = [*self._names, *(name for each in slips for name in each[2])]
        return (
            [self._rows, *(each[0] for each in slips)],
            [np.zeros(len(self._rows)), *(each[1] for each in slips)],
            names,
        )


def _least_scale(coefficients: np.ndarray, compression: np.ndarray, rebound: np.ndarray) -> float:
    """Factor of at most 1 with which a rebound has no more than the largest share of the compression's energy."""
    length = float(np.linalg.norm(rebound))
    allowed = float(coefficients.max(initial=0.0) * np.linalg.norm(compression))
    return 1.0 if length <= allowed else allowed / length


def _shift(normal: np.ndarray, null: np.ndarray, first: int) -> np.ndarray:
    """Change of all impulses, without effect on the motion, that leaves the normal ones (c,) not negative."""
    shared = nonnegative(normal, null[first:])
    return np.asarray(null @ np.linalg.lstsq(null[first:], shared - normal, rcond=None)[0])


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
        self, system: NonholonomicSystem, contacts: list[BoundContact], plant_of: Callable[[ReducedModel], ReducedPlant]
    ) -> None:
        self._system, self.contacts, self._plant_of = system, contacts, plant_of
        self._kinematics = Kinematics(system.robot)
        self._plants: dict[tuple[Closed, Closed], ReducedPlant] = {}

    def plant(self, closed: Closed, clinging: Closed = NONE) -> ReducedPlant:
        """Plant with a set of closed contacts, and others that do not slip though nothing presses them.

        Raises:
            ConstraintError: the constraints of the set cannot act together.
        """
        if (closed, clinging) not in self._plants:
            kinds: list[ConstraintKind] = [self.contacts[number].contact.constraint for number in sorted(closed)]
            kinds += [self.contacts[number].friction for number in sorted(clinging)]
            try:
                reduced = self._system.with_constraints(kinds, may_stop=True).reduce()
            except ConstraintError as error:
                raise error.within(f"contacts {self.names(closed)} closed") from None
            self._plants[closed, clinging] = self._plant_of(reduced)
        return self._plants[closed, clinging]

    def names(self, closed: Iterable[int]) -> str:
        """Names of contacts in a message."""
        return ", ".join(self.contacts[number].name for number in sorted(closed)) or "none"

    def position(self, q: np.ndarray) -> PositionKinematics:
        """Kinematics at a configuration (nq,)."""
        return self._kinematics.position(q)

    def forces(self, closed: Closed, plant: ReducedPlant) -> np.ndarray:
        """Normal forces (c,) of the closed contacts in order [N]; none below zero if they can share the load so.

        Args:
            closed: contacts that are closed in the model of the plant.
            plant: the plant, with its inputs.
        """
        rows, state = plant.reduced.all_constraints.names, plant.state
        up = [rows.index(self.contacts[number].row) for number in sorted(closed)]
        return _shared(state.contact_forces(plant.applied, plant.external)[up], state.all_rows, up)

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
            slides = any(self.contacts[number].slips for number in closed)
            jump = impacts.together(closed) if slides else self._impact(closed, rates, q, v, t)
            return frozenset(each for each in touching if self.contacts[each].gap_rate(at, jump.v) <= speed), jump
        found = impacts.sticking()
        if found is None or found.loss < -_SMALL * found.energy_before:
            raise SimulationError(
                f"impact of {self.names(touching)} at t = {t:.4f} s: no velocity after it keeps the contacts apart "
                "without slip"
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
        forces, state = self.forces(closed, plant), plant.state
        if (forces < -force_margin(forces)).any():
            return False
        if not others:
            return True
        v_dot = state.acceleration(plant.applied, plant.external)
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
