"""A controller in a loop that somebody else runs: measured q and v come in, actuator inputs go out."""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite
from pathlib import Path
from typing import Any, Literal, NamedTuple, TypedDict

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array

from rnc_pin.control.protocol import Command, Controller, State
from rnc_pin.errors import (
    ConfigurationError,
    ConstraintError,
    DivergenceError,
    InputError,
    RncError,
    SingularityError,
    printable,
)
from rnc_pin.loop.guard import Guard, ImpossibleError
from rnc_pin.loop.loop_state import LoopState
from rnc_pin.loop.saved_state import read_state, write_state
from rnc_pin.loop.velocity import FilteredVelocity, Motion, VelocityEstimator, VelocityObserver
from rnc_pin.math.linear_algebra import apply
from rnc_pin.model.evaluation import Evaluation
from rnc_pin.model.measurement import Measurement
from rnc_pin.model.reduced_model import ReducedModel

_A_LITTLE_MORE = 1 + 1e-9  # than a time that is a sum of steps
_SAFE = ("hold", "brake", "zero", "raise")
_VELOCITIES = ("measured", "filtered", "observer")


class LoopOptions(TypedDict, total=False):
    """What a loop may be told besides; ``ControlLoop`` says what each means."""

    velocity: Literal["measured", "filtered", "observer"]
    cutoff: float | None
    limits: bool | Float[Array, " p"]
    on_trouble: Literal["hold", "brake", "zero", "raise"]
    patience: float | None
    fastest: float
    margin: float
    brake: float


class Decision(NamedTuple):
    """What the last step came to, for a record. Arrays are not written to afterwards."""

    time: float
    """The controller's [s]."""
    state: Evaluation
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
        limits: whether inputs are clipped to the effort limits of the actuators; or limits (p,).
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
        ConfigurationError: an option that is none.

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
        if not 0 < dt < np.inf:
            raise ConfigurationError(f"dt of a loop has to be positive, found {dt}")
        self.reduced, self.dt = reduced, dt
        self._given = controller
        self._controller: Controller | None = controller if isinstance(controller, Controller) else None
        self._on_trouble = _one_of("on_trouble", on_trouble, _SAFE)
        self._guard = Guard(reduced.robot, fastest, self._estimator(velocity, cutoff))
        self._limits = _limits(reduced, limits)
        self._patience = 5 * dt if patience is None else patience
        self._margin, self._brake = margin, brake
        self.state = LoopState()
        self.last: Decision | None = None
        self.at_work = "the model"

    def _estimator(self, velocity: str, cutoff: float | None) -> VelocityEstimator | None:
        _one_of("velocity", velocity, _VELOCITIES)
        if cutoff is not None and not cutoff > 0:
            raise ConfigurationError(f"cutoff of a loop has to be positive, found {cutoff}")
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

    def decide(self, t: float, state: Evaluation, integrals: Float[Array, " r"] | None = None) -> Float[Array, " p"]:
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
            self._controller = self._given(measurement)  # type: ignore[operator]
        if before.begin is None and own is None:
            own = self._controller.initial_state(measurement)
        command, own = self._controller.step(t - begin, measurement, own)
        self.at_work = "taking its command"
        asked = _inputs(self.reduced, state, command)
        T = asked if self._limits is None else np.clip(asked, -self._limits, self._limits)
        missing = None if T is asked else _missing(asked, T)
        self.state = LoopState(begin, t, state.q, state.v2, integrals, before.motion, T, missing, own)
        self.last = Decision(t - begin, state, measurement, command, asked, T)
        return T

    def acted(self, T: Float[Array, " p"]) -> None:
        """Tell what the actuators gave instead of what the last step asked for, where that is known.

        Args:
            T: that (p,).
        """
        if self.last is None or T is self.state.T:
            return
        T = np.asarray(T, dtype=float)
        self.state = self.state._replace(T=T, missing=_missing(self.last.asked, T))
        self.last = self.last._replace(T=T)

    def _integrated(self, t: float, state: Evaluation) -> np.ndarray:
        """Integrals of the reducing velocities, by the trapezoidal rule."""
        before = self.state
        if before.time is None or before.integrals is None or before.v2 is None:
            return np.zeros(self.reduced.r)
        return before.integrals + 0.5 * (t - before.time) * (before.v2 + state.v2)

    # ------------------------------------------------------------------ what goes out in trouble

    def _not_taken(self, t: float, problem: str, v: Array | None) -> Array:
        if self._on_trouble == "raise":
            raise InputError(f"measurement at t = {t:g} s: {problem}")
        since = self.state.bad_since if self.state.bad_since is not None else t
        self.state = self.state._replace(bad_since=since, trouble=problem)
        if self.state.T is not None and not t - since > _A_LITTLE_MORE * self._patience:
            return self.state.T.copy()
        return self._safe(v)

    def _safe(self, v: Any) -> Array:
        """The safe command."""
        T = np.zeros(self.reduced.p)
        if self._on_trouble == "hold" and self.state.T is not None:
            T = self.state.T.copy()
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
        return T if self._limits is None else np.clip(T, -self._limits, self._limits)

    # ------------------------------------------------------------------ state

    def reset(self) -> None:
        """Forget everything: the next step is the first."""
        self.state, self.last = LoopState(), None
        if not isinstance(self._given, Controller):
            self._controller = None

    def resume(self, state: LoopState) -> None:
        """Go on from a state of this loop, or of one with the same controller and model.

        Args:
            state: that of the other.
        """
        self.state, self.last = state, None

    def save(self, path: str | Path) -> None:
        """Write the state to an ``.npz`` file.

        Args:
            path: of the file.

        Raises:
            ConfigurationError: the controller remembers something that is neither numbers, text nor tuples of them.
        """
        write_state(self.state, Path(path))

    def load(self, path: str | Path) -> None:
        """Go on from what ``save`` wrote, to the bit.

        Args:
            path: of the file.

        Raises:
            ConfigurationError: not such a file, or one of another controller.
        """
        self.resume(read_state(Path(path), (LoopState, Motion), self._template))

    def _template(self, q: Array) -> State:
        """A state of the controller's kind."""
        measurement = self.reduced.measured(q, np.zeros(self.reduced.n), np.zeros(self.reduced.r))
        if self._controller is None:
            self._controller = self._given(measurement)  # type: ignore[operator]
        return self._controller.initial_state(measurement)


def _inputs(reduced: ReducedModel, state: Evaluation, command: Command) -> np.ndarray:
    if (command.F is None) == (command.T is None):
        raise InputError("a command has to give either F or T")
    if command.T is None:
        return state.allocate(command.F)
    T = np.asarray(command.T, dtype=float)
    if T.shape != (reduced.p,):
        raise InputError(f"the T of a command has shape {T.shape}, expected ({reduced.p},)")
    if not isfinite(sum(T.tolist())):
        raise DivergenceError("the controller asks for inputs without bound")
    return T


def _missing(asked: np.ndarray, T: np.ndarray) -> np.ndarray | None:
    missing = asked - T
    return missing if missing.any() else None


def _limits(reduced: ReducedModel, limits: bool | np.ndarray) -> np.ndarray | None:
    if isinstance(limits, bool):
        return reduced.actuation.limits if limits and np.isfinite(reduced.actuation.limits).any() else None
    given = np.asarray(limits, dtype=float)
    if given.shape != (reduced.p,) or not (given >= 0).all():
        raise ConfigurationError(f"limits of a loop have to be {reduced.p} numbers that are not negative")
    return given


def _one_of(option: str, value: str, valid: tuple[str, ...]) -> str:
    if value not in valid:
        raise ConfigurationError(f"{option} of a loop: expected one of {', '.join(valid)}, found {value!r}")
    return value
