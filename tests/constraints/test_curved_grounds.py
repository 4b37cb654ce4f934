"""Bodies in bowls, pipes and on hills: nearest points, closed forms, first integrals."""

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from rnc_pin.model.kinematics import Kinematics
from rolling import rigid_body
from row_kinds import BALL, BOWL, DRUM, EGG, ON_CURVED_GROUND
from tolerances import ROUNDING

AXES = EGG.semi_axes
RADIUS = 0.2


@pytest.fixture(scope="module")
def robot():
    return rigid_body()


def rolling_ball(ground, mass=1.5, share=0.4):
    """Reduced model of a homogeneous ball; its angular velocities in its own axes are the reducing outputs."""
    robot = rigid_body(mass, (share * mass * RADIUS**2,) * 3)
    outputs = [rnc.FrameAngularVelocity("body", axis) for axis in "xyz"]
    return rnc.NonholonomicSystem(robot, [rnc.RollingBall("body", RADIUS, ground)]).reduce(outputs)


@pytest.mark.parametrize("name", ON_CURVED_GROUND)
def test_the_contact_is_where_the_normals_meet(name, robot):
    """The body's point satisfies the equation of the ellipsoid."""
    kind = ON_CURVED_GROUND[name]
    rows, generator = kind.bind(robot), np.random.default_rng(1)
    q, v = robot.random_configuration(generator), generator.normal(size=6)
    q[:3] = 0.1, -0.2, 0.05
    at = Kinematics(robot).position(q).with_velocity(v)
    points, directions = rows.lines_of_action(at)
    assert rows.units == ("m/s", "m/s", "m/s", "rad/s")[: len(rows.names)]
    pose, normal, gap = pin.XYZQUATToSE3(q), directions[2], rows.residual(at)[2]
    own = pose.actInv(points[0])
    assert np.sum((own / AXES) ** 2) == pytest.approx(1.0, abs=ROUNDING)
    outward = pose.rotation @ (own / np.square(AXES))
    np.testing.assert_allclose(outward / np.linalg.norm(outward), -normal, atol=1e-10)
    foot = points[0] - gap * normal
    assert kind.ground.level(foot) == pytest.approx(0.0, abs=1e-12)
    steep = kind.ground.gradient(foot)
    np.testing.assert_allclose(steep / np.linalg.norm(steep), normal, atol=1e-12)
    # The material point of the body, less that of the ground.
    velocity = at.velocity(robot.frame_id("body"))
    body = velocity[:3] + np.cross(velocity[3:], points[0] - q[:3])
    slip = rows.jacobian(at) @ v - rows.rate(at)
    np.testing.assert_allclose(slip[:3], directions[:3] @ (body - kind.ground.material_velocity(points[0])), atol=1e-12)
    if not kind.pivoting:
        assert slip[3] == pytest.approx((velocity[3:] - kind.ground.angular_velocity) @ normal, abs=1e-12)


def test_axes_of_a_contact_whose_normal_is_the_direction_that_they_follow(robot):
    """On the walls of a bowl to all sides, one of which is across that direction."""
    rows = rnc.RollingBody("body", rnc.Sphere(RADIUS), ground=BOWL).bind(robot)
    for out in np.concatenate([np.eye(3), -np.eye(3)]):
        q = pin.neutral(robot.model)
        q[:3] = BOWL.center + (BOWL.radius - RADIUS) * out
        axes = rows.lines_of_action(Kinematics(robot).position(q))[1][:3]
        np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=ROUNDING)
        np.testing.assert_allclose(axes[2], -out, atol=ROUNDING)
        assert np.linalg.det(axes) > 0


def test_searches_start_at_the_nearest_points_of_spheres_and_cylinders():
    place = np.array([0.7, -0.4, 0.9])
    for ground in (BOWL, BALL):
        away = place - ground.center
        np.testing.assert_allclose(ground.below(place), ground.center + 2 * away / np.linalg.norm(away), atol=ROUNDING)
    foot = DRUM.below(place)
    assert DRUM.level(foot) == pytest.approx(0.0, abs=ROUNDING)
    np.testing.assert_allclose(np.cross(place - foot, DRUM.gradient(foot)), 0.0, atol=ROUNDING)


@pytest.mark.parametrize("size", [0.3, 0.8, 50.0])
@pytest.mark.parametrize("ground", [BOWL, BALL, DRUM, rnc.GroundPlane((0.3, -0.2, 0.8), (0.2, 0.4, -0.3))])
def test_drawn_patches_have_the_area_and_the_centroid_of_caps_tubes_and_squares(ground, size):
    place = np.array([0.7, -0.4, 0.9])
    if isinstance(ground, rnc.SphericalGround):
        angle = min(size / ground.radius, 1.4)
        area = 2 * np.pi * ground.radius**2 * (1 - np.cos(angle))
        middle = ground.center + 0.5 * (1 + np.cos(angle)) * (ground.below(place) - ground.center)
    elif isinstance(ground, rnc.CylindricalGround):
        area = 4 * np.pi * ground.radius * size
        middle = ground.point + ground.along * (ground.along @ (place - ground.point))
    else:
        area, middle = 4 * size**2, place - ground.height(place) * ground.axes[2]
    vertices, triangles = ground.mesh(place, size)
    level = ground.height if isinstance(ground, rnc.GroundPlane) else ground.level
    np.testing.assert_allclose([level(each) for each in vertices], 0.0, atol=1e-11)
    first, *others = vertices[triangles.T]
    areas = 0.5 * np.linalg.norm(np.cross(*(each - first for each in others)), axis=1)
    assert areas.sum() == pytest.approx(area, rel=5e-3)
    np.testing.assert_allclose(areas @ vertices[triangles].mean(axis=1) / areas.sum(), middle, atol=3e-3)


def test_a_ball_in_a_bowl_keeps_its_spin_about_the_normal():
    """Routh (1884): of a homogeneous ball on a sphere, in any motion."""
    center = np.array([0.0, 0.0, 1.0])
    reduced = rolling_ball(rnc.SphericalGround(1.0, center))
    place = center + 0.8 * np.array([0.6, 0.0, -0.8])
    q = reduced.robot.configuration({"root_joint": [*place, 0.1, 0.2, -0.3, np.sqrt(0.86)]})
    pose, state = pin.XYZQUATToSE3(q), reduced.at(q, np.array([3.0, -2.0, 6.0]))
    R, v, v_dot = pose.rotation, state.v, state.v_dot(state.v2_dot([]))
    kept = (R @ v_dot[3:]) @ (center - pose.translation) - (R @ v[3:]) @ (R @ v[:3])
    assert kept == pytest.approx(0.0, abs=1e-10)


@pytest.mark.parametrize(("radius", "height"), [(1.0, 1.2), (0.1, 0.3), (1.0, 0.8)])
def test_for_a_ball_as_ground_the_outside_is_proposed(radius, height):
    """A ball of radius 0.2 on top of it, one that a bowl of this radius cannot hold, or one under its ceiling."""
    robot = rnc.Robot.from_urdf("rolling_ball.urdf", base="free")
    q = robot.configuration({"root_joint": [0, 0, height, 0, 0, 0, 1]})

    def rolled(**given):
        ball = rnc.RollingBall("ball", 0.2, ground=rnc.SphericalGround(radius, **given))
        reduced = rnc.NonholonomicSystem(robot, [ball]).reduce()
        run = rnc.free_motion(reduced, reduced.assembled(q) if height < 1 else q, np.zeros(reduced.r), 0.1)
        if not run.verdict.succeeded:
            raise rnc.SimulationError(str(run.verdict.first))
        return run

    with pytest.raises(rnc.RncError, match="inside=False if bodies roll on the outside of a ball"):
        rolled()
    assert rolled(inside=False).outcome is rnc.Outcome.COMPLETED
