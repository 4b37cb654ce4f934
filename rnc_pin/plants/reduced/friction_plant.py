"""Plant whose contacts open, close, stick and slide: time stepping with Coulomb friction, extrapolated where smooth."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin
import scipy

from rnc_pin.errors import ConfigurationError, DivergenceError
from rnc_pin.math.linear_algebra import null_space, solve_positive_definite_columns
from rnc_pin.model.integrators.runge_kutta import DEFAULT_TOLERANCE
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.model.system import NonholonomicSystem
from rnc_pin.plants.reduced.constrained_dynamics import ConstrainedDynamics, VelocityChart
from rnc_pin.plants.reduced.contact_plant import ContactEvent
from rnc_pin.plants.reduced.friction import DryFriction
from rnc_pin.plants.reduced.friction_impulses import FrictionImpulses, FrictionLayout, FrictionRows
from rnc_pin.plants.reduced.step_control import IntegrationErrors, Substeps
from rnc_pin.plants.reduced.unilateral_contact import UnilateralContact, bound_contacts, check_depth, radius_of_gyration

_STEPS = (1, 2, 3, 4)  # Euler steps whose results are extrapolated: order 4, or 3 if that is precise enough
_PLAIN = (2, 4)  # the same where the motion is not smooth; the difference is the error
_SHORTEST = 2.0**-12  # step of the integration over that of the caller
_ROUNDING = 1e-12  # error of a step that rounding explains, relative to the state
_TOUCHES = 1e-8  # gap without contact force, over the radius of gyration, up to which a contact still touches
_HALVINGS = 20
_IMPACTS = 100  # located landings in one call of ``advance``; further ones happen at the ends of steps
_SLIDES = 1e-6  # slip that counts as sliding, relative to the largest velocity, plus 1


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
    changes: bool = False  # True if a friction group begins or ceases to move, or turns back


class _Trial(NamedTuple):
    """Result of a step of the integration."""

    last: _Solved
    errors: np.ndarray  # (2 nv,), infinite if a friction group begins or ceases to move
    landed: float | None  # time within the step after which an open contact is below the ground


class FrictionPlant:
    """Plant whose contacts with the ground open, close, stick and slide by Coulomb friction.

    Half-explicit Euler steps find velocity and impulses together: contacts only push, friction stays in its cone and
    opposes slip (Moreau 1988; Stewart and Trinkle 1996). Where the motion is smooth, four sequences of steps are
    extrapolated to order 4 (Lubich 1989). Where it is not, at landings and between stick and slip, the steps become
    shorter until their error is within the tolerance, or reach 2^-12 of a sample and are not extrapolated. Flight
    without friction and damping is integrated by Runge-Kutta steps.

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
        contact_forces, contact_force_units: mean forces of the rows of the contacts on the robot in the last step, by
            name, and their units.
        normal_forces: mean normal force of each contact in the last step [N], by name.
        sliding: names of the contacts that slide.
        errors: estimated errors of the integration since the start.

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
        self._substeps, self.tolerance = Substeps.checked(substeps, tolerance, "FrictionPlant")
        self.errors = IntegrationErrors.initial(Substeps(self._substeps, tolerance))
        self._dynamics = ConstrainedDynamics(self.reduced, joint_damping, actuator_limits)
        self._dry = DryFriction(self.reduced, joint_friction)
        self._rows = FrictionRows(self._contacts, self._dry)
        self._chart: VelocityChart | None = None
        self._model: pin.Model = self.reduced.robot.model
        self.applied = np.zeros(self.reduced.p)
        self.work, self._time, self._size, self._step = 0.0, 0.0, 0.0, np.inf
        self.contact_events: tuple[ContactEvent, ...] = ()
        self.external: np.ndarray | None = None
        self._all, self._touching = frozenset(range(len(self._contacts))), frozenset[int]()
        self._pushing: dict[int, float] = {}
        self._sliding: frozenset[tuple[int, int]] = frozenset()
        self._rates, self._slip = np.zeros(0), np.zeros(0)
        self._q, self._v = np.zeros(self.reduced.robot.nq), np.zeros(self.reduced.n)

    # ------------------------------------------------------------------ state

    @property
    def normal_forces(self) -> dict[str, float]:
        """Mean normal force of each contact in the last step [N], by name; NaN before the first step of a contact."""
        missing = dict.fromkeys(self._touching, np.nan)
        return {each.name: (missing | self._pushing).get(number, 0.0) for number, each in enumerate(self._contacts)}

    @property
    def contact_forces(self) -> dict[str, float]:
        """Mean forces of the rows of all contacts on the robot in the last step [N or N m], by name.

        Rows of open contacts have no force. After contacts changed, those of the others are NaN until the next step.
        """
        layout, present = (self._rows.layout(each, joints=False) for each in (self._all, self._touching))
        known = len(self._rates) == self._rows.layout(self._touching).size
        rates = self._rates[: present.size] if known else np.full(present.size, np.nan)
        return dict.fromkeys(layout.names, 0.0) | dict(zip(present.names, rates.tolist(), strict=True))

    @property
    def contact_force_units(self) -> dict[str, str]:
        """Units of ``contact_forces``, by name."""
        layout = self._rows.layout(self._all, joints=False)
        return dict(zip(layout.names, layout.units, strict=True))

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
        self.applied, self.external, self._chart = np.zeros(self.reduced.p), None, None
        self.errors = IntegrationErrors.initial(Substeps(self._substeps, self.tolerance))
        self._pushing, self._sliding, self._rates, self._slip = {}, frozenset(), np.zeros(0), np.zeros(0)
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
        steps, errors = 0, np.zeros(2 * self.reduced.n)
        while end - self._time > 1e-9 * shortest:
            left = end - self._time
            longest = min(dt / (self._substeps or 1), left)
            h = min(self._step, longest)
            trial = self._trial(h, h <= shortest, h == longest)
            ratio = float(trial.errors.max()) / self._allowed(h)
            if ratio > 1.0 and h > shortest:
                self._step = max(h * min(0.5, max(0.1, 0.9 * ratio**-0.25)), shortest)
                continue
            if trial.landed is not None and impacts < _IMPACTS:
                found = self._located(trial.landed, shortest)
                if found is not None:
                    time, number = found
                    if time > 0.0:
                        trial = self._trial(time, time <= shortest)
                        steps, errors = steps + 1, errors + np.where(trial.errors < np.inf, trial.errors, 0.0)
                        self._take(trial, time, end)
                    self._touching |= {number}
                    self._impact("landing", [number])
                    impacts += 1
                    self._step = max(0.5 * h, shortest)
                    continue
            steps, errors = steps + 1, errors + trial.errors
            self._take(trial, h, end)
            longer = 4.0 if h <= shortest else min(4.0, max(1.0, 0.8 * max(ratio, 1e-9) ** -0.25))
            self._step = max(h, shortest) * longer
        chosen = Substeps(self._substeps, self.tolerance)
        error = float(errors.max(initial=0.0))
        self.errors = self.errors.compared(max(steps, 1), 0.0, error, dt, chosen, max(steps, 1))

    def _allowed(self, h: float) -> float:
        """Allowed error of a step of a time h [s]."""
        return self.tolerance * h + _ROUNDING * (1.0 + float(np.abs(self._v).max()))

    def _trial(self, h: float, plain: bool, longest: bool = False) -> _Trial:
        """Result of a step of a time h [s]: extrapolated, or of the shortest Euler steps if ``plain``.

        Order 3 is enough for the ``longest`` step. A step that the error limits is longer with order 4.
        """
        if not (self._touching or len(self._dry.limits)) and self._dynamics.damping is None:
            return self._flown(h)
        table: list[np.ndarray] = []
        nv, allowed, errors, last, path = len(self._v), self._allowed(h), np.zeros(0), self._start(), list[np.ndarray]()
        for count in _PLAIN if plain else _STEPS:
            last, path = self._start(), []
            for _ in range(count):
                last = self._euler(last, h / count)
                path.append(last.q)
                if last.changes and not plain:
                    return _Trial(last, np.full(2 * nv, np.inf), None)
            row = [np.concatenate([pin.difference(self._model, self._q, last.q), last.v, [last.work]])]
            for column, before in enumerate(() if plain else table):
                weight = count / (count - column - 1) - 1.0
                row.append(row[-1] + (row[-1] - before) / weight)
            if table:
                errors = np.abs(row[-1] - (table if plain else row[:-1])[-1])[: 2 * nv]
                if longest and count > 2 and errors.max() <= allowed:
                    table = row
                    break
            table = row
        if not plain:
            found = table[-1]
            last = last._replace(
                q=pin.integrate(self._model, self._q, found[:nv]), v=found[nv:-1], work=float(found[-1])
            )
            path[-1] = last.q
        return _Trial(last, errors, self._landing(h, path))

    def _flown(self, h: float) -> _Trial:
        """Result of a step of a time h [s] without contacts, friction and damping."""
        if self._chart is None:
            self._dynamics.initial(self._q, self._v)
            self._chart = self._dynamics.chart
        y = self._dynamics.initial(self._q, self._v, self._chart)
        coarse = self._dynamics.advance(self._q, y, self.applied, h, 1)
        path, work = [self._q], y
        for _ in range(2):
            q, work, _ = self._dynamics.advance(path[-1], work, self.applied, h / 2, 1)
            if not (np.isfinite(q).all() and np.isfinite(work).all()):
                raise DivergenceError(f"plant velocities are not finite at t = {self._time:.4f} s")
            path.append(q)
        v, leaves = self._chart.velocity(path[-1], work[: self.reduced.r], None)
        if leaves:
            self._chart = None
        errors = np.abs(self._dynamics.errors(coarse[:2], (path[-1], work), True))
        none = np.zeros(0)
        last = _Solved(path[-1], v, float(work[-1]), np.zeros(len(v)), {}, frozenset(), none, none)
        return _Trial(last, errors, self._landing(h, path[1:]))

    def _landing(self, h: float, path: list[np.ndarray]) -> float | None:
        """First of equal times until h [s] at whose configuration an open contact is below the ground."""
        if len(self._touching) == len(self._contacts):
            return None
        below = (step for step, q in enumerate(path, 1) if (self._open_gaps(q) < 0.0).any())
        return next((h * step / len(path) for step in below), None)

    def _start(self) -> _Solved:
        return _Solved(self._q, self._v, 0.0, np.zeros(0), {}, self._sliding, self._rates, self._slip)

    def _euler(self, start: _Solved, h: float) -> _Solved:
        """State after one half-explicit Euler step."""
        q = pin.integrate(self._model, start.q, h * start.v)
        if not np.isfinite(q).all():
            raise DivergenceError(f"plant velocities are not finite at t = {self._time:.4f} s")
        state = StateEvaluation.at(self.reduced.evaluator, q, v=start.v)
        M, damping, forced = state.M, self._dynamics.damping, state.B @ self.applied
        matrix = M if damping is None else M + h * np.diag(damping)
        layout = self._rows.layout(self._touching)
        rows, ground = self._rows.at(state, layout)
        free, W = self._responses(state, matrix, M @ start.v + h * (forced - state.bias), rows)
        groups = [each if each.normal >= 0 else each._replace(constant=h * each.constant) for each in layout.groups]
        problem = FrictionImpulses(rows @ W, rows @ free - ground, layout.normals, groups)
        p = problem.solve(h * start.rates if len(start.rates) == layout.size else None) if layout.size else np.zeros(0)
        v = free + W @ p
        force = rows.T @ p / h
        if damping is not None:
            force = force - damping * v
        outside = forced + force
        if self.reduced.reduction_data.forces:
            outside = outside + state.passive_sums.without_potential
        slip = rows @ v - ground
        leaving = _ROUNDING * (1.0 + float(np.abs(v).max()))
        pushing = {
            number: float(p[row]) / h if slip[row] <= leaving else 0.0
            for number, row in zip(sorted(self._touching), layout.normals, strict=True)
        }
        sliding = self._slides(layout, slip)
        changes = sliding != self._sliding
        if len(start.slip) == len(slip):
            moving = (each.rows for each, key in zip(layout.groups, layout.keys, strict=True) if key in sliding)
            changes = changes or any(slip[own] @ start.slip[own] < 0.0 for own in moving)
        work = start.work + h * 0.5 * float((start.v + v) @ outside)
        return _Solved(q, v, work, force, pushing, sliding, p / h, slip, changes)

    def _slides(self, layout: FrictionLayout, slip: np.ndarray) -> frozenset[tuple[int, int]]:
        """Keys of the friction groups that move at velocities (k,) of the rows."""
        limit = (_SLIDES * (1.0 + float(np.abs(self._v).max()))) ** 2
        moving = (slip[each.rows] @ slip[each.rows] > limit for each in layout.groups)
        return frozenset(key for key, moves in zip(layout.keys, moving, strict=True) if moves)

    def _responses(
        self, state: StateEvaluation, M: np.ndarray, momentum: np.ndarray, rows: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Velocities (nv,) of a momentum (nv,) and (nv, k) of impulses along rows, within the system's constraints."""
        columns = np.vstack([momentum, rows]).T
        if not self.reduced.m:
            found = solve_positive_definite_columns(M, columns)
        else:
            A = state.all_rows
            lengths = np.linalg.norm(A, axis=1)
            R = null_space(A[lengths > 0] / lengths[lengths > 0, None])
            found = solve_positive_definite_columns(R.T @ M @ R, R.T @ columns)
            found = None if found is None else R @ found
        if found is None:
            raise DivergenceError(f"inertia is not positive definite at t = {self._time:.4f} s")
        return found[:, 0], found[:, 1:]

    # ------------------------------------------------------------------ events

    def _gaps(self, state: StateEvaluation) -> np.ndarray:
        at = state.position
        return np.array([each.gap(at) for each in self._contacts])

    def _open_gaps(self, q: np.ndarray) -> np.ndarray:
        """Gaps (c,); infinite for contacts that touch."""
        gaps = self._gaps(StateEvaluation.at(self.reduced.evaluator, q, v=self._v))
        gaps[list(self._touching)] = np.inf
        return gaps

    def _located(self, end: float, shortest: float) -> tuple[float, int] | None:
        """Time after now, at most ``end``, at which the first open contact lands, and its number."""

        def gaps(time: float) -> np.ndarray:
            q = self._q if time == 0.0 else self._trial(time, time <= shortest).last.q
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
            _, W = self._responses(state, state.M, state.v, J)
            step = W @ np.linalg.lstsq(J @ W, gaps, rcond=1e-10)[0]
            self._q = pin.integrate(self._model, self._q, -step)

    def _impact(self, cause: str, numbers: Sequence[int] = ()) -> None:
        """Apply the impact of the contacts that touch."""
        state = self.reduced.at(self._q, v=self._v)
        gaps = self._gaps(state)
        self._touching |= frozenset(np.flatnonzero(gaps <= _TOUCHES * self._size).tolist())
        layout, named, loss = self._rows.layout(self._touching, joints=False), dict[str, float](), 0.0
        rows, ground = self._rows.at(state, layout)
        approach = rows[layout.normals] @ self._v
        if (approach < -_ROUNDING * (1.0 + float(np.abs(self._v).max()))).any():
            _, W = self._responses(state, state.M, self._v, rows)
            before, contacts = rows @ self._v - ground, [part.contact for part in layout.parts]
            rates = before[layout.normals]
            rebounds = np.array([each.rebound(rate) for each, rate in zip(contacts, rates, strict=True)])
            slow = all(abs(rate) <= each.contact.rest_speed for rate, each in zip(rates, contacts, strict=True))
            problem = FrictionImpulses(rows @ W, before, layout.normals, layout.groups)
            impulses = problem.stop() if slow else problem.impact(rebounds)
            v = self._v + W @ impulses
            loss = float(0.5 * self._v @ state.M @ self._v - 0.5 * v @ state.M @ v)
            self._v, self.work = v, self.work - loss
            named = dict(zip(layout.names, impulses.tolist(), strict=True))
            leaves = rows[layout.normals] @ v > _TOUCHES * (1.0 + float(np.abs(v).max()))
            self._touching -= {number for number, gone in zip(sorted(self._touching), leaves, strict=True) if gone}
        self._record(cause, numbers, named, loss)
        layout = self._rows.layout(self._touching)
        rows, ground = self._rows.at(state, layout)
        self._rates, self._slip = np.zeros(0), rows @ self._v - ground
        self._note(self._slides(layout, self._slip))

    def _record(
        self, cause: str, numbers: Collection[int] = (), impulses: dict[str, float] | None = None, loss: float = 0.0
    ) -> None:
        names = [each.name for each in self._contacts]
        closed = tuple(names[number] for number in sorted(self._touching))
        cause += " of " * bool(numbers) + ", ".join(names[number] for number in sorted(numbers))
        self.contact_events += (ContactEvent(self._time, cause, closed, impulses or {}, loss),)
