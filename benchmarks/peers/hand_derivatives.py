"""Derivatives of the dynamics written by hand in Python with Pinocchio's derivatives, and their cost beside ours."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import pinocchio as pin
from scipy.linalg.lapack import dgesv

import rnc_pin as rnc
from benchmarks.peers.cases import CASES, Case
from benchmarks.states import regular_states
from benchmarks.timing import in_turn, one_by_one, used_by

WORLD_AXES = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
STATES = 64
BLOCKS = "v_q", "v_v2", "v2_dot_q", "v2_dot_v2", "v2_dot_T"


class FreeArmDerivatives:
    """The blocks of ``state_derivatives`` for an arm on a floating base whose momentum is zero.

    Nothing reacts, so that Pinocchio's derivatives of forward dynamics need no multipliers.

    Args:
        model: robot whose first entries of v are the base's; no gravity acts along them.
        base: number of these entries.
        hand: frame whose linear velocity in world axes is the first part of v2.
        axes: number of its axes in v2.
        joints: entries of v that follow in v2.
    """

    def __init__(self, model: pin.Model, base: int, hand: str, axes: int, joints: list[int]) -> None:
        n = model.nv
        self._model, self._data, self._zero = model, model.createData(), np.zeros(n)
        self._base, self._hand, self._axes = base, model.getFrameId(hand), axes
        frame = model.frames[self._hand]
        self._joint, self._placement = frame.parentJoint, frame.placement
        self._E, self._force = np.zeros((n, n), order="F"), np.zeros(n)
        self._right, self._Ev_q = np.zeros((n, 1 + n - base)), np.zeros((n, n))
        self._drift_q, self._drift_v = np.zeros((2, n - base, n))
        self._right[base:, 1:] = np.eye(n - base)
        for row, entry in enumerate(joints):
            self._E[base + axes + row, entry] = 1.0

    def __call__(self, q: np.ndarray, v2: np.ndarray, T: np.ndarray) -> tuple[np.ndarray, ...]:
        """Blocks in the order of ``BLOCKS``."""
        model, data, base, axes, E = self._model, self._data, self._base, self._axes, self._E
        E[:base] = pin.crba(model, data, q, pin.Convention.WORLD)[:base]
        E[base : base + axes] = pin.getFrameJacobian(model, data, self._hand, WORLD_AXES)[:axes]
        self._right[base:, 0] = v2
        solved = dgesv(E, self._right)[2]
        v, R = np.ascontiguousarray(solved[:, 0]), solved[:, 1:]
        self._force[base:] = T
        self._Ev_q[:base] = pin.computeRNEADerivatives(model, data, q, self._zero, v)[0][:base]
        by_q, by_v, inverse = pin.computeABADerivatives(model, data, q, v, self._force)
        pin.computeForwardKinematicsDerivatives(model, data, q, v, data.ddq)
        v_q, a_q, a_v, _ = pin.getPointClassicAccelerationDerivatives(
            model, data, self._joint, self._placement, WORLD_AXES
        )
        self._Ev_q[base : base + axes] = v_q[:axes]
        self._drift_q[:axes], self._drift_v[:axes] = a_q[:axes], a_v[:axes]
        # The derivative by the joint acceleration is the Jacobian.
        J = E[base:]
        dv = -dgesv(E, self._Ev_q)[2]
        along_v = J.dot(by_v) + self._drift_v
        along_q = J.dot(by_q) + self._drift_q + along_v.dot(dv)
        return dv, R, along_q, along_v.dot(R), J.dot(inverse[:, base:])


BY_HAND = {  # base, hand, its axes and joints: the hand in the plane and the first joint; in space and four joints
    "space-robot": (1, "tip", 2, [1]),
    "free-panda": (6, "panda_hand", 3, [6, 8, 10, 12]),
}


def derivative_cost(name: str, rounds: int) -> dict[str, Any]:
    """Cost of ``state_derivatives`` at regular random states of a case, beside the same blocks by hand.

    One state, a state in a block of 64, and one state by hand [us]; the ratio of ours to that by hand, and the largest
    difference of a block, relative to its largest entry.
    """
    case = CASES[name]()
    states, by_hand = regular_states(case.reduced, case.q0, STATES), FreeArmDerivatives(case.model, *BY_HAND[name])
    given, ours = (states.q, states.v2, states.T), partial(rnc.state_derivatives, case.reduced)
    measured = one_by_one(ours, *given), used_by(lambda: ours(*given), STATES), one_by_one(by_hand, *given)
    ours_us, block_us, hand_us = (float(figure[0]) * 1e6 for figure in in_turn(measured, rounds))
    times = {"us": ours_us, "block_us": block_us, "hand_us": hand_us, "ratio": ours_us / hand_us}
    return {"system": name, **times, "difference": difference(case, by_hand, tuple(x[0] for x in given))}


def difference(case: Case, by_hand: FreeArmDerivatives, state: tuple[np.ndarray, ...]) -> float:
    """Largest difference of a block at a state, relative to its largest entry."""
    q, v2, T = state
    expected, found = rnc.state_derivatives(case.reduced, q, v2, T), by_hand(q, v2, T)
    pairs = [(block, getattr(expected, name)) for name, block in zip(BLOCKS, found, strict=True)]
    return max(float(np.abs(one - other).max() / np.abs(other).max()) for one, other in pairs)
