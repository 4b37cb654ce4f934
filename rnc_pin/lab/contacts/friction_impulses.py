"""Impulses of contacts that push, with Coulomb friction or without slip: complementarity problems of velocities."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator
from itertools import combinations

import numpy as np
import scipy

from rnc_pin.errors import DivergenceError, SimulationError
from rnc_pin.lab.contacts.unilateral_contact import FrictionGroup, RowLayout
from rnc_pin.math.linear_algebra import nonnegative, null_space, solve_positive_definite_columns
from rnc_pin.model.state_evaluation import StateEvaluation


class FrictionImpulses:
    """Impulses p (k,) with velocities ``y = G p + b`` of the rows after them.

    A normal row has ``0 <= p, 0 <= y, p y = 0``. A friction group has ``|p| <= limit``, and where it slides, p has this
    norm and opposes y. Every solution has ``p^T (G p / 2 + b) <= 0``: the impulses never create energy.

    Args:
        G: inverse inertia of the rows (k, k), symmetric and positive semidefinite.
        b: velocities of the rows without impulses (k,).
        normals: rows of the normal impulses.
        groups: friction.
    """

    def __init__(self, G: np.ndarray, b: np.ndarray, normals: list[int], groups: list[FrictionGroup]) -> None:
        self._G, self._b, self._normals, self._groups = G, b, normals, groups
        # Not below rounding: a row that no motion changes would have an infinite step.
        diagonal = np.maximum(G.diagonal(), 1e-12 * G.diagonal().max(initial=1e-300))
        self._scale = 1.0 / diagonal
        for each in groups:
            # One scale for a group: its cone is round, and different scales would make it an ellipse.
            self._scale[each.rows] = 1.0 / diagonal[each.rows].max()
        self._scaled = self._scale[:, None] * G
        self._kept = np.eye(len(b)) - self._scaled  # slope of the projected gradient step
        self._speeds = self._scale * b

    def solve(self, guess: np.ndarray | None = None) -> np.ndarray:
        """Return the impulses (k,).

        Newton's method on the natural map of the conditions alternates with projected Gauss-Seidel sweeps. Where it
        does not converge, the impulses of more sweeps act. They are in the cones of friction, and a factor of at most 1
        keeps them from creating energy.

        Args:
            guess: impulses (k,) near the solution, if they are known.
        """
        p = np.zeros(len(self._b)) if guess is None else guess
        rounds, sweeps = 6, 40
        for _ in range(rounds):
            p, solved = self._newton(p)
            if solved:
                return p
            for _ in range(sweeps):
                p = self._swept(p)
        for _ in range(400):  # they are the whole solution now
            p = self._swept(p)
        square = float(p @ self._G @ p)
        # The factor that minimizes the energy along p, at most 1.
        return p * min(1.0, max(0.0, -float(p @ self._b) / square)) if square > 0.0 else p

    def _held(self, closed: Collection[int]) -> list[int]:
        """Rows of friction without a limit, of contacts with some normal rows."""
        groups = (each for each in self._groups if math.isinf(each.coefficient) and each.normal in closed)
        return [row for each in groups for row in _indices(each)]

    def stop(self) -> np.ndarray:
        """Return the impulses (k,) after which no contact moves along its normal: rocking and bouncing end."""
        return self._stopping([*self._normals, *self._held(self._normals)])

    def is_slow(self, limits: np.ndarray) -> bool:
        """True if no contact moves faster than its limit (c,); its slip counts without a limit of friction.

        Args:
            limits: speed of each contact [m/s], (c,).
        """
        found = zip(self._normals, limits, strict=True)
        return all(np.abs(self._b[[row, *self._held([row])]]).max() <= limit for row, limit in found)

    def _stopping(self, rows: list[int]) -> np.ndarray:
        """Impulses (k,) of least norm along some rows that stop them."""
        p = np.zeros(len(self._b))
        p[rows] = np.linalg.lstsq(self._G[np.ix_(rows, rows)], -self._b[rows], rcond=1e-10)[0]
        return p

    def impact(self, restitution: np.ndarray) -> np.ndarray:
        """Return the impulses (k,) of an impact in two phases: compression, and a rebound.

        The rebound is a share of the one that Newton's coefficients ask for. It returns at most the largest coefficient
        squared of the work of the compression, and never more energy than the compression removed. Slip without a limit
        of friction stops before the compression (Stronge 1990).

        Args:
            restitution: coefficient of each normal row (c,).
        """
        G, normals = self._G, self._normals
        p = self.solve()
        first = self._stopping(self._held([row for row in normals if p[row] > 0.0]))
        y = self._b + G @ first
        rates, stopped = y[normals], self._b + G @ p
        coefficients = np.where(p[normals] > 0.0, restitution, 0.0)
        if not coefficients.any():
            return p
        wanted = stopped.copy()
        wanted[normals] += coefficients * rates  # rates are negative: the rows have to leave at -e rate
        more = type(self)(G, wanted, normals, self._groups).solve()
        # Along a normal the velocity falls from its rate to zero: its mean times the impulse is the work.
        compression = max(-0.5 * float(p[normals] @ rates), 0.0)
        # Energy that the compression took, friction included: a rebound cannot return more.
        removed = max(-float((p - first) @ (y + 0.5 * G @ (p - first))), 0.0)
        allowed = min(float(coefficients.max()) ** 2 * compression, removed)
        linear, square = float(more @ stopped), float(more @ G @ more)
        share = 1.0
        if linear + 0.5 * square > allowed > 0.0:  # the largest s with s linear + s^2 square / 2 = allowed
            share = 2.0 * allowed / (linear + float(np.sqrt(linear**2 + 2.0 * square * allowed)))
        return np.asarray(p + (share if allowed > 0.0 else 0.0) * more)

    def _newton(self, p: np.ndarray) -> tuple[np.ndarray, bool]:
        """Impulses after Newton steps, and True if they are a solution."""
        best, least, smallest = p, np.inf, float(np.abs(self._speeds).max())
        precise = 1e-13  # residual of a solution, relative to the largest impulse
        work = 8  # numbers for each row that LAPACK may use
        for _ in range(25):  # from a better guess, sweeps help more
            F, slope = self._natural_map(p)
            size = float(np.abs(F).max())
            if size < least:
                best, least = p, size
            if size <= precise * max(float(np.abs(p).max()), smallest):
                return self._admissible(p), self._energy(p) <= 0.0 or size == 0.0
            # Rows of several contacts can be dependent: the shortest step of a factorization with column pivoting.
            _, step, *_ = scipy.linalg.lapack.dgelsy(slope, F, np.zeros(len(p), dtype=np.int32), 1e-12, work * len(p))
            p = p - step
        return best, False

    def _energy(self, p: np.ndarray) -> float:
        change, size = p @ (0.5 * self._G @ p + self._b), np.abs(p) @ np.abs(self._b)
        return float(change - 1e-12 * size)

    def _admissible(self, p: np.ndarray) -> np.ndarray:
        p = p.copy()
        p[self._normals] = np.maximum(p[self._normals], 0.0)
        return p

    def _natural_map(self, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Difference (k,) of p from its projected gradient step, and its slope (k, k)."""
        F, slope = self._scaled @ p + self._speeds, self._scaled  # where a row does not move after the impulse
        z, copied = p - F, False
        for row in self._normals:
            if z[row] <= 0.0:
                slope, copied = slope if copied else slope.copy(), True
                F[row], slope[row] = p[row], 0.0
                slope[row, row] = 1.0
        for group in self._groups:
            rows, limit, wanted = group.rows, group.limit(p), z[group.rows]
            length = math.sqrt(wanted @ wanted)
            if length <= limit:
                continue
            slope, copied = slope if copied else slope.copy(), True
            direction, share = wanted / length, limit / length
            kept = self._kept[rows]
            F[rows] = p[rows] - limit * direction
            slope[rows] = (share * direction)[:, None] * (direction @ kept) - share * kept
            slope[rows, rows].flat[:: len(direction) + 1] += 1.0
            if group.normal >= 0 and p[group.normal] > 0.0:
                slope[rows, group.normal] -= group.coefficient * direction
        return F, slope

    def _swept(self, p: np.ndarray) -> np.ndarray:
        """Impulses after one projected Gauss-Seidel sweep."""
        p, scaled, speeds = p.copy(), self._scaled, self._speeds
        for row in self._normals:
            p[row] = max(0.0, p[row] - (scaled[row] @ p + speeds[row]))
        for group in self._groups:
            rows, limit = group.rows, group.limit(p)
            z = p[rows] - (scaled[rows] @ p + speeds[rows])
            length = math.sqrt(z @ z)
            p[rows] = z if length <= limit else z * (limit / length)
        return p


class RigidImpulses(FrictionImpulses):
    """Impulses of contacts that do not slip while they are closed: 0 <= p, 0 <= y of the normal rows and p y = 0.

    An open contact, with y > 0, has no impulse along the ground; a closed one, with y = 0, does not slip.
    """

    def solve(self, guess: np.ndarray | None = None) -> np.ndarray:
        """Return the impulses (k,) of the largest set of closed contacts that is a solution.

        Args:
            guess: not used: the search is over sets of contacts.

        Raises:
            SimulationError: no set is a solution. Friction without a limit does not exclude this.
        """
        at_rest = 1e-8  # velocity that counts as zero, relative to the largest, plus 1
        still = at_rest * (1.0 + float(np.abs(self._b).max()))
        none = 1e-9  # impulse that counts as zero, relative to the sum of all, plus 1
        # The largest set first: contacts that touch stay closed where they can.
        for closed in subsets(range(len(self._normals))):
            p = self._closing(closed)
            y = self._b + self._G @ p
            normal, rates = p[self._normals], y[self._normals]
            pushes = (normal >= -none * (1.0 + np.abs(normal).sum())).all()
            slips = [np.abs(y[each.rows]).max() for each in self._groups]
            rest = [self._normals.index(each.normal) for each in self._groups]
            sticks = all(slip <= still or rates[number] > still for slip, number in zip(slips, rest, strict=True))
            if pushes and sticks and (rates >= -still).all():
                return p
        raise SimulationError(NO_SET)

    def _closing(self, closed: frozenset[int]) -> np.ndarray:
        """Impulses (k,) that stop a set of contacts; none of the normal ones is negative if they can share them so."""
        normals = [self._normals[number] for number in sorted(closed)]
        rows = sorted([*normals, *(row for each in self._groups if each.normal in normals for row in _indices(each))])
        G = self._G[np.ix_(rows, rows)]
        p, up = np.zeros(len(self._b)), [rows.index(row) for row in normals]
        dependent = 1e-12  # singular value that counts as zero, relative to the largest
        # Rows of several contacts can be dependent: the shortest impulses of all that stop them.
        own = np.linalg.lstsq(G, -self._b[rows], rcond=dependent)[0]
        if (own[up] < 0.0).any():
            null = null_space(G, dependent)
            shared = nonnegative(own[up], null[up])
            own = own + null @ np.linalg.lstsq(null[up], shared - own[up], rcond=None)[0]
        p[rows] = own
        return p


NO_SET = (
    "no set of them only pushes while the others separate, without a limit of friction: give each contact a "
    "coefficient 'friction'"
)


def subsets(numbers: Iterable[int]) -> Iterator[frozenset[int]]:
    """All sets of numbers, the largest ones first.

    Args:
        numbers: distinct numbers.
    """
    ordered = sorted(numbers)
    for size in range(len(ordered), -1, -1):
        yield from map(frozenset, combinations(ordered, size))


def _indices(group: FrictionGroup) -> range:
    return range(group.rows.start, group.rows.stop)


def responses(state: StateEvaluation, M: np.ndarray, impulses: np.ndarray) -> np.ndarray:
    """Velocities (nv, k) of generalized impulses (k, nv), within the constraints of the system.

    Args:
        state: state of the system, for its rows.
        M: inertia (nv, nv), or the matrix of an implicit step.
        impulses: generalized impulses (k, nv).

    Raises:
        DivergenceError: the inertia is not positive definite.
    """
    A = state.all_rows
    if not len(A):
        found = solve_positive_definite_columns(M, impulses.T)
    else:
        lengths = np.linalg.norm(A, axis=1)
        # Rows of unit length: their rank does not depend on units. Rows without entries forbid nothing.
        R = null_space(A[lengths > 0] / lengths[lengths > 0, None])
        found = solve_positive_definite_columns(R.T @ M @ R, R.T @ impulses.T)
        found = None if found is None else R @ found
    if found is None:
        raise DivergenceError("inertia is not positive definite")
    return found


def contact_impact(
    state: StateEvaluation, layout: RowLayout, rows: np.ndarray, ground: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Impulses (k,) of an impact of contacts, and the velocity (nv,) after it.

    Args:
        state: state before the impact.
        layout: order of the rows.
        rows: the rows (k, nv).
        ground: velocities of the ground along them (k,).

    Raises:
        SimulationError: no set of contacts without slip only pushes.
    """
    v, rigid = np.array(state.v), any(math.isinf(each.coefficient) for each in layout.groups)
    rounding = 1e-12  # velocity that rounding explains, relative to the largest velocity, plus 1
    slip, still = rows @ v - ground, rounding * (1.0 + float(np.abs(v).max()))
    rates = slip[layout.normals]
    slips = rigid and (rates <= still).any() and (np.abs(slip) > still).any()  # without a limit, it stops at once
    if not slips and not (rates < -still).any():
        return np.zeros(layout.size), v
    contacts = [each.contact for each in layout.contacts]
    rest = np.array([each.rest_speed for each in contacts])
    restitution = np.array([each.restitution for each in contacts])
    W = responses(state, state.M, rows)
    problem = (RigidImpulses if rigid else FrictionImpulses)(rows @ W, slip, layout.normals, layout.groups)
    if problem.is_slow(rest):
        impulses = problem.stop()
    else:
        # Slow rebounds end at once: else a ball would bounce infinitely often in a finite time (Zeno).
        impulses = problem.impact(np.where(-restitution * rates > rest, restitution, 0.0))
    return impulses, v + W @ impulses
