"""Plants of many runs side by side; each moves as a ``ReducedPlant`` of its own, to the bit."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy import ndarray as Array

from rnc_pin.array_shapes import Float
from rnc_pin.errors import InputError
from rnc_pin.model.cached_property import cached_property
from rnc_pin.model.input_validation import numbers_of
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.runs import NumPyRuns, RunRecords
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.plants.reduced.reduced_plant import Checkpoint, ReducedPlant
from rnc_pin.plants.reduced.velocity_chart import MAX_GROWTH, VelocityChart


class ReducedPlantBatch:
    """Plants of B runs of one model that advance in lock-step.

    Every run has the bits of a ``ReducedPlant`` with the same options. One call of the compiled kernel moves all runs.
    A run that the kernel cannot decide takes the path of the single plant. A run that fails keeps its last state and
    rests, and the others go on; ``reset`` restarts it.

    Args:
        reduced: reduced model.
        size: number of runs B.
        joint_damping, actuator_limits, joint_friction, substeps: as for ``ReducedPlant``.

    Attributes:
        applied: applied inputs (B, p).
        failed: mask (B,) of the runs that failed.
        measures: True if ``measure`` is possible.
        errors: error of each run that failed, None for the others.

    Raises:
        ConstraintError: as for ``ReducedPlant``.
        InputError: size or substeps is not a positive integer.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")], robot.joint_names[1:])
        >>> plants = rnc.plants.ReducedPlantBatch(system.reduce(), size=3)
        >>> plants.reset(robot.configuration({"joint_2": 1.0}), np.zeros(4))  # the same start for all runs
        >>> plants.apply([[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [np.inf, 0.0, 0.0]])
        >>> plants.advance(0.002)
        >>> plants.failed
        array([False, False,  True])
        >>> q, v = plants.read()
        >>> v[:, 1].round(4)
        array([0.    , 0.0028,    nan])
    """

    def __init__(
        self,
        reduced: ReducedModel,
        size: int,
        joint_damping: bool = False,
        actuator_limits: bool = False,
        joint_friction: bool = False,
        substeps: int = 1,
    ) -> None:
        if not isinstance(size, int | np.integer) or isinstance(size, bool) or size < 1:
            raise InputError(f"size of a ReducedPlantBatch has to be a positive integer, found {size!r}")
        self._single = ReducedPlant(reduced, joint_damping, actuator_limits, joint_friction, substeps)
        self.reduced, self.size = reduced, int(size)
        data = reduced.reduction_data
        self.measures = reduced.evaluator.measures and not data.affine and not data.rheonomic
        self._limit = 0.0
        self._q = np.full((self.size, reduced.robot.nq), np.nan)
        self._v = np.full((self.size, reduced.n), np.nan)
        self._y = np.zeros((self.size, 0))
        self.applied = np.zeros((self.size, reduced.p))
        self._charts: list[VelocityChart | None] = [None] * self.size
        self._kinematics = np.empty((self.size, self._runs.kinematics_size))
        self._records: RunRecords | None = None
        self._current = np.zeros(self.size, dtype=bool)  # runs whose ``_v`` and kinematics are those of the state
        self._known = np.zeros(self.size, dtype=bool)  # runs whose kinematics are in ``_kinematics``
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
        which = np.arange(self.size) if runs is None else np.arange(self.size)[np.asarray(runs)]
        q = _rows(numbers_of(q, "q"), len(which), self.reduced.robot.nq, "q")
        v = _rows(numbers_of(v, "v"), len(which), self.reduced.n, "v")
        charts: dict[bytes, VelocityChart] = {}  # runs with the same start share a chart
        for run, q_0, v_0 in zip(which.tolist(), q, v, strict=True):
            dynamics = self._single._dynamics
            y = dynamics.initial(q_0, v_0, charts.get(q_0.tobytes()))
            charts[q_0.tobytes()] = dynamics.chart
            self.rollback(run, Checkpoint(q_0, y, None, np.zeros(self.reduced.p), dynamics.chart))

    def read(self) -> tuple[Float[Array, "B nq"], Float[Array, "B nv"]]:
        """Return copies of configurations (B, nq) and velocities (B, nv), with NaN velocities of failed runs."""
        self._locate()
        return self._q.copy(), np.where(self.failed[:, None], np.nan, self._v)

    def apply(self, T: Float[Array, "B p"]) -> None:
        """Hold the inputs T (B, p), clipped to the actuator limits; ``applied`` has the result."""
        T = np.asarray(T, dtype=float)
        if T.shape != self.applied.shape:
            raise InputError(f"T has shape {T.shape}, expected {self.applied.shape}")
        self.applied = np.ascontiguousarray(self._single._dynamics.saturate(T))
        if self.applied is T:
            self.applied = T.copy()

    def advance(self, dt: float) -> None:
        """Integrate all runs that have not failed over a time dt [s]."""
        self._locate()
        single = self._single
        moving = np.flatnonzero(~self.failed)
        others = moving
        if len(moving) and not single._dissipative.needed:
            q, y, status = self._integrated(moving, dt / single.substeps, single.substeps)
            done = status == 1.0
            if self.reduced.assembly.size:
                for i in np.flatnonzero(done):
                    if np.isfinite(q[i]).all():
                        q[i] = single._dynamics.project(q[i].copy(), y[i].copy())
            self._q[moving[done]], self._y[moving[done]] = q[done], y[done]
            self._current[moving[done]] = False
            others = moving[~done]
        for run in others.tolist():
            self._advance_alone(run, dt)

    def _integrated(self, moving: Array, h: float, steps: int) -> tuple[Array, Array, Array]:
        """States (m, nq) and (m, s) of runs after equal steps, and the status (m,) of the kernel."""
        select = slice(None) if len(moving) == self.size else moving
        kinematics = self._kinematics[select] if self._known[select].all() else None
        arrays = self._q[select], self._y[select], self.applied[select]
        return self._runs.integrate(self._calls(moving), *arrays, h, steps, kinematics)

    def _advance_alone(self, run: int, dt: float) -> None:
        single = self._single
        single.rollback(self.checkpoint(run))
        try:
            single.advance(dt)
        except Exception as error:  # the other runs go on
            self._fail(run, error)
            return
        self.rollback(run, single.checkpoint())

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
        if not self._single._dissipative.needed:
            return None
        self._locate()
        forces = np.full(self._v.shape, np.nan)
        for run in np.flatnonzero(~self.failed).tolist():
            self._single.rollback(self.checkpoint(run))
            forces[run] = self._single.external
        return forces

    # ------------------------------------------------------------------ single runs

    def checkpoint(self, run: int) -> Checkpoint:
        """Return the state of one run; ``ReducedPlant.rollback`` continues from it to the bit."""
        chart = self._charts[run]
        if chart is None:
            raise InputError(f"run {run} has not started: call reset")
        q, y = self._q[run].copy(), self._y[run].copy()
        state = self._single._dynamics.measured(q, self._v[run].copy(), y) if self._current[run] else None
        return Checkpoint(q, y, state, self.applied[run].copy(), chart)

    def rollback(self, run: int, checkpoint: Checkpoint) -> None:
        """Continue one run from a ``checkpoint`` of it or of a ``ReducedPlant`` with the same options."""
        q, y, state, applied, chart = checkpoint
        if self._y.shape[1] != len(y):
            self._y = np.zeros((self.size, len(y)))
        self._limit = chart.evaluator.data.r + MAX_GROWTH
        self._q[run], self._y[run], self.applied[run] = q, y, applied
        if chart is not self._charts[run]:
            self._charts[run], self._chart_calls[run] = chart, chart.evaluator.chart
        self._known[run], self._current[run] = False, state is not None
        if state is not None:
            self._v[run] = state.v
        self.errors[run], self.failed[run] = None, False

    def keep(self, runs: Array) -> None:
        """Keep only these runs, by a mask (B,) or by indices."""
        which = np.arange(self.size)[runs]
        self.size = len(which)
        for name in ("_q", "_v", "_y", "applied", "_kinematics", "_current", "_known", "failed"):
            setattr(self, name, getattr(self, name)[which])
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
        unknown = np.flatnonzero(self._current & ~self._known).tolist()
        if unknown:
            self._kinematics = self._kinematics.copy()
        for run in unknown:
            self._runs.place(self._q[run], self._kinematics[run])
            self._known[run] = True
        status = (self._current & ~self.failed).astype(float)  # a run that failed may keep the state before
        q, v = self._q.copy(), self._v.copy()
        self._records = self._runs.measure(q, v, self._kinematics, status)
        return self._runs.states(q, v, self._records), status == 1.0

    def state(self, states: StateEvaluation, run: int) -> StateEvaluation:
        """Return one of the states (B,) that ``measure`` returned last."""
        assert self._records is not None
        q, v = states.q[run].copy(), states.v[run].copy()
        return self._runs.states(q, v, self._records.of(run))

    # ------------------------------------------------------------------ velocities

    def _calls(self, runs: Array) -> tuple[object, ...]:
        """``NumPyEvaluator.chart`` of the charts of some runs."""
        every = self._chart_calls
        return tuple(every) if len(runs) == self.size else tuple(every[run] for run in runs.tolist())

    def _locate(self) -> None:
        """Bring the velocities of all runs up to date, in charts that are regular there."""
        behind = np.flatnonzero(~self._current & ~self.failed)
        if not len(behind):
            return
        missing = behind
        if self._y.shape[1]:
            select = slice(None) if len(behind) == self.size else behind
            kinematics = np.empty((len(behind), self._runs.kinematics_size))
            v, status = np.empty((len(behind), self.reduced.n)), np.zeros(len(behind))
            arrays = self._q[select], self._y[select], self._limit, kinematics, v, status
            self._runs.velocities(self._calls(behind), *arrays)
            done = status == 1.0
            if len(behind) < self.size:
                whole = self._kinematics.copy()  # ``measure`` may have given the other away
                whole[behind] = kinematics
                kinematics = whole
            self._kinematics = kinematics
            self._v[behind[done]] = v[done]
            self._current[behind[done]], self._known[behind] = True, True
            missing = behind[~done]
        for run in missing.tolist():
            self._locate_alone(run)

    def _locate_alone(self, run: int) -> None:
        single, known = self._single, bool(self._known[run])
        single.rollback(self.checkpoint(run))
        try:
            _ = single.state
        except Exception as error:  # the other runs go on
            self._fail(run, error)
            return
        self.rollback(run, single.checkpoint())
        self._known[run] = known  # q is the same

    def _fail(self, run: int, error: Exception) -> None:
        self.errors[run], self.failed[run] = error, True


def _rows(values: Array, count: int, size: int, name: str) -> Array:
    """Array (count, size) of one row for all, or of a row for each."""
    if values.shape not in ((size,), (count, size)):
        raise InputError(f"{name} has shape {values.shape}, expected ({size},) or ({count}, {size})")
    return np.array(np.broadcast_to(values, (count, size)))
