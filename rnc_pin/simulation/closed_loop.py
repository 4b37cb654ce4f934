"""Simulation: a controller and a plant in closed loop, one run or many; and motion without a sampled controller."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import cast

import numpy as np
import pinocchio as pin

from rnc_pin.control.controller import Command, Controller
from rnc_pin.errors import ConfigurationError, DivergenceError, InputError, SingularityError
from rnc_pin.model.input_validation import is_number, numbers_of
from rnc_pin.model.integrators import AdaptiveIntegrator
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.plants import Plant, ReducedPlant
from rnc_pin.plants.constrained_dynamics import ConstrainedDynamics
from rnc_pin.plants.plant import PlantReport
from rnc_pin.simulation.derived_quantities import derive, versions
from rnc_pin.simulation.run_data import Record, Trajectory
from rnc_pin.simulation.run_info import RunInfo, provenance_of
from rnc_pin.simulation.sampled_run import Progress, SampledRun, complete_run
from rnc_pin.simulation.simulation_options import (
    DEFAULT_OPTIONS,
    LiftOffMonitor,
    RunArguments,
    SimulationOptions,
    StopMonitor,
    assembled_start,
    sample_count,
)

Feedback = Callable[[float, np.ndarray, np.ndarray], np.ndarray]


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

    With a row for each run in q0 or v2_0, the result is a list of runs. An error ends only its run, whose trajectory
    has its outcome and message. On a ``ReducedPlant`` of the model, runs under trackers are computed together, and
    differ from runs alone by rounding; other runs are computed one after the other.

    Args:
        reduced: reduced model.
        controller: controller with the protocol of ``rnc_pin.control``.
        q0: initial configuration (nq,), or many (B, nq).
        duration: duration [s], rounded to a multiple of ``dt``.
        dt: sampling period [s].
        v2_0: initial reduced velocity (r,), or many (B, r); zero by default.
        plant: what moves: a ``ReducedPlant`` with damping, friction or actuator limits, a model that differs from the
            nominal one, velocity servos (for an ``ActuatorVelocityController``), sensors with faults, another
            simulator, or hardware. ``ReducedPlant(reduced)`` by default.
        options: stop conditions, control loop, observer and origin of the run.

    Returns:
        The run, or a list of runs. Ctrl-C ends it early, with outcome "interrupted"; repeated Ctrl-C has the same
        effect.

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
        Trajectory: succeeded, 1 s in 101 samples
        >>> round(run.x2[-1, 0].item(), 2)
        0.5
    """
    samples = sample_count(duration, dt)
    arguments = RunArguments(reduced, controller, q0, dt, samples, v2_0, plant, options)
    if np.ndim(q0) > 1 or (v2_0 is not None and np.ndim(v2_0) > 1):
        from rnc_pin.simulation.batch import simulate_batch  # a run alone starts without it

        return cast(Trajectory, simulate_batch(arguments))  # for type checkers, which cannot tell one row from many
    run = SampledRun(arguments)
    return complete_run(lambda progress: run.run_to(samples, progress), run.finish)


def free_motion(
    reduced: ReducedModel | ReducedPlant,
    q0: np.ndarray,
    v2_0: np.ndarray,
    duration: float,
    dt: float = 0.02,
    inputs: np.ndarray | Feedback | None = None,
    *,
    tolerance: float | tuple[float, float] = 1e-12,
    options: SimulationOptions = DEFAULT_OPTIONS,
) -> Trajectory:
    """Simulate a reduced system without input, under constant inputs, or under a continuous feedback.

    An adaptive eighth-order method integrates on the configuration manifold, in charts of the constraints only. Motions
    stay accurate over minutes, also through configurations at which the model's outputs are singular. After every step
    a projection removes the drift of holonomic rows, which is of the order of the tolerance. For a sampled controller
    with zero-order hold, use ``simulate``.

    Args:
        reduced: reduced model, or a plant of it, with effects that the model does not include:
            ``ReducedPlant(reduced, joint_damping=True)``. Its state does not change.
        q0: initial configuration (nq,).
        v2_0: initial reduced velocity (r,).
        duration: [s].
        dt: sampling period of the trajectory [s]; the tolerances determine the integration steps.
        inputs: actuator inputs (p,), or ``inputs(t, q, v2) -> (p,)``, continuous; none by default.
        tolerance: of a step, relative and absolute; two numbers if they differ.
        options: stop conditions, checked once per sample, and origin of the run. The others need ``simulate``.

    Raises:
        RncError: the motion ends early, with the run so far in ``error.trajectory``: a SingularityError or
            DivergenceError; or a SimulationError, whose cause is an error that the feedback raised.
        InputError: wrong shapes; times or tolerances are not positive; or the initial configuration violates the
            holonomic rows.
        ConfigurationError: an option needs ``simulate``, or ``meta`` has a value of the wrong type under a known key.

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")])
        >>> reduced = system.reduce([rnc.FrameSpeed("sleigh"), rnc.FrameYaw("sleigh")])
        >>> run = rnc.free_motion(reduced, robot.configuration(), v2_0=[0.0, 1.0], duration=20.0, dt=0.5)
        >>> bool(abs(run.v2[-1, 1]) < 0.01), bool(run.v2[-1, 0] > 0)  # rotation becomes straight motion
        (True, True)
    """
    stop, info = options.stop, RunInfo(dt=dt, versions=versions(), provenance=provenance_of(options.meta))
    if options.loop or options.observer is not None or options.controller_state is not None:
        raise ConfigurationError("free_motion has no controller: of the options, it takes stop and meta only")
    rtol, atol = (tolerance, tolerance) if isinstance(tolerance, int | float) else tolerance
    if not all(map(is_number, (dt, duration, rtol, atol))) or not (0 < dt <= duration and rtol > 0 and atol > 0):
        raise InputError(
            f"duration {duration!r}, dt {dt!r} and tolerance {tolerance} have to be positive, dt at most the duration"
        )
    plant = ReducedPlant(reduced) if isinstance(reduced, ReducedModel) else reduced
    if not isinstance(plant, ReducedPlant):
        raise InputError("free_motion requires a ReducedModel or a ReducedPlant; use simulate for another plant")
    if plant.joint_friction:
        raise InputError(
            "dry friction is not smooth: free_motion does not support it; use simulate with joint_friction=True"
        )
    # Equations of its own: charts follow the motion, and the state of the plant must not change.
    model, dynamics = plant.reduced, ConstrainedDynamics(plant.reduced, plant.joint_damping, plant.actuator_limits)
    stop_monitor = StopMonitor(stop, model.robot)
    # Of the plant's own model: there is no other one here.
    lift_off = LiftOffMonitor(model, model) if stop.lift_off else None
    feedback = inputs if callable(inputs) else None
    # Clipped once, and not at each stage of the integrator.
    given = np.zeros(model.p) if inputs is None or callable(inputs) else numbers_of(inputs, "inputs")
    constant = dynamics.saturate(given)

    def inputs_at(t: float, state: StateEvaluation) -> np.ndarray:
        if feedback is None:
            return constant
        return dynamics.saturate(numbers_of(feedback(t, state.q, state.v2), "inputs"))

    def local_rate(t: float, q: np.ndarray, x: np.ndarray) -> np.ndarray:
        try:
            if feedback is None:
                return dynamics.local_rate(q, x, constant)
            # A feedback asks for the state of its stage, which is a displacement u from q.
            at = pin.integrate(model.robot.model, q, x[: model.n])
            return dynamics.local_rate(q, x, inputs_at(t, dynamics.at(at, x[model.n :]).in_reduction(model.evaluator)))
        except (SingularityError, DivergenceError):  # NaN makes the integrator shorten a step that leaves the chart
            return np.full(len(x), np.nan)

    def settle(q: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        q = dynamics.project(q, y)
        # Charts change between steps only: within one, all stages have to be in the same chart.
        return q, dynamics.recentre(q, y)[1]

    q = assembled_start(model, numbers_of(q0, "q0"))
    # A (cos, sin) pair or a quaternion that is rounded in a file would scale the body that it turns.
    start = model.at(pin.normalize(model.robot.model, q), v2_0, t=0.0)
    _ = start.flow(inputs_at(0.0, start))  # raise errors of shape or singularity before the integration
    y0 = dynamics.initial(start.q, start.v)
    # Even times that end at the duration exactly, also where it is no multiple of dt.
    times_of_samples = np.linspace(0.0, duration, round(duration / dt) + 1)
    record = Record(model, dynamics.integrated)
    integrator = AdaptiveIntegrator(model.robot, local_rate, rtol, atol, settle)

    def advance(progress: Progress) -> None:
        progress.active_component = "the feedback" if feedback else "the model"
        for times, q, y in integrator.run(times_of_samples, start.q, y0):
            v, integrals = dynamics.at(q, y).v, dynamics.integrals(y)
            # One by one: the first sample that meets a condition ends the run, and a feedback may have a memory.
            for t, q_t, v_t, integrals_t, work in zip(times.tolist(), q, v, integrals, y[:, -1], strict=True):
                progress.time = t
                state = model.at(q_t, v=v_t, t=t)
                stop_monitor.check(t, state)
                T, external = inputs_at(t, state), dynamics.damping_force(state)
                if lift_off is not None:
                    lift_off.check(t, state, T, external)
                report = PlantReport(work=work, reduced=model, external=external)
                record.add(t, state, integrals_t, Command(T=T), T, report)

    return complete_run(
        advance, lambda outcome, message: derive(record, replace(info, outcome=outcome, message=message))
    )
