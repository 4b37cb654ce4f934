"""Motion of contacts that touch, stick and slide: time stepping with Coulomb friction, extrapolated where smooth."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from rnc_pin.errors import DivergenceError
from rnc_pin.lab.contacts.contact_impulses import BoundContact, ContactRows, FrictionImpulses, RowLayout, responses
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.plants.plant import IntegrationErrors, PlantReport, Substeps
from rnc_pin.plants.reduced_plant import ReducedPlant

_ROUNDING = 1e-12  # error of a step that rounding explains, relative to the state

Change = tuple[str, frozenset[int]]
"""Beginning of a state of contacts, such as "slip", and their numbers."""


class _Solved(NamedTuple):
    """Result of one Euler step."""

    q: np.ndarray
    v: np.ndarray
    work: float
    force: np.ndarray | None  # mean generalized force (nv,) of contacts, friction and damping
    pushing: dict[int, float]  # mean normal force of each contact that touches [N]
    sliding: frozenset[int]  # keys of the friction groups that move
    rates: np.ndarray  # mean forces of the rows, (k,)
    slip: np.ndarray  # velocities of the rows relative to the ground, (k,)
    changes: bool = False  # True if a friction group begins or ceases to move, or turns back


class _Trial(NamedTuple):
    """Result of a step of the integration."""

    last: _Solved
    errors: np.ndarray  # (2 nv,), infinite if a friction group begins or ceases to move


class SlidingPlant:
    """Motion while contacts with friction touch the ground.

    Half-explicit Euler steps find velocity and impulses together: contacts only push, friction stays in its cone and
    opposes slip (Moreau 1988; Stewart and Trinkle 1996). Where the motion is smooth, four sequences of steps are
    extrapolated to order 4 (Lubich 1989). Where it is not, as between stick and slip, the steps become shorter until
    their error is within the tolerance, or reach 2^-12 of a sample and are not extrapolated.

    Args:
        flight: plant without the contacts.
        contacts: all contacts.
        rows: their rows, with rows of dry joint friction.

    Attributes:
        applied: applied inputs (p,), within the actuator limits.
        touching: numbers of the contacts that touch.
        longest: length of the next step [s], if the sample leaves it.
        errors: estimated errors of the integration.
    """

    def __init__(self, flight: ReducedPlant, contacts: Sequence[BoundContact], rows: ContactRows) -> None:
        self._flight, self._contacts, self._rows = flight, contacts, rows
        self.reduced = reduced = flight.reduced
        self._substeps = Substeps(flight.substeps, flight.tolerance)
        self._model: pin.Model = reduced.robot.model
        self.errors = IntegrationErrors.initial(self._substeps)
        self.applied, self.touching = np.zeros(reduced.p), frozenset[int]()
        self._sample = 0.0
        self.restart(0.0)
        self._now: _Solved
        self._present: _Solved

    # ------------------------------------------------------------------ state

    def restart(self, size: float) -> None:
        """Forget the motion so far of a robot with a radius of gyration [m].

        Args:
            size: radius of gyration [m].
        """
        self._size, self.longest = size, np.inf
        self._steps, self._sum = 0, np.zeros(2 * self.reduced.n)

    def reset(self, q: np.ndarray, v: np.ndarray, t: float = 0.0) -> None:
        """Start at configuration q (nq,) and velocity v (nv,), at rest of all inputs.

        Args:
            q: configuration (nq,).
            v: velocity (nv,).
            t: time [s]; constraints here do not depend on it.
        """
        none = np.zeros(0)
        self._now = self._present = _Solved(q, v, 0.0, None, {}, frozenset(), none, none)
        self.applied = np.zeros(self.reduced.p)

    def touch(self, touching: frozenset[int], v: np.ndarray) -> list[Change]:
        """Let contacts touch, and return the contacts that slide.

        Args:
            touching: numbers of the contacts.
            v: velocity (nv,), e.g. after an impact.
        """
        self.touching, self._present = touching, self._now._replace(v=v)
        layout = self._rows.layout(touching)
        rows, ground = self._rows.at(self.state, layout)
        slip = rows @ v - ground
        # Forces of other rows are no guess for those of these.
        self._now = self._present = self._present._replace(slip=slip, rates=np.zeros(0))
        return self._note(self._slides(layout, slip))

    @property
    def state(self) -> StateEvaluation:
        """Present state, also within a step."""
        return StateEvaluation.at(self.reduced.evaluator, self._present.q, v=self._present.v)

    @property
    def work(self) -> float:
        """Work since the start, minus the energy that damping and friction removed [J]."""
        return self._now.work

    def report(self) -> PlantReport:
        """Return inputs, model, and the mean generalized forces of contacts, damping and friction in the last step."""
        return PlantReport(applied=self.applied, reduced=self.reduced, external=self._now.force)

    @property
    def normal_forces(self) -> dict[int, float]:
        """Mean normal force of each contact that touches in the last step [N]; NaN before its first step."""
        return dict.fromkeys(self.touching, np.nan) | self._now.pushing

    @property
    def contact_forces(self) -> dict[str, float]:
        """Mean forces of the rows of the contacts that touch in the last step; NaN after contacts changed."""
        layout, rates = self._rows.layout(self.touching, joints=False), self._now.rates
        known = len(rates) == self._rows.layout(self.touching).size
        return dict(zip(layout.names, rates.tolist() if known else [np.nan] * layout.size, strict=False))

    @property
    def sliding(self) -> frozenset[int]:
        """Numbers of the contacts that slide."""
        return frozenset(number for number in self._now.sliding if number >= 0)

    def read(self) -> tuple[np.ndarray, np.ndarray]:
        """Configuration (nq,) and velocity (nv,)."""
        return self._present.q.copy(), self._present.v.copy()

    def apply(self, T: np.ndarray) -> None:
        """Hold the inputs T (p,), clipped to the actuator limits.

        Args:
            T: inputs (p,) [N or N m].
        """
        self.applied = self._flight.dynamics.saturate(T)

    def keep_errors(self, errors: IntegrationErrors) -> None:
        """Go on with the estimated errors of a motion that this one continues.

        Args:
            errors: estimated errors so far.
        """
        self.errors = errors

    # ------------------------------------------------------------------ motion

    def step(self, left: float, dt: float) -> SlidingStep:
        """Return a step within the tolerance, of at most the time ``left`` of a sample of dt [s].

        Args:
            left: rest of the sample [s].
            dt: duration of the sample [s].
        """
        shortest_share = 2.0**-12  # step of the integration over the caller's
        self._sample, shortest = dt, shortest_share * dt
        while True:
            longest = min(dt / (self._substeps.number or 1), left)
            h = min(self.longest, longest)
            trial = self.trial(h, h <= shortest, h == longest)
            ratio = float(trial.errors.max()) / self._allowed(h)
            if ratio <= 1.0 or h <= shortest:
                return SlidingStep(self, trial, h, shortest, ratio)
            # The ratio grows about as h^4; a tenth less, so that the next step is within the tolerance.
            self.longest = max(h * min(0.5, max(0.1, 0.9 * ratio**-0.25)), shortest)

    def end_sample(self) -> None:
        """Add the errors of the steps in the present sample."""
        if self._steps:
            error = float(self._sum.max(initial=0.0))
            self.errors = self.errors.compared(self._steps, 0.0, error, self._sample, self._substeps, self._steps)
            self._steps, self._sum = 0, np.zeros(2 * self.reduced.n)

    def present(self, trial: _Trial | None) -> None:
        """Move to the end of a trial, or back to the start of the step.

        Args:
            trial: the trial; None for the start of the step.
        """
        self._present = self._now if trial is None else trial.last

    def take(self, trial: _Trial) -> list[Change]:
        """Take the result of a step, and return the contacts that opened, slide or stick.

        Args:
            trial: result of the step.
        """
        last, self._steps = trial.last, self._steps + 1
        self._sum = self._sum + np.where(trial.errors < np.inf, trial.errors, 0.0)
        self._now = self._present = last._replace(sliding=self._now.sliding, work=self._now.work + last.work)
        self._project()
        at = self.state.position
        touches = 1e-8  # gap without contact force, over the radius of gyration, up to which a contact still touches
        far = touches * self._size
        opened = frozenset(i for i in self.touching if self._contacts[i].gap(at) > far and not last.pushing.get(i))
        self.touching -= opened
        if opened:  # the rows are other ones from now on
            self._now = self._present = self._now._replace(rates=np.zeros(0), slip=np.zeros(0))
        return [*([("lift-off", opened)] if opened else []), *self._note(last.sliding)]

    def _allowed(self, h: float) -> float:
        """Allowed error of a step of a time h [s]."""
        return self._substeps.tolerance * h + _ROUNDING * (1.0 + float(np.abs(self._now.v).max()))

    def trial(self, h: float, plain: bool, longest: bool = False) -> _Trial:
        """Result of a step of a time h [s]: extrapolated, or of the shortest Euler steps if ``plain``.

        Order 3 is enough for the ``longest`` step. A step that the error limits is longer with order 4.

        Args:
            h: duration [s].
            plain: True for a step that is not smooth.
            longest: True if the step is as long as the sample allows.
        """
        table: list[np.ndarray] = []
        start = self._now._replace(work=0.0)
        q, nv, allowed, errors, last = start.q, len(start.v), self._allowed(h), np.zeros(0), start
        smooth = (1, 2, 3, 4)  # Euler steps whose results are extrapolated: order 4, or 3 if that is precise enough
        plain_steps = (2, 4)  # where the motion is not smooth; the difference of both results is the error
        for count in plain_steps if plain else smooth:
            last = start
            for _ in range(count):
                last = self._euler(last, h / count)
                if last.changes and not plain:
                    # Extrapolation needs smooth errors: a change of stick and slip within the step ends it.
                    return _Trial(last, np.full(2 * nv, np.inf))
            row = [np.concatenate([pin.difference(self._model, q, last.q), last.v, [last.work]])]
            for column, before in enumerate(() if plain else table):
                row.append(row[-1] + (row[-1] - before) / (count / (count - column - 1) - 1.0))
            if table:
                errors = np.abs(row[-1] - (table if plain else row[:-1])[-1])[: 2 * nv]
            table = row
            if longest and count > 2 and errors.max() <= allowed:
                break
        if not plain:
            found = table[-1]
            last = last._replace(q=pin.integrate(self._model, q, found[:nv]), v=found[nv:-1], work=float(found[-1]))
        return _Trial(last, errors)

    def _euler(self, start: _Solved, h: float) -> _Solved:
        """State after one half-explicit Euler step."""
        q = pin.integrate(self._model, start.q, h * start.v)
        if not np.isfinite(q).all():
            raise DivergenceError("plant velocities are not finite")
        state = StateEvaluation.at(self.reduced.evaluator, q, v=start.v)
        M, damping, forced = state.M, self._flight.dynamics.damping, state.B @ self.applied
        # Damping acts at the velocity after the step: stiff damping is stable at any step.
        matrix = M if damping is None else M + h * np.diag(damping)
        layout = self._rows.layout(self.touching)
        rows, ground = self._rows.at(state, layout)
        found = responses(state, matrix, np.vstack([M @ start.v + h * (forced - state.bias), rows]))
        free, W = found[:, 0], found[:, 1:]
        groups = [each if each.normal >= 0 else each._replace(constant=h * each.constant) for each in layout.groups]
        # Impulses of friction limits in a step are h times their forces; coefficients relate impulses already.
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
        # A contact that leaves has no force, although its impulse may be rounding.
        leaving = _ROUNDING * (1.0 + float(np.abs(v).max()))
        pushing = {
            number: float(p[row]) / h if slip[row] <= leaving else 0.0
            for number, row in zip(sorted(self.touching), layout.normals, strict=True)
        }
        sliding = self._slides(layout, slip)
        changes = sliding != self._now.sliding
        if len(start.slip) == len(slip):
            moving = (each.rows for each in layout.groups if each.key in sliding)
            # Slip that turns back came to rest within the step, where friction jumps.
            changes = changes or any(slip[own] @ start.slip[own] < 0.0 for own in moving)
        work = start.work + h * 0.5 * float((start.v + v) @ outside)
        return _Solved(q, v, work, force, pushing, sliding, p / h, slip, changes)

    def _slides(self, layout: RowLayout, slip: np.ndarray) -> frozenset[int]:
        """Keys of the friction groups that move at velocities (k,) of the rows."""
        slides = 1e-6  # slip that counts as sliding, relative to the largest velocity, plus 1
        limit = (slides * (1.0 + float(np.abs(self._now.v).max()))) ** 2
        return frozenset(each.key for each in layout.groups if slip[each.rows] @ slip[each.rows] > limit)

    def _note(self, sliding: frozenset[int]) -> list[Change]:
        """Note which friction groups move, and return the contacts that begin to slide or to stick."""
        before = self.sliding
        self._now = self._present = self._now._replace(sliding=sliding)
        changes = ("slip", (self.sliding - before) & self.touching), ("grip", (before - self.sliding) & self.touching)
        return [each for each in changes if each[1]]

    def _project(self) -> None:
        """Remove the drift of contacts that push, or are below the ground, and of holonomic rows of the system."""
        q = self.reduced.assembly.project(self._now.q) if self.reduced.assembly.size else self._now.q
        state = self.reduced.at(q, v=self._now.v)
        at = state.position
        rows = [(each.jacobian(at), each.gap(at)) for i in sorted(self.touching) for each in [self._contacts[i]]
                if self._now.pushing.get(i) or each.gap(at) < 0.0]  # fmt: skip
        if rows:
            J, gaps = np.array([row for row, _ in rows]), np.array([gap for _, gap in rows])
            W = responses(state, state.M, J)
            # The shortest step in the metric of the inertia, which the constraints of the system allow.
            q = pin.integrate(self._model, q, -(W @ np.linalg.lstsq(J @ W, gaps, rcond=1e-10)[0]))
        self._now = self._present = self._now._replace(q=q)


class SlidingStep:
    """Step of a ``SlidingPlant`` within its tolerance.

    Args:
        plant: the plant, at the start of the step until ``take``.
        trial: result of the step.
        dt: duration of the step [s].
        shortest: shortest duration [s].
        ratio: error over the allowed one.
    """

    def __init__(self, plant: SlidingPlant, trial: _Trial, dt: float, shortest: float, ratio: float) -> None:
        self._plant, self.dt, self._shortest, self._ratio = plant, dt, shortest, ratio
        self._whole = self._part = trial
        self._elapsed = dt

    def move_to(self, elapsed: float) -> None:
        """Move the plant to a time after the start of the step [s].

        Args:
            elapsed: the time [s], up to ``dt``.
        """
        self._elapsed = elapsed
        if elapsed == self.dt:
            self._part = self._whole
        elif elapsed > 0.0:
            self._part = self._plant.trial(elapsed, elapsed <= self._shortest)
        self._plant.present(self._part if elapsed > 0.0 else None)

    def take(self) -> list[Change]:
        """Take the time to which the plant moved as the end of the step, and return what contacts begin to do."""
        h, plant = self.dt, self._plant
        if self._elapsed < h:  # an event
            plant.longest = max(0.5 * h, self._shortest)
        else:
            most = 4.0 if h <= self._shortest else min(4.0, max(1.0, 0.8 * max(self._ratio, 1e-9) ** -0.25))
            plant.longest = max(h, self._shortest) * most
        return plant.take(self._part) if self._elapsed > 0.0 else []
