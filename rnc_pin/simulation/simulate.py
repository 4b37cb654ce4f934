"""A sampled controller with zero-order hold, over the continuous reduced model or any other machine."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from rnc_pin.control.protocol import Command, Controller, State
from rnc_pin.errors import InputError
from rnc_pin.interruption import interruptible, uninterrupted
from rnc_pin.loop import ControlLoop, LoopOptions, LoopState
from rnc_pin.model.admission import numbers_of
from rnc_pin.model.measurement import Measurement
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.plain import Json
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
_MODEL, _LOOP = "the model", "the loop"


def sample_count(duration: float, dt: float, substeps: int = 1) -> int:
    """How many samples a run has, its start among them.

    Raises:
        InputError: a duration or period that is not positive, less than one sample, or more than fit into memory.
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
    """Run a controller against the reduced model, or against another machine.

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
        machine: what moves instead of the reduced model: another simulator, a model that differs from what the
            controller believes, sensors with faults. ``plant`` and ``substeps`` are of our own and mean nothing then.
        loop: options of the ``ControlLoop`` that the controller runs in. By default inputs are clipped to their limits
            where ``plant`` says so, and errors are raised; around another machine there is a safe command instead.
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
        ConfigurationError: an argument that is not what is expected, or ``meta`` has something else than is expected
            under a key that is known.

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
    check_parts(reduced, controller, plant, stop, machine, loop, observer)
    provenance = provenance_of(meta)
    samples = sample_count(duration, dt, substeps)
    seen = SeenMachine(ReducedPlant(reduced, plant, substeps) if machine is None else machine, reduced)
    usual: LoopOptions = {
        "on_trouble": "raise" if machine is None else "hold",
        "limits": plant.actuator_limits,
        "fastest": stop.speed,
    }
    usual.update(loop or {})
    control, watch = ControlLoop(reduced, controller, dt, **usual), Watch(stop, reduced.robot)
    nothing = np.zeros(reduced.r)
    start = reduced.at(assembled_start(reduced, numbers_of(q0, "q0")), np.zeros(reduced.r) if v2_0 is None else v2_0)
    seen.machine.reset(start.q, start.v)
    if controller_state is None:
        controller_state = controller.initial_state(seen.look().measure(nothing))
    control.resume(LoopState(begin=0.0, controller=controller_state))
    record = Record(reduced, samples, integrated(reduced), seen.friction_names)
    outcome, message, t, culprit = Outcome.COMPLETED, None, 0.0, _MODEL
    with uninterrupted():
        try:
            with interruptible():
                for sample in range(samples):
                    t, culprit = sample * dt, _MODEL
                    state = seen.look()
                    watch.check(t, state)
                    culprit = _LOOP
                    T = seen.decide(control, t)
                    culprit = _MODEL
                    T = seen.act(control, T)
                    measurement, command = _decided(control, state)
                    integrals = control.state.integrals if control.state.integrals is not None else nothing
                    record.moves(seen.model, seen.external)
                    record.add(t, state, integrals, command, T, seen.work, seen.v_measured, seen.friction_used)
                    if observer is not None:
                        culprit = "the observer"
                        observer(Sample(t, measurement, command, T))
                        culprit = _MODEL
                    if sample + 1 < samples:
                        seen.machine.advance(dt)
        except KeyboardInterrupt:
            outcome = Outcome.INTERRUPTED
        except Exception as error:
            culprit = control.at_work if culprit is _LOOP else culprit
            raise_with(lambda told: record.finish(dt, provenance, outcome_of(told), str(told)), error, culprit, t)
        if control.state.failed and outcome is Outcome.COMPLETED:
            outcome, message = Outcome.FAILED, f"the safe command was given since: {control.state.trouble}"
        return record.finish(dt, provenance, outcome, message)


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


def _decided(loop: ControlLoop, state: StateEvaluation) -> tuple[Measurement, Command]:
    """What the loop's last step saw and asked for; where it gave the safe command, what was wanted before."""
    if loop.last is None:
        return state.measure(loop.state.integrals), Command(T=loop.state.T)
    if loop.state.trouble is not None:
        return loop.last.measurement, loop.last.command._replace(F=None, T=loop.state.T)
    return loop.last.measurement, loop.last.command
