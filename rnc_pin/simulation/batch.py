"""Runs of one controller from many initial states, in one call for all where a sample is regular.

The runs move together: each formula of a sample is evaluated once, with a leading axis for the runs. A run that meets
anything else (a singular state, a stop condition, an error) leaves the batch, and is computed again from its start,
alone. Runs whose plant or controller does not fit are computed alone too. So every run ends as a run alone does.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import cast

import numpy as np
from numpy import ndarray as Array

from rnc_pin.control.basic_controllers import ComputedTorque, ReducingOutputController, ZeroInput
from rnc_pin.control.controller import Command, State
from rnc_pin.control.redundancy import RedundancyController
from rnc_pin.control.trackers import PositionTracker, VelocityTracker
from rnc_pin.errors import InputError, RncError
from rnc_pin.interruption import interruptible, uninterrupted
from rnc_pin.math.linear_algebra import apply
from rnc_pin.model.input_validation import numbers_of
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.plants import ReducedPlant
from rnc_pin.plants.constrained_dynamics import MAX_GROWTH
from rnc_pin.plants.plant import IntegrationErrors
from rnc_pin.plants.reduced_plant import Checkpoint
from rnc_pin.simulation.run_data import Trajectory
from rnc_pin.simulation.run_info import Outcome
from rnc_pin.simulation.sampled_run import SampledRun, complete_run
from rnc_pin.simulation.simulation_options import RunArguments, check_arguments


def simulate_batch(arguments: RunArguments) -> list[Trajectory]:
    """Return a run for each initial state.

    Args:
        arguments: arguments of all runs, with a row for each run of q0, of v2_0 or of both.

    Raises:
        InputError: q0 and v2_0 have different numbers of rows, or none.
        ConfigurationError: as ``simulate``.
        RncError: a run cannot start; the message has its number.
    """
    check_arguments(arguments)
    runs = _arguments_of_runs(arguments)
    plant = _common_plant(arguments)
    found = {} if plant is None else _Batch(runs, plant).trajectories()
    for number, run in enumerate(runs):
        if number not in found:
            # After Ctrl-C the runs that are left over do not begin: they end as interrupted, too.
            interrupted = any(each.outcome is Outcome.INTERRUPTED for each in found.values())
            found[number] = _alone(_started(number, run), 0 if interrupted else run.samples)
    return [found[number] for number in range(len(runs))]


def _arguments_of_runs(arguments: RunArguments) -> list[RunArguments]:
    """Arguments of each run."""
    q0, r = numbers_of(arguments.q0, "q0"), arguments.reduced.r
    v2_0 = np.zeros(r) if arguments.v2_0 is None else numbers_of(arguments.v2_0, "v2_0")
    counts = {len(each) for each in (q0, v2_0) if each.ndim == 2}
    if max(q0.ndim, v2_0.ndim) != 2 or len(counts) != 1 or counts == {0}:
        raise InputError(f"q0 has shape {q0.shape} and v2_0 {v2_0.shape}, expected one row for each run")
    (count,) = counts
    # Copies: rows of a broadcast array share their memory, and nobody can write into them.
    q0, v2_0 = (np.array(np.broadcast_to(each, (count, each.shape[-1]))) for each in (q0, v2_0))
    return [arguments._replace(q0=q, v2_0=v2) for q, v2 in zip(q0, v2_0, strict=True)]


def _started(number: int, run: RunArguments) -> SampledRun:
    with RncError.at(f"run {number}"):
        return SampledRun(run)


def _alone(run: SampledRun, samples: int) -> Trajectory:
    """A run of its own, also if it ends early."""
    if not samples:
        return run.finish(Outcome.INTERRUPTED)
    try:
        return complete_run(lambda progress: run.run_to(samples, progress), run.finish)
    except RncError as error:
        if not isinstance(error.trajectory, Trajectory):
            raise
        return error.trajectory


def _common_plant(arguments: RunArguments) -> ReducedPlant | None:
    """Plant whose motions can be computed together; None if runs have to be alone."""
    reduced, plant, options = arguments.reduced, arguments.plant, arguments.options
    data, special = reduced.reduction_data, (options.observer, options.stop.lift_off, options.loop)
    # An observer and options of a loop belong to single samples, and lift-off is sought inside them.
    if any(special) or options.controller_state is not None or not _takes_rows(arguments.controller):
        return None
    # The calls for many runs know no time, no right-hand side mu and no projection on holonomic rows.
    if not reduced.evaluator.measures or data.rheonomic or data.affine or reduced.assembly.size:
        return None
    moving = ReducedPlant(reduced) if plant is None else plant
    # The class itself: a subclass may move in a way of its own.
    fits = type(moving) is ReducedPlant and moving.reduced is reduced and not moving.dissipates
    return moving if isinstance(moving, ReducedPlant) and fits else None


def _takes_rows(controller: object) -> bool:
    """True if the formulas of a controller take a leading axis."""
    # Kinds and not isinstance: a subclass may have a step that takes one state only.
    kind = type(controller)
    if isinstance(controller, VelocityTracker | ComputedTorque):
        return kind in (VelocityTracker, ComputedTorque) and _takes_rows(controller.target)
    if isinstance(controller, RedundancyController):
        return kind is RedundancyController and controller.secondary is None
    return kind in (PositionTracker, ReducingOutputController, ZeroInput)


class _Batch:
    """Runs that move together, with arrays (B, ...) of those that are still regular.

    Args:
        arguments: arguments of each run; only their initial states differ.
        plant: plant with the options of all; it does not move.
    """

    def __init__(self, arguments: Sequence[RunArguments], plant: ReducedPlant) -> None:
        self._reduced, self._controller, _, self._dt, self._samples, *_ = arguments[0]
        # A plant for each run: a run that needs a comparison or another chart takes that step alone.
        self._plants = [plant.twin() for _ in arguments]
        self._runs = [
            _started(number, run._replace(plant=own))
            for number, (run, own) in enumerate(zip(arguments, self._plants, strict=True))
        ]
        kernel = self._reduced.evaluator.kernel
        assert kernel is not None  # see _common_plant
        self._kernel, self._count = kernel, 0
        # One array for all runs and samples: a sample is written in one assignment.
        self._rows = np.empty((len(arguments), self._samples, self._runs[0].record.width))
        starts = [own.checkpoint() for own in self._plants]
        self._at = np.arange(len(arguments))  # numbers of the runs that are still regular
        self._q, self._y = (np.array([start[k] for start in starts]) for k in (0, 1))
        self._T = np.zeros((len(arguments), self._reduced.p))
        # The kernel takes a chart of its own for each run: they end at different times.
        self._charts = np.array([_chart(own) for own in self._plants], dtype=object)
        self._errors = tuple(np.array(each) for each in zip(*(start.errors for start in starts), strict=True))
        self._kinematics = np.empty((len(arguments), kernel.kinematics.itemsize // 8))
        self._deficit: Array | None = None
        self._state: State = None

    def trajectories(self) -> dict[int, Trajectory]:
        """Return the runs that are regular to their end, or until Ctrl-C, by their numbers."""
        outcome = Outcome.COMPLETED
        with uninterrupted():
            try:
                with interruptible():
                    self._advance()
            except KeyboardInterrupt:
                outcome = Outcome.INTERRUPTED
            found = {}
            for place, number in enumerate(self._at.tolist()):
                self._restored(place)
                self._runs[number].record.take(self._rows[number, : self._count])
                found[number] = self._runs[number].finish(outcome)
            return found

    def _advance(self) -> None:
        for sample in range(self._samples):
            try:
                self._sample(sample)
            except Exception:  # of a run that is not known: alone it ends with this error
                self._keep(np.zeros(len(self._at), dtype=bool))
            if not len(self._at):
                return
            self._count = sample + 1
            if self._count < self._samples:
                self._move()

    # ------------------------------------------------------------------ a sample

    def _sample(self, sample: int) -> None:
        """Measure, compute the inputs, and record."""
        # Runs that leave do so here, before the controller sees their states.
        states = self._measured()
        t, integrals = sample * self._dt, self._plants[0].dynamics.integrals(self._y)
        measurement = states.measure(integrals)
        # As a loop tells it: the controller learns what the limits took from its last inputs.
        if self._deficit is not None:
            force = apply(states.input_matrix, self._deficit)
            measurement = measurement._replace(input_deficit=self._deficit, force_deficit=force)
        if not sample:
            self._state = self._controller.initial_state(measurement)
        command, self._state = self._controller.step(t, measurement, self._state)
        # A command without a state, such as zero inputs, is one for all runs.
        requested = states.allocate(command.F) if command.T is None else np.tile(command.T, (len(self._at), 1))
        # All twins have the same limits, so the first one clips for all.
        self._T = np.ascontiguousarray(self._plants[0].dynamics.saturate(requested))
        # None where nothing is missing, as of a loop: the controller integrates as usual.
        self._deficit = None if (requested == self._T).all() else requested - self._T
        self._record(sample, states, command, (measurement.x1, measurement.x2, integrals))

    def _measured(self) -> StateEvaluation:
        """States of the runs; those that are not regular leave."""
        v, sizes, calls = np.zeros((len(self._at), self._reduced.n)), np.empty(len(self._at)), self._kernel.calls
        calls.admissible_velocities(tuple(self._charts), self._q, self._y, None, self._kinematics, v, sizes)
        # The bound of ``VelocityChart.velocity``, so that charts change where those of a run alone do. False for NaN.
        regular = (sizes < self._reduced.r + MAX_GROWTH).astype(float)
        for place in np.flatnonzero(regular != 1.0).tolist():
            if self._single(place, lambda plant: plant.state):  # in another chart
                regular[place], v[place] = 1.0, self._plants[self._at[place]].state.v
        # The states keep their configurations, while those of the runs go on.
        q = self._q.copy()
        # Only regular runs are measured; a run whose state the kernel leaves to NumPy is none afterwards.
        states = self._reduced.evaluator.measured_states(q, v, regular, kinematics=self._kinematics)
        regular[self._runs[0].stop.stopped(states)] = 0.0
        if (regular == 1.0).all():
            return states
        # Rare, so the runs that stay are simply measured again.
        self._keep(regular == 1.0)
        return self._measured()

    def _record(self, sample: int, states: StateEvaluation, command: Command, known: tuple[Array, ...]) -> None:
        x1, x2, integrals = known
        given = (command.v2_desired, states.v2), (command.x1_desired, x1), (command.x2_desired, x2)
        # NaN without a goal, as in the record of a run alone.
        goals = [
            np.full(like.shape, np.nan) if goal is None else np.broadcast_to(goal, like.shape) for goal, like in given
        ]
        time = np.full((len(self._at), 1), sample * self._dt)
        columns = time, self._y[:, -1:], states.q, states.v, states.v2, x1, x2, states.v1, self._T, integrals, *goals
        self._rows[self._at, sample] = np.concatenate(columns, axis=1)

    # ------------------------------------------------------------------ motion

    def _move(self) -> None:
        """Advance all runs to the next sample; a run whose step has to be compared takes it alone."""
        alone = np.ones(len(self._at), dtype=bool)
        steps_of_runs = self._errors[0]
        # Each run chooses its own number of substeps by its errors; those with equal numbers share a call.
        for steps in np.unique(steps_of_runs).tolist():
            which = np.flatnonzero(steps_of_runs == steps)
            charts = tuple(self._charts[which])
            q, y, T, kinematics = (each[which] for each in (self._q, self._y, self._T, self._kinematics))
            ends, status, rough = (np.empty_like(q), np.empty_like(y)), np.zeros(len(q)), np.zeros(len(q))
            numbers = kinematics, *ends, status, rough, *[None] * 4  # neither rates over time, nor damping or friction
            self._kernel.calls.integrate(charts, q, y, T, self._dt / steps, steps, *numbers)
            # The rule of ``ReducedPlant.advance``: a run beside others takes the steps of a run alone.
            before = IntegrationErrors._make(each[which] for each in self._errors)
            accepted, after = before.after(cast(float, rough), self._dt, self._plants[0].followed * self._dt)
            good = np.asarray(accepted) & (status == 1.0)
            alone[which[good]] = False
            known = (*ends, *cast("tuple[Array, ...]", after))
            for all_runs, some in zip((self._q, self._y, *self._errors), known, strict=True):
                all_runs[which[good]] = some[good]
        moved = np.ones(len(self._at), dtype=bool)
        for place in np.flatnonzero(alone).tolist():
            moved[place] = self._single(place, lambda plant: plant.advance(self._dt))
        self._keep(moved)

    def _single(self, place: int, move: Callable[[ReducedPlant], object]) -> bool:
        """Let the plant of a run take its place for a call; False if the call fails."""
        plant = self._restored(place)
        try:
            move(plant)
        except RncError:  # alone it raises the same error
            return False
        self._q[place], self._y[place], _, _, _, errors = plant.checkpoint()
        self._charts[place] = _chart(plant)
        # A comparison may have changed the number of substeps: the batch goes on with it.
        for all_runs, own in zip(self._errors, errors, strict=True):
            all_runs[place] = own
        return True

    def _restored(self, place: int) -> ReducedPlant:
        """Plant of a run in its present state."""
        plant = self._plants[self._at[place]]
        errors = IntegrationErrors._make(each[place].item() for each in self._errors)
        # Copies, and no evaluated state: the batch goes on writing into its arrays.
        now = self._q[place].copy(), self._y[place].copy(), None, self._T[place].copy()
        plant.rollback(Checkpoint(*now, plant.dynamics.chart, errors))
        return plant

    def _keep(self, staying: Array) -> None:
        """Keep only the runs of a mask (B,)."""
        if staying.all():
            return
        motion = self._at, self._q, self._y, self._T, self._kinematics, self._charts, self._errors
        motion, self._deficit, self._state = _rows((motion, self._deficit, self._state), staying)
        self._at, self._q, self._y, self._T, self._kinematics, self._charts, self._errors = motion


def _chart(plant: ReducedPlant) -> object:
    """Chart of a plant for the kernel; None if the kernel cannot use it."""
    kernel = plant.dynamics.chart.evaluator.kernel
    return None if kernel is None else kernel.calls


def _rows(values: State, which: Array) -> State:
    """Some rows of each array in nested tuples."""
    if isinstance(values, np.ndarray):
        return values[which]
    if isinstance(values, tuple):
        parts = [_rows(each, which) for each in values]
        return values._make(parts) if hasattr(values, "_make") else tuple(parts)
    return values
