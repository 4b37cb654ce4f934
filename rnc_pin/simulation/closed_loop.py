"""Simulation of a closed loop of controller and plant: one run, or many together."""

from __future__ import annotations

from typing import cast

import numpy as np

from rnc_pin.control.controller import Controller
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.plants import Plant
from rnc_pin.simulation.sampled_run import SampledRun, complete_run
from rnc_pin.simulation.simulation_options import DEFAULT_OPTIONS, RunArguments, SimulationOptions, sample_count
from rnc_pin.simulation.trajectory import Trajectory


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
