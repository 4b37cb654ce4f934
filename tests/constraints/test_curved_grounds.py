"""Bodies in bowls, pipes and on hills: nearest points, closed forms, first integrals."""

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from rnc_pin.constraints.surface_contact import _smaller_eigenvalue
from rnc_pin.model.kinematics import Kinematics
from rolling import rigid_body
from row_kinds import BALL, BOWL, DRUM, EGG, ON_CURVED_GROUND, WHEELS_ON_CURVED_GROUND
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


def at_place(reduced, place):
    return reduced.robot.configuration({"root_joint": [*place, 0.1, 0.2, -0.3, np.sqrt(0.86)]})


@pytest.mark.parametrize("name", ON_CURVED_GROUND)
def test_the_contact_is_where_the_normals_meet(name, robot):
    """The body's point satisfies the equation of the ellipsoid."""
    kind = ON_CURVED_GROUND[name]
    rows = kind.bind(robot)
    generator = np.random.default_rng(1)
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
        np.testing.assert_allclose(
            ground.below(place), ground.center + 2.0 * away / np.linalg.norm(away), atol=ROUNDING
        )
    foot = DRUM.below(place)
    assert DRUM.level(foot) == pytest.approx(0.0, abs=ROUNDING)
    np.testing.assert_allclose(np.cross(place - foot, DRUM.gradient(foot)), 0.0, atol=ROUNDING)


def test_the_smaller_relative_curvature():
    basis = np.array([[2.0, 1.0, 0.0], [0.0, 1.0, 3.0], [1.0, 0.0, 1.0]])
    many = np.stack([basis @ np.diag([1.0, *pair]) @ np.linalg.inv(basis) for pair in ((0.3, 2.0), (5.0, -0.7))])
    np.testing.assert_allclose(_smaller_eigenvalue(many), [0.3, -0.7], atol=ROUNDING)


def test_a_ball_in_a_bowl_keeps_its_spin_about_the_normal():
    """Routh (1884): of a homogeneous ball on a sphere, in any motion."""
    center = np.array([0.0, 0.0, 1.0])
    reduced = rolling_ball(rnc.SphericalGround(1.0, center))
    q = at_place(reduced, center + 0.8 * np.array([0.6, 0.0, -0.8]))
    pose, state = pin.XYZQUATToSE3(q), reduced.at(q, np.array([3.0, -2.0, 6.0]))
    R, v, v_dot = pose.rotation, state.v, state.v_dot(state.v2_dot([]))
    kept = (R @ v_dot[3:]) @ (center - pose.translation) - (R @ v[3:]) @ (R @ v[:3])
    assert kept == pytest.approx(0.0, abs=1e-10)


def test_one_surface_has_one_motion():
    """A bowl as a sphere and as a height; an incline as a height and as a plane."""
    sphere = rnc.SphericalGround(2.0, (0.0, 0.0, 2.0))
    root = lambda x, y: np.sqrt(4.0 - x * x - y * y)  # noqa: E731
    height = rnc.HeightField(
        lambda x, y: 2.0 - root(x, y),
        lambda x, y: (x / root(x, y), y / root(x, y)),
        lambda x, y: tuple(each / root(x, y) ** 3 for each in (4.0 - y * y, x * y, 4.0 - x * x)),
    )
    incline = rnc.HeightField(lambda x, y: 0.3 * x, lambda x, y: (0.3, 0.0), lambda x, y: (0.0, 0.0, 0.0))
    plane = rnc.GroundPlane(normal=(-0.3, 0.0, 1.0))
    for one, other in ((sphere, height), (plane, incline)):
        models = [rolling_ball(ground) for ground in (one, other)]
        q, w = models[0].assembled(at_place(models[0], (0.5, -0.3, 0.4))), np.array([1.0, -2.0, 3.0])
        rates = [model.forward_dynamics(q, w, []) for model in models]
        np.testing.assert_allclose(rates[0], rates[1], rtol=1e-10)
        slopes = [rnc.state_derivatives(model, q, w, []) for model in models]
        np.testing.assert_allclose(slopes[0].v2_dot_q, slopes[1].v2_dot_q, atol=1e-8)


def test_ground_that_cannot_carry_is_refused(robot):
    wrong = lambda x, y: (0.2 * x, 0.0)  # noqa: E731
    with pytest.raises(rnc.ConfigurationError, match=r"height field: h_x at .* is .*, but its function's derivative"):
        rnc.HeightField(lambda x, y: 0.2 * x * x, wrong, lambda x, y: (0.4, 0.0, 0.0))
    with pytest.raises(rnc.ConfigurationError, match="height field: functions have to take complex arrays"):
        rnc.HeightField(lambda x, y: np.arctan2(x, y), wrong, lambda x, y: (0.2, 0.0, 0.0))
    with pytest.raises(rnc.ConfigurationError, match="radius of spherical ground has to be positive"):
        rnc.SphericalGround(0.0)
    with pytest.raises(rnc.ConfigurationError, match="axis of cylindrical ground has no length"):
        rnc.CylindricalGround(1.0, (0, 0, 0))
    with pytest.raises(rnc.ConfigurationError, match="spin of cylindrical ground: expected a finite number"):
        rnc.CylindricalGround(1.0, spin=np.nan)
    with pytest.raises(rnc.ConstraintError, match="ground of rolling body 'body': expected a GroundPlane, Spherical"):
        rnc.RollingBody("body", EGG, ground=3.0).bind(robot)
    tight = rnc.RollingBody("body", EGG, ground=rnc.SphericalGround(0.3)).bind(robot)
    with pytest.raises(rnc.SingularityError, match="a body touches curved ground at more than one point"):
        tight.jacobian(Kinematics(robot).position(robot.configuration({"root_joint": [0, 0, -0.2, 0, 0, 0, 1]})))


@pytest.mark.parametrize("name", sorted({*WHEELS_ON_CURVED_GROUND} - {"roller on waves"}))
def test_rows_of_a_wheel_are_the_slip_along_its_heading_and_axle(name, robot):
    """The contact is the point of the rim nearest to the surface, by search."""
    kind = WHEELS_ON_CURVED_GROUND[name]
    rows, generator = kind.bind(robot), np.random.default_rng(3)
    q, v = robot.random_configuration(generator), generator.normal(size=6)
    q[:3] = 0.1, -0.2, 0.05
    at = Kinematics(robot).position(q).with_velocity(v)
    pose, velocity = pin.XYZQUATToSE3(q), at.velocity(robot.frame_id("body"))
    contact = rows.lines_of_action(at)[0][0]
    index = "xyz".index(kind.axis)
    angles = np.linspace(0.0, 2 * np.pi, 20001)
    rim = np.zeros((len(angles), 3))
    rim[:, (index + 1) % 3], rim[:, (index + 2) % 3] = 0.3 * np.cos(angles), 0.3 * np.sin(angles)
    rim = rim @ pose.rotation.T + pose.translation
    # The level of these grounds is a function of the distance.
    np.testing.assert_allclose(contact, rim[np.argmin(kind.ground.level(rim))], atol=1e-4)
    normal = kind.ground.gradient(contact)
    normal /= np.linalg.norm(normal)
    sideways = pose.rotation[:, index] - normal * (normal @ pose.rotation[:, index])
    sideways /= np.linalg.norm(sideways)
    slip = velocity[:3] + np.cross(velocity[3:], contact - q[:3]) - kind.ground.material_velocity(contact)
    along = {"rolling": np.cross(sideways, normal), "lateral": sideways, "vertical": normal}
    wanted = [along[label.split("(")[0]] @ slip for label in rows.names]
    np.testing.assert_allclose(rows.jacobian(at) @ v - rows.rate(at), wanted, atol=1e-9)


def test_a_wheel_rolls_at_the_bottom_of_a_drum_as_a_pendulum():
    """Upright disk whose axle is parallel to the drum: (1 + I / (m r^2)) (R - r) angle'' = -g sin(angle)."""
    mass, radius, spin, drum = 1.5, 0.2, 0.05, rnc.CylindricalGround(1.0, (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    robot = rigid_body(mass, (30.0, spin, 30.0))
    rows = [rnc.RollingWheel("body", radius, "y", ground=drum)]
    reduced = rnc.NonholonomicSystem(robot, rows).reduce([rnc.FrameAngularVelocity("body", axis) for axis in "xyz"])
    length = 1.0 - radius
    for angle, turn in ((0.4, 0.0), (-1.1, 3.0)):
        out, ahead = np.array([np.sin(angle), 0.0, -np.cos(angle)]), np.array([np.cos(angle), 0.0, np.sin(angle)])
        q = robot.configuration({"root_joint": [*(length * out + [0, 0, 1.0]), 0, np.sin(0.35), 0, np.cos(0.35)]})
        state = reduced.at(q, np.array([0.0, turn, 0.0]))
        R, v, v_dot = pin.XYZQUATToSE3(q).rotation, state.v, state.v_dot(state.v2_dot([]))
        rate = (R @ v[:3]) @ ahead / length
        assert abs(rate) == pytest.approx(abs(turn) * radius / length, abs=1e-12)
        own = R @ (v_dot[:3] + np.cross(v[3:], v[:3]))
        fall = -9.81 * np.sin(angle) / (1.0 + spin / (mass * radius**2))
        np.testing.assert_allclose(own, fall * ahead - length * rate**2 * out, atol=1e-10)


def test_a_wheel_is_a_torus_without_a_tube():
    """The same motion as that of a rolling body, in directions of its own."""
    robot = rigid_body(2.0, (20.0, 30.0, 40.0))  # its start is found by moving, not by turning
    ground = rnc.SphericalGround(2.0, (0.0, 0.0, 2.0))
    wheel, torus = (
        rnc.NonholonomicSystem(robot, [kind]).reduce([rnc.FrameAngularVelocity("body", axis) for axis in "xyz"])
        for kind in (
            rnc.RollingWheel("body", 0.3, "y", ground=ground),
            rnc.RollingBody("body", rnc.Torus(0.3, axis="y"), ground=ground),
        )
    )
    q, w = wheel.assembled(at_place(wheel, (0.5, -0.3, 0.4))), np.array([1.0, -2.0, 3.0])
    np.testing.assert_allclose(wheel.forward_dynamics(q, w, []), torus.forward_dynamics(q, w, []), rtol=1e-9)
    flat = rnc.RollingWheel("body", 0.3, "y", ground=3.0)
    with pytest.raises(rnc.ConstraintError, match="ground of wheel 'body': expected a GroundPlane, SphericalGround"):
        flat.bind(robot)


def test_a_cylinder_is_upright_unless_an_axis_is_given():
    np.testing.assert_array_equal(rnc.CylindricalGround(1.0).along, [0.0, 0.0, 1.0])
    np.testing.assert_array_equal(rnc.CylindricalGround(1.0, axis=(3.0, 0.0, 4.0)).along, [0.6, 0.0, 0.8])
