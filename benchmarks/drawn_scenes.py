"""Starts, goals and obstacles of scenarios, drawn at random."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from rnc_pin.collision import CollisionDistances
from rnc_pin.io.json import Json
from rnc_pin.robots.robot import Robot
from rnc_pin.scenario.execution import plan
from rnc_pin.scenario.files import find_scenario, read_yaml, with_options
from rnc_pin.scenario.loading import validate
from rnc_pin.scenario.schema.obstacles import build_obstacles

Options = dict[str, Json]
_FREE = 0.06  # [m]; distance to obstacles at the start
_SEED = 2026
_QUIET: Options = {"comparisons": {}, "plots": {}}


def drawn_options(scenario: str, run: int) -> Options:
    """Options of a run: drawn until no links touch at the start and obstacles are away from it."""
    generator = np.random.default_rng([_SEED, list(DRAWS).index(scenario), run])
    while True:
        options = DRAWS[scenario](generator)
        if _free(scenario, options):
            return {**_QUIET, **options}


@cache
def _nominal(scenario: str) -> tuple[Robot, np.ndarray]:
    experiment = plan(scenario, {**_QUIET, "simulation.duration": 0.1}).experiment
    return experiment.reduced.robot, experiment.q0


def _free(scenario: str, options: Options) -> bool:
    path = find_scenario(scenario)
    drawn = validate(with_options(read_yaml(path), options), scenario)
    robot, q0 = _nominal(scenario)
    obstacles = build_obstacles(drawn.obstacles, path.parent)
    checked = CollisionDistances(robot, obstacles, q0=q0)
    found = checked.smallest(robot.configuration(drawn.initial.q), 0.0, 1.0)
    names = {each.name for each in obstacles}
    beside = np.array([pair.names[1] in names for pair in checked.pairs])
    return bool((found[~beside] > 1e-3).all() and (found[beside] > _FREE).all())


def _numbers(generator: np.random.Generator, *ranges: tuple[float, float]) -> list[float]:
    return [round(float(generator.uniform(*each)), 4) for each in ranges]


def _tiago_shelf(generator: np.random.Generator) -> Options:
    x, y, yaw = _numbers(generator, (-0.3, 0.05), (-0.2, 0.2), (-0.3, 0.3))
    joints = read_yaml(find_scenario("tiago-shelf"))["initial"]["q"]
    options: Options = {
        "initial.q.root_joint": [x, y, yaw],
        "initial.q.torso_lift_joint": _numbers(generator, (0.1, 0.3))[0],
    }
    for name in list(joints)[1:]:
        options[f"initial.q.{name}"] = joints[name] + _numbers(generator, (-0.25, 0.25))[0]
    goal = _numbers(generator, (1.18, 1.32), (-0.35, 0.35), (0.8, 1.05))
    via = [x + 0.72, y + 0.05, goal[2]]
    options["controller.tasks.0.output.reference.via_points.points"] = [via, goal]
    table, lower, upper = _numbers(generator, (0.5, 0.66), (0.58, 0.7), (1.12, 1.25))
    options["obstacles.0.box.position"] = [_numbers(generator, (0.82, 0.95))[0], 0.0, table]
    options["obstacles.1.box.position"] = [1.3, 0.0, lower]
    options["obstacles.2.box.position"] = [1.3, 0.0, upper]
    return options


def _doorway(generator: np.random.Generator) -> Options:
    x, y, goal_x, goal_y = _numbers(generator, (-1.0, -0.65), (-0.3, 0.1), (0.6, 0.95), (-0.2, 0.1))
    heading = float(np.arctan2(goal_y - y, goal_x - x))
    bend = _numbers(generator, (0.25, 0.6))[0]
    half = _numbers(generator, (0.52, 0.7))[0]
    return {
        "initial.q": {"root_joint": [x, y, heading], "joint_1": bend, "joint_2": -2 * bend},
        "controller.tasks.1.base_pose.reference.minimum_jerk.to": [goal_x, goal_y, heading],
        "obstacles.0.box.position": [0.0, half + 0.5, 0.32],
        "obstacles.1.box.position": [0.0, -half - 0.5, 0.32],
    }


def _mecanum_crowd(generator: np.random.Generator) -> Options:
    goal = _numbers(generator, (3.0, 4.2), (-0.6, 0.6), (-0.8, 0.8))
    options: Options = {"controller.tasks.0.base_pose.reference.minimum_jerk.to": goal}
    for k in range(3):
        x, side, across, along, duration = _numbers(generator, (0.9, 5.0), (1.4, 2.4), (2.5, 4.5), (-1.5, 1.5), (8, 12))
        sign = float(generator.choice([-1.0, 1.0]))
        options[f"obstacles.{k}.capsule.position"] = [x, sign * side, 0.85]
        options[f"obstacles.{k}.capsule.motion.minimum_jerk"] = {
            "by": [along, -sign * across, 0, 0],
            "duration": duration,
        }
    aside = float(generator.choice([-1.0, 1.0]))
    x, y = _numbers(generator, (1.2, 2.6), (0.8, 1.4))
    options["obstacles.3.capsule.position"] = [x, aside * y, 0.85]
    return options


def _free_flying_arm(generator: np.random.Generator) -> Options:
    joints = read_yaml(find_scenario("free-flying-arm-limits"))["initial"]["q"]
    options: Options = {f"initial.q.{name}": joints[name] + _numbers(generator, (-0.25, 0.25))[0] for name in joints}
    first = _numbers(generator, (0.2, 0.45), (-0.8, -0.6), (-0.1, 0.1))
    second = _numbers(generator, (-0.45, -0.2), (-0.8, -0.6), (-0.1, 0.15))
    options["controller.tasks.0.output.reference.via_points.points"] = [first, second]
    return options


DRAWS: dict[str, Callable[[np.random.Generator], Options]] = {
    "tiago-shelf": _tiago_shelf,
    "doorway": _doorway,
    "mecanum-crowd": _mecanum_crowd,
    "free-flying-arm-limits": _free_flying_arm,
}
"""Options of a scenario from a generator."""

GOALS = {
    "tiago-shelf": ["arm_tool_link_x", "arm_tool_link_y", "arm_tool_link_z"],
    "doorway": ["tip_x", "tip_y", "base_x"],
    "mecanum-crowd": ["base_link_x", "base_link_y", "base_link_yaw"],
    "free-flying-arm-limits": ["panda_hand_tcp_x", "panda_hand_tcp_y", "panda_hand_tcp_z"],
}
"""Outputs whose errors count at the end."""
