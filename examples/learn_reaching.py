"""A linear policy learns to move the hand of a space robot to random points, by the cross-entropy method.

``python learn_reaching.py [GENERATIONS [POPULATION]]`` takes less than a minute and needs the extra ``gym``.
"""

import sys

import numpy as np

import rnc_pin as rnc

GENERATIONS = int(sys.argv[1]) if len(sys.argv) > 1 else 40
POPULATION = int(sys.argv[2]) if len(sys.argv) > 2 else 32
FIRST_SPREAD = 30.0

reach = "reference.primary.minimum_jerk"
envs = rnc.gym.make_vec(
    "space-robot",
    POPULATION,
    period=0.06,
    options={"simulation.duration": 3.0, "simulation.dt": 0.02, f"{reach}.duration": 1.5, "reference.vertical": None},
    draws={
        "initial.q.joint_2": [1.6, 2.0],
        "initial.q.joint_3": [-1.3, -0.9],
        f"{reach}.to.0": [1.0, 1.3],
        f"{reach}.to.1": [0.5, 0.8],
    },
    limits=rnc.gym.EpisodeLimits(input=40.0, speed=10.0, output=2.0),
    reward=lambda step: -0.06 * np.linalg.norm(step.error, axis=-1) - (3.0 - step.time) * step.failed,
)


def returns(gains: np.ndarray, seeds: list[int]) -> np.ndarray:
    """Sum of the rewards of one episode for each gain matrix; inputs are linear in errors and velocities."""
    observations, _ = envs.reset(seed=seeds)
    total, running = np.zeros(POPULATION), np.ones(POPULATION, dtype=bool)
    while running.any():
        inputs = np.einsum("bij,bj->bi", gains, observations[:, 4:])  # after platform, hand and first joint
        observations, rewards, terminated, truncated, _ = envs.step(inputs)
        total += running * rewards
        running &= ~(terminated | truncated)
    return total


rng = np.random.default_rng(0)
mean, spread = np.zeros((3, 5)), FIRST_SPREAD
for generation in range(GENERATIONS):
    gains = mean + spread * rng.normal(size=(POPULATION, 3, 5))
    best = gains[np.argsort(returns(gains, [generation] * POPULATION))[-POPULATION // 4 :]]
    mean, spread = best.mean(axis=0), best.std(axis=0) + 0.02 * FIRST_SPREAD * (1 - generation / GENERATIONS)


def mean_return(gains: np.ndarray) -> float:
    """Mean return of a policy on starts and goals that no generation had."""
    return float(returns(np.tile(gains, (POPULATION, 1, 1)), [10_000 + k for k in range(POPULATION)]).mean())


trained, at_rest = mean_return(mean), mean_return(np.zeros((3, 5)))
random = max(mean_return(FIRST_SPREAD * rng.normal(size=(3, 5))) for _ in range(2))
print(f"return on {POPULATION} unseen episodes: {trained:.2f}; no input {at_rest:.2f}, random {random:.2f}")
