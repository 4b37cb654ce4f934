"""Balls and wheels: closed forms, and rows against the motion of the material point that touches the ground."""

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from bodies import add_body
from rnc_pin.model.kinematics import Kinematics
from simple_controllers import Idle
from systems import bicycle, random_states
from textbook_systems import differential_drive
from tolerances import KKT, ROUNDING

RADIUS, MASS = 0.2, 3.0
SOLID = 0.4 * MASS * RADIUS**2


def ball(gravity=(0.0, 0.0, -9.81)):
    model = pin.Model()
    model.name = "ball"
    model.gravity.linear = np.array(gravity)
    add_body(model, "root_joint", "FreeFlyer", MASS, moments=SOLID, frame="ball")
    return rnc.Robot(model)


def reduce_ball(robot, constraints):
    """Reducing outputs: position in the plane, and spin about the vertical in the world."""

    def spin(q):
        rotation = pin.Quaternion(q[3:7]).toRotationMatrix()
        return np.concatenate([np.zeros(3), rotation[2]])[None]

    def spin_dot(q, v):
        rotation = pin.Quaternion(q[3:7]).toRotationMatrix()
        return np.concatenate([np.zeros(3), (rotation @ pin.skew(v[3:]))[2]])[None]

    system = rnc.NonholonomicSystem(robot, constraints, np.eye(6)[:, 3:])
    return system.reduce([rnc.FramePosition("ball", "xy"), rnc.Output(None, spin, spin_dot, ["spin"])], [])


def test_a_ball_rolls_down_a_slope_at_five_sevenths():
    slope = 0.3
    gravity = 9.81 * np.array([np.sin(slope), 0.0, -np.cos(slope)])
    reduced = reduce_ball(ball(gravity), [rnc.RollingBall("ball", RADIUS)])
    assert reduced.constraints.holonomic == (False, False, True)
    for q, v2 in random_states(reduced, 4):
        assert q[2] == pytest.approx(RADIUS, abs=1e-12)
        expected = [5 / 7 * 9.81 * np.sin(slope), 0.0, 0.0]
        np.testing.assert_allclose(reduced.forward_dynamics(q, v2, np.zeros(3)), expected, atol=1e-9)
        # v = omega x r: the contact rests. In the world's axes.
        v = reduced.at(q, v2).v
        rotation = pin.Quaternion(q[3:7]).toRotationMatrix()
        linear, angular = rotation @ v[:3], rotation @ v[3:]
        np.testing.assert_allclose(linear, np.cross(angular, [0, 0, RADIUS]), atol=ROUNDING)
        assert angular[2] == pytest.approx(v2[2], abs=ROUNDING)
        # The ground bears the weight and gives the friction 2/7 m g sin(slope); multipliers have the paper's sign.
        forces = dict(zip(reduced.constraints.names, -reduced.multipliers(q, v2, np.zeros(3)), strict=True))
        assert forces["vertical(ball)"] == pytest.approx(MASS * 9.81 * np.cos(slope), rel=1e-9)
        assert forces["rolling_x(ball)"] == pytest.approx(-2 / 7 * MASS * 9.81 * np.sin(slope), rel=1e-9)


def test_a_ball_on_a_turntable_goes_in_circles():
    """Rows with a rate: the ground turns at Omega, the ball circles at 2/7 Omega (Lewis and Murray 1995)."""
    omega = 2.1

    def rows(q):
        rotation = pin.Quaternion(q[3:7]).toRotationMatrix()
        return np.hstack([rotation, pin.skew(np.array([0, 0, RADIUS])) @ rotation])

    def rows_dot(q, v):
        rate = pin.Quaternion(q[3:7]).toRotationMatrix() @ pin.skew(v[3:])
        return np.hstack([rate, pin.skew(np.array([0, 0, RADIUS])) @ rate])

    def table(q):
        return omega * np.array([-q[1], q[0], 0.0])

    def table_dot(q, v):
        linear = pin.Quaternion(q[3:7]).toRotationMatrix() @ v[:3]
        return omega * np.array([-linear[1], linear[0], 0.0])

    turning = rnc.Pfaffian(rows, rows_dot, ["x", "y", "z"], rate=table, rate_dot=table_dot)
    robot = ball()
    reduced = reduce_ball(robot, [turning])
    assert reduced.affine
    q0 = robot.configuration({"root_joint": [0.7, -0.2, RADIUS, 0, 0, 0, 1]})
    start, v2_0 = np.array([0.7, -0.2]), np.array([0.3, 0.4, 0.0])
    run = rnc.simulate(reduced, Idle(3), q0, 2.0, 0.005, v2_0=v2_0)
    turn = 2 / 7 * omega
    center = start + np.array([-v2_0[1], v2_0[0]]) / turn  # v = turn z x (p - center)
    arm = (start - center)[0] + 1j * (start - center)[1]
    path = center[0] + 1j * center[1] + arm * np.exp(1j * turn * run.time)
    np.testing.assert_allclose(run.q[:, 0] + 1j * run.q[:, 1], path, atol=1e-8)
    np.testing.assert_allclose(run.constraint_residual, 0, atol=1e-11)
    # The table does work on the ball.
    assert np.ptp(run.energy) > 0.02
    np.testing.assert_allclose(run.energy - run.work, run.energy[0], atol=1e-8)
    # KKT, with the rate of mu.
    model, data = robot.model, robot.model.createData()
    for q, v2 in random_states(reduced, 4):
        t = reduced.terms(q, v2)
        gamma = t.A_dot @ t.v - table_dot(q, t.v)
        T = np.array([0.1, -0.2, 0.3])
        vdot = pin.forwardDynamics(model, data, q, t.v, np.concatenate([np.zeros(3), T]), t.A, gamma)
        ours = t.R @ reduced.forward_dynamics(q, v2, T) + t.R_dot @ v2 + t.b_dot
        np.testing.assert_allclose(ours, vdot, atol=KKT * 10)
        residual = np.concatenate([np.zeros(3), T]) - pin.rnea(model, data, q, t.v, vdot)
        np.testing.assert_allclose(t.A.T @ reduced.multipliers(q, v2, T), residual, atol=KKT * 100)
        F = t.H @ reduced.forward_dynamics(q, v2, T) + t.V @ v2 + t.G
        np.testing.assert_allclose(F, t.input_matrix @ T, atol=1e-9)


def test_a_ball_needs_a_radius_and_a_frame():
    for kind, error, words in (
        (rnc.RollingBall("ball", 0.0), rnc.ConstraintError, "radius of ball 'ball' has to be positive, found 0.0"),
        (rnc.RollingBall("bal", 1.0), rnc.ModelError, "did you mean 'ball'"),
    ):
        with pytest.raises(error, match=words):
            rnc.NonholonomicSystem(ball(), [kind])


# ---------------------------------------------------------------------- wheels on a steered fork


def test_wheels_on_a_raked_fork_touch_with_a_point_at_rest():
    """Independent: the wheel's lowest material point, found from its placement alone, moved along v and back."""
    reduced = bicycle()
    model, radius = reduced.robot.model, 0.3
    data, h = model.createData(), 1e-6

    def placement(q, frame):
        pin.framesForwardKinematics(model, data, q)
        return data.oMf[model.getFrameId(frame)].copy()

    steered = []
    for q, v2 in random_states(reduced, 8):
        v = reduced.at(q, v2).v
        steered.append(q[model.joints[3].idx_q])
        for frame in ("rear", "front"):
            here = placement(q, frame)
            axle = here.rotation[:, 1]
            down = np.array([0.0, 0.0, -1.0]) + axle[2] * axle  # steepest way down within the disk
            lowest = here.actInv(here.translation + radius * down / np.linalg.norm(down))
            assert here.act(lowest)[2] == pytest.approx(0.0, abs=1e-12), "on the ground"
            ahead, behind = (placement(pin.integrate(model, q, sign * h * v), frame).act(lowest) for sign in (1, -1))
            np.testing.assert_allclose((ahead - behind) / (2 * h), 0.0, atol=1e-8)
    assert np.ptp(steered) > 1.0


def test_an_upright_bicycle_turns_as_its_geometry_says():
    """Closed form: at no lean the front wheel heads along tan(D) = cos(rake) tan(d) of a fork steered by d.

    The yaw rate is then speed times tan(D) over the distance of the contacts, if the frame neither leans nor pitches.
    """
    model = pin.Model()
    model.name = "tricycle"
    rake, radius, base = 0.35, 0.25, 1.1
    # A planar base with a raked fork whose axis meets the front wheel's center: the center stays, the wheel tilts.
    joint = model.addJoint(0, pin.JointModelPlanar(), pin.SE3.Identity(), "root_joint")
    body = pin.Inertia(5.0, np.array([0.4, 0, 0]), np.eye(3))
    model.appendBodyToJoint(joint, body, pin.SE3.Identity())
    model.addFrame(pin.Frame("axle", joint, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    steering = np.array([-np.sin(rake), 0.0, np.cos(rake)])
    front = pin.SE3(np.eye(3), np.array([base, 0, radius]))
    fork = add_body(model, "steer", pin.JointModelRevoluteUnaligned(steering), 1.0, joint, moments=0.1, at=front)
    add_body(model, "wheel", "RY", 1.0, fork, moments=0.1, frame="wheel")
    robot = rnc.Robot(model)
    rows = rnc.RollingWheel("wheel", radius).bind(robot)
    kinematics, generator = Kinematics(robot), np.random.default_rng(0)
    for _ in range(5):
        speed, angle, yaw = generator.uniform(0.5, 2), generator.uniform(-0.9, 0.9), generator.uniform(-3, 3)
        q = robot.configuration({"root_joint": [1.0, 2.0, yaw], "steer": angle, "wheel": generator.uniform(-3, 3)})
        # The wheel tilts about its heading, so its contact is beside the center.
        heading = np.arctan(np.cos(rake) * np.tan(angle))
        tilt = np.arcsin(-np.sin(rake) * np.sin(angle))  # of the axle above the horizontal
        aside = radius * np.sin(tilt) * np.array([-np.sin(heading), np.cos(heading)])  # contact from center, base axes
        x, y = base + aside[0], aside[1]
        # The contact point of the base's motion (speed, yaw rate) must move along the heading.
        yaw_rate = speed * np.sin(heading) / (x * np.cos(heading) + y * np.sin(heading))
        along = (speed - yaw_rate * y) * np.cos(heading) + yaw_rate * x * np.sin(heading)
        # The steering rests, so the wheel's rows are those of rolling at that speed.
        v = np.array([speed, 0.0, yaw_rate, 0.0, along / radius])
        np.testing.assert_allclose(rows.jacobian(kinematics.position(q)) @ v, 0.0, atol=1e-12)


def test_a_caster_follows_its_trail():
    """Closed form: on an upright fork with trail d, ``d (w + deltadot) = w L cos(delta) - u sin(delta)``."""
    model = pin.Model()
    model.name = "caster"
    length, trail, radius = 0.8, 0.07, 0.05
    joint = add_body(model, "root_joint", "Planar", 5.0, frame="axle")
    fork = add_body(model, "fork", "RUBZ", 0.5, joint, moments=0.01, at=(length, 0, 0.1))
    below = pin.SE3(np.eye(3), np.array([-trail, 0, -0.05]))
    add_body(model, "caster", "RY", 0.2, fork, moments=0.001, at=below, frame="caster")
    system = rnc.NonholonomicSystem(
        rnc.Robot(model),
        [rnc.NoSideSlip("axle"), rnc.RollingWheel("caster", radius)],
        [rnc.FrameForce("axle", "x"), rnc.FrameTorque("axle", "z")],
    )
    assert [row.name for row in system.dropped_rows] == ["vertical(caster)"]
    reduced = system.reduce([rnc.FrameSpeed("axle"), rnc.FrameYaw("axle")])
    for q, v2 in random_states(reduced, 6):
        delta, (u, w) = np.arctan2(q[5], q[4]), v2
        delta_dot = (-u * np.sin(delta) + w * length * np.cos(delta)) / trail - w
        rolling = (u * np.cos(delta) + w * length * np.sin(delta)) / radius
        np.testing.assert_allclose(reduced.at(q, v2).v, [u, 0, w, delta_dot, rolling], atol=1e-10)


def test_a_wheel_on_a_joint_that_slides():
    model = differential_drive().model
    add_body(model, "slide", "PX", 0.1, 1, moments=0.01, frame="skid")
    with pytest.raises(rnc.ConstraintError, match="joint of wheel 'skid' is not revolute: give the axle"):
        rnc.NonholonomicSystem(rnc.Robot(model), [rnc.RollingWheel("skid", 0.1)])
