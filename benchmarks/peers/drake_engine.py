"""Time derivatives of a ``MultibodyPlant`` of Drake, for systems whose only constraint is momentum."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import FixedOffsetFrame, RevoluteJoint, RigidBody, RotationalInertia, SpatialInertia

from benchmarks.peers.cases import Case
from benchmarks.peers.peer import Peer, forces
from benchmarks.states import States

_AXES = {f"JointModelR{axis}": vector for axis, vector in zip("XYZ", np.eye(3), strict=True)}


def peers(case: Case, states: States) -> list[Peer]:
    """``CalcTimeDerivatives`` for a state, which is copied in."""
    if not case.free:
        return []
    model = case.model
    plant, base = drake_plant(model)
    count, size = plant.num_positions(), plant.num_velocities()
    context, derivatives = plant.CreateDefaultContext(), plant.AllocateTimeDerivatives()
    port = plant.get_applied_generalized_force_input_port().FixValue(context, np.zeros(size))
    applied = port.GetMutableData().get_mutable_value()
    hinges = _hinges(plant, model)
    first = None if base is None else base.floating_velocities_start_in_v()
    each = []
    for q, v, force in zip(states.q, states.v, forces(case, states), strict=True):
        x, effort = np.zeros(count + size), np.zeros(size)
        for own_q, own_v, their_q, their_v in hinges:
            x[their_q], x[count + their_v], effort[their_v] = q[own_q], v[own_v], force[own_v]
        if base is not None:
            rotation, at = pin.Quaternion(q[3:7]).matrix(), base.floating_positions_start()
            x[at : at + 7] = q[6], *q[3:6], *q[:3]
            x[count + first : count + first + 6] = *(rotation @ v[3:6]), *(rotation @ v[:3])
            effort[first : first + 6] = *(rotation @ force[3:6]), *(rotation @ force[:3])
        each.append((x, effort))

    def forward(x: np.ndarray, effort: np.ndarray) -> None:
        plant.SetPositionsAndVelocities(context, x)
        applied.SetFromVector(effort)
        plant.CalcTimeDerivatives(context, derivatives)

    def v_dot() -> np.ndarray:
        found = np.zeros((len(each), model.nv))
        for state, q, v, out in zip(each, states.q, states.v, found, strict=True):
            forward(*state)
            rates = derivatives.CopyToVector()[count:]
            for _, own_v, _, their_v in hinges:
                out[own_v] = rates[their_v]
            if base is not None:  # velocities in the axes of the world, angular ones first
                rotation = pin.Quaternion(q[3:7]).matrix()
                out[3:6] = rotation.T @ rates[first : first + 3]
                out[:3] = rotation.T @ rates[first + 3 : first + 6] - np.cross(v[3:6], v[:3])
        return found

    return [Peer("Drake CalcTimeDerivatives", forward, each, v_dot)]


def drake_plant(model: pin.Model) -> tuple[MultibodyPlant, RigidBody | None]:
    """Bodies and joints of a robot of hinges in Drake, and its base if that is free."""
    plant = MultibodyPlant(time_step=0.0)
    bodies, base = [plant.world_body()], None
    for index in range(1, model.njoints):
        joint, name, inertia = model.joints[index], str(model.names[index]), model.inertias[index]
        I = inertia.inertia  # noqa: E741 (its usual letter)
        rotational = RotationalInertia(I[0, 0], I[1, 1], I[2, 2], I[0, 1], I[0, 2], I[1, 2])
        spatial = SpatialInertia.MakeFromCentralInertia(inertia.mass, inertia.lever, rotational)
        body = plant.AddRigidBody(name, spatial)
        placement, parent = model.jointPlacements[index], bodies[model.parents[index]].body_frame()
        if joint.shortname() == "JointModelFreeFlyer":
            base = body
        else:
            axis = _AXES[joint.shortname()]
            pose = RigidTransform(RotationMatrix(placement.rotation), placement.translation)
            frame = plant.AddFrame(FixedOffsetFrame(f"{name}/parent", parent, pose))
            plant.AddJoint(RevoluteJoint(name, frame, body.body_frame(), axis))
        bodies.append(body)
    plant.mutable_gravity_field().set_gravity_vector(model.gravity.linear)
    plant.Finalize()
    return plant, base


def _hinges(plant: MultibodyPlant, model: pin.Model) -> list[tuple[int, int, int, int]]:
    """Entries of q and v of each hinge, here and in Drake."""
    found = []
    for name, joint in zip(list(model.names)[1:], list(model.joints)[1:], strict=True):
        if joint.nv == 1:
            theirs = plant.GetJointByName(name)
            found.append((joint.idx_q, joint.idx_v, theirs.position_start(), theirs.velocity_start()))
    return found
