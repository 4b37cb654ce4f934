"""Affine constraints ``A v = mu``: momentum that is not zero, against the free motion that plain ABA gives."""

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from bodies import add_body
from rnc_pin.control import ComputedTorque, RedundancyController
from rnc_pin.planning import MinimumJerk
from systems import drifting_manipulator, random_states, spinning_space_robot, tumbling_panda
from tolerances import ROUNDING


@pytest.mark.parametrize(("make", "axes", "given"), [
    (tumbling_panda, [0, 1, 2, 3, 4, 5], [2.0, -1.0, 0.5, 0.3, 0.4, -0.6]),
    (drifting_manipulator, [0, 1, 5], [3.0, -2.0, 5.0]),
])  # fmt: skip
def test_momentum_is_that_about_the_origin_of_the_world(make, axes, given):
    reduced = make()
    model, data = reduced.robot.model, reduced.robot.model.createData()
    for q, v2 in random_states(reduced, 4):
        pin.computeCentroidalMomentum(model, data, q, reduced.at(q, v2).v)
        linear = data.hg.linear
        about_origin = data.hg.angular + np.cross(data.com[0], linear)
        np.testing.assert_allclose(np.concatenate([linear, about_origin])[axes], given, atol=1e-10)


def test_a_pivot_keeps_its_angular_momentum():
    """A top pinned at its center of mass, on a base turned in the world: Euler's equations in body axes."""
    model = pin.Model()
    placement = pin.SE3(pin.utils.rpyToMatrix(0.4, -0.7, 1.1), np.array([1.0, 2.0, 3.0]))
    principal = np.array([1.0, 2.0, 3.0])
    joint = add_body(model, "pivot", "Spherical", 5.0, moments=principal, at=placement)
    add_body(model, "wheel", "RZ", 1.0, joint, moments=0.5)
    momentum = np.array([0.5, -1.0, 2.0])
    system = rnc.NonholonomicSystem(rnc.Robot(model), [rnc.MomentumConservation("pivot", momentum)], ["wheel"])
    reduced = system.reduce([rnc.JointPosition("wheel")])
    for q, v2 in random_states(reduced, 4):
        rotation = pin.Quaternion(q[:4]).toRotationMatrix()  # of the body in the pivot's fixed frame
        own = rotation.T @ momentum
        spin = np.array([0.0, 0.0, v2[0]])
        np.testing.assert_allclose(reduced.at(q, v2).v[:3], (own - 0.5 * spin) / (principal + 0.5), atol=ROUNDING)


def test_a_run_keeps_momentum_and_energy():
    reduced = spinning_space_robot()
    task = rnc.Task.of(reduced, ["tip_x", "tip_y"], ["joint_1"])
    q0 = reduced.robot.configuration({"joint_1": -0.4, "joint_2": 1.8, "joint_3": -1.1})
    x1, x2 = reduced.at(q0).outputs()
    # The platform turns by itself and is told to turn elsewhere: (12) has to count with the rate that it has anyway.
    primary = MinimumJerk(x2[:2], x2[:2] + np.array([-0.2, 0.3]), 3.0)
    target = RedundancyController(task, primary, MinimumJerk(x1, x1 + 0.4, 3.0), k3=3.0, k21=3.0)
    run = rnc.simulate(reduced, ComputedTorque(reduced, target, 40.0), q0, 4.0, 0.005)
    assert run.constraint_residual.max() < 1e-9
    assert np.abs(run.v[0]).max() > 0.1, "it does not start at rest"
    np.testing.assert_allclose(run.energy - run.work, run.energy[0], atol=1e-6)
    final = rnc.summarize(run)["final_error"]
    assert max(final.values()) < 1e-3
    data, model = reduced.robot.model.createData(), reduced.robot.model
    for q, v in zip(run.q[::80], run.v[::80], strict=True):
        assert pin.crba(model, data, q)[0] @ v == pytest.approx(6.0, abs=1e-9)


def test_rows_that_demand_two_things_are_refused():
    robot = rnc.Robot.from_urdf("space_robot.urdf")
    row = np.eye(4)[:1]

    def turning(speed, name):
        return rnc.Pfaffian(
            lambda q: row, lambda q, v: 0 * row, [name], rate=lambda q: np.array([speed]),
            rate_dot=lambda q, v: np.zeros(1),
        )  # fmt: skip

    assert rnc.NonholonomicSystem(robot, [turning(0.5, "a"), turning(0.5, "b")]).m == 1
    words = r"'b' contradicts the others: it requires 0.7, the others require 0.5"
    with pytest.raises(rnc.ConstraintError, match=words):
        rnc.NonholonomicSystem(robot, [turning(0.5, "a"), turning(0.7, "b")])


@pytest.mark.parametrize(("make", "words"), [
    (lambda r: rnc.MomentumConservation("platform", [1.0, 2.0]), "takes 1 finite number, found"),
    (lambda r: rnc.MomentumConservation("platform", np.nan), "takes 1 finite number, found nan"),
    (lambda r: rnc.Pfaffian(lambda q: np.eye(4)[:1], rate_dot=lambda q, v: v[:1]), "only together"),
    (lambda r: rnc.Pfaffian(np.eye(4)[:1]), "'rows' of a Pfaffian constraint has to be a function.*found ndarray"),
    (lambda r: rnc.Pfaffian(lambda q: np.eye(4)[:1], rate=np.ones(1)), "'rate' of a Pfaffian constraint has to be"),
    (lambda r: rnc.Pfaffian(lambda q: np.eye(4)[:1], rate=lambda q: q[:1], residual=lambda q: q[:1]),
        "'rate' or 'residual', not both"),
])  # fmt: skip
def test_values_that_do_not_fit_are_refused(make, words):
    robot = rnc.Robot.from_urdf("space_robot.urdf")
    with pytest.raises(rnc.ConstraintError, match=words):
        rnc.NonholonomicSystem(robot, [make(robot)])
