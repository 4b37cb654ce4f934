"""Control loop for an external process: measured q and v in, actuator inputs out."""

from __future__ import annotations

from math import isfinite
from pathlib import Path
from time import perf_counter
from typing import NamedTuple, Unpack

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from rnc_pin.array_shapes import Array, Float
from rnc_pin.control.controller import Command, Controller
from rnc_pin.control.loop.loop_state import (
    LoopState,
    VelocityEstimate,
    check_state,
    restore,
    with_late_tick,
    write_state,
)
from rnc_pin.control.loop.options import (
    LoopOptions,
    LoopSettings,
    admit_limits,
    check_controller,
    check_number,
    check_reduced_model,
    input_of,
    unpack_step,
)
from rnc_pin.errors import ConstraintError, InputError, RncError, SingularityError, printable
from rnc_pin.math.linear_algebra import apply, clipped
from rnc_pin.model.evaluation_results import Measurement
from rnc_pin.model.input_validation import is_number, numbers_of, own_vector
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.printing import ReprMixin, printed

_GAP = 5  # sampling periods without a measurement that count as a gap
_TIME_TOLERANCE = 1 + 1e-9  # tolerance of a time that is a sum of steps, relative


@printed()
class Decision(NamedTuple):
    """Result of the last step, for a record. Its arrays are never overwritten."""

    time: float
    """Controller time [s]."""
    state: StateEvaluation
    """Measured state."""
    measurement: Measurement
    command: Command
    requested: Float[Array, " p"]
    """Inputs of the command before clipping."""
    T: Float[Array, " p"]


class ControlLoop(ReprMixin):
    """Run a controller from measured configurations and velocities.

    ``state`` stores the data of the loop between two steps:

    * integrals of the reducing velocities,
    * the velocity estimate, if only q is measured,
    * the state of the controller,
    * the inputs that the actuators could not give; adaptive controllers then stop learning (conditional integration).

    The first step defines the controller's time zero. After a gap longer than ``timeout``, integrals follow from the
    change of the configuration, not from velocities.

    The loop rejects an invalid measurement: NaN, a wrong shape, time that does not increase, or a jump. It holds the
    last inputs for ``timeout``, then gives the safe command until a measurement is valid again. If the controller
    raises an error, for example at a singular configuration, the loop gives the safe command from then on.
    ``state.fault`` has the reason as text.

    Args:
        reduced: nominal model of the plant.
        controller: a controller of this package or of the same protocol.
        dt: nominal sampling period [s].
        options: options by name, the fields of ``LoopSettings``: ``velocity``, ``cutoff``, ``limits``, ``fallback``,
            ``timeout``, ``max_speed``, ``min_singular_value``, ``brake`` and ``deadline``.

    Attributes:
        settings: options of the loop.
        state: data of the loop between two steps; ``resume`` continues from it bit for bit.
        last: result of the last step of the controller; None before the first.
        limits: limits (p,) to which inputs are clipped, of the actuators by default; None if they are not.
        active_component: name of the component that was called last, for error messages.

    Raises:
        ConfigurationError: an option has an invalid value, or the controller is not one.

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> actuators = [rnc.FrameForce("sleigh", "x"), rnc.FrameTorque("sleigh", "z")]
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")], actuators).reduce(
        ...     [rnc.FrameSpeed("sleigh"), rnc.FrameYaw("sleigh")])
        >>> target = rnc.control.ReducingOutputController(reduced, rnc.planning.Hold([1.0, 0.0]))
        >>> loop = rnc.ControlLoop(reduced, rnc.control.VelocityTracker(target), dt=0.01)
        >>> loop.step(0.0, robot.configuration(), v=np.zeros(3)).round(2)  # the target is 1 m ahead
        array([20.,  0.])
    """

    _commanded = False  # True: commands replace velocities, which nobody measures
    _has_efforts = True  # False: inputs are velocities

    def __init__(
        self, reduced: ReducedModel, controller: Controller, dt: float, **options: Unpack[LoopOptions]
    ) -> None:
        check_number("dt", dt)
        check_reduced_model(reduced)
        check_controller(controller)
        self.reduced, self.dt, self._controller = reduced, dt, controller
        self.settings = LoopSettings.of_options(options)
        self._observer: VelocityObserver | None = None
        if self.settings.velocity == "observer":
            cutoff = 0.3 / dt if self.settings.cutoff is None else self.settings.cutoff
            # A gap for the loop is one for the observer too. A timeout of zero is none: each sample would be a gap.
            gap = _TIME_TOLERANCE * max(self.timeout, _GAP * dt)
            self._observer = VelocityObserver(reduced.robot.model, cutoff, gap)
        self.limits = admit_limits(reduced, self.settings.limits)
        # A safe command stays within what actuators can do, even if the user switched the limits off. Limits in a
        # robot's file are efforts.
        known = reduced.actuation.limits if self._has_efforts else np.full(reduced.p, np.inf)
        self._fallback_limits = known if self.limits is None else self.limits
        self.state = LoopState()
        self.last: Decision | None = None
        self.active_component = "the model"

    def _settings(self) -> dict[str, object]:
        return {"reduced": self.reduced, "controller": self._controller, "dt": self.dt}

    # ------------------------------------------------------------------ a step

    def prepare(self, q: Float[Array, " nq"], v: Float[Array, " nv"] | None = None) -> None:
        """Do before the first step what takes long: the controller's first search, and first calls of all parts.

        The controller starts from its ``initial_state`` here. A trial step follows, whose result is not used.

        Args:
            q: configuration (nq,) at which the loop will start.
            v: velocity (nv,); at rest by default.

        Raises:
            RncError: an invalid configuration, or an error of the controller.
        """
        self.reset()
        state = self.reduced.at(q, v=np.zeros(self.reduced.n) if v is None else v, t=0.0)
        # First calls import modules and fill caches: on a robot they would be late samples.
        own = self._controller.initial_state(state.measure(np.zeros(self.reduced.r)))
        self.state = LoopState(controller=own)
        self.compute_input(0.0, state)
        self.state, self.last = LoopState(controller=own), None

    def step(
        self,
        t: float,
        q: Float[Array, " nq"],
        v: Float[Array, " nv"] | None = None,
        integrals: Float[Array, " r"] | None = None,
    ) -> Float[Array, " p"]:
        """Return actuator inputs (p,) for a measurement. The array is a copy.

        Args:
            t: time of the measurement [s], from any monotonic clock.
            q: configuration (nq,), in Pinocchio's order.
            v: measured velocity (nv,); it need not satisfy the constraints. Ignored if the loop estimates velocity.
            integrals: integrals (r,) of the reducing velocities since the first step, for example from odometry. By
                default the loop integrates.

        Raises:
            RncError: an invalid measurement or an error of the controller, with ``fallback="raise"``.
        """
        begin, deadline = perf_counter(), self.settings.deadline
        T = self._step(t, q, v, integrals)
        if deadline is not None:
            late = with_late_tick(self.state.late, self.state.time or 0.0, perf_counter() - begin, deadline)
            self.state = self.state._replace(late=late)
        return T

    def _step(self, t: float, q: Array, v: Array | None, integrals: Array | None) -> Array:
        if self.state.failed:
            return self._fallback_input(v)
        try:
            q, v_valid, motion = self._validated(t, q, v)
        except InputError as problem:
            return self._reject(t, str(problem), v)
        # The estimate goes on even if the controller fails at this sample.
        self.state = self.state._replace(motion=motion)
        try:
            return self.compute_input(t, self._evaluated(t, q, v_valid), integrals).copy()
        # Any error, also of a user's controller: an exception would leave the drives without a command.
        except Exception as error:
            if self.settings.fallback == "raise":
                raise
            reason = str(error) if isinstance(error, RncError) else f"{type(error).__name__}: {error}"
            self.state = self.state._replace(fault=printable(reason), failed=True)
            return self._fallback_input(v_valid)

    def compute_input(
        self, t: float, state: StateEvaluation, integrals: Float[Array, " r"] | None = None
    ) -> Float[Array, " p"]:
        """Return actuator inputs (p,) for an evaluated state, without checks. Errors are raised.

        Args:
            t: time [s].
            state: state of the loop's model, with its velocity.
            integrals: as for ``step``.
        """
        before, self.active_component = self.state, "the model"
        if integrals is None:
            integrals = self._integrate(t, state)
        measurement = state.measure(integrals)
        if before.input_deficit is not None:
            # What actuators did not give of the last command: a controller that learns must not learn it.
            force = apply(state.input_matrix, before.input_deficit)
            measurement = measurement._replace(input_deficit=before.input_deficit, force_deficit=force)
        least = self.settings.min_singular_value
        if least > 0 and state.smallest_singular_value < least:
            what = f"the smallest singular value of E is {state.smallest_singular_value:.3g}, below the limit {least:g}"
            condition, rows = float(state.condition), state.dependent_rows()
            raise SingularityError(what, q=np.array(state.q), condition=condition, rows=rows, time=t)
        self.active_component = "the controller"
        # The controller counts time from the first step: a clock may start anywhere.
        begin, own = (t if before.begin is None else before.begin), before.controller
        if before.begin is None and own is None:  # not prepared
            own = self._controller.initial_state(measurement)
        answer = self._controller.step(t - begin, measurement, own)
        self.active_component = "the allocation of its command"
        command, own = unpack_step(answer)
        requested = input_of(self.reduced, state, command)
        T = requested if self.limits is None else clipped(requested, self.limits)
        deficit = None if T is requested else _input_deficit(requested, T)
        self.state = LoopState(begin, t, state.q, state.v2, integrals, before.motion, T, deficit, own, late=before.late)
        self.last = Decision(t - begin, state, measurement, command, requested, T)
        return T

    def report_applied_input(self, T: Float[Array, " p"]) -> None:
        """Report the inputs that the actuators applied, if they differ from those of the last step.

        Args:
            T: applied inputs (p,).

        Raises:
            InputError: T is not p finite numbers.
        """
        # Usually the plant applied the array of the last step: nothing to compare.
        if self.last is None or T is self.state.T:
            return
        T = own_vector(T, self.reduced.p, "T")
        if self.state.T is not None and (T == self.state.T).all():
            return
        self.state = self.state._replace(T=T, input_deficit=_input_deficit(self.last.requested, T))
        self.last = self.last._replace(T=T)

    def _evaluated(self, t: float, q: np.ndarray, v: np.ndarray) -> StateEvaluation:
        """State of the model. Rheonomic constraints and the controller count time from the first step."""
        return self.reduced.at(q, v=v, t=t - (t if self.state.begin is None else self.state.begin))

    def _integrate(self, t: float, state: StateEvaluation) -> np.ndarray:
        """Integrals (r,) of the reducing velocities.

        After a gap, velocities at its ends say little about the motion in between, and a clock may have jumped. The
        change of the configuration then counts.
        """
        before = self.state
        if before.time is None or before.integrals is None or before.v2 is None:
            return np.zeros(self.reduced.r)
        elapsed = t - before.time
        # After a gap the velocities in between are unknown: positions tell the integral to first order.
        if self._commanded or elapsed > _TIME_TOLERANCE * self.timeout:
            moved = pin.difference(self.reduced.robot.model, before.q, state.q)
            integrals: np.ndarray = before.integrals + state.J2 @ moved
            return integrals
        return np.asarray(before.integrals + 0.5 * elapsed * (before.v2 + state.v2))  # trapezoidal rule

    # ------------------------------------------------------------------ measurements

    def _validated(self, t: float, q: ArrayLike, v: ArrayLike | None) -> tuple[Array, Array, VelocityEstimate | None]:
        """Normalized q, measured or estimated v, and the state of the estimate, of a raw measurement.

        Its cost does not depend on the values.

        Raises:
            InputError: the measurement is invalid; the message has the reason.
        """
        before, largest = self.state, self.settings.max_speed
        if not is_number(t):
            raise InputError(f"time is {t!r}, expected a finite number")
        elapsed = None if before.time is None else t - before.time
        # The observer and the speed of q divide by this time.
        if elapsed is not None and elapsed <= 0:
            raise InputError(f"time stands still or runs backwards: {t:g} s after {before.time:g} s")
        model = self.reduced.robot.model
        given = _numbers("q", q, model.nq)
        unit: Array = pin.normalize(model, given)
        # Rounded pairs and quaternions are normalized. Zeros or angles in their place are an error of a sensor.
        unit_tolerance = 0.1
        if not np.abs(unit - given).max(initial=0.0) < unit_tolerance:
            raise InputError("q holds a (cos, sin) pair or a quaternion that is not of unit length")
        if elapsed is not None and before.q is not None:
            # A jump is an error of a sensor: the observer would make a velocity of it, and the controller a force.
            speed = np.abs(pin.difference(model, before.q, unit)).max(initial=0.0) / elapsed
            if not speed < largest:
                raise InputError(
                    f"q jumped: {speed:.3g} rad/s or m/s from the last one, expected less than {largest:g}"
                )
        if self._observer is not None:
            if before.motion is None or elapsed is None:
                motion = self._observer.start(unit)
            else:
                motion = self._observer.step(before.motion, unit, elapsed)
            return unit, motion.v, motion
        if v is None:
            raise InputError("v is missing: measure it, or use velocity='observer'")
        v = _numbers("v", v, model.nv)
        speed = np.abs(v).max(initial=0.0)
        if not speed < largest:
            raise InputError(f"v reaches {speed:.3g} rad/s or m/s, expected less than {largest:g}")
        return unit, v, None

    # ------------------------------------------------------------------ safe command

    def _reject(self, t: float, problem: str, v: Array | None) -> Array:
        if self.settings.fallback == "raise":
            raise InputError(f"measurement at t = {t:g} s: {problem}" if is_number(t) else problem)
        before, last = self.state, 0.0 if self.state.time is None else self.state.time
        runs = is_number(t) and (before.time is None or t > last)
        now = t if runs else last
        since = now if before.invalid_since is None else before.invalid_since
        if not runs and before.invalid_since is not None:
            since -= self.dt  # the timeout elapses even if the clock stands still
        self.state = before._replace(invalid_since=since, fault=problem)
        # Held at first: a single lost sample must not stop a robot that moves.
        if before.T is not None and not now - since > _TIME_TOLERANCE * self.timeout:
            return self._clipped(before.T)
        return self._fallback_input(v)

    def _clipped(self, T: Array) -> Array:
        """Copy of T, clipped to the limits: a stored state may come from another loop."""
        return clipped(T, self._fallback_limits)

    def _fallback_input(self, v: Array | None) -> Array:
        """Inputs of the safe command."""
        T = np.zeros(self.reduced.p)
        if self.settings.fallback == "hold" and self.state.T is not None:
            T = self._clipped(self.state.T)
        elif self.settings.fallback == "brake":
            T = self._braking_input(v)
        # The controller did not ask for these inputs, so none of its force is missing.
        self.state = self.state._replace(T=T, input_deficit=None)
        return T

    def _braking_input(self, v: Array | None) -> Array:
        """Braking inputs ``F = -brake diag(H) v2``; zero if q or v is unknown."""
        nothing = np.zeros(self.reduced.p)
        q, v = self.state.q, None if v is None else np.asarray(v, dtype=float)
        if q is None or v is None or v.shape != (self.reduced.n,) or not np.isfinite(v).all():
            return nothing
        try:
            state = self._evaluated(self.state.time or 0.0, q, v)
            T = state.allocate(-self.settings.brake * np.diagonal(state.H) * state.v2)
        # At a singular state no force brakes the outputs; the safe command must not fail.
        except (SingularityError, ConstraintError):
            return nothing
        return self._clipped(T)

    # ------------------------------------------------------------------ state

    @property
    def timeout(self) -> float:
        """Time for which the last inputs are held while measurements are invalid [s]."""
        return _GAP * self.dt if self.settings.timeout is None else self.settings.timeout

    def reset(self) -> None:
        """Clear the state: the next step is the first."""
        self.state, self.last = LoopState(), None

    def resume(self, state: LoopState) -> None:
        """Continue from a state of this loop, or of a loop with the same controller and model.

        Args:
            state: state to continue from; its inputs are clipped to the limits of this loop.

        Raises:
            InputError: sizes differ from those of the model, or numbers are not finite.
        """
        check_state(state, self.reduced)
        self.state, self.last = state, None
        if self.state.T is not None:
            T, deficit = self._clipped(self.state.T), self.state.input_deficit
            if not np.array_equal(T, self.state.T):
                # The other loop may have had larger limits: the deficit grows by what is clipped here.
                requested = self.state.T if deficit is None else self.state.T + deficit
                self.state = self.state._replace(T=T, input_deficit=_input_deficit(requested, T))

    def save(self, path: str | Path) -> None:
        """Write the state to an ``.npz`` file.

        Args:
            path: of the file.

        Raises:
            ConfigurationError: the controller's state holds another type than numbers, text or tuples of them.
        """
        write_state(self.state, Path(path))

    def load(self, path: str | Path) -> None:
        """Continue bit for bit from a file that ``save`` wrote. If the file is invalid, the loop does not change.

        The controller takes one trial step from the stored state.

        Args:
            path: of the file.

        Raises:
            ConfigurationError: not a file of ``save``, of another controller or model, or with invalid values.
        """
        self.resume(restore(Path(path), self.reduced, self._controller))


def _input_deficit(requested: np.ndarray, T: np.ndarray) -> np.ndarray | None:
    deficit = requested - T
    return deficit if deficit.any() else None


# ---------------------------------------------------------------------- measurements


class VelocityObserver:
    """Observer of position, velocity and acceleration from configurations, without lag at constant acceleration.

    The fading-memory filter of second order (Morrison, "Introduction to Sequential Smoothing and Prediction", 1969): a
    parabola fitted to the past by least squares, with weights that decay by ``theta = exp(-cutoff dt)`` per sample.
    The observer does not use the inertia. Controllers get the measured position, not the estimated one.

    Args:
        model: Pinocchio model of the configurations.
        cutoff: cutoff frequency [rad/s].
        gap: time between measurements after which the last acceleration says nothing, and the mean velocity counts [s].
    """

    def __init__(self, model: pin.Model, cutoff: float, gap: float = np.inf) -> None:
        self._model, self.cutoff, self._gap = model, cutoff, gap

    def start(self, q: Float[Array, " nq"]) -> VelocityEstimate:
        """Return the initial estimate at q: zero velocity."""
        nothing = np.zeros(self._model.nv)
        return VelocityEstimate(q, nothing, nothing)

    def step(self, motion: VelocityEstimate, q: Float[Array, " nq"], elapsed: float) -> VelocityEstimate:
        """Return the estimate after a new measurement q.

        Args:
            motion: last estimate.
            q: measured configuration (nq,).
            elapsed: time since the last measurement [s].
        """
        # The velocity before a gap says nothing, and its prediction would miss by far: start from the difference.
        if elapsed > self._gap:
            return VelocityEstimate(q, pin.difference(self._model, motion.q, q) / elapsed, np.zeros(self._model.nv))
        # The critically damped g-h-k filter: three equal poles theta, so the estimate does not overshoot.
        theta = np.exp(-self.cutoff * elapsed)
        ahead = motion.v * elapsed + motion.acceleration * (0.5 * elapsed**2)
        expected = pin.integrate(self._model, motion.q, ahead)
        miss = pin.difference(self._model, expected, q)
        v = motion.v + motion.acceleration * elapsed + 1.5 * (1.0 - theta) ** 2 * (1.0 + theta) / elapsed * miss
        acceleration = motion.acceleration + (1.0 - theta) ** 3 / elapsed**2 * miss
        return VelocityEstimate(pin.integrate(self._model, expected, (1.0 - theta**3) * miss), v, acceleration)


def _numbers(name: str, value: ArrayLike, size: int) -> Array:
    try:
        numbers = numbers_of(value, name)
    except InputError:
        raise InputError(f"{name} is not made of numbers") from None
    if numbers.shape != (size,):
        raise InputError(f"{name} has shape {numbers.shape}, expected ({size},)")
    if not isfinite(sum(numbers.tolist())):  # the sum of finite numbers may be too large
        wrong = np.flatnonzero(~np.isfinite(numbers))
        if len(wrong):
            raise InputError(f"{name}[{int(wrong[0])}] is not finite")
    return numbers
