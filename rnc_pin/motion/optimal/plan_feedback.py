"""Feedback along plans: the gains of a plan, or those of a time-varying linear-quadratic regulator.

After the end of a plan, the motion stops within the accelerations of the plan, and a regulator at rest holds it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import cached_property
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from rnc_pin.array_shapes import Array, Float
from rnc_pin.control.controller import Command, Description, listed
from rnc_pin.errors import ConfigurationError, ConstraintError
from rnc_pin.model.evaluation_results import Measurement
from rnc_pin.model.input_validation import Positive
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.motion.optimal.costs import Weight, weights_of
from rnc_pin.motion.optimal.guesses import inputs_for
from rnc_pin.motion.optimal.interior_point import RiccatiFactors
from rnc_pin.motion.optimal.motion_plan import MotionPlan
from rnc_pin.motion.planning.action_models import ActionModel, Nodes, action_model
from rnc_pin.printing import ReprMixin

_HORIZON = 1000  # intervals of the regulator at rest
FREQUENCY = 10.0  # of the closed loop [rad/s]: samples up to its inverse, 0.1 s, keep a double integrator stable
_SMALL, _LEAST = 1e-6, 1e-9  # of the cost of an input, and of the largest: inputs that move the same share their work
_RESERVE = 1e-3  # of a limit or range, of which feedback keeps away where its plan does, for motions within samples
_ROUNDING = 1e-12  # part of the largest velocity of the plan that is rounding


RegulatorWeights = float | tuple[Weight, Weight]
"""Natural frequency of a regulator [rad/s], or weights of states and inputs."""
_Numbers = float | tuple[Array, Array]


class PlanEnd:
    """Stop after the end of a plan.

    The reduced velocities fall linearly to zero. No acceleration exceeds the largest of the plan, unless
    the stop would take longer than the plan. A plan that ends at rest stands still, and in the kinematic form the
    velocity jumps to zero, as it jumps between intervals. The inputs are
    those of this motion; of an underactuated system, those that come nearest to it.

    Args:
        model: action model of the plan.
        plan: the plan.

    Attributes:
        duration: time until the motion stands still [s].
    """

    def __init__(self, model: ActionModel, plan: MotionPlan) -> None:
        self._model, self._plan, self._driven = model, plan, action_model(model.reduced, "acceleration")
        # A plan that ends at rest by its goal has rounding of the solver as its last velocity: that is no motion.
        w = plan.w[-1:] if model.nw else np.zeros((1, model.r))
        largest = np.abs(plan.acceleration[:, :, : model.r]).max(axis=(0, 1))
        speed = np.where(np.abs(w[0]) > _ROUNDING * np.abs(plan.w).max(initial=0.0), np.abs(w[0]), 0.0)
        tiny = 1e-300  # [rad/s^2 or m/s^2], where a plan stands
        least = np.maximum(speed / plan.duration, tiny)  # a stop takes no longer than the plan
        total, h = float((speed / np.maximum(largest, least)).max()), float(plan.time[-1] - plan.time[-2])
        at_rest = 1e-3  # part of an interval: a plan that brakes in less time ends at rest
        count = int(np.ceil(total / h - 1e-9)) if total >= at_rest * h else 0
        self.duration = total if count else 0.0
        self._h, self._rates = total / max(count, 1), np.repeat(-w / (total or 1.0), max(count, 1), axis=0)
        q, w = self._driven.rollout(Nodes(plan.q[-1:], w), self._rates[None, :count], self._h)
        self._nodes = Nodes(q[0], w[0])

    def at(self, since: float) -> tuple[Nodes, Array]:
        """State (one node) and input at a time after the end of the plan [s]."""
        if since >= self.duration:
            return self._standing
        now, k = self._driven.during(self._nodes, self._rates, self._h, since)
        middle, _ = self._driven.during(self._nodes, self._rates, self._h, (k + 0.5) * self._h)
        return now, self._input(middle, self._rates[:1])  # one for the whole interval

    def _input(self, at: Nodes, rates: Array) -> Array:
        """Input of the form that gives reduced accelerations (1, r), or comes nearest to them."""
        if self._model.form == "acceleration":
            return rates[0]
        if self._model.form == "dynamic":
            with suppress(ConstraintError):
                return inputs_for(self._model, at, rates)[0]
        return np.array(self._plan.u[-1])

    @cached_property
    def _standing(self) -> tuple[Nodes, Array]:
        """State at rest after the stop, and the input that holds it."""
        zeros = np.zeros((1, self._model.nw))
        rest = Nodes(self._nodes.q[-1:], zeros)
        return rest, self._input(rest, zeros) if self._model.form == "dynamic" else np.zeros(self._model.nu)


class FeedbackState(NamedTuple):
    """Last sample of a feedback along a plan."""

    time: float
    """Its time [s]."""
    u: Float[Array, " nu"]
    """Its input, in the form of the plan."""
    dx: Float[Array, " nx"]
    """Measured state minus the planned one."""


def mean_input(time: Float[Array, " K1"], u: Float[Array, "K nu"], t: float, dt: float, after: Array) -> Array:
    """Return the mean of planned inputs over a sample, of which a part may be after the plan.

    Args:
        time: ends of the intervals [s].
        u: their inputs.
        t: begin of the sample [s].
        dt: its duration [s].
        after: input after the last interval (nu,).
    """
    # Commands are held: the input of the interval at the begin of a sample would be late by half of a sample.
    ends = np.clip(time, t, t + dt) - t
    return np.asarray(np.diff(ends) @ u / dt + (1.0 - ends[-1] / dt) * after)


class BoundedCommands:
    """Commands within bounds of inputs, and of outputs and reduced velocities as far as inputs can keep them.

    Outputs and velocities approach a bound no faster than a critically damped motion ends there. If they are ahead of
    the plan by less than half of the room that it leaves, they may also approach the plan.

    Args:
        model: action model of the inputs.
        bounds: bounds (quantity, name, lower, upper); others than "input", "velocity" and "output" are left out.
        plan: outputs and their rates at the nodes of a plan (..., k). It leaves no room where they are not known.
        bandwidth: decay rate of the velocity error in the kinematic form [1/s].
    """

    def __init__(
        self,
        model: ActionModel,
        bounds: Iterable[tuple[str, str, float, float]],
        plan: tuple[Array, Array] | None = None,
        bandwidth: float = 20.0,
    ) -> None:
        self._model, self._driven = model, action_model(model.reduced, "acceleration")
        approach = 50.0  # rate of the motion that ends at a bound [1/s], if samples are shorter than 10 ms
        self._bandwidth, self._approach = bandwidth, approach if model.nw else bandwidth / 4.0
        reduced, kinematic = model.reduced, model.form == "kinematic"
        outputs = (*reduced.reducing.names, *reduced.vertical.names)
        velocities = model.input_names if kinematic else reduced.reducing.names
        own = {"output": outputs, "velocity": velocities, "input": model.input_names}
        self._lower, self._upper = np.full(model.nu, -np.inf), np.full(model.nu, np.inf)
        rows = []
        for quantity, name, low, high in bounds:
            # Names decide which bounds hold: those of joints that are no outputs of the model have no row here.
            if name not in own.get(quantity, ()):
                continue
            k = own[quantity].index(name)
            if quantity == "input" or (kinematic and quantity == "velocity"):
                self._lower[k], self._upper[k] = max(self._lower[k], low), min(self._upper[k], high)
            elif np.isfinite([low, high]).any():
                rows.append((quantity == "velocity", k, low, high))
        table = np.array(sorted(rows, key=lambda row: row[0]), dtype=float).reshape(-1, 4)
        self._position, self._k, sides = table[:, 0] == 0, table[:, 1].astype(int), table[:, 2:]
        self._room, self._vertical = np.zeros(len(rows)), bool((self._k >= model.r).any())
        if plan is not None:
            position, velocity = (each.reshape(-1, len(outputs))[:, self._k] for each in plan)
            values = np.where(self._position, position, velocity)
            gaps = np.stack([values.min(axis=0) - sides[:, 0], sides[:, 1] - values.max(axis=0)], axis=1)
            # Feedback may follow a plan that comes nearer to a limit than the usual approach would let it.
            self._room = gaps.min(axis=1) / 2.0
            width = np.where(self._position[:, None], np.diff(sides), np.abs(sides))
            reserve = np.where(np.isfinite(width), _RESERVE * width, 0.0)
            sides = sides + np.clip(gaps / 2.0, 0.0, reserve) * [1.0, -1.0]
        self._sides = sides.T
        self._evaluated = model.form == "dynamic" or bool(self._position.any())
        self._eye, self._zeros = np.eye(model.r), np.zeros(model.r)

    def nearest(
        self,
        u: Array,
        planned: Array,
        q: Array,
        v2: Array,
        dt: float,
        plan: Callable[[], tuple[Array, Array]] | None = None,
        lack: Array | None = None,
    ) -> Array:
        """Return the input within all bounds that is near to an input (nu,).

        Args:
            u: the input.
            planned: input of the plan (nu,).
            q: configuration (nq,).
            v2: reduced velocity (r,).
            dt: duration of the sample [s]; 0 if it is not known.
            plan: returns the outputs of the plan, as ``outputs``; None after its end, and away from plans.
            lack: reduced acceleration (r,) that the robot lacks beside the model; velocity in the kinematic form.
        """
        if not len(self._k):
            return np.minimum(np.maximum(u, self._lower), self._upper)
        model, k, x, rates, rows, free = self._model, self._k, self._zeros, v2, self._eye, self._zeros
        if self._evaluated:
            at = model.reduced.at(q, v2)
            x, rates = self.outputs(at)
        if self._vertical:
            rows = np.concatenate([rows, at.A_star])
            own = at.v1 - at.A_star @ v2 if model.form == "kinematic" else at.J1 @ at.v_dot(free) + at.J1_dot @ at.v
            free = np.concatenate([free, own])
        if lack is not None:
            free = free - rows @ lack
        if model.form == "dynamic":
            moved, passive = at.input_accelerations
            rows, free = rows @ moved, free + rows @ passive
        # A held command decays by half of the way to the bound within a sample: faster ones pass it.
        rate = min(self._approach, 0.5 / dt) if dt > 0 else self._approach
        # Velocities decay to a bound at the rate, positions as the critically damped motion of this rate.
        gain, lead = np.where(self._position, [[rate**2], [2.0 / rate]], [[rate], [1.0]]) if model.nw else (rate, 0.0)
        value, A, free = self._position * x[k] + lead * rates[k], rows[k], free[k]
        change, now = gain * (self._sides - value) - free, A @ u
        beyond = ((now < change[0]) | (now > change[1])).any()
        # Usually nothing is beyond, and what the plan allows in addition is not needed.
        if beyond and plan is not None:
            aims = plan()
            ahead = value - self._position * aims[0][k] - lead * aims[1][k]
            own = A @ planned - gain * ahead
            wider = np.minimum(change[0], own), np.maximum(change[1], own)
            change = np.where(np.stack([-ahead, ahead]) <= self._room, wider, change)
        if beyond:
            # Least change of accelerations, not of inputs: torques of an arm's base shake its light wrist.
            along = A @ np.linalg.pinv(moved.T @ moved) if model.form == "dynamic" else A
            # Each row in turn gets its change, and rows that share inputs settle in a few sweeps: cheaper than a
            # quadratic program, and never infeasible.
            sweeps = 3
            for row, way, least, most in list(zip(A, along, *change, strict=True)) * sweeps:
                now = row @ u
                u = u + way * ((np.clip(now, least, most) - now) / max(row @ way, _ROUNDING))
        return np.minimum(np.maximum(u, self._lower), self._upper)

    def outputs(self, at: StateEvaluation) -> tuple[Float[Array, " k"], Float[Array, " k"]]:
        """Return the outputs of the model, reducing ones first, and their rates; no vertical ones without a bound.

        Args:
            at: state of the model.
        """
        x1, x2 = at.outputs()
        return (np.concatenate([x2, x1]), np.concatenate([at.v2, at.v1])) if self._vertical else (x2, at.v2)

    def acceleration(self, u: Array, q: Array, v2: Array, dt: float) -> Float[Array, " r"]:
        """Return the mean reduced acceleration over a sample that an input has by the model.

        Args:
            u: the input (nu,).
            q: configuration (nq,).
            v2: reduced velocity (r,).
            dt: duration of the sample [s]; 0 if it is not known.
        """
        if self._model.form == "dynamic":
            if not dt:
                return self._model.reduced.forward_dynamics(q, v2, u)
            return (self._model.step(Nodes(q[None], v2[None]), u[None], np.array([dt])).w[0] - v2) / dt
        return u if self._model.form == "acceleration" else self._bandwidth * (u - v2)

    def force(self, u: Array, q: Array, v2: Array, dt: float, t: float) -> Float[Array, " r"]:
        """Return the reduced force of an input of the forms "acceleration" and "kinematic", held over a sample.

        Args:
            u: the input (nu,).
            q: configuration (nq,).
            v2: reduced velocity (r,).
            dt: duration of the sample [s]; 0 if it is not known.
            t: its begin [s].
        """
        rate = self.acceleration(u, q, v2, dt)
        middle = Nodes(q[None], v2[None])
        # Forces of the state at the begin of a sample lag by half of it behind gravity and centrifugal forces.
        if dt > 0:
            middle = self._driven.step(middle, rate[None], np.array([dt / 2]))
        return self._model.reduced.inverse_dynamics(middle.q[0], middle.w[0], rate, t=t + dt / 2)


class PlanFeedback(ReprMixin):
    """``u + K dx`` along a plan, with dx the measured state minus the planned one along the tangent space.

    It reads the model. The dynamic form commands inputs T; the others command the reduced force of the acceleration
    that results. Reads from the measurement ``q, v2``.

    Commands are held from sample to sample: planned inputs are their means over a sample, and forces those of the
    state in its middle.

    Inputs stay within the bounds of the plan. They also keep outputs of the model and reduced velocities within theirs,
    as far as they can: each output approaches a bound no faster than a critically damped motion ends there.

    A plan that ends at rest stands still after its end. Other plans brake: the planned reduced velocities fall linearly
    to zero, within the largest accelerations of the plan, and at most in its duration. In the kinematic form the
    planned velocity jumps to zero.

    Args:
        reduced: the model.
        plan: the plan.
        K: gains (intervals, inputs, states); those of the plan by default.
        bandwidth: decay rate of the velocity error in the kinematic form [1/s].
        weights: natural frequency [rad/s], or weights of states and inputs, of the feedback after the end: a regulator
            about the state at rest, whose horizon is 1000 intervals. Directions that no input moves there, such as
            aside of a wheel, keep their error. By default, the last gains of K hold after the end, and 10 rad/s
            without K.
        joint_damping: True for a plant with the viscous joint damping of the robot's file: forces and inputs then
            contain what the damping takes at the planned velocity.

    Raises:
        ConfigurationError: plan, gains and model do not fit.

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> actuators = [rnc.FrameForce("sleigh", "x"), rnc.FrameTorque("sleigh", "z")]
        >>> system = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")], actuators)
        >>> reduced = system.reduce([rnc.FrameSpeed("sleigh"), rnc.FrameYaw("sleigh")])
        >>> ahead = {rnc.FramePosition("sleigh", "xy"): [1.0, 0.0]}
        >>> plan = rnc.optimal.plan(reduced, robot.configuration(), ahead, 2.0, form="kinematic")
        >>> controller = rnc.optimal.PlanFeedback(reduced, plan)
        >>> measurement = reduced.at(plan.q[0], np.zeros(2)).measure(np.zeros(2))
        >>> command, _ = controller.step(1.0, measurement, controller.initial_state(measurement))
        >>> command.F.round(1)  # towards the plan, which moves at 0.5 m/s
        array([39.6,  0. ])
    """

    def __init__(
        self,
        reduced: ReducedModel,
        plan: MotionPlan,
        K: Float[Array, "K nu nx"] | None = None,
        bandwidth: Positive = 20.0,
        weights: RegulatorWeights | None = None,
        joint_damping: bool = False,
    ) -> None:
        self.plan, self.bandwidth, self.joint_damping = plan, bandwidth, joint_damping
        self._reduced, self._model = reduced, fitting_model(reduced, plan)
        self.K = np.array(plan.K if K is None else K, dtype=float)
        if self.K.shape != plan.K.shape or not np.isfinite(self.K).all():
            raise ConfigurationError(f"feedback: gains of shape {self.K.shape}, expected finite numbers {plan.K.shape}")
        self._after = PlanEnd(self._model, plan)
        names = (*reduced.reducing.names, *reduced.vertical.names)
        self._outputs = plan.reference() if plan.info.output_names == names else None
        values = None if self._outputs is None else (plan.position, plan.velocity)
        self._commands = BoundedCommands(self._model, plan.info.bounds, values, bandwidth)
        self.weights = FREQUENCY if K is None and weights is None else weights

    def describe(self) -> Description:
        """Return the form, the duration and the outcome of the plan, and the largest size of each gain."""
        plan, found = self.plan, {name: getattr(self.plan.info, name) for name in ("form", "cost", "outcome")}
        sizes = {"duration": plan.duration, "intervals": len(plan.u), "bandwidth": self.bandwidth}
        return {"type": type(self).__name__, **found, **sizes, "gains": listed(np.abs(self.K).max(axis=0))}

    def initial_state(self, measurement: Measurement) -> None:
        """Return None: there is no last sample."""

    def step(
        self, t: float, measurement: Measurement, state: FeedbackState | None = None
    ) -> tuple[Command, FeedbackState]:
        q, v2, model = np.asarray(measurement.q), np.asarray(measurement.v2), self._model
        dt = 0.0 if state is None else t - state.time
        planned, feedforward, K = self.planned(t)
        if dt > 0 and t < self.plan.duration:
            feedforward = mean_input(self.plan.time, self.plan.u, t, dt, self._after.at(0.0)[1])
        dx = pin.difference(self._reduced.robot.model, planned.q[0], q)
        dx = np.concatenate([dx, v2 - planned.w[0]]) if model.nw else dx
        over = t - self.plan.duration > 0 and self._after.duration > 0  # the plan has no outputs after its end
        known = None if over or self._outputs is None else self._outputs.at(t)  # those of another model
        v2_desired, force = model.velocity(planned, feedforward[None])[0], np.zeros(model.r)
        # By the planned velocity: to compensate the measured one would take the damping out of the loop.
        if self.joint_damping:
            now = planned if not dt else self.planned(t + dt / 2)[0]
            at = self._reduced.at(now.q[0], now.w[0] if model.nw else v2_desired)
            force = at.R.T @ (self._reduced.robot.model.damping * at.v)
            if model.form == "dynamic":
                feedforward = feedforward + at.allocate(force)
        u = self._commands.nearest(feedforward + K @ dx, feedforward, q, v2, dt, known and (lambda: known[:2]))
        state = FeedbackState(t, u, dx)
        x2, x1 = (None, None) if known is None else np.split(known.position, [model.r])
        if model.form == "dynamic":
            return Command(None, u, v2_desired, x1, x2), state
        return Command(self._commands.force(u, q, v2, dt, t) + force, None, v2_desired, x1, x2), state

    @cached_property
    def _at_rest(self) -> Array:
        """Gains after the end."""
        if self.weights is None:
            return self.K[-1]
        # A long horizon is as good as an infinite one, and exists where the algebraic Riccati equation has no solution,
        # because no input moves a direction at rest.
        at, u = self._after.at(np.inf)
        AB, H = _stages(self._model, at, u[None], np.diff(self.plan.time)[-1:], _numbers(self.plan, self.weights))
        nx = self._model.nx
        long = RiccatiFactors(np.repeat(AB, _HORIZON, axis=0), np.repeat(H, _HORIZON, axis=0), H[0, :nx, :nx])
        return long.K[0] if np.isfinite(long.K[0]).all() else self.K[-1]

    def planned(self, t: float) -> tuple[Nodes, Array, Array]:
        """State (one node), input and gains of the plan at a time [s]."""
        plan = self.plan
        if t >= plan.duration:
            return *self._after.at(t - plan.duration), self._at_rest
        at, k = self._model.during(Nodes(plan.q, plan.w), plan.u, plan.duration / len(plan.u), t)
        return at, plan.u[k], self.K[k]


def tvlqr(
    reduced: ReducedModel,
    plan: MotionPlan,
    state_cost: Weight | None = None,
    input_cost: Weight | None = None,
    frequency: Positive = FREQUENCY,
    joint_damping: bool = False,
) -> PlanFeedback:
    """Return a time-varying linear-quadratic regulator about a plan.

    It minimises the sum of ``h (dx^T Q dx + du^T R du)`` over the intervals, and ``10 dx^T Q dx`` at the end, under the
    exact linearization of every step.

    Without costs, each output that inputs move gets a critically damped loop of the natural frequency, whatever the
    form and the inertia: accelerations da cost ``da^2``, velocities ``2 frequency^2 dv2^2``, and positions
    ``frequency^4`` times the squares of ``J2 dq`` and of the part of dq that no v2 moves. (In the kinematic form,
    velocities cost ``dv2^2`` and positions ``frequency^2``.) Intervals longer than ``1 / frequency`` lower the
    frequency, and samples that are longer make the loop unstable. Inputs saturate at the bounds of the plan.

    Args:
        reduced: the model.
        plan: the plan.
        state_cost: weights Q: a number, one for each state, or weights by name: entries of v, and reduced velocities
            with "(rate)" after their names (``plan.info.state_names``). One if only R is given.
        input_cost: weights R in the same forms, positive; one if only Q is given.
        frequency: natural frequency without costs [rad/s].
        joint_damping: as for ``PlanFeedback``.

    Raises:
        ConfigurationError: a weight is negative, or names an unknown state; the plan does not fit the model.

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> actuators = [rnc.FrameForce("sleigh", "x"), rnc.FrameTorque("sleigh", "z")]
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")], actuators).reduce(
        ...     [rnc.FrameSpeed("sleigh"), rnc.FrameYaw("sleigh")])
        >>> ahead = {rnc.FramePosition("sleigh", "xy"): [1.0, 0.0]}
        >>> plan = rnc.optimal.plan(reduced, robot.configuration(), ahead, 2.0)
        >>> rnc.tvlqr(reduced, plan, state_cost=10.0).K.shape
        (40, 2, 5)
    """
    model = fitting_model(reduced, plan)
    costs = [1.0 if each is None else each for each in (state_cost, input_cost)]
    weights: RegulatorWeights = frequency if state_cost is input_cost is None else (costs[0], costs[1])
    at, numbers = Nodes(plan.q[:-1], plan.w[:-1]), _numbers(plan, weights)
    K = regulator_gains(model, at, plan.u, np.diff(plan.time), numbers)
    return PlanFeedback(reduced, plan, K, weights=weights, joint_damping=joint_damping)


def _numbers(plan: MotionPlan, weights: RegulatorWeights) -> _Numbers:
    """Natural frequency, or weights of states (nx,) and inputs (nu,) of a plan.

    Raises:
        ConfigurationError: a weight is negative or has an unknown name, or an input has none.
    """
    if not isinstance(weights, tuple):
        return weights
    Q, R = weights_of(weights[0], plan.info.state_names), weights_of(weights[1], plan.info.input_names)
    if not (R > 0).all():
        raise ConfigurationError("input_cost: every input needs a positive weight")
    return Q, R


def regulator_gains(model: ActionModel, at: Nodes, u: Array, h: Array, weights: _Numbers) -> Float[Array, "K nu nx"]:
    """Gains of a time-varying linear-quadratic regulator about a motion.

    Args:
        model: action model.
        at: states at the begin of the intervals.
        u: inputs (K, nu).
        h: lengths of the intervals (K,) [s].
        weights: natural frequency [rad/s], or weights of states and of inputs.
    """
    AB, H = _stages(model, at, u, h, weights)
    end = H[-1, : model.nx, : model.nx] / h[-1]
    # Ten times Q, or the cost to go of the critically damped loop of this frequency.
    end *= 10.0 if isinstance(weights, tuple) else (2.0 if model.nw else 1.0) / weights
    return RiccatiFactors(AB, H, end).K


def _stages(model: ActionModel, at: Nodes, u: Array, h: Array, weights: _Numbers) -> tuple[Array, Array]:
    """Dynamics (K, nx, nz) and costs (K, nz, nz) of the intervals of a regulator."""
    steps = model.step_derivatives(at, u, h)
    AB, h, nv, nx = np.concatenate([steps.x, steps.u], axis=2), h[:, None, None], model.nv, model.nx
    if isinstance(weights, tuple):
        return AB, h * np.diag(np.concatenate(weights))
    H, R, J2 = np.zeros((len(h), nx + model.nu, nx + model.nu)), steps.flow.v_v2, model.reduced.at(at.q).J2
    rates = steps.u[:, nv:] / h if model.nw else np.eye(model.nu)
    # J2 dq is the error that inputs move. The part of dq that no v2 moves has a weight too: motion ahead corrects it.
    H[:, :nv, :nv] = weights ** (4 if model.nw else 2) * (J2.mT @ J2 + np.eye(nv) - R @ np.linalg.pinv(R))
    H[:, range(nv, nx), range(nv, nx)] = 2.0 * weights**2
    H[:, nx:, nx:] = rates.mT @ rates
    own = np.einsum("kii->ki", H)[:, nx:]  # a writable view
    # More actuators than directions: without a cost of its own, no share of the work would be the best one.
    own += _SMALL * own + _LEAST * own.max()
    return AB, h * H


def fitting_model(reduced: ReducedModel, plan: MotionPlan) -> ActionModel:
    """Return the action model of a plan.

    Raises:
        ConfigurationError: the plan was made for another model.
    """
    model = action_model(reduced, plan.info.form)
    if plan.info.input_names != model.input_names or plan.K.shape[2] != model.nx:
        raise ConfigurationError(
            f"the plan is for inputs {', '.join(plan.info.input_names)}, the model has {', '.join(model.input_names)}"
        )
    if plan.q.shape[1] != reduced.robot.nq:
        raise ConfigurationError(f"the plan has {plan.q.shape[1]} coordinates, the robot {reduced.robot.nq}")
    return model
