"""Set points: goals at rest, and the cost that leads a nonholonomic robot to one.

Near a set point, a motion aside by y costs a maneuver over the distance |y|^(1 / w), with w the weight of y in
privileged coordinates. So waiting is optimal for quadratic costs: they gain y^2 for a maneuver of y^(2 / w). The cost
here is homogeneous: with W the largest weight, it has the residuals

    s_i = sign(z_i) |z_i|^(W / w_i)        r = s / |s|^((W - 1) / W)        |r|^2 = |s|^(2 / W)

so that |r|^2, squared inputs and squared velocities have the same degree: scaled motions have scaled costs (Coron,
Gruene and Worthmann, "Model predictive control, cost controllability, and homogeneity", 2020; Rosenfelder, Ebel and
Eberhard, "Model predictive control of non-holonomic vehicles", arXiv:2205.11400). If all weights are one, r is z.

At rest, a nonholonomic robot cannot move aside to first order. So no iteration of a solver leaves a motion that stands
still, whatever the cost: then the first motion comes from a plan.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from rnc_pin.analysis.growth import filtration
from rnc_pin.analysis.privileged_coordinates import privileged_coordinates
from rnc_pin.array_shapes import Array, Float
from rnc_pin.control.controller import MissedGoal
from rnc_pin.errors import ConfigurationError, ConstraintError, InfeasibleError, RncError
from rnc_pin.model.input_validation import Positive, admit_configuration, check_settings
from rnc_pin.model.kinematics import Kinematics
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.task import OutputTarget
from rnc_pin.motion.optimal.bounds import BoundKind, DistanceRows, Goal, GoalRows, NodeBound
from rnc_pin.motion.optimal.costs import (
    BoundCost,
    CostKind,
    NodeData,
    NodeOutputs,
    OutputCost,
    Phase,
    PostureCost,
    RowValues,
    stacked,
    velocity_rows,
    weights_of,
)
from rnc_pin.motion.optimal.motion_plan import MotionPlan
from rnc_pin.motion.optimal.planner import check_distances, plan_motion
from rnc_pin.motion.optimal.sequential_quadratic import SolverSettings
from rnc_pin.motion.optimal.transcription import Iterate
from rnc_pin.motion.planning.action_models import ActionModel, Nodes
from rnc_pin.motion.planning.inverse_kinematics import solve_ik
from rnc_pin.references.reference import Reference

_FREE = 1e-6  # entry of a unit vector that is not rounding


class SetPoint:
    """Configuration that a goal determines, with privileged coordinates about it.

    Args:
        reduced: the model.
        goal: values by output, or a configuration (nq,). Joints whose position no constraint depends on, such as
            wheels that roll, may stay undetermined.

    Attributes:
        q: the configuration (nq,); for outputs, the solution of inverse kinematics nearest to zero positions.
        coordinates: privileged coordinates.
        ignored: names of the joints that the goal leaves undetermined.

    Raises:
        ConfigurationError: the goal does not determine a configuration, or names an unknown output.
        InfeasibleError: no configuration reaches the goal; or a configuration has neighbours that no motion reaches.
        ConstraintError: affine rows.

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")]).reduce(
        ...     [rnc.FrameSpeed("sleigh"), rnc.FrameYaw("sleigh")])
        >>> goal = {rnc.FramePosition("sleigh", "xy"): [0.0, 0.0], rnc.FrameYaw("sleigh"): 0.0}
        >>> point = rnc.optimal.SetPoint(reduced, goal)
        >>> point.coordinates.weights
        (1, 1, 2)
        >>> round(float(point.distance(np.array([0.0, 0.04, 1.0, 0.0]))), 3)  # 4 cm aside
        0.2
    """

    def __init__(self, reduced: ReducedModel, goal: Goal) -> None:
        self.reduced, self.goal = reduced, goal
        if isinstance(goal, Mapping):
            found = solve_ik(reduced, reduced.robot.configuration(), goal)
            if not found.converged:
                missed = ", ".join(f"{name} by {error:.3g}" for name, error in found.unreachable.items())
                raise InfeasibleError(f"set point: no configuration reaches the goal; nearest misses {missed}")
            self.q = np.array(found.q)
            self.ignored = self._undetermined(NodeOutputs(reduced, list(goal)))
        else:
            self.q, self.ignored = admit_configuration(goal, reduced.robot, "goal"), ()
        self.q.setflags(write=False)
        self._rows = GoalRows(ActionModel(reduced, "kinematic"), goal, at_rest=False)
        try:
            self.coordinates = privileged_coordinates(reduced, self.q, ignored=self.ignored)
        except (ConstraintError, ConfigurationError) as error:
            if not self.ignored:
                raise
            names = ", ".join(self.ignored)
            raise ConfigurationError(
                f"set point: the goal does not determine the position of {names}; add outputs, or give a "
                f"configuration ({error})"
            ) from None
        self._check_leaf()

    def _undetermined(self, outputs: NodeOutputs) -> tuple[str, ...]:
        """Joints that move within the goal."""
        robot, closure = self.reduced.robot, filtration(self.reduced, self.q).closure
        # Directions that brackets reach and no output of the goal sees, such as the angle of a wheel.
        J = outputs.jacobian(Kinematics(robot).position(self.q))
        _, sizes, right = np.linalg.svd(J @ closure)
        rank = int((sizes > _FREE * sizes.max(initial=1.0)).sum())
        moves = np.abs(closure @ right[rank:].T).max(axis=1, initial=0.0) > _FREE
        return tuple(str(name) for name in robot.joint_names if moves[robot.velocity_indices(name)].any())

    def _check_leaf(self) -> None:
        """Refuse configurations all of whose neighbours cannot be reached, other than by holonomic rows."""
        if self.ignored:  # outputs name what has to be reached, and leave the rest free
            return
        reduced = self.reduced
        rows = reduced.at(self.q).all_rows[np.array(reduced.all_constraints.holonomic, dtype=bool)]
        room = reduced.n - int(np.linalg.matrix_rank(rows, tol=_FREE)) if len(rows) else reduced.n
        if self.coordinates.size < room:
            raise InfeasibleError(
                f"set point: motions reach {self.coordinates.size} of {room} dimensions near q, because constraints "
                "are integrable; give outputs as the goal, without the positions that follow from others"
            )

    def check_distances(self, bounds: Sequence[NodeBound], accuracy: float) -> None:
        """Refuse a goal that is nearer to something that stands than bounds allow: no motion ends there.

        Args:
            bounds: bounds, of which those of distances count.
            accuracy: shortfall that is accepted [m].

        Raises:
            InfeasibleError: the goal is, and no other configuration of it is found.
        """
        for each in bounds:
            if not isinstance(each, DistanceRows) or any(obstacle.motion for obstacle in each.distances.obstacles):
                continue
            try:
                check_distances("goal", each, self.q, 0.0, accuracy)
            except InfeasibleError:
                # Outputs leave other configurations: one of them may be free, and the robot may end there.
                if not isinstance(self.goal, Mapping):
                    raise
                pairs, apart = each.distances, each.clearance
                if not solve_ik(self.reduced, self.q, self.goal, collisions=pairs, clearance=apart).converged:
                    raise

    def errors(self, q: Float[Array, " nq"]) -> dict[str, float]:
        """Errors of a configuration by name of the goal's rows [m or rad]."""
        return self._rows.errors(q)

    def missed(self, q: Float[Array, " nq"], tolerance: float, reason: str = "") -> tuple[MissedGoal, ...]:
        """Rows of the goal whose error is above a tolerance, the largest first.

        Args:
            q: configuration (nq,).
            tolerance: largest error [m or rad].
            reason: why, for the verdict of a run.
        """
        return MissedGoal.of_errors(self.errors(q), tolerance, reason)

    def distance(self, q: Float[Array, "*n nq"]) -> Float[Array, "*n"]:
        """Homogeneous norms of the coordinates of configurations."""
        return self.coordinates.norm(q)


@dataclass(frozen=True)
class SetPointCost(CostKind):
    """Homogeneous distance from a set point: a cost under which a nonholonomic robot arrives.

    Near the goal its residuals are the privileged coordinates, each to the power 1 / weight, scaled motions have
    scaled costs, and ``EffortCost`` has the same degree. Within ``precision`` it is smooth. Farther than one unit, the
    polynomials of the coordinates fade. For a holonomic robot it is the squared distance.

    Args:
        goal: values by output that determine a configuration, or a configuration (nq,), as in ``plan``.
        weight: weight of each coordinate; by name of ``rnc.analysis.privileged_coordinates``.
        velocity_weight: weight of squared reduced velocities, in the forms that have them as state.
        phase: "running", "terminal" or "both".
        precision: homogeneous norm below which the residuals are smooth [m or rad].

    Raises:
        ConfigurationError: the precision is not positive.

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")]).reduce(
        ...     [rnc.FrameSpeed("sleigh"), rnc.FrameYaw("sleigh")])
        >>> goal = {rnc.FramePosition("sleigh", "xy"): [1.0, 0.0], rnc.FrameYaw("sleigh"): 0.0}
        >>> cost = rnc.optimal.SetPointCost(goal)
        >>> cost.bind(rnc.optimal.action_model(reduced, "kinematic")).names
        ('root_joint[0]', 'root_joint[2]', 'root_joint[1]')
    """

    goal: Goal
    weight: float | Sequence[float] | Mapping[str, float] = 1.0
    velocity_weight: float | Sequence[float] | Mapping[str, float] = 1.0
    phase: Phase = "both"
    precision: Positive = 0.02

    def __post_init__(self) -> None:
        check_settings(self)

    def bind(self, model: ActionModel) -> BoundCost:
        return SetPointBound(self, model)


class SetPointBound(BoundCost):
    """Cost of a set point for one action model: its residuals, with reduced velocities where they are states.

    Args:
        cost: the cost.
        model: action model.
    """

    def __init__(self, cost: SetPointCost, model: ActionModel) -> None:
        self.point = SetPoint(model.reduced, cost.goal)
        self._coordinates = coordinates = self.point.coordinates
        # Velocities are states that have to vanish at the goal too; in the kinematic form they are inputs, with a cost.
        names, weights = coordinates.names, weights_of(cost.weight, coordinates.names)
        if model.nw:
            speeds = model.reduced.reducing.names
            names = (*names, *speeds)
            weights = np.concatenate([weights, weights_of(cost.velocity_weight, speeds)])
        super().__init__(names, weights.tolist(), cost.phase, self._residuals)
        self._top = max(coordinates.weights)
        self._powers = self._top / np.array(coordinates.weights)
        self._least = cost.precision ** (2 * self._top)

    def _residuals(self, nodes: NodeData, derivatives: bool) -> RowValues:
        """Residuals with their derivatives, which cost little."""
        z, z_q = self._faded(nodes.at.q)
        top, powers, size = self._top, self._powers, np.abs(z)
        s, s_q = np.sign(z) * size**powers, (powers * size ** (powers - 1))[:, :, None] * z_q
        # |s|^2 + precision^(2 W) in place of |s|^2: no division by zero at the goal, and a smooth cost near it.
        total = (s**2).sum(axis=1, keepdims=True) + self._least
        factor = total ** (-(top - 1) / (2 * top))
        along = np.einsum("nk,nkv->nv", s, s_q) / total
        slopes = factor[:, :, None] * (s_q - (top - 1) / top * s[:, :, None] * along[:, None])
        found = RowValues(factor * s, nodes.slopes(slopes))
        return stacked([found, velocity_rows(nodes, True)]) if nodes.model.nw else found

    def _faded(self, q: Array) -> tuple[Array, Array]:
        """Coordinates whose polynomials fade far from the goal, where they do not describe the robot; with derivatives.

        They are multiplied by ``1 / (1 + S)``, with S the sum of ``|l_i|^(2 W / w_i)`` of the linear parts. So near
        the goal no term below the weights changes, and S grows faster than any polynomial.
        """
        coordinates = self._coordinates
        z, z_q = coordinates.evaluate(q)
        linear = coordinates.chart.coordinates(q) @ coordinates.linear.T
        size, power = np.abs(linear), 2 * self._powers
        share = 1.0 / (1.0 + (size**power).sum(axis=1, keepdims=True))
        bent = z - linear
        linear_q = coordinates.linear @ coordinates.chart.jacobian(q)
        bent_q = z_q - linear_q
        growth = np.einsum("nk,nkv->nv", power * np.sign(linear) * size ** (power - 1), linear_q)
        share_q = -(share**2) * growth
        return linear + share * bent, linear_q + share[:, :, None] * bent_q + bent[:, :, None] * share_q[:, None]


# ------------------------------------------------------------------ stalls of predictive control

AT_REST = 0.02
"""Reduced velocity below which a robot stands [m/s or rad/s]."""
TOLERANCE = 1e-2
"""Error at rest above which a set point is missed [m or rad]."""
_LONGEST = 4  # horizons of the longest plan whose beginning is a first motion
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
    # A robot that moves may be on a detour that leads away first. Half of the tolerance: the verdict asks for all of
    # it.
    if np.abs(now.w).max(initial=0.0) > AT_REST or not point.missed(now.q[0], TOLERANCE / 2):
        return False
    here, there = point.distance(np.stack([now.q[0], q_end]))
    approach = 0.9  # of the homogeneous distance now: a predicted end farther away is none
    return bool(there > approach * here)


def nearer_plan(
    point: SetPoint, q: Array, duration: float | tuple[float, float], search: Callable[..., MotionPlan]
) -> MotionPlan | None:
    """Plan from a configuration at rest to a set point; None if no guess leads to one.

    A plan that its verification does not confirm serves if it misses most its goal, and by less than half of the error
    now: the next plan starts nearer.

    Args:
        point: the set point.
        q: configuration (nq,) at the start.
        duration: duration of the plan, as for ``plan_motion``.
        search: ``plan_motion`` with its options.
    """
    try:
        return search(point.reduced, q, point.goal, duration, solutions=1)
    except InfeasibleError as error:
        plan: MotionPlan | None = getattr(error, "plan", None)
        end = None if plan is None else plan.info.verification.decisive
        nearer = end is not None and end.violation < _NEARER * max(point.errors(q).values())
        return plan if end is not None and nearer and end.name.startswith("goal") else None
    except RncError:  # the guesses met singular configurations
        return None


def first_motion(
    model: ActionModel, point: SetPoint, at: Iterate, bounds: Sequence[BoundKind], seed: int
) -> Iterate | None:
    """Plan from rest to a set point, over one, two or four horizons of a motion that stalls; None if there is none.

    The plan keeps the limits of the robot's file: they keep guesses from singular configurations, such as a steering
    angle of 90 degrees. A motion whose verification misses its goal serves if it leads nearer. Searches over two and
    four horizons have a half and a quarter of the random guesses, so that they take about as long as that over one.

    Args:
        model: action model.
        point: the set point.
        at: the motion.
        bounds: hard bounds.
        seed: of the guesses.
    """
    q, K, horizon = at.q[0], len(at.u), at.duration
    for times in (1, 2, _LONGEST):
        accuracy = 0.05  # of a plan whose beginning is all that counts; the iterations of the controller correct it
        # Intervals of the same length: the first K of them are the motion of the controller.
        settings = SolverSettings(nodes=times * K, refinements=0, accuracy=accuracy)
        given = partial(plan_motion, form=model.form, bounds=bounds, settings=settings, feedback="plan")
        seeds = 4  # of a search over one horizon
        plan = nearer_plan(point, q, times * horizon, partial(given, seeds=seeds // times, seed=seed))
        if plan is not None and plan.info.violation <= settings.tolerance:
            return Iterate(np.array(plan.q), np.array(plan.w), np.array(plan.u), times * horizon)
    return None


def quadratic_set_point(model: ActionModel, costs: Sequence[CostKind]) -> SetPoint | None:
    """Set point of quadratic costs at the end, if they determine one at which they stall: not all weights are one."""
    goal: dict[OutputTarget, ArrayLike] = {}
    found: Goal | None = None
    for cost in costs:
        if isinstance(cost, PostureCost) and cost.phase != "running":
            found = cost.q
        elif isinstance(cost, OutputCost) and cost.phase != "running" and not isinstance(cost.target, Reference):
            single: list[OutputTarget] = list(cost.output) if isinstance(cost.output, list | tuple) else [cost.output]  # type: ignore[list-item]
            ends = np.cumsum([NodeOutputs(model.reduced, each).size for each in single])[:-1]
            goal |= zip(single, np.split(np.atleast_1d(np.asarray(cost.target, dtype=float)), ends), strict=True)
    try:
        point = SetPoint(model.reduced, goal if found is None else found) if goal or found is not None else None
    except RncError:  # the costs determine no set point, or not one that is reached
        return None
    return point if point is not None and max(point.coordinates.weights) > 1 else None
