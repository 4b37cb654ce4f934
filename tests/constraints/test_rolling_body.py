"""Bodies that roll on planes: rows and special cases; motions of textbooks are in benchmarks/validation."""

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from bodies import add_body
from refusals import refused
from rnc_pin.model.assembly import Assembly
from rnc_pin.model.kinematics import Kinematics
from rolling import rigid_body
from row_kinds import EGG, ROLLING
from tolerances import ROUNDING


@pytest.mark.parametrize("name", ROLLING)
def test_rows_are_the_velocity_of_the_lowest_point(name):
    """The lowest point is searched."""
    kind, robot = ROLLING[name], rigid_body()
    plane, kinematics = kind.ground or rnc.GroundPlane(), Kinematics(robot)
    rows, generator = kind.bind(robot), np.random.default_rng(1)
    angles = np.meshgrid(np.linspace(1e-6, np.pi - 1e-6, 400), np.linspace(0, 2 * np.pi, 800), indexing="ij")
    around = np.stack([np.sin(angles[0]) * np.cos(angles[1]), np.sin(angles[0]) * np.sin(angles[1]), np.cos(angles[0])])
    surface = kind.shape.point(around.reshape(3, -1).T) @ pin.rpy.rpyToMatrix(np.array(kind.rpy)).T + kind.at
    normal = np.asarray(plane.normal) / np.linalg.norm(plane.normal)
    for _ in range(3):
        q, v = robot.random_configuration(generator), generator.normal(size=6)
        at = kinematics.position(q).with_velocity(v)
        place = at.placement(robot.frame_id("body"))
        heights = (surface @ place.rotation.T + place.translation - plane.point) @ normal
        assert rows.residual(at)[2] == pytest.approx(heights.min(), abs=2e-5)
        points, _ = rows.lines_of_action(at)
        lowest = surface[np.argmin(heights)]
        np.testing.assert_allclose(points[0], place.rotation @ lowest + place.translation, atol=5e-3)

        # The material point of the body, less that of the ground.
        velocity, contact = at.velocity(robot.frame_id("body")), points[0]
        body = velocity[:3] + np.cross(velocity[3:], contact - place.translation)
        ground = np.array(plane.velocity) + plane.spin * np.cross(normal, contact - plane.point)
        slip = rows.jacobian(at) @ v - rows.rate(at)
        assert np.linalg.norm(slip[:3]) == pytest.approx(np.linalg.norm(body - ground), abs=ROUNDING)
        assert slip[2] == pytest.approx((body - ground) @ normal, abs=ROUNDING)
        if not kind.pivoting:
            assert slip[3] == pytest.approx(velocity[3:] @ normal - plane.spin, abs=ROUNDING)


def test_many_light_bodies_are_put_on_the_ground_at_the_first_draw():
    model = pin.Model()
    for k in range(4):
        add_body(model, f"base_{k}", "FreeFlyer", 1.0, moments=(2e-4, 1.6e-3, 1.7e-3), frame=f"stone_{k}")
    robot, shape = rnc.Robot(model), rnc.Ellipsoid((0.2, 0.03, 0.02))
    assembly = Assembly(robot, [rnc.RollingBody(f"stone_{k}", shape).bind(robot) for k in range(4)])
    generator, alone = np.random.default_rng(1), np.random.default_rng(1)
    found = assembly.random_configuration(generator)
    robot.random_configuration(alone)
    assert generator.bit_generator.state == alone.bit_generator.state
    turns = [pin.Quaternion(found[7 * k + 3 : 7 * k + 7]).toRotationMatrix() for k in range(4)]
    heights = [np.linalg.norm(np.array(shape.semi_axes) * turn[2]) for turn in turns]  # of the centre of an ellipsoid
    np.testing.assert_allclose(found[2::7], heights, atol=1e-10)


test_what_does_not_roll_is_refused = refused([
    (lambda: rnc.Sphere(-0.1), rnc.ConstraintError, "radius of a sphere has to be positive"),
    (lambda: rnc.Ellipsoid((0.1, 0.2)), rnc.ConstraintError, "semi-axes of an ellipsoid: expected three numbers"),
    (lambda: rnc.Ellipsoid((0.1, 0.2, 0.0)), rnc.ConstraintError, "semi-axis of an ellipsoid has to be positive"),
    (lambda: rnc.Torus(0.2, -0.1), rnc.ConstraintError, "tube of a torus"),
    (lambda: rnc.RollingBody("body", 0.3), rnc.ConstraintError, "shape of rolling body 'body': expected Sphere"),
    (lambda: rnc.RollingBody("bdy", rnc.Sphere(0.3)), rnc.ModelError, r"no frame 'bdy'.*did you mean 'body'"),
    (lambda: rnc.GroundPlane((0, 0, 0)), rnc.ConfigurationError, "normal of the ground has no length"),
    (lambda: rnc.GroundPlane(velocity=(0, 0, 1)), rnc.ConfigurationError, "found 1 m/s along its normal"),
    (lambda: rnc.GroundPlane(spin=np.nan), rnc.ConfigurationError, "spin of the ground: expected a finite number"),
    (lambda: rnc.GroundPlane(spin=True), rnc.ConfigurationError, "expected a finite number, found True"),
    (lambda: rnc.GroundPlane(point=(0, 0)), rnc.ConfigurationError, "point of the ground: expected three"),
    (lambda: rnc.SphericalGround(0.0), rnc.ConfigurationError, "radius of spherical ground has to be positive"),
    (lambda: rnc.CylindricalGround(1.0, (0, 0, 0)), rnc.ConfigurationError, "axis of cylindrical ground has no length"),
    (lambda: rnc.CylindricalGround(1.0, spin=np.nan), rnc.ConfigurationError, "spin of cylindrical ground: expected a"),
    (lambda: rnc.RollingBody("body", EGG, ground=3.0), rnc.ConstraintError, "ground of rolling body 'body': exp"),
    (lambda: rnc.RollingWheel("body", 0.3, "y", ground=0.1), rnc.ConstraintError, "ground of wheel 'body': expected"),
    (lambda: rnc.RollingBall("body", 0.0), rnc.ConstraintError, "radius of ball 'body' has to be positive, found 0.0"),
    (lambda: rnc.RollingWheel("body", None), rnc.ConstraintError, "radius of wheel 'body' has to be positive"),
], lambda make: make().bind(rigid_body()))  # fmt: skip


@pytest.mark.parametrize(("kind", "height", "words"), [
    (rnc.RollingBody("body", rnc.Torus(0.3)), 0.0, "touches the ground at more than one point"),
    (rnc.RollingBody("body", EGG, ground=rnc.SphericalGround(0.3)), -0.2, "touches curved ground at more than one"),
])  # fmt: skip
def test_contacts_at_more_than_one_point_are_singular(kind, height, words):
    robot = rigid_body()
    q = robot.configuration({"root_joint": [0, 0, height, 0, 0, 0, 1]})
    with pytest.raises(rnc.SingularityError, match=words):
        kind.bind(robot).jacobian(Kinematics(robot).position(q))
