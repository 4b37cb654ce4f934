"""Support functions against points on the surfaces, and against coal's distances to a half space."""

import coal
import numpy as np
import pinocchio as pin
import pytest

from drawn_motions import random_joint, random_pose
from rnc_pin.collision.pair_bounds import JointSteps, support
from rnc_pin.collision.shapes import hull_of
from tolerances import ROUNDING

HULL = hull_of(np.random.default_rng(0).normal(size=(40, 3)), "hull")
SHAPES = [
    coal.Box(0.2, 0.4, 0.7), coal.Sphere(0.3), coal.Capsule(0.1, 0.5), coal.Cylinder(0.2, 0.6), coal.Cone(0.3, 0.5),
    coal.Ellipsoid(0.2, 0.3, 0.5), HULL,
]  # fmt: skip


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: type(shape).__name__)
def test_support_is_the_depth_below_a_plane(shape):
    """coal's distance to a half space is exact up to rounding."""
    generator, request, result = np.random.default_rng(4), coal.DistanceRequest(), coal.DistanceResult()
    directions = generator.normal(size=(20, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    for direction, found in zip(directions, support(shape, directions), strict=True):
        result.clear()
        plane = coal.Halfspace(-direction, -10.0)  # 10 m away along the direction
        apart = coal.distance(shape, coal.Transform3s(), plane, coal.Transform3s(), request, result)
        assert found == pytest.approx(10.0 - apart, abs=ROUNDING)


def test_a_half_space_is_bounded_along_its_normal_alone():
    normal = pin.rpy.rpyToMatrix(0.3, 0.2, 0.1)[:, 2]
    found = support(coal.Halfspace(normal, 0.4), np.array([normal, -normal, [1.0, 0.0, 0.0]]))
    np.testing.assert_allclose(found, [0.4, np.inf, np.inf])


# ---------------------------------------------------------------------- motion segments


@pytest.mark.parametrize("seed", range(60))
def test_a_carried_point_moves_at_most_by_translation_and_rotation(seed):
    """The path of a point that is r away from the frame of a joint is not longer than ``linear + angular r``."""
    generator, model = np.random.default_rng(seed), pin.Model()
    model.addJoint(0, random_joint(generator), random_pose(generator, 0.3), "joint")
    data, step = model.createData(), generator.normal(size=model.nv)
    start = pin.integrate(model, pin.neutral(model), generator.normal(size=model.nv))
    path = [pin.integrate(model, start, part * step) for part in np.linspace(0.0, 1.0, 400)]
    (angular,), (linear,) = (each[:, 1] for each in JointSteps(model, np.array(path)).of(step[None]))
    for point in (np.zeros(3), generator.normal(size=3)):
        places = []
        for q in path:
            pin.forwardKinematics(model, data, q)
            places.append(data.oMi[1].act(point))
        length = np.linalg.norm(np.diff(places, axis=0), axis=1).sum()
        assert length <= (linear + angular * np.linalg.norm(point)) * (1.0 + 1e-6) + 1e-9


def test_simple_joints_have_their_own_displacement():
    model = pin.Model()
    for k, kind in enumerate((pin.JointModelRX(), pin.JointModelPY(), pin.JointModelPlanar(), pin.JointModelHZ(0.5))):
        model.addJoint(k, kind, pin.SE3.Identity(), f"joint_{k}")
    step = np.array([-0.3, 0.4, 0.3, 0.4, -0.2, 2.0])
    angular, linear = JointSteps(model, pin.neutral(model)[None]).of(step[None])
    np.testing.assert_allclose(angular, [[0.0, 0.3, 0.0, 0.2, 2.0]])
    np.testing.assert_allclose(linear, [[0.0, 0.0, 0.4, 0.5, 1.0]])
