"""Surfaces of bodies as ground: levels and their derivatives, contacts on both sides, and mistakes."""

import numpy as np
import pytest

import rnc_pin as rnc
from rnc_pin.model.kinematics import Kinematics
from systems import free_bodies
from tolerances import ROUNDING

SHAPES = {
    "sphere": rnc.Sphere(0.4),
    "ellipsoid": rnc.Ellipsoid((0.5, 0.3, 0.2)),
    "torus": rnc.Torus(0.4, 0.1, "x"),
}


@pytest.mark.parametrize("name", SHAPES)
def test_levels_vanish_on_the_surface_and_their_gradients_are_normals(name):
    shape, generator = SHAPES[name], np.random.default_rng(0)
    normal = generator.normal(size=(20, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    surface = rnc.BodySurface(shape, at=(0.1, -0.2, 0.3), rpy=(0.3, 0.5, -0.2))
    points = surface.at + shape.point(normal @ surface._axes) @ surface._axes.T
    np.testing.assert_allclose(surface.level(points), 0.0, atol=1e-15)
    gradient = surface.gradient(points)
    np.testing.assert_allclose(gradient / np.linalg.norm(gradient, axis=1, keepdims=True), normal, atol=ROUNDING)
    assert (surface.level(points + 0.01 * normal) > 0).all()
    place, step = generator.uniform(0.3, 0.6, (20, 3)), 1e-30
    for axis, unit in enumerate(np.eye(3)):
        moved = place + 1j * step * unit
        np.testing.assert_allclose(
            np.imag(surface.level(moved)) / step, surface.gradient(place)[:, axis], atol=ROUNDING
        )
        np.testing.assert_allclose(
            np.imag(surface.gradient(moved)) / step, surface.hessian(place)[..., axis], atol=1e-9
        )


def test_two_bodies_touch_where_each_is_the_ground_of_the_other():
    """Both ways give the same contact, gap and forces between them, along opposite normals."""
    robot = free_bodies("one", "two")
    egg, ball = SHAPES["ellipsoid"], SHAPES["sphere"]
    ways = (
        rnc.RollingBody("one", egg, ground=rnc.BodySurface(ball, "two")),
        rnc.RollingBody("two", ball, ground=rnc.BodySurface(egg, "one")),
    )
    generator = np.random.default_rng(1)
    q, v = robot.random_configuration(generator), generator.normal(size=12)
    q[:3], q[7:10] = (0.5, 0.3, 0.4), (0.1, -0.2, -0.1)
    first, second = (kind.bind(robot) for kind in ways)
    at = Kinematics(robot).position(q).with_velocity(v)
    gaps = first.residual(at)[2], second.residual(at)[2]
    assert gaps[0] == pytest.approx(gaps[1], abs=ROUNDING)
    (points, one), (others, other) = first.lines_of_action(at), second.lines_of_action(at)
    np.testing.assert_allclose(one[2], -other[2], atol=ROUNDING)
    np.testing.assert_allclose(points[2] - others[2], gaps[0] * one[2], atol=ROUNDING)
    system = rnc.NonholonomicSystem(robot, [ways[0]]), rnc.NonholonomicSystem(robot, [ways[1]])
    touching = system[0].assembled(q)
    v = system[0].reduce().at(touching, generator.normal(size=9)).v
    accelerations = []
    for each in system:
        state = each.reduce().at(touching, v=v)
        accelerations.append(state.v_dot(state.v2_dot([])))
    np.testing.assert_allclose(accelerations[0], accelerations[1], atol=1e-8)


def test_searches_start_at_points_of_the_surface():
    """Those of a ball are the nearest ones; a place at the centre has one too."""
    generator = np.random.default_rng(3)
    place = np.concatenate([generator.normal(size=(5, 3)), [[0.1, 0.2, 0.3]]])
    for shape in SHAPES.values():
        surface = rnc.BodySurface(shape, at=(0.1, 0.2, 0.3), rpy=(0.3, 0.2, 0.1))
        np.testing.assert_allclose(surface.level(surface.below(place[:-1])), 0.0, atol=1e-12)
    ball = rnc.BodySurface(rnc.Sphere(0.4), at=(0.1, 0.2, 0.3))
    away = place[:-1] - ball.at
    nearest = ball.at + 0.4 * away / np.linalg.norm(away, axis=1, keepdims=True)
    np.testing.assert_allclose(ball.below(place)[:-1], nearest, atol=ROUNDING)
    assert ball.level(ball.below(place[-1])) == pytest.approx(0.0, abs=ROUNDING)


def test_drawn_surfaces_are_closed():
    for shape in SHAPES.values():
        vertices, triangles = rnc.BodySurface(shape).mesh(np.zeros(3), 1.0)
        assert triangles.max() < len(vertices)
        assert np.isfinite(vertices).all()
        assert np.abs(shape.level(vertices)).max() < 1e-12


def test_mistakes_have_names():
    with pytest.raises(rnc.ConstraintError, match="expected Sphere, Ellipsoid, Torus or an object with the methods"):
        rnc.BodySurface(rnc.Cone(0.1, 0.2))
    with pytest.raises(rnc.ConstraintError, match="sharp edge"):
        rnc.BodySurface(rnc.Torus(0.2))
    with pytest.raises(rnc.ConfigurationError, match="centre of a body's surface"):
        rnc.BodySurface(rnc.Sphere(0.2), at=(0.0, 1.0))
