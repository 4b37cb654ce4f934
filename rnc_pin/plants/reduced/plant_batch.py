"""Plants of many runs of one model, which advance in lock-step."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import cast

import numpy as np
from numpy import ndarray as Array

from rnc_pin.array_shapes import Float
from rnc_pin.errors import InputError
from rnc_pin.model.cached_property import cached_property
from rnc_pin.model.input_validation import numbers_of
from rnc_pin.model.numpy_evaluator import Dissipation, NumPyRuns, RunRecords, RunStarts
from rnc_pin.model.parameter_types import is_count
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.plants.reduced.constrained_dynamics import MAX_GROWTH, VelocityChart
from rnc_pin.plants.reduced.friction import INSTANT
from rnc_pin.plants.reduced.reduced_plant import Checkpoint, ReducedPlant
from rnc_pin.plants.reduced.step_control import MOST_EVENT_SUBSTEPS, MOST_SUBSTEPS, IntegrationErrors, Substeps


class ReducedPlantBatch:
    """Plants of B runs of one model that advance in lock-step.

    One call of the compiled kernel moves all runs. A run that the kernel cannot decide takes the path of the single
    plant. A run that fails keeps its last state and rests, and the others go on; ``reset`` restarts it.

    Args:
        plant: plant with the model and the options of all runs; it does not move.
        size: number of runs B.

    Attributes:
        reduced: model of all runs.
        applied: applied inputs (B, p).
        failed: mask (B,) of the runs that failed.
        tolerance: allowed error of the integration per second, as of the plant.
        measures: True if ``measure`` is possible.
        errors: error of each run that failed, None for the others.

    Raises:
        InputError: size is not a positive integer.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")], robot.joint_names[1:])
        >>> plants = rnc.plants.ReducedPlantBatch(rnc.ReducedPlant(system.reduce()), size=3)
        >>> plants.reset(robot.configuration({"joint_2": 1.0}), np.zeros(4))  # the same start for all runs
        >>> plants.apply([[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [np.inf, 0.0, 0.0]])
        >>> plants.advance(0.002)
        >>> plants.failed
        array([False, False,  True])
        >>> q, v = plants.read()
        >>> v[:, 1].round(4)
        array([0.    , 0.0028,    nan])
    """

    def __init__(self, plant: ReducedPlant, size: int) -> None:
        if not isinstance(plant, ReducedPlant):
            raise InputError(f"plant of a ReducedPlantBatch: expected a ReducedPlant, found {type(plant).__name__}")
        if not is_count(size, 1):
            raise InputError(f"size of a ReducedPlantBatch has to be a positive integer, found {size!r}")
        self._single = plant.twin()
        self.reduced, self.size, self.tolerance = plant.reduced, int(size), plant.tolerance
        data = self.reduced.reduction_data
        self.measures = self.reduced.evaluator.measures and not data.affine and not data.rheonomic
        self._limit = self.reduced.r + MAX_GROWTH
        self._q = np.full((self.size, self.reduced.robot.nq), np.nan)
        self._y = np.zeros((self.size, self._single._dynamics.state_size))
        self.applied = np.zeros((self.size, self.reduced.p))
        self._friction = np.full(self.size, plant.actuator_friction)
        self._substeps = Substeps(plant.substeps, plant.tolerance)
        start = IntegrationErrors.initial(self._substeps)
        self._errors = start.of_runs(self.size)
        self._charts: list[VelocityChart | None] = [None] * self.size
        self._v, self._kinematics = (np.empty((self.size, 0)) for _ in range(2))
        self._located = False  # True if ``_v`` and ``_kinematics`` are those of the state
        self._records: RunRecords | None = None
        self.errors: list[Exception | None] = [None] * self.size
        self.failed = np.zeros(self.size, dtype=bool)

    @cached_property
    def _runs(self) -> NumPyRuns:
        """Calls for many runs in the reduction of the model."""
        return self.reduced.evaluator.runs

    @cached_property
    def _chart_calls(self) -> list[object]:
        """``NumPyEvaluator.chart`` of the chart of each run; None for runs without a chart."""
        return [None if chart is None else chart.evaluator.chart for chart in self._charts]

    def __getstate__(self) -> dict[str, object]:  # these refer to memory
        return {name: value for name, value in vars(self).items() if name not in ("_runs", "_chart_calls")}

    # ------------------------------------------------------------------ plant

    def reset(
        self, q: Float[Array, "*batch nq"], v: Float[Array, "*batch nv"], runs: Sequence[int] | None = None
    ) -> None:
        """Restart runs with zero inputs; velocity against the constraints is removed.

        Args:
            q: configurations (B, nq), or one (nq,) for all.
            v: velocities (B, nv), or one (nv,) for all.
            runs: indices of the runs to restart, whose number then replaces B; all by default.
        """
        which = np.arange(self.size)
        if runs is not None:
            try:
                which = which[np.asarray(runs)]
            except IndexError:
                raise InputError(f"runs: expected indices of {self.size} runs, found {runs!r}") from None
        q = _rows(numbers_of(q, "q"), len(which), self.reduced.robot.nq, "q")
        v = _rows(numbers_of(v, "v"), len(which), self.reduced.n, "v")
        _ = self.reduced.at(q, v=v, t=0.0)  # refuses what is not finite or not of unit length
        charts: dict[bytes, VelocityChart] = {}  # runs with the same start share a chart
        start = IntegrationErrors.initial(self._substeps)
        for run, q_0, v_0 in zip(which.tolist(), q, v, strict=True):
            dynamics = self._single._dynamics
            y = dynamics.initial(q_0, v_0, charts.get(q_0.tobytes()))
            charts[q_0.tobytes()] = dynamics.chart
            nothing, friction = np.zeros(self.reduced.p), float(self._friction[run])
            self.rollback(run, Checkpoint(q_0, y, None, nothing, dynamics.chart, start, friction))

    def read(self) -> tuple[Float[Array, "B nq"], Float[Array, "B nv"]]:
        """Return copies of configurations (B, nq) and velocities (B, nv), with NaN velocities of failed runs."""
        self._locate()
        return self._q.copy(), np.where(self.failed[:, None], np.nan, self._v)

    def apply(self, T: Float[Array, "B p"]) -> None:
        """Hold the inputs T (B, p), clipped to the actuator limits; ``applied`` has the result."""
        T = np.asarray(T, dtype=float)
        if T.shape != self.applied.shape:
            raise InputError(f"T has shape {T.shape}, expected {self.applied.shape}")
        self.applied = np.array(self._single._dynamics.saturate(T), order="C")  # the caller may change T

    def advance(self, dt: float) -> None:
        """Integrate all runs that have not failed over a time dt [s]."""
        self._locate()
        alone, steps_of_runs, rubs = ~self.failed, np.array(self._errors.steps), self._friction > 0.0
        for steps, with_friction in set(zip(steps_of_runs[alone].tolist(), rubs[alone].tolist(), strict=True)):
            which = np.flatnonzero(alone & (steps_of_runs == steps) & (rubs == with_friction))
            alone[which[self._together(which, dt, steps)]] = False
        for run in np.flatnonzero(alone).tolist():
            self._alone(run, partial(self._single.advance, dt))
        self._located = False

    def _together(self, which: Array, dt: float, steps: int) -> Array:
        """Integrate runs (b,) with one number of substeps by the kernel; return the mask (b,) of those that moved.

        The decisions are those of ``ReducedPlant.advance``. A run that the kernel cannot decide moves alone.
        """
        errors, dynamics = self._errors, self._single._dynamics
        some = len(which) < self.size
        now = errors.selected(which) if some else errors
        q, y, status, roughness = self._integrated(which, dt, steps)
        with np.errstate(invalid="ignore"):  # an infinite roughness at a stop of friction needs a comparison
            accepts, after = now.after(cast(float, roughness), dt, self._substeps.followed * dt)
        moved = status == 1.0
        accepted = np.asarray(accepts) & moved
        if accepted.all() and not some:
            self._errors = after._replace(used=cast(int, np.array(after.steps)))  # ``write`` changes each array
        else:
            for each, all_runs in zip(after.arrays, errors.arrays, strict=True):
                all_runs[which[accepted]] = each[accepted]
        due, limit = np.flatnonzero(moved & ~accepted), self._substeps.tolerance * dt
        most = MOST_EVENT_SUBSTEPS if self._dissipate(which) else MOST_SUBSTEPS
        while len(due):
            fine = self._integrated(which[due], dt, 2 * steps)
            valid = fine[2] == 1.0
            for each in (q[due], y[due], *fine[:2]):
                valid &= np.isfinite(each).all(axis=1)
            moved[due], more = valid, np.zeros(len(due), dtype=bool)
            for place in np.flatnonzero(valid).tolist():
                k, finer = int(due[place]), (fine[0][place], fine[1][place])
                run = int(which[k])
                dynamics.chart = self._chart(run)
                found = dynamics.errors((q[k], y[k]), finer, bool(fine[3][place] < np.inf))
                error = float(np.abs(found).max(initial=0.0))
                enough = error <= limit
                if enough or (self._substeps.number is None and steps >= most):
                    own = errors.of_run(run)
                    errors.write(run, own.compared(steps, float(roughness[k]), error, dt, self._substeps, steps))
                elif self._substeps.number is None:
                    more[place] = True
                    (q[k], y[k]), roughness[k] = finer, fine[3][place]
                else:
                    moved[k] = False
            due, steps = due[more], 2 * steps
        if self.reduced.assembly.size:
            for k in np.flatnonzero(moved).tolist():
                if np.isfinite(q[k]).all():
                    q[k] = dynamics.project(q[k].copy(), y[k].copy())
        if moved.all() and not some:
            self._q, self._y = q, y
        else:
            self._q, self._y = self._q.copy(), self._y.copy()
            self._q[which[moved]], self._y[which[moved]] = q[moved], y[moved]
        return moved

    def _integrated(self, which: Array, dt: float, steps: int) -> tuple[Array, Array, Array, Array]:
        """Result of the kernel for runs (b,): q, y, status and roughness."""
        calls, arrays = self._chart_calls, (self._q, self._y, self.applied)
        kinematics = self._kinematics
        if len(which) < self.size:
            calls, arrays = [calls[run] for run in which], tuple(each[which] for each in arrays)
            kinematics = kinematics[which]
        if not self._dissipate(which):
            return self._runs.integrate(tuple(calls), *arrays, dt / steps, steps, kinematics)
        start = RunStarts(*arrays, kinematics)
        return self._runs.dissipate(tuple(calls), start, dt / steps, steps, self._losses(which))

    def _losses(self, which: Array) -> Dissipation:
        """Damping and friction of runs (b,), all with friction of their actuators or all without it."""
        step = self._single._dissipative
        return step.of_runs(step.friction.limits_of_runs(self._friction[which]))

    def _alone(self, run: int, move: Callable[[], object]) -> None:
        """Let the single plant take the place of a run for a call; the run fails if the call raises an error."""
        self._single.rollback(self.checkpoint(run))
        try:
            move()
        except Exception as error:  # the other runs go on
            self.errors[run], self.failed[run] = error, True
            return
        self._take(run, self._single.checkpoint())

    # ------------------------------------------------------------------ quantities

    @property
    def integrals(self) -> Float[Array, "B r"]:
        """Integrals of the reducing velocities since the start, (B, r)."""
        return self._single._dynamics.integrals(self._y)

    @property
    def work(self) -> Float[Array, " B"]:
        """Work (B,) of actuators and rheonomic constraints, minus the dissipation of damping and friction [J]."""
        return self._y[:, -1].copy()

    @property
    def external(self) -> Float[Array, "B nv"] | None:
        """Current generalized forces (B, nv) of damping and friction, NaN of failed runs; None without them."""
        if not self._dissipate(slice(None)):
            return None
        self._locate()
        damping, forces = self._single.damping, np.where(self.failed[:, None], np.nan, 0.0 * self._v)
        if damping is not None:
            forces -= damping * self._v
        for rubs in (True, False):
            which = np.flatnonzero(~self.failed & ((self._friction > 0.0) == rubs))
            losses = self._losses(which)
            if not losses.limits.size:
                continue
            start = RunStarts(*(each[which] for each in (self._q, self._y, self.applied, self._kinematics)))
            found, status = self._runs.friction(tuple(self._chart_calls[run] for run in which), start, INSTANT, losses)
            forces[which[status == 1.0]] += found[status == 1.0]
            for run in which[status != 1.0].tolist():
                self._single.rollback(self.checkpoint(run))
                forces[run] = self._single.external
        return forces

    def _dissipate(self, which: Array | slice) -> bool:
        """True if damping or friction is active in some runs."""
        dry = len(self._single._dissipative.friction.entries) > 0 or bool(self._friction[which].any())
        return self._single.damping is not None or dry

    # ------------------------------------------------------------------ single runs

    def checkpoint(self, run: int) -> Checkpoint:
        """Return the state of one run; ``ReducedPlant.rollback`` continues from it to the bit."""
        chart = self._chart(run)
        q, y = self._q[run].copy(), self._y[run].copy()
        known = self._located and not self.failed[run]
        t = self._single._dynamics.time(y)
        state = self.reduced.evaluator.measured(q, self._v[run].copy(), t) if known else None
        applied, friction = self.applied[run].copy(), float(self._friction[run])
        return Checkpoint(q, y, state, applied, chart, self._errors.of_run(run), friction)

    def errors_of(self, run: int) -> IntegrationErrors:
        """Return the estimated errors of the integration of one run since its start."""
        return self._errors.of_run(run)

    @property
    def steps(self) -> Array:
        """Substeps (B,) of the last sample of each run."""
        return np.asarray(self._errors.used)

    models = None
    """Model of each run; None if all have ``reduced``."""

    @property
    def charts(self) -> list[VelocityChart]:
        """Chart of the velocities of each run."""
        return [self._chart(run) for run in range(self.size)]

    def _chart(self, run: int) -> VelocityChart:
        chart = self._charts[run]
        if chart is None:
            raise InputError(f"run {run} has not started: call reset")
        return chart

    def rollback(self, run: int, checkpoint: Checkpoint) -> None:
        """Continue one run from a ``checkpoint`` of it or of a ``ReducedPlant`` with the same options."""
        self._take(run, checkpoint)
        self.errors[run], self.failed[run], self._located = None, False, False

    def _take(self, run: int, checkpoint: Checkpoint) -> None:
        """Write the state of one run."""
        self._q[run], self._y[run], _, self.applied[run], chart, errors, self._friction[run] = checkpoint
        self._errors.write(run, errors)
        if chart is not self._charts[run]:
            self._charts[run], self._chart_calls[run] = chart, chart.evaluator.chart

    def keep(self, runs: Array) -> None:
        """Keep only these runs, by a mask (B,) or by indices."""
        which = np.arange(self.size)[runs]
        self.size = len(which)
        for name in ("_q", "_v", "_y", "applied", "_kinematics", "failed", "_friction"):
            setattr(self, name, getattr(self, name)[which])
        self._errors = self._errors.selected(which)
        self._charts = [self._charts[run] for run in which]
        self._chart_calls = [self._chart_calls[run] for run in which]
        self.errors = [self.errors[run] for run in which]

    def measure(self) -> tuple[StateEvaluation, Array]:
        """Return the states (B,) in the reduction of the model, and the mask (B,) of those that the kernel measures.

        A run outside the mask has failed, or needs the formulas of a single state; its quantities are undefined.

        Raises:
            InputError: ``measures`` is False.
        """
        if not self.measures:
            raise InputError("the compiled kernel cannot measure this model: measure one state at a time")
        self._locate()
        status = (~self.failed).astype(float)
        q, v = self._q.copy(), self._v.copy()
        self._records = self._runs.measure(q, v, self._kinematics, status)
        return self._runs.states(q, v, self._records), status == 1.0

    def state(self, states: StateEvaluation, run: int) -> StateEvaluation:
        """Return one of the states (B,) that ``measure`` returned last."""
        assert self._records is not None
        q, v = states.q[run].copy(), states.v[run].copy()
        return self._runs.states(q, v, self._records.of(run))

    # ------------------------------------------------------------------ velocities

    def _locate(self) -> None:
        """Bring velocities and kinematics of all runs up to date, in charts that are regular there."""
        if self._located:
            return
        if None in self._charts:
            self.checkpoint(self._charts.index(None))  # raises the error of a run that has not started
        self._v = np.full((self.size, self.reduced.n), np.nan)
        self._kinematics = np.empty((self.size, self._runs.kinematics_size))
        status = np.zeros(self.size)
        arrays = self._q, self._y, self._limit, self._kinematics, self._v, status
        self._runs.velocities(tuple(self._chart_calls), *arrays)
        for run in np.flatnonzero((status != 1.0) & ~self.failed).tolist():
            self._alone(run, lambda: self._single.state)
            if not self.failed[run]:
                self._v[run] = self._single.state.v
        self._located = True


def _rows(values: Array, count: int, size: int, name: str) -> Array:
    """Array (count, size) of one row for all, or of a row for each."""
    if values.shape not in ((size,), (count, size)):
        raise InputError(f"{name} has shape {values.shape}, expected ({size},) or ({count}, {size})")
    return np.array(np.broadcast_to(values, (count, size)))
