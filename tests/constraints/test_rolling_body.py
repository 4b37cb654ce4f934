"""Bodies that roll on planes: rows and special cases; motions of textbooks are in benchmarks/validation."""

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from bodies import add_body
from rnc_pin.model.assembly import Assembly
from rnc_pin.model.kinematics import Kinematics
from rolling import rigid_body
from row_kinds import ROLLING
from tolerances import ROUNDING


@pytest.mark.parametrize("name", ROLLING)
def test_rows_are_the_velocity_of_the_lowest_point(name):
    """The lowest point is searched."""
    kind, robot = ROLLING[name], rigid_body()
    plane = kind.ground or rnc.GroundPlane()
    kinematics = Kinematics(robot)
    rows = kind.bind(robot)
    generator = np.random.default_rng(1)
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
        velocity = at.velocity(robot.frame_id("body"))
        contact = points[0]
        body = velocity[:3] + np.cross(velocity[3:], contact - place.translation)
        ground = np.array(plane.velocity) + plane.spin * np.cross(normal, contact - plane.point)
        slip = rows.jacobian(at) @ v - rows.rate(at)
        assert np.linalg.norm(slip[:3]) == pytest.approx(np.linalg.norm(body - ground), abs=ROUNDING)
        assert slip[2] == pytest.approx((body - ground) @ normal, abs=ROUNDING)
        if not kind.pivoting:
            assert slip[3] == pytest.approx(velocity[3:] @ normal - plane.spin, abs=ROUNDING)


def test_a_body_without_pivoting_has_the_momentum_of_rolling_alone():
    """A sphere without pivoting has two freedoms; with no gravity's moment it rolls straight on."""
    robot = rigid_body(1.0, (0.02,) * 3)
    reduced = rnc.NonholonomicSystem(robot, [rnc.RollingBody("body", rnc.Sphere(0.3), pivoting=False)]).reduce()
    assert reduced.r == 2
    q0 = reduced.assembled(robot.configuration())
    run = rnc.free_motion(reduced, q0, [0.4, 0.6], 1.0, 0.25)
    steps = np.diff(run.q[:, :2], axis=0)
    np.testing.assert_allclose(steps, np.tile(steps[0], (len(steps), 1)), atol=1e-9)


def test_a_light_body_far_above_the_ground_is_put_on_it():
    """Nearest by kinetic energy, it would turn instead: its moments are small."""
    robot = rigid_body(1.0, (2e-4, 1.6e-3, 1.7e-3))
    reduced = rnc.NonholonomicSystem(robot, [rnc.RollingBody("body", rnc.Ellipsoid((0.2, 0.03, 0.02)))]).reduce()
    generator = np.random.default_rng(0)
    for _ in range(3):
        q = robot.random_configuration(generator)
        q[2] = generator.uniform(-4, 4)
        assert (
            np.abs(reduced.constraints.places[0].block.residual(Kinematics(robot).position(reduced.assembled(q)))).max()
            < 1e-11
        )


def test_many_light_bodies_are_put_on_the_ground_at_the_first_draw():
    """By kinetic energy alone, each turned instead at every other draw, and all had to succeed at once."""
    model = pin.Model()
    for k in range(4):
        add_body(model, f"base_{k}", "FreeFlyer", 1.0, moments=(2e-4, 1.6e-3, 1.7e-3), frame=f"stone_{k}")
    robot = rnc.Robot(model)
    shape = rnc.Ellipsoid((0.2, 0.03, 0.02))
    assembly = Assembly(robot, [rnc.RollingBody(f"stone_{k}", shape).bind(robot) for k in range(4)])
    generator, alone = np.random.default_rng(1), np.random.default_rng(1)
    found = assembly.random_configuration(generator)
    robot.random_configuration(alone)
    assert generator.bit_generator.state == alone.bit_generator.state
    turns = [pin.Quaternion(found[7 * k + 3 : 7 * k + 7]).toRotationMatrix() for k in range(4)]
    heights = [np.linalg.norm(np.array(shape.semi_axes) * turn[2]) for turn in turns]  # of the centre of an ellipsoid
    np.testing.assert_allclose(found[2::7], heights, atol=1e-10)


def test_what_does_not_roll_is_refused():
    robot = rigid_body()
    with pytest.raises(rnc.ConstraintError, match="radius of a sphere has to be positive"):
        rnc.Sphere(-0.1)
    with pytest.raises(rnc.ConstraintError, match="semi-axes of an ellipsoid: expected three numbers"):
        rnc.Ellipsoid((0.1, 0.2))
    with pytest.raises(rnc.ConstraintError, match="semi-axis of an ellipsoid has to be positive"):
        rnc.Ellipsoid((0.1, 0.2, 0.0))
    with pytest.raises(rnc.ConstraintError, match="tube of a torus"):
        rnc.Torus(0.2, -0.1)
    with pytest.raises(rnc.ConstraintError, match="shape of rolling body 'body': expected Sphere"):
        rnc.RollingBody("body", 0.3).bind(robot)
    with pytest.raises(rnc.ModelError, match=r"no frame 'bdy'.*did you mean 'body'"):
        rnc.RollingBody("bdy", rnc.Sphere(0.3)).bind(robot)
    for wrong, words in (
        ({"normal": (0, 0, 0)}, "normal of the ground has no length"),
        ({"velocity": (0, 0, 1)}, "velocity of the ground has to be along it, found 1 m/s along its normal"),
        ({"spin": np.nan}, "spin of the ground: expected a finite number"),
        ({"spin": True}, "spin of the ground: expected a finite number, found True"),
        ({"spin": 10**400}, "spin of the ground: expected a finite number"),
        ({"point": (0, 0)}, "point of the ground: expected three finite numbers"),
    ):
        with pytest.raises(rnc.ConfigurationError, match=words):
            rnc.GroundPlane(**wrong)
    flat = rnc.RollingBody("body", rnc.Torus(0.3)).bind(robot)
    with pytest.raises(rnc.SingularityError, match="touches the ground at more than one point"):
        flat.jacobian(Kinematics(robot).position(robot.configuration()))
