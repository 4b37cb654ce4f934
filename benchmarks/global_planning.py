"""Ways in drawn worlds that have one by construction, and a gap that is one centimetre too narrow.

``python -m benchmarks.global_planning [N] [WORLD ...] [--seconds S] [--gaps M]``. A world begins with a way through
random configurations; obstacles are drawn around it and kept if the way stays free. The search does not know this way.
A success is a way within the seconds that a dense replay confirms: distances at samples without bounds between them.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from itertools import pairwise
from typing import NamedTuple

import coal
import numpy as np
import pinocchio as pin
from numpy import ndarray as Array

import rnc_pin as rnc
from benchmarks.planned_models import car, tractor
from rnc_pin.collision import CollisionDistances, Obstacle, PairSelection
from rnc_pin.errors import ConfigurationError, InfeasibleError
from rnc_pin.planning import Way, WaySettings, find_steering, find_way
from rnc_pin.planning.exact_steering import ExactMotion
from rnc_pin.planning.kinematic_flow import KinematicFlow
from rnc_pin.planning.steering_detection import planned_velocities
from rnc_pin.planning.way_checking import WayChecker

_CLEARANCE, _ROOM = 0.01, 0.05  # [m] that the search keeps, and that the way of the construction has
_STOPS, _BOXES, _TRIES = 3, 30, 300
_PIECES = 100  # steps of each random input
_DENSE = 0.01  # [m or rad] between the samples of the replay


class World(NamedTuple):
    """Kind of drawn worlds: the model, the half size of the area [m], and sizes of the boxes (smallest, largest)."""

    model: Callable[[], rnc.ReducedModel]
    half: float
    smallest: tuple[float, float, float]
    largest: tuple[float, float, float]


def tiago() -> rnc.ReducedModel:
    robot = rnc.Robot.from_example("tiago_no_hand", base="planar")
    wheels = [rnc.RollingWheel(f"wheel_{side}_link", 0.0985) for side in ("left", "right")]
    return rnc.NonholonomicSystem(robot, wheels).reduce()


def panda() -> rnc.ReducedModel:
    robot = rnc.Robot.from_example("panda", lock={"panda_finger_joint1": 0.0, "panda_finger_joint2": 0.0})
    return rnc.NonholonomicSystem(robot, []).reduce()


def mecanum_arm() -> rnc.ReducedModel:
    """The arm on a base that moves in any direction, as one on Mecanum wheels does."""
    robot = rnc.Robot.from_example(
        "panda", base="planar", lock={"panda_finger_joint1": 0.0, "panda_finger_joint2": 0.0}
    )
    return rnc.NonholonomicSystem(robot, []).reduce()


WORLDS = {
    "TIAGo in rooms": World(tiago, 3.5, (0.1, 0.3, 1.6), (0.2, 3.0, 2.0)),
    "car in a lot": World(car, 5.0, (0.6, 0.6, 1.0), (1.0, 2.5, 1.0)),
    "arm among boxes": World(panda, 0.9, (0.08, 0.08, 0.08), (0.25, 0.25, 0.5)),
    "base with an arm in rooms": World(mecanum_arm, 3.0, (0.1, 0.3, 1.6), (0.2, 3.0, 2.0)),
    "car with a trailer": World(lambda: tractor(1), 5.0, (0.6, 0.6, 1.0), (1.0, 2.5, 1.0)),
}


def drawn(world: World, reduced: rnc.ReducedModel, seed: int) -> tuple[Array, Array, list[Obstacle]]:
    """Start, goal and obstacles of a world that has a way."""
    generator = np.random.default_rng(seed)
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
        height = size[2] / 2 if world.model is not panda else generator.uniform(0.1, 0.9)
        yaw = generator.choice([0.0, np.pi / 2])
        box = Obstacle(coal.Box(*size.tolist()), position=(x, y, height), yaw=yaw, name=f"box {k}")
        checker = WayChecker(CollisionDistances(reduced.robot, [box], PairSelection(links=False)), _ROOM)
        if all(checker.is_free(motion) for motion in motions):
            kept.append(box)
        if len(kept) == _BOXES:
            break
    return start, motions[-1].q[-1], kept


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
        elif joint.nq == 1 and world.model is not car:
            q[k] = generator.uniform(*np.clip([low[k], high[k]], -np.pi, np.pi))
    return q


def _angle(yaw: float) -> tuple[float, float]:
    return float(np.cos(yaw)), float(np.sin(yaw))


def confirmed(way: Way, goal: Array, obstacles: list[Obstacle]) -> bool:
    """True if a dense replay keeps the clearance, the rows hold, and the way ends at the goal."""
    distances = CollisionDistances(way.reduced.robot, obstacles, PairSelection(links=False))
    moved = (np.abs(way.v).max(axis=1) * np.diff(way.time)).sum()
    replay = way.at(np.linspace(0.0, way.duration, int(moved / _DENSE) + 2))
    apart = min(distances.smallest(q, 0.0, 0.1).min() for q in replay)
    planned = planned_velocities(way.reduced, way.q[0])
    missed = pin.difference(way.reduced.robot.model, way.q[-1], goal)[planned]
    return bool(apart >= _CLEARANCE and way.residual < 1e-9 and np.abs(missed).max() < 1e-8)


def run(name: str, count: int, seconds: float) -> None:
    """Print how many worlds of a kind have a way within the seconds, and the times."""
    world = WORLDS[name]
    reduced = world.model()
    times, bad = [], []
    for seed in range(count):
        start, goal, obstacles = drawn(world, reduced, seed)
        begin = time.perf_counter()
        try:
            settings = WaySettings(seconds=seconds)
            way = find_way(reduced, start, goal, obstacles, clearance=_CLEARANCE, settings=settings, seed=seed)
        except InfeasibleError as error:
            bad.append(f"  world {seed}: {error}")
            continue
        times.append(time.perf_counter() - begin)
        if not confirmed(way, goal, obstacles):
            bad.append(f"  world {seed}: the replay does not confirm the way")
    share = f"{count - len(bad)} of {count} within {seconds:g} s"
    spread = f", median {np.median(times):.1f} s, longest {max(times):.1f} s" if times else ""
    print(f"{name}: {share}{spread}", *bad, sep="\n", flush=True)


def gaps(count: int) -> None:
    """Print how many ways lead through a gap that is one centimetre narrower than a box on a knife edge."""
    geometry, plain = pin.GeometryModel(), rnc.Robot.from_urdf("unicycle.urdf", base="planar")
    body = plain.model.getFrameId("axle")
    geometry.addGeometryObject(pin.GeometryObject("body", 1, body, pin.SE3.Identity(), coal.Box(0.6, 0.6, 0.2)))
    robot = rnc.Robot(plain.model, collision_model=geometry)
    reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("axle")]).reduce()
    passed = 0
    for seed in range(count):
        generator = np.random.default_rng(seed)
        thickness, x = generator.uniform(0.02, 0.4), 1.5
        walls = [
            Obstacle(coal.Box(thickness, 40.0, 1.0), position=(x, side * (20.0 + 0.59 / 2), 0.0), name=name)
            for side, name in ((1.0, "left"), (-1.0, "right"))
        ]
        ends = []
        for low, high in ((0.0, 0.8), (2.2, 3.0)):
            q = np.array(robot.configuration())
            yaw = generator.normal(0.0, 0.1)
            q[:4] = generator.uniform(low, high), generator.normal(0.0, 0.05), *_angle(yaw)
            ends.append(q)
        area = [[-1.0, -1.0, 0.0], [4.0, 1.0, 1.0]]
        settings = WaySettings(seconds=0.2, area=area)
        try:
            find_way(reduced, *ends, walls, clearance=0.0, settings=settings, seed=seed)
        except InfeasibleError:
            continue
        passed += 1
    print(f"gap 1 cm too narrow: {passed} ways in {count} tries", flush=True)


def main() -> None:
    """Run the worlds that the command line names."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("count", nargs="?", type=int, default=20, help="worlds of each kind")
    parser.add_argument("worlds", nargs="*", help=f"of {', '.join(WORLDS)}; all by default")
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--gaps", type=int, default=1000)
    given = parser.parse_args()
    for name in given.worlds or WORLDS:
        run(name, given.count, given.seconds)
    if given.gaps:
        gaps(given.gaps)


if __name__ == "__main__":
    main()
