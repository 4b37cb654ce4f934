"""Symmetries of a reduced system: directions of motion along which it does not change, such as over flat ground.

The search covers two kinds: motions of the whole robot in the world, and motions of joints in their own axes, such as
about a wheel's axle. Along a symmetry, the velocities of all bodies, the reduced accelerations and the holonomic rows
do not change, at given reduced velocities and inputs. These changes are linear in the direction and come from analytic
derivatives. So the symmetries are a null space over sampled states.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin
import scipy

from rnc_pin.analysis.derivatives import state_derivatives
from rnc_pin.analysis.lie_brackets import frame_bracket
from rnc_pin.errors import ConstraintError, SingularityError
from rnc_pin.model.kinematics import Kinematics
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.robots.robot import Robot


class Symmetries:
    """Symmetries of a reduced system.

    Args:
        reduced: the model.
        twists: motions of the whole robot, (6, k) in the world [m/s, rad/s].
        joints: rates of joints in their own axes, (nv, s - k).

    Attributes:
        size: number of symmetries, s.
    """

    def __init__(self, reduced: ReducedModel, twists: np.ndarray, joints: np.ndarray) -> None:
        self._model = reduced.robot.model
        self._data = self._model.createData()
        self._twists, self._joints = twists, joints
        self.size = twists.shape[1] + joints.shape[1]

    def coefficients(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return the least-squares coefficients (s,) of the symmetries in a velocity (nv,).

        Args:
            q: configuration (nq,).
            v: the velocity.
        """
        dependent = 1e-9  # relative singular value: symmetries may coincide at some configurations
        return np.linalg.lstsq(self.directions(q), v, rcond=dependent)[0]

    def directions(self, q: np.ndarray) -> np.ndarray:
        """Return the velocities (nv, s) of the symmetries at a configuration (nq,).

        Args:
            q: the configuration.
        """
        return np.hstack([self._whole(q)[0] @ self._twists, self._joints])

    def gradient(self, q: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
        """Return the derivatives (nv, nv) of ``directions(q) @ coefficients``; the last index is the direction.

        Args:
            q: configuration (nq,).
            coefficients: coefficients of the symmetries (s,).
        """
        n, model = self._model.nv, self._model
        result = np.zeros((n, n))
        k = self._twists.shape[1]
        if not k:
            return result
        X, inverse = self._whole(q)
        velocity = X @ self._twists @ coefficients[:k]
        for direction in range(n):  # derivative of J X = twist, with constant twist
            pin.computeJointJacobiansTimeVariation(model, self._data, q, np.eye(n)[direction])
            rates = [
                pin.getJointJacobianTimeVariation(model, self._data, joint, pin.WORLD).reshape(6, n) @ velocity
                for joint in range(1, model.njoints)
            ]
            result[:, direction] = -inverse @ np.concatenate(rates)
        return result

    def _whole(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return _whole_motions(self._model, self._data, q)[:2]


def find_symmetries(reduced: ReducedModel, q: np.ndarray, cyclic: Sequence[str] = ()) -> Symmetries:
    """Return the symmetries of a system, by derivatives at sampled states near a configuration.

    Args:
        reduced: the model.
        q: configuration (nq,) in the middle of the samples.
        cyclic: joints, or entries of v, that count as symmetries although the dynamics depend on them.

    Raises:
        ModelError: unknown joint.
        ConstraintError: no regular configurations near q.
    """
    robot, n = reduced.robot, reduced.n
    model, data = robot.model, robot.model.createData()
    of_robot, of_joints = [np.zeros((0, 6))], [np.zeros((0, n))]
    # A fixed seed: the same system always has the same symmetries.
    generator = np.random.default_rng(0)
    for configuration in _sampled(reduced, q, generator):
        here = reduced.with_basis_at(configuration)
        changes = _changes(here, configuration, generator)
        X, _, misfit = _whole_motions(model, data, configuration)
        of_robot += [misfit, *(_scaled(each) @ X for each in (changes.bodies, *changes.others))]
        of_joints += [_scaled(each) for each in (changes.joints, *changes.others)]
    columns = [_null_space(np.vstack(of_joints)), *(np.eye(robot.nv)[:, entries_of(robot, name)] for name in cyclic)]
    return Symmetries(reduced, _null_space(np.vstack(of_robot)), scipy.linalg.orth(np.hstack(columns)))


def entries_of(robot: Robot, name: str) -> list[int]:
    """Return the indices in v of a joint, or of an entry of v by name.

    Args:
        robot: the robot.
        name: name of a joint, or of an entry of v.
    """
    names = robot.velocity_names
    return [names.index(name)] if name in names else [*range(robot.nv)[robot.velocity_indices(name)]]


class _Changes(NamedTuple):
    """Changes of the system along each direction, (k, nv) each, at given velocities and inputs."""

    joints: np.ndarray
    """Changes of the velocity in axes that move along with the joints."""
    bodies: np.ndarray
    """Changes of all body velocities in body axes; these show motions of the whole robot."""
    others: tuple[np.ndarray, np.ndarray]
    """Changes of the reduced accelerations, and of the holonomic rows."""


def _changes(reduced: ReducedModel, q: np.ndarray, generator: np.random.Generator) -> _Changes:
    v2, T = generator.normal(size=reduced.r), generator.normal(size=reduced.p)
    derivatives = state_derivatives(reduced, q, v2, T)
    model, assembly = reduced.robot.model, reduced.assembly
    data = model.createData()
    pin.computeForwardKinematicsDerivatives(model, data, q, derivatives.v, np.zeros(reduced.n))
    bodies = []
    for joint in range(1, model.njoints):
        along_q, along_v = pin.getJointVelocityDerivatives(model, data, joint, pin.LOCAL)
        # A single column arrives as a vector.
        bodies.append(along_q.reshape(6, -1) + along_v.reshape(6, -1) @ derivatives.v_q)
    closing = assembly.jacobian(Kinematics(reduced.robot).position(q))[assembly.leading]
    bracket, v = frame_bracket(model), derivatives.v
    # Velocities are in moving frames: the change along a field has the bracket of the joints' groups too.
    carried = np.stack([bracket(each, v) for each in np.eye(reduced.n)], axis=-1)
    return _Changes(derivatives.v_q + carried, np.vstack(bodies), (derivatives.v2_dot_q, closing))


def _sampled(reduced: ReducedModel, q: np.ndarray, generator: np.random.Generator) -> list[np.ndarray]:
    """Regular configurations near a given one that satisfy the holonomic rows."""
    found: list[np.ndarray] = []
    samples, tries = 4, 40  # states that decide, and configurations tried for them: some cannot be assembled
    spread = 1.0  # [rad or m]: far enough that accidental symmetries of one configuration vanish
    for _ in range(tries):
        tangent = generator.uniform(-spread, spread, reduced.n)
        try:
            configuration = reduced.assembled(pin.integrate(reduced.robot.model, q, tangent))
            _ = reduced.at(configuration).R
        except (ConstraintError, SingularityError):
            continue
        found.append(configuration)
        if len(found) == samples:
            return found
    raise ConstraintError("no steady motion: there are no regular configurations near the guess")


def _whole_motions(model: pin.Model, data: pin.Data, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Velocities (nv, 6) that move all bodies with a unit twist, the inverse that gave them, and the misfit."""
    pin.computeJointJacobians(model, data, q)
    joints = range(1, model.njoints)
    J = np.vstack([pin.getJointJacobian(model, data, joint, pin.WORLD).reshape(6, -1) for joint in joints])
    inverse, twists = np.linalg.pinv(J), np.tile(np.eye(6), (len(joints), 1))
    X = inverse @ twists
    return X, inverse, J @ X - twists


def _scaled(changes: np.ndarray) -> np.ndarray:
    largest = np.abs(changes).max(initial=0.0)
    no_change = 1e-12  # absolute zero limit for the changes along all directions
    return changes / largest if largest > no_change else np.zeros_like(changes)


def _null_space(rows: np.ndarray) -> np.ndarray:
    """Orthonormal basis of the directions without changes above ``_UNCHANGED``."""
    # Rows of zeros make the matrix tall: all right singular vectors have a value then.
    _, values, right = np.linalg.svd(np.vstack([rows, np.zeros((rows.shape[1], rows.shape[1]))]))
    unchanged = 1e-6  # zero limit, relative to the largest change along any direction
    return right[values < unchanged].T
