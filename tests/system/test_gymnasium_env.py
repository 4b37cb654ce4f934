"""The environment of the examples, where Gymnasium is installed."""

import runpy

import numpy as np
import pytest

from places import ROOT

pytest.importorskip("gymnasium", reason="needs Gymnasium")


@pytest.fixture
def example():
    return runpy.run_path(str(ROOT / "examples" / "gymnasium_env.py"))


@pytest.mark.filterwarnings("ignore:.*alternative render modes.*:UserWarning")
def test_gymnasium_accepts_the_environment(example):
    from gymnasium.utils.env_checker import check_env

    check_env(example["ReachingEnv"]())


def test_seeds_repeat_episodes_and_a_policy_with_the_model_is_better_than_none(example):
    env = example["ReachingEnv"]()
    first, again, other = (env.reset(seed=seed)[0] for seed in (3, 3, 4))
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)
    assert example["mean_return"](example["computed_torque"], 2) > 0.5 * example["mean_return"](example["no_input"], 2)
