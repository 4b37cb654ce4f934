"""Simulation of a sampled controller with zero-order hold and a continuous plant."""

from __future__ import annotations

from typing import Any

import numpy as np

from rnc_pin.control.controller import Command, Controller
from rnc_pin.errors import ConfigurationError, InputError
from rnc_pin.loop import ControlLoop, LoopOptions, LoopState, VelocityInputLoop
from rnc_pin.loop.options import admit_controller, admit_model, type_name
from rnc_pin.model.input_validation import numbers_of
from rnc_pin.model.measurement import Measurement
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.plants import Plant, ReducedPlant
from rnc_pin.plants.plant import takes_velocities
from rnc_pin.plants.reduced import integrated_outputs
from rnc_pin.simulation.ending import MODEL, Progress, complete_run
from rnc_pin.simulation.former_arguments import accept_former_arguments
from rnc_pin.simulation.plant_adapter import PlantAdapter
from rnc_pin.simulation.record import Record
from rnc_pin.simulation.run_info import provenance_of
from rnc_pin.simulation.simulation_options import DEFAULT_OPTIONS, Sample, SimulationOptions
from rnc_pin.simulation.stop import StopMonitor
from rnc_pin.simulation.trajectory import Trajectory

_MOST_SAMPLES = 10_000_000
_ASSEMBLED = 1e-4  # largest residual of holonomic rows that counts as rounding of an initial configuration
_METHODS = ("reset", "read", "apply", "advance")


def sample_count(duration: float, dt: float) -> int:
    """Number of samples of a run, including its start.

    Raises:
        InputError: the duration or period is not positive, or there are too few or too many samples.
    """
    numbers = all(isinstance(each, int | float | np.integer | np.floating) for each in (duration, dt))
    if not numbers or not (dt > 0 and duration > 0 and np.isfinite(duration)):
        raise InputError(f"duration {duration!r} and dt {dt!r} have to be positive numbers")
    samples = round(min(duration / dt, _MOST_SAMPLES + 1)) + 1
    if not 2 <= samples <= _MOST_SAMPLES:
        raise InputError(
            f"duration {duration:g} s is {duration / dt:.3g} times dt {dt:g} s, expected 1 to {_MOST_SAMPLES:g}"
        )
    return samples


@accept_former_arguments
def simulate(
    reduced: ReducedModel,
    controller: Controller,
    q0: np.ndarray,
    duration: float,
    dt: float = 0.002,
    *,
    v2_0: np.ndarray | None = None,
    plant: Plant | None = None,
    options: SimulationOptions = DEFAULT_OPTIONS,
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
        plant: what moves: a ``ReducedPlant`` with damping, friction or actuator limits, a model that differs from the
            nominal one, velocity servos (for an ``ActuatorVelocityController``), sensors with faults, another
            simulator, or hardware. ``ReducedPlant(reduced)`` by default.
        options: stop conditions, control loop, observer and origin of the run.

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
    _check_arguments(reduced, controller, plant, options)
    provenance, samples = provenance_of(options.meta), sample_count(duration, dt)
    adapter = PlantAdapter(ReducedPlant(reduced) if plant is None else plant, reduced)
    loop_options: LoopOptions = {**adapter.loop_options, "max_speed": options.stop.speed, **options.loop}
    kind = VelocityInputLoop if takes_velocities(plant) else ControlLoop
    loop, stop = kind(reduced, controller, dt, **loop_options), StopMonitor(options.stop, reduced.robot)
    zeros = np.zeros(reduced.r)
    start = reduced.at(assembled_start(reduced, numbers_of(q0, "q0")), zeros if v2_0 is None else v2_0)
    adapter.plant.reset(start.q, start.v)
    controller_state = options.controller_state
    if controller_state is None:
        controller_state = controller.initial_state(adapter.read_state().measure(zeros))
    loop.resume(LoopState(begin=0.0, controller=controller_state))
    record = Record(reduced, samples, integrated_outputs(reduced), adapter.friction_names)

    def advance(progress: Progress) -> str | None:
        for sample in range(samples):
            progress.time = t = sample * dt
            state = adapter.read_state()
            stop.check(t, state)
            T = _compute_input(adapter, loop, progress)
            T = adapter.apply(loop, T)
            measurement, command = _last_decision(loop, state)
            integrals = loop.state.integrals if loop.state.integrals is not None else zeros
            record.moves(adapter.model, adapter.external)
            outputs = (measurement.x1, measurement.x2) if measurement.q is state.q else None  # not of a sensor's state
            sensed = adapter.v_measured, adapter.friction_used
            record.add(t, state, integrals, command, T, adapter.work, *sensed, outputs)
            if options.observer is not None:
                progress.active_component = "the observer"
                options.observer(Sample(t, measurement, command, T))
                progress.active_component = MODEL
            if sample + 1 < samples:
                adapter.plant.advance(dt)
        return f"the loop gave the safe command until the end: {loop.state.fault}" if loop.state.failed else None

    return complete_run(advance, lambda outcome, message: record.finish(dt, provenance, outcome, message))


def _check_arguments(reduced: Any, controller: Any, plant: Any, options: Any) -> None:
    admit_model(reduced)
    admit_controller(controller)
    missing = [each for each in _METHODS if not callable(getattr(plant, each, None))]
    if plant is not None and (missing or isinstance(plant, type)):
        raise ConfigurationError(f"plant: expected methods {', '.join(_METHODS)}, found {type_name(plant)}")
    if takes_velocities(plant) and not getattr(controller, "gives_velocities", False):
        raise ConfigurationError(
            "the plant takes velocities: put rnc.control.ActuatorVelocityController(reduced, ...) over a kinematic "
            f"controller, found {type_name(controller)}"
        )
    if getattr(controller, "gives_velocities", False) and not takes_velocities(plant):
        raise ConfigurationError(
            "the controller gives velocities: expected a plant with velocity servos, such as "
            f"rnc.plants.VelocityPlant(reduced), found {type_name(plant)}"
        )
    if not isinstance(options, SimulationOptions):
        raise ConfigurationError(f"options: expected SimulationOptions, found {type_name(options)}")


def _compute_input(adapter: PlantAdapter, loop: ControlLoop, progress: Progress) -> np.ndarray:
    """Inputs (p,) of the loop. If it fails, ``progress`` names the component that failed."""
    try:
        return adapter.compute_input(loop, progress.time)
    except Exception:
        progress.active_component = loop.active_component
        raise


def assembled_start(reduced: ReducedModel, q0: np.ndarray) -> np.ndarray:
    """Initial configuration without rounding errors of the holonomic rows.

    Raises:
        InputError: the residual of a holonomic row is larger than rounding.
    """
    if not reduced.assembly.size:
        return q0
    if np.abs(reduced.assembly.residual(q0)).max() > _ASSEMBLED:
        name, residual = reduced.assembly.worst(q0)
        raise InputError(
            f"the initial configuration violates {name} by {residual:.3g} [m or rad]; "
            "reduced.assembled(q0) or system.assembled(q0) returns the nearest one that satisfies it"
        )
    return reduced.assembled(q0)


def _last_decision(loop: ControlLoop, state: StateEvaluation) -> tuple[Measurement, Command]:
    """Measurement and command of the loop's last step. For a safe command, the goals are those of the step before."""
    if loop.last is None:
        return state.measure(loop.state.integrals), Command(T=loop.state.T)
    if loop.state.fault is not None:
        return loop.last.measurement, loop.last.command._replace(F=None, T=loop.state.T)
    return loop.last.measurement, loop.last.command
