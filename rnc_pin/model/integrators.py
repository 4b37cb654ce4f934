"""Runge-Kutta methods on the configuration manifold, in exponential coordinates ``q = q0 (+) u`` of a step.

Equal steps of order four, equal steps that integrate damping of any size by matrix exponentials, and adaptive steps.
``ReducedMotion`` applies them to a reduced model.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from fractions import Fraction
from functools import cache
from math import factorial
from typing import NamedTuple

import numpy as np
import pinocchio as pin
import scipy
from numpy import ndarray as Array

from rnc_pin.errors import DivergenceError
from rnc_pin.model.evaluator import Evaluator
from rnc_pin.model.reduction_kernel import curved_joints
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.robots.robot import Robot

__all__ = [
    "AdaptiveIntegrator",
    "ExponentialCoordinates",
    "ExponentialRungeKutta4",
    "LieRungeKutta4",
    "LinearPart",
    "Rate",
    "phi_functions",
]

Rate = Callable[[Array, Array], tuple[Array, Array]]

_SERIES_BELOW = 1.0  # below it closed forms and recurrences lose digits by cancellation; the series converge beyond
_TERMS = np.arange(1, 15)


class ExponentialCoordinates:
    """Exponential coordinates of a robot's configurations, joint by joint.

    With v the velocity at ``q0 (+) u`` in the joint's local frame, ``udot = J(u)^-1 v``, J the right Jacobian of the
    exponential. For SE(2), SO(3) and SE(3) alike, ``J^-1 = I + ad/2 + a ad^2 + b ad^4``, with a and b functions of the
    angle of u (Bullo and Murray 1995). Pinocchio's ``dIntegrate`` is not used: in 4.1 its error is 4e-7 for a
    free-flyer that translates while it rotates by 1e-4 rad.

    Args:
        robot: robot of the configurations.

    Example:
        >>> from rnc_pin.model.integrators import ExponentialCoordinates
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> coordinates = ExponentialCoordinates(robot)
        >>> along = np.array([1.0, 0.0, 1.0])
        >>> coordinates.rate(robot.configuration(), 0.3 * along, along).round(6)  # on a circle u = t v
        array([1., 0., 1.])
    """

    def __init__(self, robot: Robot) -> None:
        curved = curved_joints(robot.model)
        self._model, self._others = robot.model, curved is None
        self._curved = [(where, _ADJOINTS[kind]) for kind, where in curved or ()]

    def derivative(self, rate: Rate, q: Array, u: Array, y: Array) -> tuple[Array, Array]:
        """Return ``(udot, ydot)`` at ``q (+) u`` of a motion ``rate(q, y) -> (v, ydot)``.

        Args:
            rate: the motion.
            q: configuration (nq,) at the origin of the coordinates.
            u: coordinates (nv,) [rad or m].
            y: all other states, in a linear space.
        """
        v, y_dot = rate(pin.integrate(self._model, q, u), y)
        return self.rate(q, u, v), y_dot

    def rate(self, q: Array, u: Array, v: Array) -> Array:
        """``udot`` (nv,) at ``q (+) u``.

        Args:
            q: configuration (nq,) at the origin of the coordinates.
            u: coordinates (nv,) [rad or m].
            v: velocity (nv,) there, in the joints' local frames.
        """
        if self._others:  # a joint type that robot files do not have: use Pinocchio's own derivative
            return np.linalg.solve(pin.dIntegrate(self._model, q, u, pin.ArgumentPosition.ARG1), v)
        if not self._curved:
            return v
        rate = v.copy()
        for where, adjoint in self._curved:
            ad, angle = adjoint(u[where])
            a, b = _coefficients(angle)
            # Powers of ad act on the velocity one after the other: no matrix is multiplied by a matrix.
            once = ad.dot(v[where])
            twice = ad.dot(once)
            rate[where] += 0.5 * once + a * twice + b * ad.dot(ad.dot(twice))
        return rate


def check_reach(u: Array, h: float) -> None:
    """Raise an error if a step is longer than the chart.

    Args:
        u: coordinates (nv,) at the end of the step [rad or m].
        h: duration of the step [s].

    Raises:
        DivergenceError: the step is too long or not finite.
    """
    # A robot turns or drives a few radians or metres in a step: farther, the accelerations are wrong.
    limit = 100.0  # [rad or m]
    if not u.dot(u) < limit**2:  # also false for infinity and NaN
        moved = np.sqrt(u.dot(u))
        raise DivergenceError(
            f"one step of {h:g} s would move by {moved:.3g} rad or m, limit {limit:g}: reduce the step"
        )


def _coefficients(angle: float) -> tuple[float, float]:
    square = angle * angle
    if angle < _SERIES_BELOW:
        # Both series have even powers only.
        powers = square ** (_TERMS - 1)
        second, fourth = _series()
        return float(second.dot(powers)), float(fourth.dot(powers[:-1]))
    # Closed forms of the coefficients, Bullo and Murray (1995), in half angles.
    half = 0.5 * angle
    alpha, beta = half / np.tan(half), (half / np.sin(half)) ** 2
    return (2 * (1 - alpha) + 0.5 * (alpha - beta)) / square, ((1 - alpha) + 0.5 * (alpha - beta)) / square**2


@cache
def _series() -> tuple[Array, Array]:
    """Coefficients of the series of a and b in the square of the angle."""
    scaled = [Fraction(1)]  # B_n / n! of the Bernoulli numbers: the series x / (exp(x) - 1); scipy.special loads slowly
    for n in range(1, 2 * len(_TERMS) + 1):
        scaled.append(-sum((each / factorial(n + 1 - k) for k, each in enumerate(scaled)), Fraction(0)))
    bernoulli = np.abs(np.array(scaled[2::2], dtype=float))
    return (2 - _TERMS) * bernoulli, ((1 - _TERMS) * bernoulli)[1:]


def _planar(u: Array) -> tuple[Array, float]:
    x, y, turn = u
    return np.array([[0.0, -turn, y], [turn, 0.0, -x], [0.0, 0.0, 0.0]]), abs(turn)


def _spherical(u: Array) -> tuple[Array, float]:
    return pin.skew(u), float(np.sqrt(u.dot(u)))


def _free(u: Array) -> tuple[Array, float]:
    return pin.Motion(u).action, float(np.sqrt(u[3:].dot(u[3:])))


_ADJOINTS = {"JointModelPlanar": _planar, "JointModelSpherical": _spherical, "JointModelFreeFlyer": _free}


# ------------------------------------------------------------------ equal steps

DEFAULT_TOLERANCE = 1e-7
"""Largest error that the integration adds in a second [m, rad, m/s or rad/s]."""


class LieRungeKutta4:
    """Classical Runge-Kutta method in the coordinates ``q = q0 (+) u`` of one step (Munthe-Kaas 1999).

    The rates of the coordinates use the exact right Jacobian of the exponential (``ExponentialCoordinates``). So the
    order is four for planar, spherical and free-flying joints too, and quaternions keep unit length.

    Args:
        robot: robot of the configurations.

    Example:
        >>> from rnc_pin.model.integrators import LieRungeKutta4
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> integrator = LieRungeKutta4(robot)
        >>> circle = lambda q, y: (np.array([1.0, 0.0, 1.0]), -y)
        >>> q, y = integrator.step(circle, robot.configuration(), y=np.ones(1), h=0.1)
        >>> q.round(6)  # x = sin h, y = 1 - cos h
        array([0.099833, 0.004996, 0.995004, 0.099833])
        >>> y.round(5)  # exp(-h)
        array([0.90484])
    """

    def __init__(self, robot: Robot) -> None:
        self._model = robot.model
        self._coordinates = ExponentialCoordinates(robot)

    def step(
        self, rate: Rate, q: Array, y: Array, h: float, first: tuple[Array, Array] | None = None
    ) -> tuple[Array, Array]:
        """Return the state after a time h.

        Args:
            rate: ``rate(q, y) -> (v, ydot)``.
            q: configuration (nq,).
            y: all other states, in a linear space.
            h: step [s].
            first: rate at (q, y), if already known.

        Raises:
            DivergenceError: the step is longer than the chart.
        """
        return self.measured_step(rate, q, y, h, 0, first)[:2]

    def measured_step(
        self, rate: Rate, q: Array, y: Array, h: float, r: int, first: tuple[Array, Array] | None = None
    ) -> tuple[Array, Array, float]:
        """Return the state after a time h, and the roughness of the step.

        The roughness is h times the largest of ``|k3 - k2|`` and ``|k1 - k2 - k3 + k4|`` over the slopes k of the
        configuration and of the first r of y. It is of the order h^3 where the error is of the order h^5.

        Args:
            rate, q, y, h, first: as for ``step``.
            r: number of states of y that count.

        Raises:
            DivergenceError: as ``step``.
        """
        # Classical stages: the start, twice the middle, the end.
        slopes = [rate(q, y) if first is None else first]
        for fraction in (0.5, 0.5, 1.0):
            slope, y_slope = slopes[-1]
            u = (fraction * h) * slope
            check_reach(u, h)
            slopes.append(self._coordinates.derivative(rate, q, u, y + (fraction * h) * y_slope))
        sides = zip(*slopes, strict=True)
        u, by = ((h / 6) * (one + 2.0 * two + 2.0 * three + four) for one, two, three, four in sides)
        # Differences of the stages show what a step misses: where they agree, the rate is nearly constant or linear in
        # time.
        one, two, three, four = (np.concatenate([slope, y_slope[:r]]) for slope, y_slope in slopes)
        largest = max(np.abs(three - two).max(initial=0.0), np.abs(one - two - three + four).max(initial=0.0))
        return pin.integrate(self._model, q, u), y + by, h * float(largest)


# ------------------------------------------------------------------ equal steps with damping


class LinearPart(NamedTuple):
    """Linear part L of the motion, frozen during a step: decay of the velocities w, and the states that they drive.

    Attributes:
        modes: (r, r), ``w = modes @ a``; kinetic energy is ``|a|^2 / 2`` at the start of the step.
        inverse: (r, r), ``a = inverse @ w``.
        decay: decay rates (r,) [1/s], not negative: ``adot = -decay a`` plus nonlinear terms.
        u: (nv, r), rate of the configuration's coordinates per mode.
        others: (s, r), rate of the other integrals per mode.
    """

    modes: Array
    inverse: Array
    decay: Array
    u: Array
    others: Array


class ExponentialRungeKutta4:
    """Method ETD4RK (Cox and Matthews 2002, eq. 26 to 29) in the coordinates ``q = q0 (+) u`` of one step.

    The state is (u, y) with ``y = [w, others]``, ``zdot = L z + N(z)``. L is frozen at the start of the step.
    L contains the damping, so damping does not limit the step size. For a constant L, motion under constant forces is
    exact, including the steady speed. Otherwise the order is four while ``decay h`` is moderate.

    Args:
        robot: robot of the configurations.

    Example:
        >>> from rnc_pin.model.integrators import ExponentialRungeKutta4, LinearPart
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> along, one = np.array([[1.0], [0.0], [0.0]]), np.eye(1)
        >>> damped = LinearPart(one, one, decay=np.array([100.0]), u=along, others=np.zeros((0, 1)))
        >>> rate = lambda q, y: (along @ y, 200.0 - 100.0 * y)
        >>> integrator = ExponentialRungeKutta4(robot)
        >>> q, y, roughness = integrator.step(rate, damped, robot.configuration(), y=np.zeros(1), h=1.0)
        >>> y.round(6), q[:1].round(6)  # steady speed 2 m/s after 1/100 s
        (array([2.]), array([1.98]))
    """

    def __init__(self, robot: Robot) -> None:
        self._model = robot.model
        self._coordinates = ExponentialCoordinates(robot)

    def step(self, rate: Rate, linear: LinearPart, q: Array, y: Array, h: float) -> tuple[Array, Array, float]:
        """Return the state after a time h, and the roughness of the step as ``LieRungeKutta4.measured_step``.

        Args:
            rate: ``rate(q, y) -> (v, ydot)``.
            linear: linear part at (q, y).
            q: configuration (nq,).
            y: velocities w (r,), then all other states (s,), in a linear space.
            h: step [s].

        Raises:
            DivergenceError: the step is longer than the chart.
        """
        n, r = len(linear.u), len(linear.decay)
        # Positions and integrals are driven by the decaying velocities: their part of exp(hL) follows from the same
        # modes.
        follow = np.vstack([linear.u, linear.others])
        half, whole = phi_functions(-0.5 * h * linear.decay, 2), phi_functions(-h * linear.decay, 4)

        def slope(x: Array) -> Array:
            u, a = x[:n], x[n : n + r]
            check_reach(u, h)
            y_at = np.concatenate([linear.modes @ a, x[n + r :]])
            u_dot, y_dot = self._coordinates.derivative(rate, q, u, y_at)
            return np.concatenate([u_dot, linear.inverse @ y_dot[:r], y_dot[r:]])

        def linear_slope(x: Array) -> Array:
            a = x[n : n + r]
            following = follow @ a
            return np.concatenate([following[:n], -linear.decay * a, following[n:]])

        def phi(k: int, values: list[Array], time: float, x: Array) -> Array:
            """``time phi_k(time L) x``."""
            a = x[n : n + r]
            others = np.concatenate([x[:n], x[n + r :]]) / factorial(k) + time * (follow @ (values[k + 1] * a))
            return time * np.concatenate([others[:n], values[k] * a, others[n:]])

        start = np.concatenate([np.zeros(n), linear.inverse @ y[:r], y[r:]])
        first, flows = slope(start), linear_slope(start)
        # N is the part of the rate that the linear part leaves: only its change within the step makes an error.
        N = first - flows
        at_a = start + phi(1, half, 0.5 * h, first)
        N_a = slope(at_a) - linear_slope(at_a)
        at_b = start + phi(1, half, 0.5 * h, flows + N_a)
        N_b = slope(at_b) - linear_slope(at_b)
        at_c = at_a + phi(1, half, 0.5 * h, linear_slope(at_a) + 2.0 * N_b - N)
        N_c = slope(at_c) - linear_slope(at_c)
        end = (
            start
            + phi(1, whole, h, first)
            + phi(2, whole, h, 2.0 * (N_a + N_b) - 3.0 * N - N_c)
            + phi(3, whole, h, 4.0 * (N - N_a - N_b + N_c))
        )
        check_reach(end[:n], h)
        y = np.concatenate([linear.modes @ end[n : n + r], end[n + r :]])
        uneven, bent = (np.abs(each[: n + r]).max(initial=0.0) for each in (N_b - N_a, N - N_a - N_b + N_c))
        return pin.integrate(self._model, q, end[:n]), y, h * float(max(uneven, bent))


def phi_functions(x: Array, last: int) -> list[Array]:
    """Functions ``phi_0(x) = exp(x)``, ``phi_k+1(x) = (phi_k(x) - 1/k!) / x`` up to ``last``, for x <= 0.

    They are Kummer's functions ``1F1(1; k + 1; x) / k!``, exact to rounding near zero too.

    Args:
        x: numbers that are not positive, of any shape.
        last: index of the last function.
    """
    orders = range(1, last + 1)
    return [np.exp(x), *(scipy.special.hyp1f1(1.0, k + 1.0, x) / factorial(k) for k in orders)]


# ------------------------------------------------------------------ adaptive steps

LocalRate = Callable[[float, Array, Array], Array]
Settle = Callable[[Array, Array], tuple[Array, Array]]
Samples = tuple[Array, Array, Array]


class AdaptiveIntegrator:
    """SciPy's eighth-order Dormand-Prince method with step-size control, in local coordinates.

    Each step runs in the coordinates ``q = q_k (+) u`` about the configuration at its start. The next chart is centred
    at its end. Quaternions therefore keep unit length, and no step leaves its chart. The next step starts from the
    result of ``settle``.

    Args:
        robot: robot of the configurations.
        local_rate: ``local_rate(t, q_k, x) -> xdot`` of coordinates ``x = (u, y)``; y holds all other states, in a
            linear space.
        rtol, atol: relative and absolute tolerance of a step. Only the absolute one applies to positions, because u
            starts at zero.
        settle: maps (q, y) at the end of a step to an equivalent state, for example in another chart.

    Example:
        >>> from rnc_pin.model.integrators import AdaptiveIntegrator, ExponentialCoordinates
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> exponential, circle = ExponentialCoordinates(robot), lambda q, y: (np.array([1.0, 0.0, 1.0]), -y)
        >>> rate = lambda t, q, x: np.concatenate(exponential.derivative(circle, q, x[:3], x[3:]))
        >>> integrator = AdaptiveIntegrator(robot, rate, rtol=1e-10, atol=1e-10)
        >>> blocks = list(integrator.run(np.array([0.0, 1.0, np.pi]), robot.configuration(), np.ones(1)))
        >>> t, q, y = (each[-1] for each in blocks[-1])
        >>> q.round(6) + 0.0, y.round(6)  # half a circle of radius 1, and exp(-pi)
        (array([ 0.,  2., -1.,  0.]), array([0.043214]))
    """

    def __init__(
        self, robot: Robot, local_rate: LocalRate, rtol: float, atol: float, settle: Settle | None = None
    ) -> None:
        self._model, self._nv, self._local_rate = robot.model, robot.nv, local_rate
        self._rtol, self._atol, self._settle = rtol, atol, settle

    def run(self, times: Array, q0: Array, y0: Array) -> Iterator[Samples]:
        """Yield the states (t, q, y) at the increasing ``times`` in blocks (count, ...); the first is (q0, y0).

        Between the ends of steps, the method's seventh-order interpolation applies. A block has the samples of one
        step before its end, in the chart of this step, or the sample at its end.

        Args:
            times: increasing times (N,) [s].
            q0: configuration (nq,) at the first one.
            y0: all other states there.

        Raises:
            DivergenceError: steps become too short, for example near a singularity.
        """
        q, nv = np.array(q0, dtype=float), self._nv

        def chart_rate(t: float, x: Array) -> Array:
            return self._local_rate(t, q, x)

        # Each chart begins at its own origin.
        x0 = np.concatenate([np.zeros(nv), y0])
        yield _block(times[:1], q, x0[nv:])
        span = float(times[0]), x0, float(times[-1])
        solver = scipy.integrate.DOP853(chart_rate, *span, rtol=self._rtol, atol=self._atol)
        # Near a singularity the steps shrink without end: so many in a row that are a billionth of the run end it.
        shortest, patience = 1e-9 * float(times[-1] - times[0]), 50
        due = 1
        short = 0
        while due < len(times):
            solver.step()
            short = short + 1 if solver.step_size is None or solver.step_size < shortest else 0
            if solver.status == "failed" or short > patience:
                raise DivergenceError(
                    "the step size is too small: the motion runs into a singularity, or the "
                    f"tolerances (rtol {self._rtol:g}, atol {self._atol:g}) are finer than rounding allows",
                    time=float(solver.t),
                )
            end = due + int(np.searchsorted(times[due:], solver.t))
            if end > due:
                x = solver.dense_output()(times[due:end])
                inside = np.array([pin.integrate(self._model, q, u) for u in np.ascontiguousarray(x[:nv].T)])
                yield times[due:end], inside, np.ascontiguousarray(x[nv:].T)
                due = end
            # The next chart; chart_rate sees the new q.
            q = pin.integrate(self._model, q, solver.y[:nv])
            y = solver.y[nv:]
            if self._settle is not None:
                q, y = self._settle(q, y)
            # A chart per step: local coordinates stay small, and far from where their derivative is singular.
            solver.y = np.concatenate([np.zeros(nv), y])
            if due < len(times) and times[due] == solver.t:
                yield _block(times[due : due + 1], q, y)
                due += 1
            if due < len(times):
                # The solver begins a step with the slope at the end of the last one, which was in the old chart.
                solver.f = chart_rate(solver.t, solver.y)


def _block(times: Array, q: Array, y: Array) -> Samples:
    """Block of one sample."""
    return times, q[None].copy(), np.array(y[None], dtype=float)


# ------------------------------------------------------------------ motion of a reduced model


def state_rates(state: StateEvaluation, T: Array, damping: Array | None, external: Array | None) -> tuple[Array, Array]:
    """Full velocity at a state, and the rates of v2, the integrals of J1 v, the time if rheonomic, and the work.

    Args:
        state: evaluation of the states.
        T: actuator inputs (..., p) [N or N m].
        damping: viscous coefficients (nv,); None for zero.
        external: generalized forces (..., nv) in addition to inputs; None for zero.
    """
    v, v2_dot, power = state.flow(T, damping, external)
    return v, np.concatenate([v2_dot, state.v1, [power] if state.t is None else [1.0, power]])


class ReducedMotion:
    """Motion of reductions of one robot under constant inputs: rates and equal steps.

    The state is q with y: reduced velocities v2, integrals of the rates of the vertical outputs, the time if the
    constraints depend on it, and the work, (r + k + 1,) or (r + k + 2,). The compiled kernel computes rates and steps
    by the same methods. Where it does not know a row, or leaves a state to NumPy, the formulas here decide.

    Args:
        robot: robot of the reductions.
        damping: viscous coefficients (nv,); None for zero.
    """

    def __init__(self, robot: Robot, damping: Array | None = None) -> None:
        self._damping, self._integrator = damping, LieRungeKutta4(robot)
        self._coordinates = ExponentialCoordinates(robot)

    def rate(self, by: Evaluator, q: Array, y: Array, T: Array, external: Array | None = None) -> tuple[Array, Array]:
        """Full velocity (nv,), and the rates of y.

        Args:
            by: evaluator of the reduction.
            q: configuration (nq,); all arrays are contiguous floats.
            y: state.
            T: actuator inputs (p,).
            external: generalized forces (nv,) in addition to inputs and damping; None for zero.
        """
        # The time is part of y, so that stages of a step have times of their own.
        n, v2, t = by.data.n, y[: by.data.r], float(y[-2]) if by.data.rheonomic else None
        # In the order in which an integrator has them: v, then the rates of its state.
        found = np.empty(n + len(y))
        if by.calls.state_derivative(q, None, v2, T, external, self._damping, by.rates_at(t), found):
            return found[:n], found[n:]
        return state_rates(StateEvaluation.at(by, q, v2, t=t), T, self._damping, external)

    def local_rate(self, by: Evaluator, q: Array, x: Array, T: Array) -> Array:
        """Rates of local coordinates ``x = (u, y)`` at ``q (+) u``.

        Args:
            by: evaluator of the reduction.
            q: configuration (nq,) at the centre; all arrays are contiguous floats.
            x: coordinates u (nv,), then y.
            T: actuator inputs (p,).
        """
        n, found = by.data.n, np.empty(len(x))
        rates = by.rates_at(float(x[-2])) if by.data.rheonomic else None
        # One call, and not one for the rate with the coordinates in Python: an adaptive step has twelve stages.
        if by.calls.state_derivative(q, x[:n], x[n : n + by.data.r], T, None, self._damping, rates, found):
            return found
        return np.concatenate(self._coordinates.derivative(lambda at, y: self.rate(by, at, y, T), q, x[:n], x[n:]))

    def steps(self, by: Evaluator, q: Array, y: Array, T: Array, h: float, count: int) -> tuple[Array, Array, float]:
        """Configuration and y after equal Runge-Kutta steps, and the sum of their roughness.

        Args:
            by: evaluator of the reduction.
            q: configuration (nq,); all arrays are contiguous floats.
            y: state.
            T: actuator inputs (p,), constant.
            h: duration of each step [s].
            count: number of steps.

        Raises:
            DivergenceError: accelerations are not finite, or a step is longer than the integrator's chart.
        """
        kernel, rates = by.kernel, None
        if by.data.rheonomic and kernel is not None and kernel.fused:
            # Constraints over time need their right-hand side at the stages of each step: its start, middle and end.
            rates = kernel.rates_over_time((y[-2] + 0.5 * h * np.arange(2 * count + 1)).tolist())
        found = np.empty(q.shape), np.empty(y.shape), np.zeros(1), np.empty(1)
        # The kernel's Runge-Kutta steps have no damping, which would limit the step: it has a method of its own.
        if self._damping is None:
            by.calls.integrate((by.calls,), q, y, T, h, count, None, *found, rates, None, None, None)
        q_end, y_end, status, rough = found
        if status[0]:
            return q_end, y_end, float(rough[0])
        roughness = 0.0
        for _ in range(count):
            q, y, one = self._integrator.measured_step(lambda q, y: self.rate(by, q, y, T), q, y, h, by.data.r)
            roughness += one
        return q, y, roughness

    def trace(
        self, by: Evaluator, q: Array, v2: Array, T: Array, h: float, count: int
    ) -> tuple[Array, Array, Array, Array, Array]:
        """States along equal Runge-Kutta steps without damping, for constraints that do not depend on time.

        Args:
            by: evaluator of the reduction.
            q, v2: configuration (nq,) and reduced velocities (r,) at the start.
            T: actuator inputs (p,), constant, or those of each step (count, p).
            h: duration of each step [s].
            count: number of steps.

        Returns:
            q (count + 1, nq) and v2 (count + 1, r); v (count, nv) and rates of v2 (count, r) at the start of each step;
            the way (count, nv) to its end.
        """
        nq, n, r, s = len(q), by.data.n, by.data.r, by.data.r + by.data.vertical.size + 1
        record = np.zeros((count + 1, nq + 2 * (s + n)))
        record[0, :nq], record[0, nq : nq + r] = q, v2
        before, after, inputs = record[:-1], record[1:], np.ascontiguousarray(np.broadcast_to(T, (count, by.data.p)))
        if not by.calls.trace(before, inputs, np.full(count, h), after):
            for begin, end, held in zip(before, after, inputs, strict=True):
                start = begin[:nq].copy(), begin[nq : nq + s].copy()
                end[nq + s : -n] = np.concatenate(self.rate(by, *start, held))
                end[:nq], end[nq : nq + s], _ = self.steps(by, *start, held, h, 1)
                end[-n:] = pin.difference(by.data.robot.model, start[0], end[:nq])
        v, v2_dot = after[:, nq + s : nq + s + n], after[:, nq + s + n : nq + s + n + r]
        return record[:, :nq], record[:, nq : nq + r], v, v2_dot, after[:, -n:]
