"""Wheels, balls, casters and knife edges on planes in any pose, at rest and in motion."""

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from rnc_pin.applications.scenario.schema.scenario import validate
from rnc_pin.lab.mujoco import MuJoCoPlant
from rnc_pin.model.kinematics import Kinematics
from rolling import GRAVITY, rigid_body
from row_kinds import MOVING, ON_PLANES, SLOPE
from tolerances import ROUNDING


@pytest.fixture(scope="module")
def robot():
    return rigid_body()


@pytest.mark.parametrize("shape", [rnc.Torus(0.3, axis="y"), rnc.Sphere(0.3)])
def test_wheels_and_balls_are_bodies_of_their_shape(shape, robot, generator):
    """The contact of a ``RollingBody`` follows from its support function, that of wheels and balls from their axle."""
    kind = ON_PLANES["wheel" if isinstance(shape, rnc.Torus) else "ball"]
    rows, body = kind.bind(robot), rnc.RollingBody("body", shape, ground=MOVING).bind(robot)
    for _ in range(3):
        q, v = robot.random_configuration(generator), generator.normal(size=6)
        at = Kinematics(robot).position(q).with_velocity(v)
        slips = [each.jacobian(at) @ v - each.rate(at) for each in (rows, body)]
        assert slips[0][2] == pytest.approx(slips[1][2], abs=ROUNDING)
        # The wheel's rows are along its heading, those of the body along the plane's axes.
        assert np.linalg.norm(slips[0]) == pytest.approx(np.linalg.norm(slips[1]), abs=ROUNDING)
        np.testing.assert_allclose(rows.lines_of_action(at)[0], body.lines_of_action(at)[0], atol=ROUNDING)
        np.testing.assert_allclose(rows.residual(at), body.residual(at), atol=ROUNDING)


@pytest.mark.parametrize("kind", [rnc.RollingWheel("body", 0.3, "y"), rnc.RollingBall("body", 0.3)])
def test_a_slope_is_level_ground_with_leaning_gravity(kind, robot):
    """The rows on z = 0 share no formula with the pose of a plane; on a conveyor, Galileo's principle holds."""
    Q = SLOPE.axes
    outputs = [rnc.FrameAngularVelocity("body", axis) for axis in "xyz"]
    level = rnc.NonholonomicSystem(rigid_body(gravity=Q @ GRAVITY), [kind]).reduce(outputs)
    conveyor = rnc.GroundPlane(SLOPE.normal, SLOPE.point, 0.8 * Q[0] - 0.3 * Q[1])
    for ground in (SLOPE, conveyor):
        placed = type(kind)(**{**vars(kind), "ground": ground})
        leaning = rnc.NonholonomicSystem(robot, [placed]).reduce(outputs)
        generator = np.random.default_rng(3)
        for _ in range(2):
            q, w = robot.random_configuration(generator), generator.normal(size=3)
            q = level.assembled(q)
            pose = pin.XYZQUATToSE3(q)
            there = pin.SE3ToXYZQUAT(pin.SE3(Q.T @ pose.rotation, Q.T @ pose.translation + SLOPE.point))
            expected = level.forward_dynamics(q, w, [])
            np.testing.assert_allclose(leaning.forward_dynamics(there, w, []), expected, rtol=1e-9, atol=1e-9)
            np.testing.assert_allclose(leaning.assembled(there), there, atol=1e-9)


def test_a_knife_edge_moves_with_the_turntable_that_carries_it(robot):
    rows = ON_PLANES["knife edge"].bind(robot)
    normal, axes = MOVING.axes[2], np.eye(3)
    q = robot.random_configuration(np.random.default_rng(4))
    pose = pin.XYZQUATToSE3(q)
    point = pose.act(np.array([0.1, 0.2, 0.3]))
    # Rigid motion of the body with the table: every point of it has the velocity of the material.
    angular = -0.7 * normal
    linear = np.array([0.3, 0.2, 0.0]) + np.cross(angular, pose.translation - [0.1, 0.2, 0.3])
    v = np.concatenate([pose.rotation.T @ linear, pose.rotation.T @ angular])
    at = Kinematics(robot).position(q)
    np.testing.assert_allclose(rows.jacobian(at) @ v, rows.rate(at), atol=ROUNDING)
    np.testing.assert_allclose(rows.lines_of_action(at)[0][0], point, atol=ROUNDING)
    np.testing.assert_allclose(rows.lines_of_action(at)[1][0], pose.rotation @ axes[0], atol=ROUNDING)


def test_the_material_of_a_turntable_turns_about_its_point():
    table = rnc.GroundPlane(point=(0.3, -0.2, 0.5), velocity=(0.1, 0.2, 0.0), spin=2.0)
    np.testing.assert_allclose(table.material_velocity(np.array([1.3, 0.8, 0.5])), [-1.9, 2.2, 0.0], atol=ROUNDING)
    np.testing.assert_allclose(table.twist, [-0.3, -0.4, 0.0, 0.0, 0.0, 2.0], atol=ROUNDING)


@pytest.mark.parametrize("normal", [(0.0, 0.0, 2.0), (3.0, 0.0, 0.0), (-1.0, 0.1, 0.0), (0.8, 0.0, 0.6)])
def test_the_axes_of_a_plane_are_its_normal_and_the_world_axis_that_is_most_in_it(normal):
    axes, up = rnc.GroundPlane(normal).axes, np.array(normal) / np.linalg.norm(normal)
    world = np.eye(3)[int(abs(up[0]) > 0.9)]
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=ROUNDING)
    np.testing.assert_allclose((axes[2], np.cross(axes[0], axes[1])), (up, up), atol=ROUNDING)
    assert axes[0] @ world == pytest.approx(np.linalg.norm(np.cross(up, world)))


def test_a_scenario_names_the_ground_once():
    raw = {
        "robot": {"urdf": "rolling_ball.urdf", "base": "free"},
        "ground": {"plane": {"normal": [0.0, 0.1, 1.0]}},
        "constraints": [
            {"rolling_ball": {"frame": "ball", "radius": 0.2}},
            {"caster": {"frame": "ball", "radius": 0.2, "ground": {"plane": {"spin": 2.0}}}},
        ],
        "outputs": {"reducing": [{"frame_speed": {"frame": "ball"}}]},
    }
    ball, caster = validate(raw, "slope.yaml").constraints
    assert (ball.ground.normal, caster.ground.spin) == ([0.0, 0.1, 1.0], 2.0)
    with pytest.raises(rnc.ConfigurationError, match=r"slope.yaml: ground: no constraint takes a ground"):
        validate({**raw, "constraints": [{"momentum": "root_joint"}]}, "slope.yaml")
    robot = rnc.Robot.from_urdf("rolling_ball.urdf", base="free")
    at_rest, turning = (rnc.NonholonomicSystem(robot, [kind]).reduce() for kind in (ball, caster))
    q0 = at_rest.assembled(robot.configuration({"root_joint": [0, 0, 0.2, 0, 0, 0, 1]}))
    assert MuJoCoPlant(at_rest, q0=q0).wheel_names == ("ball",)
    with pytest.raises(rnc.ConfigurationError, match=r"MuJoCo: vertical\(ball\) rolls on a GroundPlane that"):
        MuJoCoPlant(turning, q0=q0)
