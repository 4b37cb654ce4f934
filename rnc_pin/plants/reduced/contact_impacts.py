"""Impacts of contacts that touch at one state: which of them take part, and the impact in which none of them slips."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import MappingProxyType

import numpy as np
import scipy

from rnc_pin.analysis.normal_forces import nonnegative
from rnc_pin.model.impact import Impact
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.plants.reduced.unilateral_contact import BoundContact

_SMALL = 1e-9
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
