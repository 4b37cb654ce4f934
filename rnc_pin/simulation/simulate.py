"""A sampled controller with zero-order hold, over the continuous reduced model."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from rnc_pin.control.protocol import Command, Controller, State
from rnc_pin.errors import DivergenceError, InputError
from rnc_pin.interruption import interruptible, uninterrupted
from rnc_pin.model.evaluation import Evaluation
from rnc_pin.model.measurement import Measurement
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.plain import Json
from rnc_pin.simulation.ending import outcome_of, raise_with
from rnc_pin.simulation.info_json import provenance_of
from rnc_pin.simulation.lie_runge_kutta import LieRungeKutta4
from rnc_pin.simulation.moving_plant import MovingPlant
from rnc_pin.simulation.plant import NOTHING_BESIDE, Plant
from rnc_pin.simulation.record import Record
from rnc_pin.simulation.run_info import Outcome, Provenance
from rnc_pin.simulation.stop import BEYOND_BOUNDS, Stop, Watch
from rnc_pin.simulation.trajectory import Trajectory

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
_MODEL = "the model"


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
    plant: Plant = NOTHING_BESIDE,
    stop: Stop = BEYOND_BOUNDS,
    controller_state: State = None,
    observer: Observer | None = None,
    meta: Provenance | Mapping[str, Json] | None = None,
) -> Trajectory:
    """Run a controller against the reduced model.

    The controller sees a measurement every ``dt`` and its inputs are held in between, while the system moves by a
    fourth-order Lie-group integrator in charts of its own, regular wherever the constraints have constant rank: only
    what the controller looks at can be singular. What the integrator lets holonomic rows drift, wheels off the ground
    or loops apart, is removed at every sample, along a correction that has no momentum in the motion that is left.

    Args:
        reduced: the model.
        controller: anything with the protocol of ``rnc_pin.control``.
        q0: initial configuration (nq,).
        duration: [s]; the last sample is at the nearest whole number of ``dt``.
        dt: sampling period [s].
        v2_0: initial reduced velocity (r,); at rest by default.
        substeps: integration steps in a sampling period.
        plant: what a real machine has beside the model: ``Plant(joint_damping=True, actuator_limits=True)``.
        stop: what ends the run early: ``Stop(position_limits=True)``.
        controller_state: resume from this state instead of a fresh one.
        observer: called with every ``Sample``.
        meta: kept with the trajectory: where the run comes from, as ``Provenance`` or as a mapping that JSON can say.

    Returns:
        The run. Ctrl-C ends it early, with outcome "interrupted", and so does a second and a third.

    Raises:
        RncError: whatever ends the run early, with the run so far in ``error.trajectory``: a SingularityError,
            DivergenceError or LimitError; a ConstraintError where the actuators cannot produce what the controller asks
            for; a SimulationError where the controller or the observer raises, with what it raised as its cause.
        InputError: wrong shapes, a duration or period that is not positive, or an initial configuration that does not
            satisfy the holonomic rows (``ReducedModel.assembled`` gives one that does).
        ConfigurationError: ``meta`` has something else than is expected under a key that is known.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")], robot.joint_names[1:])
        >>> reduced = system.reduce([rnc.JointPosition(f"joint_{k}") for k in (1, 2, 3)])
        >>> swing = rnc.planning.MinimumJerk(np.zeros(3), [0.5, 0.0, 0.0], duration=1.0)
        >>> target = rnc.control.ReducingOutputController(reduced, swing)
        >>> controller = rnc.control.ComputedTorque(reduced, target)
        >>> run = rnc.simulate(reduced, controller, robot.configuration(), duration=1.0, dt=0.01)
        >>> run
        Trajectory: completed, 1 s in 101 samples
        >>> round(run.x2[-1, 0].item(), 2)
        0.5
    """
    provenance = provenance_of(meta)
    samples = sample_count(duration, dt, substeps)
    closed = reduced.assembly.size > 0
    moving, watch = MovingPlant(reduced, plant), Watch(stop, reduced.robot)
    q = assembled_start(reduced, np.array(q0, dtype=float))
    start = reduced.at(q, np.zeros(reduced.r) if v2_0 is None else v2_0)
    y = moving.start(start.q, start.v)
    state_of_controller = controller_state
    if controller_state is None:
        state_of_controller = controller.initial_state(start.measure(moving.integrals(y)))
    integrator = LieRungeKutta4(reduced.robot)
    record = Record(reduced, samples, moving.carries)
    outcome, t, culprit = Outcome.COMPLETED, 0.0, _MODEL
    with uninterrupted():
        try:
            with interruptible():
                for sample in range(record.capacity):
                    t, culprit = sample * dt, _MODEL
                    if not np.isfinite(y).all():
                        raise DivergenceError("velocities have no bound", time=t)
                    state, y = moving.settled(q, y)
                    watch.check(t, state)
                    integrals = moving.integrals(y)
                    measurement = state.measure(integrals)
                    culprit = "the controller"
                    command, state_of_controller = controller.step(t, measurement, state_of_controller)
                    culprit = "taking its command"
                    T = moving.saturate(_inputs(reduced, state, command))
                    record.add(t, state, integrals, command, T, y[-1])
                    if observer is not None:
                        culprit = "the observer"
                        observer(Sample(t, measurement, command, T))
                    culprit = _MODEL
                    if sample + 1 < record.capacity:
                        rate, first = moving.rate(T), moving.first_slope(state, T)
                        for substep in range(substeps):
                            q, y = integrator.step(rate, q, y, dt / substeps, None if substep else first)
                        if closed and np.isfinite(q).all():  # else diverged, which the next sample says
                            q = reduced.assembly.project(q)
        except KeyboardInterrupt:
            outcome = Outcome.INTERRUPTED
        except Exception as error:
            raise_with(lambda told: record.finish(dt, provenance, outcome_of(told), str(told)), error, culprit, t)
        return record.finish(dt, provenance, outcome)


def assembled_start(reduced: ReducedModel, q0: np.ndarray) -> np.ndarray:
    """The initial configuration without its rounding, or a refusal."""
    if not reduced.assembly.size:
        return q0
    if np.abs(reduced.position_residual(q0)).max() > _ASSEMBLED:
        name, residual = reduced.assembly.worst(q0)
        raise InputError(
            f"the initial configuration violates {name} by {residual:.3g} [m or rad]; "
            "reduced.assembled(q0), or system.assembled(q0), gives the nearest one that does not"
        )
    return reduced.assembled(q0)


def _inputs(reduced: ReducedModel, state: Evaluation, command: Command) -> np.ndarray:
    if (command.F is None) == (command.T is None):
        raise InputError("a command has to give either F or T")
    if command.T is None:
        return state.allocate(command.F)
    T = np.asarray(command.T, dtype=float)
    if T.shape != (reduced.p,):
        raise InputError(f"the T of a command has shape {T.shape}, expected ({reduced.p},)")
    return T
