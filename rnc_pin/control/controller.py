"""Protocols of controllers, and their common types.

Controllers hold gains only. Everything that they learn is in a state, which is passed in and returned. So a run can be
saved, resumed and replayed bit for bit:

    state = controller.initial_state(measurement)
    command, state = controller.step(t, measurement, state)      # once per sample

``ControlLoop`` keeps the state of its controller, and its ``save`` writes it. A run of ``simulate`` starts with
``SimulationOptions.controller_state`` and gives each new state to its observer, as ``Sample.state``.

Further methods are optional. ``describe()``, which controllers of this package implement, puts gains in the record of a
run. ``findings`` of ``SelfJudging`` and ``missed_goals`` of ``Ending`` add findings to its verdict.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any, ClassVar, Literal, NamedTuple, Protocol, TypeAlias, runtime_checkable

import numpy as np

from rnc_pin.array_shapes import Array, Float
from rnc_pin.errors import ConfigurationError, InputError, short_text
from rnc_pin.io.json import Json
from rnc_pin.model.evaluation_results import Measurement
from rnc_pin.printing import ReprMixin, printed
from rnc_pin.verdict import Finding

State: TypeAlias = Any
"""State of a controller from one sample to the next; only the controller knows its content."""
Description: TypeAlias = Mapping[str, Json]
"""Description of a controller: its ``type``, its gains, and the descriptions of the controllers that it contains."""


@printed()
class VelocityTarget(NamedTuple):
    """Desired motion of the reducing outputs from a kinematic controller, with leading batch axes."""

    v2: Float[Array, "*batch r"]
    """Desired rates."""
    v2_dot: Float[Array, "*batch r"]
    """Derivative of the desired rates."""
    x1: Float[Array, "*batch k"] | None = None
    """Desired vertical outputs; NaN for outputs outside the task."""
    x2: Float[Array, "*batch r"] | None = None
    """Desired reducing outputs; NaN if only the rate matters."""
    estimates: Float[Array, "*batch s"] | None = None
    """Parameter estimates of the controller."""
    prediction_error: Float[Array, "*batch k"] | None = None
    """Measured minus predicted rates of the vertical outputs."""
    v2_held: Float[Array, "*batch r"] | None = None
    """Rates for a robot that holds its command over the sample: the mean of the planned rates. None for v2."""


@printed()
class Command(NamedTuple):
    """Output of a controller: F or T; the other fields are for the record only."""

    F: Float[Array, "*batch r"] | None = None
    """Reduced force; the loop allocates it to the actuators."""
    T: Float[Array, "*batch p"] | None = None
    """Actuator inputs, from a controller that knows its actuators."""
    v2_desired: Float[Array, "*batch r"] | None = None
    x1_desired: Float[Array, "*batch k"] | None = None
    x2_desired: Float[Array, "*batch r"] | None = None
    estimates: Float[Array, "*batch s"] | None = None
    prediction_error: Float[Array, "*batch k"] | None = None


@runtime_checkable
class Controller(Protocol):
    """Controller that computes a command once per sample; any object with these two methods is one.

    It holds gains only. What it learns is in the state, which ``step`` takes and returns without changing it. The
    command has ``F``, a reduced force (r,), or ``T``, inputs of the actuators (p,); others are for the record.

    The measurement has q (nq,), v2 (r,), the outputs x1 (k,) and x2 (r,), A_star (k, r), and more; see ``Measurement``.
    ``describe()`` is optional: type and gains for the record of a run. So are ``findings(state, samples)`` and
    ``missed_goals(t, q, v2)``, which add to its verdict.

    Example:
        >>> class Brake:
        ...     def __init__(self, gain):
        ...         self.gain = gain  # [N s/m or N m s/rad]
        ...     def initial_state(self, measurement):
        ...         return None
        ...     def step(self, t, measurement, state):
        ...         return rnc.control.Command(F=-self.gain * measurement.v2), state
        >>> isinstance(Brake(5.0), rnc.control.Controller)
        True
        >>> Brake(5.0).step(0.0, rnc.Measurement(v2=np.array([1.0, 0.5])), None)[0].F
        array([-5. , -2.5])
    """

    def initial_state(self, measurement: Measurement) -> State:
        """Return the state before the first sample.

        Args:
            measurement: first measurement.
        """

    def step(self, t: float, measurement: Measurement, state: State) -> tuple[Command, State]:
        """Return the command, and the state for the next sample.

        Args:
            t: time of the sample [s].
            measurement: measurement at that time.
            state: state from the last sample; it is not changed.
        """


@runtime_checkable
class KinematicController(Protocol):
    """Controller that computes a velocity target once per sample; it reads no masses.

    It has the methods of ``Controller``, with a ``VelocityTarget`` in place of the command: v2 (r,) and its
    derivative. Trackers, such as ``VelocityTracker``, turn the target into forces.

    Example:
        >>> class Cruise:
        ...     def initial_state(self, measurement):
        ...         return None
        ...     def step(self, t, measurement, state):
        ...         return rnc.control.VelocityTarget(v2=np.array([1.0, 0.0]), v2_dot=np.zeros(2)), state
        >>> isinstance(Cruise(), rnc.control.KinematicController)
        True
    """

    def initial_state(self, measurement: Measurement) -> State:
        """Return the state before the first sample.

        Args:
            measurement: first measurement.
        """

    def step(self, t: float, measurement: Measurement, state: State) -> tuple[VelocityTarget, State]:
        """Return the velocity target, and the state for the next sample.

        Args:
            t: time of the sample [s].
            measurement: measurement at that time.
            state: state from the last sample; it is not changed.
        """


@runtime_checkable
class Describable(Protocol):
    """Object with a description of its type and gains; all controllers of this package implement it."""

    def describe(self) -> Description: ...


def describe(thing: object) -> Description:
    """Return the description of an object; the name of its class if it has no ``describe``.

    Args:
        thing: any object.
    """
    return thing.describe() if isinstance(thing, Describable) else {"type": type(thing).__name__}


def listed(values: object) -> Json:
    """Return a gain in a form that JSON can store: a number, or a list of numbers.

    Args:
        values: number or array.
    """
    # Python's numbers: JSON cannot store those of NumPy.
    numbers: Json = np.asarray(values).tolist()
    return numbers


class DescribedMixin(ReprMixin):
    """Mixin of controllers with settings: it prints them in one line, and describes them for the record of a run.

    Attributes:
        described: names of the attributes that the description contains.
    """

    described: ClassVar[tuple[str, ...]] = ()

    def describe(self) -> Description:
        """Return the type and the settings, with the descriptions of the objects among them."""
        return {"type": type(self).__name__, **{name: _setting(getattr(self, name)) for name in self.described}}


def _setting(value: object) -> Json:
    if value is None or isinstance(value, bool | int | float | str | tuple | np.ndarray):
        return listed(value)
    # Objects among the settings describe themselves, such as gains and a target.
    return dict(describe(value))


def check_size(reference: object, size: int, what: str) -> None:
    """Raise an error if the size of a reference differs from the number of its outputs.

    Args:
        reference: reference that a user gave.
        size: number of outputs that it is for.
        what: word for these outputs, for the message.
    """
    # An array has a size too: a user who gives values means a constant reference.
    found = None if isinstance(reference, np.ndarray) else getattr(reference, "size", None)
    if found is None:
        raise ConfigurationError(
            f"the {what} reference has to be one such as rnc.planning.Hold(values), found {short_text(reference)}"
        )
    if found != size:
        raise ConfigurationError(f"the {what} reference has {found} values for {size} outputs")


def check_target(target: object) -> None:
    """Raise an error unless the target of a controller is a kinematic controller, and no class of these.

    Args:
        target: object that a user gave.
    """
    # A class has the methods too, so the protocol alone would take it.
    if isinstance(target, type) or not isinstance(target, KinematicController):
        raise ConfigurationError(
            "target: expected a kinematic controller, such as "
            f"rnc.control.ReducingOutputController(reduced, reference), found {short_text(target)}"
        )


def elapsed_time(t: float, last: float | None) -> float:
    """Return the time since the last sample [s]; zero at the first sample.

    Args:
        t: time of the sample [s].
        last: time of the last sample [s]; None at the first one.

    Raises:
        InputError: time runs backwards.
    """
    # Adaptation integrates over this time: a first sample learns nothing.
    if last is None:
        return 0.0
    if t < last:
        raise InputError(f"time runs backwards: {t:g} s after {last:g} s")
    return t - last


def goals_at(values: np.ndarray, where: np.ndarray | slice, shape: tuple[int, ...]) -> np.ndarray:
    """Return an array of this shape with values at some indices, and NaN ("no goal") at the others.

    Args:
        values: values of the outputs with a goal.
        where: indices of these outputs.
        shape: shape of all outputs.
    """
    # Plots and errors of a run leave NaN out; a zero would be a goal.
    whole = np.full(shape, np.nan)
    whole[..., where] = values
    return whole


def command_towards(target: VelocityTarget, F: np.ndarray | None = None, T: np.ndarray | None = None) -> Command:
    """Return a command with force F or inputs T, and the record of its velocity target.

    Args:
        target: desired motion.
        F: reduced force (r,).
        T: actuator inputs (p,).
    """
    return Command(F, T, target.v2, target.x1, target.x2, target.estimates, target.prediction_error)


@printed()
class LimitedAcceleration(NamedTuple):
    """Limits of one entry of an acceleration.

    Attributes:
        name: name of the entry.
        quantity: "v2" for a reduced velocity, "v" for a velocity of the robot.
        column: column of the entry.
        lower, upper: smallest and largest acceleration [rad/s^2 or m/s^2].
        rounding: excess that counts as rounding, as a share of the larger limit. The acceleration of a run is a
            quotient of two samples, between which the inputs are held.
    """

    name: str
    quantity: Literal["v", "v2"]
    column: int
    lower: float
    upper: float
    rounding: float = 1e-4


@printed()
class MissedGoal(NamedTuple):
    """Goal of a controller from which a robot is away at the end of a run.

    Attributes:
        name: name of the goal's row.
        error: its error, in the unit of the row.
        tolerance: largest error that the goal allows.
        reason: why, for the message of the verdict; "" if it is not known.
    """

    name: str
    error: float
    tolerance: float
    reason: str = ""

    @classmethod
    def of_errors(cls, errors: Mapping[str, float], tolerance: float, reason: str = "") -> tuple[MissedGoal, ...]:
        """Return the rows whose error is above a tolerance or unknown, the largest first.

        Args:
            errors: errors by name.
            tolerance: largest error that the goal allows.
            reason: why, for the message of the verdict.
        """
        found = sorted(errors.items(), key=lambda item: -item[1])
        # ``not <=`` holds for NaN too: an error that is not known is a missed goal.
        return tuple(cls(name, error, tolerance, reason) for name, error in found if not error <= tolerance)


@runtime_checkable
class Nesting(Protocol):
    """Controller with another one as its ``target``, or the state of such a controller."""

    @property
    def target(self) -> object: ...


@runtime_checkable
class Ending(Protocol):
    """Controller that tells which of its goals a run has missed that ends in a state."""

    def missed_goals(self, t: float, q: Float[Array, " nq"], v2: Float[Array, " r"]) -> Iterable[MissedGoal]: ...


@runtime_checkable
class Limiting(Protocol):
    """Controller that limits accelerations."""

    limited_accelerations: tuple[LimitedAcceleration, ...]


@runtime_checkable
class VelocityGiving(Protocol):
    """Controller whose inputs may be velocities of the actuators."""

    gives_velocities: bool


def nested(whole: object) -> Iterator[object]:
    """Iterate over a controller or a state, and those within it as ``target``, from the outermost.

    Args:
        whole: controller or state.
    """
    # A state has the path of its controller: the state of an inner one is found by the same steps.
    yield whole
    while isinstance(whole, Nesting):
        whole = whole.target
        yield whole


@runtime_checkable
class SelfJudging(Protocol):
    """Controller that tells what happened in its own steps, such as programs that were not solved."""

    def findings(self, state: State, samples: int) -> Iterable[Finding]:
        """Return findings about the steps so far, from the state of this controller or of one around it.

        Args:
            state: state of this controller, or of one around it.
            samples: number of its steps.
        """


def findings_of(controller: object, state: State, samples: int) -> tuple[Finding, ...]:
    """Findings of a controller, and of the one within it as its ``target``, about its steps so far.

    Args:
        controller: any controller; one without ``findings`` has none.
        state: its state.
        samples: number of its steps.
    """
    # All of them: each one knows its own steps only.
    judging = (each for each in nested(controller) if isinstance(each, SelfJudging))
    return tuple(finding for each in judging for finding in each.findings(state, samples))


def missed_goals(
    controller: object, t: float, q: Float[Array, " nq"], v2: Float[Array, " r"]
) -> tuple[MissedGoal, ...]:
    """Goals that a controller, or the one within it as its ``target``, has missed if a run ends in a state.

    Args:
        controller: any controller; one without ``missed_goals`` has none.
        t: time of the end [s].
        q: configuration (nq,).
        v2: reduced velocity (r,).
    """
    # The outermost one: a controller may have other goals than its target.
    found = next((each for each in nested(controller) if isinstance(each, Ending)), None)
    return () if found is None else tuple(found.missed_goals(t, q, v2))


def limited_accelerations(controller: object) -> tuple[LimitedAcceleration, ...]:
    """Accelerations that a controller limits, or that the one within it as its ``target`` limits.

    Args:
        controller: any controller; one without limits has none.
    """
    found = next((each for each in nested(controller) if isinstance(each, Limiting)), None)
    return () if found is None else found.limited_accelerations
