"""Stalls of predictive control at a set point: when waiting is all that it plans, and new first motions.

At rest, a nonholonomic robot cannot move aside to first order. So no iteration of a solver leaves a motion that stands
still, whatever the cost: the first motion comes from a plan.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy import ndarray as Array
from numpy.typing import ArrayLike

from rnc_pin.errors import InfeasibleError, RncError
from rnc_pin.model.output_targets import OutputTarget
from rnc_pin.optimal.action_models import ActionModel, Nodes
from rnc_pin.optimal.bounds import BoundKind, Goal
from rnc_pin.optimal.costs import CostKind, OutputCost, PostureCost
from rnc_pin.optimal.file_limits import FileLimits
from rnc_pin.optimal.motion_plan import MotionPlan
from rnc_pin.optimal.node_data import NodeOutputs, OutputChoice
from rnc_pin.optimal.planner import plan_motion
from rnc_pin.optimal.sequential_quadratic import SolverSettings
from rnc_pin.optimal.set_point import SetPoint
from rnc_pin.optimal.transcription import Iterate
from rnc_pin.planning.references import Reference

AT_REST = 0.02
"""Reduced velocity below which a robot stands [m/s or rad/s]."""
TOLERANCE = 1e-2
"""Error at rest above which a set point is missed [m or rad]."""
_APPROACH = 0.9  # of the homogeneous distance now: a predicted end farther away is none
_LONGEST = 4  # horizons of the longest plan whose beginning is a first motion
_SEEDS = 4  # of a search over one horizon
_ACCURACY = 0.05  # of such a plan; the iterations of the controller correct it
_NEARER = 0.5  # of the largest error now: a plan that misses its goal by less is of use

QUADRATIC = "quadratic costs stall beside a set point of a nonholonomic robot; SetPointCost arrives (docs/optimal.md)"
"""Reason of a stall, for warnings and verdicts."""


def stalls(point: SetPoint, now: Nodes, q_end: Array) -> bool:
    """True if a robot stands away from its set point, and the end of its predicted motion is not nearer.

    Args:
        point: the set point.
        now: state, one node.
        q_end: configuration (nq,) at the end of the predicted motion.
    """
    if np.abs(now.w).max(initial=0.0) > AT_REST or not point.missed(now.q[0], TOLERANCE / 2):
        return False
    here, there = point.distance(np.stack([now.q[0], q_end]))
    return bool(there > _APPROACH * here)


def leads_nearer(plan: MotionPlan, point: SetPoint, q: Array) -> bool:
    """True if the verification of a plan misses most its goal, and by less than half of the error now.

    Args:
        plan: plan that its verification does not confirm.
        point: the set point.
        q: configuration (nq,) at the start.
    """
    end = plan.info.verification.decisive
    return end.name.startswith("goal") and end.violation < _NEARER * max(point.errors(q).values())


def first_motion(
    model: ActionModel, point: SetPoint, q: Array, horizon: float, K: int, bounds: Sequence[BoundKind], seed: int
) -> Iterate | None:
    """Beginning of a plan from rest to a set point, over a horizon of K intervals; None if there is none.

    The plan keeps the limits of the robot's file: they keep guesses from singular configurations, such as a steering
    angle of 90 degrees. A motion whose verification misses its goal serves if it leads nearer. Searches over two and
    four horizons have a half and a quarter of the random guesses, so that they take about as long as that over one.

    Args:
        model: action model.
        point: the set point.
        q: configuration (nq,).
        horizon: duration of the motion [s].
        K: number of intervals.
        bounds: hard bounds.
        seed: of the guesses.
    """
    for times in (1, 2, _LONGEST):
        settings = SolverSettings(nodes=times * K, refinements=0, accuracy=_ACCURACY)
        try:
            plan = plan_motion(
                model.reduced,
                q,
                point.goal,
                times * horizon,
                form=model.form,
                bounds=bounds,
                limits=FileLimits(),
                settings=settings,
                seeds=_SEEDS // times,
                seed=seed,
                feedback="plan",
            )
        except InfeasibleError as error:
            found: MotionPlan | None = getattr(error, "plan", None)
            if found is None or found.info.violation > settings.tolerance or not leads_nearer(found, point, q):
                continue
            plan = found
        except RncError:  # the guesses met singular configurations
            return None
        return Iterate(np.array(plan.q[: K + 1]), np.array(plan.w[: K + 1]), np.array(plan.u[:K]), horizon)
    return None


def quadratic_set_point(model: ActionModel, costs: Sequence[CostKind]) -> SetPoint | None:
    """Set point of quadratic costs at the end, if they determine one at which they stall: not all weights are one."""
    goal: dict[OutputTarget, ArrayLike] = {}
    found: Goal | None = None
    for cost in costs:
        if isinstance(cost, PostureCost) and cost.phase != "running":
            found = cost.q
        elif isinstance(cost, OutputCost) and cost.phase != "running" and not isinstance(cost.target, Reference):
            goal |= _targets(model, cost.output, np.atleast_1d(np.asarray(cost.target, dtype=float)))
    try:
        point = SetPoint(model.reduced, goal if found is None else found) if goal or found is not None else None
    except RncError:  # the costs determine no set point, or not one that is reached
        return None
    return point if point is not None and max(point.coordinates.weights) > 1 else None


def _targets(model: ActionModel, chosen: OutputChoice, target: Array) -> dict[OutputTarget, ArrayLike]:
    """Targets of single outputs, from those of an output or of a list of them."""
    parts: dict[OutputTarget, ArrayLike] = {}
    begin = 0
    single: list[OutputTarget] = list(chosen) if isinstance(chosen, list | tuple) else [chosen]  # type: ignore[list-item]
    for each in single:
        size = NodeOutputs(model.reduced, each).size
        parts[each] = target[begin : begin + size]
        begin += size
    return parts
