"""Coordinates of outputs and of configurations: their differences, displacements, rates and records.

Outputs are real numbers, angles and rotation vectors.

A rotation R is written as its rotation vector r, ``R = exp(r)``. Rates of such outputs are angular velocities w in
world axes, and ``w = J(r) rdot`` with the left Jacobian of SO(3),

    J(r) = I + a [r] + b [r]^2,    a = (1 - cos u) / u^2,    b = (u - sin u) / u^3,    u = |r|

(Chirikjian, "Stochastic Models, Information Theory, and Lie Groups", volume 2, section 10.8). Exponentials and
logarithms are Pinocchio's.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from math import isnan
from typing import TypeVar

import numpy as np
import pinocchio as pin

from rnc_pin.array_shapes import Array, Float
from rnc_pin.errors import ConfigurationError

_Angle = TypeVar("_Angle", float, Array)


class Coordinates:
    """Coordinate types of k outputs: real numbers, angles, and rotation vectors of three entries.

    Args:
        angular: True for angles, which are compared modulo a full turn, (k,).
        rotations: index of the first entry of every rotation vector.
        names: names of the outputs for error messages, (k,); empty if they are not known.
    """

    def __init__(
        self, angular: Sequence[bool] | Array, rotations: Sequence[int] = (), names: Sequence[str] = ()
    ) -> None:
        self.names = tuple(names)
        self.angular = np.asarray(angular, dtype=bool)
        self.rotations = tuple(int(first) for first in rotations)
        self.size = len(self.angular)
        self._triples = [slice(first, first + 3) for first in self.rotations]
        self._has_angles = bool(self.angular.any())

    def choose(self, places: Array) -> Coordinates:
        """Coordinate types of the outputs at some indices, in this order.

        Args:
            places: indices of the outputs.

        Raises:
            ConfigurationError: the three components of a rotation are not all chosen, in order.
        """
        chosen = [int(place) for place in places]
        rotations = []
        for first in self.rotations:
            triple = [first, first + 1, first + 2]
            if not set(triple) & set(chosen):
                continue
            start = chosen.index(first) if first in chosen else -1
            # A rotation vector without one of its entries is no rotation.
            if start < 0 or chosen[start : start + 3] != triple:
                label = f"'{self.names[first].removesuffix('_x')}'" if self.names else f"at {first}"
                raise ConfigurationError(f"the three components of orientation {label} have to stay together, in order")
            rotations.append(start)
        names = [self.names[place] for place in chosen] if self.names else ()
        return Coordinates(self.angular[chosen], sorted(rotations), names)

    def difference(self, desired: Array, actual: Array) -> Array:
        """``desired - actual`` (..., k): angles in (-pi, pi]; ``log(Rd R^T)`` in world axes for rotations.

        Args:
            desired: goals (..., k) [rad or m].
            actual: values (..., k) [rad or m].
        """
        # Triples of rotations are overwritten below: their plain difference is no rotation.
        error = desired - actual
        if self._has_angles:
            error = np.where(self.angular, wrapped(error), error)
        for triple in self._triples:
            goal, here = desired[..., triple], actual[..., triple]
            if goal.ndim == here.ndim == 1:  # one state, on the hot path
                if not isnan(sum(goal.tolist())):
                    error[triple] = pin.log3(pin.exp3(goal) @ pin.exp3(here).T)
                continue
            if goal.shape != here.shape:
                goal, here = np.broadcast_arrays(goal, here)
            for at in np.ndindex(goal.shape[:-1]):
                # A goal of NaN gives an error of NaN.
                if not np.isnan(goal[at]).any():
                    error[(*at, triple)] = pin.log3(pin.exp3(goal[at]) @ pin.exp3(here[at]).T)
        return error

    def difference_rate(self, error: Array, desired_rate: Array, rate: Array) -> Array:
        """Rate of ``difference`` (..., k), from the error and both rates.

        Rotations have ``edot = J(e)^-1 wd - J(-e)^-1 w``.

        Args:
            error: the difference (..., k) [rad or m].
            desired_rate: rates of the goals (..., k); rotations have angular velocities in world axes [rad/s].
            rate: rates of the values (..., k), in the same axes.
        """
        change = desired_rate - rate
        for triple in self._triples:
            e = error[..., triple]
            wd, w = np.broadcast_to(desired_rate[..., triple], e.shape), np.broadcast_to(rate[..., triple], e.shape)
            for at in np.ndindex(e.shape[:-1]):
                right = pin.Jlog3(pin.exp3(e[at]))  # J(-e)^-1, and its transpose is J(e)^-1
                change[(*at, triple)] = right.T @ wd[at] - right @ w[at]
        return change

    def moved(self, start: Array, by: Array) -> Array:
        """``start`` displaced by ``by``, (k,). Rotations are rotated by the rotation vector ``by`` in world axes.

        Args:
            start: values (k,) [rad or m].
            by: displacements (k,) [rad or m].
        """
        goal = np.array(start + by)
        for triple in self._triples:
            # A displacement in world axes multiplies from the left.
            goal[triple] = pin.log3(pin.exp3(by[triple]) @ pin.exp3(start[triple]))
        return goal

    def to_rates(self, position: Array, velocity: Array, acceleration: Array) -> tuple[Array, Array]:
        """Rates and accelerations (k,) of a reference; rotations get angular velocity and angular acceleration.

        Args:
            position: values (k,); rotations as rotation vectors.
            velocity: their first derivatives (k,) [rad/s or m/s].
            acceleration: their second derivatives (k,) [rad/s^2 or m/s^2].
        """
        # At rest the angular velocity is zero at any rotation.
        if not self._triples or not (velocity.any() or acceleration.any()):
            return velocity, acceleration
        velocity, acceleration = np.array(velocity), np.array(acceleration)
        for triple in self._triples:
            if not (velocity[triple].any() or acceleration[triple].any()):
                continue
            # w = J rdot and wdot = J rddot + Jdot rdot.
            J, J_dot = left_jacobian(position[triple], velocity[triple])
            acceleration[triple] = J @ acceleration[triple] + J_dot @ velocity[triple]
            velocity[triple] = J @ velocity[triple]
        return velocity, acceleration

    def unwrap(self, series: Array, about: Array | None = None) -> Array:
        """Remove the jumps of angles and rotation vectors from a record (N, k): they continue past a half turn.

        Args:
            series: the record.
            about: approximate values (N, k) from integrated rates, which include full turns between two samples.
                Without them, an angle moves by at most a half turn between two samples.
        """
        smooth = np.array(series)
        if about is None:
            smooth[:, self.angular] = np.unwrap(smooth[:, self.angular], axis=0)
        else:
            for angle in np.flatnonzero(self.angular):  # one at a time: records are long
                # The integral of the rate has drifted by less than half a turn, so rounding finds the whole turns.
                turns = np.round((about[:, angle] - smooth[:, angle]) / (2 * np.pi))
                smooth[:, angle] += 2 * np.pi * turns
        for triple in self._triples:
            column = smooth[:, triple]
            for previous, vector in pairwise(column):
                # In place, so that the next pair compares with the vector that is already continued.
                vector[...] = _nearest_turn(vector, previous)
        return smooth


def arc_chord(turn: _Angle) -> tuple[_Angle, _Angle]:
    """Parts of the chord of an arc of unit length along and across its first direction, for an arc that turns by turn.

    These are ``sin(turn) / turn`` and ``(1 - cos(turn)) / turn``, which hold at zero too.

    Args:
        turn: angle [rad].
    """
    # NumPy's sinc has the factor pi; 1 - cos(x) = 2 sin^2(x / 2) keeps its digits near zero.
    return np.sinc(turn / np.pi), np.sin(turn / 2) * np.sinc(turn / (2 * np.pi))


def wrapped(angle: _Angle) -> _Angle:
    """Angle, or array of angles, wrapped to (-pi, pi].

    Args:
        angle: one angle, or any array [rad].
    """
    # This way round pi stays pi, and -pi becomes pi.
    return np.pi - np.mod(np.pi - angle, 2 * np.pi)


def heading_of(rotation: Array) -> float:
    """Yaw of the x axis of a rotation matrix (3, 3) [rad].

    Args:
        rotation: axes of the frame as columns, in the world.
    """
    return float(np.arctan2(rotation[1, 0], rotation[0, 0]))


def left_jacobian(r: Array, r_dot: Array) -> tuple[Array, Array]:
    """Left Jacobian J(r) with ``w = J(r) rdot``, and its rate along ``rdot``, (3, 3) each.

    Args:
        r: rotation vector (3,) [rad].
        r_dot: its derivative (3,) [rad/s].
    """
    square = float(r @ r)
    u = np.sqrt(square)
    small = 1e-2  # [rad]: below it the quotients lose digits by cancellation, and two terms of the series are exact
    if u < small:
        a, b = 1 / 2 - square / 24, 1 / 6 - square / 120
        a_dot, b_dot = -1 / 12 + square / 180, -1 / 60 + square / 1260  # (da/du) / u
    else:
        sine, cosine = np.sin(u), np.cos(u)
        a, b = (1 - cosine) / square, (u - sine) / (square * u)
        a_dot = (sine / u - 2 * a) / square
        b_dot = ((1 - cosine) / square - 3 * b) / square
    along = float(r @ r_dot)  # u udot
    K, K_dot = pin.skew(r), pin.skew(r_dot)
    J = np.eye(3) + a * K + b * (K @ K)
    J_dot = a * K_dot + b * (K_dot @ K + K @ K_dot) + along * (a_dot * K + b_dot * (K @ K))
    return J, J_dot


def rotation_vector_rates(r: Array, w: Array, w_dot: Array) -> tuple[Array, Array]:
    """First and second derivative (3,) of a rotation vector, from the angular velocity and acceleration.

    Args:
        r: rotation vector (3,) [rad].
        w: angular velocity (3,) in world axes [rad/s].
        w_dot: angular acceleration (3,) in world axes [rad/s^2].
    """
    J, _ = left_jacobian(r, np.zeros(3))
    r_dot = np.linalg.solve(J, w)
    # A second call: the rate of J needs rdot, which the first one gives.
    _, J_dot = left_jacobian(r, r_dot)
    return r_dot, np.linalg.solve(J, w_dot - J_dot @ r_dot)


def _nearest_turn(vector: Array, previous: Array) -> Array:
    """Rotation vector that is nearest to ``previous`` and gives the same rotation as ``vector``."""
    angle = float(np.linalg.norm(vector))
    length = float(np.linalg.norm(previous))
    # No axis is left: the rotation is the identity, which has all axes.
    if angle < 1e-12:
        if length < np.pi:
            return vector
        axis, angle = previous / length, 0.0  # whole turns about any axis are no rotation
    else:
        axis = vector / angle
    turns = np.round((float(axis @ previous) - angle) / (2 * np.pi))
    return (angle + 2 * np.pi * turns) * axis


# ------------------------------------------------------------------ configurations


class ConfigurationManifold:
    """Exponential map and its inverse, as Pinocchio defines them, for stacks of configurations.

    Args:
        model: Pinocchio's model.

    Example:
        >>> robot = rnc.Robot.from_urdf("unicycle.urdf", base="planar")
        >>> from rnc_pin.model.coordinates import ConfigurationManifold
        >>> manifold = ConfigurationManifold(robot.model)
        >>> start = np.tile(robot.configuration(), (2, 1))
        >>> step = np.array([[0.1, 0.0, 0.0, 0.0, 0.0], [0.1, 0.0, np.pi, 0.0, 0.0]])
        >>> manifold.integrate(start, step)[:, :2].round(4)
        array([[0.1   , 0.    ],
               [0.    , 0.0637]])
    """

    def __init__(self, model: pin.Model) -> None:
        self._model = model
        self.nv = model.nv

    def integrate(self, q: Float[Array, "n nq"], step: Float[Array, "n nv"]) -> Float[Array, "n nq"]:
        """Configurations displaced by tangent vectors.

        Args:
            q: configurations (n, nq).
            step: displacements (n, nv), in the moving axes of planar, spherical and free joints [rad or m].
        """
        return np.array([pin.integrate(self._model, a, b) for a, b in zip(q, step, strict=True)]).reshape(q.shape)

    def difference(self, start: Float[Array, "n nq"], end: Float[Array, "n nq"]) -> Float[Array, "n nv"]:
        """Tangent vectors at ``start`` that lead to ``end``.

        Args:
            start: configurations (n, nq).
            end: configurations (n, nq).
        """
        found = [pin.difference(self._model, a, b) for a, b in zip(start, end, strict=True)]
        return np.array(found).reshape(len(start), self.nv)

    def interpolate(
        self, start: Float[Array, "*n nq"], end: Float[Array, "*n nq"], parts: Float[Array, " n"]
    ) -> Float[Array, "n nq"]:
        """Configurations on the geodesics between two configurations, at fractions of them.

        Args:
            start: one configuration, or one for each part.
            end: one configuration, or one for each part.
            parts: fractions from 0 at the start to 1 at the end (n,).
        """
        step = parts[:, None] * self.difference(np.atleast_2d(start), np.atleast_2d(end))
        return self.integrate(np.broadcast_to(start, (len(parts), start.shape[-1])), step)


class PlacementChart:
    """Coordinates (nv,) of configurations about a center.

    A planar or free base has its translation in the axes that it has at the center, and its angle or rotation vector.
    Unlike in the logarithm of SE(2) and SE(3), the translation does not depend on the rotation. The coordinates of
    other joints are those of ``pinocchio.difference``.

    Args:
        model: Pinocchio's model.
        center: configuration (nq,) with zero coordinates.

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> from rnc_pin.model.coordinates import PlacementChart
        >>> chart = PlacementChart(robot.model, np.array([1.0, 0.0, 0.0, 1.0]))  # at x = 1 m, yaw 90 degrees
        >>> chart.coordinates(np.array([[1.0, 0.5, -1.0, 0.0]])).round(4)
        array([[0.5   , 0.    , 1.5708]])
    """

    def __init__(self, model: pin.Model, center: Float[Array, " nq"]) -> None:
        self._model, self._center = model, np.array(center, dtype=float)
        self._manifold = ConfigurationManifold(model)
        kinds = "JointModelPlanar", "JointModelFreeFlyer"
        self._bases = [(each.idx_q, each.idx_v, each.nv) for each in model.joints if each.shortname() in kinds]

    def coordinates(self, q: Float[Array, "n nq"]) -> Float[Array, "n nv"]:
        """Coordinates of configurations.

        Args:
            q: configurations (n, nq).
        """
        found = self._manifold.difference(np.broadcast_to(self._center, q.shape), q)
        for at, to, size in self._bases:
            axes = _base_axes(self._center[at:], size)
            # Instead of the logarithm of SE(2) or SE(3): the plain displacement, along the axes at the centre.
            found[:, to : to + len(axes)] = (q - self._center)[:, at : at + len(axes)] @ axes
        return found

    def jacobian(self, q: Float[Array, "n nq"]) -> Float[Array, "n nv nv"]:
        """Derivatives of the coordinates along tangent vectors at the configurations.

        Args:
            q: configurations (n, nq).
        """
        n, nv = len(q), self._manifold.nv
        found = np.array([pin.dDifference(self._model, self._center, each)[1] for each in q]).reshape(n, nv, nv)
        for at, to, size in self._bases:
            axes = _base_axes(self._center[at:], size)
            shift = slice(to, to + len(axes))
            # A tangent vector has its translation along the axes at q, which are turned against those at the centre.
            found[:, shift, to : to + size] = 0.0
            found[:, shift, shift] = [axes.T @ _base_axes(each[at:], size) for each in q]
        return found


def _base_axes(q: Array, size: int) -> Array:
    """Axes as columns of a base with 3 or 6 degrees of freedom, whose coordinates come first in q."""
    if size == 6:
        return np.array(pin.Quaternion(q[3:7]).toRotationMatrix())
    cosine, sine = q[2:4]
    return np.array([[cosine, -sine], [sine, cosine]])
