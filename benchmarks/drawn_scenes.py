"""Starts, goals and obstacles of scenarios, drawn at random."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

from benchmarks.doorway_circle import CLEARANCE, passage
from benchmarks.doorway_path import doorway_path
from rnc_pin.applications.scenario.files import find_scenario, read_yaml, with_options
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.applications.scenario.schema.scenario import validate
from rnc_pin.applications.scenario.schema.world import build_obstacles
from rnc_pin.collision import CollisionDistances, Obstacle
from rnc_pin.io.json import Json
from rnc_pin.robots.robot import Robot

Options = dict[str, Json]
_FREE = 0.06  # [m]; distance to obstacles at the start
_SEED = 2026
_QUIET: Options = {"comparisons": {}, "plots": {}}
_RUN: Options = {**_QUIET, "simulation.dt": 0.025, "preflight": "refuse"}
_FASTEST = 0.5  # [m/s] of people; the base drives 0.7 m/s in every direction
_VIA_POINTS = 12  # of the planned path through a doorway
_APART = 1.5  # [m] between the centres of people: the base fits between them


def drawn_options(scenario: str, run: int) -> Options:
    """Options of a run: drawn until no links touch at the start and obstacles are away from it."""
    generator = _generator(scenario, run)
    while True:
        options = DRAWS[scenario](generator)
        if _free(scenario, options):
            return {**_RUN, **(_follow_path(options) if scenario == "doorway" else options)}


def _generator(scenario: str, run: int) -> np.random.Generator:
    return np.random.default_rng([_SEED, list(DRAWS).index(scenario), run])


@cache
def _nominal(scenario: str) -> tuple[Robot, np.ndarray]:
    experiment = Scenario.load(FILES.get(scenario, scenario), {**_QUIET, "simulation.duration": 0.1}).experiment
    return experiment.reduced.robot, experiment.q0


def _free(scenario: str, options: Options) -> bool:
    path = find_scenario(FILES.get(scenario, scenario))
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
    options["controller.tasks.0.output.reference.via_points"] = {"times": [2, 4.5], "points": [via, goal]}
    options["simulation.duration"] = 6.5
    table, lower, upper = _numbers(generator, (0.5, 0.66), (0.58, 0.7), (1.12, 1.25))
    options["obstacles.0.box.position"] = [_numbers(generator, (0.82, 0.95))[0], 0.0, table]
    options["obstacles.1.box.position"] = [1.3, 0.0, lower]
    options["obstacles.2.box.position"] = [1.3, 0.0, upper]
    return options


def _doorway(generator: np.random.Generator) -> Options:
    """Doorway that elbow and forearm can pass while the hand stays in place: others are drawn again."""
    while True:
        options = _any_doorway(generator)
        if passage(*_door_of(options)) >= CLEARANCE:
            return options


def _follow_path(options: Options) -> Options:
    """The same doorway, with a planned path as the platform's reference in place of the straight one."""
    path = doorway_path(*_door_of(options))
    if path is None:
        return options
    duration = options["controller.tasks.1.base_pose.reference.minimum_jerk.duration"]
    share = np.linspace(0.0, 1.0, _VIA_POINTS + 1)[1:]
    way = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)  # of a minimum-jerk motion
    points = CubicSpline(np.linspace(0.0, 1.0, len(path.poses)), path.poses)(way)
    via: Json = {"times": (share * duration).tolist(), "points": points.tolist()}
    kept = {key: value for key, value in options.items() if ".base_pose.reference." not in key}
    return {**kept, "controller.tasks.1.base_pose.reference": {"via_points": via}}


def unrestricted_doorways(count: int) -> list[tuple[list[float], float, list[float], tuple[Obstacle, ...]]]:
    """Arguments of ``passage`` for the first draws of this many runs, whether or not they can be passed."""
    found = []
    for run in range(count):
        generator = _generator("doorway", run)
        while not _free("doorway", options := _any_doorway(generator)):
            pass
        found.append(_door_of(options))
    return found


def _door_of(options: Options) -> tuple[list[float], float, list[float], tuple[Obstacle, ...]]:
    """Start of the platform, bend of the arm, goal of the platform, and jambs."""
    drawn = validate(with_options(read_yaml(find_scenario("doorway")), options), "doorway")
    start, goal = drawn.initial.q, options["controller.tasks.1.base_pose.reference.minimum_jerk.to"]
    jambs = build_obstacles(drawn.obstacles, find_scenario("doorway").parent)
    return start["root_joint"], start["joint_1"], goal, jambs


def _any_doorway(generator: np.random.Generator) -> Options:
    x, y, goal_x, goal_y = _numbers(generator, (-1.0, -0.65), (-0.3, 0.1), (0.6, 0.95), (-0.2, 0.1))
    heading = float(np.arctan2(goal_y - y, goal_x - x))
    bend = _numbers(generator, (0.25, 0.6))[0]
    half = _numbers(generator, (0.52, 0.7))[0]
    return {
        "simulation.duration": 6.0,
        "controller.tasks.1.base_pose.reference.minimum_jerk.duration": 4.5,
        "initial.q": {"root_joint": [x, y, heading], "joint_1": bend, "joint_2": -2 * bend},
        "controller.tasks.1.base_pose.reference.minimum_jerk.to": [goal_x, goal_y, heading],
        "obstacles.0.box.position": [0.0, half + 0.5, 0.32],
        "obstacles.1.box.position": [0.0, -half - 0.5, 0.32],
    }


def _mecanum_crowd(generator: np.random.Generator) -> Options:
    """Three people who walk across or along the way, and one who waits; nobody gives way to the robot."""
    goal = _numbers(generator, (2.2, 3.2), (-0.6, 0.6), (-0.8, 0.8))
    starts, ends, duration = _walks(generator, np.array(goal[:2]))
    options: Options = {
        "simulation.duration": 8.5,
        "controller.tasks.0.base_pose.reference.minimum_jerk": {"to": goal, "duration": 6.0},
    }
    for k, (start, end) in enumerate(zip(starts.tolist(), ends.tolist(), strict=True)):
        options[f"obstacles.{k}.capsule.position"] = [*start, 0.85]
        by = [end[0] - start[0], end[1] - start[1], 0.0, 0.0]
        if k < 3:
            options[f"obstacles.{k}.capsule.motion.minimum_jerk"] = {"by": by, "duration": duration}
    return options


def _walks(generator: np.random.Generator, goal: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Starts and ends (4, 2) [m] of people, and the duration of their way [s]: apart from each other and the goal."""
    duration = 10.0
    longest = _FASTEST * duration / 1.875  # the largest speed of a minimum-jerk motion is 1.875 times its mean
    shares = np.linspace(0.0, 1.0, 21)[:, None, None]
    while True:
        x, side = generator.uniform(0.8, 5.0, 4), generator.choice([-1.0, 1.0], 4)
        starts = np.column_stack([x, side * generator.uniform(0.4, 1.6, 4)])
        angle = generator.uniform(-np.pi, np.pi, 4)
        length = np.append(generator.uniform(1.0, longest, 3), 0.0)
        ends = starts + length[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
        ways = (starts + shares * (ends - starts)).swapaxes(0, 1)  # people, times, coordinates
        between = np.linalg.norm(ways[:, None] - ways[None], axis=-1).min(axis=-1)[np.triu_indices(4, 1)]
        late = np.linalg.norm(ways[:, 12:] - goal, axis=-1).min()
        if between.min() > _APART and late > _APART and np.linalg.norm(starts, axis=1).min() > 1.0:
            return starts.round(4), ends.round(4), duration


def _free_flying_arm(generator: np.random.Generator) -> Options:
    joints = read_yaml(find_scenario("free-flying-arm-limits"))["initial"]["q"]
    options: Options = {f"initial.q.{name}": joints[name] + _numbers(generator, (-0.25, 0.25))[0] for name in joints}
    first = _numbers(generator, (0.2, 0.45), (-0.8, -0.6), (-0.1, 0.1))
    second = _numbers(generator, (-0.45, -0.2), (-0.8, -0.6), (-0.1, 0.15))
    options["controller.tasks.0.output.reference.via_points"] = {"times": [2.5, 5], "points": [first, second]}
    options["simulation.duration"] = 6.5
    return options


def _telescopic_arm(generator: np.random.Generator) -> Options:
    """A reach of which most extend the boom until its efforts can no longer carry it, among people who walk by."""
    names = ("lift", "turn", "boom", "telescope", "wrist")
    starts = _numbers(generator, (0.1, 0.6), (-1.0, 1.0), (0.0, 0.5), (0.05, 0.15), (-0.5, 0.5))
    angle, reach, height, duration = _numbers(generator, (-2.3, 2.3), (0.7, 1.3), (0.8, 1.5), (1.0, 3.0))
    goal = [reach * float(np.cos(angle)), reach * float(np.sin(angle)), height]
    options: Options = {f"initial.q.{name}": value for name, value in zip(names, starts, strict=True)}
    options["controller.tasks.0.output.reference.minimum_jerk"] = {"to": goal, "duration": duration}
    for k, side in enumerate((1.0, -1.0)):
        x, y, time = _numbers(generator, (1.5, 2.5), (1.55, 1.9), (6.0, 9.0))
        options[f"obstacles.{k}.capsule.position"] = [side * x, side * y, 0.9]
        options[f"obstacles.{k}.capsule.motion.minimum_jerk"] = {"by": [-2 * side * x, 0, 0, 0], "duration": time}
    return {**options, "preflight": "warn"}


def _space_robot(generator: np.random.Generator) -> Options:
    """A reach of a free-floating arm whose joints have limits of velocity and acceleration."""
    first, second, third, x, y = _numbers(generator, (-0.9, 0.1), (1.2, 2.2), (-1.6, -0.6), (0.6, 1.4), (0.2, 0.9))
    fast, slow = _numbers(generator, (0.4, 1.2), (0.3, 1.0))
    reach: Json = {
        "output": {"frame_position": {"frame": "tip", "axes": "xy"}},
        "reference": {"minimum_jerk": {"to": [x, y], "duration": 2.0}},
        "gain": 3,
    }
    joints: Json = {"joint_1": fast, "joint_2": fast, "joint_3": 2 * fast}
    limits: Json = {"joint_velocity": {"limit": slow, "joints": list(joints)}, "acceleration": {"limit": joints}}
    return {
        "task": {},
        "reference": {},
        "sweep": {},
        "outputs.reducing": [{"joint": name} for name in joints],
        "outputs.vertical": [{"frame_position": {"frame": "tip", "axes": "xy"}}],
        "initial.q": {"joint_1": first, "joint_2": second, "joint_3": third},
        "controller": {"type": "inverse_dynamics", "tasks": [{"output": reach}], "limits": limits},
        "simulation.duration": 6.0,
        "preflight": "warn",
    }


FILES = {"telescopic-arm": str(Path(__file__).parent / "scenes" / "telescopic-arm.yaml")}
"""Files of scenarios that are not built in."""
DRAWS: dict[str, Callable[[np.random.Generator], Options]] = {
    "tiago-shelf": _tiago_shelf,
    "doorway": _doorway,
    "mecanum-crowd": _mecanum_crowd,
    "free-flying-arm-limits": _free_flying_arm,
    "telescopic-arm": _telescopic_arm,
    "space-robot": _space_robot,
}
"""Options of a scenario from a generator."""

GOALS = {
    "tiago-shelf": ["arm_tool_link_x", "arm_tool_link_y", "arm_tool_link_z"],
    "doorway": ["tip_x", "tip_y", "base_x"],
    "mecanum-crowd": ["base_link_x", "base_link_y", "base_link_yaw"],
    "free-flying-arm-limits": ["panda_hand_tcp_x", "panda_hand_tcp_y", "panda_hand_tcp_z"],
    "telescopic-arm": ["hand_x", "hand_y", "hand_z"],
    "space-robot": ["tip_x", "tip_y"],
}
"""Outputs whose errors count at the end."""
