"""Navigation: the way is followed, a robot stops before what blocks it, takes another way, or says why not."""

import coal
import numpy as np
import pytest

import rnc_pin as rnc
from benchmarks.planned_models import car, mobile_manipulator, tractor
from rnc_pin.control import NavigationController, WayFollowing
from rnc_pin.planning.action_models import KinematicFlow
from systems import mecanum_box, with_box

Obstacle = rnc.collision.Obstacle
DT = 0.02
FAST = rnc.planning.WaySettings()  # the first way


def wall(*gaps, x=1.5, width=1.2, reach=4.0):
    """A wall along y with gaps."""
    ends = [-reach, *sorted(y + side * width / 2 for y in gaps for side in (-1, 1)), reach]
    pairs = zip(ends[::2], ends[1::2], strict=True)
    return [
        Obstacle(coal.Box(0.2, high - low, 1.0), position=(x, (low + high) / 2, 0.0), name=f"wall {k}")
        for k, (low, high) in enumerate(pairs)
    ]


def unicycle():
    robot = with_box(rnc.Robot.from_urdf("unicycle.urdf", base="planar"), "axle", 0.5, 0.4, 0.2)
    return rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("axle")]).reduce()


SYSTEMS = {"unicycle": unicycle, "car": car, "mecanum": mecanum_box, "mobile manipulator": mobile_manipulator}


def at_pose(reduced, x, y, yaw=0.0):
    q = np.array(reduced.robot.configuration())
    q[:4] = x, y, np.cos(yaw), np.sin(yaw)
    return q


def driven(reduced, controller, q, duration, *, world=lambda t, q: None, push=lambda t: None, dt=DT):
    """Configurations, velocities and status of a robot that holds each velocity until the next sample."""
    flow, v2, state, rows = KinematicFlow(reduced), np.zeros(reduced.r), None, []
    for t in np.arange(0.0, duration, dt):
        obstacles, pushed = world(t, q), push(t)
        if obstacles is not None:
            controller.set_obstacles(obstacles)
        q = q if pushed is None else flow.manifold.integrate(q[None], pushed[None])[0]
        measured = reduced.at(q, v2).measure(np.zeros(reduced.r))
        state = controller.initial_state(measured) if state is None else state
        target, state = controller.step(float(t), measured, state)
        v2 = target.v2
        rows.append((t, q, v2, controller.status, state))
        q = flow.step(q[None], dt * v2[None])[0]
    return rows


def closest(reduced, rows, obstacles):
    """Smallest distance of coal from a later part of the robot's motion to obstacles, which may move."""
    distances = rnc.collision.CollisionDistances(reduced.robot, obstacles, rnc.collision.PairSelection(links=False))
    return min(distances.smallest(q, t, 1.0).min() for t, q, *_ in rows)


@pytest.mark.parametrize("kind", SYSTEMS)
def test_a_robot_drives_through_a_gap_to_its_goal(kind):
    reduced, obstacles = SYSTEMS[kind](), wall(0.5, width=1.6)
    goal = at_pose(reduced, 3.5, 0.5)
    controller = NavigationController(reduced, goal, obstacles, clearance=0.06, following=WayFollowing(tolerance=0.01))
    rows = driven(reduced, controller, at_pose(reduced, -0.5, 0.0), 25.0, dt=0.05)
    assert rows[-1][3] == "arrived"
    assert not controller.missed_goals(rows[-1][1], np.zeros(reduced.r))
    assert closest(reduced, rows, obstacles) > 0.04


def test_a_door_closes_and_the_robot_takes_the_other_one():
    reduced = unicycle()
    both, one = wall(0.0, 2.0), wall(2.0)
    controller = NavigationController(
        reduced, at_pose(reduced, 3.0, 0.0), both, following=WayFollowing(acceleration=1.0)
    )
    shut = []

    def world(t, q):
        if not shut and q[0] > 0.4:
            shut.append(t)
            return one
        return None

    rows = driven(reduced, controller, at_pose(reduced, -1.0, 0.0), 30.0, world=world)
    words = [row[3] for row in rows]
    order = [word for k, word in enumerate(words) if k == 0 or words[k - 1] != word]
    assert order == ["replanning", "following", "stopping", "replanning", "following", "arrived"]
    assert closest(reduced, [row for row in rows if row[0] >= shut[0]], one) > 0.04
    # The way is straight here: the robot stops after v^2 / (2 a), but for the sample in which the door closes.
    k = words.index("stopping")
    speed, stood = abs(rows[k][2][0]), words.index("replanning", k)
    assert speed == pytest.approx(0.8, abs=0.02)
    assert rows[stood][1][0] - rows[k][1][0] == pytest.approx(speed**2 / (2 * 1.0), abs=1.5 * speed * DT)


def test_a_robot_waits_for_a_cart_that_crosses_its_way():
    reduced = unicycle()
    cart = cart_along([1.5, 4.0], [1.5, -4.0], 9.0)
    quick = WayFollowing(acceleration=1.0, check=0.25, horizon=6.0)
    controller = NavigationController(reduced, at_pose(reduced, 4.0, 0.0), [cart], following=quick)
    rows = driven(reduced, controller, at_pose(reduced, -1.0, 0.0), 11.0)
    words = [row[3] for row in rows]
    order = [word for k, word in enumerate(words) if k == 0 or words[k - 1] != word]
    assert order == ["replanning", "waiting", "following", "arrived"]
    assert {row[4].reason for row in rows if row[3] == "waiting"} == {"waits for cart"}
    assert closest(reduced, rows, [cart]) > 0.049


def cart_along(first, last, duration, sides=(0.6, 0.8)):
    motion = rnc.planning.MinimumJerk([*first, 0, 0], [*last, 0, 0], duration=duration)
    return Obstacle(coal.Box(*sides, 1.0), name="cart", motion=motion)


def test_a_robot_at_its_goal_gives_way_to_a_cart_and_comes_back():
    reduced = unicycle()
    goal, cart = at_pose(reduced, 0.0, 0.0), cart_along([0.0, 4.0], [0.0, -4.0], 7.0)
    # Nobody moves: the cart drives over the goal.
    assert closest(reduced, [(t, goal) for t in np.arange(0.0, 7.0, 0.1)], [cart]) < 0.0
    controller = NavigationController(reduced, goal, [cart], following=WayFollowing(acceleration=1.0), settings=FAST)
    rows = driven(reduced, controller, goal, 12.0, dt=0.1)
    assert closest(reduced, rows, [cart]) > 0.04
    assert "gives way to cart" in {row[4].reason for row in rows if row[3] == "giving way"}
    assert rows[-1][3] == "arrived"
    assert not controller.missed_goals(rows[-1][1], np.zeros(reduced.r))


def test_in_a_corridor_a_robot_backs_off_along_the_way_that_it_came_from():
    reduced = unicycle()
    walls = [Obstacle(coal.Box(4.0, 0.2, 1.0), position=(2.0, y, 0.0), name=f"wall {y}") for y in (-0.5, 0.5)]
    goal, cart = at_pose(reduced, 5.5, 0.0), cart_along([7.0, 0.0], [-2.0, 0.0], 20.0, sides=(0.5, 0.5))
    following = WayFollowing(acceleration=1.0)
    controller = NavigationController(reduced, goal, walls, following=following, settings=FAST)
    seen = []

    def world(t, q):
        if q[0] > 1.0 and not seen:
            seen.append(t)
            return [*walls, cart]
        return None

    rows = driven(reduced, controller, at_pose(reduced, -0.6, 0.0), 17.0, world=world, dt=0.1)
    later = [row for row in rows if row[0] >= seen[0]]
    assert closest(reduced, later, [cart]) > 0.04
    assert closest(reduced, rows, walls) > 0.04
    assert min(q[0] for _, q, *_ in later) < -0.4  # out of the corridor, which is too narrow for both
    assert "gives way to cart" in {row[4].reason for row in later}


def test_a_robot_that_cannot_give_way_says_so():
    reduced, q = unicycle(), at_pose(unicycle(), 0.0, 0.0)
    four = (0.1, 1.0, -0.4, 0.0), (0.1, 1.0, 0.4, 0.0), (1.0, 0.1, 0.0, -0.4), (1.0, 0.1, 0.0, 0.4)
    walls = [Obstacle(coal.Box(a, b, 1.0), position=(x, y, 0.0), name=f"wall {x} {y}") for a, b, x, y in four]
    cart = cart_along([0.0, 4.0], [0.0, -4.0], 7.0)
    following = WayFollowing(acceleration=1.0, slice_size=10.0)
    controller = NavigationController(reduced, q, [*walls, cart], following=following)
    rows = driven(reduced, controller, q, 4.0, dt=0.1)
    assert closest(reduced, rows, walls) > 0.04
    assert closest(reduced, rows, [cart]) < 0.0
    assert "cart comes nearer than the robot can avoid" in {row[4].reason for row in rows}


def test_without_another_way_it_stops_and_says_so():
    reduced, shut = unicycle(), wall()
    area = [[-2, -3, -1], [5, 3, 1]]
    settings = rnc.planning.WaySettings(motions=150, area=area)
    controller = NavigationController(reduced, at_pose(reduced, 3.0, 0.0), wall(0.0), settings=settings)
    rows = driven(
        reduced, controller, at_pose(reduced, -1.0, 0.0), 6.0,
        world=lambda t, q: shut if abs(t - 2.0) < DT / 2 else None,
    )  # fmt: skip
    assert rows[-1][3] == "no way"
    assert rows[-1][1][0] < 1.5 - 0.1 - 0.25 - 0.04
    missed = controller.missed_goals(rows[-1][1], np.zeros(reduced.r))
    assert missed
    assert "no way found" in missed[0].reason
    controller.set_obstacles(wall(0.0))  # the door opens again
    q, state = rows[-1][1], rows[-1][4]
    measured = reduced.at(q, np.zeros(reduced.r)).measure(np.zeros(reduced.r))
    while controller.status in ("no way", "replanning"):
        state = controller.step(6.0, measured, state)[1]
    assert controller.status == "following"


@pytest.mark.parametrize("period", [DT, 0.1])
def test_a_search_ends_however_often_the_obstacles_are_seen_elsewhere(period):
    reduced, every = unicycle(), round(period / DT)
    controller = NavigationController(reduced, at_pose(reduced, 3.0, 0.0), wall(0.0))

    def seen(t, q):  # a person walks far away
        person = Obstacle(coal.Cylinder(0.25, 1.6), position=(0.0, -6.0 + 0.5 * t, 0.8), name="person")
        return [*wall(0.0), person] if round(t / DT) % every == 0 else None

    rows = driven(reduced, controller, at_pose(reduced, -1.0, 0.0), 12.0, world=seen)
    assert rows[-1][3] == "arrived"
    assert closest(reduced, rows, wall(0.0)) > 0.04


def test_a_way_that_an_obstacle_has_blocked_during_its_search_is_not_followed():
    reduced, shut = unicycle(), wall(1.5)
    q = at_pose(reduced, -1.0, 0.0)
    controller = NavigationController(reduced, at_pose(reduced, 3.0, 0.0), wall(0.0))
    measured = reduced.at(q, np.zeros(reduced.r)).measure(np.zeros(reduced.r))
    state = controller.initial_state(measured)
    for _ in range(3):
        state = controller.step(0.0, measured, state)[1]
    controller.set_obstacles(shut)
    state = state._replace(least_slices=1000)  # this search goes on in spite of the change
    while controller.status == "replanning":
        state = controller.step(0.0, measured, state)[1]
    assert controller.status == "following"
    assert state.searches == 2
    distances = rnc.collision.CollisionDistances(reduced.robot, shut, rnc.collision.PairSelection(links=False))
    assert min(distances.smallest(each, 0.0, 1.0).min() for each in state.way.q) > 0.04


def test_a_robot_that_is_pushed_off_its_way_plans_again():
    reduced = unicycle()
    controller = NavigationController(reduced, at_pose(reduced, 3.0, 0.0), wall(0.0, width=1.6))
    aside = np.array([0.0, 0.15, 0.1, 0.0])
    rows = driven(
        reduced, controller, at_pose(reduced, -1.0, 0.0), 14.0, push=lambda t: aside if abs(t - 1.5) < DT / 2 else None
    )
    assert "stopping" in [row[3] for row in rows]
    assert rows[-1][4].ways >= 2
    assert rows[-1][3] == "arrived"
    # A small push is for the feedback.
    controller = NavigationController(reduced, at_pose(reduced, 3.0, 0.0), wall(0.0, width=1.6))
    rows = driven(
        reduced, controller, at_pose(reduced, -1.0, 0.0), 9.0,
        push=lambda t: 0.2 * aside if abs(t - 1.5) < DT / 2 else None,
    )  # fmt: skip
    assert rows[-1][4].ways == 1
    assert not controller.missed_goals(rows[-1][1], np.zeros(reduced.r))


def test_the_same_measurements_give_the_same_commands_also_from_a_state_of_another_controller():
    reduced, obstacles = unicycle(), wall(2.0)
    q, goal = at_pose(reduced, -1.0, 0.0), at_pose(reduced, 3.0, 0.0)
    small = WayFollowing(slice_size=40)
    first, second = (NavigationController(reduced, goal, obstacles, following=small, settings=FAST) for _ in range(2))
    measured = reduced.at(q, np.zeros(reduced.r)).measure(np.zeros(reduced.r))
    states = [first.initial_state(measured)]
    while first.status == "replanning":
        states.append(first.step(0.0, measured, states[-1])[1])
    assert len(states) > 4
    state = states[len(states) // 2]
    while second.status == "replanning":
        state = second.step(0.0, measured, state)[1]
    assert np.array_equal(state.way.q, states[-1].way.q)
    assert np.array_equal(state.way.gains, states[-1].way.gains)


def test_what_it_refuses():
    with pytest.raises(rnc.ConfigurationError, match=r"speed: expected a share of the velocity limits up to 1"):
        WayFollowing(speed=1.2)
    with pytest.raises(rnc.ConfigurationError, match=r"tube: expected a positive number"):
        WayFollowing(tube=0.0)
    trailer = tractor(1)
    with pytest.raises(rnc.ConfigurationError, match=r"no exact steering is known"):
        NavigationController(trailer, trailer.robot.configuration())
