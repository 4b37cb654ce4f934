"""How far two frames are apart."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rnc_pin.errors import SingularityError
from rnc_pin.math.linear_algebra import complex_step
from rnc_pin.model.kinematics import Kinematics
from rnc_pin.model.rows import OutputRows
from rnc_pin.robots.robot import Robot

_TOGETHER = 1e-9


@dataclass(frozen=True)
class Distance:
    """Distance between the origins of two frames [m].

    Args:
        frame_a: name of one frame.
        frame_b: name of the other.
    """

    frame_a: str
    frame_b: str

    def bind(self, robot: Robot) -> OutputRows:
        return _DistanceRow(self, robot)


class _DistanceRow(OutputRows):
    def __init__(self, kind: Distance, robot: Robot) -> None:
        self.names = (f"distance_{kind.frame_a}_{kind.frame_b}",)
        self.units = ("m/s",)
        self.angular = (False,)
        self._a, self._b = robot.frame_id(kind.frame_a), robot.frame_id(kind.frame_b)

    def _vector(self, state: Kinematics) -> np.ndarray:
        return state.placement(self._b).translation - state.placement(self._a).translation

    def value(self, state: Kinematics) -> np.ndarray:
        return np.array([np.linalg.norm(self._vector(state))])

    def _direction(self, state: Kinematics) -> tuple[np.ndarray, float]:
        vector = self._vector(state)
        length = float(np.linalg.norm(vector))
        if length < _TOGETHER:
            raise SingularityError(
                "a distance has no rate where it is zero",
                q=state.q.copy(),
                condition=1 / max(length, 1e-300),
                rows=self.names,
            )
        return vector / length, length

    def jacobian(self, state: Kinematics) -> np.ndarray:
        direction, _ = self._direction(state)
        return (direction @ (state.jacobian(self._b) - state.jacobian(self._a))[:3])[None]

    def _relative_rates(self, state: Kinematics) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        direction, length = self._direction(state)
        velocity = state.velocity(self._b).linear - state.velocity(self._a).linear
        return direction, (velocity - direction * (direction @ velocity)) / length, velocity

    def jacobian_dot(self, state: Kinematics) -> np.ndarray:
        direction, direction_dot, _ = self._relative_rates(state)
        jacobian = (state.jacobian(self._b) - state.jacobian(self._a))[:3]
        jacobian_dot = (state.jacobian_dot(self._b) - state.jacobian_dot(self._a))[:3]
        return (direction @ jacobian_dot + direction_dot @ jacobian)[None]

    def drift(self, state: Kinematics) -> np.ndarray:
        direction, direction_dot, velocity = self._relative_rates(state)
        relative = state.acceleration(self._b).linear - state.acceleration(self._a).linear
        return np.array([direction @ relative + direction_dot @ velocity])

    def drift_gradient(self, state: Kinematics) -> np.ndarray:
        a, b = state.frame_gradients(self._a), state.frame_gradients(self._b)
        _, _, velocity = self._relative_rates(state)
        acceleration = state.acceleration(self._b).linear - state.acceleration(self._a).linear
        return complex_step(
            _distance_drift,
            (self._vector(state), (state.jacobian(self._b) - state.jacobian(self._a))[:3]),
            (velocity, b.velocity - a.velocity),
            (acceleration, b.acceleration - a.acceleration),
        )


def _distance_drift(vector: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray) -> np.ndarray:
    """Second derivative of the length of a vector."""
    length = np.sqrt(vector.dot(vector))
    rate = vector.dot(velocity) / length
    return np.array([(velocity.dot(velocity) + vector.dot(acceleration) - rate * rate) / length])
