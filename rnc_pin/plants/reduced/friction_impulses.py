"""Impulses of unilateral contacts with Coulomb friction: a nonlinear complementarity problem at velocity level.

The rows along which contacts push and friction acts follow from the set of contacts that touch.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import scipy

from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.plants.reduced.friction import DryFriction
from rnc_pin.plants.reduced.unilateral_contact import BoundContact

_PRECISE = 1e-13  # residual of a solution, relative to the largest impulse
_WORK = 8  # numbers for each row that LAPACK may use
_NEWTON, _ROUNDS, _SWEEPS, _CONVEX_SWEEPS = 25, 6, 40, 2000


class FrictionGroup(NamedTuple):
    """Rows of one friction force: its norm is at most ``coefficient`` times the normal impulse, plus ``constant``.

    Attributes:
        rows: the rows, which are neighbours.
        normal: row of the normal impulse; -1 without one, as of dry friction in a joint.
        coefficient: coefficient of friction, or a length [m] for moments.
        constant: impulse [N s or N m s].
    """

    rows: slice
    normal: int
    coefficient: float
    constant: float = 0.0

    def limit(self, p: np.ndarray) -> float:
        """Largest norm of the impulse beside impulses p (k,)."""
        return self.constant + (self.coefficient * max(float(p[self.normal]), 0.0) if self.normal >= 0 else 0.0)


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
        diagonal = np.maximum(G.diagonal(), 1e-12 * G.diagonal().max(initial=1e-300))
        self._scale = 1.0 / diagonal
        for each in groups:
            self._scale[each.rows] = 1.0 / diagonal[each.rows].max()
        self._scaled = self._scale[:, None] * G
        self._kept = np.eye(len(b)) - self._scaled  # slope of the projected gradient step
        self._speeds = self._scale * b

    def solve(self, guess: np.ndarray | None = None) -> np.ndarray:
        """Return the impulses (k,).

        Newton's method on the natural map of the conditions alternates with projected Gauss-Seidel sweeps. Where the
        conditions have no solution nearby, as for Painleve's rod, the impulses of the associated convex problem act:
        ``p^T (G p / 2 + b)`` is least in the cones of friction, so these impulses do not create energy either.

        Args:
            guess: impulses (k,) near the solution, if they are known.
        """
        p = np.zeros(len(self._b)) if guess is None else guess
        for _ in range(_ROUNDS):
            p, solved = self._newton(p)
            if solved:
                return p
            for _ in range(_SWEEPS):
                p = self._swept(p)
        return self._associated()

    def stop(self) -> np.ndarray:
        """Return the normal impulses (k,) after which no contact moves along its normal: rocking and bouncing end."""
        p, normals = np.zeros(len(self._b)), self._normals
        p[normals] = np.linalg.lstsq(self._G[np.ix_(normals, normals)], -self._b[normals], rcond=1e-10)[0]
        return p

    def impact(self, restitution: np.ndarray) -> np.ndarray:
        """Return the impulses (k,) of an impact in two phases: compression, and a rebound.

        The rebound is a share of the one that Newton's coefficients ask for. It returns at most the largest coefficient
        squared of the work of the compression, and never more energy than the compression removed.

        Args:
            restitution: coefficient of each normal row (c,).
        """
        G, y, normals = self._G, self._b, self._normals
        p, rates = self.solve(), y[normals]
        stopped = y + G @ p
        coefficients = np.where(p[normals] > 0.0, restitution, 0.0)
        if not coefficients.any():
            return p
        wanted = stopped.copy()
        wanted[normals] += coefficients * rates  # rates are negative: the rows have to leave at -e rate
        more = FrictionImpulses(G, wanted, normals, self._groups).solve()
        compression = max(-0.5 * float(p[normals] @ rates), 0.0)
        removed = max(-float(p @ (y + 0.5 * G @ p)), 0.0)
        allowed = min(float(coefficients.max()) ** 2 * compression, removed)
        linear, square = float(more @ stopped), float(more @ G @ more)
        share = 1.0
        if linear + 0.5 * square > allowed > 0.0:  # the largest s with s linear + s^2 square / 2 = allowed
            share = 2.0 * allowed / (linear + float(np.sqrt(linear**2 + 2.0 * square * allowed)))
        return np.asarray(p + (share if allowed > 0.0 else 0.0) * more)

    def _newton(self, p: np.ndarray) -> tuple[np.ndarray, bool]:
        """Impulses after Newton steps, and True if they are a solution."""
        best, least, smallest = p, np.inf, float(np.abs(self._speeds).max())
        for _ in range(_NEWTON):
            F, slope = self._natural_map(p)
            size = float(np.abs(F).max())
            if size < least:
                best, least = p, size
            if size <= _PRECISE * max(float(np.abs(p).max()), smallest):
                return self._admissible(p), self._energy(p) <= 0.0 or size == 0.0
            # Rows of several contacts can be dependent: the shortest step of a factorization with column pivoting.
            _, step, *_ = scipy.linalg.lapack.dgelsy(slope, F, np.zeros(len(p), dtype=np.int32), 1e-12, _WORK * len(p))
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

    # ------------------------------------------------------------------ associated problem

    def _associated(self) -> np.ndarray:
        """Impulses of least ``p^T (G p / 2 + b)`` in the cones of friction, by block coordinate descent from zero."""
        p, blocks = np.zeros(len(self._b)), list(self._blocks())
        for _ in range(_CONVEX_SWEEPS):
            before = p.copy()
            for rows, step, normal, groups in blocks:
                p[rows] = p[rows] - step * (self._G[rows] @ p + self._b[rows])
                _project(p, normal, groups)
            if np.abs(p - before).max() <= 1e-12 * np.abs(p).max():
                break
        return p

    def _blocks(self) -> Iterator[tuple[np.ndarray, float, int, list[FrictionGroup]]]:
        """Rows that share a cone, the length of a descent step, the normal row and the groups."""
        for normal in [*self._normals, -1]:
            groups = [each for each in self._groups if each.normal == normal]
            rows = np.array([normal] * (normal >= 0) + [row for each in groups for row in _indices(each)], dtype=int)
            if len(rows):
                yield rows, 1.0 / np.linalg.eigvalsh(self._G[np.ix_(rows, rows)])[-1], normal, groups


def _indices(group: FrictionGroup) -> range:
    return range(group.rows.start, group.rows.stop)


def _project(p: np.ndarray, normal: int, groups: list[FrictionGroup]) -> None:
    """Replace impulses by the nearest ones in the cone of a contact, or within constant limits."""
    lengths = [float(np.linalg.norm(p[each.rows])) for each in groups]
    if normal >= 0:
        # The nearest normal impulse n solves n = p_n + sum of c (|p_g| - c n) over the groups beyond their limits.
        order = sorted((a / c if c else np.inf, c, a) for a, each in zip(lengths, groups, strict=True)
                       for c in [each.coefficient])[::-1]  # fmt: skip
        n, weight, total = float(p[normal]), 1.0, float(p[normal])
        for ratio, c, a in order:
            if n >= ratio:
                break
            weight, total = weight + c * c, total + c * a
            n = total / weight
        p[normal] = max(n, 0.0)
    for length, each in zip(lengths, groups, strict=True):
        limit = each.limit(p)
        if length > limit:
            p[each.rows] *= limit / length


_TURNING = ("turning_x", "turning_y", "turning_z")


class _Part(NamedTuple):
    """Rows of one contact: where they are, those of its own, and those of its angular velocity."""

    contact: BoundContact
    where: slice
    own: slice
    turning: slice


class FrictionLayout(NamedTuple):
    """Order of the rows while some contacts touch: of each its normal row, then its friction, then joint friction.

    Attributes:
        parts: the contacts.
        size: number of rows (k).
        normals: rows of the normal impulses.
        groups: friction; limits of joint friction are forces.
        names: names of the rows.
        units: units of the forces along them; those of joint friction are unknown.
        keys: of the groups, number of the contact, or -1, and kind of friction: 0 for slip.
    """

    parts: list[_Part]
    size: int
    normals: list[int]
    groups: list[FrictionGroup]
    names: list[str]
    units: list[str]
    keys: list[tuple[int, int]]


class FrictionRows:
    """Rows (k, nv) of the contacts that touch and of dry joint friction.

    Args:
        contacts: the contacts.
        dry: dry joint friction.
    """

    def __init__(self, contacts: Sequence[BoundContact], dry: DryFriction) -> None:
        self._contacts, self._dry = contacts, dry
        self._limits = [each.turning_limits for each in contacts]
        self._layouts: dict[tuple[frozenset[int], bool], FrictionLayout] = {}

    def layout(self, touching: frozenset[int], joints: bool = True) -> FrictionLayout:
        """Order of the rows.

        Args:
            touching: numbers of the contacts that touch.
            joints: False without the rows of joint friction, as in an impact.
        """
        if (touching, joints) not in self._layouts:
            self._layouts[touching, joints] = self._layout(touching, joints)
        return self._layouts[touching, joints]

    def _layout(self, touching: frozenset[int], joints: bool) -> FrictionLayout:
        found = FrictionLayout([], 0, [], [], [], [], [])
        k = 0
        for number in sorted(touching):
            each, first = self._contacts[number], k
            slips = len(each.names) - 1 if each.contact.friction else 0
            rolling, spin = self._limits[number]
            turning = slice(0 if rolling else 2, 3 if spin else 2)
            found.normals.append(first)
            turned = [f"{kind}({each.name})" for kind in _TURNING[turning]]
            found.names.extend((*each.names[: 1 + slips], *turned))
            found.units.extend(("N",) * (1 + slips) + ("N m",) * len(turned))
            k += 1
            sizes = slips, 2 * bool(rolling), bool(spin)
            for kind, (size, coefficient) in enumerate(zip(sizes, (each.contact.friction, rolling, spin), strict=True)):
                if size:
                    found.groups.append(FrictionGroup(slice(k, k + size), first, float(coefficient or 0.0)))
                    found.keys.append((number, kind))
                    k += size
            found.parts.append(_Part(each, slice(first, k), slice(0, 1 + slips), turning))
        for i, limit in enumerate(self._dry.limits if joints else ()):
            found.groups.append(FrictionGroup(slice(k + i, k + i + 1), -1, 0.0, float(limit)))
            found.keys.append((-1, i))
            found.names.append(f"friction {i}")
            found.units.append("")
        return found._replace(size=k + (len(self._dry.limits) if joints else 0))

    def at(self, state: StateEvaluation, layout: FrictionLayout) -> tuple[np.ndarray, np.ndarray]:
        """Rows (k, nv) in an order, and velocities of the ground along them (k,)."""
        matrix, ground, at = np.empty((layout.size, len(state.v))), np.zeros(layout.size), state.position
        end = 0
        for each, where, own, turning in layout.parts:
            rows, speeds = each.rows(at)
            middle, end = where.start + own.stop, where.stop
            matrix[where.start : middle], ground[where.start : middle] = rows[own], speeds[own]
            if middle < end:
                matrix[middle:end] = each.turning(at)[turning]
        if end < layout.size:
            matrix[end:] = self._dry.rows(state)
        return matrix, ground
