"""Navigation: arrivals, safe stops and collisions in drawn worlds that change, and the processor time of steps.

``python -m benchmarks navigation [N] [SYSTEM ...] [--world appear|cross] [--out FILE]``. In the worlds of ``appear``,
boxes appear before the robot and others vanish while it drives. A box appears only where the robot can stop before it:
its distance is above that of the closed form v^2 / (2 a), for all points of the robot, and the clearances. In those of
``cross``, two carts go to and fro across the robot's way, by a motion that it knows. Start and goal are drawn until the
whole robot is beside their lanes there, by more than the clearance and the tube. A run has 120 s.

A robot takes each velocity until the next sample. A replay by coal decides on collisions, at a quarter of the samples'
distance, without bounds. A robot arrives if its replay ends at rest within the tolerance. Else it has to stand, and
the verdict has to name what it missed and why. With a file, draws that it has are not run again.
"""

from __future__ import annotations

import argparse
import gc
import json
import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import NamedTuple

import coal
import numpy as np
import pinocchio as pin
from numpy import ndarray as Array

import rnc_pin as rnc
from benchmarks.planned_models import car, mobile_manipulator
from benchmarks.set_points import drive
from benchmarks.set_points import mecanum as tiago_pro
from rnc_pin.collision import CollisionDistances, Obstacle, PairSelection
from rnc_pin.control import NavigationController, WayFollowing
from rnc_pin.planning import ReferencePoint, find_steering
from rnc_pin.planning.action_models import KinematicFlow


def mecanum() -> rnc.ReducedModel:
    """The base of TIAGo Pro with one box as its outline."""
    model = tiago_pro().robot.model
    shape = pin.GeometryObject("body", 1, model.getFrameId("base_link"), pin.SE3.Identity(), coal.Box(0.75, 0.55, 1.2))
    outline = pin.GeometryModel()
    outline.addGeometryObject(shape)
    rollers = {"front_left": 1, "front_right": -1, "rear_left": -1, "rear_right": 1}
    wheels = [rnc.RollingWheel(f"wheel_{name}_link", 0.0762, roller=side * np.pi / 4) for name, side in rollers.items()]
    return rnc.NonholonomicSystem(rnc.Robot(model, collision_model=outline), wheels).reduce()


SYSTEMS: dict[str, Callable[[], rnc.ReducedModel]] = {
    "differential drive": drive,
    "car": car,
    "Mecanum base": mecanum,
    "mobile manipulator": mobile_manipulator,
}
FOLLOWING, CLEARANCE = WayFollowing(acceleration=2.0), 0.05
DT, DURATION, REST = 0.05, 120.0, 1.0  # [s]; of a sample, of a run, and at its end
ENDS, HALF, FREE = 3.5, 2.5, 0.3  # [m] from the middle to start and goal, half width, room around start and goal
REACH, CART = 2 * HALF, (0.5, 0.7, 1.0)  # [m]; way of a cart to both sides of the middle, and its size
BOXES, CHANGES, CARTS, TRIES = 5, 4, 2, 200
LIMIT = 0.02  # [s] of processor time that a step may take


@dataclass
class Shuttle:
    """Motion to and fro along y."""

    x: float
    rate: float
    phase: float
    size: int = 4

    def at(self, t: float) -> ReferencePoint:
        rate, values = self.rate, np.zeros((4, 4))
        c, s = REACH * math.cos(rate * t + self.phase), REACH * math.sin(rate * t + self.phase)
        values[0, 0] = self.x
        values[:, 1] = c, -rate * s, -(rate**2) * c, rate**3 * s
        return ReferencePoint(*values)


class Result(NamedTuple):
    """Result of one run."""

    arrived: bool
    named: bool
    """True for a robot that stands elsewhere, with a verdict that says so."""
    nearest: float
    """Smallest distance of the replay [m]."""
    longest: float
    """Longest processor time of a step [s]."""
    over: int
    """Number of steps that take longer than the limit."""
    steps: int


class Draw:
    """World of one seed.

    Args:
        reduced: the model.
        kind: "appear" or "cross".
        seed: seed of all choices.
    """

    def __init__(self, reduced: rnc.ReducedModel, kind: str, seed: int) -> None:
        self._reduced, self._draw = reduced, np.random.default_rng([seed, kind == "cross"])
        self.start, self.goal = (self._pose(side * ENDS) for side in (-1.0, 1.0))
        self._planned = find_steering(reduced, self.start).planned
        self.obstacles: list[Obstacle] = []
        self._count = 0
        if kind == "cross":
            for k, x in enumerate(np.array([-1.0, 1.0]) + self._draw.uniform(-0.4, 0.4, CARTS)):
                motion = Shuttle(
                    float(x), float(self._draw.uniform(0.1, 0.25)), float(self._draw.uniform(0, 2 * np.pi))
                )
                self.obstacles.append(Obstacle(coal.Box(*CART), name=f"cart {k + 1}", motion=motion))
            lanes = [
                Obstacle(coal.Box(CART[0], CART[1] + 2 * REACH, CART[2]), (each.motion.x, 0.0, 0.0), name=each.name)
                for each in self.obstacles
            ]
            beside = CollisionDistances(reduced.robot, lanes, PairSelection(links=False))
            room = CLEARANCE + FOLLOWING.tube
            while beside.smallest(self.start, 0.0, np.inf).min() < room:
                self.start = self._pose(-ENDS)
            while beside.smallest(self.goal, 0.0, np.inf).min() < room:
                self.goal = self._pose(ENDS)
        for _ in range(BOXES):
            self._appear(lambda: self._draw.uniform([-ENDS, -HALF], [ENDS, HALF]), self.start, FREE)
        times = np.sort(self._draw.uniform(1.0, 12.0, CHANGES if kind == "appear" else 0))
        self._changes = [(t, number % 2 == 0) for number, t in enumerate(times)]

    def _pose(self, x: float) -> Array:
        yaw = self._draw.uniform(-np.pi, np.pi)
        q = np.array(self._reduced.robot.configuration())
        q[:4] = x, self._draw.uniform(-1.0, 1.0), np.cos(yaw), np.sin(yaw)
        return q

    def _appear(self, place: Callable[[], Array], q: Array, room: float) -> bool:
        """True if a box is found that is not nearer to a configuration than the robot needs to stop."""
        for _ in range(TRIES):
            size, (x, y) = self._draw.uniform(0.3, 1.0, 2), place()
            box = Obstacle(coal.Box(*size, 1.0), position=(x, y, 0.0), name=f"box {self._count}")
            near = CollisionDistances(self._reduced.robot, [box], PairSelection(links=False))
            asked = ((self.goal, FREE), (q, room))
            if all(near.smallest(at, 0.0, np.inf).min() > least for at, least in asked):
                self.obstacles.append(box)
                self._count += 1
                return True
        return False

    def changed(self, t: float, q: Array, v: Array) -> bool:
        """True if the world changes now; ``v`` (nv,) is the velocity of the robot."""
        if not self._changes or t < self._changes[0][0]:
            return False
        _, appears = self._changes[0]
        if appears:
            base = q[:2]

            def before() -> Array:
                ahead = self._draw.uniform(0.2, 1.0) * (self.goal[:2] - base)
                return np.asarray(base + ahead + self._draw.normal(0.0, 0.3, 2))

            if not self._appear(before, q, self._room(q, v)):
                return False  # the robot is at its goal, or no box has room: again at the next sample
        elif self._count:
            self.obstacles.pop(int(self._draw.integers(len(self.obstacles))))
        self._changes.pop(0)
        return True

    def _room(self, q: Array, v: Array) -> float:
        """Distance within which a point of the robot can move before it stops [m], and what the way keeps."""
        robot, geometry = self._reduced.robot, self._reduced.robot.collision_model
        assert geometry is not None
        data, shapes = robot.model.createData(), geometry.createData()
        pin.updateGeometryPlacements(robot.model, data, geometry, shapes, q)
        pin.computeJointJacobians(robot.model, data, q)
        fastest = 0.0
        for shape, place in zip(geometry.geometryObjects, shapes.oMg, strict=True):
            shape.geometry.computeLocalAABB()
            motion = pin.getJointJacobian(robot.model, data, shape.parentJoint, pin.WORLD) @ v
            middle = place.act(shape.geometry.aabb_center)
            speed = np.linalg.norm(motion[:3] + np.cross(motion[3:], middle))
            fastest = max(fastest, float(speed + np.linalg.norm(motion[3:]) * shape.geometry.aabb_radius))
        stopping = np.abs(v[self._planned]).max() / FOLLOWING.acceleration
        return fastest * (0.5 * stopping + DT) + CLEARANCE + FOLLOWING.tube


class Replay:
    """Distances by coal between the robot and obstacles, at samples."""

    def __init__(self, reduced: rnc.ReducedModel) -> None:
        self._robot, self._data = reduced.robot, reduced.robot.model.createData()
        assert reduced.robot.collision_model is not None
        self._geometry = reduced.robot.collision_model
        self._placed = self._geometry.createData()
        self._request, self.nearest = coal.DistanceRequest(), np.inf

    def look(self, t: float, q: Array, obstacles: list[Obstacle]) -> None:
        """Measure one sample."""
        geometry = self._geometry
        pin.updateGeometryPlacements(self._robot.model, self._data, geometry, self._placed, q)
        for obstacle in obstacles:
            pose = obstacle.placement(t)
            there = coal.Transform3s(pose.rotation, pose.translation)
            for shape, place in zip(geometry.geometryObjects, self._placed.oMg, strict=True):
                here = coal.Transform3s(place.rotation, place.translation)
                result = coal.DistanceResult()
                coal.distance(shape.geometry, here, obstacle.shape, there, self._request, result)
                self.nearest = min(self.nearest, result.min_distance)


def run(name: str, kind: str, seed: int) -> Result:
    """One run in a drawn world."""
    reduced = SYSTEMS[name]()
    draw, flow, replay = Draw(reduced, kind, seed), KinematicFlow(reduced), Replay(reduced)
    controller = NavigationController(
        reduced, draw.goal, draw.obstacles, clearance=CLEARANCE, following=FOLLOWING, seed=seed
    )
    q, v2, times = draw.start, np.zeros(reduced.r), []
    state = controller.initial_state(reduced.at(q, v2).measure(np.zeros(reduced.r)))
    stood = 0.0
    gc.freeze()  # else Python's collector looks at all modules in some of the steps
    for number in range(int(DURATION / DT)):
        t = number * DT
        at = reduced.at(q, v2)
        if draw.changed(t, q, at.v):
            controller.set_obstacles(draw.obstacles)
        begin = time.process_time()
        target, state = controller.step(t, at.measure(np.zeros(reduced.r)), state)
        times.append(time.process_time() - begin)
        v2 = target.v2
        stood = 0.0 if v2.any() else stood + DT
        for part in range(4):
            replay.look(t + part * DT / 4, flow.step(q[None], part * DT / 4 * v2[None])[0], draw.obstacles)
        q = flow.step(q[None], DT * v2[None])[0]
        if controller.status == "arrived" and stood > REST:
            break
    gc.unfreeze()
    missed = controller.missed_goals(q, v2)
    away = np.abs(pin.difference(reduced.robot.model, q, draw.goal)[:3]).max()
    arrived = bool(not missed and stood and away <= FOLLOWING.tolerance)
    named = bool(not arrived and stood and missed and missed[0].reason and away > FOLLOWING.tolerance)
    over = sum(each > LIMIT for each in times)
    return Result(arrived, named, replay.nearest, max(times), over, len(times))


def row(name: str, kind: str, results: list[Result]) -> str:
    """Line of the table."""
    arrived, named = (sum(getattr(each, key) for each in results) for key in ("arrived", "named"))
    hit = sum(each.nearest <= 0.0 for each in results)
    nearest, longest = min(each.nearest for each in results), max(each.longest for each in results)
    over, steps = (sum(getattr(each, key) for each in results) for key in ("over", "steps"))
    return (
        f"| {name}, {kind} | {arrived} of {len(results)} | {named} | {len(results) - arrived - named} | {hit} | "
        f"{nearest:.3f} | {1e3 * longest:.0f} | {over} of {steps} |"
    )


def main() -> None:
    """Print a row for each system and kind of world."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("count", nargs="?", type=int, default=50)
    parser.add_argument("systems", nargs="*", choices=[*SYSTEMS, []], default=[])
    parser.add_argument("--world", choices=("appear", "cross"))
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    lines = given.out.read_text(encoding="utf-8").splitlines() if given.out and given.out.is_file() else []
    known = {(name, kind, seed): Result(*rest) for name, kind, seed, *rest in map(json.loads, lines)}
    rows = [(name, kind) for name in given.systems or SYSTEMS for kind in [given.world] if kind]
    rows = rows or [(name, kind) for name in given.systems or SYSTEMS for kind in ("appear", "cross")]
    for seed, (name, kind) in product(range(given.count), rows):
        if (name, kind, seed) not in known:
            known[name, kind, seed] = run(name, kind, seed)
            if given.out:
                with given.out.open("a", encoding="utf-8") as file:
                    file.write(json.dumps([name, kind, seed, *known[name, kind, seed]]) + "\n")
    print(
        "| system, world | arrived | stands, says why | else | touched | nearest [m] | longest step [ms] | over 20 ms |"
    )
    print("|---|---|---|---|---|---|---|---|")
    for name, kind in rows:
        print(row(name, kind, [known[name, kind, seed] for seed in range(given.count)]))


if __name__ == "__main__":
    main()
