"""Arguments and options of ``simulate``, the conditions that end a run early, and the samples for an observer."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from rnc_pin.analysis import NormalForces, first_lift_off, near_lift_off
from rnc_pin.analysis.normal_forces import CHANGES
from rnc_pin.control.controller import Command, Controller, State, VelocityGiving
from rnc_pin.control.loop import LoopOptions
from rnc_pin.control.loop.options import LoopSettings, check_controller, check_reduced_model, type_name
from rnc_pin.errors import ConfigurationError, DivergenceError, InputError, LimitError
from rnc_pin.io.json import Json
from rnc_pin.model.evaluation_results import Measurement
from rnc_pin.model.input_validation import is_number
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.plants import Plant
from rnc_pin.plants.plant import takes_velocities
from rnc_pin.printing import printed
from rnc_pin.robots.robot import Robot
from rnc_pin.simulation.run_info import Provenance

_ASSEMBLED = 1e-4  # largest residual of holonomic rows that counts as rounding of an initial configuration
_MOST_SAMPLES = 10_000_000


@dataclass(frozen=True)
class Stop:
    """Conditions that end a run early, checked once per sample; lift-off inside the samples, too.

    Args:
        speed: largest reduced velocity, in the units of the outputs' rates; a larger one counts as diverged.
        position_limits: True ends the run if a joint leaves its position limits in the robot's file.
        lift_off: True ends the run if a contact with the ground would have to pull.

    Raises:
        InputError: speed is not positive.

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")]).reduce()
        >>> fast = rnc.SimulationOptions(rnc.Stop(speed=2.0))
        >>> try:
        ...     rnc.free_motion(reduced, robot.configuration(), [5.0, 0.0], 1.0, options=fast)
        ... except rnc.DivergenceError as error:
        ...     print(error)
        diverged at t = 0.000 s: reduced velocities reached 5, limit 2
    """

    speed: float = 1e3
    position_limits: bool = False
    lift_off: bool = False

    def __post_init__(self) -> None:
        if not self.speed > 0:
            raise InputError(f"speed of a Stop has to be positive, found {self.speed}")


class StopMonitor:
    """Check of stop conditions for a robot.

    Args:
        stop: stop conditions.
        robot: robot with the position limits.

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")]).reduce()
        >>> monitor = rnc.simulation.StopMonitor(rnc.Stop(speed=2.0), robot)
        >>> monitor.stopped(reduced.at(np.tile(robot.configuration(), (2, 1)), [[1.0, 0.0], [5.0, 0.0]])).tolist()
        [False, True]
    """

    def __init__(self, stop: Stop, robot: Robot) -> None:
        self._speed = stop.speed
        self._ranges: list[tuple[str, int, float, float]] = []
        model = robot.model
        for name, joint in zip(robot.joint_names, list(model.joints)[1:], strict=True):
            if stop.position_limits and joint.nq == 1:
                low, high = model.lowerPositionLimit[joint.idx_q], model.upperPositionLimit[joint.idx_q]
                # Equal limits are those of a file that states none.
                if low < high:
                    self._ranges.append((name, joint.idx_q, low, high))

    def stopped(self, states: StateEvaluation) -> np.ndarray:
        """Mask (count,) of the states for which ``check`` raises an error.

        Args:
            states: states (count,) in the outputs of the controller's model.
        """
        # Negated, so that velocities that are not numbers stop too.
        stopped = ~(np.abs(states.v2).max(axis=-1, initial=0.0) < self._speed)
        for _, k, low, high in self._ranges:
            stopped |= ~((low <= states.q[:, k]) & (states.q[:, k] <= high))
        return stopped

    def check(self, t: float, state: StateEvaluation) -> None:
        """Raise an error if a state meets a stop condition.

        Args:
            t: simulated time [s].
            state: state with one configuration.

        Raises:
            DivergenceError: a reduced velocity exceeds the limit, or is not finite.
            LimitError: a joint is outside its position limits.
        """
        speed = np.abs(state.v2).max(initial=0.0)
        if not speed < self._speed:
            raise DivergenceError(f"reduced velocities reached {speed:.3g}, limit {self._speed:g}", time=t)
        for name, index, low, high in self._ranges:
            if not low <= state.q[index] <= high:
                raise LimitError(
                    f"joint '{name}' left its range [{low:g}, {high:g}]: {state.q[index]:.4g} at t = {t:.3f} s"
                )


class LiftOffMonitor:
    """Check that no contact with the ground pulls.

    Args:
        model: reduced model of the plant; None if it is unknown.
        reduced: model of the states to check.

    Raises:
        ConfigurationError: the plant has no model, or the model has no contact with a normal force.
    """

    def __init__(self, model: ReducedModel | None, reduced: ReducedModel) -> None:
        if model is None:
            raise ConfigurationError(
                "lift_off of a Stop: normal forces need the reduced model of the plant; in MuJoCo, contacts lift off"
            )
        self._model, self._other, self._forces = model, model is not reduced, NormalForces(model)
        if not self._forces.names:
            raise ConfigurationError("lift_off of a Stop: the model has no contact with a normal force")
        self._forces.require("lift_off of a Stop")
        self._samples: list[tuple[np.ndarray, ...]] = []

    def check(self, t: float, state: StateEvaluation, T: np.ndarray, external: np.ndarray | None) -> None:
        """Raise an error if a contact pulls, at a sample or since the last one, by more than rounding.

        Args:
            t: simulated time [s].
            state: state in the controller's model.
            T: inputs (p,) [N or N m].
            external: generalized forces (nv,) in addition to the inputs; None without any.

        Raises:
            LimitError: names the contact, the time and the force.
        """
        # Loads are those of what moves, which the controller may not know.
        if self._other:
            state = self._model.at(state.q, v=state.v, t=t)
        forces = self._forces.at(state, T, external)
        sample = np.array(t), state.q, state.v, np.array(T), state.contact_forces(T, external), forces
        self._samples = [*self._samples[-CHANGES:], sample]  # one more than those that tell no change
        time, *states, rows, loads = (np.stack(each) for each in zip(*self._samples, strict=True))
        last = len(time) - 2  # the interval that has ended
        inside = self._forces.between(time, (states[0], states[1], states[2]), rows, loads, np.array([last]))
        near = last in near_lift_off(loads)
        lifted = first_lift_off(time[-1:], loads[-1:], self._forces.names, inside if near else ())
        if lifted is not None:
            raise LimitError(
                f"contact '{lifted.contact}' lifts off at t = {lifted.time:.3f} s: the model pulls with "
                f"{-lifted.force:.3g} N, and the contact can only push{self._forces.remedy(lifted.contact)}"
            )


@printed()
class Sample(NamedTuple):
    """Argument of an observer, once per sample. Its arrays are never overwritten."""

    time: float
    """[s]"""
    measurement: Measurement
    command: Command
    T: np.ndarray
    """Applied actuator inputs (p,)."""
    state: State = None
    """State of the controller after the sample."""


Observer = Callable[[Sample], None]


@dataclass(frozen=True)
class SimulationOptions:
    """Options of a run of ``simulate``.

    Args:
        stop: conditions that end the run early: ``Stop(position_limits=True)``.
        loop: options of the ``ControlLoop`` of the controller. On a ``ReducedPlant`` of the same model, errors are
            raised by default; on another plant the loop gives a safe command instead. The loop clips no inputs by
            default: plants do, a ``ReducedPlant`` with ``actuator_limits=True``.
        controller_state: initial state of the controller; a new one by default.
        observer: function that is called with every ``Sample``.
        meta: origin of the run, stored with the trajectory: a ``Provenance``, or a mapping that JSON can represent.

    Raises:
        ConfigurationError: an option has the wrong type, or ``loop`` has an unknown key.

    Example:
        >>> times, observer = [], lambda sample: times.append(sample.time)
        >>> options = rnc.SimulationOptions(rnc.Stop(speed=5.0), {"velocity": "observer"}, observer=observer)
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> drives = [rnc.FrameForce("sleigh", "x"), rnc.FrameTorque("sleigh", "z")]
        >>> system = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")], drives)
        >>> reduced = system.reduce([rnc.FrameSpeed("sleigh"), rnc.FrameYaw("sleigh")])
        >>> target = rnc.control.ReducingOutputController(reduced, rnc.planning.Hold([0.0, 0.0]))
        >>> tracker = rnc.control.VelocityTracker(target)
        >>> _ = rnc.simulate(reduced, tracker, robot.configuration(), 0.2, dt=0.1, options=options)
        >>> times
        [0.0, 0.1, 0.2]
    """

    stop: Stop = Stop()
    loop: LoopOptions = field(default_factory=LoopOptions)
    controller_state: State = None
    observer: Observer | None = None
    meta: Provenance | Mapping[str, Json] | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.stop, Stop):
            raise ConfigurationError(f"stop: expected a Stop, found {type_name(self.stop)}")
        if not isinstance(self.loop, Mapping):
            raise ConfigurationError(
                f"loop: expected a mapping of options of ControlLoop, found {type_name(self.loop)}"
            )
        LoopSettings.of_options(self.loop)  # refuses wrong ones now, and not at the start of a run
        # A copy: the caller may change the mapping between two runs.
        object.__setattr__(self, "loop", dict(self.loop))
        if self.observer is not None and not callable(self.observer):
            raise ConfigurationError(f"observer: expected a function of a Sample, found {type_name(self.observer)}")


DEFAULT_OPTIONS = SimulationOptions()


class RunArguments(NamedTuple):
    """Arguments of one run, as for ``simulate``, with a number of samples instead of a duration."""

    reduced: ReducedModel
    controller: Controller
    q0: np.ndarray
    dt: float
    samples: int
    """Number of samples; 0 if the caller ends the run."""
    v2_0: np.ndarray | None = None
    plant: Plant | None = None
    options: SimulationOptions = DEFAULT_OPTIONS


# ---------------------------------------------------------------------- checks


def sample_count(duration: float, dt: float) -> int:
    """Number of samples of a run, including its start.

    Args:
        duration: simulated time [s].
        dt: sampling period [s].

    Raises:
        InputError: the duration or period is not positive, or there are too few or too many samples.
    """
    if not (is_number(duration) and is_number(dt) and dt > 0 and duration > 0):
        raise InputError(f"duration {duration!r} and dt {dt!r} have to be positive numbers")
    # The ratio may be infinite, which cannot be rounded.
    samples = round(min(duration / dt, _MOST_SAMPLES + 1)) + 1
    if not 2 <= samples <= _MOST_SAMPLES:
        raise InputError(
            f"duration {duration:g} s is {duration / dt:.3g} times dt {dt:g} s, expected 1 to {_MOST_SAMPLES:g}"
        )
    return samples


def check_arguments(arguments: RunArguments) -> None:
    """Raise an error if an argument of a run has the wrong type, or if plant and controller do not fit together.

    Args:
        arguments: arguments of a run.
    """
    reduced, controller, *_, plant, options = arguments
    check_reduced_model(reduced)
    check_controller(controller)
    if plant is not None and (isinstance(plant, type) or not isinstance(plant, Plant)):
        raise ConfigurationError(f"plant: expected methods reset, read, apply, advance, found {type_name(plant)}")
    # Forces on servos, or velocities on motors, would run and mean nothing.
    takes, gives = takes_velocities(plant), isinstance(controller, VelocityGiving) and controller.gives_velocities
    if takes and not gives:
        raise ConfigurationError(
            "the plant takes velocities: put rnc.control.ActuatorVelocityController(reduced, ...) over a kinematic "
            f"controller, found {type_name(controller)}"
        )
    if gives and not takes:
        raise ConfigurationError(
            "the controller gives velocities: expected a plant with velocity servos, such as "
            f"rnc.plants.VelocityPlant(reduced), found {type_name(plant)}"
        )
    if not isinstance(options, SimulationOptions):
        raise ConfigurationError(f"options: expected SimulationOptions, found {type_name(options)}")


def assembled_start(reduced: ReducedModel, q0: np.ndarray) -> np.ndarray:
    """Initial configuration without rounding errors of the holonomic rows.

    Args:
        reduced: reduced model.
        q0: configuration (nq,), which satisfies the holonomic rows up to rounding.

    Raises:
        InputError: the residual of a holonomic row is larger than rounding.
    """
    reduced.robot.check_unchanged()
    if not reduced.assembly.size:
        return q0
    # Farther away it is a mistake in q0, which a projection would hide in another posture.
    if np.abs(reduced.assembly.residual(q0)).max() > _ASSEMBLED:
        name, residual = reduced.assembly.worst(q0)
        raise InputError(
            f"the initial configuration violates {name} by {residual:.3g} [m or rad]; "
            "reduced.assembled(q0) or system.assembled(q0) returns the nearest one that satisfies it"
            f"{reduced.assembly.remedy(name)}"
        )
    return reduced.assembled(q0)
