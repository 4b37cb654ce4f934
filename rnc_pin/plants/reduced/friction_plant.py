"""Plant whose contacts open, close, stick and slide: time stepping with Coulomb friction, extrapolated where smooth."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin
import scipy

from rnc_pin.errors import ConfigurationError, DivergenceError
from rnc_pin.math.linear_algebra import null_space
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.model.system import NonholonomicSystem
from rnc_pin.plants.reduced.constrained_dynamics import ConstrainedDynamics
from rnc_pin.plants.reduced.contact_plant import ContactEvent
from rnc_pin.plants.reduced.friction import DryFriction
from rnc_pin.plants.reduced.friction_impulses import FrictionGroup, FrictionImpulses
from rnc_pin.plants.reduced.step_control import DEFAULT_TOLERANCE, Substeps
from rnc_pin.plants.reduced.unilateral_contact import (
    UnilateralContact,
    bound_contacts,
    check_depth,
    radius_of_gyration,
)

_STEPS = (1, 2, 3, 4)  # Euler steps whose results are extrapolated: order 4
_SHORTEST = 2.0**-12  # step of the integration over that of the caller
_ROUNDING = 1e-12  # error of a step that rounding explains, relative to the state
_TOUCHES = 1e-8  # gap without contact force, over the radius of gyration, up to which a contact still touches
_HALVINGS = 20
_IMPACTS = 100  # located landings in one call of ``advance``; further ones happen at the ends of steps
_SLIDES = 1e-6  # slip that counts as sliding, relative to the largest velocity, plus 1


class _Rows(NamedTuple):
    """Rows (k, nv) of the contacts that touch and of dry joint friction, and what acts along them."""

    matrix: np.ndarray
    ground: np.ndarray  # velocities of the ground along the rows (k,)
    normals: list[int]
    groups: list[FrictionGroup]
    names: list[str]
    keys: list[tuple[int, int]]  # of the groups: number of the contact, or -1, and kind of friction


class _Solved(NamedTuple):
    """Result of one Euler step."""

    q: np.ndarray
    v: np.ndarray
    work: float
    force: np.ndarray  # mean generalized force (nv,) of contacts, friction and damping
    pushing: dict[int, float]  # mean normal force of each contact that touches [N]
    sliding: frozenset[tuple[int, int]]  # keys of the friction groups that move
    rates: np.ndarray  # mean forces of the rows, (k,)
    slip: np.ndarray  # velocities of the rows relative to the ground, (k,)
    reverses: bool = False  # True if a friction group turns back


class _Trial(NamedTuple):
    """Result of a step of the integration."""

    last: _Solved
    error: float  # infinite if a friction group begins or ceases to move
    landed: float | None  # time within the step after which an open contact is below the ground


class FrictionPlant:
    """Plant whose contacts with the ground open, close, stick and slide by Coulomb friction.

    Half-explicit Euler steps find velocity and impulses together: contacts only push, friction stays in its cone and
    opposes slip (Moreau 1988; Stewart and Trinkle 1996). Where the motion is smooth, four sequences of steps are
    extrapolated to order 4 (Lubich 1989). Where it is not, at landings and between stick and slip, the steps become
    shorter until their error is within the tolerance, or reach 2^-12 of a sample and are not extrapolated.

    A landing is located and is an impact in two phases, each with friction: compression until no contact approaches,
    and a rebound. The rebound returns at most the share ``restitution^2`` of the work of the normal impulses, and never
    more energy than the compression removed.

    Args:
        system: system without the contacts, with the actuators.
        contacts: the contacts; each one with slip has a number as ``friction``.
        joint_damping, actuator_limits, joint_friction, substeps, tolerance: as for ``ReducedPlant``.

    Attributes:
        reduced: model without the contacts.
        applied: applied inputs (p,), within the actuator limits.
        work: work since the start, minus the energy that damping, friction and impacts removed [J].
        contact_events: landings, lift-offs, and changes between stick and slip.
        external: mean generalized forces (nv,) of contacts, damping and friction in the last step.
        normal_forces: mean normal force of each contact in the last step [N], by name.
        sliding: names of the contacts that slide.

    Raises:
        ConfigurationError: no contacts, contacts of the same name or without ``friction``, moving or momentum
            constraints in the system.

    Example:
        >>> robot = rnc.Robot.from_urdf("rolling_ball.urdf", base="free")
        >>> contact = rnc.UnilateralContact(rnc.RollingBall("ball", 0.2), friction=0.3)
        >>> plant = rnc.FrictionPlant(rnc.NonholonomicSystem(robot), [contact])
        >>> plant.reset(robot.configuration({"root_joint": [0, 0, 0.2, 0, 0, 0, 1]}), np.array([1.0, 0, 0, 0, 0, 0]))
        >>> plant.advance(0.2)
        >>> [(event.cause, round(event.time, 3)) for event in plant.contact_events]
        [('start', 0.0), ('slip of ball', 0.0), ('grip of ball', 0.097)]
    """

    def __init__(
        self,
        system: NonholonomicSystem,
        contacts: Sequence[UnilateralContact],
        joint_damping: bool = False,
        actuator_limits: bool = False,
        joint_friction: bool = False,
        substeps: int | None = None,
        tolerance: float = DEFAULT_TOLERANCE,
    ) -> None:
        self._contacts = bound_contacts("FrictionPlant", system, contacts)
        for each in self._contacts:
            if each.slips and each.contact.friction is None:
                raise ConfigurationError(
                    f"contact '{each.name}': a FrictionPlant requires its coefficient of friction; without a limit of "
                    "friction use a ContactPlant"
                )
        self.reduced: ReducedModel = system.reduce()
        if self.reduced.affine or self.reduced.rheonomic or any(
            block.conserved is not None for block, *_ in self.reduced.constraints.places
        ):  # fmt: skip
            raise ConfigurationError(
                "FrictionPlant: constraints of the system that move, depend on time or conserve a momentum are not "
                "supported"
            )
        number, self.tolerance = Substeps.checked(substeps, tolerance, "FrictionPlant")
        self._substeps = number or 1
        self._dynamics = ConstrainedDynamics(self.reduced, joint_damping, actuator_limits)
        self._dry = DryFriction(self.reduced, joint_friction)
        self._limits = [each.turning_limits for each in self._contacts]
        self._model: pin.Model = self.reduced.robot.model
        self.applied = np.zeros(self.reduced.p)
        self.work, self._time, self._size, self._step = 0.0, 0.0, 0.0, np.inf
        self.contact_events: tuple[ContactEvent, ...] = ()
        self.external: np.ndarray | None = None
        self._touching: frozenset[int] = frozenset()
        self._pushing: dict[int, float] = {}
        self._sliding: frozenset[tuple[int, int]] = frozenset()
        self._rates, self._slip = np.zeros(0), np.zeros(0)
        self._q, self._v = np.zeros(self.reduced.robot.nq), np.zeros(self.reduced.n)

    # ------------------------------------------------------------------ state

    @property
    def normal_forces(self) -> dict[str, float]:
        """Mean normal force of each contact in the last step [N], by name."""
        return {each.name: self._pushing.get(number, 0.0) for number, each in enumerate(self._contacts)}

    @property
    def sliding(self) -> tuple[str, ...]:
        """Names of the contacts that slide."""
        return tuple(self._contacts[number].name for number, kind in sorted(self._sliding) if number >= 0 and not kind)

    def reset(self, q: np.ndarray, v: np.ndarray) -> None:
        """Restart at time zero, at configuration q (nq,) and velocity v (nv,).

        Contacts that touch the ground, or are a little below it, are closed; if they approach it, with an impact.

        Raises:
            InputError: a contact is below the ground.
        """
        state = self.reduced.at(np.array(q, dtype=float), v=np.array(v, dtype=float))
        self._q, self._v = np.array(state.q), np.array(state.v)
        self._size = radius_of_gyration(self._model, self._q)
        self.work, self._time, self._step, self.contact_events = 0.0, 0.0, np.inf, ()
        self.applied, self.external = np.zeros(self.reduced.p), None
        self._pushing, self._sliding, self._rates = {}, frozenset(), np.zeros(0)
        self._slip = np.zeros(0)
        gaps = self._gaps(state)
        check_depth(self._contacts, gaps, self._size)
        self._touching = frozenset(np.flatnonzero(gaps <= _TOUCHES * self._size).tolist())
        self._impact("start")

    def read(self) -> tuple[np.ndarray, np.ndarray]:
        """Configuration (nq,) and velocity (nv,)."""
        return self._q.copy(), self._v.copy()

    def apply(self, T: np.ndarray) -> None:
        """Hold the inputs T (p,), clipped to the actuator limits."""
        self.applied = self._dynamics.saturate(np.array(T, dtype=float))

    # ------------------------------------------------------------------ motion

    def advance(self, dt: float) -> None:
        """Advance by a time dt [s], through all events on the way.

        Raises:
            DivergenceError: velocities or accelerations are not finite.
        """
        end, shortest, impacts = self._time + dt, _SHORTEST * dt, 0
        while end - self._time > 1e-9 * shortest:
            left = end - self._time
            h = min(self._step, dt / self._substeps, left)
            trial = self._trial(h, plain=h <= shortest)
            allowed = self.tolerance * h + _ROUNDING * (1.0 + float(np.abs(self._v).max()))
            ratio = trial.error / allowed
            if ratio > 1.0 and h > shortest:
                self._step = max(h * min(0.5, max(0.1, 0.9 * ratio**-0.25)), shortest)
                continue
            if trial.landed is not None and impacts < _IMPACTS:
                found = self._located(trial.landed, shortest)
                if found is not None:
                    time, number = found
                    if time > 0.0:
                        self._take(self._trial(time, plain=time <= shortest), time, end)
                    self._touching |= {number}
                    self._impact("landing", [number])
                    impacts += 1
                    self._step = max(0.5 * h, shortest)
                    continue
            self._take(trial, h, end)
            self._step = max(h, shortest) * min(4.0, max(1.0, 0.8 * max(ratio, 1e-9) ** -0.25))

    def _trial(self, h: float, plain: bool) -> _Trial:
        """Result of a step of a time h [s]: extrapolated, or of the shortest Euler steps if ``plain``."""
        table: list[np.ndarray] = []
        changes, last, landed, nv = False, self._start(), None, len(self._v)
        for count in _STEPS[-1:] if plain else _STEPS:
            last = self._start()
            for step in range(count):
                last = self._euler(last, h / count)
                changes |= last.sliding != self._sliding or last.reverses
                if count == _STEPS[-1] and landed is None and self._below(last.q):
                    landed = h * (step + 1) / count
            row = [np.concatenate([pin.difference(self._model, self._q, last.q), last.v, [last.work]])]
            for column, before in enumerate(table):
                weight = count / (count - column - 1) - 1.0
                row.append(row[-1] + (row[-1] - before) / weight)
            table = row
        error = 0.0
        if not plain:
            found = table[-1]
            error = np.inf if changes else float(np.abs(found - table[-2])[: 2 * nv].max())
            q = pin.integrate(self._model, self._q, found[:nv])
            last = last._replace(q=q, v=found[nv:-1], work=float(found[-1]))
            if landed is None and self._below(q):
                landed = h
        return _Trial(last, error, landed)

    def _start(self) -> _Solved:
        return _Solved(self._q, self._v, 0.0, np.zeros(0), {}, self._sliding, self._rates, self._slip)

    def _euler(self, start: _Solved, h: float) -> _Solved:
        """State after one half-explicit Euler step."""
        q = pin.integrate(self._model, start.q, h * start.v)
        if not np.isfinite(q).all():
            raise DivergenceError(f"plant velocities are not finite at t = {self._time:.4f} s")
        state = self.reduced.at(q, v=start.v)
        M, damping, forced = state.M, self._dynamics.damping, state.B @ self.applied
        matrix = M if damping is None else M + h * np.diag(damping)
        rows = self._rows(state, self._touching, h)
        v, p = self._impulses(state, rows, M @ start.v + h * (forced - state.bias), matrix, h * start.rates)
        mean, acting = 0.5 * (start.v + v), rows.matrix.T @ p
        force = acting / h - (0.0 if damping is None else damping * v)
        outside = forced + force
        if self.reduced.reduction_data.forces:
            outside = outside + state.passive_sums.without_potential
        slip = rows.matrix @ v - rows.ground
        leaving = _ROUNDING * (1.0 + float(np.abs(v).max()))
        pushing = {
            number: float(p[row]) / h if slip[row] <= leaving else 0.0
            for number, row in zip(sorted(self._touching), rows.normals, strict=True)
        }
        sliding, reverses = self._slides(rows, slip), False
        if len(start.slip) == len(slip):
            moving = (each.rows for each, key in zip(rows.groups, rows.keys, strict=True) if key in sliding)
            reverses = any(slip[own] @ start.slip[own] < 0.0 for own in moving)
        work = start.work + h * float(mean @ outside)
        return _Solved(q, v, work, force, pushing, sliding, p / h, slip, reverses)

    def _slides(self, rows: _Rows, slip: np.ndarray) -> frozenset[tuple[int, int]]:
        """Keys of the friction groups that move at velocities (k,) of the rows."""
        limit = _SLIDES * (1.0 + float(np.abs(self._v).max()))
        moving = (bool(slip[each.rows] @ slip[each.rows] > limit**2) for each in rows.groups)
        return frozenset(key for key, moves in zip(rows.keys, moving, strict=True) if moves)

    def _rows(self, state: StateEvaluation, touching: frozenset[int], h: float) -> _Rows:
        """Rows of contacts that touch, and of dry friction in joints during a time h [s]."""
        parts, ground, normals, groups = [np.zeros((0, self.reduced.n))], [np.zeros(0)], list[int](), []
        names, keys, k, at = list[str](), list[tuple[int, int]](), 0, state.position
        for number in sorted(touching):
            each, limits, normal = self._contacts[number], self._limits[number], k
            matrix, speeds = each.rows(at)
            turns = each.turning(at) if any(limits) else matrix[:0]
            kinds = (matrix[1:], each.contact.friction), (turns[:2], limits[0]), (turns[2:], limits[1])
            turning = [f"{kind}({each.name})" for kind in ("turning_x", "turning_y", "turning_z")]
            named = each.names[1:], turning[:2], turning[2:]
            names.append(each.row)
            parts.append(matrix[:1])
            ground.append(np.zeros(1))
            normals.append(normal)
            k += 1
            for kind, (rows, coefficient) in enumerate(kinds):
                if coefficient and len(rows):
                    parts.append(rows)
                    ground.append(np.zeros(len(rows)) if kind else speeds[1:])
                    groups.append(FrictionGroup(np.arange(k, k + len(rows)), normal, float(coefficient)))
                    keys.append((number, kind))
                    names += named[kind]
                    k += len(rows)
        if h and len(self._dry.limits):
            parts.append(self._dry.rows(state))
            ground.append(np.zeros(len(self._dry.limits)))
            groups += [FrictionGroup(np.array([k + i]), -1, 0.0, h * each) for i, each in enumerate(self._dry.limits)]
            names += [f"friction {i}" for i in range(len(self._dry.limits))]
            keys += [(-1, i) for i in range(len(self._dry.limits))]
        return _Rows(np.vstack(parts), np.concatenate(ground), normals, groups, names, keys)

    def _impulses(
        self, state: StateEvaluation, rows: _Rows, momentum: np.ndarray, M: np.ndarray, guess: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Velocity (nv,) and impulses (k,) of a momentum (nv,) that the rows change."""
        inverse = self._inverse(state, M)
        free = inverse @ momentum
        if not len(rows.matrix):
            return free, np.zeros(0)
        W = rows.matrix @ inverse
        problem = FrictionImpulses(W @ rows.matrix.T, rows.matrix @ free - rows.ground, rows.normals, rows.groups)
        p = problem.solve(guess if len(guess) == len(rows.matrix) else None)
        return free + p @ W, p

    def _inverse(self, state: StateEvaluation, M: np.ndarray) -> np.ndarray:
        """Inverse inertia (nv, nv) along the velocities that the constraints of the system admit."""
        if not self.reduced.m:
            return np.linalg.inv(M)
        A = state.all_rows
        lengths = np.linalg.norm(A, axis=1)
        R = null_space(A[lengths > 0] / lengths[lengths > 0, None])
        return np.asarray(R @ np.linalg.solve(R.T @ M @ R, R.T))

    # ------------------------------------------------------------------ events

    def _gaps(self, state: StateEvaluation) -> np.ndarray:
        at = state.position
        return np.array([each.gap(at) for each in self._contacts])

    def _below(self, q: np.ndarray) -> bool:
        """True if an open contact is below the ground."""
        return bool((self._open_gaps(q) < 0.0).any())

    def _open_gaps(self, q: np.ndarray) -> np.ndarray:
        """Gaps (c,); infinite for contacts that touch."""
        if len(self._touching) == len(self._contacts):
            return np.full(len(self._contacts), np.inf)
        gaps = self._gaps(self.reduced.at(q, v=self._v))
        gaps[list(self._touching)] = np.inf
        return gaps

    def _located(self, end: float, shortest: float) -> tuple[float, int] | None:
        """Time after now, at most ``end``, at which the first open contact lands, and its number."""

        def gaps(time: float) -> np.ndarray:
            q = self._q if time == 0.0 else self._trial(time, plain=time <= shortest).last.q
            return self._open_gaps(q)

        now, then = gaps(0.0), gaps(end)
        first: tuple[float, int] | None = None
        for number in np.flatnonzero(then < 0.0).tolist():
            start = 0.0
            if now[number] <= 0.0:
                times = (end * 0.5**k for k in range(1, _HALVINGS))
                start = next((time for time in times if gaps(time)[number] > 0.0), -1.0)
            time = 0.0
            if start >= 0.0:
                time = float(
                    scipy.optimize.brentq(lambda t, i=number: gaps(t)[i], start, end, xtol=1e-12 * end, rtol=1e-14)
                )
            first = (time, number) if first is None else min(first, (time, number))
        return first

    def _take(self, trial: _Trial, h: float, end: float) -> None:
        """Take the result of a step of a time h, and note contacts that opened, slide or stick."""
        last = trial.last
        self._time, self.work = min(self._time + h, end), self.work + last.work
        self._q, self._v, self.external, self._pushing = last.q, last.v, last.force, last.pushing
        self._rates, self._slip = last.rates, last.slip
        if self._touching or self.reduced.assembly.size:
            self._project()
        gaps = self._gaps(self.reduced.at(self._q, v=self._v))
        opened = [i for i in sorted(self._touching) if gaps[i] > _TOUCHES * self._size and not last.pushing.get(i)]
        self._touching -= frozenset(opened)
        if opened:
            self._rates, self._slip = np.zeros(0), np.zeros(0)  # of other rows from now on
            self._record("lift-off", opened)
        self._note(last.sliding)

    def _note(self, sliding: frozenset[tuple[int, int]]) -> None:
        """Note which friction groups move, and record contacts that begin to slide or to stick."""
        before, now = ({number for number, kind in each if not kind} for each in (self._sliding, sliding))
        self._sliding = sliding
        for cause, numbers in (("slip", now - before), ("grip", before - now)):
            if numbers & self._touching:
                self._record(cause, numbers & self._touching)

    def _project(self) -> None:
        """Remove the drift of contacts that push, or are below the ground, and of holonomic rows of the system."""
        if self.reduced.assembly.size:
            self._q = self.reduced.assembly.project(self._q)
        state = self.reduced.at(self._q, v=self._v)
        at = state.position
        rows = [(each.jacobian(at), each.gap(at)) for i in sorted(self._touching) for each in [self._contacts[i]]
                if self._pushing.get(i) or each.gap(at) < 0.0]  # fmt: skip
        if rows:
            J, gaps = np.array([row for row, _ in rows]), np.array([gap for _, gap in rows])
            W = J @ self._inverse(state, state.M)
            step = W.T @ np.linalg.lstsq(W @ J.T, gaps, rcond=1e-10)[0]
            self._q = pin.integrate(self._model, self._q, -step)

    def _impact(self, cause: str, numbers: Sequence[int] = ()) -> None:
        """Apply the impact of the contacts that touch."""
        state = self.reduced.at(self._q, v=self._v)
        gaps = self._gaps(state)
        self._touching |= frozenset(np.flatnonzero(gaps <= _TOUCHES * self._size).tolist())
        rows, named, loss = self._rows(state, self._touching, 0.0), dict[str, float](), 0.0
        approach = rows.matrix[rows.normals] @ self._v
        if (approach < -_ROUNDING * (1.0 + float(np.abs(self._v).max()))).any():
            inverse = self._inverse(state, state.M)
            W = rows.matrix @ inverse
            before, contacts = rows.matrix @ self._v - rows.ground, [self._contacts[i] for i in sorted(self._touching)]
            rates = before[rows.normals]
            rebounds = np.array([each.rebound(rate) for each, rate in zip(contacts, rates, strict=True)])
            slow = all(abs(rate) <= each.contact.rest_speed for rate, each in zip(rates, contacts, strict=True))
            problem = FrictionImpulses(W @ rows.matrix.T, before, rows.normals, rows.groups)
            impulses = problem.stop() if slow else problem.impact(rebounds)
            v = self._v + impulses @ W
            loss = float(0.5 * self._v @ state.M @ self._v - 0.5 * v @ state.M @ v)
            self._v, self.work = v, self.work - loss
            named = dict(zip(rows.names, impulses.tolist(), strict=True))
            leaves = rows.matrix[rows.normals] @ v > _TOUCHES * (1.0 + float(np.abs(v).max()))
            self._touching -= {number for number, gone in zip(sorted(self._touching), leaves, strict=True) if gone}
        self._record(cause, numbers, named, loss)
        rows = self._rows(state, self._touching, 1.0)
        self._rates, self._slip = np.zeros(0), rows.matrix @ self._v - rows.ground
        self._note(self._slides(rows, self._slip))

    def _record(
        self, cause: str, numbers: Collection[int] = (), impulses: dict[str, float] | None = None, loss: float = 0.0
    ) -> None:
        names = [each.name for each in self._contacts]
        closed = tuple(names[number] for number in sorted(self._touching))
        cause += " of " * bool(numbers) + ", ".join(names[number] for number in sorted(numbers))
        self.contact_events += (ContactEvent(self._time, cause, closed, impulses or {}, loss),)
