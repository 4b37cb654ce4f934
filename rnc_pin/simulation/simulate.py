"""Simulation of a sampled controller with zero-order hold and a continuous plant."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from rnc_pin.control.protocol import Command, Controller, State
from rnc_pin.errors import InputError
from rnc_pin.interruption import interruptible, uninterrupted
from rnc_pin.io.json import Json
from rnc_pin.loop import ControlLoop, LoopOptions, LoopState
from rnc_pin.model.admission import numbers_of
from rnc_pin.model.measurement import Measurement
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.plants import Machine
from rnc_pin.simulation.arguments import check_parts
from rnc_pin.simulation.ending import outcome_of, raise_with
from rnc_pin.simulation.info_json import provenance_of
from rnc_pin.simulation.moving_plant import integrated
from rnc_pin.simulation.plant import NOTHING_BESIDE, Plant
from rnc_pin.simulation.record import Record
from rnc_pin.simulation.reduced_plant import ReducedPlant
from rnc_pin.simulation.run_info import Outcome, Provenance
from rnc_pin.simulation.seen_machine import SeenMachine
from rnc_pin.simulation.stop import BEYOND_BOUNDS, Stop, Watch
from rnc_pin.simulation.trajectory import Trajectory

_MOST_SAMPLES = 10_000_000
_ASSEMBLED = 1e-4  # largest residual of holonomic rows that counts as rounding of an initial configuration


class Sample(NamedTuple):
    """Argument of an observer, once per sample. Its arrays are never overwritten."""

    time: float
    """[s]"""
    measurement: Measurement
    command: Command
    T: np.ndarray
    """Applied actuator inputs (p,)."""


Observer = Callable[[Sample], None]
_MODEL, _LOOP = "the model", "the loop"


def sample_count(duration: float, dt: float, substeps: int = 1) -> int:
    """Number of samples of a run, including its start.

    Raises:
        InputError: the duration or period is not positive, or there are too few or too many samples.
    """
    numbers = all(isinstance(each, int | float | np.integer | np.floating) for each in (duration, dt, substeps))
    if not numbers or not (dt > 0 and duration > 0 and np.isfinite(duration)) or substeps < 1:
        raise InputError(
            f"duration {duration!r} and dt {dt!r} have to be positive numbers and substeps {substeps!r} at least 1"
        )
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
    machine: Machine | None = None,
    loop: LoopOptions | None = None,
    controller_state: State = None,
    observer: Observer | None = None,
    meta: Provenance | Mapping[str, Json] | None = None,
) -> Trajectory:
    """Simulate a controller in closed loop with the reduced model, or with another plant.

    The controller gets a measurement every ``dt``, and a zero-order hold keeps its inputs in between. A fourth-order
    Lie-group integrator runs in charts of the constraints, which are regular if the constraints have constant rank.
    So only the outputs of the controller can be singular. At every sample a projection removes the drift of holonomic
    rows, such as wheel height and loop closure. The correction has zero momentum along the admissible velocities.

    Args:
        reduced: reduced model.
        controller: controller with the protocol of ``rnc_pin.control``.
        q0: initial configuration (nq,).
        duration: duration [s], rounded to a multiple of ``dt``.
        dt: sampling period [s].
        v2_0: initial reduced velocity (r,); zero by default.
        substeps: integration steps per sampling period.
        plant: effects that the model does not include: ``Plant(joint_damping=True, actuator_limits=True)``.
        stop: conditions that end the run early: ``Stop(position_limits=True)``.
        machine: plant instead of the reduced model: another simulator, a model that differs from the nominal one, or
            sensors with faults. ``plant`` and ``substeps`` have no effect on it.
        loop: options of the ``ControlLoop`` of the controller. By default inputs are clipped if ``plant`` has actuator
            limits. Errors are raised, but with ``machine`` the loop gives a safe command instead.
        controller_state: initial state of the controller; a new one by default.
        observer: function that is called with every ``Sample``.
        meta: origin of the run, stored with the trajectory: a ``Provenance``, or a mapping that JSON can represent.

    Returns:
        The run. Ctrl-C ends it early, with outcome "interrupted"; repeated Ctrl-C has the same effect.

    Raises:
        RncError: the run ends early, with the run so far in ``error.trajectory``: a SingularityError, DivergenceError
            or LimitError; a ConstraintError if the actuators cannot produce the command; or a SimulationError, whose
            cause is an error that the controller or the observer raised.
        InputError: wrong shapes; the duration or period is not positive; or the initial configuration violates the
            holonomic rows (``ReducedModel.assembled`` returns one that satisfies them).
        ConfigurationError: an argument has the wrong type, or ``meta`` has a value of the wrong type under a known key.

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
    loop = check_parts(reduced, controller, plant, stop, machine, loop, observer)
    provenance = provenance_of(meta)
    samples = sample_count(duration, dt, substeps)
    seen = SeenMachine(ReducedPlant(reduced, plant, substeps) if machine is None else machine, reduced)
    usual: LoopOptions = {
        "fallback": "raise" if machine is None else "hold",
        "limits": plant.actuator_limits,
        "max_speed": stop.speed,
    }
    usual.update(loop)
    control, watch = ControlLoop(reduced, controller, dt, **usual), Watch(stop, reduced.robot)
    nothing = np.zeros(reduced.r)
    start = reduced.at(assembled_start(reduced, numbers_of(q0, "q0")), np.zeros(reduced.r) if v2_0 is None else v2_0)
    seen.machine.reset(start.q, start.v)
    if controller_state is None:
        controller_state = controller.initial_state(seen.look().measure(nothing))
    control.resume(LoopState(begin=0.0, controller=controller_state))
    record = Record(reduced, samples, integrated(reduced), seen.friction_names)
    outcome, message, t, active = Outcome.COMPLETED, None, 0.0, _MODEL
    with uninterrupted():
        try:
            with interruptible():
                for sample in range(samples):
                    t, active = sample * dt, _MODEL
                    state = seen.look()
                    watch.check(t, state)
                    active = _LOOP
                    T = seen.decide(control, t)
                    active = _MODEL
                    T = seen.act(control, T)
                    measurement, command = _decided(control, state)
                    integrals = control.state.integrals if control.state.integrals is not None else nothing
                    record.moves(seen.model, seen.external)
                    record.add(t, state, integrals, command, T, seen.work, seen.v_measured, seen.friction_used)
                    if observer is not None:
                        active = "the observer"
                        observer(Sample(t, measurement, command, T))
                        active = _MODEL
                    if sample + 1 < samples:
                        seen.machine.advance(dt)
        except KeyboardInterrupt:
            outcome = Outcome.INTERRUPTED
        except Exception as error:
            active = control.active_component if active is _LOOP else active
            raise_with(lambda told: record.finish(dt, provenance, outcome_of(told), str(told)), error, active, t)
        if control.state.failed and outcome is Outcome.COMPLETED:
            outcome, message = Outcome.FAILED, f"the loop gave the safe command until the end: {control.state.fault}"
        return record.finish(dt, provenance, outcome, message)


def assembled_start(reduced: ReducedModel, q0: np.ndarray) -> np.ndarray:
    """Initial configuration without rounding errors of the holonomic rows.

    Raises:
        InputError: the residual of a holonomic row is larger than rounding.
    """
    if not reduced.assembly.size:
        return q0
    if np.abs(reduced.position_residual(q0)).max() > _ASSEMBLED:
        name, residual = reduced.assembly.worst(q0)
        raise InputError(
            f"the initial configuration violates {name} by {residual:.3g} [m or rad]; "
            "reduced.assembled(q0) or system.assembled(q0) returns the nearest one that satisfies it"
        )
    return reduced.assembled(q0)


def _decided(loop: ControlLoop, state: StateEvaluation) -> tuple[Measurement, Command]:
    """Measurement and command of the loop's last step. For a safe command, the goals are those of the step before."""
    if loop.last is None:
        return state.measure(loop.state.integrals), Command(T=loop.state.T)
    if loop.state.fault is not None:
        return loop.last.measurement, loop.last.command._replace(F=None, T=loop.state.T)
    return loop.last.measurement, loop.last.command
