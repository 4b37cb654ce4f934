"""Runs of ``simulate`` from many initial states against runs alone."""

import numpy as np
import pytest

import rnc_pin as rnc
import systems
from rnc_pin.control import ComputedTorque, PositionTracker, ReducingOutputController, VelocityTracker, ZeroInput
from rnc_pin.motion.planning import Hold, MinimumJerk
from rnc_pin.simulation import batch
from simple_controllers import Inputs

DT, DURATION, CLOSE = 0.01, 0.12, 1e-12


def alone(*arguments, **options):
    try:
        return rnc.simulate(*arguments, **options)
    except rnc.RncError as error:
        return error.trajectory


def check_all(reduced, controller, q0, v2_0, plant=None, stop=None, duration=DURATION):
    options = {"plant": plant, "options": rnc.SimulationOptions(**({} if stop is None else {"stop": stop}))}
    runs = rnc.simulate(reduced, controller, q0, duration, DT, v2_0=v2_0, **options)
    for place, run in enumerate(runs):
        q = q0 if np.ndim(q0) == 1 else q0[place]
        single = alone(reduced, controller, q, duration, DT, v2_0=v2_0[place], **options)
        for name, theirs in single.arrays.items():
            size = np.nanmax(np.abs(theirs), initial=1.0)
            np.testing.assert_allclose(run.arrays[name], theirs, rtol=0, atol=CLOSE * size, err_msg=name)
        assert (run.outcome, run.info.message, run.meta["names"]) == (
            single.outcome, single.info.message, single.meta["names"]
        )  # fmt: skip
        ours, theirs = run.info.integration, single.info.integration
        assert (ours.substeps, ours.enough) == (theirs.substeps, theirs.enough)
    return runs


@pytest.fixture
def none_alone(monkeypatch):
    def refuse(run, samples):
        raise AssertionError("a run is alone")

    monkeypatch.setattr(batch, "_alone", refuse)


def hold(reduced, k2=2.0):
    return ReducingOutputController(reduced, Hold(np.linspace(-0.5, 0.5, reduced.r)), k2)


CONTROLLERS = {
    "velocity": lambda reduced: VelocityTracker(hold(reduced)),
    "torque": lambda reduced: ComputedTorque(reduced, hold(reduced)),
    "position": lambda reduced: PositionTracker(hold(reduced).reference, angular=reduced.reducing.coordinates),
    "none": ZeroInput,
}


def needs_kernel(reduced):
    if not reduced.evaluator.measures:
        pytest.skip("runs are computed together by the compiled kernel")


@pytest.fixture(scope="module")
def sleigh():
    return systems.sleigh()


@pytest.mark.parametrize("name", ["mobile_manipulator", "fire_truck"])
@pytest.mark.parametrize("controller", CONTROLLERS)
def test_runs_of_trackers_are_those_of_runs_alone(name, controller):
    reduced = systems.ALL[name]()
    q, v2 = map(np.array, zip(*systems.random_states(reduced, 3, seed=5), strict=True))
    check_all(reduced, CONTROLLERS[controller](reduced), q, 0.3 * v2)


@pytest.mark.parametrize("controller", CONTROLLERS)
def test_runs_of_trackers_are_computed_together(sleigh, none_alone, controller):
    needs_kernel(sleigh)
    v2_0 = np.array([[0.1, 0.2], [0.0, -0.1]])
    runs = rnc.simulate(sleigh, CONTROLLERS[controller](sleigh), sleigh.robot.configuration(), DURATION, DT, v2_0=v2_0)
    assert [run.v2[0].tolist() for run in runs] == v2_0.tolist()


def test_a_task_of_redundant_outputs_and_its_angles():
    reduced = systems.space_robot()
    task = rnc.Task.of(reduced, primary=["tip_x", "tip_y"], redundant=["joint_1"])
    q0 = reduced.robot.configuration({"joint_1": -0.4, "joint_2": 1.8, "joint_3": -1.1})
    x1, x2 = reduced.at(q0).outputs()
    reference = MinimumJerk(x2[:2], x2[:2] + 0.2, duration=1.0)
    kinematic = rnc.control.RedundancyController(task, reference, Hold(x1), k21=1.0)
    near = q0 + 0.02 * np.random.default_rng(0).standard_normal((3, len(q0)))
    check_all(reduced, VelocityTracker(kinematic), near, np.zeros((3, 3)))


def test_each_run_has_the_steps_and_the_charts_that_its_motion_needs():
    robot = rnc.Robot.from_urdf("rolling_ball.urdf", base="free")
    reduced = rnc.NonholonomicSystem(robot).reduce()
    q0 = robot.configuration({"root_joint": [0, 0, 2.0, 0, 0, 0, 1]})
    v = np.array([np.r_[1.0, 0.0, 0.5, spin * np.array([0.3, 0.5, 0.81])] for spin in (0.0, 5.0, 40.0, 200.0)])
    v2_0 = np.array([reduced.at(q0, v=each).v2 for each in v])
    runs = check_all(reduced, ZeroInput(reduced), q0, v2_0, duration=1.5)
    substeps = [run.info.integration.substeps for run in runs]
    assert substeps == sorted(substeps)
    assert substeps[0] < substeps[-1]


def test_runs_end_for_themselves(sleigh):
    v2_0 = np.array([[0.1, 0.2], [0.1, 0.0], [0.0, -0.1], [2e3, 0.0]])
    q0 = np.array([sleigh.robot.configuration({"root_joint": [0, 0, yaw]}) for yaw in (0.1, 2.5, 0.0, 0.0)])
    tracker = VelocityTracker(ReducingOutputController(sleigh, Hold([0.2, 0.0])))
    runs = check_all(sleigh, tracker, q0, v2_0, stop=rnc.Stop(speed=1.0))
    assert [str(run.outcome) for run in runs] == ["completed", "diverged", "completed", "diverged"]
    assert len(runs[0].time) == 13 > len(runs[1].time) > len(runs[3].time) == 0


def test_a_joint_that_leaves_its_range_ends_only_its_run():
    reduced = systems.driven_panda()
    v2_0 = np.zeros((2, 7))
    v2_0[1, 3] = 15.0  # towards the stop of the elbow
    q0 = np.array([0.0, 0.0, 0.0, -1.5, 0.0, 1.5, 0.0])
    runs = check_all(reduced, ZeroInput(reduced), q0, v2_0, stop=rnc.Stop(position_limits=True))
    assert [str(run.outcome) for run in runs] == ["completed", "limit"]


@pytest.mark.parametrize("controller", ["velocity", "position"])
def test_limits_of_the_actuators_and_the_windup_of_each_run(controller):
    limited = systems.sleigh(3.0, 0.2)
    plant = rnc.ReducedPlant(limited, actuator_limits=True, substeps=2)
    v2_0 = np.array([[-0.5, 0.5], [0.95, 0.0], [4.0, 1.0]])
    runs = check_all(limited, CONTROLLERS[controller](limited), limited.robot.configuration(), v2_0, plant)
    saturated = [(np.abs(run.T) == [3.0, 0.2]).any() for run in runs]
    assert any(saturated)


class Shy(Inputs):
    def step(self, t, measurement, state):
        if measurement.v2[0] > 0.5:
            raise ValueError("too fast for me")
        return super().step(t, measurement, state)


def test_other_plants_move_one_after_the_other(sleigh):
    v2_0, plant = np.array([[0.1, 0.0], [0.3, 0.2]]), rnc.ReducedPlant(sleigh, joint_friction=True)
    check_all(sleigh, CONTROLLERS["velocity"](sleigh), sleigh.robot.configuration(), v2_0, plant)


def test_an_error_of_a_controller_ends_only_its_run(sleigh):
    v2_0 = np.array([[-1.0, 0.0], [0.4, 0.0], [-2.0, 0.1]])
    runs = check_all(sleigh, Shy(lambda t: [10.0, 0.0]), sleigh.robot.configuration(), v2_0)
    assert [str(run.outcome) for run in runs] == ["completed", "failed", "completed"]
    assert "too fast for me" in runs[1].info.message


class Interrupted(Hold):
    def at(self, t):
        if t > 0.055:
            raise KeyboardInterrupt
        return super().at(t)


def test_an_interruption_ends_runs_that_are_computed_together(sleigh, none_alone):
    needs_kernel(sleigh)
    tracker = PositionTracker(Interrupted([0.1, 0.1]))
    runs = rnc.simulate(sleigh, tracker, np.tile(sleigh.robot.configuration(), (2, 1)), DURATION, DT)
    assert [(str(run.outcome), len(run.time)) for run in runs] == [("interrupted", 6)] * 2


@pytest.mark.parametrize(("arguments", "error", "message"), [
    ({"v2_0": np.zeros((2, 2)), "q0": np.zeros((3, 4))}, rnc.InputError, "expected one row for each run"),
    ({"v2_0": np.zeros((2, 3))}, rnc.InputError, "run 0: "),
    ({"v2_0": np.zeros((0, 2))}, rnc.InputError, "expected one row for each run"),
    ({"q0": np.zeros((2, 2, 4))}, rnc.InputError, "expected one row for each run"),
    ({"v2_0": np.zeros((2, 2)), "options": {"stop": None}}, rnc.ConfigurationError, "options: expected"),
    ({"v2_0": np.zeros((2, 2)), "plant": object()}, rnc.ConfigurationError, "plant: expected methods"),
])  # fmt: skip
def test_wrong_arguments_are_refused(sleigh, arguments, error, message):
    q0 = sleigh.robot.configuration()
    with pytest.raises(error, match=message):
        rnc.simulate(sleigh, ZeroInput(sleigh), **{"q0": q0, "duration": 0.1, "dt": 0.01, **arguments})
