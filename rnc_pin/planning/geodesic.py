"""Shortest rotation between two orientations, at rest at both ends."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from rnc_pin.math.coordinates import Coordinates, left_jacobian
from rnc_pin.planning.references import MinimumJerk, ReferencePoint


class Geodesic:
    """Minimum-jerk motion from start to goal, rotations about one axis: ``R(t) = exp(s(t) log(R1 R0^T)) R0``.

    Outputs on lines and circles move as in ``MinimumJerk``. Positions of rotations are rotation vectors of at most a
    half turn. The jerk of a rotation is NaN, because no controller uses it.

    Args:
        start: (k,), with rotation vectors for rotations.
        goal: (k,), in the same form.
        duration: of the motion [s].
        coordinates: coordinates of the outputs; they tell which outputs are rotations.
        begin: time at which it starts [s].

    Example:
        >>> robot = rnc.Robot.from_urdf("satellite.urdf", base="free", gravity=(0, 0, 0))
        >>> outputs = [rnc.FrameOrientation("satellite"), rnc.FramePosition("satellite")]
        >>> reduced = rnc.NonholonomicSystem(robot).reduce(outputs)
        >>> coordinates = reduced.reducing.coordinates
        >>> quarter = [0.0, 0.0, np.pi / 2, 1.0, 0.0, 0.0]
        >>> reference = rnc.planning.Geodesic(np.zeros(6), quarter, duration=2.0, coordinates=coordinates)
        >>> reference.at(1.0).position.round(6) + 0.0  # an eighth of a turn, and half a metre
        array([0.      , 0.      , 0.785398, 0.5     , 0.      , 0.      ])
    """

    def __init__(
        self, start: ArrayLike, goal: ArrayLike, duration: float, coordinates: Coordinates, begin: float = 0.0
    ) -> None:
        first, last = np.atleast_1d(np.asarray(start, dtype=float)), np.atleast_1d(np.asarray(goal, dtype=float))
        self._whole = MinimumJerk(first, last, duration, begin)
        self._turns = []
        for place in coordinates.rotations:
            triple = slice(place, place + 3)
            R0 = pin.exp3(first[triple])
            arc = pin.log3(pin.exp3(last[triple]) @ R0.T)
            self._turns.append((triple, R0, arc))
        self._share = MinimumJerk([0.0], [1.0], duration, begin)
        self.size, self.duration = self._whole.size, self._whole.duration

    def at(self, t: float) -> ReferencePoint:
        point = ReferencePoint(*(each.copy() for each in self._whole.at(t)))
        s, s_dot, s_ddot, _ = (float(each[0]) for each in self._share.at(t))
        for triple, R0, arc in self._turns:
            r = pin.log3(pin.exp3(s * arc) @ R0)
            J, _ = left_jacobian(r, np.zeros(3))
            velocity = np.linalg.solve(J, s_dot * arc)
            _, J_dot = left_jacobian(r, velocity)
            point.position[triple], point.velocity[triple] = r, velocity
            point.acceleration[triple] = np.linalg.solve(J, s_ddot * arc - J_dot @ velocity)
            point.jerk[triple] = np.nan
        return point
