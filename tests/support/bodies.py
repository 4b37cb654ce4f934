"""Bodies of a Pinocchio model that is made in a test."""

import numpy as np
import pinocchio as pin

import rnc_pin as rnc


def add_body(model, name, kind, body, parent=0, *, com=(0, 0, 0), moments=1.0, at=None, frame=None):
    """Add a joint that carries a body, and a frame at it where that has a name; return the index of the joint.

    ``kind`` may be what follows ``pin.JointModel``, ``body`` a mass [kg] or an inertia, ``moments`` one or three about
    the center of mass [kg m^2], and ``at`` a placement or a place [m] on the parent.
    """
    here = pin.SE3.Identity()
    if isinstance(kind, str):
        kind = getattr(pin, f"JointModel{kind}")()
    if not isinstance(body, pin.Inertia):
        body = pin.Inertia(body, np.array(com, float), np.diag(np.broadcast_to(moments, 3).astype(float)))
    place = here if at is None else at if isinstance(at, pin.SE3) else pin.SE3(np.eye(3), np.array(at, float))
    joint = model.addJoint(parent, kind, place, name)
    model.appendBodyToJoint(joint, body, here)
    if frame is not None:
        add_frame(model, frame, joint)
    return joint


def add_frame(model, name, joint=0, at=(0, 0, 0)):
    """Add a frame to a joint, that of the world by default, at a placement or a place [m]; return its index."""
    place = at if isinstance(at, pin.SE3) else pin.SE3(np.eye(3), np.array(at, float))
    return model.addFrame(pin.Frame(name, joint, 0, place, pin.FrameType.OP_FRAME))


def frame_placement(robot, q, name):
    """Placement of a frame in the world, by Pinocchio itself."""
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, q)
    return data.oMf[robot.frame_id(name)].copy()


def free_body(mass, moments, **frames):
    """Return a robot of one free body with frames at given places."""
    model = pin.Model()
    joint = add_body(model, "root_joint", "FreeFlyer", mass, moments=moments)
    for name, place in frames.items():
        add_frame(model, name, joint, place)
    return rnc.Robot(model)
