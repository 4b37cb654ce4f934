"""Pairs that DistanceBounds leaves out, against the distances of all pairs."""

import coal
import numpy as np
import pinocchio as pin

import rnc_pin as rnc
from rnc_pin.collision import CollisionDistances, Obstacle

WITHIN = 0.15


def test_pairs_that_approach_along_a_path_are_measured_in_time():
    """Steps of all sizes, a person who walks by, and kinematics from an evaluation of the model or from q."""
    robot = rnc.Robot.from_example("panda")
    reduced = rnc.NonholonomicSystem(robot).reduce()
    walk = rnc.planning.MinimumJerk([0.5, -2.0, 0.8, 0.0], [0.5, 2.0, 0.8, 3.0], duration=6.0)
    person = Obstacle(coal.Box(0.2, 0.6, 1.2), roll=0.3, name="person", motion=walk)
    post = Obstacle(coal.Cylinder(0.1, 1.0), position=(0.7, 0.5, 0.5), name="post")
    used, every = CollisionDistances(robot, [person, post]), CollisionDistances(robot, [person, post])
    generator = np.random.default_rng(3)
    q, direction, counts = robot.configuration(), generator.standard_normal(robot.nv), []
    for sample in range(40):
        if sample % 12 == 0:
            direction = generator.standard_normal(robot.nv)
        q = pin.integrate(robot.model, q, (0.5 if sample % 20 == 19 else 0.03) * direction)
        t = 0.1 * sample
        near = used.at(reduced.at(q) if sample % 3 else q, t, within=WITHIN)
        whole = every.at(q, t)
        inside = whole.distance < WITHIN
        np.testing.assert_array_equal(near.pairs, whole.pairs[inside])
        bounds = used.smallest(q, t, beyond=WITHIN)
        np.testing.assert_allclose(bounds[inside], whole.distance[inside], atol=1e-6)
        assert (bounds <= whole.distance + 1e-6).all()
        for key in ("distance", "drift"):
            np.testing.assert_allclose(getattr(near, key), getattr(whole, key)[inside], atol=1e-6)
        separate = inside & (whole.distance > 1e-3)  # the normal of a penetration may jump
        mine = whole.distance[inside] > 1e-3
        fixed = near.point_b[mine] - near.point_a[mine] - near.distance[mine, None] * near.normal[mine]
        assert np.abs(fixed).max(initial=0.0) < 1e-6
        np.testing.assert_allclose(near.jacobian[mine], whole.jacobian[separate], atol=1e-4)
        counts.append(len(near.pairs))
    assert len(set(counts)) > 5
