"""A controller in a loop that somebody else runs: what it keeps, what it refuses, what it does after a fault."""

import re

import numpy as np
import pytest

import rnc_pin as rnc
import systems
from rnc_pin.control import Command
from rnc_pin.control.loop import control_loop, loop_state
from rnc_pin.control.loop.control_loop import VelocityObserver
from rnc_pin.control.loop.loop_state import VelocityEstimate, write_state
from rnc_pin.motion import optimal
from rnc_pin.motion.optimal import SetPointController, predictive_control, set_point_controller
from rnc_pin.plants import ReducedPlant
from simple_controllers import Memoryless

DT = 0.01
GOAL = np.array([1.0, 0.5])


def sleigh():
    """A sleigh with a thruster and a flywheel, on its way to a place along its nose and to a heading."""
    reduced = systems.sleigh()
    way = rnc.planning.MinimumJerk(np.zeros(2), GOAL, duration=1.0)
    target = rnc.control.ReducingOutputController(reduced, way)
    return reduced, rnc.control.VelocityTracker(target, rnc.control.VelocityGains(k=20.0, beta=20.0))


def drive(loop, plant, times, spoil=lambda sample, q, v: (q, v)):
    """Inputs of a loop around a plant, (N, p)."""
    inputs = []
    for sample, t in enumerate(times):
        T = loop.step(t, *spoil(sample, *plant.read()))
        plant.apply(T)
        plant.advance(DT)
        inputs.append(T)
    return np.array(inputs)


def started(reduced):
    plant = ReducedPlant(reduced)
    plant.reset(reduced.robot.configuration(), np.zeros(reduced.n))
    return plant


def slow(monkeypatch, *spent):
    """Controller whose steps take these times of the wall clock [s]."""
    clock, rest = [0.0], list(spent)
    monkeypatch.setattr(control_loop, "perf_counter", lambda: clock[0])

    def law(t, measurement):
        clock[0] += rest.pop(0)
        return Command(T=np.zeros(2))

    return Memoryless(law)


SEARCHING = {
    "nearer_plan": (set_point_controller, lambda *of, **options: SetPointController(*of, 3.0, **options)),
    "first_motion": (predictive_control, lambda reduced, goal, **options: optimal.PredictiveController(
        reduced, [optimal.EffortCost()], 3.0, goal=goal, **options)),
}  # fmt: skip


@pytest.mark.parametrize("name", SEARCHING)
def test_a_prepared_loop_has_searched_before_its_first_step(name, monkeypatch):
    """Its inputs are those of a loop that was not prepared, whose first step searches."""
    reduced, (module, make), searches = systems.sleigh(), SEARCHING[name], []
    goal = systems.goal_of("sleigh", 1.0)
    q, search = reduced.robot.configuration(), getattr(module, name)
    monkeypatch.setattr(module, name, lambda *each: searches.append(each) or search(*each))
    loops = [rnc.ControlLoop(reduced, make(reduced, goal, form="dynamic", nodes=15), DT) for _ in range(2)]
    loops[0].prepare(q)
    inputs = loops[0].step(5.0, q, np.zeros(3))
    assert len(searches) == 1
    np.testing.assert_array_equal(inputs, loops[1].step(5.0, q, np.zeros(3)))
    assert np.abs(inputs).max() > 0.0


def test_steps_that_are_late_by_the_wall_clock_are_counted_in_the_state(tmp_path, monkeypatch):
    reduced, _ = sleigh()
    controller = slow(monkeypatch, 0.0, 0.3, 0.1, 0.4, 0.0, 0.0)
    loop = rnc.ControlLoop(reduced, controller, DT, deadline=0.2)
    drive(loop, started(reduced), DT * np.arange(5))
    late = loop.state.late
    assert (late.ticks, late.late, late.first) == (5, 2, DT)
    assert late.largest == pytest.approx(0.4)
    assert "2 steps (40 %)" in str(late)
    loop.save(tmp_path / "state.npz")
    after = rnc.ControlLoop(reduced, controller, DT, deadline=0.2)
    after.load(tmp_path / "state.npz")
    assert after.state.late == late


def test_a_loop_without_a_deadline_has_a_state_that_depends_on_no_clock(monkeypatch):
    reduced, _ = sleigh()
    loop = rnc.ControlLoop(reduced, slow(monkeypatch, 9.0), DT)
    drive(loop, started(reduced), [0.0])
    assert loop.state.late is None
    with pytest.raises(rnc.ConfigurationError, match="deadline"):
        rnc.ControlLoop(reduced, Memoryless(None), DT, deadline=0.0)


def test_it_does_what_a_simulation_does():
    reduced, tracker = sleigh()
    run = rnc.simulate(reduced, tracker, reduced.robot.configuration(), 1.5, DT)
    inputs = drive(rnc.ControlLoop(reduced, tracker, DT), started(reduced), run.time)
    assert np.abs(inputs - run.T).max() < 1e-3 * np.abs(run.T).max()  # its integrals are trapezoidal
    assert np.abs(run.x2[-1] - GOAL).max() < 0.02


def test_time_may_begin_anywhere():
    reduced, tracker = sleigh()
    times = DT * np.arange(50)
    early = drive(rnc.ControlLoop(reduced, tracker, DT), started(reduced), times)
    late = drive(rnc.ControlLoop(reduced, tracker, DT), started(reduced), 1.7e9 + times)
    assert np.abs(late - early).max() < 1e-4 * np.abs(early).max()  # clocks count in 2e-7 s there


@pytest.mark.parametrize("through", ["memory", "file"])
def test_it_resumes_to_the_bit(tmp_path, through):
    reduced, tracker = sleigh()
    times = DT * np.arange(60)
    plant, loop = started(reduced), rnc.ControlLoop(reduced, tracker, DT, velocity="observer")
    drive(loop, plant, times[:30])
    other = rnc.ControlLoop(reduced, tracker, DT, velocity="observer")
    if through == "file":
        loop.save(tmp_path / "loop.npz")
        other.load(tmp_path / "loop.npz")
    else:
        other.resume(loop.state)
    q, v = plant.read()
    twin = ReducedPlant(reduced)
    twin.reset(q, v)
    plant.reset(q, v)
    plant.apply(loop.state.T)
    twin.apply(loop.state.T)
    assert np.array_equal(drive(loop, plant, times[30:]), drive(other, twin, times[30:]))


def test_a_state_of_another_controller_or_beyond_its_largest_size_is_refused(tmp_path, monkeypatch):
    reduced, tracker = sleigh()
    loop = rnc.ControlLoop(reduced, tracker, DT)
    drive(loop, started(reduced), [0.0, DT])
    loop.save(tmp_path / "loop.npz")
    other = rnc.ControlLoop(reduced, rnc.control.ComputedTorque(reduced, tracker.target), DT)
    with pytest.raises(rnc.ConfigurationError, match="another controller: it holds a 'TrackerState'"):
        other.load(tmp_path / "loop.npz")
    (tmp_path / "text.npz").write_text("no state")
    with pytest.raises(rnc.ConfigurationError, match=r"text\.npz: not the state of a loop"):
        loop.load(tmp_path / "text.npz")
    with pytest.raises(rnc.ConfigurationError, match=r"no file '.*gone\.npz'"):
        loop.load(tmp_path / "gone.npz")
    monkeypatch.setattr(loop_state, "_MOST_BYTES", 100)
    with pytest.raises(rnc.ConfigurationError, match=r"loop\.npz: not the state of a loop: arrays take more"):
        loop.load(tmp_path / "loop.npz")


def limited(effort=3.0):
    """The sleigh with actuators that have limits, under way in a loop."""
    return systems.sleigh(effort, effort), sleigh()[1]


def saved(loop, path, **changed):
    """The state of a loop as a file, with some of it changed."""
    write_state(loop.state._replace(**changed), path)
    return path


def changed_tracker(**fields):
    return lambda state: {"controller": state.controller._replace(**fields)}


FOREIGN = {
    "T that is no number": (lambda state: {"T": np.full(2, np.nan)}, "T is not finite"),
    "T without bound": (lambda state: {"T": np.array([0.0, 1e300])}, r"T is not finite, or beyond 1e\+15"),
    "T of text": (lambda state: {"T": "full speed"}, "T is a str, expected a ndarray"),
    "T of another size": (lambda state: {"T": np.zeros(3)}, r"T has shape \(3,\), expected \(2,\)"),
    "one T": (lambda state: {"T": 1.0}, r"T has shape \(\), expected \(2,\)"),
    "text as time": (lambda state: {"time": "noon"}, "time is a str, expected a float"),
    "no time": (lambda state: {"time": np.nan}, "time is not finite"),
    "an endless number": (lambda state: {"begin": 10**400}, "begin is not finite"),
    "truth as time": (lambda state: {"invalid_since": True}, "invalid_since is True, expected a float"),
    "no configuration": (lambda state: {"q": np.array([0.0, 0.0, 3.0, 4.0])}, "not of unit length"),
    "a longer configuration": (lambda state: {"q": np.zeros(5)}, r"q has shape \(5,\)"),
    "a block of velocities": (lambda state: {"v2": np.zeros((2, 2))}, r"v2 has shape \(2, 2\), expected \(2,\)"),
    "integrals": (lambda state: {"integrals": np.array([np.inf, 0.0])}, "integrals is not finite"),
    "input deficit": (lambda state: {"input_deficit": np.zeros(1)}, r"input_deficit has shape \(1,\)"),
    "an estimate": (lambda state: {"motion": VelocityEstimate(state.q, np.zeros(2), np.zeros(3))}, r"motion\.v has"),
    "no estimate": (lambda state: {"motion": (1.0,)}, "motion is a tuple, expected a VelocityEstimate"),
    "a reason": (lambda state: {"fault": 3}, "fault is a number or an array, expected a str"),
    "failure": (lambda state: {"failed": "perhaps"}, "failed is a str, expected a bool"),
    "gains of NaN": (changed_tracker(learnt=np.full((2, 7), np.nan)), "not finite"),
    "gains of another size": (changed_tracker(learnt=np.zeros((2, 3))), "the controller raises ValueError"),
    "gains that fit by chance": (changed_tracker(learnt=np.zeros((1, 7))), r"shape \(1, 7\), expected \(2, 7\)"),
    "gains of text": (changed_tracker(learnt="much"), "the controller raises"),
    "the controller's time as text": (changed_tracker(time="noon"), "the controller raises TypeError"),
    "a time to come": (changed_tracker(time=1e9), "time runs backwards"),
    "no memory": (lambda state: {"controller": None}, "the controller raises AttributeError"),
    "a memory that is one number": (lambda state: {"controller": 1.0}, "the controller raises AttributeError"),
}  # fmt: skip


@pytest.mark.parametrize("what", FOREIGN)
def test_a_state_that_no_loop_has_is_refused_and_changes_nothing(what, tmp_path):
    change, reason = FOREIGN[what]
    reduced, tracker = limited()
    loop, plant = rnc.ControlLoop(reduced, tracker, DT), started(reduced)
    drive(loop, plant, DT * np.arange(3))
    path, before = saved(loop, tmp_path / "loop.npz", **change(loop.state)), loop.state
    with pytest.raises(rnc.ConfigurationError, match=reason) as caught:
        loop.load(path)
    assert str(caught.value).startswith(str(path))
    assert loop.state is before
    if "controller" not in change(loop.state):
        with pytest.raises(rnc.InputError, match=reason):
            loop.resume(loop.state._replace(**change(loop.state)))


def test_nothing_beyond_the_limits_leaves_a_loop_that_was_loaded(tmp_path):
    """A file's inputs are held when the next sample is bad: they are clipped, as is every safe command."""
    reduced, tracker = limited(effort=3.0)
    for limits in (True, False, np.array([2.0, 1.0])):
        largest = limits if isinstance(limits, np.ndarray) else np.full(2, 3.0)
        loop = rnc.ControlLoop(reduced, tracker, DT, limits=limits, timeout=2 * DT)
        plant = started(reduced)
        drive(loop, plant, DT * np.arange(3))
        loop.load(saved(loop, tmp_path / "loop.npz", T=np.array([500.0, -1e9]), input_deficit=None))
        assert np.array_equal(loop.state.T, largest * [1, -1])
        assert np.array_equal(loop.state.input_deficit, [500.0 - largest[0], -1e9 + largest[1]])
        for sample in range(3, 9):  # held, then safe
            assert np.array_equal(loop.step(sample * DT, np.full(4, np.nan), np.zeros(3)), largest * [1, -1])
        loop.step(9 * DT, *plant.read())
        loop.report_applied_input(np.array([40.0, 40.0]))  # held inputs stay within the limits
        assert np.array_equal(loop.step(10 * DT, np.full(4, np.nan), np.zeros(3)), largest)


def test_what_acted_has_a_size_and_is_finite():
    reduced, tracker = sleigh()
    loop, plant = rnc.ControlLoop(reduced, tracker, DT), started(reduced)
    drive(loop, plant, [0.0])
    for T in (np.zeros(3), np.array([np.nan, 0.0]), np.zeros((2, 2))):
        with pytest.raises(rnc.InputError, match="T h"):
            loop.report_applied_input(T)


class Diary:
    """A controller of somebody else's, whose memory grows: plain tuples, arrays, text and flags."""

    def initial_state(self, measurement):
        return {"mood": "calm", "past": np.zeros((0, 2)), "last": None, "notes": (), "awake": False}

    def step(self, t, measurement, state):
        past = np.vstack([state["past"], measurement.x2])
        notes = (*state["notes"], (t, "sample"))
        mood = "calm" if len(past) % 2 else "busy"
        memory = {"mood": mood, "past": past, "last": t, "notes": notes, "awake": True}
        return rnc.control.Command(T=np.full(2, 0.1 * len(past))), memory


def test_memories_that_grow_are_loaded_and_those_of_another_kind_are_not(tmp_path):
    reduced, _ = sleigh()
    loop, plant = rnc.ControlLoop(reduced, Diary(), DT), started(reduced)
    drive(loop, plant, DT * np.arange(5))
    loop.save(tmp_path / "loop.npz")
    other = rnc.ControlLoop(reduced, Diary(), DT)
    other.load(tmp_path / "loop.npz")
    assert np.array_equal(other.step(5 * DT, *plant.read()), loop.step(5 * DT, *plant.read()))
    loop_state._check_memory(np.zeros((3, 2)), np.zeros(0), np.zeros((1, 2)))  # of a list that was empty
    memory = loop.state.controller
    for key, value, reason in (
        ("past", np.zeros((4, 3)), "raises ValueError"),
        ("past", np.zeros(2), r"controller\.past has shape \(2,\)"),
        ("past", np.full((4, 2), np.inf), r"controller\.past is not finite"),
        ("mood", 3.0, r"controller\.mood is a number or an array, expected a str"),
        ("last", "noon", r"controller\.last is a str, expected a float"),
        ("awake", np.nan, r"controller\.awake is not finite"),
        ("notes", "none", r"controller\.notes is a str, expected a tuple"),
        ("notes", ((np.nan, "sample"),), r"controller\.notes\.0\.0 is not finite"),
    ):
        path = saved(loop, tmp_path / "changed.npz", controller={**memory, key: value})
        with pytest.raises(rnc.ConfigurationError, match=reason):
            other.load(path)


@pytest.mark.parametrize("safe", ["zero", "brake"])
@pytest.mark.parametrize("clock", [0.02, np.nan, "noon", None])
def test_patience_ends_although_the_clock_stands_still(clock, safe):
    reduced, tracker = sleigh()
    loop, plant = rnc.ControlLoop(reduced, tracker, DT, fallback=safe, timeout=3 * DT), started(reduced)
    drive(loop, plant, DT * np.arange(3))
    held = loop.state.T
    assert held.any()
    q = plant.read()[0]
    inputs = [loop.step(clock, q, np.zeros(3)) for _ in range(6)]
    assert [bool(np.array_equal(T, held)) for T in inputs] == [True] * 4 + [False] * 2
    assert not inputs[-1].any()  # at rest there is nothing to brake
    assert "time" in loop.state.fault
    T = loop.step(0.08, *plant.read())
    assert loop.state.fault is None
    assert T.any()
    strict = rnc.ControlLoop(reduced, tracker, DT, fallback="raise")
    strict.step(0.02, *plant.read())
    with pytest.raises(rnc.InputError, match=r"time (is|stands still)"):
        strict.step(clock, *plant.read())


BAD = {
    "NaN in q": (lambda q, v: (q * np.nan, v), r"q\[0\] is not finite"),
    "NaN in v": (lambda q, v: (q, v * np.nan), r"v\[0\] is not finite"),
    "infinite": (lambda q, v: (q, v + np.inf), r"v\[0\] is not finite"),
    "words": (lambda q, v: ("nowhere", v), "q is not made of numbers"),
    "too short": (lambda q, v: (q[:-1], v), r"q has shape \(3,\), expected \(4,\)"),
    "no velocity": (lambda q, v: (q, None), "v is missing"),
    "a jump": (lambda q, v: (q + np.eye(4)[0] * 5.0, v), "q jumped"),
    "too fast": (lambda q, v: (q, v + 1e4), r"v reaches 1e\+04 rad/s or m/s"),
    "beyond sums": (lambda q, v: (q, v * 0.0 + 1e308), r"v reaches 1e\+308 rad/s or m/s"),
    "no direction": (lambda q, v: (q * [1, 1, 0.1, 0.1], v), "not of unit length"),
}


@pytest.mark.parametrize("what", BAD)
def test_one_bad_sample_does_no_harm(what):
    """It is not taken: inputs are held, and what was learnt stays sound."""
    spoil, reason = BAD[what]
    reduced, tracker = sleigh()
    times = DT * np.arange(150)
    plant, loop = started(reduced), rnc.ControlLoop(reduced, tracker, DT)
    reasons = []

    def once(sample, q, v):
        reasons.append(loop.state.fault)
        return spoil(q, v) if sample == 20 else (q, v)

    inputs = drive(loop, plant, times, once)
    assert np.array_equal(inputs[20], inputs[19])
    assert re.search(reason, reasons[21])
    assert reasons[22] is None
    clean = drive(rnc.ControlLoop(reduced, tracker, DT), started(reduced), times)
    assert np.abs(inputs[-1] - clean[-1]).max() < 0.05 * np.abs(clean).max()
    loop, plant = rnc.ControlLoop(reduced, tracker, DT, fallback="raise"), started(reduced)
    loop.step(0.0, *plant.read())
    with pytest.raises(rnc.InputError, match=reason):
        loop.step(DT, *spoil(*plant.read()))


@pytest.mark.parametrize(("safe", "expected"), [("hold", 1.0), ("zero", 0.0), ("brake", -1.0)])
def test_measurements_that_stay_away_lead_to_the_safe_command(safe, expected):
    reduced, tracker = sleigh()
    plant, loop = started(reduced), rnc.ControlLoop(reduced, tracker, DT, fallback=safe, timeout=3 * DT)
    times = DT * np.arange(40)
    inputs = drive(loop, plant, times, lambda sample, q, v: (q * np.nan, v) if sample >= 30 else (q, v))
    assert np.array_equal(inputs[30:34], np.tile(inputs[29], (4, 1)))  # the timeout first
    assert reduced.at(plant.read()[0], v=plant.read()[1]).v2[0] > 0.1
    if safe == "brake":
        assert inputs[-1, 0] < 0
        q, v = plant.read()
        assert not any(loop.step(1.0, q * np.nan, wrong).any() for wrong in (None, v * np.nan, v[:1], v[:, None]))
    else:
        assert np.array_equal(inputs[-1], expected * inputs[29])


def test_a_singular_configuration_ends_the_controller_not_the_loop():
    reduced = systems.space_robot()  # the tip's x and y and joint 1: singular where the arm is straight
    target = rnc.control.ReducingOutputController(reduced, rnc.planning.Hold(np.zeros(3)))
    loop = rnc.ControlLoop(reduced, rnc.control.VelocityTracker(target), DT, fallback="zero", min_singular_value=0.002)
    robot = reduced.robot
    loop.step(0.0, robot.configuration({"joint_2": 1.0}), np.zeros(4))
    assert loop.state.fault is None
    T = loop.step(2 * DT, robot.configuration({"joint_2": 1e-3}), np.zeros(4))
    assert not T.any()
    assert loop.state.failed
    assert "below the limit 0.002" in loop.state.fault
    assert not loop.step(3 * DT, robot.configuration({"joint_2": 1.0}), np.zeros(4)).any()  # for good
    loop.reset()
    assert loop.step(0.0, robot.configuration({"joint_2": 1.0}), np.zeros(4)).any()


def test_integrals_are_kept_where_nobody_gives_them():
    """Speed is a quasi-velocity: its position is what the loop made of it, not zero."""
    reduced, tracker = sleigh()
    loop, plant = rnc.ControlLoop(reduced, tracker, DT), started(reduced)
    drive(loop, plant, DT * np.arange(100))
    assert loop.state.integrals[0] == pytest.approx(plant.integrals[0], abs=0.02)
    assert loop.state.integrals[0] > 0.5


@pytest.mark.parametrize("jump", [0.2, 60.0, 3600.0])
def test_an_observer_survives_a_clock_that_jumps(jump):
    """The robot goes on at 0.5 m/s, after it accelerated: the last acceleration says nothing about the time between."""
    reduced, _ = sleigh()
    loop = rnc.ControlLoop(reduced, Memoryless(lambda *_: rnc.control.Command(T=np.zeros(2))), DT, velocity="observer")
    x, errors = 0.0, []
    for sample in range(200):
        speed = min(0.5, 0.5 * sample / 100)
        x += speed * DT
        t = sample * DT + (jump if sample >= 101 else 0.0)
        loop.step(t, reduced.robot.configuration({"root_joint": [x, 0.0, 0.0]}))
        errors.append(abs(loop.state.motion.v[0] - speed))
    assert max(errors[101:]) < 0.51
    assert max(errors[150:]) < 0.01


def test_a_command_for_several_states_is_none():
    reduced, _ = sleigh()
    for kind in "FT":
        command = Command(**{kind: np.ones((2, 2))})
        loop = rnc.ControlLoop(reduced, Memoryless(lambda *_, command=command: command), DT, fallback="raise")
        with pytest.raises(rnc.InputError, match=rf"the {kind} of a command has shape \(2, 2\), expected \(2,\)"):
            loop.step(0.0, reduced.robot.configuration(), np.zeros(3))


def test_the_memory_that_a_controller_uses_again_is_not_that_of_the_loop():
    reduced, _ = sleigh()
    memory, limits = np.array([1.0, 2.0]), np.array([50.0, 50.0])
    loop = rnc.ControlLoop(reduced, Memoryless(lambda *_: rnc.control.Command(T=memory)), DT, limits=limits)
    loop.step(0.0, reduced.robot.configuration(), np.zeros(3))
    memory[:], limits[:] = 1000.0, 0.0
    assert loop.state.T.tolist() == loop.last.requested.tolist() == [1.0, 2.0]
    assert loop.limits.tolist() == [50.0, 50.0]


def test_an_observer_is_the_parabola_that_fits_the_fading_past_best():
    """Independent: weighted least squares over all samples; weights fade by exp(-cutoff dt) from one to the next."""
    reduced, _ = sleigh()
    cutoff, count, generator = 25.0, 400, np.random.default_rng(5)
    measured = 0.1 * np.cumsum(generator.normal(size=(count, 2)), axis=0)
    observer = VelocityObserver(reduced.robot.model, cutoff)
    motion = observer.start(reduced.robot.configuration())
    for x, y in measured:
        motion = observer.step(motion, reduced.robot.configuration({"root_joint": [x, y, 0.0]}), DT)
    weights = np.exp(-cutoff * DT * np.arange(count)[::-1])
    assert weights[0] < 1e-30, "the start is forgotten"
    times = DT * np.arange(1 - count, 1)
    for axis in (0, 1):
        half, slope, place = np.polyfit(times, measured[:, axis], 2, w=np.sqrt(weights))
        found = [motion.q[axis], motion.v[axis], motion.acceleration[axis]]
        np.testing.assert_allclose(found, [place, slope, 2 * half], rtol=1e-6)


def test_options_that_are_none_are_refused():
    reduced, tracker = sleigh()
    for options, reason in (
        ({"velocity": "guessed"}, "velocity of a loop 'guessed' is not known; did you mean 'measured'"),
        ({"fallback": "panic"}, "fallback of a loop 'panic' is not known; expected one of: hold, brake, zero, raise"),
        ({"limits": np.ones(5)}, "limits of a loop have to be 2 non-negative numbers"),
        ({"cutoff": -1.0, "velocity": "observer"}, "cutoff of a loop has to be positive"),
        ({"tmeout": 1.0}, "loop: no option 'tmeout'; did you mean 'timeout'"),
    ):
        with pytest.raises(rnc.ConfigurationError, match=reason):
            rnc.ControlLoop(reduced, tracker, DT, **options)
    with pytest.raises(rnc.ConfigurationError, match="dt of a loop has to be positive"):
        rnc.ControlLoop(reduced, tracker, 0.0)


def test_inputs_that_the_loop_and_the_plant_take_away_are_missing_together():
    """Of 10 the loop lets 6 through and the plant gives 4: 6 are missing, and they are so in the reduced force."""
    reduced, _ = sleigh()
    seen, wanted = [], Command(T=np.array([10.0, -3.0]))
    controller = Memoryless(lambda t, measurement: seen.append(measurement) or wanted)
    loop, q, v = rnc.ControlLoop(reduced, controller, DT, limits=np.array([6.0, 5.0])), np.zeros(4), np.zeros(3)
    q[2] = 1.0
    for given, deficit in (([4.0, -3.0], [6.0, 0.0]), ([6.0, -3.0], [4.0, 0.0]), ([6.0, -1.0], [4.0, -2.0])):
        np.testing.assert_array_equal(loop.step(loop.state.time + DT if loop.state.time else 0.5, q, v), [6.0, -3.0])
        np.testing.assert_array_equal(loop.state.input_deficit, [4.0, 0.0])
        loop.report_applied_input(np.array(given))
        np.testing.assert_array_equal(loop.state.input_deficit, deficit)
        np.testing.assert_array_equal(loop.state.T, given)
        np.testing.assert_array_equal(loop.last.T, given)
        loop.step(loop.state.time + DT, q, v)
        np.testing.assert_array_equal(seen[-1].input_deficit, deficit)
        np.testing.assert_allclose(seen[-1].force_deficit, reduced.at(q).input_matrix @ deficit, atol=1e-15)
    loop.report_applied_input(np.array([10.0, -3.0]))  # more than the loop itself let through
    assert loop.state.input_deficit is None
    rnc.ControlLoop(reduced, controller, DT).report_applied_input(np.zeros(2))  # ignored before the first step
    assert rnc.ControlLoop(limited(2.0)[0], controller, DT).step(0.5, q, v).tolist() == [2.0, -2.0]  # by default
