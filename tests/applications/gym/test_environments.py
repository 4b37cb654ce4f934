"""Environments of scenarios: Gymnasium's own checks, its vector of single environments, and runs of ``simulate``."""

import re
import sys
from dataclasses import replace

import numpy as np
import pytest

import rnc_pin as rnc
from rnc_pin.applications.gym.episode_task import EpisodeTask
from rnc_pin.applications.scenario.execution import execute
from rnc_pin.applications.scenario.scenario import Scenario
from simple_controllers import Inputs

gymnasium = pytest.importorskip("gymnasium", reason="needs the extra gym")
env_checker = pytest.importorskip("gymnasium.utils.env_checker")

LIMITS = rnc.gym.EpisodeLimits(input=200.0, speed=3.0, output=3.0)
SHORT = {"simulation.duration": 0.5, "simulation.dt": 0.01, "reference.primary.minimum_jerk.duration": 0.4}
SETTINGS = {"options": SHORT, "period": 0.05, "limits": LIMITS}


@pytest.fixture(scope="module")
def env():
    return rnc.gym.make("space-robot", **SETTINGS)


def equal(one, other):
    """True if two nested results agree in every bit."""
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(equal(one[key], other[key]) for key in one)
    one, other = np.asarray(one), np.asarray(other)
    if one.dtype == object:
        return all(equal(a, b) if isinstance(a, np.ndarray | dict) else a == b for a, b in zip(one, other, strict=True))
    return np.array_equal(one, other, equal_nan=True)


@pytest.mark.filterwarnings("ignore:.*recommend using a symmetric and normalized.*:UserWarning")
@pytest.mark.filterwarnings("ignore:.*alternative render modes.*:UserWarning")
def test_gymnasium_accepts_an_environment(env):
    env_checker.check_env(env)


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_a_batch_is_gymnasiums_vector_of_single_environments_to_the_bit(mode):
    """Through failures and the ends of episodes, with random starts and goals."""
    ours = rnc.gym.make_vec("space-robot", 3, autoreset_mode=mode, **SETTINGS)
    assert ours.metadata["autoreset_mode"] is gymnasium.vector.AutoresetMode(mode)
    theirs = gymnasium.vector.SyncVectorEnv(
        [lambda: rnc.gym.make("space-robot", **SETTINGS)] * 3, autoreset_mode=gymnasium.vector.AutoresetMode(mode)
    )
    assert ours.single_observation_space == theirs.single_observation_space
    assert ours.action_space == theirs.action_space
    (observations, _), (expected, _) = ours.reset(seed=5), theirs.reset(seed=5)
    assert equal(observations, expected)
    assert len({each[1] for each in observations}) == 3  # of three starts
    actions = np.random.default_rng(0).uniform(-0.5, 0.5, (25, 3, 3))
    actions[:, 1] = 200.0  # too fast at once
    ends = np.zeros(2, dtype=int)
    for each in actions:
        found, wanted = ours.step(each), theirs.step(each)
        assert all(equal(one, other) for one, other in zip(found, wanted, strict=True))
        ends += [found[2].sum(), found[3].sum()]
    assert ends.min() > 0  # failures and ends of time


def test_an_episode_is_a_run_of_simulate(env):
    """The same inputs at the same times, and errors against the references at the ends of periods."""
    fixed = rnc.gym.make("space-robot", draws={}, **SETTINGS)
    fixed.reset(seed=0)
    inputs = np.random.default_rng(1).uniform(-0.5, 0.5, (10, 3))
    steps = [fixed.step(T) for T in inputs]

    replay = Inputs(lambda t: inputs[min(round(t / 0.05), len(inputs) - 1)])
    task = EpisodeTask("space-robot", SHORT, {}, 0.05, 0.0)
    plant = rnc.ReducedPlant(task.reduced, substeps=5)
    run = rnc.simulate(task.reduced, replay, task.nominal.q, 0.5, 0.05, plant=plant)
    observed = np.array([step[0] for step in steps])
    expected = np.hstack([run.x1, run.x2])[1:]
    assert np.abs(observed[:, :4] - expected).max() < 1e-12
    assert np.abs(observed[:, -3:] - run.v2[1:]).max() < 1e-11
    goal = np.array([*task.nominal.references[0].reference.at(0.45).position])  # platform is vertical, so it is first
    assert np.abs(observed[8, 5:7] - (goal - expected[8, 1:3])).max() < 1e-12
    assert [step[3] for step in steps] == [False] * 9 + [True]
    assert not any(step[2] for step in steps)


def test_the_default_reward_is_the_mean_relative_error_and_failing_never_pays():
    env = rnc.gym.make("space-robot", draws={}, **SETTINGS)
    env.reset(seed=0)
    observation, reward, *_ = env.step(np.zeros(3))
    bounds = env.observation_space.high
    assert reward == pytest.approx(-0.05 * np.mean(np.abs(observation[4:7]) / bounds[4:7]), rel=1e-12)
    total, failed = reward, False
    while not failed:
        _, reward, failed, _, info = env.step([200.0, 200.0, 200.0])
        total += reward
    assert info["failure"] == "ended_early"
    assert total < -(0.5 - info["time"])
    with pytest.raises(rnc.InputError, match="over"):
        env.step(np.zeros(3))


@pytest.mark.parametrize(("failure", "name", "options", "inputs", "limits"), [
    ("ended_early", "space-robot", SHORT, [200.0, 200.0, 200.0], LIMITS),
    ("position", "mobile-manipulator", {"initial.q.joint_1": 62.5}, [0.0, 0.0, 400.0, 0.0],
        rnc.gym.EpisodeLimits(input=500.0, speed=1e4, output=3.0)),
    ("singular", "space-robot", SHORT, [0.0, -20.0, 20.0], LIMITS),
])  # fmt: skip
def test_failures_are_the_findings_of_a_run(failure, name, options, inputs, limits):
    """The same inputs in a run of ``simulate``, with the limits of the environment as conditions to stop."""
    smallest = 0.08 if failure == "singular" else 0.01
    settings = {"options": options, "period": 0.05, "limits": replace(limits, singular_value=smallest)}
    env = rnc.gym.make(name, draws={}, **settings)
    env.reset(seed=0)
    failed = False
    while not failed:
        _, _, failed, _, info = env.step(inputs)
    assert info["failure"] == failure

    task = EpisodeTask(name, options, {}, 0.05, smallest)
    plant = rnc.ReducedPlant(task.reduced, substeps=task.samples)
    stop = rnc.Stop(speed=float(np.max(limits.speed)))
    more = {"plant": plant, "options": rnc.SimulationOptions(stop=stop, loop={"min_singular_value": smallest})}
    try:
        run = rnc.simulate(task.reduced, Inputs(lambda _: inputs), task.nominal.q, info["time"], 0.05, **more)
    except rnc.RncError as error:
        run = error.trajectory
    fails = {each.kind for each in run.verdict.findings if each.severity == "fails"}
    assert failure in fails


@pytest.mark.parametrize(("position", "time"), [([9.0, 0.0, 0.4], None), ([2.0, 0.0, 0.4], 0.5)])
def test_an_episode_ends_where_its_robot_is_in_an_obstacle(position, time):
    """A wall comes at up to 4 m/s and meets a robot at rest: the episode once went on. Another wall is far away."""
    wall = {"name": "wall", "size": [0.1, 4.0, 0.8], "position": position}
    if time is not None:
        wall["motion"] = {"minimum_jerk": {"by": [-2.0, 0.0, 0.0, 0.0], "duration": 1.0}}
    options = {"obstacles": [{"box": wall}], "simulation.duration": 2.0, "comparisons": {}}
    env = rnc.gym.make("mobile-manipulator", options=options, period=0.05, limits=rnc.gym.EpisodeLimits(20.0, 9.0, 9.0))
    env.reset(seed=0)
    over = False
    while not over:
        _, _, failed, ended, info = env.step(np.zeros(env.action_space.shape))
        over = failed or ended
    assert (failed, info["failure"]) == ((False, "") if time is None else (True, "collision"))
    if time is not None:
        assert 0.2 < info["time"] < 0.8


def test_a_reward_function_gets_the_step():
    def effort(step):
        assert isinstance(step, rnc.gym.Transition)
        return -np.square(step.T).sum(axis=-1) - step.time

    envs = rnc.gym.make_vec("space-robot", 2, reward=effort, **SETTINGS)
    envs.reset(seed=0)
    _, rewards, *_ = envs.step(np.array([[1.0, 0.0, 0.0], [250.0, 0.0, 0.0]]))  # the second one is clipped to 200
    assert rewards == pytest.approx([-1.05, -40000.05])


def test_disabled_autoreset_resets_where_it_is_told():
    envs = rnc.gym.make_vec("space-robot", 2, autoreset_mode="Disabled", **SETTINGS)
    envs.reset(seed=0)
    for _ in range(10):
        observations, _, _, truncated, _ = envs.step(np.zeros((2, 3)))
    assert truncated.all()
    with pytest.raises(rnc.ConfigurationError, match="reset_mask"):
        envs.step(np.zeros((2, 3)))
    after, info = envs.reset(options={"reset_mask": np.array([False, True])})
    assert equal(after[0], observations[0])
    assert not equal(after[1], observations[1])
    assert info["_time"].tolist() == [False, True]


def test_limits_come_from_the_model_and_from_the_scenarios_own_run():
    options = {**SHORT, "simulation.duration": 0.1}
    robot = rnc.gym.make("mobile-manipulator", options={**options, "simulation.dt": 0.002}).unwrapped
    high = robot.action_space.high
    assert high[2:].tolist() == [400.0, 400.0]  # of the joints in the file
    run = execute(
        Scenario.load("mobile-manipulator", {**options, "simulation.dt": 0.002, "comparisons": {}})
    ).trajectory
    assert high[0] == 2 * np.abs(run.T[:, 0]).max()
    assert robot.observation_space.high[-1] == 10 * np.abs(run.v2[:, 3]).max()


REFUSED = {
    "phases": ("grasp", {}),
    "contacts": ("space-robot", {"options": {"contacts": [{"constraint": {"caster": {"frame": "tip", "radius": 0}}}]}}),
    "faults": ("space-robot", {"options": {"faults": {"delay": 0.01}}}),
    "plant": ("space-robot", {"options": {"plant": "mujoco"}}),
    "actuators: there are none": ("space-robot", {"options": {"actuators": []}}),
    "no multiple of simulation.dt": ("space-robot", {"period": 0.0155}),
    "draws: 'robot.urdf'": ("space-robot", {"draws": {"robot.urdf": [0, 1]}}),
    "minimum 1 is greater than maximum 0": ("space-robot", {"draws": {"initial.q.joint_1": [1, 0]}}),
    "give a function as 'reward'": ("space-robot", {"options": {"reference": {}}, "draws": {}, "limits": LIMITS}),
    "limits.speed: expected a number or 3": ("space-robot", {"limits": rnc.gym.EpisodeLimits(speed=[1.0, 2.0])}),
    "limits.input: expected positive": ("space-robot", {"limits": rnc.gym.EpisodeLimits(input=0.0)}),
    "nearly singular": ("space-robot", {"limits": replace(LIMITS, singular_value=0.9)}),
    "none of 20 draws": ("space-robot",
        {"draws": {"initial.q.joint_3": [0, 1e-4]}, "limits": replace(LIMITS, singular_value=0.05)}),
}  # fmt: skip


@pytest.mark.parametrize("message", REFUSED)
def test_what_an_environment_does_not_support_is_refused_in_one_line(message):
    scenario, settings = REFUSED[message]
    with pytest.raises(rnc.RncError, match=message) as error:
        rnc.gym.make(scenario, **settings).reset(seed=0)
    assert "\n" not in str(error.value)


def test_actions_of_the_wrong_shape_and_unknown_modes_are_refused(env):
    env.reset(seed=0)
    for action in ([0.0, 0.0], [0.0, 0.0, np.nan]):
        with pytest.raises(rnc.InputError, match="actions"):
            env.step(action)
    with pytest.raises(rnc.ConfigurationError, match="did you mean 'NextStep'"):
        rnc.gym.make_vec("space-robot", 2, autoreset_mode="nextstep")
    with pytest.raises(rnc.ConfigurationError, match="num_envs"):
        rnc.gym.make_vec("space-robot", 0)


def test_without_gymnasium_one_line_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "gymnasium", None)
    with pytest.raises(rnc.ConfigurationError, match=re.escape("rnc.gym: Gymnasium is not installed: pip install")):
        rnc.gym.make("space-robot")


def test_states_that_the_kernel_does_not_measure_are_measured_alone():
    """Both ways agree; the second is also that of models without compiled measurements."""
    together, alone = (rnc.gym.make_vec("space-robot", 2, **SETTINGS) for _ in range(2))
    alone.batch._plants.measures = False
    actions = np.random.default_rng(2).uniform(-20, 20, (4, 2, 3))
    for envs in (together, alone):
        envs.reset(seed=1)
    for each in actions:
        (observations, rewards, *ends, _), (others, as_much, *same, _) = together.step(each), alone.step(each)
        assert np.abs(observations - others).max() < 1e-12
        assert np.abs(rewards - as_much).max() < 1e-12
        assert equal(np.array(ends), np.array(same))


def test_an_episode_whose_state_overflows_fails_and_leaves_the_others_alone():
    limits = rnc.gym.EpisodeLimits(input=1e200, speed=1e250, output=3.0)
    envs = rnc.gym.make_vec("mobile-manipulator", 2, limits=limits)
    single = rnc.gym.make("mobile-manipulator", limits=limits)
    assert single.action_space.high.tolist() == [1e200, 1e200, 400.0, 400.0]  # the joints have effort limits
    before, _ = envs.reset(seed=0)
    single.reset(seed=0)
    with np.errstate(over="ignore", invalid="ignore"):
        observations, _, terminated, _, info = envs.step(np.array([[0.1, 0.2, 0.3, 0.4], [1e200, 1e200, 0.0, 0.0]]))
    assert terminated.tolist() == [False, True]
    assert info["failure"].tolist() == ["", "ended_early"]
    assert equal(observations[0], single.step(np.array([0.1, 0.2, 0.3, 0.4]))[0])
    assert equal(observations[1], before[1])  # the last regular one


def test_the_goal_of_a_set_point_is_the_reference_of_its_outputs():
    """The car of "park": errors are goal less value, and a start at the goal has none."""
    settings = {"limits": rnc.gym.EpisodeLimits(input=20.0, speed=5.0, output=5.0)}
    observation, _ = rnc.gym.make("park", **settings).reset(seed=3)
    np.testing.assert_allclose(
        observation[[5, 6, 7, 8]], [0.0 - each for each in observation[[0, 1, 2, 4]]], atol=1e-12
    )
    assert np.abs(observation[5:7]).max() > 0.1
    there = rnc.gym.make("park", options={"initial.q.root_joint": [0, 0, 0]}, draws={}, **settings)
    observation, _ = there.reset(seed=0)
    np.testing.assert_allclose(observation, 0.0, atol=1e-12)
