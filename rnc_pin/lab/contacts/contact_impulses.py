"""Contacts with the ground that open and close by themselves, and the impulses of contacts that push.

Impulses with Coulomb friction or without slip solve complementarity problems of velocities.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Annotated, NamedTuple

import numpy as np
import pinocchio as pin
import scipy
from annotated_types import Ge, Le

from rnc_pin.constraints import GroundPlane
from rnc_pin.errors import ConfigurationError, DivergenceError, SimulationError
from rnc_pin.math.convex_programs import nonnegative
from rnc_pin.math.linear_algebra import null_space, solve_positive_definite
from rnc_pin.model.input_validation import NotNegative, check_settings
from rnc_pin.model.kinematics import Kinematics, PositionKinematics, VelocityKinematics
from rnc_pin.model.rows import ConstraintKind
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.model.system import NonholonomicSystem
from rnc_pin.plants.friction import DryFriction
from rnc_pin.robots.robot import Robot


@dataclass(frozen=True)
class UnilateralContact:
    """Contact that only pushes: it closes when the body lands, and opens when its normal force becomes zero.

    Its constraint acts while the contact is closed. The height row of the constraint gives the gap, its other rows
    prevent slip: by Coulomb friction, or without a limit if ``friction`` is None. A ``Caster`` has the height row only,
    so it is a contact without friction, of a ball or of a point (radius 0).

    Args:
        constraint: ``RollingWheel``, ``RollingBall``, ``RollingBody`` or ``Caster`` on a plane.
        restitution: coefficient of the height row, from 0 (no rebound) to 1 (elastic): Newton's of a contact without
            friction; with friction the energetic one, whose square is the share of the work that the rebound returns.
        rest_speed: speed [m/s] of a rebound below which the contact stays closed. Contacts that touch close together if
            their gaps are slower, and without a limit of friction also their slips. So bouncing and rocking end after
            a finite time.
        friction: coefficient of Coulomb friction; None for no limit.

    Raises:
        ConfigurationError: a coefficient out of its range; when it is bound, a constraint without a gap, or friction of
            a contact without rows that prevent slip.

    Example:
        >>> contact = rnc.UnilateralContact(rnc.RollingBall("ball", radius=0.2), restitution=0.7, friction=0.4)
        >>> contact.rest_speed
        0.01
    """

    constraint: ConstraintKind
    restitution: Annotated[float, Ge(0), Le(1)] = 0.0
    rest_speed: NotNegative = 0.01
    friction: NotNegative | None = None

    def __post_init__(self) -> None:
        check_settings(self)


class BoundContact:
    """Contact of a robot: its gap, and the rates of the gap.

    Args:
        contact: the contact.
        robot: the robot.

    Attributes:
        contact: the contact.
        name: frame of the constraint, or its height row.
        names: names of the rows along which it acts: the height row, and rows that prevent slip.
        coefficient: coefficient of friction, infinite without a limit.

    Raises:
        ConfigurationError: the constraint has no height row, its ground is not a plane, no joint changes the gap, or
            friction has no rows.
    """

    def __init__(self, contact: UnilateralContact, robot: Robot) -> None:
        kind = contact.constraint
        ground = getattr(kind, "ground", None)
        if ground is not None and not isinstance(ground, GroundPlane):
            raise ConfigurationError(
                f"contact of {type(kind).__name__}: expected a plane as ground, found {type(ground).__name__}: "
                "contacts that open and close need a gap, which curved ground does not give"
            )
        self._rows = rows = kind.bind(robot)
        heights = [row for row, flag in enumerate(rows.holonomic) if flag and rows.on_ground]
        if len(heights) != 1:
            raise ConfigurationError(
                f"contact of {type(kind).__name__}: expected a RollingWheel, RollingBall, RollingBody or Caster with "
                f"one height row, found {len(heights)} height rows"
            )
        self.contact, self._height = contact, heights[0]
        slips = [row for row in range(len(rows.names)) if row != heights[0]]
        self.name = str(getattr(kind, "frame", rows.names[heights[0]]))
        if contact.friction and not slips:
            raise ConfigurationError(
                f"contact '{self.name}': a {type(kind).__name__} has no rows along the ground for friction; a "
                "RollingBall has them, also a small one for a corner or a foot"
            )
        # Rows without friction would only make the problem larger.
        slips = [] if contact.friction == 0.0 else slips
        self._order = [self._height, *slips]
        self.names = tuple(rows.names[row] for row in self._order)
        self.coefficient = np.inf if contact.friction is None else float(contact.friction)
        kinematics, generator = Kinematics(robot), np.random.default_rng(0)
        samples = 3  # random configurations: a joint that changes the gap does so at almost all
        moments = (kinematics.position(robot.random_configuration(generator)) for _ in range(samples))
        zero = 1e-9  # entry of a height row that counts as zero
        if max(float(np.abs(self.jacobian(at)).max()) for at in moments) < zero:
            raise ConfigurationError(
                f"contact '{self.name}': no joint changes its height, so it cannot open: load the robot with a free "
                "base"
            )

    def rows(self, at: PositionKinematics) -> tuple[np.ndarray, np.ndarray]:
        """Rows ``names`` (k, nv) with their velocities (k,): the gap first.

        Args:
            at: kinematics at the configuration.
        """
        rates = self._rows.rate(at)[self._order] if self._rows.affine else np.zeros(len(self.names))
        return self._rows.jacobian(at)[self._order], rates

    def jacobian(self, at: PositionKinematics) -> np.ndarray:
        """Jacobian of the gap, (nv,).

        Args:
            at: kinematics at the configuration.
        """
        return np.asarray(self._rows.jacobian(at)[self._height])

    def gap(self, at: PositionKinematics) -> float:
        """Distance from the ground [m], negative below it.

        Args:
            at: kinematics at the configuration.
        """
        return float(self._rows.residual(at)[self._height])

    def gap_acceleration(self, at: VelocityKinematics, v_dot: np.ndarray) -> float:
        """Second rate of the gap at acceleration v_dot (nv,) [m/s^2].

        Args:
            at: kinematics at the state.
            v_dot: acceleration (nv,).
        """
        return float(self.jacobian(at) @ v_dot + self._rows.bias_acceleration(at)[self._height])


class FrictionGroup(NamedTuple):
    """Rows of one friction force: its norm is at most ``coefficient`` times the normal impulse, plus ``constant``.

    Attributes:
        rows: the rows, which are neighbours.
        normal: row of the normal impulse; -1 without one, as of dry friction in a joint.
        coefficient: coefficient of friction; infinite for no slip while the contact is
            closed.
        constant: impulse [N s or N m s].
        key: number of the contact, or -1 and less for the joints.
    """

    rows: slice
    normal: int
    coefficient: float
    constant: float = 0.0
    key: int = 0

    def limit(self, p: np.ndarray) -> float:
        """Largest norm of the impulse beside impulses p (k,).

        Args:
            p: impulses of all rows (k,).
        """
        return self.constant + (self.coefficient * max(float(p[self.normal]), 0.0) if self.normal >= 0 else 0.0)


class RowLayout(NamedTuple):
    """Order of the rows while some contacts touch: of each its normal row, then its friction, then joint friction.

    Attributes:
        contacts: the contacts.
        size: number of rows (k).
        normals: rows of the normal impulses.
        groups: friction; limits of joint friction are forces.
        names: names of the rows of contacts.
    """

    contacts: list[BoundContact]
    size: int
    normals: list[int]
    groups: list[FrictionGroup]
    names: list[str]


class ContactRows:
    """Rows (k, nv) of the contacts that touch and of dry joint friction.

    Args:
        contacts: the contacts.
        dry: dry joint friction.
    """

    def __init__(self, contacts: Sequence[BoundContact], dry: DryFriction) -> None:
        self._contacts, self._dry = contacts, dry

    def layout(self, touching: frozenset[int], joints: bool = True) -> RowLayout:
        """Order of the rows.

        Args:
            touching: numbers of the contacts that touch.
            joints: False without the rows of joint friction, as in an impact.
        """
        found, k = RowLayout([], 0, [], [], []), 0
        for number in sorted(touching):
            each = self._contacts[number]
            found.contacts.append(each)
            found.normals.append(k)
            found.names.extend(each.names)
            end = k + len(each.names)
            if end > k + 1:
                found.groups.append(FrictionGroup(slice(k + 1, end), k, each.coefficient, key=number))
            k = end
        for joint, limit in enumerate(self._dry.limits if joints else ()):
            found.groups.append(FrictionGroup(slice(k, k + 1), -1, 0.0, float(limit), -1 - joint))
            k += 1
        return found._replace(size=k)

    def at(self, state: StateEvaluation, layout: RowLayout) -> tuple[np.ndarray, np.ndarray]:
        """Rows (k, nv) in an order, and velocities of the ground along them (k,).

        Args:
            state: state of the system.
            layout: order of the rows.
        """
        matrix, ground, end = np.empty((layout.size, len(state.v))), np.zeros(layout.size), 0
        for each in layout.contacts:
            start, end = end, end + len(each.names)
            matrix[start:end], ground[start:end] = each.rows(state.position)
        if end < layout.size:
            matrix[end:] = self._dry.rows
        return matrix, ground


def bound_contacts(system: NonholonomicSystem, contacts: Sequence[UnilateralContact]) -> list[BoundContact]:
    """Return the contacts of a plant, bound to the robot of its system.

    Args:
        system: system without the contacts.
        contacts: the contacts.

    Raises:
        ConfigurationError: no contacts, contacts of the same name, a contact without a gap, or friction with
            a limit at some contacts only.
    """
    if not contacts or not all(isinstance(each, UnilateralContact) for each in contacts):
        raise ConfigurationError(f"contacts: expected a list of UnilateralContact, found {contacts!r}")
    bound = [BoundContact(each, system.robot) for each in contacts]
    names = [each.name for each in bound]
    for name in names:
        if names.count(name) > 1:
            raise ConfigurationError(f"contacts: '{name}' occurs twice")
    # Rows with and without a limit would need two methods at one impact.
    has_limit = any(each.contact.friction is not None for each in bound)
    for each in bound:
        if has_limit and each.contact.friction is None and len(each.names) > 1:
            raise ConfigurationError(
                f"contact '{each.name}': requires its coefficient of friction, because the friction of some contact "
                "has a limit"
            )
    return bound


def radius_of_gyration(model: pin.Model, q: np.ndarray) -> float:
    """Radius of gyration of a robot about its centre of mass, the mean of three axes [m].

    Args:
        model: Pinocchio model.
        q: configuration (nq,).
    """
    data = model.createData()
    pin.ccrba(model, data, q, np.zeros(model.nv))
    total = data.Ig
    # The trace of the inertia is twice the sum of m r^2.
    return float(np.sqrt(np.trace(total.inertia) / (2.0 * total.mass)))


# ---------------------------------------------------------------------- impulses


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

    def _stopping(self, rows: list[int], dependent: float = 1e-10) -> np.ndarray:
        """Impulses (k,) of least norm along some rows that stop them; ``dependent`` as for ``null_space``."""
        p = np.zeros(len(self._b))
        p[rows] = np.linalg.lstsq(self._G[np.ix_(rows, rows)], -self._b[rows], rcond=dependent)[0]
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
                gained, rounding = p @ (0.5 * self._G @ p + self._b), 1e-12 * (np.abs(p) @ np.abs(self._b))
                p = p.copy()
                p[self._normals] = np.maximum(p[self._normals], 0.0)
                return p, bool(gained <= rounding) or size == 0.0
            # Rows of several contacts can be dependent: the shortest step of a factorization with column pivoting.
            _, step, *_ = scipy.linalg.lapack.dgelsy(slope, F, np.zeros(len(p), dtype=np.int32), 1e-12, work * len(p))
            p = p - step
        return best, False

    def _natural_map(self, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Difference (k,) of p from its projected gradient step, and its slope (k, k)."""
        F, slope = self._scaled @ p + self._speeds, self._scaled.copy()  # where a row does not move after the impulse
        z = p - F
        for row in self._normals:
            if z[row] <= 0.0:
                F[row], slope[row] = p[row], 0.0
                slope[row, row] = 1.0
        for group in self._groups:
            rows, limit, wanted = group.rows, group.limit(p), z[group.rows]
            length = math.sqrt(wanted @ wanted)
            if length <= limit:
                continue
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
            sticks = all(np.abs(y[each.rows]).max() <= still or y[each.normal] > still for each in self._groups)
            if pushes and sticks and (rates >= -still).all():
                return p
        raise SimulationError(NO_SET)

    def _closing(self, closed: frozenset[int]) -> np.ndarray:
        """Impulses (k,) that stop a set of contacts; none of the normal ones is negative if they can share them so."""
        normals = [self._normals[number] for number in sorted(closed)]
        rows = sorted([*normals, *(row for each in self._groups if each.normal in normals for row in _indices(each))])
        dependent = 1e-12  # singular value that counts as zero, relative to the largest
        # Rows of several contacts can be dependent: the shortest impulses of all that stop them.
        p = self._stopping(rows, dependent)
        if (p[normals] < 0.0).any():
            null, up = null_space(self._G[np.ix_(rows, rows)], dependent), [rows.index(row) for row in normals]
            shared = nonnegative(p[normals], null[up])
            p[rows] += null @ np.linalg.lstsq(null[up], shared - p[normals], rcond=None)[0]
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
    lengths = np.linalg.norm(A, axis=1)
    # Rows of unit length: their rank does not depend on units. Rows without entries forbid nothing.
    R = null_space(A[lengths > 0] / lengths[lengths > 0, None])
    found = solve_positive_definite(R.T @ M @ R, impulses @ R)
    if np.isnan(found).any():
        raise DivergenceError("inertia is not positive definite")
    return R @ found.T


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
