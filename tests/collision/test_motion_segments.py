"""Rotations and translations of joints along steps, against Pinocchio's placements."""

import numpy as np
import pinocchio as pin
import pytest

from drawn_motions import random_joint, random_pose
from rnc_pin.collision.motion_segments import JointSteps


@pytest.mark.parametrize("seed", range(60))
def test_a_carried_point_moves_at_most_by_translation_and_rotation(seed):
    """The path of a point that is r away from the frame of a joint is not longer than ``linear + angular r``."""
    generator, model = np.random.default_rng(seed), pin.Model()
    model.addJoint(0, random_joint(generator), random_pose(generator, 0.3), "joint")
    data, step = model.createData(), generator.normal(size=model.nv)
    start = pin.integrate(model, pin.neutral(model), generator.normal(size=model.nv))
    path = [pin.integrate(model, start, part * step) for part in np.linspace(0.0, 1.0, 400)]
    (angular,), (linear,) = (each[:, 1] for each in JointSteps(model, np.array(path)).of(step[None]))
    offset = generator.normal(size=3)
    for point in (np.zeros(3), offset):
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
