"""``mj_forward`` of MuJoCo, for systems whose only constraint is momentum; rolling is friction there, another model."""

from __future__ import annotations

import mujoco
import numpy as np
import pinocchio as pin

from benchmarks.peers.cases import Case
from benchmarks.peers.peer import Peer, forces
from benchmarks.states import States
from rnc_pin.lab.mujoco import MuJoCoPlant


def peers(case: Case, states: States) -> list[Peer]:
    """One call of ``mj_forward`` for a state, which is copied in."""
    if not case.free:
        return []
    plant = MuJoCoPlant(case.reduced, q0=case.q0)
    model, data = plant.model, plant.data
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    each = []
    for q, v, force in zip(states.q, states.v, forces(case, states), strict=True):
        plant.reset(q, v)
        applied = np.zeros(model.nv)
        plant._joints.add_force(data.qpos, force, applied)
        each.append((data.qpos.copy(), data.qvel.copy(), applied))
    qpos, qvel, qfrc = data.qpos, data.qvel, data.qfrc_applied

    def forward(*state: np.ndarray) -> None:
        qpos[:], qvel[:], qfrc[:] = state
        mujoco.mj_forward(model, data)

    def v_dot() -> np.ndarray:
        found = []
        for state, q, v in zip(each, states.q, states.v, strict=True):
            forward(*state)
            found.append(_in_own_axes(case.model, data.qacc.copy(), q, v))
        return np.array(found)

    return [Peer("MuJoCo mj_forward", forward, each, v_dot)]


def _in_own_axes(model: pin.Model, acceleration: np.ndarray, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Rates of v from those of MuJoCo, where the linear velocity of a free base has the axes of the world."""
    if model.joints[1].shortname() == "JointModelFreeFlyer":
        rotation = pin.Quaternion(q[3:7]).matrix()
        acceleration[:3] = rotation.T @ acceleration[:3] - np.cross(v[3:6], v[:3])
    return acceleration
