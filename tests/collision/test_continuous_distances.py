"""Smallest distances between samples, against a dense replay by Pinocchio and coal alone."""

import coal
import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from bodies import add_body
from drawn_motions import DenseReplay, drawn_motion
from rnc_pin.collision import CollisionDistances, Obstacle, PairSelection, continuous_distances
from rnc_pin.collision.continuous_distances import default_tolerance
from systems import with_shape

WITHIN = 0.05
COAL = 1e-5  # [m]; errors of coal
DEEP = 0.02  # [m]; deeper, coal's way of a sphere out of a cylinder may be three times the shortest


@pytest.mark.parametrize("seed", [*range(50), *(pytest.param(k, marks=pytest.mark.long) for k in range(50, 1000))])
def test_no_contact_is_missed_and_none_is_invented(seed):
    motion = drawn_motion(seed)
    distances = CollisionDistances(motion.robot, motion.obstacles, q0=motion.q[0])
    ends = np.array([0, len(motion.q) - 1]) if seed % 2 else None  # every other time, further samples are not measured
    found = continuous_distances(distances, motion.time, motion.q, WITHIN, samples=ends)
    dense = DenseReplay(motion, [pair[:2] for pair in distances.pairs])
    smallest = dense.smallest()
    near = smallest < WITHIN - found.tolerance - COAL
    kinds = [{type(distances.shapes[k]) for k in pair[:2]} for pair in distances.pairs]
    jumps = (smallest < -DEEP) & [each == {coal.Sphere, coal.Cylinder} for each in kinds]
    bound = np.where(jumps, -found.tolerance, smallest + found.tolerance + COAL)
    assert (found.smallest < bound)[near].all()
    for k in np.flatnonzero(found.smallest < WITHIN).tolist():
        assert dense.distances(found.time[k], [k]) == pytest.approx([found.smallest[k]], abs=COAL)


def driven(robot, places):
    """Configurations at x, y and yaw."""
    q = np.array([robot.configuration()] * len(places))
    q[:, :2], q[:, 2], q[:, 3] = places[:, :2], np.cos(places[:, 2]), np.sin(places[:, 2])
    return q


def test_few_samples_are_measured_where_bodies_are_far_or_slow():
    """An arm that swings past a wall: most of its 2001 samples need no measurement, and the nearest one is found."""
    robot = rnc.Robot.from_example("panda")
    q = np.array([robot.configuration({"panda_joint2": 0.3, "panda_joint4": -1.8})] * 2001)
    q[:, 0] = np.sin(np.linspace(0.0, 3.0, 2001))
    wall = Obstacle(coal.Box(0.1, 4.0, 4.0), position=(1.0, 0.0, 0.0), name="wall")
    distances = CollisionDistances(robot, [wall], PairSelection(links=False), q0=q[0])
    placed, place = [], distances.place
    distances.place = lambda q, t: (placed.extend(t), place(q, t))[1]
    found = continuous_distances(distances, np.linspace(0.0, 3.0, 2001), q, within=0.5, exact=0.0)
    assert len(placed) < 400
    every = found.curves(np.arange(len(distances.pairs))).min(axis=0)
    near = every < 0.5
    assert near.any()
    assert (found.smallest - every)[near].max() < found.tolerance
    exact = continuous_distances(distances, np.linspace(0.0, 3.0, 2001), q, within=0.5)
    np.testing.assert_allclose(np.minimum(exact.smallest, every)[near], exact.smallest[near], atol=COAL)


def test_a_wheel_that_spins_fast_beside_a_wall_is_certain():
    """The spin of a wheel about its own axis does not move it: 200 turns between two samples change no distance."""
    wall = Obstacle(coal.Box(9.0, 0.1, 2.0), position=(0.0, 0.4, 0.0), name="wall")
    robot = rnc.Robot.from_urdf("unicycle.urdf", base="planar")
    distances = CollisionDistances(robot, [wall])
    wheels = distances.spinning.shapes
    assert len(wheels) == 2
    q = driven(robot, np.zeros((2, 3)))
    spun = [robot.model.joints[distances.carriers[k]].idx_q for k in wheels.tolist()]
    assert all(robot.model.joints[distances.carriers[k]].nv == 1 for k in wheels.tolist())
    q[1, spun] = 1256.0
    found = continuous_distances(distances, np.array([0.0, 1.0]), q, within=1.0)
    assert not found.uncertain.any()
    np.testing.assert_allclose(found.smallest, found.curves(np.arange(len(distances.pairs)))[0], atol=COAL)


def test_tolerance_follows_the_size_of_the_robot():
    model = pin.Model()
    add_body(model, "slide", "PX", pin.Inertia.FromSphere(1.0, 0.1), frame="bead")
    bead = CollisionDistances(with_shape(rnc.Robot(model), "bead", coal.Sphere(0.01)))
    assert default_tolerance(bead) == pytest.approx(0.01 * np.sqrt(3.0) * 0.01)
    assert default_tolerance(CollisionDistances(rnc.Robot.from_example("tiago_no_hand"))) == 1e-3
