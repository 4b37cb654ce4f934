"""Functions of the configuration that a user wrote: their rates, and a check of the rates that the user gave.

The rate along v is a central difference of order eight on the configuration manifold, with an error estimate.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
import pinocchio as pin
from numpy import ndarray as Array

from rnc_pin.errors import ConstraintError, InputError, SingularityError, short_text
from rnc_pin.model.kinematics import over_states
from rnc_pin.robots.robot import Robot

STEP = 0.01  # [rad or m]
Field = Callable[[Array], Array]
Function = Callable[..., object]  # of q, or of q and t
Rate = Callable[..., object]  # of q and v, or of q, v and t

_STEPS = (0.3 * STEP, STEP, 0.1 * STEP)  # [rad or m]


def central_difference(field: Callable[[float], Array], step: float) -> Array:
    """Derivative of ``field(s)`` at zero.

    Args:
        field: function of one number.
        step: distance between evaluations.
    """
    stencil = ((1, 4 / 5), (2, -1 / 5), (3, 4 / 105), (4, -1 / 280))  # of order eight
    terms = [weight * (field(k * step) - field(-k * step)) for k, weight in stencil]
    return np.asarray(np.sum(terms, axis=0) / step)


def gradient(model: pin.Model, field: Field, q: Array, step: float = STEP) -> Array:
    """Derivatives (..., nv) of ``field(q)`` (...) along every tangent direction.

    Args:
        model: Pinocchio's model of the robot.
        field: function of one configuration.
        q: configuration (nq,).
        step: distance between evaluations [rad or m].
    """
    return _slopes(lambda by: field(pin.integrate(model, q, by)), model.nv, step)


def gradient_with_error(model: pin.Model, field: Field, q: Array) -> tuple[Array, float]:
    """Gradient as in ``gradient``, and the largest difference between the results of two step lengths.

    Args:
        model: Pinocchio's model of the robot.
        field: function of one configuration.
        q: configuration (nq,).
    """
    return slopes_with_error(lambda by: field(pin.integrate(model, q, by)), model.nv)


def slopes_with_error(field: Field, n: int) -> tuple[Array, float]:
    """Derivatives (..., n) of a function of displacements (n,) at zero, and their error as in ``gradient_with_error``.

    Args:
        field: function of a displacement.
        n: its size.
    """
    # The error of order eight falls by 256 with half the step: the difference is that of the coarse one.
    coarse, fine = _slopes(field, n, 0.8 * STEP), _slopes(field, n, 0.4 * STEP)
    return fine, float(np.abs(fine - coarse).max(initial=0.0))


def _slopes(field: Field, n: int, step: float) -> Array:
    """Derivatives (..., n) of a function of displacements (n,), at zero."""

    def along(unit: Array) -> Array:
        return central_difference(lambda s: field(s * unit), step)

    return np.stack([along(unit) for unit in np.eye(n)], axis=-1)


class UserFunction:
    """Function of a user whose results are admitted as arrays of one shape.

    Args:
        function: the function.
        shape: shape of its results.
        what: the function in messages.

    Raises (every call):
        InputError: the result is no array of numbers, or has another shape.
    """

    def __init__(self, function: Function, shape: tuple[int, ...], what: str) -> None:
        self._function, self.shape, self._what = function, shape, what

    def __call__(self, *state: object) -> Array:
        found = self._function(*state)
        try:
            array = np.array(found, dtype=float)  # the function may use its memory again
        except (TypeError, ValueError):
            raise InputError(
                f"{self._what} returned {short_text(found)}, expected an array of shape {self.shape}"
            ) from None
        if array.shape != self.shape:
            raise InputError(f"{self._what} returned shape {array.shape}, expected {self.shape}")
        return array

    def over(self, *states: Array) -> Array:
        """Results (..., *shape) over the leading axes of the arguments.

        Args:
            states: arrays (..., size) of the arguments.
        """
        return over_states(self, self.shape, *states)


def derived_rate(robot: Robot, function: Callable[..., Array], label: str, timed: bool = False) -> Rate:
    """Rate of a user's function along v: ``rate(q, v)``, for a function without a rate of its own.

    Args:
        robot: the robot.
        function: values at one configuration, ``function(q)``, or ``function(q, t)``; then ``rate(q, v, t)``.
        label: the function in messages.
        timed: True for a function of q and t; its rate includes the flow of time.

    Raises:
        ConstraintError: the function has no rate at random configurations, e.g. because it jumps.
    """
    for q, v, t in _random_states(robot, function, timed):
        found, doubt = _difference(robot.model, function, q, v, t)
        rough = 1e-3  # relative error estimate above which the function jumps, or has a kink
        if doubt > rough * (1.0 + np.abs(found).max(initial=0.0)):
            raise ConstraintError(
                f"{label} has no rate that differences can find: two step lengths differ by {doubt:.1e}; "
                "pass its rate as well"
            )
    return partial(_flow, robot.model, function, _STEPS[0])


def admitted_rate(
    robot: Robot, function: UserFunction, given: Rate | None, label: str, whose: str, names: Sequence[str], timed: bool
) -> UserFunction:
    """Return the rate of a user's function: the given one if it agrees with differences, or a derived one.

    Args:
        robot: the robot.
        function: the function.
        given: rate that the user gave, if any.
        label: name of the function in messages.
        whose: words after it.
        names: name of each row of its values.
        timed: True for a function of q and t.
    """
    what = f"{label}_dot(q, v){whose}"
    # A rate that is wrong by a sign leaves the function right: only differences at moving states show it.
    if given is not None:
        check_rate(robot, function, given, (f"{label}(q)", what), names, timed=timed)
    return UserFunction(given or derived_rate(robot, function, f"{label}(q){whose}", timed), function.shape, what)


def check_rate(
    robot: Robot,
    function: Function,
    rate: Rate,
    labels: tuple[str, str],
    names: Sequence[str],
    angular: bool = False,
    timed: bool = False,
) -> None:
    """Compare a rate that the user gave with differences of the function at two random states.

    Args:
        robot: the robot.
        function: values at one configuration, ``function(q)``.
        rate: the user's rate of these values, ``rate(q, v)``.
        labels: the function and its rate in messages.
        names: name of each row of the values.
        angular: True if the values are angles, which may jump by a full turn.
        timed: True for functions ``function(q, t)`` and ``rate(q, v, t)``.

    Raises:
        ConstraintError: the rate is wrong; the message has the row, the entry and both values.
    """
    for q, v, t in _random_states(robot, function, timed):
        expected, doubt = _difference(robot.model, function, q, v, t, angular)
        given = np.asarray(rate(q, v, *t), dtype=float)
        if given.shape != expected.shape:
            return  # another message tells the shape
        # Rounding and differences explain so much; an error estimate may be too small by so many times.
        unexplained, trust = 1e-6, 100.0
        allowed = unexplained * (1.0 + np.abs(expected).max(initial=0.0)) + trust * doubt
        wrong = ~(np.abs(given - expected) <= allowed)
        if wrong.any():
            row, *entry = np.unravel_index(np.argmax(np.where(wrong, np.abs(given - expected), 0.0)), given.shape)
            place = f"row '{names[int(row)]}'" + (f", entry {entry[0]}" if entry else "")
            raise ConstraintError(
                f"{labels[1]} is not the rate of {labels[0]}: {place} is {given[row, *entry]:.6g}, differences give "
                f"{expected[row, *entry]:.6g} (at q = {np.round(q, 3).tolist()}, v = {np.round(v, 3).tolist()})"
            )


def _random_states(
    robot: Robot, function: Function, timed: bool = False
) -> list[tuple[Array, Array, tuple[float, ...]]]:
    """Two random states (q, v, times) at which the function is finite; fewer if it rarely is."""
    generator, found, wanted, draws = np.random.default_rng(0), [], 2, 8
    for _ in range(draws):
        q, v = robot.random_configuration(generator, 1.0), generator.uniform(-1.0, 1.0, robot.nv)
        t: tuple[float, ...] = (float(generator.uniform(0.2, 1.0)),) if timed else ()
        try:  # differences need a neighbourhood
            near = [function(pin.integrate(robot.model, q, share * v), *t) for share in (-0.1, 0.0, 0.1)]
        except SingularityError:
            continue
        if np.isfinite(np.asarray(near, dtype=float)).all():
            found.append((q, v, t))
        if len(found) == wanted:
            break
    return found


def _difference(
    model: pin.Model, function: Function, q: Array, v: Array, t: tuple[float, ...], angular: bool = False
) -> tuple[Array, float]:
    """Rate by differences, from the best pair of step lengths, and its error estimate."""
    here = np.array(function(q, *t), dtype=float)

    def values(at: Array, *t: float) -> Array:
        # An angle may jump by a full turn between two points of the stencil: differences from here are wrapped.
        change = np.asarray(function(at, *t), dtype=float) - here
        return np.remainder(change + np.pi, 2 * np.pi) - np.pi if angular else change

    found = [_flow(model, values, step, q, v, *t) for step in _STEPS]
    doubts = [float(np.abs(found[0] - other).max(initial=0.0)) for other in found[1:]]
    # A longer step suffers from curvature, a shorter one from rounding: the pair that agrees better decides.
    return found[0] if doubts[0] <= doubts[1] else found[2], min(doubts)


def _flow(model: pin.Model, values: Callable[..., Array], step: float, q: Array, v: Array, *t: float) -> Array:
    """Rate of values along v, and of time if they depend on it, by differences."""
    # Along a unit vector, so that the step has the same size for slow and for fast velocities.
    speed = float(np.linalg.norm(v))
    direction = v / speed if speed else v  # at rest all differences are zero
    rate = speed * central_difference(lambda s: values(pin.integrate(model, q, s * direction), *t), step)
    return rate + central_difference(lambda s: values(q, *(now + s for now in t)), step) if t else rate
