"""Ways in drawn worlds that have one by construction.

``python -m benchmarks ways [N] [WORLD ...] [--seconds S]``. A world begins with a
way through random configurations; obstacles are drawn around it and kept if the way stays free. TIAGo starts in one of
three rooms with doors, and its hand reaches into a shelf in the last one; a way through both doors is known. The search
does not know these ways. A success is a way within the seconds of processor time that a dense replay confirms:
distances at samples without bounds between them.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from itertools import pairwise
from typing import Literal, NamedTuple

import coal
import numpy as np
import pinocchio as pin
from numpy import ndarray as Array
from numpy.typing import ArrayLike

import rnc_pin as rnc
from benchmarks.planned_models import car, tractor
from rnc_pin.collision import CollisionDistances, Obstacle, PairSelection
from rnc_pin.errors import ConfigurationError, InfeasibleError
from rnc_pin.motion.planning import OutputTarget, Way, WaySettings, find_steering, find_way
from rnc_pin.motion.planning.action_models import KinematicFlow
from rnc_pin.motion.planning.exact_steering import ExactMotion
from rnc_pin.motion.planning.way import WayChecker
from rnc_pin.motion.planning.way_finding import SampledBases

_CLEARANCE, _ROOM = 0.01, 0.05  # [m] that the search keeps, and that the way of the construction has
_STOPS, _BOXES, _TRIES = 3, 30, 300
_FINGERS = {"panda_finger_joint1": 0.0, "panda_finger_joint2": 0.0}
_PIECES = 100  # steps of each random input
_DENSE = 0.01  # [m or rad] between the samples of the replay
_REACHED = 1e-6  # [m or rad] error at the goal
_SHARED = 3.0  # time on the wall over that of the processor, at most
_HAND, _DOORS = "arm_tool_link", (0.85, 1.1)  # [m] width of doors
_CARRIED = {"torso_lift_joint": 0.15, "arm_1_joint": 0.2, "arm_2_joint": -1.34, "arm_3_joint": -0.2}
_CARRIED |= {"arm_4_joint": 1.94, "arm_5_joint": -1.57, "arm_6_joint": 1.37}
_REACHING = {"torso_lift_joint": 0.2, "arm_1_joint": 1.5, "arm_2_joint": 0.1, "arm_3_joint": -1.5}
_REACHING |= {"arm_4_joint": 1.2, "arm_5_joint": 0.0, "arm_6_joint": 0.0}


class World(NamedTuple):
    """Kind of drawn worlds.

    Attributes:
        model: the model.
        half: half size of the area [m].
        smallest: smallest sides of the boxes [m].
        largest: largest sides of the boxes [m].
        heights: smallest and largest height of their middles [m]; None if they stand on the ground.
    """

    model: Callable[[], rnc.ReducedModel]
    half: float
    smallest: tuple[float, float, float] = (0.0, 0.0, 0.0)
    largest: tuple[float, float, float] = (0.0, 0.0, 0.0)
    heights: tuple[float, float] | None = None


class Task(NamedTuple):
    """Start (nq,), goal, obstacles and a configuration (nq,) that reaches the goal."""

    start: Array
    goal: Array | dict[OutputTarget, Array]
    obstacles: list[Obstacle]


def tiago() -> rnc.ReducedModel:
    robot = rnc.Robot.from_example("tiago_no_hand", base="planar")
    wheels = [rnc.RollingWheel(f"wheel_{side}_link", 0.0985) for side in ("left", "right")]
    return rnc.NonholonomicSystem(robot, wheels).reduce()


def panda(base: Literal["fixed", "planar"] = "fixed") -> rnc.ReducedModel:
    """The arm; a planar base moves in any direction, as one on Mecanum wheels does."""
    return rnc.NonholonomicSystem(rnc.Robot.from_example("panda", base=base, lock=_FINGERS), []).reduce()


def flying_arm() -> rnc.ReducedModel:
    """The arm on a satellite with thrusters."""
    arm = rnc.Robot.from_example("panda", lock=_FINGERS)
    satellite = rnc.Robot.from_urdf("satellite.urdf", base="free", gravity=(0, 0, 0))
    return rnc.NonholonomicSystem(satellite.attach(arm, "mount"), []).reduce()


WORLDS = {
    "TIAGo in rooms": World(tiago, 2.5),
    "car in a lot": World(car, 5.0, (0.6, 0.6, 1.0), (1.0, 2.5, 1.0)),
    "arm among boxes": World(panda, 0.9, (0.08, 0.08, 0.08), (0.25, 0.25, 0.5), (0.1, 0.9)),
    "free-flying arm in a truss": World(flying_arm, 3.0, (0.1, 0.1, 0.1), (0.2, 3.0, 2.0), (-3.0, 3.0)),
    "base with an arm in rooms": World(partial(panda, "planar"), 3.0, (0.1, 0.3, 1.6), (0.2, 3.0, 2.0)),
    "car with a trailer": World(partial(tractor, 1), 5.0, (0.6, 0.6, 1.0), (1.0, 2.5, 1.0)),
}


def drawn(world: World, reduced: rnc.ReducedModel, seed: int) -> Task:
    """World that has a way."""
    generator = np.random.default_rng(seed)
    if not any(world.largest):
        return _rooms(world, reduced, generator)
    while True:
        start = _configuration(world, reduced, generator)
        alone = WayChecker(CollisionDistances(reduced.robot, q0=start), 0.0)  # as the search: without pairs that touch
        motions = _drive(world, reduced, start, generator)
        if all(alone.is_free(motion) for motion in motions):
            break
    kept: list[Obstacle] = []
    for k in range(_TRIES):
        size = generator.uniform(world.smallest, world.largest)
        x, y = generator.uniform(-world.half, world.half, 2)
        height = size[2] / 2 if world.heights is None else generator.uniform(*world.heights)
        box = _box(f"box {k}", size.tolist(), (x, y, height), generator.choice([0.0, np.pi / 2]))
        if _all_free(reduced, [box], motions):
            kept.append(box)
        if len(kept) == _BOXES:
            break
    return Task(start, motions[-1].q[-1], kept)


def _box(name: str, size: Sequence[float], position: ArrayLike, yaw: float = 0.0) -> Obstacle:
    return Obstacle(coal.Box(*size), position=position, yaw=yaw, name=name)


def _all_free(reduced: rnc.ReducedModel, obstacles: list[Obstacle], motions: Iterable[ExactMotion]) -> bool:
    """True if motions have room beside obstacles."""
    checker = WayChecker(CollisionDistances(reduced.robot, obstacles, PairSelection(links=False)), _ROOM)
    return all(checker.is_free(motion) for motion in motions)


def _rooms(world: World, reduced: rnc.ReducedModel, generator: np.random.Generator) -> Task:
    """Three rooms in a row, doors between them, and a shelf in the last one, which the hand reaches into."""
    half, steering = world.half, find_steering(reduced, np.array(reduced.robot.configuration()))
    length, frame = 3.0 * half, reduced.robot.model.getFrameId(_HAND)
    outer = [
        *(_box(f"wall {y}", (length, 0.1, 2.0), (0.0, y, 1.0)) for y in (-half, half)),
        *(_box(f"wall {x}", (0.1, 2 * half, 2.0), (x, 0.0, 1.0)) for x in (-length / 2, length / 2)),
    ]
    while True:
        stops, walls = [_posed(reduced, *_place(-length / 2, half, generator), _CARRIED)], list(outer)
        for x in (-half / 2, half / 2):
            y, width = generator.uniform(0.8 - half, half - 0.8), generator.uniform(*_DOORS)
            stops += [_posed(reduced, x + side, y, 0.0, _CARRIED) for side in (-0.7, 0.7)]
            for name, low, high in (("right", -half, y - width / 2), ("left", y + width / 2, half)):
                walls.append(_box(f"{name} of door {x}", (0.1, high - low, 2.0), (x, (low + high) / 2, 1.0)))
        place = _place(half / 2, half, generator)
        arm = {joint: angle + generator.normal(0.0, 0.5) for joint, angle in _REACHING.items()}
        stops += [_posed(reduced, *place, each) for each in (_CARRIED, arm)]
        data = reduced.robot.model.createData()
        pin.framesForwardKinematics(reduced.robot.model, data, stops[-1])
        hand, forward = data.oMf[frame], np.array([np.cos(place[2]), np.sin(place[2]), 0.0])
        middle, room = hand.translation + 0.1 * forward, np.array([0.0, 0.0, generator.uniform(0.2, 0.3)])
        shelf = [
            *(_box(f"board {k}", (0.4, 0.9, 0.03), middle + k * room, place[2]) for k in (-1, 1)),
            _box("back", (0.03, 0.9, 2.0 * room[2]), middle + 0.2 * forward, place[2]),
        ]
        checker = WayChecker(CollisionDistances(reduced.robot, q0=stops[0]), 0.0)
        if checker.violation(stops[-1]) is not None or not 0.4 < hand.translation[2] < 1.5:
            continue
        motions = [next(steering.motions(*pair)) for pair in pairwise(stops)][::-1]  # the arm moves along the first one
        if checker.is_free(motions[0]) and _all_free(reduced, walls + shelf, motions):
            place, turn = hand.translation.copy(), hand.rotation.copy()
            goal = {rnc.FramePosition(_HAND): place, rnc.FrameOrientation(_HAND): turn}
            return Task(stops[0], goal, walls + shelf)


def _place(x: float, half: float, generator: np.random.Generator) -> tuple[float, float, float]:
    """Random pose (x, y, yaw) in the room that begins at x."""
    y = generator.uniform(0.6 - half, half - 0.6)
    return x + generator.uniform(0.6, half - 0.6), y, generator.uniform(-np.pi, np.pi)


def _posed(reduced: rnc.ReducedModel, x: float, y: float, yaw: float, joints: dict[str, float]) -> Array:
    model = reduced.robot.model
    q = np.clip(reduced.robot.configuration(joints), model.lowerPositionLimit, model.upperPositionLimit)
    q[:4] = x, y, *_angle(yaw)
    return q


def _drive(world: World, reduced: rnc.ReducedModel, start: Array, generator: np.random.Generator) -> list[ExactMotion]:
    """Motions through random configurations; without exact steering along random inputs within limits and area."""
    try:
        steering = find_steering(reduced, start)
    except ConfigurationError:
        return [_random_drive(world, reduced, start, generator)]
    stops = [start, *(_configuration(world, reduced, generator) for _ in range(_STOPS - 1))]
    return [next(steering.motions(*pair)) for pair in pairwise(stops)]


def _random_drive(world: World, reduced: rnc.ReducedModel, start: Array, generator: np.random.Generator) -> ExactMotion:
    """Random inputs until the base has come some way from its start."""
    flow, model = KinematicFlow(reduced), reduced.robot.model
    places = [start[None]]
    while np.linalg.norm(places[-1][-1, :2] - start[:2]) < world.half or len(places) < 2 * _STOPS:
        inputs = generator.uniform(-2.0, 2.0, (1, reduced.r))
        (piece,) = flow.along(places[-1][-1:], inputs, np.array([_PIECES]))
        limited = model.lowerPositionLimit < model.upperPositionLimit
        inside = (piece >= model.lowerPositionLimit) & (piece <= model.upperPositionLimit) | ~limited
        if inside.all() and (np.abs(piece[:, :2]) < world.half).all():
            places.append(piece[1:])
    q = np.concatenate(places)
    return ExactMotion(q, flow.manifold.difference(q[:-1], q[1:]))


def _configuration(world: World, reduced: rnc.ReducedModel, generator: np.random.Generator) -> Array:
    """Random configuration: a base in the area, joints within their limits, straight wheels."""
    model = reduced.robot.model
    low, high = model.lowerPositionLimit, model.upperPositionLimit
    q = np.array(reduced.robot.configuration())
    for joint in list(model.joints)[1:]:
        k = joint.idx_q
        if joint.shortname() == "JointModelPlanar":
            yaw = generator.uniform(-np.pi, np.pi)
            q[k : k + 4] = *generator.uniform(-world.half, world.half, 2), *_angle(yaw)
        elif joint.shortname() == "JointModelFreeFlyer":
            turn = generator.normal(size=4)
            q[k : k + 7] = *generator.uniform(-world.half, world.half, 3), *(turn / np.linalg.norm(turn))
        elif joint.nq == 1 and world.model is not car:
            q[k] = generator.uniform(*np.clip([low[k], high[k]], -np.pi, np.pi))
    return q


def _angle(yaw: float) -> tuple[float, float]:
    return float(np.cos(yaw)), float(np.sin(yaw))


def confirmed(way: Way, task: Task) -> bool:
    """True if a dense replay keeps the clearance, the rows hold, and the way ends at the goal."""
    distances = CollisionDistances(way.reduced.robot, task.obstacles, PairSelection(links=False))
    moved = (np.abs(way.v).max(axis=1) * np.diff(way.time)).sum()
    replay = way.at(np.linspace(0.0, way.duration, int(moved / _DENSE) + 2))
    apart = min(distances.smallest(q, 0.0, 0.1).min() for q in replay)
    model = way.reduced.robot.model
    if isinstance(task.goal, dict):
        data, (position, rotation) = model.createData(), task.goal.values()
        pin.framesForwardKinematics(model, data, way.q[-1])
        hand = data.oMf[model.getFrameId(_HAND)]
        missed = pin.log6(hand.actInv(pin.SE3(rotation, position))).vector
    else:
        missed = pin.difference(model, way.q[-1], task.goal)[~SampledBases(way.reduced, way.q[0]).followers()]
    return bool(apart >= _CLEARANCE and way.residual < 1e-9 and np.abs(missed).max() < _REACHED)


def run(name: str, count: int, seconds: float) -> None:
    """Print how many worlds of a kind have a way within the seconds, and the times."""
    world = WORLDS[name]
    reduced = world.model()
    times, bad = [], []
    for seed in range(count):
        task = drawn(world, reduced, seed)
        begin = time.process_time()
        try:
            settings = WaySettings(seconds=_SHARED * seconds)
            way = find_way(*(reduced, *task), clearance=_CLEARANCE, settings=settings, seed=seed)
        except InfeasibleError as error:
            bad.append(f"  world {seed}: {error}")
            continue
        times.append(time.process_time() - begin)
        if times[-1] > seconds:
            bad.append(f"  world {seed}: {times[-1]:.0f} s")
        elif not confirmed(way, task):
            bad.append(f"  world {seed}: the replay does not confirm the way")
    share = f"{count - len(bad)} of {count} within {seconds:g} s"
    spread = f", median {np.median(times):.1f} s, longest {max(times):.1f} s" if times else ""
    print(f"{name}: {share}{spread}", *bad, sep="\n", flush=True)


def main() -> None:
    """Run the worlds that the command line names."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("count", nargs="?", type=int, default=20, help="worlds of each kind")
    parser.add_argument("worlds", nargs="*", help=f"of {', '.join(WORLDS)}; all by default")
    parser.add_argument("--seconds", type=float, default=30.0)
    given = parser.parse_args()
    for name in given.worlds or WORLDS:
        run(name, given.count, given.seconds)


if __name__ == "__main__":
    main()
