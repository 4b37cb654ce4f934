"""Lengths of planned paths of a car with turning radius 1, beside the closed forms of Dubins and of Reeds and Shepp."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

import rnc_pin as rnc
from benchmarks.planned_models import car, knife_edge
from rnc_pin.errors import InfeasibleError
from rnc_pin.optimal import EffortCost, InputBound, MotionPlan, OutputBound, SolverSettings
from rnc_pin.planning.shortest_paths import LEFT, RIGHT, STRAIGHT, driven_pose, dubins_length, reeds_shepp_length

Pose = tuple[float, float, float]
"""x, y and heading at the end."""
LIMIT = ((40, 0.1), (40, 0.01), (40, 0.001), (40, 1e-4), (80, 1e-4), (160, 1e-4), (320, 1e-4))
"""Intervals and weights of the effort that tend to the shortest path. The large first weight removes cusps."""
FINER = ((40, 1e-2), (40, 1e-3), (80, 1e-3), (160, 1e-3), (320, 1e-3), (320, 1e-4), (640, 1e-4))
"""Intervals and weights of the effort. Each plan is the guess of the next; a step that fails is left out."""
CLOSE = 1.008
"""Length at which the steps end, in durations of the knife edge, which are a lower bound."""
CANDIDATES = 3
"""Local optima of the first weight that become guesses for the next."""
BLOCKS = (3, 4, 5, 6, 8, 10)
"""Numbers of blocks of the speed, for guesses where the knife edge turns while it hardly moves."""
DRIVES, NODES = 12, 40
ROUGH: dict[str, Any] = {"tolerance": 1e-4, "substeps": 4, "refinements": 0, "accuracy": 0.1}
"""Settings of the steps: their plans are guesses of finer ones, so that they may miss the pose by 10 cm or 0.1 rad."""
FORWARD_RATE, BOTH_RATES = 20.0, (200.0, 50.0)
"""Largest rate of the steering [rad/s]. The closed forms have no limit, and turn at once at cusps."""


def compare(kind: str, count: int) -> None:
    """Print lengths of planned paths beside closed forms, for random poses within 4 turning radii."""
    exact, planned = KINDS[kind]
    reduced, generator = car(), np.random.default_rng(0)
    ratios, taken = [], []
    for number in range(1, count + 1):
        x, y, heading = generator.uniform([-4.0, -4.0, -np.pi], [4.0, 4.0, np.pi]).tolist()
        begin = time.process_time()
        try:
            found = planned(reduced, (x, y, heading))
        except InfeasibleError as error:
            print(f"  {number}: ({x:.2f}, {y:.2f}, {heading:.2f}): {error}", flush=True)
            found = np.inf
        taken.append(time.process_time() - begin)
        ratios.append(found / exact(x, y, heading))
        print(f"  {number}: ({x:.2f}, {y:.2f}, {heading:.2f}): {ratios[-1] - 1:+.2%}, {taken[-1]:.1f} s", flush=True)
    near = np.abs(np.array(ratios) - 1) < 0.01
    print(f"{kind}: {near.sum()} of {count} within 1 % of the closed form; error median {np.median(ratios) - 1:.2%}, "
          f"largest {max(ratios) - 1:.2%}; processor time median {np.median(taken):.1f} s", flush=True)  # fmt: skip


def driven_length(plan: MotionPlan) -> float:
    """Length of the path of the car, both directions positive [m]."""
    return float(np.abs(plan.u[:, 0]).mean() * plan.duration)


def forward_plan(
    reduced: rnc.ReducedModel, pose: Pose, starts: int = DRIVES, finer: Sequence[tuple[int, float]] = LIMIT
) -> MotionPlan:
    """Plan of least duration of the car that drives forwards: the limit of a small effort weight.

    The first weight is for all guesses, random drives with constant steering in a few segments. The cheapest plans
    become guesses for the next.

    Args:
        reduced: the car, with a wheelbase of 1 m.
        pose: x, y and heading at the end.
        starts: number of guesses.
        finer: intervals and weights of the effort, in falling order.

    Raises:
        InfeasibleError: no guess leads to the pose.
    """
    shortest = max(0.5, float(np.hypot(*pose[:2])))  # the straight line keeps guesses from a vanishing duration
    found = random_drives(reduced, pose, starts)
    for nodes, weight in finer:
        settings = SolverSettings(nodes=nodes, iterations=60, **ROUGH)
        plans = []
        for guess in found:
            with suppress(InfeasibleError):
                plans.append(_fastest(reduced, pose, (0.0, FORWARD_RATE), (shortest, 15.0), weight, settings, guess))
        found = sorted(plans, key=lambda each: each.duration)[:CANDIDATES] or (found if weight < finer[0][1] else [])
    if not found:
        raise InfeasibleError(f"none of {starts} guesses leads to the pose")
    return found[0]


def reversing_plan(reduced: rnc.ReducedModel, pose: Pose, finer: Sequence[tuple[int, float]] = FINER) -> MotionPlan:
    """Plan of least duration of the car that drives in both directions, from the plan of a knife edge.

    Args:
        reduced: the car, with a wheelbase of 1 m.
        pose: x, y and heading at the end.
        finer: intervals and weights of the effort.

    Raises:
        InfeasibleError: no guess leads to the pose.
    """
    edge = turning_plan(pose)
    around = (0.5 * edge.duration, 1.5 * edge.duration)

    def improved(guesses: Sequence[Any], nodes: int, weight: float) -> list[MotionPlan]:
        settings, plans = SolverSettings(nodes=nodes, iterations=100, **ROUGH), []
        for guess in guesses:
            for rate in BOTH_RATES:  # a slower steering converges where a faster one does not
                with suppress(InfeasibleError):
                    plans.append(_fastest(reduced, pose, (-1.0, rate), around, weight, settings, guess))
                    break
        return plans

    plans = improved([_along_edge(reduced, edge)], *finer[0])
    plans = plans or improved([_in_blocks(reduced, edge, blocks) for blocks in BLOCKS], *finer[0])
    if not plans:
        raise InfeasibleError("the plan of the knife edge does not lead to one of the car")
    best = min(plans, key=driven_length)
    for nodes, weight in finer[1:]:
        if driven_length(best) < CLOSE * edge.duration:
            break
        best = next(iter(improved([best], nodes, weight)), best)
    return best


def turning_plan(pose: Pose, nodes: int = NODES, solutions: int = 3) -> MotionPlan:
    """Plan of least duration of a knife edge with speed and turning rate up to 1.

    Its duration is the length of Reeds and Shepp: a turn on the spot takes as long as an arc of radius 1.
    H. J. Sussmann and G. Tang, "Shortest paths for the Reeds-Shepp car", report SYCON-91-10, Rutgers University, 1991.
    """
    reduced = knife_edge()
    goal = {rnc.FramePosition("sleigh", "xy"): pose[:2], rnc.FrameYaw("sleigh"): pose[2]}
    return rnc.optimal.plan(
        reduced, reduced.robot.configuration(), goal, (0.5, 15.0), form="kinematic", costs=[EffortCost(1e-3)],
        bounds=[InputBound(-1.0, 1.0)], time_weight=1.0, solutions=solutions, feedback=None,
        settings=SolverSettings(nodes=nodes, iterations=60, tolerance=1e-4, refinements=0, accuracy=1e-2),
    )  # fmt: skip


def _fastest(
    reduced: rnc.ReducedModel,
    pose: Pose,
    limits: tuple[float, float],
    duration: tuple[float, float],
    weight: float,
    settings: SolverSettings,
    guess: Any,
) -> MotionPlan:
    """Plan of the car from a guess, with limits (smallest speed, largest rate of the steering)."""
    slowest, rate = limits
    goal = {rnc.FramePosition("rear_axle", "xy"): pose[:2], rnc.FrameYaw("chassis"): pose[2]}
    steering = OutputBound(rnc.JointPosition("front_steering"), -np.pi / 4, np.pi / 4)
    bounds = [InputBound([slowest, -rate], [1.0, rate]), steering]
    return rnc.optimal.plan(
        reduced, reduced.robot.configuration(), goal, duration, form="kinematic",
        costs=[EffortCost([0.1 * weight, weight])], bounds=bounds, time_weight=1.0, settings=settings, guess=guess,
        seeds=0, feedback=None,
    )  # fmt: skip


def _along_edge(reduced: rnc.ReducedModel, edge: MotionPlan) -> np.ndarray:
    """Configurations of the car along a plan of the knife edge, each with the steering of the interval before it."""
    speed, turn = edge.u.T
    curvature = np.clip(turn * np.sign(speed) / np.maximum(np.abs(speed), 1e-3), -1.0, 1.0)
    steering = np.arctan(np.concatenate([[0.0], curvature]))
    poses = np.column_stack([edge.q[:, :2], np.arctan2(edge.q[:, 3], edge.q[:, 2])]).tolist()
    return np.array(
        [
            reduced.robot.configuration({"root_joint": pose, "front_steering": float(angle)})
            for pose, angle in zip(poses, steering, strict=True)
        ]
    )


def _in_blocks(reduced: rnc.ReducedModel, edge: MotionPlan, blocks: int) -> np.ndarray:
    """Configurations of the car like a plan of the knife edge, but with full speed in one direction in each block.

    The knife edge may turn while it hardly moves, which takes as long as a turn in several arcs. Signs of the speed
    follow from sum-up rounding (S. Sager, "Numerical methods for mixed-integer optimal control problems", 2005).
    """
    K, missing = len(edge.u), 0.0
    block = np.arange(K) * blocks // K
    signs = np.empty(K)
    for k in range(blocks):
        missing += float(edge.u[block == k, 0].mean())
        signs[block == k] = 1.0 if missing >= 0 else -1.0
        missing -= 1.0 if missing >= 0 else -1.0
    turns = np.where(np.abs(edge.u[:, 1]) > 0.5, np.sign(edge.u[:, 1]) * signs, 0.0).astype(int).tolist()
    word = list(zip(turns, (signs * edge.duration / K).tolist(), strict=True))
    return np.array(
        [
            reduced.robot.configuration({"root_joint": driven_pose(word[:k]), "front_steering": np.pi / 4 * turn})
            for k, turn in enumerate([0, *turns])
        ]
    )


def random_drives(reduced: rnc.ReducedModel, pose: Pose, count: int) -> list[Any]:
    """Configurations along random drives: of many, those that end nearest to a pose, each with another order of turns.

    Args:
        reduced: the car, with turning radius 1 at the bounds of the steering.
        pose: x, y and heading at the end.
        count: number of drives.
    """
    generator, drawn = np.random.default_rng(0), []
    for _ in range(5000):
        turns = generator.choice([LEFT, STRAIGHT, RIGHT], size=3)
        word = [(int(turn), float(length)) for turn, length in zip(turns, generator.uniform(0.1, 5.0, 3), strict=True)]
        x, y, heading = driven_pose(word)
        missed = np.hypot(x - pose[0], y - pose[1]) + 1 - np.cos(heading - pose[2])
        drawn.append((missed + 0.1 * sum(length for _, length in word), tuple(turns), word))
    kept: dict[Any, list[Any]] = {}
    for _, kind, word in sorted(drawn, key=lambda each: each[0]):
        kept.setdefault(kind, word)
    return [_configurations(reduced, word) for word in list(kept.values())[:count]]


def _configurations(reduced: rnc.ReducedModel, word: list[tuple[int, float]]) -> np.ndarray:
    """Configurations at equal distances along a drive."""
    ends = np.cumsum([0.0, *(length for _, length in word)])
    found = []
    for s in np.linspace(0.0, ends[-1], NODES + 1):
        here = max(0, int(np.searchsorted(ends, s)) - 1)
        begun = [*word[:here], (word[here][0], s - ends[here])]
        steering = np.pi / 4 * word[here][0] * (s > 0)
        found.append(reduced.robot.configuration({"root_joint": driven_pose(begun), "front_steering": steering}))
    return np.array(found)


KINDS: dict[str, tuple[Callable[[float, float, float], float], Callable[[rnc.ReducedModel, Pose], float]]] = {
    "dubins": (dubins_length, lambda reduced, pose: driven_length(forward_plan(reduced, pose))),
    "reeds-shepp": (reeds_shepp_length, lambda reduced, pose: driven_length(reversing_plan(reduced, pose))),
    "turning": (reeds_shepp_length, lambda _, pose: turning_plan(pose).duration),
}
"""Length in closed form, and that of a plan."""
