"""Control to a set point without a solver in the loop: plan at rest, follow with feedback, plan again where needed."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from rnc_pin.array_shapes import Array, Float
from rnc_pin.control.controller import Command, DescribedMixin, MissedGoal, VelocityTarget
from rnc_pin.errors import ConfigurationError, RncError
from rnc_pin.model.evaluation_results import Measurement
from rnc_pin.model.input_validation import Positive, check_positive_settings
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.motion.optimal.bounds import DISTANCE, BoundKind, FileLimits, Goal, GoalRows
from rnc_pin.motion.optimal.costs import CostKind, NodeData
from rnc_pin.motion.optimal.guesses import inputs_for
from rnc_pin.motion.optimal.motion_plan import MotionPlan
from rnc_pin.motion.optimal.plan_feedback import FREQUENCY, BoundedCommands, mean_input, regulator_gains, tvlqr
from rnc_pin.motion.optimal.planner import build_problem, initial_node, plan_motion
from rnc_pin.motion.optimal.sequential_quadratic import SolverSettings
from rnc_pin.motion.optimal.set_point import AT_REST, SetPoint, nearer_plan
from rnc_pin.motion.planning.action_models import ActionModel, Form, Nodes, action_model

_OF_FILE = FileLimits()
_NEAR = 20.0  # times the tolerance: an error at which the feedback at rest moves the directions of weight one
_SETTLED = 4.0  # time constants of this feedback before the error counts
_SAMPLES = 40  # whose mean is the error at rest: noise that is above the tolerance now and then starts no plan
_STATE_COST = 10.0  # of feedback by velocities: they know no inertia, and the costs lead aside motions
_MOST_NODES = 1000  # of SolverSettings
_RESERVE = 0.1  # of velocities and ranges that plans leave to the feedback: wrong masses lead beyond the plan
_FARTHEST = 0.5  # place at which a robot is held, from the robot [m or rad]: 50 m/s^2 or rad/s^2 by forces
_SAMPLED = 0.15  # natural frequency at rest times the period, at most: measurements may be late and noisy
_LEARNED = 0.25  # rate at which the feedback along plans learns what the model lacks, over that frequency
_RETRY, _LONGEST = 1.0, 6  # time until the next search after the first one in vain [s], and how often it doubles


class SetPointState(NamedTuple):
    """Mode, plan with its feedback, and counters."""

    mode: str
    """"stand" at rest, "follow" a plan, or "stop" before the next plan."""
    begin: float
    """Time of the first node of the plan, or of the begin of the mode [s]."""
    h: float
    """Length of the plan's intervals [s]."""
    q: Float[Array, "K1 nq"]
    w: Float[Array, "K1 nw"]
    u: Float[Array, "K nu"]
    gains: Float[Array, "K nu nx"]
    mean: Float[Array, " nv"]
    """Mean displacement from the goal while the robot stands."""
    samples: int
    """Measurements in this mean; from 40 on, older ones fade."""
    hold: Float[Array, " nq"]
    """Configuration to which the feedback leads away from plans."""
    rate: Float[Array, " r"]
    """Reduced velocity of this configuration."""
    bias: Float[Array, " r"]
    """Acceleration by which the feedback balances what the model lacks; a velocity where velocities are the inputs."""
    lack: Float[Array, " r"]
    """Acceleration that the model lacked in the last samples, in the same units."""
    v2: Float[Array, " r"]
    """Reduced velocity at the last step."""
    expected: Float[Array, " r"]
    """Reduced acceleration of its command, by the model."""
    time: float
    """Time of the last step [s]."""
    next_check: float
    """Time of the next check of the error, or of the end that the feedback leads to [s]."""
    plans: int
    """Plans that were followed."""
    failures: int
    """Searches that led to no plan."""


@dataclass(eq=False, repr=False)
class SetPointController(DescribedMixin):
    """Feedback along plans to a set point, for computers that cannot solve a program in each sample.

    At rest, away from the goal, it plans to the goal, and follows the plan with the gains of ``rnc.tvlqr``. Every
    ``check`` seconds it integrates the rest of the plan with its feedback from the measured state. So it knows whether
    the state is still in the tube from which the feedback leads to the goal; outside, it brakes and plans again. A lag
    that the feedback at rest takes back is inside. It also plans again if the robot comes to rest away from the goal.

    Where it stands, it is held in the directions that inputs move, with a natural frequency of 10 rad/s by forces.
    Near the goal, the configuration that holds it moves until it is there: wrong masses and loads leave no error.
    What the feedback at rest balances is added to the next plan, along which it goes on to learn what the model lacks.

    The search for a plan takes place at rest, which takes seconds: the first one in ``initial_state``, others in the
    step that starts them. The controller reads the model. Reads from the measurement ``q, v2``. One state at a time.

    Args:
        reduced: the model.
        goal: values by output that determine a configuration, or a configuration (nq,), as in ``SetPoint``; or a
            ``SetPoint`` of the model.
        duration: duration of a plan [s], or its shortest and longest value.
        form: "kinematic", "acceleration" or "dynamic", as in ``plan``.
        costs: costs of the plans; ``[EffortCost()]`` by default.
        bounds: hard bounds of the plans. The feedback keeps those of inputs, and those of outputs and velocities as
            far as inputs can; plans leave it a tenth of them.
        limits: limits of the robot's file that plans keep; None for none.
        nodes: number of intervals.
        seeds: number of random guesses of each search.
        tolerance: error at rest above which it plans again [m or rad].
        tube: predicted error at the end of a plan from which it plans again [m or rad], beside what the feedback at
            rest takes back. Outputs and distances beyond their bounds on the way by more count too.
        check: time between two checks [s].
        bandwidth: decay rate of the velocity error in the kinematic form [1/s].
        braking: decay rate of the velocity while it brakes [1/s]; half of it is that of errors at rest.
        velocities: True for a kinematic controller, whose steps return velocities, for robots that take these: the
            target of an ``ActuatorVelocityController``. The form is "acceleration", so that bounds of inputs limit the
            rates of velocities.

    Raises:
        ConfigurationError: an argument has an invalid value, velocities with another form, or the goal does not
            determine a configuration.
        InfeasibleError: no configuration reaches the goal, or it is beyond a limit or too near to something.
        InputError: a bound or the duration is not an interval.

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> actuators = [rnc.FrameForce("sleigh", "x"), rnc.FrameTorque("sleigh", "z")]
        >>> system = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")], actuators)
        >>> reduced = system.reduce([rnc.FrameSpeed("sleigh"), rnc.FrameYaw("sleigh")])
        >>> goal = {rnc.FramePosition("sleigh", "xy"): [1.0, 0.0], rnc.FrameYaw("sleigh"): 0.0}
        >>> controller = rnc.optimal.SetPointController(reduced, goal, 4.0)
        >>> run = rnc.simulate(reduced, controller, robot.configuration(), 6.0, 0.02)
        >>> bool(abs(run.q[-1, 0] - 1.0) < 0.005), run.verdict.word
        (True, 'succeeded')
    """

    described = ("form", "nodes", "tolerance", "tube", "check", "bandwidth", "braking", "weights")

    reduced: ReducedModel
    goal: Goal | SetPoint
    duration: float | tuple[float, float]
    _: KW_ONLY
    form: Form = "dynamic"
    costs: Sequence[CostKind] | None = None
    bounds: Sequence[BoundKind] = ()
    limits: FileLimits | None = _OF_FILE
    nodes: int = 40
    seeds: int = 6
    tolerance: Positive = 5e-3
    tube: Positive = 0.05
    check: Positive = 0.25
    bandwidth: Positive = 20.0
    braking: Positive = 4.0
    velocities: bool = False

    def __post_init__(self) -> None:
        numbers = ("tolerance", "tube", "check", "bandwidth", "braking")
        check_positive_settings(**{name: getattr(self, name) for name in numbers})
        if self.velocities and self.form != "acceleration":
            raise ConfigurationError(f"velocities: expected the form 'acceleration', found '{self.form}'")
        self.set_point = self.goal if isinstance(self.goal, SetPoint) else SetPoint(self.reduced, self.goal)
        self._model = model = action_model(self.reduced, self.form)
        goal = GoalRows(model, self.set_point.goal, at_rest=True)
        given = self.duration, self.costs, self.bounds, self.nodes, self.limits
        problem = build_problem(model, initial_node(model, self.set_point.q), goal, *given)  # refuses wrong ones now
        self.set_point.check_distances(problem.bounds, self.tolerance)
        self._moved = ActionModel(self.reduced, "kinematic")
        self._driven = self._moved if self.velocities else self._model
        """Model of the robot under the commands."""
        self.weights = self.set_point.coordinates.weights
        stated = [each for each in problem.bounds if not each.of_file]
        self._watched = [each for each in stated if each.quantity in ("output", DISTANCE)]
        self._commands = BoundedCommands(model, problem.limits, bandwidth=self.bandwidth)

    def _settings(self) -> Mapping[str, object]:
        return {name: getattr(self, name) for name in self.described}

    def missed_goals(self, t: float, q: Float[Array, " nq"], v2: Float[Array, " r"]) -> tuple[MissedGoal, ...]:
        """Rows of the goal that a run misses which ends in this state, for its verdict.

        Args:
            t: time [s].
            q: configuration (nq,).
            v2: reduced velocity (r,).
        """
        moving = float(np.abs(v2).max(initial=0.0)) > AT_REST
        reason = "the run ends on the way" if moving else "no plan led to it, or an unknown force is too large"
        return self.set_point.missed(q, 2 * self.tolerance, reason)

    def initial_state(self, measurement: Measurement) -> SetPointState:
        """Return a state that follows a plan, or that brakes if the robot moves."""
        K, model = self.nodes, self._model
        q = np.repeat(np.asarray(measurement.q, dtype=float)[None], K + 1, axis=0)
        empty = np.zeros((K + 1, model.nw)), np.zeros((K, model.nu)), np.zeros((K, model.nu, self._driven.nx))
        v2 = np.array(measurement.v2, dtype=float)
        zeros = np.zeros(model.r)
        held = q[0], v2, zeros, zeros, v2, zeros
        state = SetPointState("stop", 0.0, 1.0, q, *empty, np.zeros(model.nv), 0, *held, 0.0, 0.0, 0, 0)
        if not self._stands(v2):
            return state
        now = Nodes(q[:1], v2[None] if self._driven.nw else np.empty((1, 0)))
        return self._next(0.0, now, v2, state._replace(mode="stand"))

    def step(
        self, t: float, measurement: Measurement, state: SetPointState
    ) -> tuple[Command | VelocityTarget, SetPointState]:
        q, v2 = np.asarray(measurement.q), np.asarray(measurement.v2)
        now = Nodes(q[None], v2[None] if self._driven.nw else np.empty((1, 0)))
        dt = t - state.time
        if state.mode != "follow":
            hold = self._moved.step(Nodes(state.hold[None], np.empty((1, 0))), state.rate[None], np.array([dt])).q[0]
            state = state._replace(hold=hold, rate=state.rate * np.exp(-self.braking * dt))
        if dt > 0 and not self.velocities:
            state = self._learned(dt, v2, state)
        state = self._next(t, now, v2, state)._replace(time=t)
        if state.mode == "follow":
            desired, k = self._planned(t, state)
            u = self._followed(t, dt, now, state, desired, k)
            v2_desired = desired.w[0] if self._model.nw else state.u[k]
        else:
            state, u = self._held(dt, now, v2, state)
            v2_desired = state.rate
        if self.velocities:
            return VelocityTarget(v2=u, v2_dot=np.zeros_like(u)), state
        state = state._replace(v2=v2.copy(), expected=self._commands.acceleration(u, q, v2, dt))
        command = Command(v2_desired=v2_desired)
        if self.form == "dynamic":
            return command._replace(T=u), state
        return command._replace(F=self._commands.force(u, q, v2, dt, t)), state

    def _learned(self, dt: float, v2: Array, state: SetPointState) -> SetPointState:
        """State that knows what the model lacked in the last sample, such as the weight of a load."""
        lack = (state.expected - (v2 - state.v2) / dt) / (1.0 if self._model.nw else self.bandwidth)
        lack = (state.lack + lack) / 2.0  # where robots are lighter than the model, all of it at once would alternate
        if state.mode != "follow":
            return state._replace(lack=lack)
        # Slower than the feedback: what wrong inertias lack changes with the planned accelerations, and would lag.
        share = 1.0 - math.exp(-_LEARNED * self._frequency(dt) * dt)
        return state._replace(lack=lack, bias=state.bias + share * (lack - state.bias))

    # ------------------------------------------------------------------ modes

    def _next(self, t: float, now: Nodes, v2: Array, state: SetPointState) -> SetPointState:
        """State after the changes of mode at a time."""
        if state.mode == "follow":
            if t >= state.begin + len(state.u) * state.h - 1e-9:
                bias = state.bias - self._stiffness(t - state.time) * self._away(state.q[-1], now.q[0])
                state = self._holding(t, now.q[0], np.zeros_like(v2), state._replace(bias=bias))
                return self._standing(t, state, max(self.check, 2 * _SETTLED / self.braking))
            if t >= state.next_check - 1e-9:
                if self._end_error(t, now, state) > self.tube:
                    return self._holding(t, now.q[0], v2, state)._replace(mode="stop", begin=t)
                return state._replace(next_check=t + self.check)
            return state
        if state.mode == "stop":
            return self._standing(t, state, self.check) if self._stands(v2) else state
        if t < state.next_check - self.check:
            return state
        count = min(state.samples + 1, _SAMPLES)
        goal, manifold = self.set_point.q[None], self._model.manifold
        mean = state.mean + (manifold.difference(goal, now.q)[0] - state.mean) / count
        state = state._replace(mean=mean, samples=count)
        if t < state.next_check - 1e-9:
            return state
        q = manifold.integrate(goal, mean[None])[0]
        if not self.set_point.missed(q, self.tolerance):
            return state._replace(next_check=t + self.check)
        return self._searched(t, q, state)

    def _standing(self, t: float, state: SetPointState, until: float) -> SetPointState:
        return state._replace(mode="stand", begin=t, samples=0, next_check=t + until)

    def _holding(self, t: float, q: Array, rate: Array, state: SetPointState) -> SetPointState:
        """State whose feedback begins at a configuration with a reduced velocity, and with the last bias."""
        ahead = self.reduced.at(q).R @ state.bias / self._stiffness(t - state.time)
        q = self._model.manifold.integrate(q[None], ahead[None])[0]
        return state._replace(hold=q, rate=rate)

    def _stands(self, v2: Array) -> bool:
        return bool(np.abs(v2).max(initial=0.0) < AT_REST)

    def _searched(self, t: float, q: Array, state: SetPointState) -> SetPointState:
        """State that follows a new plan, or that stands until the next search."""
        plan = self._plan(q, state.plans + state.failures)
        if plan is None:
            pause = _RETRY * 2.0 ** min(state.failures, _LONGEST)
            return state._replace(samples=0, next_check=t + pause, failures=state.failures + 1)
        h, bias = float(plan.time[1] - plan.time[0]), -self._stiffness(t - state.time) * self._away(state.hold, q)
        state = state._replace(mode="follow", begin=t, h=h, gains=self._gains(plan), bias=bias, samples=0)
        q, w, u = (np.array(each) for each in (plan.q, plan.w, plan.u))
        return state._replace(q=q, w=w, u=u, next_check=t + self.check, plans=state.plans + 1)

    def _gains(self, plan: MotionPlan) -> Array:
        """Gains of the feedback along a plan, of velocities about it if these are the commands."""
        if not self.velocities:
            return tvlqr(self.reduced, plan, _STATE_COST if self.form == "kinematic" else None).K
        weights = np.full(self._driven.nx, _STATE_COST), np.ones(self._driven.nu)
        start = Nodes(plan.q[:-1], np.empty((len(plan.u), 0)))
        return regulator_gains(self._driven, start, (plan.w[:-1] + plan.w[1:]) / 2, np.diff(plan.time), weights)

    def _plan(self, q: Array, seed: int) -> MotionPlan | None:
        """Plan from a configuration at rest; None if no guess leads to one.

        Searches after the first have twice the intervals: where a maneuver is large beside its distance, the equations
        of long intervals are too nonlinear for the iterations.
        """
        nodes = self.nodes if seed == 0 else min(2 * self.nodes, _MOST_NODES)
        settings = SolverSettings(nodes=nodes, accuracy=self.tolerance, reserve=_RESERVE)
        given = {name: getattr(self, name) for name in ("form", "costs", "bounds", "limits", "seeds")}
        search = partial(plan_motion, settings=settings, seed=seed, **given)
        return nearer_plan(self.set_point, q, self.duration, search)

    # ------------------------------------------------------------------ commands

    def _planned(self, t: float, state: SetPointState) -> tuple[Nodes, int]:
        """State of the plan at a time, and its interval."""
        return self._model.during(Nodes(state.q, state.w), state.u, state.h, t - state.begin)

    def _followed(self, t: float, dt: float, now: Nodes, state: SetPointState, planned: Nodes, k: int) -> Array:
        """Input with feedback along the plan and its interval k, within bounds, for a sample of the duration dt."""
        w = np.empty((1, 0)) if self.velocities else planned.w
        u = state.gains[k] @ self._driven.difference(Nodes(planned.q, w), now)[0]
        if self.velocities:
            return u + planned.w[0] + state.bias
        ahead, bias = state.u[k], state.bias
        if t + dt > state.begin + (k + 1) * state.h + 1e-9:  # the sample has the inputs of several intervals
            time = state.begin + state.h * np.arange(len(state.q))
            ahead = mean_input(time, state.u, t, dt, state.u[-1])
        if self.form == "dynamic" and bias.any():
            at = self.reduced.at(now.q[0])
            bias = at.allocate(at.H @ bias)
        ahead, q = ahead + bias, now.q[0]
        # Nodes of the kinematic form have no velocities, and its bounds do not depend on them.
        v2, plan_v2 = (now.w[0], planned.w[0]) if self._model.nw else (state.u[k], state.u[k])

        def outputs() -> tuple[Array, Array]:
            return self._commands.outputs(self.reduced.at(planned.q[0], plan_v2))

        return self._commands.nearest(u + ahead, ahead, q, v2, dt, outputs, state.lack)

    def _end_error(self, t: float, now: Nodes, state: SetPointState) -> float:
        """Largest error at the end of the plan, to which its feedback leads the model from a state [m or rad]."""
        zeros = np.zeros(self._model.r)
        K, state = len(state.u), state._replace(bias=zeros, lack=zeros)  # the bias balances what the model lacks
        try:
            while t < state.begin + K * state.h - 1e-9:
                planned, k = self._planned(t, state)
                until = state.begin + (k + 1) * state.h
                if self.velocities:
                    planned, k = self._planned((t + until) / 2, state)
                u = self._followed(t, until - t, now, state, planned, k)
                now, t = self._driven.step(now, u[None], np.array([until - t])), until
                if self._excess(t, now) > self.tube:
                    return np.inf
            # What the inputs move, the feedback at rest takes back: a robot that lags there is not off its plan.
            back = np.clip(self._away(now.q[0], state.q[-1]), -_FARTHEST, _FARTHEST)
            q = self._model.manifold.integrate(now.q, (self.reduced.at(now.q[0]).R @ back)[None])[0]
            return max(self.set_point.errors(q).values())
        except RncError:  # it meets a singular configuration
            return np.inf

    def _excess(self, t: float, now: Nodes) -> float:
        """Largest amount by which an output or a distance is beyond its bound [m or rad], such as a steering angle."""
        nodes = NodeData(self._driven, now, None, np.full(1, t))
        values = [(each, each.rows(nodes, False).value[0]) for each in self._watched]
        return max([0.0, *(float(np.maximum(each.lower - x, x - each.upper).max()) for each, x in values)])

    def _held(self, dt: float, now: Nodes, v2: Array, state: SetPointState) -> tuple[SetPointState, Array]:
        """State with the rate of its configuration at rest, and the input of the form that leads there."""
        q, k = now.q[0], self._stiffness(dt)
        away, rate, change = self._away(state.hold, q), state.rate, -self.braking * state.rate
        if state.mode == "stand":
            # Not filtered, though noise then moves a robot at rest: a lag here and late measurements oscillate.
            rate, change = self._correction(q), np.zeros_like(v2)
            rate[(np.abs(away) > _FARTHEST) & (rate * away < 0)] = 0.0
            state = state._replace(rate=rate)
        if self.velocities:
            return state, rate - k * away
        u = rate - k * away
        if self.form != "kinematic":
            u = change + 2.0 * k**0.5 * (rate - v2) - k * away  # critically damped
        if self.form == "dynamic":
            u = inputs_for(self._model, now, u[None])[0]
        return state, self._commands.nearest(u, u, q, v2, dt, None, state.lack)

    def _stiffness(self, dt: float) -> float:
        """Acceleration at rest for a displacement of one unit [1/s^2]; velocity where these are the inputs [1/s]."""
        if self.velocities:
            return 0.5 * self.braking
        if self.form == "kinematic":
            return 0.25 * self.bandwidth
        return self._frequency(dt) ** 2

    def _frequency(self, dt: float) -> float:
        """Natural frequency at rest by forces [rad/s]."""
        return min(FREQUENCY, _SAMPLED / dt) if dt > 0 else FREQUENCY

    def _away(self, start: Array, end: Array) -> Array:
        """Displacement (r,) between configurations in the directions that inputs move."""
        moved = self._model.manifold.difference(start[None], end[None])[0]
        return np.linalg.lstsq(self.reduced.at(end).R, moved)[0]

    def _correction(self, q: Array) -> Array:
        """Reduced velocity that reduces coordinates of weight one near the goal; zero away from it."""
        if max(self.set_point.errors(q).values()) > _NEAR * self.tolerance:
            return np.zeros(self._model.r)
        coordinates, direct = self.set_point.coordinates, np.array(self.weights) == 1  # those that single inputs move
        J = coordinates.jacobian(q)[direct] @ self.reduced.at(q).R
        return -0.5 * self.braking * np.linalg.lstsq(J, coordinates.values(q)[direct])[0]
