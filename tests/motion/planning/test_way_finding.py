"""Ways between configurations: exact, free of collisions between samples too, deterministic, or an honest error."""

import inspect
from itertools import combinations

import coal
import numpy as np
import pinocchio as pin
import pytest
from ompl import base as ob
from scipy.integrate import solve_ivp

import rnc_pin as rnc
import rnc_pin.errors
from benchmarks.planned_models import car, mobile_manipulator, tractor
from bodies import add_body
from driven_bases import drafted_model, tricycle
from places import ROOT
from rnc_pin.model.coordinates import ConfigurationManifold
from rnc_pin.motion.planning import WaySettings, find_way
from rnc_pin.motion.planning.inverse_kinematics import TangentBounds
from rnc_pin.motion.planning.way import intervals_along, motion_along, way_checker
from rnc_pin.motion.planning.way_finding import SampledBases, goal_configurations
from rnc_pin.motion.planning.way_search import SearchBudget, WaySearch, WaySpace, WayTask
from systems import ROLLERS, WHEEL, at_pose, driven_panda, four_bar, knife_box, mecanum, mecanum_box, tiago, with_shape

Obstacle = rnc.collision.Obstacle


def gap(width, thickness=0.2, length=40.0):
    """A long wall with a gap around y = 0."""
    return [
        Obstacle(coal.Box(thickness, length, 1.0), position=(1.5, side * (length + width) / 2, 0.0), name=name)
        for side, name in ((1.0, "left"), (-1.0, "right"))
    ]


def reintegrated(way):
    """Largest difference of a node from an integration of ``v = R(q) v2`` that starts at the one before."""
    reduced, model, worst = way.reduced, way.reduced.robot.model, 0.0
    for k, (q, h) in enumerate(zip(way.q, np.diff(way.time), strict=False)):

        def rate(t, x, q=q, k=k):
            # Coordinates x of the group element exp(x) are those of Pinocchio's integrate.
            at = reduced.at(pin.integrate(model, q, x))
            slope = pin.dIntegrate(model, q, x)[1]  # d(q (+) x) = slope dx in the tangent space at the end
            return np.linalg.solve(slope, at.R @ (at.J2 @ way.v[k]))

        found = solve_ivp(rate, (0.0, h), np.zeros(model.nv), method="DOP853", rtol=1e-12, atol=1e-13)
        end = pin.integrate(model, q, found.y[:, -1])
        worst = max(worst, np.abs(pin.difference(model, end, way.q[k + 1])).max())
    return worst


def closest(way, obstacles, spacing=0.01):
    """Smallest distance to obstacles at dense samples, without bounds between them."""
    alone = rnc.collision.PairSelection(links=False)
    distances = rnc.collision.CollisionDistances(way.reduced.robot, obstacles, alone)
    steps = np.abs(way.v).max(axis=1) * np.diff(way.time)
    times = np.linspace(0.0, way.duration, int(steps.sum() / spacing) + 2)
    return min(distances.smallest(q, 0.0, 0.2).min() for q in way.at(times))


LOT = [
    Obstacle(coal.Box(2.0, 1.2, 1.0), position=(0.2, -0.8, 0.5), name="behind"),
    Obstacle(coal.Box(2.0, 1.2, 1.0), position=(4.6, -0.8, 0.5), name="before"),
    Obstacle(coal.Box(10.0, 0.2, 1.0), position=(3.0, -1.8, 0.5), name="curb"),
]
ROOMS = [*gap(1.3, length=5.0), Obstacle(coal.Box(0.6, 0.6, 0.6), position=(0.8, 1.6, 0.3), name="table")]
ENDLESS = tricycle(turns_round=True)
TASKS = {
    "car": lambda: (car(), at_pose(car(), -1.0, 1.0), at_pose(car(), 1.9, -0.7), LOT),
    "differential drive": lambda: (tiago(), at_pose(tiago(), 0.0, 2.0), at_pose(tiago(), 3.2, 1.0, 2.0), ROOMS),
    "endless steering": lambda: (b := drafted_model(ENDLESS), at_pose(b, -1.0, -0.3), at_pose(b, 3.2, -0.3), ROOMS),
    "mecanum": lambda: (mecanum_box(), at_pose(mecanum(), 0.0, 2.0), at_pose(mecanum(), 3.0, 1.0, 1.0), ROOMS),
}


@pytest.mark.parametrize("kind", TASKS)
def test_a_way_is_exact_and_free_between_its_nodes_too(kind):
    reduced, q0, goal, obstacles = TASKS[kind]()
    way = find_way(reduced, q0, goal, obstacles, clearance=0.02)
    assert reintegrated(way) < 1e-11
    assert way.residual < 1e-12
    nearest = closest(way, obstacles)
    assert nearest >= 0.02 == way.checker.clearance
    assert way.narrowest.distance == pytest.approx(nearest, abs=5e-3)
    moved = pin.difference(reduced.robot.model, way.q[-1], goal)
    assert np.abs(moved[way.planned]).max() < 1e-9
    assert pin.difference(reduced.robot.model, way.at(way.duration), way.q[-1]) == pytest.approx(0.0, abs=1e-12)


def test_an_arm_moves_around_an_obstacle():
    reduced = driven_panda()
    q0, goal = (np.array([turn, 0.3, 0.0, -1.8, 0.0, 2.1, 0.0]) for turn in (-0.8, 0.8))
    post = [Obstacle(coal.Box(0.1, 0.1, 1.6), position=(0.5, 0.0, 0.4), name="post")]
    way = find_way(reduced, q0, goal, post)
    assert way.q[-1] == pytest.approx(goal, abs=1e-12)
    model = reduced.robot.model
    assert (way.q >= model.lowerPositionLimit - 1e-9).all()
    assert (way.q <= model.upperPositionLimit + 1e-9).all()
    assert closest(way, post, spacing=0.02) >= 0.01


def test_a_goal_of_outputs_is_reached():
    reduced, hand = mobile_manipulator(), rnc.FramePosition("tip", "xy")
    start, goal, rows = reduced.robot.configuration(), {hand: [4.0, 1.0]}, hand.bind(reduced.robot)
    goals = goal_configurations(goal, start, None, reduced, None, WaySettings(goals=3), seed=1)
    assert [np.abs(one - other).max() > 1e-3 for one, other in combinations(goals, 2)] == [True] * 3
    for q in (find_way(reduced, start, goal, gap(1.6, 0.1)).q[-1], *goals):
        at = rnc.NonholonomicSystem(reduced.robot, []).reduce().at(q)
        assert rows.value(at.position) == pytest.approx([4.0, 1.0], abs=1e-5)
    limits, turned = TangentBounds(tiago().robot), {rnc.FrameYaw("base_link"): 1.0}
    drawn = goal_configurations(turned, at_pose(tiago(), 0.0, 0.0), None, tiago(), None, WaySettings(goals=3), 1)[1:]
    assert ((limits.lower < drawn[:, limits.q_index]) & (drawn[:, limits.q_index] < limits.upper)).all()


@pytest.mark.parametrize("seed", range(3))
def test_a_gap_that_is_one_centimetre_too_narrow_is_never_passed(seed):
    reduced = knife_box()
    start, goal = at_pose(reduced, 0.0, 0.0), at_pose(reduced, 3.0, 0.0)
    settings = WaySettings(seconds=120.0, motions=600, area=[[-2, -2, 0], [5, 2, 1]])
    with pytest.raises(rnc.InfeasibleError, match=r"no way .* nearest .* m from .* block most motions \([5-9]\d%\)"):
        find_way(reduced, start, goal, gap(0.59), clearance=0.0, settings=settings, seed=seed)
    # The same gap is passed straight ahead if it is wide enough: by the tolerance and a millimetre to both sides.
    wide = find_way(reduced, start, goal, gap(0.606), clearance=0.0, settings=settings, seed=seed)
    assert 0.0 < wide.narrowest.distance < 0.004


@pytest.mark.parametrize(("bar", "holds"), [(0.04, True), (1.3, False)])
def test_wheels_that_follow_count_and_distances_of_the_base_have_been_decided_before(bar, holds):
    box = mecanum_box()
    geometry, wheel = box.robot.collision_model.copy(), box.robot.model.getFrameId("bl")
    upright = coal.Box(0.04, 0.04, bar)  # beside the wall only after a part of a turn
    parent = box.robot.model.frames[wheel].parentJoint
    geometry.addGeometryObject(pin.GeometryObject("bar", parent, wheel, pin.SE3.Identity(), upright))
    robot = rnc.Robot(box.robot.model, collision_model=geometry)
    rows = [rnc.RollingWheel(name, WHEEL, roller=roller) for name, roller in ROLLERS.items()]
    reduced = rnc.NonholonomicSystem(robot, rows).reduce()
    start, goal = at_pose(reduced, 0.0, 0.0), at_pose(reduced, 0.0, 0.5)
    # The base is nearer than the first check accepts at a sample, and farther than the clearance.
    wall = Obstacle(coal.Box(0.2, 40.0, 3.0), position=(0.3 + 0.0105 + 0.1, 0.0, 0.0), name="wall")
    steering, checker = rnc.planning.find_steering(reduced, start), way_checker(robot, start, [wall], None, 0.01)
    completed = steering.completed(next(steering.motions(start, goal)), start)
    motion = steering.along(start, completed.steps)
    assert not checker.is_free(motion)
    assert checker.holds_with(motion, ~steering.planned) == holds


@pytest.mark.parametrize(("kind", "most"), [("car", 2.0), ("differential drive", 0.4), ("mecanum", 7.0)])
def test_a_motion_along_a_way_stops_at_its_corners_and_is_exact(kind, most):
    """Constant reduced accelerations, integrated by another method, lead along the way to its end."""
    reduced, q0, goal, obstacles = TASKS[kind]()
    way = find_way(reduced, q0, goal, obstacles, seed=1)
    duration, limits = 4.0 * way.duration, np.full((2, reduced.r), [[most], [40.0]])
    K = intervals_along(way, 10, duration, limits)
    q, v2, mean = motion_along(way, K, duration, limits)
    h, model = duration / K, reduced.robot.model
    assert (np.abs(v2[[0, -1]]).max(), mean) == (0, pytest.approx((v2[:-1] + v2[1:]) / 2, abs=1e-9))
    assert np.abs(pin.difference(model, q[-1], way.q[-1])).max() < 1e-9
    for k in range(0, K, max(1, K // 15)):

        def rate(t, x, k=k):
            here = reduced.at(pin.integrate(model, q[k], x))
            slope = pin.dIntegrate(model, q[k], x)[1]
            return np.linalg.solve(slope, here.R @ (v2[k] + (v2[k + 1] - v2[k]) * t / h))

        found = solve_ivp(rate, (0.0, h), np.zeros(model.nv), rtol=1e-10, atol=1e-11)
        assert np.abs(pin.difference(model, pin.integrate(model, q[k], found.y[:, -1]), q[k + 1])).max() < 1e-8
    assert np.isclose(np.abs(v2).max(axis=1), 0.0).sum() >= 3  # it stops on the way
    # Pieces share the time by these limits: by the speeds of the way alone, the car steered with 4 rad/s.
    assert (np.abs(v2).max() <= most, np.abs(np.diff(v2, axis=0)).max() / h <= 40.0) == (True, True)


def test_a_way_that_no_iteration_improves_is_the_plan_itself():
    reduced, q0, goal, obstacles = TASKS["car"]()
    way = find_way(reduced, q0, goal, obstacles, clearance=0.02, seed=1)
    near = rnc.collision.CollisionDistances(reduced.robot, obstacles, q0=q0)
    bound, settings = rnc.optimal.DistanceBound(near, 0.02), rnc.optimal.SolverSettings(iterations=1)
    options = {"bounds": [bound], "guess": way, "seeds": 0, "settings": settings}
    plan = rnc.optimal.plan(reduced, q0, goal, 2.0 * way.duration, **options)
    assert plan.info.guess == "given, as it is"
    assert plan.verdict.succeeded
    assert closest(way, obstacles) - 1e-6 <= min(near.smallest(q, 0.0, 0.2).min() for q in plan.q)


def test_the_joints_that_are_held_do_not_move():
    reduced, q0, goal, obstacles = TASKS["differential drive"]()
    way = find_way(reduced, q0, goal, obstacles)
    pair, distance = way_checker(reduced.robot, q0, obstacles, None, 1.0).violation(q0)
    assert "table" in pair  # which is farther than links from each other
    assert 0.1 < distance < 0.4
    arm = slice(4, 14)
    assert way.q[:, arm] == pytest.approx(np.tile(q0[arm], (len(way.q), 1)), abs=1e-8)


def floating_arm():
    """A satellite with three joints in the plane."""
    model = rnc.Robot.from_urdf("floating_arm.urdf", base="planar", gravity=(0, 0, 0)).model.copy()
    add_body(model, "wrist", "RZ", 1.0, model.getJointId("elbow"), com=(0.2, 0, 0), moments=0.05, at=(0.8, 0, 0))
    return rnc.NonholonomicSystem(rnc.Robot(model), [rnc.MomentumConservation("root_joint")]).reduce()


def with_center_of(reduced, q, other):
    """The configuration, moved so that its centre of mass is that of another one."""
    found, data = np.array(q), reduced.robot.model.createData()
    centers = [np.array(pin.centerOfMass(reduced.robot.model, data, each)) for each in (q, other)]
    found[:2] += (centers[1] - centers[0])[:2]
    return found


def test_a_trailer_drives_around_a_box_by_propagated_motions():
    reduced = tractor(1)
    start, goal = at_pose(reduced, 0.0, 0.0), at_pose(reduced, 1.5, 1.0, 0.8, hitch_1=0.2)
    box = [Obstacle(coal.Box(0.4, 0.4, 1.0), position=(1.9, -0.6, 0.5), name="box")]
    way = find_way(reduced, start, goal, box, settings=WaySettings(seconds=120.0, shortcuts=3))
    assert reintegrated(way) < 1e-11
    assert way.residual < 1e-12
    assert closest(way, box) >= 0.01 < way.checker.clearance  # its motions deviate from their samples
    assert np.abs(pin.difference(reduced.robot.model, way.q[-1], goal)).max() < 1e-9
    assert way.info.steering == "propagated"
    halfway, h = 0.5 * (way.time[:-1] + way.time[1:])[::20], 1e-5
    halfway = halfway[np.diff(way.time)[::20] > 4.0 * h]  # the velocity jumps at some nodes
    assert len(halfway) > 20
    # pin.difference takes turns by less than 1e-7 as none
    rates = ConfigurationManifold(reduced.robot.model).difference(way.at(halfway - h), way.at(halfway + h)) / (2.0 * h)
    for q, v in zip(way.at(halfway), rates, strict=True):
        assert reduced.at(q).A @ v == pytest.approx(0.0, abs=1e-7)
    assert (np.abs(way.q[:, 4:]) <= reduced.robot.model.upperPositionLimit[4:] + 1e-9).all()


def test_a_free_floating_arm_turns_its_base_by_its_joints():
    reduced = floating_arm()
    start = at_pose(reduced, 0.0, 0.0, 0.0, shoulder=0.3, elbow=0.5, wrist=0.2)
    goal = with_center_of(reduced, at_pose(reduced, 0.0, 0.0, 0.2, shoulder=-0.4, elbow=0.9, wrist=-0.5), start)
    way = find_way(reduced, start, goal, settings=WaySettings(seconds=400.0, shortcuts=2), seed=2)
    assert reintegrated(way) < 1e-11
    assert np.abs(pin.difference(reduced.robot.model, way.q[-1], goal)).max() < 1e-9
    away = np.array(goal)
    away[0] += 0.1  # the centre of mass cannot move
    with pytest.raises(rnc.InfeasibleError, match=r"no way found in \d+ s.*nearest 0\.\d+ m"):
        find_way(reduced, start, away, settings=WaySettings(seconds=0.4))


def test_a_closed_loop_stays_closed_and_the_same_seed_gives_the_same_way():
    reduced = four_bar()
    start, goal = (reduced.assembled(reduced.robot.configuration({"crank": angle}), ["crank"]) for angle in (0.4, 0.9))
    way, again = (find_way(reduced, start, goal, settings=WaySettings(seconds=120.0), seed=3) for _ in range(2))
    np.testing.assert_array_equal(way.q, again.q)
    assert np.abs(pin.difference(reduced.robot.model, way.q[-1], goal)).max() < 1e-9
    assert max(np.abs(reduced.assembled(q, ["crank"]) - q).max() for q in way.q[::20]) < 1e-9


def test_an_error_in_the_search_is_not_lost(monkeypatch):
    def interrupted(self, first, second):
        if any(frame.function == "checkMotion" for frame in inspect.stack(0)):
            raise KeyboardInterrupt
        return connect(self, first, second)

    connect = WaySearch.connect
    monkeypatch.setattr(WaySearch, "connect", interrupted)
    with pytest.raises(KeyboardInterrupt) as caught:
        find_way(*TASKS["car"]())

    # OMPL frees its states. A frame of the error that kept one would give its Python object to a later search.
    frames = [each.frame.raw for each in caught.traceback]
    frames += [frame.f_back for frame in frames if frame.f_code.co_name == "safely"]
    frames = [frame for frame in frames if frame is not None and frame.f_code.co_name != "run"]
    assert "safely" in [frame.f_code.co_name for frame in frames]
    assert not [each for frame in frames for each in frame.f_locals.values() if isinstance(each, ob.State)]


def test_without_ompl_there_is_one_clear_line(monkeypatch):
    monkeypatch.setattr(rnc_pin.errors, "find_spec", lambda name: None)
    with pytest.raises(rnc.ConfigurationError, match=r"find_way: OMPL is not installed: pip install '\.\[ompl\]'"):
        find_way(*TASKS["car"]())


def test_further_motions_lead_to_faster_ways_and_the_same_motions_to_the_same_way():
    reduced = knife_box()
    start, goal = at_pose(reduced, 0.0, 0.0), at_pose(reduced, 3.0, 2.0, 1.0)
    first = find_way(reduced, start, goal, ROOMS, seed=3)
    ways = [find_way(reduced, start, goal, ROOMS, settings=WaySettings(improve=250), seed=3) for _ in range(2)]
    better = ways[0]
    assert better.duration < first.duration
    assert first.info.edges < better.info.edges <= first.info.edges + 260
    assert np.array_equal(ways[0].q, ways[1].q)
    assert closest(better, ROOMS) > 0.01
    assert reintegrated(better) < 1e-11


def test_a_search_ends_after_a_number_of_motions():
    reduced = knife_box()
    start, goal, limited = at_pose(reduced, 0, 0), at_pose(reduced, 3, 0), WaySettings(motions=60, seconds=600.0)
    with pytest.raises(rnc.InfeasibleError, match=r" 6[0-9] motions checked"):
        find_way(reduced, start, goal, gap(0.3), settings=limited)


def test_each_shortcut_makes_a_way_faster_by_a_thousandth_at_least():
    """From a detour to the straight way, with one more try at a time; no other change is made."""
    reduced = knife_box()
    places = np.array([at_pose(reduced, *each) for each in ((0.0, 0.0), (2.0, 2.0, 1.0), (4.0, 0.0))])
    steering = rnc.planning.find_steering(reduced, places[0])
    area, budget = np.array([[-9.0] * 3, [9.0] * 3]), SearchBudget(9.0)
    search = WaySearch(steering, WayTask(reduced, steering.planned, None, places[0], places[2:3], area, budget))
    detour = search._joined(places)
    ways = [search.shortened(detour, tries, seed=3) for tries in range(40)]
    times = [np.abs(way.steps[:, [0, 2]]).max(axis=1).sum() for way in ways]
    for slower, faster, before, after in zip(times, times[1:], ways, ways[1:], strict=False):
        assert faster < 0.999 * slower or np.array_equal(before.q, after.q)
    assert 4.0 <= times[-1] < 4.3 < times[0]


@pytest.mark.parametrize("base", ["planar", "free"])
def test_states_of_the_search_are_configurations(base):
    """Each kind of joint in its own subspace, and back."""
    box, unicycle = coal.Box(0.2, 0.2, 0.2), rnc.Robot.from_urdf("unicycle.urdf", base=base)
    model = with_shape(unicycle, "axle", box, joint=1).model.copy()
    for kind in ("RUBZ", "Spherical", "FreeFlyer", "RX", "PY"):
        add_body(model, kind, kind, 1.0, 1, com=(0.2, 0, 0), moments=0.05)
    model.lowerPositionLimit[-1], model.upperPositionLimit[-1] = -0.3, 0.4
    reduced = rnc.NonholonomicSystem(rnc.Robot(model), []).reduce()
    both = np.array([reduced.robot.random_configuration(np.random.default_rng(k)) for k in (0, 1)])
    steering, area = rnc.planning.find_steering(reduced, both[0]), np.array([[-9.0] * 3, [9.0] * 3])
    ways = WaySpace(steering, WayTask(reduced, steering.planned, None, both[0], both[1:], area, SearchBudget(9.0)))
    ways.space.setup()
    state = ways.space.allocState()
    ways.write(state, both[1])
    np.testing.assert_allclose(pin.difference(model, ways.read(state), both[1]), 0.0, atol=1e-12)
    assert ways._range(model.nq - 1, "JointModelPY", False) == (-0.3, 0.4)


def test_a_way_is_narrowest_where_it_passes_beside_a_post():
    """A box of 0.4 m goes east in a second and north in four: it passes a ball, 0.7 m beside it, after two of these."""
    box, post = knife_box(0.4, 0.4), Obstacle(coal.Sphere(0.1), position=(1.9, 1.5, 0.0), name="post")
    checker = way_checker(box.robot, at_pose(box, 0.0, 0.0), [post], None, 0.0)
    q = np.array([at_pose(box, x, y) for x, y in ((0, 0), (0.3, 0), (0.6, 0), (1, 0), (1, 3), (1, 4))])
    times = np.array([0.0, 0.3, 0.6, 1.0, 5.0, 6.0])
    found = checker.narrowest(times, q, 5.0)
    assert found.distance == pytest.approx(0.9 - 0.2 - 0.1, abs=2e-3)
    assert 2.7 < found.time < 3.3  # the side of the box is flat
    np.testing.assert_allclose(found.q, at_pose(box, 1.0, 0.75 * (found.time - 1.0)), atol=1e-9)
    assert "post" in found.pair
    assert checker.narrowest(times, q, 0.59) is None


@pytest.mark.parametrize(("limit", "planned"), [("1e30", 3), ("40", 5)])
def test_wheels_follow_however_a_file_says_that_they_have_no_limits(limit, planned, tmp_path):
    text = (ROOT / "urdf" / "differential_drive.urdf").read_text()
    text = text.replace('type="continuous"', 'type="revolute"')
    text = text.replace("<limit ", f'<limit lower="-{limit}" upper="{limit}" ')
    (tmp_path / "drive.urdf").write_text(text)
    robot = rnc.Robot.from_urdf(tmp_path / "drive.urdf", base="planar")
    rows = [rnc.RollingWheel(f"{name}_wheel", 0.1) for name in ("left", "right")]
    reduced = rnc.NonholonomicSystem(robot, rows).reduce()
    assert (~SampledBases(reduced, robot.configuration()).followers()).sum() == planned
