"""Collision avoidance: rows of single samples, and the clearance that sampled control keeps, measured by coal."""

import coal
import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from bodies import add_body, free_body
from rnc_pin.collision import CollisionDistances, Obstacle
from rnc_pin.motion.whole_body import ControlSample, InverseDynamicsQP
from rnc_pin.motion.whole_body.limits import CollisionAvoidance
from rnc_pin.motion.whole_body.limits.distance_limits import approach_speed
from rnc_pin.motion.whole_body.tasks import DampingTask, OutputTask
from systems import with_shape

DT = 0.01


def differential_drive_with_arm():
    """TIAGo on two rolling wheels, without its head and wrist."""
    lock = dict.fromkeys(("head_1_joint", "head_2_joint", "arm_5_joint", "arm_6_joint", "arm_7_joint"), 0.0)
    robot = rnc.Robot.from_example("tiago_no_hand", base="planar", lock=lock)
    wheels = [rnc.RollingWheel(f"wheel_{side}_link", 0.0985) for side in ("left", "right")]
    arm = ["torso_lift_joint", "arm_1_joint", "arm_2_joint", "arm_3_joint", "arm_4_joint"]
    outputs = [rnc.FrameSpeed("base_link"), rnc.FrameYaw("base_link"), *map(rnc.JointPosition, arm)]
    start = {"torso_lift_joint": 0.3, "arm_1_joint": 0.7, "arm_2_joint": -0.5, "arm_3_joint": -1.2, "arm_4_joint": 1.9}
    return rnc.NonholonomicSystem(robot, wheels).reduce(outputs), robot.configuration(start)


def test_rows_are_the_damper():
    reduced, q0 = differential_drive_with_arm()
    towards = rnc.planning.MinimumJerk([1.0, 0.1, 0.5, 0.0], [0.2, 0.1, 0.5, 0.0], duration=4.0)
    person = Obstacle(coal.Cylinder(0.2, 1.6), name="person", motion=towards)
    limit = CollisionAvoidance(clearance=0.03, influence=0.4, rate=4.0, obstacles=[person], q0=q0)
    bound, sample = limit.bind(reduced), ControlSample(reduced, 1.0, q0, np.full(reduced.r, 0.1), DT)
    rows, lower, upper, places = bound.rows(sample)
    assert len(bound.names) == len(bound.clearances)
    assert np.isinf(upper).all()
    exact = CollisionDistances(reduced.robot, [person], q0=q0).at(sample.end.q, 1.0 + DT)
    active, v = exact.distance < 0.4, sample.end.v
    own = slice(len(places) - np.count_nonzero(active), None)  # rows of edges come first
    np.testing.assert_array_equal(places[own], exact.pairs[active])
    rates = exact.rates(v)[active]
    wanted = -4.0 * (exact.distance - bound.clearances)[active]
    np.testing.assert_allclose((rows @ v - lower)[own], rates - wanted, atol=1e-12)
    assert any("person" in bound.names[place] for place in places)


def test_neighbours_keep_half_of_their_distance():
    reduced, q0 = differential_drive_with_arm()
    bound = CollisionAvoidance(clearance=0.1, q0=q0).bind(reduced)
    at_start = bound.distances.at(q0).distance
    np.testing.assert_allclose(bound.clearances, np.minimum(0.1, 0.5 * at_start))
    assert (bound.clearances < 0.1).any()


def test_an_approach_needs_no_more_than_its_deceleration():
    """Along ``d' = -speed(d)`` the deceleration is ``speed speed'``: a far away, less where the damper counts."""
    a, rate, room = 1.5, 4.0, np.linspace(-0.1, 3.0, 6201)
    speed = approach_speed(room, rate, np.full(len(room), a))
    used = (0.5 * speed**2)[2:] - (0.5 * speed**2)[:-2]
    used /= room[2:] - room[:-2]
    far = room[1:-1] > a / rate**2 + 1e-3
    np.testing.assert_allclose(used[far], a, rtol=1e-9)
    assert used.max() < a * (1 + 1e-9)
    np.testing.assert_allclose(speed[room < a / rate**2], rate * room[room < a / rate**2])
    np.testing.assert_array_equal(approach_speed(room, rate, np.full(len(room), np.inf)), rate * room)


def weak_cart(effort):
    """Ball of 1 kg on a rail along x that can push itself with a limited force."""
    model = pin.Model()
    add_body(model, "rail", "PX", pin.Inertia.FromSphere(1.0, 0.1), frame="cart")
    model.upperEffortLimit[:] = effort
    robot = with_shape(rnc.Robot(model), "cart", coal.Sphere(0.1))
    return rnc.NonholonomicSystem(robot, [], ["rail"]).reduce()


def least_distance(obstacle, goal, braking_time=2.0, **settings):
    """Smallest distance [m] to an obstacle of a cart of 2 N on its way to a goal [m]."""
    reduced = weak_cart(2.0)
    there = rnc.planning.MinimumJerk([0.0], [goal], duration=2.5)
    limit = CollisionAvoidance(0.05, 2.0, 10.0, obstacles=[obstacle], **settings)
    task = OutputTask(rnc.JointPosition("rail"), there, gain=4.0)
    program = InverseDynamicsQP(reduced, [task], [limit], dt=0.025, braking_time=braking_time)
    run = rnc.simulate(reduced, program, np.zeros(1), 2.5, 0.025)
    check = CollisionDistances(reduced.robot, [obstacle])
    return min(check.smallest(q, t, 1.0).min() for t, q in zip(run.time, run.q, strict=True))


def test_weak_actuators_brake_in_time():
    wall = Obstacle(coal.Box(0.2, 1.0, 1.0), position=(2.0, 0.0, 0.0), name="wall")
    assert least_distance(wall, 2.5) > 0.05 - 1e-6
    assert least_distance(wall, 2.5, None, deceleration=1e3) < 0.0  # the damper alone brakes too late
    assert least_distance(wall, 2.5, deceleration=1e3) > 0.05 - 1e-6  # not with a verified braking motion


@pytest.mark.parametrize(("place", "later", "speed", "stops"), [
    (1.2, 1.2, 1.8, True), (1.2, 1.2, 2.0, False), (1.2, 3.0, 2.2, True), (2.0, 0.6, 1.5, False),
])  # fmt: skip
def test_a_braking_motion_meets_a_door_where_it_will_be(place, later, speed, stops):
    """2 N stop 1 kg within ``v^2 / 4``; 0.25 m of the way are shapes and clearance."""
    motion = rnc.planning.MinimumJerk([place, 0.0, 0.0, 0.0], [later, 0.0, 0.0, 0.0], duration=1.0)
    door, reduced = Obstacle(coal.Box(0.2, 1.0, 1.0), motion=motion), weak_cart(2.0)
    program = InverseDynamicsQP(reduced, [DampingTask()], [CollisionAvoidance(0.05, obstacles=[door])], dt=0.025)
    assert (program.braking_problem(0.0, np.zeros(1), np.array([speed])) is None) == stops


def test_robot_retreats_from_a_person_in_motion():
    walk = rnc.planning.MinimumJerk([2.0, 0.0, 0.0, 0.0], [-0.5, 0.0, 0.0, 0.0], duration=5.0)
    person = Obstacle(coal.Capsule(0.2, 1.0), name="person", motion=walk)
    assert least_distance(person, 1.0) > 0.05 - 1e-3


def test_a_hand_that_rests_on_an_edge_keeps_both_of_its_ends():
    """A box over a box, tilted by 1e-4 rad: one corner is nearest, and the edge of a turn beside it counts too."""
    robot = with_shape(free_body(1.0, 0.1, hand=(0, 0, 0)), "hand", coal.Box(0.2, 0.1, 0.1))
    floor = Obstacle(coal.Box(2.0, 2.0, 1.0), position=(0.0, 0.0, -0.5), name="floor")
    distances, height, tilt = CollisionDistances(robot, [floor]), 0.051, 1e-4
    q = np.array([0.0, 0.0, height, 0.0, np.sin(tilt / 2), 0.0, np.cos(tilt / 2)])
    near = distances.at(q)
    edges = distances.edges(near)
    assert near.distance[0] == pytest.approx(height - 0.05 * np.cos(tilt) - 0.1 * np.sin(tilt), abs=1e-6)
    x = edges.point_a[:, 0]
    assert x.min() < -0.09
    assert x.max() > 0.09
    at = np.flatnonzero(np.abs(x) > 0.09)
    assert edges.distance.min() >= near.distance[0] - 1e-9
    assert edges.distance.max() == pytest.approx(height - 0.05 * np.cos(tilt) + 0.1 * np.sin(tilt), abs=1e-6)
    v = np.array([0.0, 0.0, 0.0, 0.0, 1.0, 0.0])  # turns about y: points in front of the middle come down
    np.testing.assert_allclose(edges.jacobian[at] @ v, -x[at], atol=1e-3)
