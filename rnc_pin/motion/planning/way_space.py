"""OMPL's state space of a robot: subspaces of its planned joints, and states from configurations and back."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin
from numpy import ndarray as Array
from numpy.typing import ArrayLike

from rnc_pin.array_shapes import Float
from rnc_pin.collision import Obstacle
from rnc_pin.collision.shapes import bounding_box
from rnc_pin.errors import ConfigurationError, InputError
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.motion.planning.exact_steering import Steering, base_axes
from rnc_pin.motion.planning.way_checking import WayChecker
from rnc_pin.robots.joint_values import NO_LIMIT

if TYPE_CHECKING:
    from ompl import base as ob

_REACH = 0.3  # [m]; metric of joints: a turn by 1 rad counts as a path of this length
_TURN = np.pi  # [rad]; range of revolute joints without limits, to both sides
_SLIDE = 1.0  # [m]; the same for prismatic ones


class WaySpace:
    """State space of the planned joints, in which OMPL samples, and measures distances.

    Args:
        steering: exact steering; its radius gives the metric of a car.
        configurations: configurations (n, nq) that the space contains: start and goals.
        area: smallest and largest coordinates (2, 3) of the base [m].
        held: names of joints that stay within the range of ``configurations``.

    Attributes:
        space: OMPL's compound space.

    Raises:
        ConfigurationError: the space does not support a joint.
    """

    def __init__(
        self,
        steering: Steering,
        configurations: Float[Array, "n nq"],
        area: Float[Array, "2 3"],
        held: Sequence[str] = (),
    ) -> None:
        from ompl import base as ob

        self._ob, self._model = ob, steering.reduced.robot.model
        self._q0, self._coupled = np.array(configurations[0]), steering.couplings.applied
        self.space = ob.CompoundStateSpace()
        self._parts: list[tuple[str, int]] = []
        reals: list[tuple[int, float, float]] = []
        for index, joint in enumerate(self._model.joints):
            if not index or not steering.sampled[joint.idx_v : joint.idx_v + joint.nv].all():
                continue
            kind, entry = joint.shortname(), int(joint.idx_q)
            if kind == "JointModelPlanar":
                plane = ob.ReedsSheppStateSpace(steering.radius) if steering.radius else ob.SE2StateSpace()
                self._bound(plane, area[:, :2])
                self._add("planar", entry, plane, 1.0)
            elif kind == "JointModelFreeFlyer":
                body = ob.SE3StateSpace()
                self._bound(body, area)
                self._add("free", entry, body, 1.0)
            elif kind == "JointModelSpherical":
                self._add("ball", entry, ob.SO3StateSpace(), _REACH)
            elif joint.nq == 2 and joint.nv == 1:
                self._add("circle", entry, ob.SO2StateSpace(), _REACH)
            elif joint.nq == joint.nv:
                tight = self._model.names[index] in held
                reals += [(entry + k, *self._range(entry + k, configurations, kind, tight)) for k in range(joint.nq)]
            else:
                raise ConfigurationError(
                    f"ways: joint '{self._model.names[index]}' is a {kind}, which ways do not support"
                )
        self._entries = [entry for entry, _, _ in reals]
        if reals:
            joints = ob.RealVectorStateSpace(len(reals))
            self._bound(joints, np.array(reals)[:, 1:].T)
            self._add("reals", 0, joints, _REACH)

    def _add(self, kind: str, entry: int, space: ob.StateSpace, weight: float) -> None:
        self.space.addSubspace(space, weight)
        self._parts.append((kind, entry))

    def _bound(self, space: ob.StateSpace, area: Array) -> None:
        bounds = self._ob.RealVectorBounds(area.shape[1])
        for k, (low, high) in enumerate(area.T.tolist()):
            bounds.setLow(k, low)
            bounds.setHigh(k, high)
        space.setBounds(bounds)

    def _range(self, entry: int, configurations: Array, kind: str, tight: bool) -> tuple[float, float]:
        """Range of a joint in the space: its limits, which the configurations are within."""
        own = configurations[:, entry]
        first, last = float(own.min()), float(own.max())
        if tight:
            return first - 1e-9, last + 1e-9
        low, high = float(self._model.lowerPositionLimit[entry]), float(self._model.upperPositionLimit[entry])
        room = _SLIDE if kind.startswith("JointModelP") else _TURN
        if not low < high:
            low, high = -np.inf, np.inf
        low = low if low > -NO_LIMIT else first - room
        high = high if high < NO_LIMIT else last + room
        return min(low, first), max(high, last)

    def write(self, state: ob.State, q: Float[Array, " nq"]) -> None:
        """Set a state to a configuration."""
        for k, (kind, entry) in enumerate(self._parts):
            own = state[k]
            if kind == "reals":
                own[0 : len(self._entries)] = q[self._entries].tolist()
            elif kind == "circle":
                own.value = float(np.arctan2(q[entry + 1], q[entry]))
            elif kind == "planar":
                own.setXY(float(q[entry]), float(q[entry + 1]))
                own.setYaw(float(np.arctan2(q[entry + 3], q[entry + 2])))
            else:
                turn = own
                if kind == "free":
                    own.setXYZ(*q[entry : entry + 3].tolist())
                    turn, entry = own.rotation(), entry + 3
                turn.x, turn.y, turn.z, turn.w = q[entry : entry + 4].tolist()

    def read(self, state: ob.State) -> Float[Array, " nq"]:
        """Configuration of a state; joints that follow are as at the start."""
        q = self._q0.copy()
        for k, (kind, entry) in enumerate(self._parts):
            own = state[k]
            if kind == "reals":
                q[self._entries] = own[0 : len(self._entries)]
            elif kind == "circle":
                q[entry : entry + 2] = np.cos(own.value), np.sin(own.value)
            elif kind == "planar":
                yaw = own.getYaw()
                q[entry : entry + 4] = own.getX(), own.getY(), np.cos(yaw), np.sin(yaw)
            else:
                turn = own
                if kind == "free":
                    q[entry : entry + 3] = own.getX(), own.getY(), own.getZ()
                    turn, entry = own.rotation(), entry + 3
                q[entry : entry + 4] = turn.x, turn.y, turn.z, turn.w
        return self._coupled(pin.normalize(self._model, q))


def base_area(
    reduced: ReducedModel,
    radius: float,
    configurations: Float[Array, "n nq"],
    obstacles: Sequence[Obstacle],
    checker: WayChecker | None,
    given: ArrayLike | None,
) -> Float[Array, "2 3"]:
    """Smallest and largest coordinates of the base."""
    if given is not None:
        area = np.asarray(given, dtype=float)
        if area.shape != (2, 3) or not (area[0] < area[1]).all():
            raise InputError(f"area: expected smallest and largest x, y and z (2, 3), found {area.tolist()}")
        return area
    size = base_axes(reduced.robot.model)
    points = np.zeros((len(configurations), 3))
    points[:, :size] = configurations[:, :size]
    corners = [points]
    for obstacle in obstacles:
        if not obstacle.unbounded:
            center, halves = bounding_box(obstacle.shape, obstacle.name)
            pose = obstacle.placement(0.0)
            middle, reach = pose.act(center), np.abs(pose.rotation) @ halves
            corners.append(np.array([middle - reach, middle + reach]))
    every = np.concatenate(corners)
    room = 1.0 + 2.0 * radius
    if checker is not None:
        room += 2.0 * float(checker.distances.radii[: checker.distances.link_shapes].max())
    return np.array([every.min(axis=0) - room, every.max(axis=0) + room])
