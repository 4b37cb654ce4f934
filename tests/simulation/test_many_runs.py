"""Many runs of ``simulate`` against runs alone: the same bits, outcomes and errors."""

import copy
import pickle

import numpy as np
import pytest

import rnc_pin as rnc
import systems
from controlled_tasks import TASK
from rnc_pin.control import (
    Command,
    ComputedTorque,
    ReducingOutputController,
    SlitheringReference,
    SteeringController,
    VelocityTracker,
)
from rnc_pin.control.controller import accepts_batches, stack_states, state_of_runs
from rnc_pin.planning import CarPath, Hold, MinimumJerk
from rnc_pin.plants import MassErrors, Payload
from rnc_pin.simulation import RunArguments
from same_runs import check_same
from simple_controllers import Inputs

DT, DURATION = 0.01, 0.12
DRIVES = [rnc.FrameForce("sleigh", "x"), rnc.FrameTorque("sleigh", "z")]


def alone(*arguments, **options):
    """A run, however it ends, and its error."""
    try:
        return rnc.simulate(*arguments, **options), None
    except rnc.RncError as error:
        return error.trajectory, error


def check_all(reduced, controller, q0, v2_0=None, plant=None, options=None, **alike):
    """Compare a batch with its runs alone, whose arguments are rows of those of the batch."""
    options = options or rnc.SimulationOptions()
    runs = rnc.simulate(reduced, controller, q0, DURATION, DT, v2_0=v2_0, plant=plant, options=options, **alike)
    for place, run in enumerate(runs):
        each = controller[place] if isinstance(controller, list) else controller
        v2 = v2_0 if v2_0 is None or np.ndim(v2_0) == 1 else v2_0[place]
        q = q0 if np.ndim(q0) == 1 else q0[place]
        own = plant[place] if isinstance(plant, list) else plant
        single, error = alone(reduced, each, q, DURATION, DT, v2_0=v2, plant=own, options=options, **alike)
        check_same(run, single)
        assert runs.outcomes[place] is single.outcome
        assert str(runs.errors[place]) == str(error)
        assert type(runs.errors[place]) is type(error)
    return runs


def starts(reduced, count):
    states = systems.random_states(reduced, count, seed=5)
    return np.array([q for q, _ in states]), np.array([0.3 * v2 for _, v2 in states])


def hold(reduced, k2=2.0):
    return ReducingOutputController(reduced, Hold(np.linspace(-0.5, 0.5, reduced.r)), k2)


@pytest.fixture(scope="module")
def sleigh():
    return systems.sleigh()


@pytest.fixture(scope="module")
def at_rest(sleigh):
    return sleigh.robot.configuration()


@pytest.mark.parametrize("name", ["mobile_manipulator", "fire_truck"])
def test_a_tracker_and_a_model_based_controller_have_the_bits_of_runs_alone(name):
    reduced = systems.ALL[name]()
    q0, v2_0 = starts(reduced, 3)
    target = hold(reduced)
    for controller in (VelocityTracker(target), ComputedTorque(reduced, target)):
        assert check_all(reduced, controller, q0, v2_0).outcomes == (rnc.Outcome.COMPLETED,) * 3


def test_a_task_of_redundant_outputs_and_its_angles():
    reduced = systems.space_robot()
    task = rnc.Task.of(reduced, primary=["tip_x", "tip_y"], redundant=["joint_1"])
    q0 = reduced.robot.configuration({"joint_1": -0.4, "joint_2": 1.8, "joint_3": -1.1})
    x1, x2 = reduced.at(q0).outputs()
    reference = MinimumJerk(x2[:2], x2[:2] + 0.2, duration=1.0)
    kinematic = rnc.control.RedundancyController(task, reference, Hold(x1), k21=1.0)
    near = q0 + 0.02 * np.random.default_rng(0).standard_normal((3, len(q0)))
    check_all(reduced, VelocityTracker(kinematic), near)


def test_a_trailer_that_steers_after_its_tractor():
    """Runs record places at different times, and the last one turns until its trailer would stand across the path."""
    reduced = systems.fire_truck()
    task, path = rnc.Task.of(reduced, *TASK), CarPath((-8, 3, 0), (0, 0, 0), 12.0, 1.0)
    slithering = SlitheringReference(reduced, task, "tractor", "rear_axle")
    tracker = VelocityTracker(SteeringController(reduced, task, path.reference, slithering))
    assert accepts_batches(tracker)
    q0 = np.tile(reduced.robot.configuration({"root_joint": [-8, 3, 0]}), (4, 1))
    q0[3, 4] = 1.2  # front steering
    v2_0 = np.array([[0.5, 0.0, 0.0], [1.5, 0.3, -0.2], [-0.9, 0.0, 0.1], [25.0, 0.0, 0.0]])
    runs = check_all(reduced, tracker, q0, v2_0)
    assert [str(outcome) for outcome in runs.outcomes] == ["completed"] * 3 + ["singular"]


def test_the_controllers_of_tasks_take_all_runs_at_once(sleigh):
    target = hold(sleigh)
    for controller in (target, VelocityTracker(target), ComputedTorque(sleigh, target)):
        assert accepts_batches(controller)
    assert not accepts_batches(Shy())
    states = [sleigh.at(q, v2).measure(np.zeros(2)) for q, v2 in systems.random_states(sleigh, 3)]
    tracker = VelocityTracker(target)
    alone = [tracker.step(0.0, each, tracker.initial_state(each)) for each in states]
    fields = (None if parts[0] is None else np.stack(parts) for parts in zip(*states, strict=True))
    command, state = tracker.step(
        0.0, type(states[0])(*fields), stack_states([tracker.initial_state(m) for m in states])
    )
    for run, (command_alone, state_alone) in enumerate(alone):
        assert np.array_equal(command.F[run], command_alone.F)
        assert np.array_equal(state_of_runs(state, run).D, state_alone.D)


def test_states_of_one_run_are_stacked_too():
    np.testing.assert_array_equal(stack_states([np.array([1.0, 2.0])]), [[1.0, 2.0]])


def test_runs_end_for_themselves(sleigh, at_rest):
    v2_0 = np.array([[0.1, 0.2], [30.0, 0.0], [0.0, -0.1], [2e3, 0.0]])
    options = rnc.SimulationOptions(stop=rnc.Stop(speed=30.1))
    runs = check_all(sleigh, Inputs(lambda t: [20.0, 0.0]), at_rest, v2_0, options=options)
    assert [str(outcome) for outcome in runs.outcomes] == ["completed", "diverged", "completed", "diverged"]
    assert [len(run.time) for run in runs] == [13, len(runs[1].time), 13, 0]
    assert 0 < len(runs[1].time) < 13


def test_a_joint_that_leaves_its_range_ends_only_its_run():
    robot = rnc.Robot.from_example("panda", lock={"panda_finger_joint1": 0.0, "panda_finger_joint2": 0.0})
    reduced = rnc.NonholonomicSystem(robot, [], [f"panda_joint{k}" for k in range(1, 8)]).reduce()
    q0 = np.array([0.0, 0.0, 0.0, -1.5, 0.0, 1.5, 0.0])
    v2_0 = np.zeros((2, 7))
    v2_0[1, 3] = 15.0  # towards the stop of the elbow
    options = rnc.SimulationOptions(stop=rnc.Stop(position_limits=True))
    runs = check_all(reduced, rnc.control.ZeroInput(reduced), q0, v2_0, options=options)
    assert [str(outcome) for outcome in runs.outcomes] == ["completed", "limit"]


def test_a_controller_for_each_run_and_states_that_go_on(sleigh, at_rest):
    controllers = [VelocityTracker(ReducingOutputController(sleigh, Hold([goal, 0.1]))) for goal in (0.2, 0.5)]
    check_all(sleigh, controllers, at_rest)

    seen = []
    for v2 in ([0.1, 0.0], [0.3, 0.0]):
        observed = rnc.SimulationOptions(observer=seen.append)
        rnc.simulate(sleigh, controllers[0], at_rest, DURATION, DT, v2_0=v2, options=observed)
    states = [seen[12].state, seen[25].state]
    states = [state._replace(time=None) for state in states]
    runs = rnc.simulate(
        sleigh, controllers[0], at_rest, DURATION, DT, options=rnc.SimulationOptions(controller_state=states)
    )
    for run, state in zip(runs, states, strict=True):
        options = rnc.SimulationOptions(controller_state=state)
        check_same(run, rnc.simulate(sleigh, controllers[0], at_rest, DURATION, DT, options=options))


def test_limits_of_the_actuators_and_the_windup_of_each_run(sleigh, at_rest):
    limited = systems.sleigh(3.0, 0.2)
    v2_0 = np.array([[0.0, 0.0], [0.95, 0.0], [4.0, 1.0]])
    tracker = VelocityTracker(ReducingOutputController(limited, Hold([1.0, 0.0]), 0.1))
    plant = rnc.ReducedPlant(limited, actuator_limits=True, substeps=2)
    runs = check_all(limited, tracker, at_rest, v2_0, plant=plant)
    saturated = [(np.abs(run.T) == [3.0, 0.2]).any() for run in runs]
    assert any(saturated)
    assert not all(saturated)


class Shy:
    """A controller that refuses high speeds."""

    def initial_state(self, measurement):
        return None

    def step(self, t, measurement, state):
        if measurement.v2[0] > 0.5:
            raise ValueError("too fast for me")
        return Command(F=np.array([10.0, 0.0]), x2_desired=measurement.x2 if t > 0.05 else None), state


def test_an_error_of_a_controller_ends_only_its_run(sleigh, at_rest):
    v2_0 = np.array([[-1.0, 0.0], [0.4, 0.0], [-2.0, 0.1]])
    runs = check_all(sleigh, Shy(), at_rest, v2_0)
    assert [str(outcome) for outcome in runs.outcomes] == ["completed", "failed", "completed"]
    assert isinstance(runs.errors[1].__cause__, ValueError)


@pytest.mark.parametrize(("faults", "loop"), [
    ({"position_noise": 1e-3, "velocity_noise": 0.02, "counts": 4096, "delay": 2, "jitter": 0.3}, {}),
    ({"velocity_bias": 0.01, "dropped": 0.3}, {"velocity": "filtered", "cutoff": 60.0}),
    ({"effort": 3.0, "dead_zone": 0.5, "position_bias": 0.01}, {}),
    ({"effort": 3.0}, {"limits": True}),
    ({"garbage": 0.3}, {"fallback": "hold", "timeout": 0.02}),
    ({"garbage": 0.3}, {"fallback": "raise"}),
    ({"slip_time": 0.05, "slip_speed": 0.2, "slip_duration": 0.03, "position_noise": 1e-3}, {}),
    ({"velocity_noise": 0.1}, {"max_speed": 0.45}),  # some measurements are too fast
])  # fmt: skip
def test_faults_of_sensors_and_actuators_have_the_bits_of_runs_alone(sleigh, at_rest, faults, loop):
    """Runs with an invalid measurement, or with slip, go on alone."""
    plants = [
        rnc.plants.FaultyPlant(rnc.ReducedPlant(sleigh, actuator_limits=True), rnc.Faults(**faults), sleigh, DT, seed)
        for seed in range(3)
    ]
    options, tracker = rnc.SimulationOptions(loop=loop), VelocityTracker(hold(sleigh))
    v2_0 = np.array([[0.1, 0.0], [0.3, 0.2], [-0.2, 0.4]])
    key = RunArguments(sleigh, tracker, at_rest, DT, 13, plant=plants[0], options=options).lock_step_key
    assert (key is not None) == sleigh.evaluator.measures
    runs = check_all(sleigh, tracker, at_rest, v2_0, plants, options)
    assert all(run.v_measured.shape == run.v.shape for run in runs if len(run.time))


def true_plant(sleigh, change):
    """Plant of a sleigh: a heavier one, one that gets a load, one whose turn locks, or the sleigh itself."""
    if change is None:
        return rnc.ReducedPlant(sleigh)
    robot = copy.deepcopy(sleigh.robot)
    rows = change.change(robot)
    model = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh"), *rows], DRIVES).reduce()
    plant = rnc.ReducedPlant(model)
    return plant if isinstance(change, MassErrors) else rnc.plants.ChangingPlant(rnc.ReducedPlant(sleigh), plant, 0.05)


@pytest.mark.parametrize(("change", "faults"), [
    (MassErrors(0.3, 1), {"position_noise": 1e-3}),
    (Payload("sleigh", 2.0), {"garbage": 0.2, "dead_zone": 0.2}),
    (None, {"friction": 0.3, "velocity_noise": 1e-3}),
    (None, {"friction": 2.0, "dead_zone": 0.1}),  # most of the time at rest
])  # fmt: skip
@pytest.mark.parametrize("tracker", ["velocity", "position"])
def test_changed_robots_and_friction_have_the_bits_of_runs_alone(sleigh, at_rest, change, faults, tracker):
    """Plants of other models take their own steps, with sensors and loops together; friction is in the batch."""
    each = [rnc.Faults(**faults)] * 2 + [rnc.Faults(**{**faults, "friction": 0.0})]
    plants = [
        rnc.plants.FaultyPlant(true_plant(sleigh, change), own, sleigh, DT, seed) for seed, own in enumerate(each)
    ]
    target = hold(sleigh)
    controller = VelocityTracker(target) if tracker == "velocity" else rnc.control.PositionTracker(target.reference)
    key = RunArguments(sleigh, controller, at_rest, DT, 13, plant=plants[0]).lock_step_key
    assert (key is not None) == sleigh.evaluator.measures
    check_all(sleigh, controller, at_rest, np.array([[0.1, 0.0], [0.3, 0.2], [-0.2, 0.4]]), plants)


@pytest.mark.parametrize("losses", ["joint_damping", "joint_friction"])
def test_runs_with_damping_and_joint_friction_have_the_bits_of_runs_alone(losses):
    robot = rnc.Robot.from_example("panda", lock={"panda_finger_joint1": 0.0, "panda_finger_joint2": 0.0})
    robot.model.damping[:], robot.model.upperDryFrictionLimit[:] = 0.5, 0.3
    reduced = rnc.NonholonomicSystem(robot, [], [f"panda_joint{k}" for k in range(1, 8)]).reduce()
    q0, v2_0 = starts(reduced, 2)
    check_all(reduced, rnc.control.ZeroInput(reduced), q0, v2_0, plant=rnc.ReducedPlant(reduced, **{losses: True}))


@pytest.mark.parametrize("garbage", [0.0, 0.2])
def test_vehicles_that_drive_to_a_pose_have_the_bits_of_runs_alone(garbage):
    """Some wait, some drive backwards, and some rest: the law is that of each."""
    reduced = systems.sleigh()
    system = rnc.NonholonomicSystem(reduced.robot, [rnc.NoSideSlip("sleigh")], DRIVES)
    reduced = system.reduce(
        [rnc.FrameSpeed("sleigh"), rnc.FrameYaw("sleigh")], [rnc.FramePosition("sleigh", axes="xy")]
    )
    drive = rnc.control.UnicycleStabilizer(np.array([0.4, 0.0, 0.1]), np.array([0, 1]), begin=0.02)
    controller = rnc.control.SplitController([(VelocityTracker(drive), [0, 1])], r=2)
    starts_of = [
        reduced.robot.configuration({"root_joint": pose}) for pose in ([0, 0.3, 1], [0.8, 0, 0], [0.4, 0, 0.1])
    ]
    faults = rnc.Faults(garbage=garbage)
    plants = [rnc.plants.FaultyPlant(rnc.ReducedPlant(reduced), faults, reduced, DT, seed) for seed in range(3)]
    runs = check_all(reduced, controller, np.array(starts_of), np.zeros((3, 2)), plants)
    assert (runs.stack("v2_desired")[1] <= 0.0).all() or garbage


class Impatient(Shy):
    """A controller whose user presses Ctrl-C."""

    def step(self, t, measurement, state):
        if t > 0.055:
            raise KeyboardInterrupt
        return super().step(t, measurement, state)


def test_an_interruption_ends_all_runs(sleigh, at_rest):
    runs = rnc.simulate(sleigh, Impatient(), np.stack([at_rest, at_rest]), DURATION, DT)
    assert [str(outcome) for outcome in runs.outcomes] == ["interrupted", "interrupted"]
    assert [len(run.time) for run in runs] == ([6, 6] if sleigh.evaluator.measures else [6, 0])


def test_an_interruption_ends_the_runs_that_follow_one_another(sleigh, at_rest):
    options = rnc.SimulationOptions(loop={"min_singular_value": 1e-9})  # one run after the other
    runs = rnc.simulate(sleigh, Impatient(), np.stack([at_rest] * 3), DURATION, DT, options=options)
    assert [str(outcome) for outcome in runs.outcomes] == ["interrupted"] * 3
    assert [len(run.time) for run in runs] == [6, 0, 0]


def test_runs_of_several_models_and_plants_keep_their_order(sleigh, at_rest):
    """Those with equal options advance together, whichever runs stand between them."""
    limited = [rnc.ReducedPlant(sleigh, actuator_limits=True) for _ in range(2)]
    plants = [limited[0], None, limited[1], rnc.ReducedPlant(sleigh, substeps=2), None]
    v2_0 = 0.1 * np.arange(10.0).reshape(5, 2)
    tracker = VelocityTracker(hold(sleigh))
    runs = rnc.simulate(sleigh, tracker, at_rest, DURATION, DT, v2_0=v2_0, plant=plants)
    for run, v2, plant in zip(runs, v2_0, plants, strict=True):
        check_same(run, rnc.simulate(sleigh, tracker, at_rest, DURATION, DT, v2_0=v2, plant=plant))


def test_a_singular_start_has_an_outcome_and_no_run():
    reduced = systems.space_robot()
    straight = reduced.robot.configuration()
    bent = reduced.robot.configuration({"joint_1": -0.4, "joint_2": 1.8, "joint_3": -1.1})
    runs = rnc.simulate(reduced, rnc.control.ZeroInput(reduced), np.stack([straight, bent]), DURATION, DT)
    assert [str(outcome) for outcome in runs.outcomes] == ["singular", "completed"]
    with pytest.raises(rnc.SingularityError):
        _ = runs[0]
    assert np.isnan(runs.stack("q")[0]).all()
    assert np.array_equal(runs.stack("q")[1], runs[1].q)


def test_runs_can_be_sliced_and_stored(sleigh, at_rest):
    v2_0 = np.array([[0.1, 0.0], [0.2, 0.0], [0.3, 0.0]])
    runs = rnc.simulate(sleigh, rnc.control.ZeroInput(sleigh), at_rest, DURATION, DT, v2_0=v2_0)
    assert str(runs) == "TrajectoryBatch of 3 runs: 3 completed"
    assert [run.v2[0, 0] for run in runs[1:]] == [0.2, 0.3]
    check_same(pickle.loads(pickle.dumps(runs))[2], runs[2])
    assert runs.stack("energy").shape == (3, 13)
    with pytest.raises(rnc.InputError, match="no array 'energies'"):
        runs.stack("energies")


@pytest.mark.parametrize(("arguments", "error", "message"), [
    ({"v2_0": np.zeros((2, 2)), "q0": np.zeros((3, 4))}, rnc.InputError, "q0 has 3, v2_0 has 2"),
    ({"v2_0": np.zeros((2, 3))}, rnc.InputError, "run 0: "),
    ({"v2_0": np.zeros((0, 2))}, rnc.InputError, "at least one: v2_0 has 0"),
    ({"q0": np.zeros((2, 2, 4))}, rnc.InputError, "expected one row or a row for each run"),
    ({"v2_0": np.zeros((2, 2)), "options": rnc.SimulationOptions(observer=print)}, rnc.ConfigurationError,
        "cannot tell the runs of a batch apart"),
    ({"v2_0": np.zeros((2, 2)), "options": {"stop": None}}, rnc.ConfigurationError, "run 0: options: expected"),
    ({"v2_0": np.zeros((2, 2)), "plant": object()}, rnc.ConfigurationError, "run 0: plant: expected methods"),
])  # fmt: skip
def test_wrong_arguments_are_refused(sleigh, at_rest, arguments, error, message):
    with pytest.raises(error, match=message):
        rnc.simulate(sleigh, rnc.control.ZeroInput(sleigh), **{"q0": at_rest, "duration": 0.1, "dt": 0.01, **arguments})
