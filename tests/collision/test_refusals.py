"""Refusals of distances, obstacles and cells, each in one line."""

from types import SimpleNamespace

import coal
import numpy as np

import rnc_pin as rnc
from refusals import refused
from rnc_pin.collision import CollisionDistances, Obstacle, PairSelection, cells_around, load_mesh_shape
from rnc_pin.collision.continuous_distances import continuous_distances
from rnc_pin.collision.pair_bounds import JointSteps, support

BALL = Obstacle(coal.Sphere(0.1), name="ball")
PLANE = coal.Plane(np.array([0.0, 0.0, 1.0]), 0.0)
MIMIC = SimpleNamespace(njoints=2, joints=[None, SimpleNamespace(shortname=lambda: "JointModelMimic", idx_v=0, nv=0)])
SCATTERED = np.random.default_rng(0).uniform(-10.0, 10.0, (4000, 3))


def obstacle(shape, **arguments):
    return lambda robot: Obstacle(shape, name="it", **arguments)


def along(time, **options):
    def call(robot):
        q = np.tile(robot.configuration(), (2, 1))
        return continuous_distances(CollisionDistances(robot, [BALL]), np.array(time), q, **options)

    return call


test_what_is_wrong_is_refused_in_one_line = refused([
    (lambda robot: CollisionDistances(robot, selection=PairSelection(pairs=[("axl", "axle")])), rnc.ModelError,
        "no link 'axl' with collision geometry"),
    (lambda robot: CollisionDistances(robot, [BALL, BALL]), rnc.ModelError, "two obstacles are named 'ball'"),
    (lambda robot: CollisionDistances(robot).at([robot.configuration()] * 2), rnc.InputError, "q has shape"),
    (lambda robot: CollisionDistances(rnc.Robot(robot.model)), rnc.ModelError, "no collision geometry"),
    (along([0.0, -1.0]), rnc.InputError, "must not decrease"),
    (along([0.0]), rnc.InputError, r"found shapes \(2, \d+\), \(1,\)"),
    (along([0.0, 1.0], tolerance=0.0), rnc.InputError, "has to be positive, found 0 m"),
    (lambda robot: JointSteps(MIMIC, np.zeros((1, 0))), rnc.ModelError, "joint 1 is a JointModelMimic"),
    (lambda robot: support(PLANE, np.eye(3)), rnc.ModelError, "Plane has no support function"),
    (lambda robot: cells_around([1.0, 2.0, 3.0], 0.1), rnc.InputError, r"points have shape \(3,\), expected \(n, 3\)"),
    (lambda robot: cells_around([[1.0, 2.0, 3.0]], 0.0), rnc.InputError, "side: expected a positive number, found 0"),
    (lambda robot: cells_around(SCATTERED, 0.3), rnc.ModelError,
        "boxes, expected at most 2000: give a larger 'side'"),
    (lambda robot: cells_around([[np.nan, 0, 0]], 0.1), rnc.ModelError, "there are no points"),
    (lambda robot: cells_around([[0, 0, 0], [1e3, 1e3, 1e3]], 0.1), rnc.ModelError, "give a larger 'side'"),
    (lambda robot: load_mesh_shape("rock.obj"), rnc.ModelError, "mesh 'rock.obj': No such file"),
    (lambda robot: load_mesh_shape("rock.obj", 0.0), rnc.ModelError, "scale takes one number or three"),
    (obstacle(coal.Box(1, 0, 1)), rnc.InputError, "sizes have to be positive"),
    (obstacle(coal.Sphere(-1)), rnc.InputError, "sizes have to be positive"),
    (obstacle(coal.Sphere(np.inf)), rnc.InputError, "sizes have to be positive and finite"),
    (obstacle(coal.Sphere(1), position=(0, 0)), rnc.InputError, "three finite numbers"),
    (obstacle(coal.Sphere(1), position=(0, 0, np.nan)), rnc.InputError, "three finite numbers"),
    (obstacle(coal.Sphere(1), yaw="left"), rnc.InputError, "have to be numbers"),
    (obstacle(coal.Sphere(1), motion=rnc.planning.Hold([0, 0, 0])), rnc.InputError, "motion has 3 numbers"),
    (obstacle(PLANE), rnc.ModelError, "is a Plane"),
    (obstacle("box"), rnc.ModelError, "expected a coal shape"),
    (obstacle(coal.Box(1, 1, 1), ignored_links="wheel"), rnc.InputError, "takes names of links, found 'wheel'"),
], lambda case: case(rnc.Robot.from_urdf("unicycle.urdf", base="planar")))  # fmt: skip
