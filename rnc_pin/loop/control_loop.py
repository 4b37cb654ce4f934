"""A controller in a loop that somebody else runs: measured q and v come in, actuator inputs go out."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array

from rnc_pin.control.protocol import Command, Controller
from rnc_pin.errors import ConstraintError, InputError, RncError, SingularityError, printable
from rnc_pin.loop.command import inputs_of, read_answer
from rnc_pin.loop.guard import Guard, ImpossibleError, is_time
from rnc_pin.loop.loop_state import LoopState
from rnc_pin.loop.options import admit_controller, admit_limits, admit_model, check_choice, check_number
from rnc_pin.loop.restoring import restored
from rnc_pin.loop.saved_state import write_state
from rnc_pin.loop.state_checks import check_state
from rnc_pin.loop.velocity import FilteredVelocity, VelocityEstimator, VelocityObserver
from rnc_pin.math.linear_algebra import apply
from rnc_pin.model.admission import vector
from rnc_pin.model.measurement import Measurement
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.state_evaluation import StateEvaluation

_A_LITTLE_MORE = 1 + 1e-9  # than a time that is a sum of steps
_SAFE = ("hold", "brake", "zero", "raise")
_VELOCITIES = ("measured", "filtered", "observer")


class Decision(NamedTuple):
    """What the last step came to, for a record. Arrays are not written to afterwards."""

    time: float
    """The controller's [s]."""
    state: StateEvaluation
    """As it was measured."""
    measurement: Measurement
    command: Command
    asked: Float[Array, " p"]
    """Inputs that the command asks for, before they are clipped."""
    T: Float[Array, " p"]


class ControlLoop:
    """Runs a controller of this package, or any with its protocol, from measured configurations and velocities.

    It keeps what has to be kept between steps: integrals of quasi-velocities, an estimate of the velocity where only q
    is measured, the controller's own state, and the force that the actuators could not give, so that controllers stop
    learning from it. The first step is the controller's time zero.

    A measurement that cannot be true is not taken: NaN, a wrong shape, time that stands still or runs backwards, a
    jump. The last inputs are held for ``patience``, then the safe command is given, until there is a true one again.
    Where the controller itself ends, at a singular configuration say, the safe command is given for good;
    ``state.trouble`` has the reason in words.

    Args:
        reduced: what is believed of the machine.
        controller: of this package or with its protocol; or a function of the first measurement that makes one, so that
            its references start where the machine is.
        dt: usual time between steps [s].
        velocity: "measured"; or from configurations alone, "filtered" (two low passes: smooth, late) or "observer" (a
            fading-memory filter: no lag while accelerations are steady).
        cutoff: of the velocity's estimate [rad/s]; 0.3 / dt by default.
        limits: whether inputs are clipped to the effort limits of the actuators; or limits (p,). The safe command and
            inputs that are held are always clipped: to these limits, or with False to those of the actuators.
        on_trouble: the safe command: "hold" the last inputs, "brake" (``F = -brake diag(H) v2``: reads the model's
            inertia), "zero", or "raise" the error.
        patience: how long the last inputs are held while measurements are no good [s]; five steps by default.
        fastest: speed beyond which a velocity, or the way between two configurations, cannot be true [rad/s, m/s].
        margin: smallest singular value of E below which the controller is no longer asked.
        brake: rate at which braking takes velocities away [1/s].

    Attributes:
        state: what it remembers; ``resume`` goes on from it, to the bit.
        last: what the last step that asked the controller came to; None before.
        at_work: who was asked last, in words, for messages.

    Raises:
        ConfigurationError: an option that is none, or no controller.

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> actuators = [rnc.FrameForce("sleigh", "x"), rnc.FrameTorque("sleigh", "z")]
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")], actuators).reduce(
        ...     [rnc.FrameSpeed("sleigh"), rnc.FrameYaw("sleigh")])
        >>> target = rnc.control.ReducingOutputController(reduced, rnc.planning.Hold([1.0, 0.0]))
        >>> loop = rnc.ControlLoop(reduced, rnc.control.VelocityTracker(target), dt=0.01)
        >>> loop.step(0.0, robot.configuration(), v=np.zeros(3)).round(2)  # a metre ahead: go
        array([20.,  0.])
    """

    def __init__(
        self,
        reduced: ReducedModel,
        controller: Controller | Callable[[Measurement], Controller],
        dt: float,
        *,
        velocity: Literal["measured", "filtered", "observer"] = "measured",
        cutoff: float | None = None,
        limits: bool | Float[Array, " p"] = True,
        on_trouble: Literal["hold", "brake", "zero", "raise"] = "hold",
        patience: float | None = None,
        fastest: float = 100.0,
        margin: float = 0.0,
        brake: float = 5.0,
    ) -> None:
        check_number("dt", dt)
        self.reduced, self.dt = admit_model(reduced), dt
        self._given = admit_controller(controller, of_measurement=True)
        self._controller: Controller | None = controller if isinstance(controller, Controller) else None
        self._on_trouble = check_choice("on_trouble", on_trouble, _SAFE)
        for option, value in (("fastest", fastest), ("margin", margin), ("brake", brake), ("patience", patience)):
            if value is not None:
                check_number(option, value, zero=option != "fastest")
        self._guard = Guard(reduced.robot, fastest, self._estimator(velocity, cutoff))
        self._limits = admit_limits(reduced, limits)
        self._safe_limits = reduced.actuation.limits if self._limits is None else self._limits
        self._patience = 5 * dt if patience is None else patience
        self._margin, self._brake = margin, brake
        self.state = LoopState()
        self.last: Decision | None = None
        self.at_work = "the model"

    def _estimator(self, velocity: str, cutoff: float | None) -> VelocityEstimator | None:
        check_choice("velocity", velocity, _VELOCITIES)
        if cutoff is not None:
            check_number("cutoff", cutoff)
        if velocity == "measured":
            return None
        kind = FilteredVelocity if velocity == "filtered" else VelocityObserver
        return kind(self.reduced.robot.model, 0.3 / self.dt if cutoff is None else cutoff)

    # ------------------------------------------------------------------ a step

    def step(
        self,
        t: float,
        q: Float[Array, " nq"],
        v: Float[Array, " nv"] | None = None,
        integrals: Float[Array, " r"] | None = None,
    ) -> Float[Array, " p"]:
        """Inputs for what was measured; the array is the caller's.

        Args:
            t: when, by any clock that runs forwards [s].
            q: configuration, in Pinocchio's order.
            v: velocity as it was measured; it need not satisfy the constraints. Not read where it is estimated.
            integrals: of the reducing velocities since the first step, where somebody knows them better: odometry.

        Raises:
            RncError: with ``on_trouble="raise"``, whatever is wrong.
        """
        if self.state.failed:
            return self._safe(v)
        try:
            taken = self._guard.take(self.state, t, q, v)
        except ImpossibleError as problem:
            return self._not_taken(t, str(problem), v)
        self.state = self.state._replace(motion=taken.motion)
        try:
            return self.decide(t, self.reduced.at(taken.q, v=taken.v), integrals).copy()
        except Exception as error:
            if self._on_trouble == "raise":
                raise
            reason = str(error) if isinstance(error, RncError) else f"{type(error).__name__}: {error}"
            self.state = self.state._replace(trouble=printable(reason), failed=True)
            return self._safe(taken.v)

    def decide(
        self, t: float, state: StateEvaluation, integrals: Float[Array, " r"] | None = None
    ) -> Float[Array, " p"]:
        """The same for a state that is known to be true and has been evaluated; errors are raised.

        Args:
            t: when [s].
            state: of the loop's model, with its velocity.
            integrals: as for ``step``.
        """
        before, self.at_work = self.state, "the model"
        if integrals is None:
            integrals = self._integrated(t, state)
        measurement = state.measure(integrals)
        if before.missing is not None:
            excess = apply(state.input_matrix, before.missing)
            measurement = measurement._replace(missing=before.missing, excess=excess)
        if self._margin > 0 and state.smallest_singular_value < self._margin:
            raise SingularityError(
                f"the outputs are closer to singular than the margin {self._margin:g}",
                q=np.array(state.q),
                condition=float(state.condition),
                rows=self.reduced.reducing.names,
                time=t,
            )
        self.at_work = "the controller"
        begin, own = (t if before.begin is None else before.begin), before.controller
        if self._controller is None:
            self._controller = self._made(measurement)
        if before.begin is None and own is None:
            own = self._controller.initial_state(measurement)
        answer = self._controller.step(t - begin, measurement, own)
        self.at_work = "taking its command"
        command, own = read_answer(answer)
        asked = inputs_of(self.reduced, state, command)
        T = asked if self._limits is None else np.clip(asked, -self._limits, self._limits)
        missing = None if T is asked else _missing(asked, T)
        self.state = LoopState(begin, t, state.q, state.v2, integrals, before.motion, T, missing, own)
        self.last = Decision(t - begin, state, measurement, command, asked, T)
        return T

    def acted(self, T: Float[Array, " p"]) -> None:
        """Tell what the actuators gave instead of what the last step asked for, where that is known.

        Args:
            T: that (p,).

        Raises:
            InputError: not p finite numbers.
        """
        if self.last is None or T is self.state.T:
            return
        T = vector(T, self.reduced.p, "T")
        if T.ndim > 1:
            raise InputError(f"T has shape {T.shape}, expected ({self.reduced.p},)")
        self.state = self.state._replace(T=T, missing=_missing(self.last.asked, T))
        self.last = self.last._replace(T=T)

    def _integrated(self, t: float, state: StateEvaluation) -> np.ndarray:
        """Integrals of the reducing velocities, by the trapezoidal rule."""
        before = self.state
        if before.time is None or before.integrals is None or before.v2 is None:
            return np.zeros(self.reduced.r)
        return before.integrals + 0.5 * (t - before.time) * (before.v2 + state.v2)

    # ------------------------------------------------------------------ what goes out in trouble

    def _not_taken(self, t: Any, problem: str, v: Array | None) -> Array:
        if self._on_trouble == "raise":
            raise InputError(f"measurement at t = {t:g} s: {problem}" if is_time(t) else problem)
        before, last = self.state, 0.0 if self.state.time is None else self.state.time
        runs = is_time(t) and (before.time is None or t > last)
        now = t if runs else last
        since = now if before.bad_since is None else before.bad_since
        if not runs and before.bad_since is not None:
            since -= self.dt  # patience ends although the clock stands still
        self.state = before._replace(bad_since=since, trouble=problem)
        if before.T is not None and not now - since > _A_LITTLE_MORE * self._patience:
            return self._clipped(before.T)
        return self._safe(v)

    def _clipped(self, T: Array) -> Array:
        """Inputs that somebody else may have put into the state, within the limits; a copy."""
        clipped: Array = np.clip(T, -self._safe_limits, self._safe_limits)
        return clipped

    def _safe(self, v: Any) -> Array:
        """The safe command."""
        T = np.zeros(self.reduced.p)
        if self._on_trouble == "hold" and self.state.T is not None:
            T = self._clipped(self.state.T)
        elif self._on_trouble == "brake":
            T = self._braked(v)
        self.state = self.state._replace(T=T, missing=None)
        return T

    def _braked(self, v: Any) -> Array:
        """Inputs against the motion; none where it is not known."""
        nothing = np.zeros(self.reduced.p)
        q, v = self.state.q, None if v is None else np.asarray(v, dtype=float)
        if q is None or v is None or v.shape != (self.reduced.n,) or not np.isfinite(v).all():
            return nothing
        try:
            state = self.reduced.at(q, v=v)
            T = state.allocate(-self._brake * np.diagonal(state.H) * state.v2)
        except (SingularityError, ConstraintError):
            return nothing
        return self._clipped(T)

    # ------------------------------------------------------------------ state

    def reset(self) -> None:
        """Forget everything: the next step is the first."""
        self.state, self.last = LoopState(), None
        if not isinstance(self._given, Controller):
            self._controller = None

    def resume(self, state: LoopState) -> None:
        """Go on from a state of this loop, or of one with the same controller and model.

        Args:
            state: that of the other; inputs in it that are beyond this loop's limits are clipped.

        Raises:
            InputError: sizes that are not this model's, or numbers that are not finite.
        """
        check_state(state, self.reduced)
        self.state, self.last = state, None
        if self.state.T is not None:
            T = self._clipped(self.state.T)
            if not np.array_equal(T, self.state.T):
                asked = self.state.T if self.state.missing is None else self.state.T + self.state.missing
                self.state = self.state._replace(T=T, missing=_missing(asked, T))

    def save(self, path: str | Path) -> None:
        """Write the state to an ``.npz`` file.

        Args:
            path: of the file.

        Raises:
            ConfigurationError: the controller remembers something that is neither numbers, text nor tuples of them.
        """
        write_state(self.state, Path(path))

    def load(self, path: str | Path) -> None:
        """Go on from what ``save`` wrote, to the bit; whatever is wrong with the file, the loop stays as it was.

        What the controller is said to remember is tried: it takes one step from there.

        Args:
            path: of the file.

        Raises:
            ConfigurationError: not such a file, one of another controller or model, or values that no loop has.
        """
        state, controller = restored(Path(path), self.reduced, self._made)
        self.resume(state)
        self._controller = self._controller if controller is None else controller

    def _made(self, measurement: Measurement) -> Controller:
        """The controller, made of the first measurement if it has to be."""
        made: Controller = self._given(measurement) if self._controller is None else self._controller
        return made


def _missing(asked: np.ndarray, T: np.ndarray) -> np.ndarray | None:
    missing = asked - T
    return missing if missing.any() else None
