"""End of a run: conditions that end it early, its outcome, and the error that carries the run so far."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rnc_pin import errors
from rnc_pin.analysis import NormalForces, first_lift_off
from rnc_pin.interruption import interruptible, uninterrupted
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.robots.robot import Robot
from rnc_pin.simulation.run_info import Outcome
from rnc_pin.simulation.trajectory import Trajectory


@dataclass(frozen=True)
class Stop:
    """Conditions that end a run early, checked once per sample.

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
            raise errors.InputError(f"speed of a Stop has to be positive, found {self.speed}")


DEFAULT_STOP = Stop()


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
                if low < high:
                    self._ranges.append((name, joint.idx_q, low, high))

    def stopped(self, states: StateEvaluation) -> np.ndarray:
        """Mask (count,) of the states for which ``check`` raises an error."""
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
        speed = 0.0
        if not np.vdot(state.v2, state.v2) < self._speed * self._speed:  # the length bounds every entry
            speed = np.abs(state.v2).max()
        if not speed < self._speed:
            raise errors.DivergenceError(f"reduced velocities reached {speed:.3g}, limit {self._speed:g}", time=t)
        for name, index, low, high in self._ranges:
            if not low <= state.q[index] <= high:
                raise errors.LimitError(
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
            raise errors.ConfigurationError(
                "lift_off of a Stop: normal forces need the reduced model of the plant; in MuJoCo, contacts lift off"
            )
        self._model, self._other, self._forces = model, model is not reduced, NormalForces(model)
        if not self._forces.names:
            raise errors.ConfigurationError("lift_off of a Stop: the model has no contact with a normal force")
        self._forces.require("lift_off of a Stop")

    def check(self, t: float, state: StateEvaluation, T: np.ndarray, external: np.ndarray | None) -> None:
        """Raise an error if a contact pulls by more than rounding: contacts that share a force may have zero.

        Raises:
            LimitError: names the contact, the time and the force.
        """
        if self._other:
            state = self._model.at(state.q, v=state.v)
        forces = self._forces.at(state, T, external)
        lifted = first_lift_off(np.array([t]), forces[None], self._forces.names)
        if lifted is not None:
            raise errors.LimitError(
                f"contact '{lifted.contact}' lifts off at t = {t:.3f} s: the model pulls with {-lifted.force:.3g} N, "
                "and the contact can only push"
            )


_OUTCOMES = {
    errors.SingularityError: Outcome.SINGULAR,
    errors.DivergenceError: Outcome.DIVERGED,
    errors.LimitError: Outcome.LIMIT,
}
_LONGEST = 300  # largest number of characters from the message of a foreign error

MODEL = "the model"
Finish = Callable[[Outcome, str | None], Trajectory]


@dataclass
class Progress:
    """Progress of a run, for its error messages."""

    time: float = 0.0
    """[s]"""
    active_component: str = MODEL


def complete_run(advance: Callable[[Progress], str | None], finish: Finish) -> Trajectory:
    """Run to the end and return the trajectory; Ctrl-C ends the run early.

    Args:
        advance: the whole run; returns the reason if it failed without an error.
        finish: function from the outcome and its reason to the trajectory so far.

    Raises:
        RncError: ``advance`` raised an error. ``error.trajectory`` has the trajectory so far.
    """
    progress, outcome, reason = Progress(), Outcome.COMPLETED, None
    with uninterrupted():
        try:
            with interruptible():
                reason = advance(progress)
        except KeyboardInterrupt:
            outcome = Outcome.INTERRUPTED
        except Exception as error:
            failure = run_error(error, progress.active_component, progress.time)
            failure.trajectory = finish(outcome_of(failure), str(failure))
            raise failure  # noqa: B904 (run_error sets the cause)
        return finish(outcome if reason is None else Outcome.FAILED, reason)


def run_error(error: Exception, component: str, t: float) -> errors.RncError:
    """Return an error of a run as an RncError, which can carry the run so far.

    Args:
        error: error that was caught.
        component: name of the component that raised it.
        t: time [s].

    Returns:
        The error itself if it is an RncError, else a SimulationError with the error as its cause.
    """
    if isinstance(error, errors.RncError):
        if isinstance(error, errors.SingularityError | errors.DivergenceError) and error.time is None:
            error.time = t
        return error
    message = " ".join(str(error).split())
    message = f": {message[:_LONGEST]}" if message else ""
    failure = errors.SimulationError(f"{component} raised {type(error).__name__} at t = {t:.3f} s{message}")
    failure.__cause__ = error
    return failure


def outcome_of(error: errors.RncError) -> Outcome:
    """Outcome of a run that an error ended."""
    return next((outcome for kind, outcome in _OUTCOMES.items() if isinstance(error, kind)), Outcome.FAILED)
