"""Record of a run: its samples, and what the plant told beside them. ``derive`` makes the trajectory of it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import accumulate

import numpy as np
from numpy import ndarray as Array

from rnc_pin.control.controller import Command
from rnc_pin.errors import InputError
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.plants.plant import PlantReport

GOALS = ("v2_desired", "x1_desired", "x2_desired")
"""Arrays with the goals of a sample, NaN without one."""
_STATED = tuple(
    name
    for name, none in PlantReport._field_defaults.items()
    if isinstance(none, Mapping) and not name.endswith("_units")
)
"""Fields of a report with numbers by name: each is an array of the run."""
_OPTIONAL = ("estimates", "prediction_error", "v_measured", *_STATED)
_SILENT = PlantReport()
_BLOCK = 1000  # largest number of samples in a block
_ROOM = 16e6  # memory for the matrices of a block [bytes]


class Record:
    """Samples of a run, recorded one by one.

    Args:
        reduced: reduced model of the controller.
        capacity: expected number of samples; ``add`` makes room for more.
        carries: mask (r,) of the reducing outputs with a valid integral.
        report: what the plant tells at the start: contacts with friction, and forces that it states itself.

    Attributes:
        count: number of samples so far.
        contacts: names of the contacts whose friction is recorded.
        own_forces: of "normal_forces" and "contact_forces", units by name of the forces that the plant states itself.
        external: generalized forces (capacity, nv) in addition to the inputs; None without any.
    """

    def __init__(self, reduced: ReducedModel, capacity: int, carries: Array, report: PlantReport = _SILENT) -> None:
        self.reduced, self.carries, self.capacity, self.count = reduced, carries, capacity, 0
        self.contacts = tuple(report.friction_used)
        newtons = dict.fromkeys(report.normal_forces, "N")
        self.own_forces = {"normal_forces": newtons, "contact_forces": dict(report.contact_force_units)}
        k, r = reduced.vertical.size, reduced.r
        self._columns = {
            "time": 1, "work": 1, "q": reduced.robot.nq, "v": reduced.n, "v2": r, "x1": k, "x2": r, "v1": k,
            "T": reduced.p, "integrals": r, "v2_desired": r, "x1_desired": k, "x2_desired": r,
        }  # fmt: skip
        # One row for each sample, so that a sample is written at once.
        self.arrays = {name: np.zeros((capacity, 0)) for name in _OPTIONAL}
        self._use_rows(np.full((capacity, self.width), np.nan))
        self.arrays["integrals"][:] = 0.0
        self._no_goals = tuple(np.full(size, np.nan) for size in (r, k, r))
        self._models: list[tuple[int, ReducedModel | None]] = []  # first sample and plant model
        self.external: Array | None = None

    @property
    def width(self) -> int:
        """Numbers of a sample."""
        return sum(self._columns.values())

    def take(self, rows: Array) -> None:
        """Take the rows (N, ``width``) of samples that somebody else has recorded, of a plant with the same model.

        Args:
            rows: rows (N, ``width``), in the order of the columns.
        """
        self.capacity = self.count = len(rows)
        self.arrays = {name: np.zeros((len(rows), 0)) for name in _OPTIONAL}
        self._models = [(0, self.reduced)]
        self._use_rows(rows)

    def _use_rows(self, rows: Array) -> None:
        """Set the array of all samples; the arrays by name are views of it."""
        ends = dict(zip(self._columns, accumulate(self._columns.values()), strict=True))
        self._rows = rows
        self.arrays |= {name: rows[:, end - self._columns[name] : end] for name, end in ends.items()}
        # Series, where the others are matrices.
        self.arrays |= {name: self.arrays[name][:, 0] for name in ("time", "work")}

    def _grow(self) -> None:
        """Double the capacity. A run that a user ends has no known length."""
        more = self.capacity
        for name in _OPTIONAL:
            array = self.arrays[name]
            self.arrays[name] = np.concatenate([array, np.full((more, array.shape[1]), np.nan)])
        self._use_rows(np.concatenate([self._rows, np.full((more, self._rows.shape[1]), np.nan)]))
        if self.external is not None:
            self.external = np.concatenate([self.external, np.zeros((more, self.reduced.n))])
        self.capacity += more

    def _moves(self, model: ReducedModel | None, external: Array | None) -> None:
        """Set the plant model of the next samples, and the external forces (nv,) of the next one."""
        if self.count == self.capacity:
            self._grow()
        if not self._models or self._models[-1][1] is not model:
            # Models are kept by their first sample: derived quantities of a stretch are evaluated together.
            self._models.append((self.count, model))
        if external is not None:
            if self.external is None:
                # Zero before: a plant may begin to report forces in the middle of a run.
                self.external = np.zeros((self.capacity, self.reduced.n))
            self.external[self.count] = external

    def add(
        self,
        t: float,
        state: StateEvaluation,
        integrals: Array,
        command: Command,
        T: Array,
        report: PlantReport,
        outputs: tuple[Array, Array] | None = None,
        v_measured: Array | None = None,
    ) -> None:
        """Add one sample.

        Args:
            t: time [s].
            state: true state in the outputs of the controller's model.
            integrals: integrals (r,) of the reducing velocities.
            command: command of the controller, with its goals.
            T: applied inputs (p,).
            report: what the plant tells after they are applied.
            outputs: x1 and x2 of the state, if they are known.
            v_measured: measured velocity (nv,); None or empty if measurements are exact.

        Raises:
            InputError: a goal or an estimate of the command has another shape than before.
        """
        self._moves(report.reduced, report.external)
        # After ``_moves``, which may have made room in new arrays.
        row, given = self._rows[self.count], (command.v2_desired, command.x1_desired, command.x2_desired)
        goals = [
            none if goal is None else _expect(name, goal, none.shape)
            for name, goal, none in zip(GOALS, given, self._no_goals, strict=True)
        ]
        x1, x2 = state.outputs(integrals) if outputs is None else outputs
        # One call for all columns: samples are recorded while the loop waits.
        row[0], row[1] = t, report.work
        np.concatenate((state.q, state.v, state.v2, x1, x2, state.v1, T, integrals, *goals), out=row[2:])
        # None for an empty list: to ask NumPy for four sizes takes as long as recording the rest.
        stated = [[*getattr(report, name).values()] or None for name in _STATED]
        optional = command.estimates, command.prediction_error, v_measured, *stated
        for name, value in zip(_OPTIONAL, optional, strict=True):
            # Most plants and controllers tell nothing here: their runs have arrays without columns.
            if value is None or not np.size(value):
                continue
            if not self.arrays[name].shape[1]:  # the first sample that has it: those before have NaN
                self.arrays[name] = np.full((self.capacity, np.size(value)), np.nan)
            self.arrays[name][self.count] = _expect(name, value, self.arrays[name].shape[1:])
        self.count += 1

    @property
    def signals(self) -> dict[str, Array]:
        """Contiguous arrays (N, ...) of the samples so far, by name."""
        return {name: np.ascontiguousarray(array[: self.count]) for name, array in self.arrays.items()}

    @property
    def plant_models(self) -> list[ReducedModel]:
        """Known models of the plant, in the order of their first samples."""
        return list(dict.fromkeys(model for _, model in self._models if model is not None))

    def stretches(self) -> Iterator[tuple[int, int, ReducedModel]]:
        """Yield first sample, end and model of each interval with one plant; the controller's model for an unknown."""
        # A run that ended before its first sample has no model of a plant.
        told = self._models or [(0, None)]
        ends = [start for start, _ in told[1:]] + [self.count]
        for (start, model), end in zip(told, ends, strict=True):
            if start < end:
                yield start, end, self.reduced if model is None else model


def _expect(name: str, value: Array | list[float], shape: tuple[int, ...]) -> Array:
    """Return a value of a command with this shape; raise an error for another one."""
    value = np.asarray(value)
    if value.shape != shape:
        raise InputError(f"{name} of a command has shape {value.shape}, expected {shape}")
    return value


def blocks(samples: int, numbers: int) -> Iterator[slice]:
    """Yield blocks of samples, so that memory does not grow with the length of the run.

    Args:
        samples: number of samples.
        numbers: temporary numbers per sample.
    """
    # One sample at least, however large its matrices are.
    length = max(1, min(_BLOCK, int(_ROOM / (8 * max(numbers, 1)))))
    for start in range(0, samples, length):
        yield slice(start, min(start + length, samples))
