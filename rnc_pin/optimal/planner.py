"""Planning of optimal motions."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Le
from numpy.typing import ArrayLike

from rnc_pin.analysis.derivatives import state_derivatives
from rnc_pin.errors import ModelWarning
from rnc_pin.model.parameter_types import NotNegative
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.optimal.action_models import Form, action_model
from rnc_pin.optimal.bounds import BoundKind, Goal, GoalRows
from rnc_pin.optimal.costs import CostKind
from rnc_pin.optimal.file_limits import FileLimits
from rnc_pin.optimal.guesses import Guess, guesses
from rnc_pin.optimal.motion_plan import MotionPlan
from rnc_pin.optimal.plan_feedback import tvlqr
from rnc_pin.optimal.plan_search import Gains, PlanSearch
from rnc_pin.optimal.problem_building import build_problem, check_start, initial_node
from rnc_pin.optimal.sequential_quadratic import SolverSettings
from rnc_pin.optimal.transcription import Transcription

_DEFAULT, _OF_FILE = SolverSettings(), FileLimits()

RunFeedback = Literal["tvlqr", "plan"] | Gains | None
"""Feedback that a run will use: the gains of ``rnc.tvlqr(reduced, plan)``, those of the plan, a function from a plan to
gains (K, nu, nx), or None for the inputs alone."""


def plan_motion(
    reduced: ReducedModel,
    q0: ArrayLike,
    goal: Goal | None,
    duration: float | tuple[float, float],
    *,
    form: Form = "acceleration",
    costs: Sequence[CostKind] | None = None,
    bounds: Sequence[BoundKind] = (),
    limits: FileLimits | None = _OF_FILE,
    settings: SolverSettings = _DEFAULT,
    guess: Guess = None,
    seeds: Annotated[int, Ge(0), Le(1000)] = 6,
    seed: int = 0,
    solutions: Annotated[int, Ge(1), Le(1000)] = 1,
    v2_0: ArrayLike | None = None,
    at_rest: bool = True,
    time_weight: NotNegative = 0.0,
    feedback: RunFeedback = "tvlqr",
) -> MotionPlan:
    """Return an optimal motion of a reduced system from a configuration to a goal.

    Inputs are constant over equal intervals. The goal and the bounds hold at the nodes. The straight line is the first
    guess; nonholonomic systems often need one of the random guesses. The result is a local optimum: with ``solutions``
    above 1, several guesses are solved and the cheapest plan is returned.

    Verification decides. A fine step integrates the inputs, without feedback and with the feedback that the run will
    use; goal, bounds and distances count at every step and between steps. A plan that violates one by more than
    ``settings.accuracy`` is solved again with half the intervals' length, then from the other guesses. If the
    refinements do not help without feedback, the motion with feedback decides: the motion may be unstable.

    Args:
        reduced: the model.
        q0: initial configuration (nq,).
        goal: values by output (name or object), a configuration (nq,), or None for terminal costs only.
        duration: duration [s], or its shortest and longest value for a free duration.
        form: "kinematic" (input v2), "acceleration" (input v2_dot) or "dynamic" (input T).
        costs: costs; ``[EffortCost()]`` by default.
        bounds: hard bounds. They replace limits of the robot's file for the same rows.
        limits: limits of the robot's file that hold too: all by default; None for none. Positions and velocities hold
            in every form, efforts in the form "dynamic".
        settings: settings of the solver.
        guess: another plan, or configurations (n, nq) at equal times; the straight line by default.
        seeds: number of further guesses that are tried if others do not lead to a plan: past both sides of obstacles
            in the way of a mobile base, then loops of the shape where the rows couple the rest to it, then random ones.
        seed: seed of the random guesses.
        solutions: number of plans among which the cheapest is returned. If fewer guesses lead to plans, a warning and
            ``info.solutions`` tell.
        v2_0: initial reduced velocity (r,); zero by default. The kinematic form has none.
        at_rest: True if the motion ends at rest.
        time_weight: cost of a free duration [1/s].
        feedback: feedback that the run will use: "tvlqr" for ``rnc.tvlqr(reduced, plan)``, "plan" for the gains of the
            plan, a function from a plan to gains, or None if it drives the inputs alone.

    Raises:
        InfeasibleError: no guess led to a verified motion; the message names the violated row and what was tried, and
            ``error.plan`` is the best plan. Or the start or the goal is beyond a limit.
        ConfigurationError: unknown form or output, or a combination that is not possible.
        InputError: wrong shapes, or a duration that is not positive.

    Warns:
        ModelWarning: derivatives are finite differences, or there are fewer solutions than asked for.

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")]).reduce(
        ...     [rnc.FrameSpeed("sleigh"), rnc.FrameYaw("sleigh")])
        >>> beside = {rnc.FramePosition("sleigh", "xy"): [0.0, 1.0], rnc.FrameYaw("sleigh"): 0.0}
        >>> slow = [rnc.optimal.VelocityBound(-1.0, 1.0)]
        >>> plan = rnc.optimal.plan(reduced, robot.configuration(), beside, 6.0, bounds=slow)
        >>> plan.info.outcome, plan.verdict.succeeded
        ('solved', True)
    """
    model = action_model(reduced, form)
    end = None if goal is None else GoalRows(model, goal, at_rest)
    start = initial_node(model, q0, v2_0)
    problem = build_problem(model, start, end, duration, costs, bounds, settings.nodes, limits)
    problem.time_weight = time_weight
    check_start(problem, settings.accuracy)
    _warn_of_differences(problem)
    wanted = max(1, solutions)
    search = PlanSearch(problem, settings, _gains(reduced, feedback), wanted, alone=not seeds and wanted == 1)
    made = search.run(guesses(problem, goal, guess, seeds + wanted - 1, seed))
    if made.info.solutions < wanted:
        found, tried = made.info.solutions, made.info.guesses
        text = f"plan: {found} solutions instead of {wanted}: the other {tried - found} of {tried} guesses led to none"
        warnings.warn(f"{text}; allow more seeds or iterations", ModelWarning, stacklevel=2)
    return made


def _gains(reduced: ReducedModel, feedback: RunFeedback) -> Gains | None:
    """Function from a plan to the gains of its feedback."""
    if feedback == "tvlqr":
        return lambda plan: tvlqr(reduced, plan).K
    if feedback == "plan":
        return lambda plan: plan.K
    return feedback


def _warn_of_differences(problem: Transcription) -> None:
    """Warn if the model has functions of a user, whose derivatives are finite differences."""
    reduced, start = problem.model.reduced, problem.start
    moving = state_derivatives(reduced, start.q[0], np.ones(reduced.r), np.ones(reduced.p))  # at rest, rates vanish
    error = float(np.max(moving.difference_error))
    if error > 0:
        text = f"derivatives of user-defined rows or outputs are finite differences (error {error:.1g} at the start)"
        warnings.warn(f"plan: {text}; nodes are evaluated one at a time", ModelWarning, stacklevel=3)


plan = plan_motion
"""Name of the export; a scenario has another ``plan``."""
