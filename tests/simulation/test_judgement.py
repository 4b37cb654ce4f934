"""Each finding has a run in which it is true, and one beside it in which it is not."""

from dataclasses import replace

import numpy as np
import pytest

import rnc_pin as rnc
import systems
from driven_bases import KINDS, RADIUS, drafted_model
from rnc_pin.collision import OmittedPair
from rnc_pin.simulation import Clearance, LimitReplay, distance_findings, sampled_run
from rnc_pin.verdict import FindingKind, Severity
from simple_controllers import Idle, Inputs
from urdf_parts import joint, link, read


def sliders(tmp_path, first, second):
    parts = [link("base"), link("a"), link("b")]
    for name, limit in {"a": first, "b": second}.items():
        slide = joint(name, "base", name, axis="1 0 0", kind="prismatic", effort=None)
        parts.append(slide.replace("</joint>", f"<limit {limit}/></joint>"))
    return read(tmp_path / "sliders.urdf", *parts)


def pushed(robot, T, duration=1.0, **options):
    """Run under constant forces: x = T t^2 / 2 for a mass of 1 kg."""
    reduced = rnc.NonholonomicSystem(robot, [], list(robot.joint_names)).reduce()
    controller = Inputs(lambda t: T)
    plant = rnc.ReducedPlant(reduced, actuator_limits=False)
    return rnc.simulate(reduced, controller, robot.configuration(), duration, 0.01, plant=plant, **options)


def kinds(verdict):
    return [(each.kind, each.where) for each in verdict.findings]


WIDE = 'lower="-9" upper="9" velocity="9" effort="9"'


@pytest.mark.parametrize(("limit", "kind", "amount", "time"), [
    ('lower="-9" upper="0.3" velocity="9" effort="9"', FindingKind.POSITION, 0.2, 1.0),  # x = 0.5 at 1 s
    ('lower="0.2" upper="9" velocity="9" effort="9"', FindingKind.POSITION, 0.2, 0.0),  # x = 0 at the start
    ('lower="-9" upper="9" velocity="0.6" effort="9"', FindingKind.VELOCITY, 0.4, 1.0),  # 1 m/s at 1 s
    ('lower="-9" upper="9" velocity="9" effort="0.75"', FindingKind.EFFORT, 0.25, 0.0),
])  # fmt: skip
def test_what_exceeds_a_limit_of_the_file_fails(tmp_path, limit, kind, amount, time):
    (found,) = pushed(sliders(tmp_path, limit, WIDE), [1.0, 1.0]).verdict.findings
    assert (found.kind, found.where, found.severity) == (kind, "a", Severity.FAILS)
    assert (found.amount, found.time) == (pytest.approx(amount, abs=1e-9), pytest.approx(time))


@pytest.mark.parametrize(("mass", "word"), [(1.0, "succeeded"), (0.8, "failed")])
def test_accelerations_above_the_limit_of_a_program_fail(tmp_path, mass, word):
    robot = sliders(tmp_path, WIDE, WIDE)
    reduced = rnc.NonholonomicSystem(robot, [], list(robot.joint_names)).reduce()
    lighter = rnc.Robot.from_urdf(tmp_path / "sliders.urdf")
    for body in lighter.model.inertias:
        body.mass *= mass
    plant = rnc.ReducedPlant(rnc.NonholonomicSystem(lighter, [], list(robot.joint_names)).reduce())
    reach = rnc.control.tasks.PostureTask({"a": 1.0}, gain=1.0)
    limit = rnc.control.limits.AccelerationLimit(0.5, joints=["a"])
    program = rnc.control.InverseDynamicsQP(reduced, [reach], [limit], dt=0.01)
    run = rnc.simulate(reduced, program, robot.configuration(), 6.0, 0.01, plant=plant)
    assert run.verdict.word == word
    if word == "failed":
        (found,) = run.verdict.failures
        assert (found.kind, found.where) == (FindingKind.ACCELERATION, "a")
        assert found.amount == pytest.approx(0.5 / mass - 0.5, rel=0.01)


def test_an_effort_of_zero_is_a_limit_where_the_file_states_others(tmp_path):
    none = 'lower="-9" upper="9" velocity="9" effort="0"'
    (found,) = pushed(sliders(tmp_path, none, WIDE), [8.7, 1.0]).verdict.findings
    assert (found.kind, found.where, found.amount) == (FindingKind.EFFORT, "a", pytest.approx(8.7))
    assert pushed(sliders(tmp_path, none, WIDE), [0.0, 1.0]).verdict.findings == ()
    assert pushed(sliders(tmp_path, none, none), [8.7, 1.0]).verdict.findings == ()  # zeros are placeholders


@pytest.mark.parametrize(("limit", "word"), [(2.5, "succeeded"), (1.5, "failed")])
def test_limits_of_forces_on_frames_are_judged(limit, word):
    reduced = systems.sleigh(limit)
    run = rnc.simulate(reduced, Inputs(lambda t: [2.0 * t, 0.3]), reduced.robot.configuration(), 1.0, 0.01)
    assert run.verdict.word == word
    if word == "failed":
        (found,) = run.verdict.findings
        assert (found.kind, found.where) == (FindingKind.EFFORT, "force(sleigh.x)")
        assert found.amount == pytest.approx(2.0 - limit, abs=0.021)


def test_an_actuator_at_its_limit_for_long_degrades(tmp_path):
    verdict = pushed(sliders(tmp_path, 'lower="-9" upper="9" velocity="9" effort="1"', WIDE), [1.0, 1.0]).verdict
    assert (verdict.word, kinds(verdict)) == ("degraded", [(FindingKind.SATURATION, "a")])


def alternating(size, start, stop, N=101):
    """Signal (N,) that jumps between two values of this distance at each sample of a stretch, else zero."""
    values = np.zeros(N)
    values[start:stop] = 0.5 * size * (-1.0) ** np.arange(stop - start)
    return values


def with_signals(run, robot, **signals):
    """Verdict of a run with other signals of joint b, whose limits are 9."""
    arrays = {name: np.column_stack([np.zeros_like(values), 9.0 * values]) for name, values in signals.items()}
    changed = replace(run, **arrays)
    return rnc.simulation.judge(changed, rnc.simulation.replay_limits(robot, changed))


@pytest.mark.parametrize(("size", "samples", "word"), [
    (0.04, 101, "succeeded"),  # noise of two per cent of the limit
    (0.06, 101, "degraded"), (0.4, 101, "degraded"), (2.0, 101, "failed"),
    (2.0, 3, "succeeded"), (2.0, 6, "degraded"),  # at a start or a switch
])  # fmt: skip
@pytest.mark.parametrize("signal", ["T", "v"])
def test_inputs_and_velocities_that_alternate_degrade_or_fail(tmp_path, signal, size, samples, word):
    robot = sliders(tmp_path, WIDE, WIDE)
    verdict = with_signals(pushed(robot, [0.0, 0.0]), robot, **{signal: alternating(size, 0, samples)})
    found = [each for each in verdict.findings if each.kind is FindingKind.REVERSAL]
    assert (verdict.word, len(found)) == (word, word != "succeeded")
    for each in found:
        assert (each.where, each.time) == ("b", 0.0)
        assert each.amount == pytest.approx(size)


def plain_share(values):
    """Share of samples that begin four changes of alternating sign, each above 5 %, one sample after another."""
    count = 0
    for k in range(len(values) - 4):
        changes = [values[k + j + 1] - values[k + j] for j in range(4)]
        signs = [change > 0 for change in changes]
        count += all(abs(change) > 0.05 for change in changes) and signs in ([True, False] * 2, [False, True] * 2)
    return count / len(values)


def test_the_share_of_reversals_is_that_of_a_plain_count_and_violent_noise_fails(tmp_path):
    robot = sliders(tmp_path, WIDE, WIDE)
    run, rng = pushed(robot, [0.0, 0.0]), np.random.default_rng(4)
    for spread, words in ((0.02, {"succeeded"}), (0.1, {"degraded"}), (1.0, {"degraded", "failed"})):
        values = np.clip(spread * rng.normal(size=101), -1.0, 1.0)
        verdict = with_signals(run, robot, T=values)
        found = [each for each in verdict.findings if each.kind is FindingKind.REVERSAL]
        share = f"in {100 * plain_share(values):.3g} % of the samples"
        assert verdict.word in words
        assert [share in str(each) for each in found] == [True] * len(found)
        assert len(found) == (plain_share(values) > 0.01)


def test_reversals_need_limits_samples_and_numbers(tmp_path):
    none, chatter = 'lower="-9" upper="9" velocity="0" effort="0"', alternating(2.0, 0, 101)
    robot, unlimited = sliders(tmp_path, WIDE, WIDE), sliders(tmp_path, none, none)
    run = pushed(robot, [0.0, 0.0])
    assert with_signals(run, unlimited, T=chatter, v=chatter).succeeded
    for count in (2, 3, 4):
        short = pushed(robot, [0.0, 0.0], 0.01 * (count - 1))
        assert with_signals(short, robot, T=0.9 * chatter[:count]).findings == ()
    chatter[50] = np.inf
    found = [each.kind for each in with_signals(run, robot, T=chatter).findings]
    assert FindingKind.REVERSAL in found


def test_late_samples_are_a_note_beside_the_findings_and_equal_runs_stay_equal(tmp_path, monkeypatch):
    reduced, clock = systems.sleigh(), [0.0]
    monkeypatch.setattr(sampled_run, "thread_time", lambda: clock[0])
    monkeypatch.setattr(sampled_run, "perf_counter", lambda: 10.0 * clock[0])  # of a busy computer

    def run(slow):
        def push(t):
            clock[0] += slow.get(round(100 * t), 0.002)
            return [0.0, 0.0]

        return rnc.simulate(reduced, Inputs(push), reduced.robot.configuration(), 0.49, 0.01)

    late, quick = run({3: 0.02, 7: 0.03}), run({})
    note = late.verdict.late
    assert (note.kind, note.severity, note.amount, note.time) == (FindingKind.LATE, Severity.NOTE, 2 / 50, 0.03)
    assert "2 steps (4 %)" in str(note)
    assert "30 ms" in str(note)
    assert quick.verdict.late is None
    assert (late.verdict, late.verdict.word, str(late.verdict)) == (quick.verdict, "succeeded", str(quick.verdict))
    assert (late.meta, repr(late.info), late.info) == (quick.meta, repr(quick.info), quick.info)
    late.save(tmp_path / "run.npz")
    assert rnc.Trajectory.load(tmp_path / "run.npz").verdict.late is None
    for computing_time in (None, 1.0):
        summary = rnc.summarize(late, computing_time)
        rnc.simulation.add_verdict(summary, late.verdict)
        assert ("late" in summary, summary["findings"]) == (computing_time is not None, [])


def bent(reduced):
    return reduced.robot.configuration({"joint_1": -0.4, "joint_2": 1.8, "joint_3": -1.1})


class Blind:
    """Plant whose sensors give no numbers after some readings, until others; a run reads once before its samples."""

    def __init__(self, reduced, first, last=np.inf):
        self._plant = plant = rnc.ReducedPlant(reduced)
        self.reset, self.apply, self.advance = plant.reset, plant.apply, plant.advance  # those of every plant
        self._count, self.blind = 0, lambda count: first < count <= last

    def __getattr__(self, name):
        return getattr(self._plant, name)

    def read(self):
        self._count += 1
        q, v = self._plant.read()
        return (np.nan * q, v) if self.blind(self._count) else (q, v)

    def report(self):
        return self._plant.report()._replace(actual=self._plant.read())


@pytest.mark.parametrize(("first", "last", "word", "samples"), [
    (0, np.inf, "failed", 21), (19, np.inf, "failed", 3), (5, 7, "degraded", 2), (22, np.inf, "succeeded", 0),
])  # fmt: skip
def test_fallback_commands_fail_if_they_last_to_the_end_or_for_most_of_the_run(first, last, word, samples):
    reduced = systems.space_robot()
    run = rnc.simulate(reduced, Idle(3), bent(reduced), 0.2, 0.01, plant=Blind(reduced, first, last))
    assert run.outcome is rnc.Outcome.COMPLETED
    assert run.verdict.word == word
    assert [each.kind for each in run.verdict.findings] == [FindingKind.FALLBACK] * bool(samples)
    assert (run.info.fallback.samples if samples else 0) == samples
    if samples:
        assert "q[0] is not finite" in str(run.verdict.first)


@pytest.mark.parametrize(("share", "word"), [(0.3, "degraded"), (0.8, "failed")])
def test_single_invalid_samples_are_no_end(share, word):
    reduced = systems.space_robot()
    garbage = np.random.default_rng(3).random(101) < share
    garbage[-1] = True
    plant = Blind(reduced, 0)
    plant.blind = lambda count: garbage[count - 2] if count > 1 else False
    run = rnc.simulate(reduced, Idle(3), bent(reduced), 1.0, 0.01, plant=plant)
    assert (run.info.fallback.samples, run.verdict.word) == (garbage.sum(), word)


def test_a_run_whose_first_samples_are_lost_still_knows_its_goals():
    reduced = systems.space_robot()
    target = rnc.control.ReducingOutputController(reduced, rnc.planning.Hold(reduced.at(bent(reduced)).outputs()[1]))
    controller, plant = rnc.control.ComputedTorque(reduced, target), Blind(reduced, 0, 4)
    figures = rnc.summarize(rnc.simulate(reduced, controller, bent(reduced), 0.2, 0.01, plant=plant))
    assert set(figures["final_error"]) == set(reduced.reducing.names)
    for kind in ("final_error", "max_error", "rms_error"):
        assert np.isfinite(list(figures[kind].values())).all()


def test_goals_that_are_missed_or_not_a_number_fail():
    reduced = systems.space_robot()
    run = rnc.free_motion(reduced, bent(reduced), np.zeros(3), duration=0.1)
    verdict = rnc.simulation.judge(run, goal_errors={"near": 0.019, "far": 0.021, "lost": np.nan})
    assert kinds(verdict) == [(FindingKind.GOAL, "far"), (FindingKind.GOAL, "lost")]
    assert rnc.simulation.judge(run, goal_errors={"far": 0.021}, goal_tolerance=0.03).succeeded
    assert rnc.simulation.judge(run, goal_errors={"far": 0.021}, accepted=["goal"]).word == "degraded"


def test_a_run_that_ends_early_fails_and_its_goals_are_not_judged():
    reduced = systems.space_robot()
    fast = rnc.SimulationOptions(rnc.Stop(speed=2.0))
    with pytest.raises(rnc.DivergenceError) as caught:
        rnc.free_motion(reduced, bent(reduced), np.full(3, 5.0), duration=1.0, options=fast)
    verdict = rnc.simulation.judge(caught.value.trajectory, goal_errors={"far": 1.0})
    assert [each.kind for each in verdict.findings] == [FindingKind.ENDED_EARLY]
    assert str(verdict.first) == str(caught.value)


def test_a_verdict_stays_with_the_file_of_its_run(tmp_path):
    limit = 'lower="-9" upper="0.3" velocity="9" effort="9"'
    run = pushed(sliders(tmp_path, limit, WIDE), [1.0, 1.0])
    replace(run, grounds=None).save(tmp_path / "samples.npz")  # samples of a run, which nothing can judge
    with pytest.raises(rnc.ConfigurationError, match="saved before it was judged"):
        _ = rnc.Trajectory.load(tmp_path / "samples.npz").verdict
    run.save(tmp_path / "run.npz")
    assert rnc.Trajectory.load(tmp_path / "run.npz").verdict == run.verdict
    assert not run.verdict.succeeded
    replace(run, q=np.full_like(run.q, np.nan)).save(tmp_path / "unknown.npz")
    with np.load(tmp_path / "unknown.npz") as file:
        assert np.isnan(file["q"]).all()


def replay_of(*clearances, omitted=()):
    return LimitReplay((), clearances, omitted, np.array([0.0, 1.0]), np.zeros((2, 0)), 0.2, 1e-3)


def test_thresholds():
    touching = Clearance(("a", "b"), -0.9e-6, 0.5, True)
    deep = Clearance(("a", "b"), -1.1e-6, 0.5, True)
    assert distance_findings(replay_of(touching)) == []
    (found,) = distance_findings(replay_of(deep))
    assert (found.kind, found.severity, found.amount, found.time) == ("collision", "fails", 1.1e-6, 0.5)
    near, nearer = (Clearance(("a", "b"), 0.1 - short, 0.5, True) for short in (0.9e-4, 1.1e-4))
    assert distance_findings(replay_of(near), 0.1) == []
    (found,) = distance_findings(replay_of(nearer), 0.1)
    assert (found.kind, found.severity) == ("clearance", "fails")
    assert (found.amount, distance_findings(replay_of(nearer))) == (pytest.approx(1.1e-4), [])


def test_a_pair_has_one_finding_with_its_deepest_value():
    both = [Clearance(("base", "rack"), distance, t, True) for distance, t in ((-0.2, 1.0), (-0.1, 2.0))]
    (found,) = distance_findings(replay_of(*both, Clearance(("base", "rack"), 0.01, 0.0, True)), 0.1)
    assert (found.amount, found.time, found.where, found.unit) == (0.2, 1.0, "base / rack", "m")


def test_a_wheel_on_the_floor_is_told_how_it_may_touch():
    (found,) = distance_findings(replay_of(Clearance(("wheel", "floor"), -1e-11, 0.0, True)), clearance=0.02)
    assert found.message == (
        "wheel touches floor at t = 0 s, 0.02 m was asked for; links that may touch it belong in the ignored_links "
        "of floor"
    )
    (near,) = distance_findings(replay_of(Clearance(("wheel", "floor"), 1e-3, 0.0, True)), clearance=0.02)
    assert "ignored_links" not in near.message


def test_links_of_the_robot_have_no_clearance_but_may_not_collide():
    wrist = Clearance(("arm_5", "tool"), 0.004, 1.0, False)
    assert distance_findings(replay_of(wrist), 0.1) == []
    (found,) = distance_findings(replay_of(wrist._replace(distance=-0.004)), 0.1)
    assert found.kind is FindingKind.COLLISION


def test_overlaps_at_the_start_are_notes_and_fast_motions_degrade():
    omitted = (OmittedPair(("torso", "arm_1"), "overlap by 0.0115 m at the reference configuration", 0.0115),)
    fast = Clearance(("arm", "wall"), 0.15, 1.0, True, False, True)
    found = distance_findings(replay_of(fast, omitted=omitted))
    assert [each.severity for each in found] == [Severity.DEGRADES, Severity.NOTE]
    assert str(found[1]) == "torso and arm_1 overlap by 0.0115 m at the start: they are not checked"
    assert "arm / wall is not certain" in str(found[0])


def test_a_clearance_that_the_replay_cannot_know_is_refused():
    with pytest.raises(rnc.InputError, match=r"clearance is 0.3 m, but the replay knows distances up to 0.2 m"):
        distance_findings(replay_of(), 0.3)


@pytest.mark.parametrize(("angle", "severity"), [(0.0, None), (0.025, Severity.DEGRADES), (0.3, Severity.FAILS)])
def test_a_steered_wheel_without_a_lateral_row_that_is_not_aimed_slides(angle, severity):
    """At v along x it slides with v sin(angle); 1 s at 0.5 m/s."""
    reduced = drafted_model(KINDS["four steered drives"])
    q = reduced.robot.configuration({"turn_w1_joint": angle})  # w0 and w3 have the lateral rows
    rates = 0.5 / RADIUS * (np.array(reduced.reducing.names) == "w0_joint")
    run = rnc.free_motion(reduced, q, rates, duration=1.0)
    slides = [each for each in run.verdict.findings if each.kind is FindingKind.SLIP]
    assert [(each.where, each.severity) for each in slides] == ([("w1", severity)] if severity else [])
    for each in slides:
        assert each.amount == pytest.approx(0.5 * np.sin(angle), rel=0.02)


@pytest.mark.parametrize(("system", "units"), [
    (systems.space_robot, ["N m s"]), (systems.fire_truck, ["m/s"] * 3),
    (systems.free_flying_panda, ["kg m/s"] * 3 + ["N m s"] * 3),
])  # fmt: skip
def test_a_row_slips_in_its_own_unit(system, units):
    reduced = system()
    bent = reduced.robot.configuration({reduced.robot.joint_names[-1]: 0.5, reduced.robot.joint_names[-2]: 0.5})
    run = rnc.free_motion(reduced, bent, np.zeros(reduced.r), duration=0.1)
    slipping = replace(run, slip=np.full_like(run.multipliers, 0.05))
    found = [each for each in rnc.simulation.judge(slipping).findings if each.kind is FindingKind.SLIP]
    assert [each.unit for each in found] == units
    assert f"slips by up to 0.05 {units[0]}, at" in str(found[0])
