"""Kinematics of one state, each quantity with a workspace of its own, and differences along the motion."""

import numpy as np
import pinocchio as pin

import rnc_pin as rnc
from bodies import add_body, add_frame

STEP = 1e-5  # of central differences


def tree():
    """A body that flies, with a turning and an endless joint on one branch, a ball and a slide on the other."""
    model, generator = pin.Model(), np.random.default_rng(4)
    flyer = 0
    for name, kind, parent in (
        ("flyer", "FreeFlyer", None), ("turn", "RX", "flyer"), ("endless", "RUBZ", "turn"),
        ("ball", "Spherical", "flyer"), ("slide", "PZ", "ball"),
    ):  # fmt: skip
        place = pin.SE3(pin.rpy.rpyToMatrix(*generator.uniform(-1, 1, 3)), generator.uniform(-1, 1, 3))
        parent_id = flyer if parent is None else model.getJointId(parent)
        joint = model.addJoint(parent_id, getattr(pin, f"JointModel{kind}")(), place, name)
        body = pin.Inertia(generator.uniform(1, 3), generator.uniform(-0.3, 0.3, 3), np.diag([0.3, 0.4, 0.5]))
        model.appendBodyToJoint(joint, body, pin.SE3.Identity())
    for name in ("universe", "flyer", "endless", "ball", "slide"):
        place = pin.SE3(pin.rpy.rpyToMatrix(*generator.uniform(-1, 1, 3)), generator.uniform(-1, 1, 3))
        add_frame(model, f"on_{name}", 0 if name == "universe" else model.getJointId(name), place)
    return rnc.Robot(model)


def slider():
    """One degree of freedom, of which Pinocchio gives vectors in place of matrices."""
    model = pin.Model()
    place = pin.SE3(pin.rpy.rpyToMatrix(0.2, 0.3, 0.4), np.ones(3))
    joint = add_body(model, "turn", "RX", 2.0, com=(0.1, 0.2, 0.3), at=place)
    add_frame(model, "on_turn", joint, pin.SE3(pin.rpy.rpyToMatrix(0.5, -0.3, 0.7), np.array([0.3, -0.4, 0.6])))
    return rnc.Robot(model)


ROBOTS = {"tree": tree(), "slider": slider()}


def states(robot, seed=0):
    generator = np.random.default_rng(seed)
    q = np.stack([robot.random_configuration(generator) for _ in range(6)]).reshape(2, 3, robot.nq)
    return q, generator.normal(size=(2, 3, robot.nv))


class Plain:
    """One state, each question with a workspace that nobody has used."""

    def __init__(self, robot, q, v):
        self.model, self.q, self.v = robot.model, q, v

    def placement(self, frame, q=None):
        data = self.model.createData()
        pin.framesForwardKinematics(self.model, data, self.q if q is None else q)
        return data.oMf[frame]

    def joint_placement(self, joint):
        data = self.model.createData()
        pin.forwardKinematics(self.model, data, self.q)
        return data.oMi[joint]

    def jacobian(self, frame, axes, q=None):
        q = self.q if q is None else q
        return pin.computeFrameJacobian(self.model, self.model.createData(), q, frame, axes).reshape(6, self.model.nv)

    def along(self, of, v=None):
        """The rate of something of q along a velocity, by differences."""
        v = self.v if v is None else v
        ahead, behind = (of(pin.integrate(self.model, self.q, sign * STEP * v)) for sign in (1, -1))
        return (ahead - behind) / (2 * STEP)

    def jacobian_dot(self, frame, axes):
        return self.along(lambda q: self.jacobian(frame, axes, q))

    def M(self):
        upper = np.triu(pin.crba(self.model, self.model.createData(), self.q))
        return upper + np.triu(upper, 1).T

    def C(self):
        return pin.computeCoriolisMatrix(self.model, self.model.createData(), self.q, self.v)

    def bias(self):
        return pin.rnea(self.model, self.model.createData(), self.q, self.v, np.zeros(self.model.nv))


def near(there, here, what=""):
    np.testing.assert_allclose(there, here, rtol=0, atol=1e-7 * (1 + np.abs(here).max(initial=0.0)), err_msg=str(what))
