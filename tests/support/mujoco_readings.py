"""A robot read from MJCF beside MuJoCo's own reading: joints, limits, losses, moments, gravity, sites."""

from __future__ import annotations

import mujoco
import numpy as np
import pinocchio as pin

import rnc_pin as rnc

_SCALAR_LAST = {1: [0], 4: [3, 0, 1, 2], 7: [0, 1, 2, 6, 3, 4, 5]}  # MuJoCo has the scalar of a quaternion first


def difference(robot: rnc.Robot, theirs: mujoco.MjModel) -> str:
    """Name of the first difference; empty if there is none."""
    model = robot.model
    if (len(robot.joint_names), robot.nv) != (theirs.njnt, theirs.nv):
        return f"{len(robot.joint_names)} joints of {theirs.njnt}"
    q, data, entries = pin.neutral(model), mujoco.MjData(theirs), np.zeros(theirs.nv, dtype=int)
    generator = np.random.default_rng(0)
    for k, index in enumerate(_order(robot, theirs)):
        joint, start, first = model.joints[index], theirs.jnt_qposadr[k], theirs.jnt_dofadr[k]
        entries[first : first + joint.nv] = range(joint.idx_v, joint.idx_v + joint.nv)
        own = generator.uniform(-1, 1, joint.nq)
        if joint.nq > 1:
            own[-4:] /= np.linalg.norm(own[-4:])
        else:
            limits = [model.lowerPositionLimit[joint.idx_q], model.upperPositionLimit[joint.idx_q]]
            if not np.allclose(limits, theirs.jnt_range[k] if theirs.jnt_limited[k] else [-np.inf, np.inf]):
                return "limits"
        q[joint.idx_q : joint.idx_q + joint.nq] = own
        data.qpos[start : start + joint.nq] = own[_SCALAR_LAST[joint.nq]]
    mujoco.mj_forward(theirs, data)
    damping = theirs.dof_damping if theirs.dof_damping.ndim == 1 else theirs.dof_damping[:, 0]
    losses = ((model.damping, damping), (model.armature, theirs.dof_armature))
    if not all(np.allclose(ours[entries], other) for ours, other in losses):
        return "damping or armature"
    here, M = model.createData(), np.zeros((theirs.nv, theirs.nv))
    for row, unit in zip(M, np.eye(theirs.nv), strict=True):
        mujoco.mj_mulM(theirs, data, row, unit)
    # Entries of a free joint come in other axes, of which eigenvalues know nothing.
    moments = np.linalg.eigvalsh(M)
    if not np.allclose(np.linalg.eigvalsh(pin.crba(model, here, q)), moments, rtol=1e-6, atol=1e-9 * moments[-1]):
        return "moments"
    if (theirs.jnt_type != mujoco.mjtJoint.mjJNT_FREE).all():
        gravity = pin.computeGeneralizedGravity(model, here, q)[entries]
        if not np.allclose(gravity, data.qfrc_bias, rtol=1e-6, atol=1e-9 * max(1.0, float(np.abs(gravity).max()))):
            return "gravity"
    pin.framesForwardKinematics(model, here, q)
    for k in range(theirs.nsite):
        name = theirs.site(k).name
        if name and theirs.site_bodyid[k] > 0:
            frame = here.oMf[model.getFrameId(name, pin.FrameType.OP_FRAME)]
            ours = np.concatenate([frame.translation, frame.rotation.ravel()])
            if not np.allclose(ours, [*data.site_xpos[k], *data.site_xmat[k]], atol=1e-6):
                return f"site '{name}'"
    return ""


def _order(robot: rnc.Robot, theirs: mujoco.MjModel) -> list[int]:
    """Our joint for each of theirs: by name, those without one in their order."""
    names = [theirs.joint(k).name for k in range(theirs.njnt)]
    nameless = (k for k, name in enumerate(robot.model.names) if k and name not in names)
    return [robot.model.getJointId(name) if name else next(nameless) for name in names]
