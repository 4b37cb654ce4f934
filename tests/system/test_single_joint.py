"""Robots with one joint, and joints about any axis: Pinocchio stores and returns both unlike the others."""

from typing import NamedTuple

import numpy as np
import pinocchio as pin
import pytest
from scipy.special import ellipk

import rnc_pin as rnc
from simple_controllers import Idle
from tolerances import ROUNDING

pytestmark = pytest.mark.filterwarnings("error", "ignore:zmq.eventloop.ioloop is deprecated:DeprecationWarning")

INTEGRATED = 1e-9  # positions after a period of a thousand fourth-order steps [rad or m]

MASS, INERTIA, LENGTH, GRAVITY = 1.3, 0.07, 0.4, 9.81  # of the bob; inertia about any axis through its centre
AXES, KINDS = ["0 1 0", "0 -1 0", "0.6 0 0.8", "-0.8 0 -0.6"], ["revolute", "continuous"]


def pendulum(kind, axis, gravity=GRAVITY):
    """A bob below a hinge; ``tip`` is at its centre."""
    model = pin.buildModelFromXML(
        '<robot name="strange"><link name="base"/><link name="tip"/><link name="bob"><inertial>'
        f'<origin xyz="0 0 {-LENGTH}"/><mass value="{MASS}"/>'
        f'<inertia ixx="{INERTIA}" iyy="{INERTIA}" izz="{INERTIA}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        f'<joint name="hinge" type="{kind}"><parent link="base"/><child link="bob"/><axis xyz="{axis}"/>'
        '<limit lower="-3" upper="2" effort="50" velocity="50"/></joint>'
        f'<joint name="fixed" type="fixed"><parent link="bob"/><child link="tip"/><origin xyz="0 0 {-LENGTH}"/></joint>'
        "</robot>"
    )
    model.gravity.linear = np.array([0.0, 0.0, -gravity])
    return rnc.Robot(model)


def reduced_of(robot, vertical=(), reducing=None):
    (name,) = robot.joint_names
    return rnc.NonholonomicSystem(robot, [], [name]).reduce([reducing or rnc.JointPosition(name)], vertical)


class Swing(NamedTuple):
    """A pendulum: ``inertia q'' = torque - weight sin q``. Inertia and weight are those about its axis, by hand."""

    robot: rnc.Robot
    axis: np.ndarray
    inertia: float
    weight: float


@pytest.fixture(params=[(kind, axis) for kind in KINDS for axis in AXES], ids=lambda p: f"{p[0]} about {p[1]}")
def swing(request):
    kind, axis = request.param
    a = np.array(axis.split(), float)
    square = 1 - a[2] ** 2  # of the part of the bob's lever, and of gravity, across the axis
    inertia, weight = INERTIA + MASS * LENGTH**2 * square, MASS * GRAVITY * LENGTH * square
    return Swing(pendulum(kind, axis), a, inertia, weight)


def test_one_joint_is_named_set_and_read(swing):
    robot, axis, *_ = swing
    assert (robot.velocity_names, robot.velocity_units) == (("hinge",), ("rad/s",))
    assert robot.velocity_indices("hinge") == slice(0, 1)
    for angle in (-2.9, 0.0, 1.7):
        q = robot.configuration({"hinge": angle})
        assert robot.joint_values(q) == pytest.approx({"hinge": angle}, abs=ROUNDING)
        data = robot.model.createData()
        pin.framesForwardKinematics(robot.model, data, q)
        turned = data.oMf[robot.frame_id("bob")].rotation
        np.testing.assert_allclose(turned, pin.exp3(angle * axis), atol=ROUNDING)
    with pytest.raises(rnc.ModelError, match=r"joint 'hinge' takes 1 value, found 3$"):
        robot.configuration({"hinge": [1, 2, 3]})


def test_a_pendulum_moves_as_by_hand(swing):
    robot, axis, inertia, weight = swing
    reduced = reduced_of(robot)
    angle, rate, torque = np.random.default_rng(1).uniform(-2, 2, (3, 2, 4))
    q = np.array([robot.configuration({"hinge": each}) for each in angle.ravel()]).reshape(2, 4, -1)
    v2, T = rate[..., None], torque[..., None]
    expected = (torque - weight * np.sin(angle)) / inertia
    height = -LENGTH * axis[2] ** 2 - weight / (MASS * GRAVITY) * np.cos(angle)
    energy = inertia * rate**2 / 2 + MASS * GRAVITY * height
    np.testing.assert_allclose(reduced.forward_dynamics(q, v2, T)[..., 0], expected, atol=ROUNDING)
    np.testing.assert_allclose(reduced.energy(q, v2), energy, atol=ROUNDING)
    np.testing.assert_allclose(reduced.inverse_dynamics(q, v2, expected[..., None]), T, atol=ROUNDING)
    for at, w, u, i in zip(q[0], v2[0], T[0], range(4), strict=True):
        np.testing.assert_allclose(reduced.forward_dynamics(at, w, u), [expected[0, i]], atol=ROUNDING)
        terms = reduced.terms(at, w)
        found = np.concatenate([getattr(terms, name).ravel() for name in ("H", "V", "G", "R", "input_matrix")])
        np.testing.assert_allclose(found, [inertia, 0, weight * np.sin(angle[0, i]), 1, 1], atol=ROUNDING)
        assert reduced.energy(at, w) == pytest.approx(energy[0, i], abs=ROUNDING)


@pytest.mark.parametrize("swing", [("revolute", AXES[3]), ("continuous", AXES[2])], indirect=True)
def test_a_pendulum_is_back_after_its_period(swing):
    """4 K(sin^2 (amplitude / 2)) / omega, K the complete elliptic integral."""
    robot, _, inertia, weight = swing
    period = 4 * ellipk(np.sin(0.75) ** 2) / np.sqrt(weight / inertia)
    q = robot.configuration({"hinge": 1.5})
    run = rnc.simulate(reduced_of(robot), Idle(1), q, period, period / 1000)
    assert run.outcome == rnc.Outcome.COMPLETED
    np.testing.assert_allclose(run.x2[[0, 500, 1000], 0], [1.5, -1.5, 1.5], atol=INTEGRATED)
    exact = rnc.free_motion(reduced_of(robot), q, np.zeros(1), period, period / 10)
    np.testing.assert_allclose(exact.q[-1], q, atol=INTEGRATED)
