"""Largest clearance with which the robot can pass a drawn doorway: the hand stays, and the elbow has to pass.

With the hand fixed, the elbow moves on a circle about the hand, and forearm and elbow have no other freedom. So every
motion of the platform from one side to the other contains all angles of an arc: one of two, to one of two goal angles.
If bodies touch at one angle of each of these arcs, no motion exists. This condition is necessary, not sufficient.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import coal
import numpy as np

from rnc_pin.applications.scenario.builder import build_system
from rnc_pin.applications.scenario.files import find_scenario, read_yaml
from rnc_pin.applications.scenario.schema.scenario import validate
from rnc_pin.collision import CollisionDistances, Obstacle
from rnc_pin.robots.robot import Robot

CLEARANCE = 0.05  # [m] that the scenario keeps
_STEP = 0.01  # [rad] between tested angles
_FAR = 1.0  # [m] up to which distances are exact


@cache
def doorway_robot() -> Robot:
    path = find_scenario("doorway")
    return build_system(validate(read_yaml(path), "doorway"), path.parent).robot


def passage(start: Sequence[float], bend: float, goal: Sequence[float], jambs: Sequence[Obstacle]) -> float:
    """Return the largest clearance [m] with which elbow and forearm can pass, negative or zero if they touch.

    Args:
        start: pose (x, y, yaw) of the platform at the start.
        bend: joint_1 at the start; joint_2 is -2 of it [rad].
        goal: pose of the platform at the end.
        jambs: the door.
    """
    x, y, yaw = start
    elbow = np.array([x + np.cos(yaw + bend), y + np.sin(yaw + bend)])
    hand = np.add(elbow, [np.cos(yaw - bend), np.sin(yaw - bend)])
    ahead = np.asarray(goal[:2]) - hand
    to_goal, half = np.arctan2(ahead[1], ahead[0]), np.arccos(min(float(np.linalg.norm(ahead)) / 2.0, 1.0))
    first = np.arctan2(*(elbow - hand)[::-1])
    arcs = [(last - first) % (2 * np.pi) - turn for last in (to_goal + half, to_goal - half) for turn in (0, 2 * np.pi)]
    distances = CollisionDistances(doorway_robot(), jambs, q0=_stretched(hand, first))
    doors = {each.name for each in jambs}
    forearm = [
        k
        for k, pair in enumerate(distances.pairs)
        if pair.names[1] in doors and (pair.names[0] in ("link_2", "tip") or _is_elbow(pair.names[0], pair.first))
    ]

    def clearance(angle: float) -> float:
        return float(distances.smallest(_stretched(hand, angle), 0.0, _FAR)[forearm].min())

    def least(arc: float) -> float:
        found = _FAR
        for angle in np.linspace(first, first + arc, max(int(abs(arc) / _STEP), 2)).tolist():
            found = min(found, clearance(angle))
            if found <= 0.0:
                break
        return found

    return max(map(least, arcs))


def _is_elbow(link: str, shape: int) -> bool:
    model = doorway_robot().collision_model
    return link == "link_1" and model is not None and isinstance(model.geometryObjects[shape].geometry, coal.Sphere)


def _stretched(hand: np.ndarray, angle: float) -> np.ndarray:
    """Configuration with the elbow at this angle about the hand; the rest of the robot is on the far side."""
    base = hand + 2.0 * np.array([np.cos(angle), np.sin(angle)])
    return doorway_robot().configuration({"root_joint": [*base, 0.0], "joint_1": angle + np.pi, "joint_2": 0.0})
