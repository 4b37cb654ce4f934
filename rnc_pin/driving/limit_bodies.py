"""Bodies that limits concern, so that a page can highlight them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from rnc_pin.robots.robot import Robot

_DISTANCE, _JOINT = " distance", (" position", " velocity")


class HighlightedBodies(NamedTuple):
    """Bodies of limits: names of visual shapes of the robot, and of obstacles."""

    shapes: frozenset[str]
    obstacles: frozenset[str]


class LimitBodies:
    """Map from the names of limits to bodies.

    Args:
        robot: robot with its visual shapes.
        obstacles: names of the obstacles.
    """

    def __init__(self, robot: Robot, obstacles: Iterable[str]) -> None:
        self._obstacles = frozenset(obstacles)
        model, visual = robot.model, robot.visual_model
        self._by_joint: dict[int, set[str]] = {}
        self._by_link: dict[str, set[str]] = {}
        for shape in () if visual is None else visual.geometryObjects:
            self._by_joint.setdefault(int(shape.parentJoint), set()).add(str(shape.name))
            self._by_link.setdefault(str(model.frames[shape.parentFrame].name), set()).add(str(shape.name))
        names = robot.velocity_names
        self._joints = {names[joint.idx_v + k]: i for i, joint in enumerate(model.joints) if i for k in range(joint.nv)}
        self._frames = {str(frame.name): int(frame.parentJoint) for frame in model.frames}

    def of(self, limits: Iterable[str]) -> HighlightedBodies:
        """Return the bodies of limits by their names; accelerations concern none."""
        joints: set[int] = set()
        shapes: set[str] = set()
        obstacles: set[str] = set()
        for name in limits:
            ending = next((each for each in _JOINT if name.endswith(each)), None)
            if name.endswith(_DISTANCE):
                for body in name.removesuffix(_DISTANCE).split(" / "):
                    if body in self._obstacles:
                        obstacles.add(body)
                    else:
                        shapes |= self._by_link.get(body, set())
            elif ending is not None and name.removesuffix(ending) in self._joints:
                joints.add(self._joints[name.removesuffix(ending)])
            elif not name.endswith(" acceleration") and name.split(" ")[0] in self._frames:
                joints.add(self._frames[name.split(" ")[0]])
        shapes |= {shape for joint in joints for shape in self._by_joint.get(joint, ())}
        return HighlightedBodies(frozenset(shapes), frozenset(obstacles))
