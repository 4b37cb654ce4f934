"""Plans that are returned keep goal and distances in a replay that does not use the package; others are refused."""

import coal
import numpy as np
import pytest

import forklifts
import rnc_pin as rnc
import systems
from benchmarks.planned_models import car, tractor
from rnc_pin.motion.optimal import DistanceBound, OutputBound, SolverSettings, VelocityBound
from rnc_pin.motion.optimal.bounds import GoalRows
from rnc_pin.motion.optimal.guesses import guesses
from rnc_pin.motion.optimal.planner import build_problem, initial_node
from rnc_pin.motion.optimal.sequential_quadratic import SequentialQuadratic
from rnc_pin.motion.planning.action_models import action_model
from rnc_pin.verdict import FindingKind, Severity

RACK, SIZE, CLEARANCE = (0.0, 0.0, 1.0), (2.0, 0.6, 2.0), 0.1
SLOW = VelocityBound([-1.0, -1.0, -0.5], [1.0, 1.0, 0.5])


def round_the_rack(reduced, number, **options):
    """Plan from one side of a rack to the other, between poses of a draw."""
    generator = np.random.default_rng(number)
    begin = generator.uniform([-2.0, -2.5, -0.6], [2.0, -1.9, 0.6])
    end = generator.uniform([-2.0, 1.9, -0.6], [2.0, 2.5, 0.6])
    lift = generator.uniform(0.0, 1.4)
    rack = rnc.collision.Obstacle(coal.Box(*SIZE), position=RACK, name="rack")
    distances = rnc.collision.CollisionDistances(reduced.robot, [rack], rnc.collision.PairSelection(links=False))
    start = reduced.robot.configuration({"root_joint": begin})
    bounds = [SLOW, DistanceBound(distances, CLEARANCE)]
    options = {"bounds": bounds, "seed": number, "feedback": None, **options}
    return (*end, lift), rnc.optimal.plan(reduced, start, forklifts.goal_of(end, lift), 16.0, **options)


@pytest.mark.parametrize("number", [0, 1, *(pytest.param(k, marks=pytest.mark.long) for k in range(2, 8))])
def test_plans_round_a_rack_keep_goal_and_clearance_in_a_dense_replay(tmp_path, number):
    reduced = forklifts.forklift(tmp_path)
    (x, y, yaw, lift), plan = round_the_rack(reduced, number)
    assert (plan.info.outcome, plan.verdict.succeeded) == ("solved", True)
    q, w = forklifts.replay(plan, reduced.robot.model)
    end = np.array([q[-1, 0], q[-1, 1], np.arctan2(q[-1, 3], q[-1, 2]), q[-1, 4]])
    np.testing.assert_allclose(end, [x, y, yaw, lift], atol=5.1e-3)
    np.testing.assert_allclose(w, 0.0, atol=5.1e-3)
    assert forklifts.smallest_distance(q, RACK, SIZE) > CLEARANCE - 1e-4
    assert -5e-3 < q[:, 4].min() <= q[:, 4].max() < 1.4 + 5e-3


def test_a_plan_that_its_verification_does_not_confirm_is_refused_with_the_plan(tmp_path):
    """Eight intervals of 2 s cut the corners of the rack between their nodes."""
    reduced, few = forklifts.forklift(tmp_path), SolverSettings(nodes=8, refinements=0)
    with pytest.raises(rnc.InfeasibleError, match=r"no verified plan in 16 s: after re-integration, ") as refusal:
        round_the_rack(reduced, 0, settings=few, seeds=1)
    plan = refusal.value.plan
    assert "tried up to 8 intervals and" in str(refusal.value)
    assert (plan.info.outcome, plan.verdict.succeeded) == ("unverified", False)
    q, _ = forklifts.replay(plan, reduced.robot.model)
    kinds = {each.kind for each in plan.verdict.findings}
    assert kinds <= {FindingKind.GOAL, FindingKind.CLEARANCE, FindingKind.COLLISION}
    near = [each.amount for each in plan.verdict.findings if each.kind != FindingKind.GOAL]
    if near:
        assert max(near) == pytest.approx(CLEARANCE - forklifts.smallest_distance(q, RACK, SIZE), abs=2e-2)


def test_corners_between_nodes_are_kept_by_larger_distances_at_the_nodes_next_to_them(tmp_path):
    """Without refinements, the nodes next to a corner move away from it."""
    reduced = forklifts.forklift(tmp_path)
    _, plan = round_the_rack(reduced, 0, settings=SolverSettings(refinements=0))
    assert len(plan.u) == 40
    q, _ = forklifts.replay(plan, reduced.robot.model)
    assert forklifts.smallest_distance(q, RACK, SIZE) > CLEARANCE - 1e-4


def test_a_start_or_goal_beyond_a_bound_is_refused_at_once(tmp_path):
    reduced = forklifts.forklift(tmp_path)
    rack = rnc.collision.Obstacle(coal.Box(*SIZE), position=RACK, name="rack")
    distances = rnc.collision.CollisionDistances(reduced.robot, [rack], rnc.collision.PairSelection(links=False))
    start = reduced.robot.configuration({"root_joint": [0.0, -0.8, 0.0], "lift_joint": 0.5})  # the base is 5 cm away
    goal = forklifts.goal_of((0.0, -2.0, 0.0), 0.5)
    with pytest.raises(rnc.InfeasibleError, match=r"start: the distance of base and rack is 0\.05 m, below the clear"):
        rnc.optimal.plan(reduced, start, goal, 8.0, bounds=[DistanceBound(distances, CLEARANCE)])
    away = reduced.robot.configuration({"root_joint": [0.0, -2.0, 0.0], "lift_joint": 0.5})
    with pytest.raises(rnc.InfeasibleError, match=r"goal: the distance of base and rack is 0\.05 m, below the clear"):
        rnc.optimal.plan(reduced, away, start, 8.0, bounds=[DistanceBound(distances, CLEARANCE)])
    beside = OutputBound(rnc.FramePosition("base", "xy"), None, [9, -1])
    with pytest.raises(rnc.InfeasibleError, match=r"start: value of base_y = -0\.8 is above the limit -1 of its bound"):
        rnc.optimal.plan(reduced, start, goal, 8.0, bounds=[beside])


def test_an_unstable_motion_is_judged_with_the_feedback_of_the_run():
    """A trailer in reverse leaves its plan without feedback."""
    reduced, hitch = tractor(1), rnc.JointPosition("hitch_1")
    goal = {**systems.goal_of("tractor"), hitch: 0.0}
    start = reduced.robot.configuration({"root_joint": [4.0, 1.0, 0.2]})
    problem = {"bounds": [VelocityBound(-1.0, 1.0)], "settings": SolverSettings(refinements=0), "seeds": 0}
    plan = rnc.optimal.plan(reduced, start, goal, 16.0, **problem)
    alone, followed = plan.info.verification.inputs, plan.info.verification.feedback
    assert followed.violation <= plan.info.accuracy < alone.violation
    assert plan.info.outcome == "solved"
    (note,) = plan.verdict.findings
    assert (note.kind, note.severity, note.amount) == (FindingKind.PLAN, Severity.NOTE, alone.violation)
    run = rnc.simulate(reduced, rnc.tvlqr(reduced, plan), start, plan.duration, dt=0.01)
    np.testing.assert_allclose(run.q[-1, :2], [0.0, 0.0], atol=2 * plan.info.accuracy)
    with pytest.raises(rnc.InfeasibleError, match="no verified plan in 16 s: after re-integration, goal"):
        rnc.optimal.plan(reduced, start, goal, 16.0, feedback=None, guess=plan, **problem)


def test_as_many_guesses_are_solved_as_solutions_are_asked_for():
    """More than the random guesses that a single solution may try; the straight line leads to none."""
    reduced = systems.sleigh()
    start, goal = reduced.robot.configuration(), {rnc.FramePosition("sleigh", "xy"): [0.0, 1.0]}
    options = {"seeds": 2, "settings": SolverSettings(nodes=10, iterations=40, accuracy=0.5)}
    plans = [rnc.optimal.plan(reduced, start, goal, 4.0, solutions=n, **options) for n in (1, 10)]
    assert ([plan.info.solutions for plan in plans], plans[0].info.guesses) == ([1, 10], 2)
    assert (plans[1].info.guesses >= 11, plans[1].info.cost <= plans[0].info.cost) == (True, True)


def test_the_cheapest_of_a_few_guesses_is_the_usual_plan():
    """Parking of a car whose straight line leads to a plan that costs 30 % more than the best of 60 guesses."""
    reduced = car()
    goal = {rnc.FramePosition("rear_axle", "xy"): [-2.9008, 1.2531], rnc.FrameYaw("chassis"): 0.8255}
    bounds = [OutputBound(rnc.JointPosition("front_steering"), -0.6, 0.6), VelocityBound(-1.0, 1.0)]
    problem = {"bounds": bounds, "settings": SolverSettings(accuracy=1e-2, reserve=0.0), "feedback": None}
    usual, first = (
        rnc.optimal.plan(reduced, reduced.robot.configuration(), goal, 16.0, solutions=count, **problem)
        for count in (None, 1)
    )
    assert (first.info.guess, usual.info.guesses) == ("straight line", 5)
    assert usual.info.cost < 0.78 * first.info.cost
    ahead = {rnc.FramePosition("rear_axle", "xy"): [2.0, 0.0], rnc.FrameYaw("chassis"): 0.0}  # the rows allow the line
    plan = rnc.optimal.plan(reduced, reduced.robot.configuration(), ahead, 6.0, feedback=None)
    assert (plan.info.guess, plan.info.guesses) == ("straight line", 1)


def across(place):
    """A box on Mecanum wheels whose straight line leads along x, and a wall across x = 1.5."""
    reduced = systems.mecanum_box()
    wall = rnc.collision.Obstacle(coal.Box(0.4, 2.0, 2.0), position=(1.5, place, 0.0), name="wall")
    distances = rnc.collision.CollisionDistances(reduced.robot, [wall], rnc.collision.PairSelection(links=False))
    return reduced, distances, systems.goal_of("base", 3.0)


@pytest.mark.parametrize(("place", "names"), [(-0.3, ["left", "right"]), (0.3, ["right", "left"]), (4.0, [])])
def test_guesses_pass_a_wall_across_the_line_on_both_sides(place, names):
    reduced, distances, goal = across(place)
    model = action_model(reduced, "kinematic")
    start = initial_node(model, reduced.robot.configuration(), None)
    bounds = [DistanceBound(distances, CLEARANCE)]
    problem = build_problem(model, start, GoalRows(model, goal, True), 8.0, None, bounds, 40, None)
    found = list(guesses(problem, goal, None, 3, 0))
    expected = ["straight line", *(f"{side} of wall" for side in names)]
    assert [name for name, _ in found] == [*expected, *(f"random {k + 1}" for k in range(3 - len(names)))]
    for name, motion in found[1 : len(expected)]:
        np.testing.assert_allclose(motion.q[[0, -1], :2], [[0.0, 0.0], [3.0, 0.0]], atol=1e-6)
        beside = motion.q[np.abs(motion.q[:, 0] - 1.5) < 0.2, 1]
        assert len(beside)
        assert ((beside > place + 1.0) if name.startswith("left") else (beside < place - 1.0)).all()
        assert min(distances.at(q, 0.0).distance.min(initial=np.inf) for q in motion.q) > 0.0


@pytest.fixture
def iterations(monkeypatch):
    """Numbers of intervals of all iterations."""
    found, iterate = [], SequentialQuadratic.iterate

    def counted(self, at, *options):
        found.append(self.problem.K)
        return iterate(self, at, *options)

    monkeypatch.setattr(SequentialQuadratic, "iterate", counted)
    return found


ASIDE = systems.goal_of("sleigh", 1.0, 0.5, 0.5)


def test_improvements_end_after_twice_the_iterations_of_a_guess_and_the_message_says_so(iterations):
    """An accuracy that no number of intervals reaches."""
    reduced = systems.sleigh()
    hopeless = SolverSettings(nodes=5, iterations=8, refinements=4, accuracy=1e-12)
    with pytest.raises(rnc.InfeasibleError, match=r"tried up to 20 .* allow more iterations \(improvements took all"):
        rnc.optimal.plan(reduced, reduced.robot.configuration(), ASIDE, 2.0, seeds=0, settings=hopeless)
    assert iterations.count(5) <= 8
    assert sum(K / 5 for K in iterations if K > 5) <= 16
    assert max(iterations) < 80


def test_a_solution_that_several_guesses_share_is_improved_once(iterations):
    reduced = systems.sleigh()
    hopeless = SolverSettings(nodes=5, refinements=1, accuracy=1e-12, cost_tolerance=1e-9)
    counts = []
    for seeds in (0, 3):
        iterations.clear()
        with pytest.raises(rnc.InfeasibleError, match="different: 1"):
            rnc.optimal.plan(reduced, reduced.robot.configuration(), ASIDE, 2.0, seeds=seeds, settings=hopeless)
        counts.append((iterations.count(5), iterations.count(10)))
    (once, finer), (each, shared) = counts
    assert each > 3 * once > 0
    assert shared == finer > 0


def test_fewer_solutions_than_asked_for_are_told():
    reduced = systems.sleigh()
    start, goal = reduced.robot.configuration(), {rnc.FramePosition("sleigh", "xy"): [0.0, 1.0]}
    hasty = SolverSettings(nodes=10, iterations=7, accuracy=0.5)
    with pytest.warns(rnc.ModelWarning, match=r"plan: (\d+) solutions instead of 12: the other \d+ of 12 guesses"):
        plan = rnc.optimal.plan(reduced, start, goal, 4.0, solutions=12, seeds=0, settings=hasty)
    assert plan.info.solutions < plan.info.guesses == 12


def test_a_refusal_carries_the_best_motion_even_if_no_guess_is_within_tolerance():
    reduced = systems.sleigh()
    far = {rnc.FramePosition("sleigh", "xy"): [5.0, 0.0]}
    settings = SolverSettings(nodes=10, iterations=30)
    row = r"no plan in 1 s: .*(sleigh_x|sleigh_speed_x).* violated by"
    options = {"bounds": [VelocityBound(-1, 1)], "seeds": 0, "settings": settings}
    with pytest.raises(rnc.InfeasibleError, match=row) as refusal:
        rnc.optimal.plan(reduced, reduced.robot.configuration(), far, 1.0, **options)
    assert (refusal.value.plan.info.outcome, refusal.value.plan.verdict.succeeded) == ("unverified", False)
