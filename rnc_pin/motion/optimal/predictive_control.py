"""Model-predictive control: an optimal motion over a moving horizon, with feedback along it."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, asdict, dataclass
from typing import Annotated, NamedTuple

import numpy as np
from annotated_types import Ge

from rnc_pin.array_shapes import Array, Float
from rnc_pin.control.controller import (
    Command,
    DescribedMixin,
    Description,
    LimitedAcceleration,
    MissedGoal,
    State,
    nested,
)
from rnc_pin.errors import ConfigurationError, RncError, warn
from rnc_pin.model.evaluation_results import Measurement
from rnc_pin.model.input_validation import NotNegative, Positive, check_settings
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.motion.optimal.bounds import BoundKind, Goal, GoalRows
from rnc_pin.motion.optimal.costs import CostKind
from rnc_pin.motion.optimal.guesses import along
from rnc_pin.motion.optimal.planner import build_problem, initial_node
from rnc_pin.motion.optimal.sequential_quadratic import SequentialQuadratic, SolverSettings
from rnc_pin.motion.optimal.set_point import (
    AT_REST,
    QUADRATIC,
    TOLERANCE,
    SetPoint,
    SetPointBound,
    first_motion,
    quadratic_set_point,
    stalls,
)
from rnc_pin.motion.optimal.transcription import Iterate, gains_of
from rnc_pin.motion.planning.action_models import Form, Nodes, action_model
from rnc_pin.verdict import MOSTLY, Finding, FindingKind, Severity

_LONGEST = 6  # how often the time until the next search doubles


class PredictiveState(NamedTuple):
    """Motion over the horizon, and counters."""

    begin: float
    """Time of the first node [s]."""
    q: Float[Array, "K1 nq"]
    w: Float[Array, "K1 nw"]
    u: Float[Array, "K nu"]
    gains: Float[Array, "K nu nx"]
    next_update: float
    """Time of the next update [s]."""
    updates: int
    """Updates that were used."""
    missed: int
    """Updates that were not used: too late, not finite, or at a singular configuration."""
    escapes: int = 0
    """Motions that were replaced by the beginning of a plan, because they stalled."""
    searches: int = 0
    """Searches for such a plan."""
    next_search: float = 0.0
    """Time from which the next search may take place [s]."""
    multipliers: Float[Array, "K1 k"] | None = None
    """Multipliers of the bounds, from which the next update starts; None if no bound is active."""


@dataclass(frozen=True)
class UpdateSchedule:
    """Updates of the motion of a predictive controller.

    Args:
        period: time between updates [s].
        iterations: iterations of an update.
        delay: time from a measurement to its input [s].
        budget: processor time of an update [s]; None for no limit, which gives repeatable runs.

    Raises:
        ConfigurationError: an argument has an invalid value.

    Example:
        >>> rnc.optimal.UpdateSchedule(delay=0.01)
        UpdateSchedule(period=0.05, iterations=1, delay=0.01, budget=None)
    """

    period: Positive = 0.05
    iterations: Annotated[int, Ge(1)] = 1
    delay: NotNegative = 0.0
    budget: NotNegative | None = None

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(eq=False, repr=False)
class PredictiveController(DescribedMixin):
    """Model-predictive control (MPC) of a reduced system.

    At every update, a fixed number of iterations improves the motion over the horizon. It starts from the last motion,
    shifted in time. Between updates, the feedback gains of the motion act on the measured state. An update that exceeds
    its budget or fails is not used: the last motion and its feedback continue, and after its end its last node is held.

    With a ``SetPointCost`` or a ``goal``, the first motion is the beginning of a plan to it. If later the robot stands
    away from the goal, and its predicted motion does not lead nearer, another plan takes its place. Such an update is
    late by the time of the search. A plan whose first horizon costs more than waiting is followed to its end without
    updates, because they would turn the robot back. A set point that is missed at the end of a run is in its verdict.

    The motion starts at the state that is predicted for the end of the delay. The controller reads the model. Reads
    from the measurement ``q, v2``.

    Args:
        reduced: the model.
        costs: costs, with one at the end that pulls to the goal (phase "terminal" or "both").
        horizon: duration of the motion [s].
        form: "acceleration" or "dynamic".
        bounds: hard bounds.
        nodes: number of intervals.
        updates: schedule of the updates.
        goal: values by output or a configuration (nq,), which hold at the end of the horizon, at rest. The horizon has
            to be long enough to reach them; near the goal, motions are as short as the costs allow.

    Raises:
        ConfigurationError: the form is "kinematic".

    Warns:
        ModelWarning: quadratic costs at the end determine a set point beside which they stall.

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> actuators = [rnc.FrameForce("sleigh", "x"), rnc.FrameTorque("sleigh", "z")]
        >>> system = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")], actuators)
        >>> reduced = system.reduce([rnc.FrameSpeed("sleigh"), rnc.FrameYaw("sleigh")])
        >>> goal = rnc.optimal.OutputCost(rnc.FramePosition("sleigh", "xy"), [1.0, 0.0], weight=10.0, phase="both")
        >>> effort = rnc.optimal.EffortCost(weight=0.1)
        >>> controller = rnc.optimal.PredictiveController(reduced, [goal, effort], horizon=2.0, nodes=5)
        >>> measurement = reduced.at(robot.configuration(), np.zeros(2)).measure(np.zeros(2))
        >>> command, state = controller.step(0.0, measurement, controller.initial_state(measurement))
        >>> bool(command.T[0] > 0), state.updates, state.missed  # it pushes towards the goal
        (True, 1, 0)
    """

    described = ("form", "horizon", "nodes")

    reduced: ReducedModel
    costs: Sequence[CostKind]
    horizon: float
    _: KW_ONLY
    form: Form = "dynamic"
    bounds: Sequence[BoundKind] = ()
    nodes: int = 20
    updates: UpdateSchedule = UpdateSchedule()
    goal: Goal | None = None

    def __post_init__(self) -> None:
        if self.form == "kinematic":
            raise ConfigurationError("form 'kinematic': a predictive controller needs 'acceleration' or 'dynamic'")
        reduced, goal = self.reduced, self.goal
        self._solver_settings, self._model = SolverSettings(nodes=self.nodes), action_model(reduced, self.form)
        self._model.parts = 1  # feedback at every sample takes the place of exact steps
        start = initial_node(self._model, reduced.robot.configuration())
        end = None if goal is None else GoalRows(self._model, goal, at_rest=True)
        problem = build_problem(self._model, start, end, self.horizon, self.costs, self.bounds, self.nodes)
        self._problem = problem.changed(reserve=self._solver_settings.reserve)  # for the feedback between updates
        points = [each.point for each in self._problem.costs if isinstance(each, SetPointBound)]
        self.set_point = SetPoint(reduced, goal) if goal is not None else points[0] if points else None
        if self.set_point is not None:
            self.set_point.check_distances(self._problem.bounds, self._solver_settings.accuracy)
        self._stalls_at = None if self.set_point is not None else quadratic_set_point(self._model, self.costs)
        if self._stalls_at is not None:
            weights = ", ".join(map(str, self._stalls_at.coordinates.weights))
            warn(f"predictive control: weights {weights}: {QUADRATIC}")
        self._h = self.horizon / self.nodes

    @property
    def limited_accelerations(self) -> tuple[LimitedAcceleration, ...]:
        """Accelerations that the bounds of the inputs limit in the form "acceleration", for the verdict of a run."""
        if self.form != "acceleration":
            return ()
        names = self._model.input_names
        held = 0.01  # of a limit: the force is held for a sample, so that the acceleration departs from its bound
        return tuple(
            LimitedAcceleration(name.removesuffix("_dot"), "v2", names.index(name), low, high, held)
            for quantity, name, low, high in self._problem.limits
            if quantity == "input" and (np.isfinite(low) or np.isfinite(high))
        )

    def describe(self) -> Description:
        """Return the form, the horizon and the schedule of updates."""
        return {**super().describe(), **asdict(self.updates)}

    def _settings(self) -> Mapping[str, object]:
        return {**{name: getattr(self, name) for name in self.described}, "updates": self.updates}

    def findings(self, state: State, samples: int) -> tuple[Finding, ...]:
        """Return the finding of updates that were late or failed: the last motion and its feedback went on instead.

        Args:
            state: state of the controller, or of one around it.
            samples: number of steps.
        """
        own = next(each for each in nested(state) if isinstance(each, PredictiveState))
        if not own.missed:
            return ()
        total = own.missed + own.updates
        share, what = own.missed / total, f"{own.missed} of {total} updates of the predictive controller"
        severity = Severity.FAILS if share > MOSTLY else Severity.DEGRADES
        message = f"{what} were late or failed: its last motion went on"
        return (Finding(FindingKind.FALLBACK, "predictive controller", share, "", None, severity, message),)

    def missed_goals(self, t: float, q: Float[Array, " nq"], v2: Float[Array, " r"]) -> tuple[MissedGoal, ...]:
        """Rows of the set point that a run misses which ends in this state, for its verdict.

        Set points of quadratic costs count only for a robot at rest: it stalls.

        Args:
            t: time [s].
            q: configuration (nq,).
            v2: reduced velocity (r,).
        """
        moving = float(np.abs(v2).max(initial=0.0)) > AT_REST
        if self.set_point is not None:
            return self.set_point.missed(q, TOLERANCE, "the run ends on the way" if moving else "no motion led to it")
        if self._stalls_at is None or moving:
            return ()
        return self._stalls_at.missed(q, TOLERANCE, QUADRATIC)

    def initial_state(self, measurement: Measurement) -> PredictiveState:
        """Return a motion that stands at the measured configuration, or the first motion to a set point."""
        stand = along(self._model, np.repeat(np.asarray(measurement.q)[None], self.nodes + 1, axis=0), self.horizon)
        gains = np.zeros((self.nodes, self._model.nu, self._model.nx))
        state = PredictiveState(0.0, stand.q, stand.w, stand.u, gains, -np.inf, 0, 0)
        return state if self.set_point is None else self._updated(0.0, _node_of(measurement), state)

    def step(self, t: float, measurement: Measurement, state: PredictiveState) -> tuple[Command, PredictiveState]:
        now = _node_of(measurement)
        if t >= state.next_update - 1e-9:
            state = self._updated(t, now, state)
        u = self._input(t + self.updates.delay, self._predicted(t, now, state), state)
        if self.form == "dynamic":
            return Command(T=u), state
        return Command(F=self.reduced.inverse_dynamics(now.q[0], now.w[0], u)), state

    def _updated(self, t: float, now: Nodes, state: PredictiveState) -> PredictiveState:
        """State after an update of the motion, or with one more missed update."""
        # Processor time: other programs of the computer do not make updates fail.
        limit, begin, K = self.updates.budget, time.process_time(), self.nodes
        waiting = state._replace(next_update=t + self.updates.period)
        self._problem.begin = t + self.updates.delay
        try:
            at, known = self._shifted(t + self.updates.delay, self._predicted(t, now, state), state)
            escapes, point = state.escapes, self.set_point
            searches = point is not None and t >= state.next_search - 1e-9
            if point is not None and searches and stalls(point, Nodes(at.q[:1], at.w[:1]), at.q[-1]):
                limit = None  # a search takes seconds: with the budget of an update, its plan would be dropped
                pause = self.horizon * 2.0 ** min(state.searches, _LONGEST)
                waiting = waiting._replace(searches=state.searches + 1, next_search=t + pause)
                plan, known = first_motion(self._model, point, at, self.bounds, state.searches), None
                if plan is not None:
                    escapes += 1
                    first = Iterate(plan.q[: K + 1], plan.w[: K + 1], plan.u[:K], self.horizon)
                    if self.goal is None and self._problem.values(first).cost > self._problem.values(at).cost:
                        # Over one horizon, waiting costs less: an update would turn the robot back.
                        return self._following(t, plan, waiting._replace(escapes=escapes, updates=state.updates + 1))
                    at = first
            solver = SequentialQuadratic(self._problem, self._solver_settings)
            solver.interior.multipliers = known
            # A fresh solver: damping and penalties of the last update belong to another horizon. The multipliers are
            # the part that saves iterations.
            rows = None
            for _ in range(self.updates.iterations):
                improved = solver.iterate(at)
                if improved is None:
                    break
                at, rows = improved[0], improved[1].rows
            if rows is None or solver.linear is None:
                gains = self._problem.feedback_gains(at)
            else:  # real-time iteration: the linearization of the last iteration gives the gains, too
                gains = gains_of(solver.linear, np.minimum(self._problem.upper - rows, rows - self._problem.lower))
        except RncError:
            return waiting._replace(missed=state.missed + 1)
        late = limit is not None and time.process_time() - begin > limit
        if late or not (np.isfinite(at.u).all() and np.isfinite(gains).all()):
            return waiting._replace(missed=state.missed + 1)
        # The multipliers go into the state: a controller without memory of its own can be saved and resumed.
        motion = waiting._replace(begin=t + self.updates.delay, q=at.q, w=at.w, u=at.u, gains=gains, escapes=escapes)
        return motion._replace(multipliers=solver.interior.multipliers, updates=state.updates + 1)

    def _following(self, t: float, plan: Iterate, state: PredictiveState) -> PredictiveState:
        """State that follows a plan to its end, without updates."""
        # The plan is longer than the horizon, and its feedback has to last to its end.
        gains = self._problem.changed(K=len(plan.u)).feedback_gains(plan)
        begin = t + self.updates.delay
        motion = state._replace(begin=begin, q=plan.q, w=plan.w, u=plan.u, gains=gains)
        return motion._replace(multipliers=None, next_update=begin + plan.duration)

    def _predicted(self, t: float, now: Nodes, state: PredictiveState) -> Nodes:
        """State at the end of the delay, under the inputs of the last motion."""
        if self.updates.delay == 0.0:
            return now
        # Feedback acts during the delay too, so that its inputs change within an interval.
        parts = max(1, int(np.ceil(self.updates.delay / self._h)))
        step = self.updates.delay / parts
        for k in range(parts):
            u = self._input(t + k * step, now, state)
            now = self._model.step(now, u[None], np.array([step]))
        return now

    def _input(self, t: float, at: Nodes, state: PredictiveState) -> Array:
        """Input with feedback at a time."""
        since = min(t - state.begin, self._h * len(state.u))  # after its end, the last node is held
        planned, k = self._model.during(Nodes(state.q, state.w), state.u, self._h, since)
        return state.u[k] + state.gains[k] @ self._model.difference(planned, at)[0]

    def _shifted(self, begin: float, start: Nodes, state: PredictiveState) -> tuple[Iterate, Array | None]:
        """Last motion from a new time and a new start on, and its multipliers; the last input repeats after its end."""
        K = self.nodes
        since = np.maximum(begin + self._h * np.arange(K) - state.begin, 0.0)
        # The input of the nearest interval: one that is interpolated would be none of the last motion.
        places = np.minimum((since / self._h + 0.5).astype(int), len(state.u) - 1)
        u = state.u[places]
        later = places[:-1] + 1
        q, w = np.concatenate([start.q, state.q[later]]), np.concatenate([start.w, state.w[later]])
        last = self._model.step(Nodes(q[-1:], w[-1:]), u[-1:], np.array([self._h]))
        at = Iterate(np.concatenate([q, last.q]), np.concatenate([w, last.w]), u, self.horizon)
        return at, None if state.multipliers is None else state.multipliers[[*places, K]]


def _node_of(measurement: Measurement) -> Nodes:
    return Nodes(np.asarray(measurement.q, dtype=float)[None], np.asarray(measurement.v2, dtype=float)[None])
