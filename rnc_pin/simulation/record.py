"""Recorder of a run: samples are stored one by one, derived quantities are computed at the end in blocks."""

from __future__ import annotations

import platform
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import accumulate

import numpy as np
import pinocchio as pin
from numpy import ndarray as Array

from rnc_pin.analysis import NormalForces
from rnc_pin.control.controller import Command
from rnc_pin.control.loop.loop_state import LateTicks
from rnc_pin.errors import InputError
from rnc_pin.model.cached_property import once_per_model
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.rows import OutputStack
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.simulation import run_info
from rnc_pin.simulation.derived_quantities import MATRICES, DerivedQuantities, RowNames, blocks
from rnc_pin.simulation.ground_bodies import GroundBody, ground_bodies
from rnc_pin.simulation.judgement import judged_by
from rnc_pin.simulation.trajectory import Trajectory
from rnc_pin.verdict import Finding
from rnc_pin.version import __version__

_GOALS = ("v2_desired", "x1_desired", "x2_desired")
_OWN_FORCES = ("normal_forces", "contact_forces")  # a plant may state them itself
_OPTIONAL = ("estimates", "prediction_error", "v_measured", "friction_used", "slip_speed", *_OWN_FORCES)


class Record:
    """Recorder of a run.

    Args:
        reduced: reduced model.
        capacity: expected number of samples; ``moves`` and ``add`` make room for more.
        carries: mask (r,) of the reducing outputs with a valid integral.
        contacts: names of the contacts whose friction is recorded.
    """

    def __init__(self, reduced: ReducedModel, capacity: int, carries: Array, contacts: tuple[str, ...] = ()) -> None:
        self.reduced, self.capacity, self.count, self._contacts = reduced, capacity, 0, contacts
        self._versions = versions()  # before the run, so that an error here loses no results
        k, r = reduced.vertical.size, reduced.r
        columns = {
            "time": 1, "work": 1, "q": reduced.robot.nq, "v": reduced.n, "v2": r, "x1": k, "x2": r, "v1": k,
            "T": reduced.p, "integrals": r, "v2_desired": r, "x1_desired": k, "x2_desired": r,
        }  # fmt: skip
        self._columns = columns
        # One row for each sample, so that a sample is written at once.
        self.arrays = {name: np.zeros((capacity, 0)) for name in _OPTIONAL}
        self._use_rows(np.full((capacity, self.width), np.nan))
        self._integrals[:] = 0.0
        self._no_goals = tuple(np.full(size, np.nan) for size in (r, k, r))
        self._carries = carries
        self._models: list[tuple[int, ReducedModel | None]] = []  # first sample and plant model
        self._external: Array | None = None
        self._normal: NormalForces | None = None
        self.phases: tuple[run_info.PhaseInfo, ...] = ()
        """Intervals with one set of constraints, of a plant whose contacts open and close."""
        self.fallback: run_info.FallbackUse | None = None
        """Use of fallback commands by the control loop."""
        self.findings: tuple[Finding, ...] = ()
        """Findings of the controller about its own steps."""
        self.integration: run_info.IntegrationAccuracy | None = None
        """Estimated errors of the integration."""
        self.late: LateTicks | None = None
        """Samples whose computation took longer than the sampling period."""
        self.own_force_units: dict[str, dict[str, str]] = {}
        """Units by name of the forces that the plant states itself, for each kind."""

    @property
    def width(self) -> int:
        """Numbers of a sample."""
        return sum(self._columns.values())

    def take(self, rows: Array) -> None:
        """Take the rows (N, ``width``) of samples that somebody else has recorded, of a plant with the same model."""
        self.capacity = self.count = len(rows)
        self.arrays = {name: np.zeros((len(rows), 0)) for name in _OPTIONAL}
        self._models = [(0, self.reduced)]
        self._use_rows(rows)

    def _use_rows(self, rows: Array) -> None:
        """Set the array of all samples; the arrays by name are views of it."""
        ends = dict(zip(self._columns, accumulate(self._columns.values()), strict=True))
        self._rows = rows
        self.arrays |= {name: rows[:, end - self._columns[name] : end] for name, end in ends.items()}
        self.arrays |= {name: self.arrays[name][:, 0] for name in ("time", "work")}
        self._integrals = self.arrays.pop("integrals")

    def _grow(self) -> None:
        """Double the capacity. A run that a user ends has no known length."""
        more = self.capacity
        for name in _OPTIONAL:
            array = self.arrays[name]
            self.arrays[name] = np.concatenate([array, np.full((more, array.shape[1]), np.nan)])
        self._use_rows(np.concatenate([self._rows, np.full((more, self._rows.shape[1]), np.nan)]))
        if self._external is not None:
            self._external = np.concatenate([self._external, np.zeros((more, self.reduced.n))])
        self.capacity += more

    def moves(self, model: ReducedModel | None, external: Array | None) -> None:
        """Set the plant model of the next samples, and external forces of the next sample or samples.

        Args:
            model: reduced model of the plant; None if it is unknown. The controller's model then replaces it.
            external: generalized forces (nv,) or (count, nv) in addition to the inputs, if any.
        """
        if self.count == self.capacity:
            self._grow()
        if not self._models or self._models[-1][1] is not model:
            self._models.append((self.count, model))
        if external is not None:
            if self._external is None:
                self._external = np.zeros((self.capacity, self.reduced.n))
            self._external[self.count : self.count + len(np.atleast_2d(external))] = external

    def add(
        self,
        t: float,
        state: StateEvaluation,
        integrals: Array,
        command: Command,
        T: Array,
        work: float,
        outputs: tuple[Array, Array] | None = None,
        sensed: tuple[Array, ...] = (),
    ) -> None:
        """Add one sample, after ``moves``.

        ``outputs`` are x1 and x2, if known; ``sensed`` is what the plant states itself.
        """
        row, given = self._rows[self.count], (command.v2_desired, command.x1_desired, command.x2_desired)
        goals = [
            none if goal is None else _expect(name, goal, none.shape)
            for name, goal, none in zip(_GOALS, given, self._no_goals, strict=True)
        ]
        x1, x2 = state.outputs(integrals) if outputs is None else outputs
        row[0], row[1] = t, work
        np.concatenate((state.q, state.v, state.v2, x1, x2, state.v1, T, integrals, *goals), out=row[2:])
        self.add_optional(command.estimates, command.prediction_error, *sensed)
        self.count += 1

    def add_optional(self, *values: Array | None) -> None:
        """Add arrays of the next sample that not every run has, in the order of their names; None or empty without."""
        for name, value in zip(_OPTIONAL, values, strict=False):
            if value is None or not np.size(value):
                continue
            if not self.arrays[name].shape[1]:
                self.arrays[name] = np.full((self.capacity, np.size(value)), np.nan)
            self.arrays[name][self.count] = _expect(name, value, self.arrays[name].shape[1:])

    def extend(self, times: Array, states: StateEvaluation, integrals: Array, T: Array, work: Array) -> None:
        """Add samples (count,) without goals, all under the inputs T (p,)."""
        block = slice(self.count, self.count + len(times))
        x1, x2 = states.outputs(integrals)
        values = {
            "time": times, "q": states.q, "v": states.v, "v2": states.v2, "T": T, "work": work, "x1": x1, "x2": x2,
            "v1": states.v1,
        }  # fmt: skip
        for name, value in values.items():
            self.arrays[name][block] = value
        self._integrals[block] = integrals
        self.count += len(times)

    def finish(
        self,
        dt: float,
        provenance: run_info.Provenance,
        outcome: run_info.Outcome = run_info.Outcome.COMPLETED,
        message: str | None = None,
    ) -> Trajectory:
        """Return the trajectory.

        Args:
            dt: sampling period [s].
            provenance: origin of the run.
            outcome: outcome of the run.
            message: reason of an early end, if any.
        """
        reduced = self.reduced
        a = {name: np.ascontiguousarray(array[: self.count]) for name, array in self.arrays.items()}
        own_forces = {kind: a.pop(kind) for kind in _OWN_FORCES}
        own_forces = {kind: array for kind, array in own_forces.items() if self.own_force_units.get(kind)}
        x1, x2 = reduced.vertical.coordinates, reduced.reducing.coordinates
        a["x1"] = x1.unwrap(a["x1"], _integrated(a["x1"], a["v1"], a["time"]))
        about = _integrated(a["x2"], a["v2"], a["time"])
        about[:, self._carries] = (a["x2"][:1] + self._integrals[: self.count])[:, self._carries]
        a["x2"] = x2.unwrap(a["x2"], about)
        bodies = ground_bodies(reduced)
        given = np.concatenate([a[name] for name in _GOALS], axis=1)
        first = int(np.argmax(~np.isnan(given).all(axis=1))) if len(given) else 0  # with a valid measurement
        goals = tuple(
            name
            for kind, outputs in (("x1", reduced.vertical), ("x2", reduced.reducing))
            for name, column in zip(outputs.names, a[f"{kind}_desired"].T, strict=True)
            if not np.isnan(column[first:]).any()
        )
        _fill_desired(a["x2_desired"], a["v2_desired"], a["x2"], dt)
        rows, own = self._row_names(), [output_names(model) for model in self._plant_models()]
        units: dict[str, str] = {}
        for each in own:
            units |= zip(each.contact_forces, each.contact_forces_units, strict=True)
        forces = {"contact_forces": rows.contact_forces, "normal_forces": rows.normal_forces}
        for kind in own_forces:
            forces[kind] = tuple(self.own_force_units[kind])
            units |= self.own_force_units[kind]
        info = run_info.RunInfo(
            replace(
                own[0],
                multipliers=rows.multipliers,
                multipliers_units=tuple(units[name] for name in rows.multipliers),
                contact_forces_units=tuple(units[name] for name in forces["contact_forces"]),
                friction_used=self._contacts,
                ground_poses=tuple(body.name for body in bodies),
                contact_forces=forces["contact_forces"],
                normal_forces=forces["normal_forces"],
            ),
            goals,
            dt,
            self._versions,
            provenance,
            outcome,
            message,
            self.phases,
            self.fallback,
            self.findings,
            self.integration,
            late=self.late,
        )
        derived = self._derived(a["time"], a["q"], a["v"], a["T"], bodies) | own_forces
        return judged_by(Trajectory(**a, **derived, info=info), reduced)

    def _derived(self, t: Array, q: Array, v: Array, T: Array, bodies: Sequence[GroundBody]) -> dict[str, Array]:
        reduced, rows = self.reduced, self._row_names()
        quantities = DerivedQuantities(reduced, rows, bodies)
        derived = quantities.empty(len(q))
        for start, end, plant in self._stretches(len(q)):
            own = self._normal if plant is reduced else None
            normal = (own or NormalForces(plant)) if rows.normal_forces else None
            for inner in blocks(end - start, MATRICES * reduced.n**2):
                block = slice(start + inner.start, start + inner.stop)
                external = None if self._external is None else self._external[block]
                found = quantities.of(plant, normal, t[block], q[block], v[block], T[block], external)
                for name, values in found.items():
                    derived[name][block] = values
        return derived

    def _row_names(self) -> RowNames:
        """Rows with forces: those of the controller's model, or of all models of a plant whose contacts switch."""
        models = self._plant_models() if self.phases else [self.reduced]
        kept, every = (
            tuple(dict.fromkeys(name for stack in stacks for name in stack.names))
            for stacks in ([model.constraints for model in models], [model.all_constraints for model in models])
        )
        return RowNames(kept, every, self._normal_names(), switching=bool(self.phases))

    def _plant_models(self) -> list[ReducedModel]:
        """Controller's model and models of the plant, in the order of their first samples."""
        return [self.reduced, *dict.fromkeys(model for _, model in self._models if model is not None)]

    def _normal_names(self) -> tuple[str, ...]:
        """Names of the contacts with known normal forces; empty if the plant is not a reduced model."""
        if not any(model is not None for _, model in self._models):
            return ()
        if self.phases:
            return tuple(dict.fromkeys(name for each in self._plant_models() for name in NormalForces(each).names))
        if self._normal is None:
            self._normal = NormalForces(self.reduced)
        return self._normal.names

    def _stretches(self, samples: int) -> Iterator[tuple[int, int, ReducedModel]]:
        """Yield first sample, end and plant model of each interval with one plant model."""
        told = self._models or [(0, None)]
        ends = [start for start, _ in told[1:]] + [samples]
        for (start, model), end in zip(told, ends, strict=True):
            if start < end:
                yield start, end, self.reduced if model is None else model


def _expect(name: str, value: Array, shape: tuple[int, ...]) -> Array:
    """Return a value of a command with this shape; raise an error for another one."""
    value = np.asarray(value)
    if value.shape != shape:
        raise InputError(f"{name} of a command has shape {value.shape}, expected {shape}")
    return value


def _integrated(values: Array, rates: Array, time: Array) -> Array:
    """First values plus the integral of the rates (N, k), by the trapezoidal rule."""
    whole = np.empty_like(values)
    whole[:1] = 0.0
    for block in blocks(len(values) - 1, 4 * values.shape[1]):
        after = slice(block.start + 1, block.stop + 1)
        steps = 0.5 * np.diff(time[block.start : block.stop + 1])[:, None] * (rates[after] + rates[block])
        steps[0] += whole[block.start]
        np.cumsum(steps, axis=0, out=whole[after])
    whole += values[:1]
    return whole


def _fill_desired(x2_desired: Array, v2_desired: Array, x2: Array, dt: float) -> None:
    """Fill missing desired outputs with the integral of their desired rates (trapezoidal rule)."""
    if not len(x2):
        return
    columns = np.isnan(x2_desired).all(axis=0) & ~np.isnan(v2_desired).any(axis=0)
    for column in np.flatnonzero(columns):
        rates, start = v2_desired[:, column], x2[0, column]
        x2_desired[0, column] = start
        x2_desired[1:, column] = start + np.cumsum(0.5 * dt * (rates[1:] + rates[:-1]))


@once_per_model
def output_names(reduced: ReducedModel) -> run_info.OutputNames:
    """Names, units and coordinate types of the columns in runs of a model."""
    return run_info.OutputNames(
        x1=columns_of(reduced.vertical),
        x2=columns_of(reduced.reducing),
        T=tuple(reduced.actuation.names),
        T_units=tuple(reduced.actuation.units),
        multipliers=tuple(reduced.constraints.names),
        contact_forces=tuple(reduced.all_constraints.names),
        v=tuple(reduced.robot.velocity_names),
        v_units=tuple(reduced.robot.velocity_units),
        q=tuple(name for name, _ in reduced.robot.configuration_entries),
        q_units=tuple(unit for _, unit in reduced.robot.configuration_entries),
        multipliers_units=tuple(run_info.FORCE_UNITS.get(unit, "") for unit in reduced.constraints.units),
        contact_forces_units=tuple(run_info.FORCE_UNITS.get(unit, "") for unit in reduced.all_constraints.units),
    )


def columns_of(outputs: OutputStack) -> run_info.Columns:
    """Names, units and coordinate types of outputs."""
    units = tuple(unit.removesuffix("/s") for unit in outputs.units)
    angular, rotations = outputs.angular.tolist(), outputs.coordinates.rotations
    return run_info.Columns(
        tuple(outputs.names), units, tuple(angular), tuple(rotations), tuple(outputs.quasi.tolist())
    )


def versions() -> dict[str, str]:
    """Versions of the software that a result depends on."""
    return {
        "rnc_pin": __version__,
        "pin": pin.__version__,
        "numpy": np.__version__,
        "python": platform.python_version(),
    }
