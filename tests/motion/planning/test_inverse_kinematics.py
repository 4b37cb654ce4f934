"""Configurations for targets: closed forms, robots of others, closed loops, limits, collisions, unreachable targets."""

from itertools import pairwise

import coal
import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
import systems
from bodies import add_body, frame_placement
from rnc_pin.collision import CollisionDistances, Obstacle
from rnc_pin.motion.planning import inverse_kinematics
from rnc_pin.motion.planning.inverse_kinematics import Descent, Residuals, TangentBounds, descend


def arm():
    """The arm of the mobile manipulator on a fixed base, in the plane."""
    robot = rnc.Robot.from_urdf("mobile_manipulator.urdf")
    return rnc.NonholonomicSystem(robot, [], robot.joint_names).reduce([rnc.FramePosition("tip", "xy")])


def shape_of(reduced):
    """Shoulder (2,) and both lengths of the arm, from the model."""
    model, data = reduced.robot.model, reduced.robot.model.createData()
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    points = [data.oMi[1].translation, data.oMi[2].translation, data.oMf[reduced.robot.frame_id("tip")].translation]
    return points[0][:2], *(float(np.linalg.norm((b - a)[:2])) for a, b in pairwise(points))


def test_a_two_link_arm_bends_as_the_law_of_cosines_says(generator):
    reduced = arm()
    shoulder, first, second = shape_of(reduced)
    q0 = reduced.robot.configuration({"joint_1": 0.3, "joint_2": 0.5})
    for _ in range(20):
        reach, angle = generator.uniform(0.2, 0.98) * (first + second), generator.uniform(-np.pi, np.pi)
        goal = shoulder + reach * np.array([np.cos(angle), np.sin(angle)])
        result = rnc.solve_ik(reduced, q0, {rnc.FramePosition("tip", "xy"): goal})
        elbow = np.arccos((reach**2 - first**2 - second**2) / (2 * first * second))
        assert result.converged
        assert np.cos(result.q[1]) == pytest.approx(np.cos(elbow), abs=1e-8)
        assert result.residuals == {"tip": pytest.approx(0.0, abs=1e-9)}
        assert not result.unreachable
        assert not result.q.flags.writeable


def test_a_long_arm_of_many_joints_reaches():
    """Beside the squares of its levers, the damping of a step is lost to rounding."""
    model, generator = pin.Model(), np.random.default_rng(0)
    for k in range(12):
        at = [2.0, 0.0, 0.0] if k else None
        add_body(model, f"joint_{k}", "RY" if k % 2 else "RZ", 1.0, k, at=at, frame=f"link_{k}")
    reduced = rnc.NonholonomicSystem(rnc.Robot(model)).reduce()
    for _ in range(5):
        q0, q = generator.uniform(-1.0, 1.0, (2, 12))
        goal = reduced.at(q).position.placement(reduced.robot.frame_id("link_11")).translation
        assert rnc.solve_ik(reduced, q0, {rnc.FramePosition("link_11"): goal}).converged


def test_no_joint_makes_a_full_turn_from_the_start():
    reduced = arm()
    q0 = reduced.robot.configuration({"joint_1": 20.0, "joint_2": -7.0})
    far = rnc.solve_ik(reduced, q0, {rnc.FramePosition("tip", "xy"): [9.0, 1.0]})
    near = rnc.solve_ik(reduced, q0, {rnc.FramePosition("tip", "xy"): shape_of(reduced)[0] + [0.3, 0.9]})
    for result in (far, near):
        assert np.abs(result.q - q0).max() <= np.pi
    assert near.converged
    meant = rnc.solve_ik(reduced, q0, {rnc.JointPosition("joint_1"): 30.0})  # here the turns are the target
    assert meant.q[0] == pytest.approx(30.0)


def test_random_starts_are_half_a_turn_or_a_metre_around_and_within_limits(monkeypatch):
    model, starts = pin.Model(), []
    for k, kind in enumerate(("RZ", "RZ", "RZ", "Translation")):
        add_body(model, f"joint_{k}", kind, 1.0, k, frame=f"body_{k}")
    model.lowerPositionLimit[:3], model.upperPositionLimit[:3] = [-20.0, -1.0, -0.2], [20.0, 9.0, 0.5]
    reduced = rnc.NonholonomicSystem(rnc.Robot(model)).reduce()

    def stay(evaluate, bounds, q, *rest, **options):
        starts.append(q)
        return Descent(q, 1.0, 0.0, 0)

    monkeypatch.setattr(inverse_kinematics, "descend", stay)
    q0, far = np.array([5.0, 1.0, 0.0, 4.0, -3.0, 7.0]), {rnc.FramePosition("body_3", "x"): 99.0}
    rnc.solve_ik(reduced, q0, far, search=rnc.IkSearch(starts=400))
    drawn, turn = np.array(starts[1:400]), np.pi
    low, high = np.array([[5 - turn, -1.0, -0.2, 3.0, -4.0, 6.0], [5 + turn, 1 + turn, 0.5, 5.0, -2.0, 8.0]])
    assert ((low <= drawn) & (drawn <= high)).all()
    assert (np.ptp(drawn, axis=0) > 0.97 * (high - low)).all()


def test_a_target_out_of_reach_is_reported_with_its_distance():
    reduced = arm()
    shoulder, first, second = shape_of(reduced)
    q0 = reduced.robot.configuration({"joint_1": 0.3, "joint_2": 0.5})
    goal = shoulder + np.array([3.0 * first + second, 1.0])
    distance = float(np.linalg.norm(goal - shoulder))
    result = rnc.solve_ik(reduced, q0, {rnc.FramePosition("tip", "xy"): goal}, search=rnc.IkSearch(starts=5))
    assert not result.converged
    assert result.unreachable == {"tip": pytest.approx(distance - first - second, abs=1e-6)}
    tip = reduced.at(result.q).outputs()[1]
    assert tip - shoulder == pytest.approx((first + second) / distance * (goal - shoulder), abs=1e-3)  # flat
    # Two targets of which one can be reached alone: both errors are reported.
    both = rnc.solve_ik(reduced, q0, {"tip_x": goal[0], "tip_y": shoulder[1]}, search=rnc.IkSearch(starts=5))
    assert set(both.residuals) == {"tip_x", "tip_y"}
    assert both.unreachable["tip_x"] == pytest.approx(goal[0] - shoulder[0] - first - second, abs=1e-6)
    assert "tip_y" not in both.unreachable


def test_limits_hold_and_are_reported():
    reduced = arm()
    model = reduced.robot.model
    shoulder, first, second = shape_of(reduced)
    lower, upper = model.lowerPositionLimit.copy(), model.upperPositionLimit.copy()
    try:
        model.lowerPositionLimit, model.upperPositionLimit = np.array([-0.5, -0.4]), np.array([0.5, 0.4])
        goal = shoulder + (first + second) * np.array([np.cos(0.7), np.sin(0.7)])
        result = rnc.solve_ik(reduced, np.zeros(2), {rnc.FramePosition("tip", "xy"): goal})
        assert not result.converged
        assert (result.active_limits, result.q[0]) == (("joint_1 (upper)",), 0.5)
        # The best second joint is a one-dimensional problem.
        angles = np.linspace(-0.4, 0.4, 200_001)
        tips = shoulder[:, None] + first * np.array([[np.cos(0.5)], [np.sin(0.5)]])
        tips = tips + second * np.array([np.cos(0.5 + angles), np.sin(0.5 + angles)])
        distances = np.linalg.norm(tips - goal[:, None], axis=0)
        assert result.unreachable["tip"] == pytest.approx(distances.min(), abs=1e-8)
        assert result.q[1] == pytest.approx(angles[distances.argmin()], abs=1e-5)
        free = rnc.solve_ik(reduced, np.zeros(2), {rnc.FramePosition("tip", "xy"): 0.99 * goal}, limits=False)
        assert free.converged
    finally:
        model.lowerPositionLimit, model.upperPositionLimit = lower, upper


ROBOTS = {
    "tiago_no_hand": ({"base": "planar"}, "arm_tool_link"),
    "ur5_robot": ({}, "tool0"),
    "panda": ({}, "panda_hand"),
}


def random_pose(robot, frame, generator):
    """Pose of a frame at a random configuration within the limits; bases within a metre."""
    model = robot.model
    lower = np.where(np.abs(model.lowerPositionLimit) < 1e3, model.lowerPositionLimit, -1.0)
    upper = np.where(np.abs(model.upperPositionLimit) < 1e3, model.upperPositionLimit, 1.0)
    return frame_placement(robot, pin.normalize(model, generator.uniform(lower, upper)), frame)


@pytest.mark.parametrize("name", ROBOTS)
def test_reachable_poses_of_published_robots_are_reached(name):
    options, frame = ROBOTS[name]
    robot = rnc.Robot.from_example(name, **options)
    reduced, generator = rnc.NonholonomicSystem(robot).reduce(), np.random.default_rng(1)
    for seed in range(10):
        goal = random_pose(robot, frame, generator)
        targets = {rnc.FramePosition(frame): goal.translation, rnc.FrameOrientation(frame): goal.rotation}
        result = rnc.solve_ik(reduced, robot.configuration(), targets, search=rnc.IkSearch(seed=seed))
        assert result.converged, result
        lower, upper = robot.model.lowerPositionLimit, robot.model.upperPositionLimit
        bounded = (lower < upper) & (np.abs(lower) < 1e300)
        assert ((result.q >= lower) & (result.q <= upper))[bounded].all()
        assert np.linalg.norm(pin.log6(frame_placement(robot, result.q, frame).actInv(goal)).vector) < 3e-6


def test_rolling_rows_are_ignored_and_named():
    reduced = systems.mobile_manipulator()
    q0 = reduced.robot.configuration({"joint_1": 0.5, "joint_2": -1.2})
    targets = {rnc.FramePosition("tip", "xy"): [2.0, 1.0], "base_yaw": 0.8, "distance_base_tip": 1.2}
    result = rnc.solve_ik(reduced, q0, targets)
    assert result.converged
    assert result.ignored_rows == ("no_side_slip(axle.y)",)
    x1, x2 = reduced.at(result.q).outputs()
    assert [*x2[:2], x2[3], x1[0]] == pytest.approx([2.0, 1.0, 0.8, 1.2], abs=1e-8)
    held = rnc.solve_ik(reduced, q0, {rnc.FramePosition("tip", "xy"): [1.2, 0.4]}, hold=["root_joint"])
    assert held.q[:4] == pytest.approx(q0[:4], abs=0)
    assert held.converged


def test_a_four_bar_closes_exactly_at_any_reachable_crank_angle():
    reduced = systems.four_bar()
    q0 = reduced.random_configuration(np.random.default_rng(0))
    names = reduced.robot.joint_names
    for angle in np.linspace(-3.0, 3.0, 13):
        result = rnc.solve_ik(reduced, q0, {rnc.JointPosition(names[0]): angle})
        assert result.converged, result
        assert np.abs(reduced.assembly.residual(result.q)).max() < 1e-9
        assert result.q[0] == pytest.approx(angle, abs=1e-8)
        assert not result.ignored_rows
    # The rocker turns back where crank and coupler are aligned. Beyond, the loop stays closed.
    ground, rocker, near = systems.GROUND, systems.ROCKER, systems.COUPLER - systems.CRANK
    end = np.pi - np.arccos((ground**2 + rocker**2 - near**2) / (2 * ground * rocker))
    result = rnc.solve_ik(reduced, q0, {rnc.JointPosition(names[2]): end + 0.2}, search=rnc.IkSearch(starts=10))
    assert not result.converged
    assert result.holonomic_residual < 1e-11
    assert result.unreachable[names[2]] == pytest.approx(0.2, abs=1e-4)


def test_obstacles_are_avoided_and_reported():
    robot = rnc.Robot.from_example("panda")
    reduced = rnc.NonholonomicSystem(robot).reduce()
    q0 = robot.configuration({"panda_joint2": -0.6, "panda_joint4": -2.2, "panda_joint6": 1.8})
    target = {rnc.FramePosition("panda_hand"): [0.5, 0.1, 0.35]}
    free, data = rnc.solve_ik(reduced, q0, target), robot.model.createData()
    pin.forwardKinematics(robot.model, data, free.q)
    elbow = data.oMi[robot.joint_id("panda_joint4")].translation
    ball = Obstacle(coal.Sphere(0.08), position=tuple(elbow), name="ball")
    distances = CollisionDistances(robot, [ball], q0=q0)
    assert distances.at(free.q, within=0.02).distance.min() < 0.0
    result = rnc.solve_ik(reduced, q0, target, collisions=distances, clearance=0.02)
    assert result.converged
    assert not result.collisions
    assert distances.smallest(result.q, beyond=0.1).min() >= 0.02
    # A hand inside the obstacle is impossible: pair and depth are reported.
    inside = CollisionDistances(robot, [Obstacle(coal.Sphere(0.15), position=(0.5, 0.1, 0.35), name="ball")], q0=q0)
    blocked = rnc.solve_ik(reduced, q0, target, collisions=inside, search=rnc.IkSearch(starts=3))
    assert not blocked.converged
    assert blocked.collisions or blocked.unreachable


def test_equal_seeds_give_equal_bits():
    robot = rnc.Robot.from_example("ur5_robot")
    reduced = rnc.NonholonomicSystem(robot).reduce()
    goal = random_pose(robot, "tool0", np.random.default_rng(5))
    targets = {rnc.FramePosition("tool0"): goal.translation, rnc.FrameOrientation("tool0"): pin.log3(goal.rotation)}
    one, other = (rnc.solve_ik(reduced, robot.configuration(), targets, search=rnc.IkSearch(seed=3)) for _ in range(2))
    assert np.array_equal(one.q, other.q)


# ---------------------------------------------------------------------- bounded descent


def slides(kinds):
    """Model of joints of one or three slides."""
    model = pin.Model()
    for k, kind in enumerate(kinds):
        add_body(model, f"joint_{k}", kind, 1.0, k)
    return rnc.Robot(model).model


def test_each_of_three_slides_stops_at_its_own_limit():
    """Behind a ball, so that places in q and in v differ. The nearest point of a box is its clipped goal."""
    model = slides([pin.JointModelSpherical(), pin.JointModelPX(), pin.JointModelTranslation()])
    high = np.array([np.inf, np.inf, np.inf, np.inf, 0.5, 0.1, 0.2, 0.3])
    low, high[6] = -high, np.inf  # limits on one side are limits
    low[5] = -np.inf
    model.lowerPositionLimit, model.upperPositionLimit = low, high
    bounds = TangentBounds(rnc.Robot(model))
    assert bounds.v_index.tolist() == [3, 4, 5, 6]
    goal, J = np.array([0.4, 3.0, -2.0, 0.25]), np.eye(7)[3:]
    nothing = np.zeros((0, 7))

    def evaluate(q):
        return Residuals(goal - q[4:], J, nothing[:, 0], nothing)

    found = descend(evaluate, bounds, pin.neutral(model))
    np.testing.assert_allclose(found.q[4:], [0.4, 0.1, -0.2, 0.25], atol=1e-9)
    assert found.error == pytest.approx(np.hypot(2.9, 1.8), abs=1e-9)


def test_an_equality_of_coupled_joints_satisfies_the_conditions_of_optimality():
    """Joints within their limits have one slope; the others would go beyond."""
    model, high = slides([pin.JointModelPX()] * 4), np.array([0.3, 0.4, 0.5, 0.6])
    model.lowerPositionLimit, model.upperPositionLimit = -high, high
    generator, bounds = np.random.default_rng(5), TangentBounds(rnc.Robot(model))
    for _ in range(12):
        J, goal, total = generator.normal(size=(4, 4)), generator.normal(size=4), generator.uniform(-0.8, 0.8)

        def evaluate(q, J=J, goal=goal, total=total):
            return Residuals(goal - J @ q, J, np.array([q.sum() - total]), np.ones((1, 4)))

        found = descend(evaluate, bounds, np.zeros(4))
        slope, at_limit = J.T @ (goal - J @ found.q), np.abs(found.q) >= high - 1e-12
        assert found.residual < 1e-12
        shared = slope[~at_limit].mean()
        np.testing.assert_allclose(slope[~at_limit], shared, atol=1e-8)
        assert ((slope - shared)[at_limit] * np.sign(found.q[at_limit]) > 0).all()
