"""A sampled controller with zero-order hold, over the continuous reduced model."""

from __future__ import annotations

import platform
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from rnc_pin.control.protocol import Command, Controller
from rnc_pin.errors import ConstraintError, DivergenceError, InputError, LimitError, SimulationError, SingularityError
from rnc_pin.model.measurement import Measurement
from rnc_pin.model.reduction import ReducedModel
from rnc_pin.simulation.lie_runge_kutta import LieRungeKutta4
from rnc_pin.simulation.plant import Plant
from rnc_pin.simulation.trajectory import Outcome, Trajectory

_MOST_SAMPLES = 10_000_000
_ASSEMBLED = 1e-4  # residual of holonomic rows up to which an initial configuration counts as rounded, not as wrong


class Sample(NamedTuple):
    """What an observer is told once a sample. Arrays are not written to afterwards."""

    time: float
    """[s]"""
    measurement: Measurement
    command: Command
    T: np.ndarray
    """Actuator inputs that act (p,)."""


Observer = Callable[[Sample], None]
OUTCOMES = {SingularityError: Outcome.SINGULAR, DivergenceError: Outcome.DIVERGED, LimitError: Outcome.LIMIT}


def sample_count(duration: float, dt: float, substeps: int = 1) -> int:
    """How many samples a run has, its start among them.

    Raises:
        InputError: a duration or period that is not positive, less than one sample, or more than fit into memory.
    """
    if not (dt > 0 and duration > 0 and np.isfinite(duration)) or substeps < 1:
        raise InputError(f"duration {duration} and dt {dt} have to be positive and substeps {substeps} at least 1")
    samples = round(min(duration / dt, _MOST_SAMPLES + 1)) + 1
    if not 2 <= samples <= _MOST_SAMPLES:
        raise InputError(
            f"duration {duration:g} s is {duration / dt:.3g} times dt {dt:g} s, expected 1 to {_MOST_SAMPLES:g}"
        )
    return samples


def simulate(
    reduced: ReducedModel,
    controller: Controller,
    q0: np.ndarray,
    duration: float,
    dt: float = 0.002,
    *,
    v2_0: np.ndarray | None = None,
    substeps: int = 1,
    joint_damping: bool = False,
    actuator_limits: bool = False,
    position_limits: bool = False,
    controller_state: Any = None,
    speed_limit: float = 1e3,
    observer: Observer | None = None,
    meta: Mapping[str, Any] | None = None,
) -> Trajectory:
    """Run a controller against the reduced model.

    The controller sees a measurement every ``dt`` and its inputs are held in between, while the model moves
    by a fourth-order Lie-group integrator. What the integrator lets holonomic rows drift, wheels off the ground or
    loops apart, is removed at every sample, along a correction that has no momentum in the motion that is left.

    Args:
        reduced: the model.
        controller: anything with the protocol of ``rnc_pin.control``.
        q0: initial configuration (nq,).
        duration: [s]; the last sample is at the nearest whole number of ``dt``.
        dt: sampling period [s].
        v2_0: initial reduced velocity (r,); at rest by default.
        substeps: integration steps in a sampling period.
        joint_damping: let the URDF's viscous damping act on the plant.
        actuator_limits: clip inputs to the URDF's effort limits.
        position_limits: end the run where a joint leaves its range.
        controller_state: resume from this state instead of a fresh one.
        speed_limit: a reduced velocity beyond this counts as diverged.
        observer: called with every ``Sample``.
        meta: kept with the trajectory.

    Returns:
        The run. Ctrl-C ends it early, with outcome "interrupted".

    Raises:
        SingularityError, DivergenceError, LimitError: with the run so far in ``error.trajectory``.
        ConstraintError: the actuators cannot produce what the controller asks for.
        InputError: wrong shapes, a duration or period that is not positive, or an initial configuration that does not
            satisfy the holonomic rows (``ReducedModel.assembled`` gives one that does).
    """
    samples = sample_count(duration, dt, substeps)
    closed = reduced.assembly.size > 0
    q = assembled_start(reduced, np.array(q0, dtype=float))
    y = np.zeros(2 * reduced.r + 1)
    y[: reduced.r] = 0.0 if v2_0 is None else v2_0
    measurement = reduced.measure(q, y[: reduced.r], y[reduced.r : 2 * reduced.r])
    state = controller.initial_state(measurement) if controller_state is None else controller_state
    plant = Plant(reduced, joint_damping, actuator_limits, position_limits)
    integrator = LieRungeKutta4(reduced.robot)
    record = Record(reduced, samples)
    outcome, t = Outcome.COMPLETED, 0.0
    information = dict(meta or {})
    try:
        for sample in range(record.capacity):
            t = sample * dt
            v2 = y[: reduced.r]
            if not np.abs(v2).max() < speed_limit:
                raise DivergenceError(f"reduced velocities reached {np.abs(v2).max():.3g}", time=t)
            beyond = plant.joint_beyond_range(q)
            if beyond:
                raise LimitError(f"{beyond} at t = {t:.3f} s")
            measurement = reduced.measure(q, v2, y[reduced.r : 2 * reduced.r])
            command, state = controller.step(t, measurement, state)
            T = plant.saturate(_inputs(reduced, q, command))
            record.add(t, measurement, command, T, y)
            if observer is not None:
                observer(Sample(t, measurement, command, T))
            if sample + 1 < record.capacity:
                rate = plant.rate(T)
                for _ in range(substeps):
                    q, y = integrator.step(rate, q, y, dt / substeps)
                if closed and np.isfinite(q).all():  # else diverged, which the next sample says
                    q = reduced.assembly.project(q)
    except KeyboardInterrupt:
        outcome = Outcome.INTERRUPTED
    except (SimulationError, ConstraintError, InputError) as error:
        if isinstance(error, SingularityError | DivergenceError) and error.time is None:
            error.time = t
        outcome = next((value for kind, value in OUTCOMES.items() if isinstance(error, kind)), Outcome.FAILED)
        information.update(outcome=outcome, message=str(error))
        error.trajectory = record.finish(information, dt)
        raise
    information.update(outcome=outcome)
    return record.finish(information, dt)


def assembled_start(reduced: ReducedModel, q0: np.ndarray) -> np.ndarray:
    """The initial configuration without its rounding, or a refusal."""
    if not reduced.assembly.size:
        return q0
    if np.abs(reduced.position_residual(q0)).max() > _ASSEMBLED:
        name, residual = reduced.assembly.worst(q0)
        raise InputError(
            f"the initial configuration violates {name} by {residual:.3g} [m or rad]; "
            "reduced.assembled(q0) gives the nearest one that does not"
        )
    return reduced.assembled(q0)


def _inputs(reduced: ReducedModel, q: np.ndarray, command: Command) -> np.ndarray:
    if (command.F is None) == (command.T is None):
        raise InputError("a command has to give either F or T")
    if command.T is None:
        return reduced.allocate(q, command.F)
    return np.asarray(command.T, dtype=float)


class Record:
    """Rows of a run, filled sample by sample; the rest follows in one batch at the end."""

    def __init__(self, reduced: ReducedModel, capacity: int) -> None:
        self.reduced, self.capacity, self.count = reduced, capacity, 0
        sizes = {
            "time": (), "q": (reduced.robot.nq,), "v2": (reduced.r,), "v2_desired": (reduced.r,),
            "x1": (reduced.vertical.size,), "x1_desired": (reduced.vertical.size,),
            "x2": (reduced.r,), "x2_desired": (reduced.r,), "T": (reduced.p,), "work": (),
            "estimates": (0,), "prediction_error": (0,),
        }  # fmt: skip
        self.arrays = {name: np.full((capacity, *size), np.nan) for name, size in sizes.items()}

    def add(self, t: float, measurement: Measurement, command: Command, T: np.ndarray, y: np.ndarray) -> None:
        a, i = self.arrays, self.count
        a["time"][i], a["q"][i], a["v2"][i], a["T"][i], a["work"][i] = t, measurement.q, measurement.v2, T, y[-1]
        a["x1"][i], a["x2"][i] = measurement.x1, measurement.x2
        for name in ("v2_desired", "x1_desired", "x2_desired"):
            value = getattr(command, name)
            if value is not None:
                a[name][i] = value
        for name in ("estimates", "prediction_error"):
            value = getattr(command, name)
            if value is not None:
                if not a[name].shape[1]:
                    a[name] = np.full((self.capacity, np.size(value)), np.nan)
                a[name][i] = value
        self.count += 1

    def finish(self, meta: dict[str, Any], dt: float) -> Trajectory:
        reduced = self.reduced
        a = {name: array[: self.count] for name, array in self.arrays.items()}
        for name, outputs in (("x1", reduced.vertical), ("x2", reduced.reducing)):
            a[name] = outputs.coordinates.unwrap(a[name])
        goals = {
            name: [
                n for n, column in zip(outputs.names, a[f"{name}_desired"].T, strict=True) if not np.isnan(column).any()
            ]
            for name, outputs in (("x1", reduced.vertical), ("x2", reduced.reducing))
        }
        _fill_desired(a["x2_desired"], a["v2_desired"], a["x2"], dt)
        q, v2, T = a["q"], a["v2"], a["T"]
        terms_v = np.empty((self.count, reduced.n))
        F = np.empty((self.count, reduced.r))
        if self.count:
            E_inverse, _, B = reduced.stack(q)
            R = E_inverse[..., reduced.m :]
            terms_v = reduced.velocity(q, v2)
            F = np.vecmat(np.matvec(B, T), R)
        residual = np.abs(reduced.constraint_residual(q, terms_v)).max(axis=-1, initial=0.0)
        return Trajectory(
            **a,
            v=terms_v,
            F=F,
            multipliers=reduced.multipliers(q, v2, T),
            energy=np.asarray(reduced.energy(q, v2)),
            constraint_residual=residual,
            position_residual=np.abs(reduced.position_residual(q)).max(axis=-1, initial=0.0),
            singular_value=np.asarray(reduced.smallest_singular_value(q)),
            meta={
                **output_names(reduced),
                "goals": goals["x1"] + goals["x2"],
                "dt": dt,
                "versions": versions(),
                **meta,
            },
        )


def _fill_desired(x2_desired: np.ndarray, v2_desired: np.ndarray, x2: np.ndarray, dt: float) -> None:
    """Where only a rate was desired, put its integral from the start (trapezoidal rule)."""
    if not len(x2):
        return
    columns = np.isnan(x2_desired).all(axis=0) & ~np.isnan(v2_desired).any(axis=0)
    rates = v2_desired[:, columns]
    steps = 0.5 * dt * (rates[1:] + rates[:-1])
    x2_desired[:, columns] = x2[0, columns] + np.vstack([np.zeros(rates.shape[1]), np.cumsum(steps, axis=0)])


def output_names(reduced: ReducedModel) -> dict[str, Any]:
    """Names, units and angularity of what a model's runs consist of, as ``Trajectory.meta`` has them."""

    def coordinate(unit: str) -> str:
        return unit.removesuffix("/s") if unit.endswith("/s") else unit

    return {
        "names": {
            "x1": list(reduced.vertical.names),
            "x2": list(reduced.reducing.names),
            "T": list(reduced.actuation.names),
            "multipliers": list(reduced.constraints.names),
            "v": list(reduced.robot.velocity_names),
        },
        "units": {
            "x1": [coordinate(unit) for unit in reduced.vertical.units],
            "x2": [coordinate(unit) for unit in reduced.reducing.units],
        },
        "angular": {
            "x1": reduced.vertical.angular.tolist(),
            "x2": reduced.reducing.angular.tolist(),
        },
        "rotations": {
            "x1": list(reduced.vertical.coordinates.rotations),
            "x2": list(reduced.reducing.coordinates.rotations),
        },
    }


def versions() -> dict[str, str]:
    """Versions that a result depends on."""
    from importlib.metadata import version

    return {
        "rnc_pin": version("rnc_pin"),
        "pin": pin.__version__,
        "numpy": np.__version__,
        "python": platform.python_version(),
    }
