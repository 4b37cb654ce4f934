"""Forward dynamics written by hand in Python on Pinocchio, as a careful user would write them for one robot.

Each class answers the question of ``forward_dynamics``: q, v2 and T in, v2_dot out. It is called as
``solution(q, v2, T)`` and returns ``(v2_dot, v, v_dot)``. Arrays are reused, one call of Pinocchio gives inertia and
joint Jacobians, and LAPACK is called without the checks of ``scipy.linalg``. ``rate`` is the same in the coordinates of
an integrator.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from scipy.linalg.lapack import dgesv, dposv

WORLD_AXES, OWN_AXES = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED, pin.ReferenceFrame.LOCAL
Solution = tuple[np.ndarray, np.ndarray, np.ndarray]


class FreeArm:
    """Arm on a floating base whose momentum is zero: rows of M replace constraint rows, and nothing reacts.

    Args:
        model: robot whose first entries of v are the base's.
        base: number of these entries.
        hand: frame whose velocity is a part of v2.
        axes: number of its axes in v2, possibly zero.
        joints: entries of v that follow in v2.
    """

    def __init__(self, model: pin.Model, base: int, hand: str, axes: int, joints: list[int]) -> None:
        self._model, self._data, self._zero = model, model.createData(), np.zeros(model.nv)
        self._base, self._hand, self._axes = base, model.getFrameId(hand), axes
        self._E, self._right = np.zeros((model.nv, model.nv), order="F"), np.zeros(model.nv)
        self._force, self._drift = np.zeros(model.nv), np.zeros(model.nv - base)
        for row, entry in enumerate(joints):
            self._E[base + axes + row, entry] = 1.0

    def __call__(self, q: np.ndarray, v2: np.ndarray, T: np.ndarray) -> Solution:
        model, data, base, axes, E = self._model, self._data, self._base, self._axes, self._E
        M = pin.crba(model, data, q, pin.Convention.WORLD)
        E[:base] = M[:base]
        if axes:
            E[base : base + axes] = pin.getFrameJacobian(model, data, self._hand, WORLD_AXES)[:axes]
        self._right[base:] = v2
        v = dgesv(E, self._right)[2]
        self._force[base:] = T
        v_dot = dposv(M, self._force - pin.nonLinearEffects(model, data, q, v))[1]
        v2_dot = E[base:].dot(v_dot)
        if axes:
            pin.forwardKinematics(model, data, q, v, self._zero)
            v2_dot[:axes] += pin.getFrameClassicalAcceleration(model, data, self._hand, WORLD_AXES).linear[:axes]
        return v2_dot, v, v_dot


class RollingArm:
    """KKT of a robot on a planar base whose constraint rows are parts of frame velocities.

    Args:
        model: robot on a planar base.
        m: number of constraint rows.
        B: constant part of the matrix of inputs.
    """

    def __init__(self, model: pin.Model, m: int, B: np.ndarray) -> None:
        n = model.nv
        self.model, self.data, self._zero, self.m, self.B = model, model.createData(), np.zeros(n), m, B
        self.E, self._kkt = np.zeros((n, n), order="F"), np.zeros((n + m, n + m), order="F")
        self._speeds, self._right, self.drift = np.zeros(n), np.zeros(n + m), np.zeros(n)

    def set_rows(self) -> None:
        """Write constraint rows, then rows of v2, into E, and inputs into B."""
        raise NotImplementedError

    def set_drift(self) -> None:
        """Write ``Edot v`` into drift; accelerations of frames are those at zero joint acceleration."""
        raise NotImplementedError

    def __call__(self, q: np.ndarray, v2: np.ndarray, T: np.ndarray) -> Solution:
        model, data, m, E, K = self.model, self.data, self.m, self.E, self._kkt
        n = model.nv
        K[:n, :n] = pin.crba(model, data, q, pin.Convention.WORLD)
        self.set_rows()
        K[n:, :n] = E[:m]
        K[:n, n:] = E[:m].T
        self._speeds[m:] = v2
        v = dgesv(E, self._speeds)[2]
        pin.forwardKinematics(model, data, q, v, self._zero)
        self.set_drift()
        self._right[:n] = self.B.dot(T) - pin.nonLinearEffects(model, data, q, v)
        self._right[n:] = -self.drift[:m]
        v_dot = dgesv(K, self._right)[2][:n]
        return E[m:].dot(v_dot) + self.drift[m:], v, v_dot


class MobileManipulator(RollingArm):
    """Platform that does not slip along its axle, with an arm of two joints: hand, forward speed and yaw."""

    def __init__(self, model: pin.Model) -> None:
        super().__init__(model, 1, np.zeros((model.nv, 4)))
        self._axle, self._base, self._tip = (model.getFrameId(name) for name in ("axle", "base", "tip"))
        self.B[3, 2] = self.B[4, 3] = 1.0

    def set_rows(self) -> None:
        """Lateral speed of the axle; hand, forward speed and yaw rate of the platform; force and torque on it."""
        model, data, E, B = self.model, self.data, self.E, self.B
        E[0] = pin.getFrameJacobian(model, data, self._axle, OWN_AXES)[1]
        E[1:3] = pin.getFrameJacobian(model, data, self._tip, WORLD_AXES)[:2]
        platform = pin.getFrameJacobian(model, data, self._base, OWN_AXES)
        E[3:] = platform[::5]
        B[:, :2] = platform[::5].T

    def set_drift(self) -> None:
        """Accelerations of the frames."""
        model, data, drift = self.model, self.data, self.drift
        drift[0] = pin.getFrameAcceleration(model, data, self._axle, OWN_AXES).vector[1]
        drift[1:3] = pin.getFrameClassicalAcceleration(model, data, self._tip, WORLD_AXES).linear[:2]
        drift[3:] = pin.getFrameAcceleration(model, data, self._base, OWN_AXES).vector[::5]


class Tiago(RollingArm):
    """TIAGo on two rolling wheels: forward speed and yaw rate of its base, and all joints of torso and arm."""

    RADIUS = 0.0985

    def __init__(self, model: pin.Model) -> None:
        n = model.nv
        super().__init__(model, 3, np.zeros((n, n - 3)))
        wheels = "wheel_left_joint", "wheel_right_joint"
        self._wheels = [model.getFrameId(f"{name.removesuffix('_joint')}_link") for name in wheels]
        driven = [model.joints[model.getJointId(name)].idx_v for name in wheels]
        others = [entry for entry in range(3, n) if entry not in driven]
        self.B[driven + others, range(n - 3)] = 1.0
        for row, entry in enumerate([0, 2, *others]):
            self.E[3 + row, entry] = 1.0

    def set_rows(self) -> None:
        """Velocities of both points of contact: along the heading, of the left one also to the side."""
        model, data, E = self.model, self.data, self.E
        heading = data.oMi[1].rotation[:2, :2]
        left, right = (pin.getFrameJacobian(model, data, frame, WORLD_AXES) for frame in self._wheels)
        E[:2] = heading.T.dot(self._contact(left))
        E[2] = heading[:, 0].dot(self._contact(right))

    def _contact(self, J: np.ndarray) -> np.ndarray:
        rows = J[:2].copy()
        rows[0] -= self.RADIUS * J[4]
        rows[1] += self.RADIUS * J[3]
        return rows

    def set_drift(self) -> None:
        """Accelerations of the points of contact; their velocities are zero, so that rates of the heading drop out."""
        model, data, drift = self.model, self.data, self.drift
        heading = data.oMi[1].rotation[:2, :2]
        left, right = (pin.getFrameClassicalAcceleration(model, data, frame, WORLD_AXES) for frame in self._wheels)
        drift[:2] = heading.T.dot(self._contact(left.vector))
        drift[2] = heading[:, 0].dot(self._contact(right.vector))
