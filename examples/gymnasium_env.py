"""A Gymnasium environment of a reduced model: the hand of a space robot moves to random points.

Copy it, and change the robot, the outputs and the reward. It needs ``pip install gymnasium``.
"""

import gymnasium
import numpy as np

import rnc_pin as rnc

PERIOD = 0.05  # time that an action is held [s]
DURATION = 3.0  # time of an episode [s]
LARGEST_INPUT = 40.0  # of each motor [N m]
LARGEST_SPEED = np.array([5.0, 5.0, 5.0])  # of the hand [m/s] and of the first joint [rad/s]
REACH = 3.0  # bound of positions in the observation [m or rad]
MIN_SINGULAR_VALUE = 0.01  # of [A; J2] with scaled rows; below it the reduction is singular


def space_robot() -> rnc.ReducedModel:
    """A floating platform with an arm; angular momentum is conserved."""
    robot = rnc.Robot.from_urdf("space_robot.urdf")
    momentum = rnc.MomentumConservation("platform")
    system = rnc.NonholonomicSystem(robot, [momentum], actuators=["joint_1", "joint_2", "joint_3"])
    return system.reduce(
        reducing=[rnc.FramePosition("tip", "xy"), rnc.JointPosition("joint_1")],
        vertical=[rnc.JointPosition("platform")],
    )


class ReachingEnv(gymnasium.Env):
    """Observations are platform, hand, first joint, error of the hand and reduced velocities; actions are
    torques, as parts of the largest ones.


    An episode ends as a failure where the motion is singular or too fast.
    The largest cost of a step is 1, and a failure costs the rest of the episode: failing early never pays.
    """

    def __init__(self) -> None:
        self.reduced = space_robot()
        self.plant = rnc.ReducedPlant(self.reduced, joint_damping=True, actuator_limits=True)
        high = np.concatenate([[np.pi], [REACH, REACH, np.pi], [2 * REACH, 2 * REACH], LARGEST_SPEED])
        self.observation_space = gymnasium.spaces.Box(-high, high, dtype=np.float64)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, shape=(3,), dtype=np.float64)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        robot, random = self.reduced.robot, self.np_random
        start = {"joint_1": -0.4, "joint_2": random.uniform(1.6, 2.0), "joint_3": random.uniform(-1.3, -0.9)}
        self.plant.reset(robot.configuration(start), np.zeros(robot.nv))
        self.goal = np.array([random.uniform(1.0, 1.3), random.uniform(0.5, 0.8)])
        self.steps = 0
        observation, _ = self._observe()
        return observation, {"goal": self.goal.copy()}

    def step(self, action):
        self.steps += 1
        self.plant.apply(LARGEST_INPUT * np.clip(action, -1.0, 1.0))
        try:
            self.plant.advance(PERIOD)
            observation, failure = self._observe()
        except (rnc.SingularityError, rnc.DivergenceError) as error:  # the state before stays observed
            observation, failure = self.observation, str(error)
        left = round(DURATION / PERIOD) - self.steps
        error = np.linalg.norm(observation[4:6])
        reward = -min(float(error), 1.0) - (left if failure else 0)
        return observation, reward, bool(failure), left <= 0, {"goal": self.goal.copy(), "failure": failure}

    def _observe(self) -> tuple[np.ndarray, str]:
        """The clipped observation, and what failed."""
        q, v = self.plant.read()
        state = self.reduced.at(q, v=v)
        x1, x2 = state.outputs()
        failure = ""
        if state.smallest_singular_value < MIN_SINGULAR_VALUE:
            failure = "singular"
        elif (np.abs(state.v2) > LARGEST_SPEED).any():
            failure = "too fast"
        observation = np.concatenate([x1, x2, self.goal - x2[:2], state.v2])
        space = self.observation_space
        self.observation = np.clip(observation, space.low, space.high)
        return self.observation, failure


def computed_torque(env: ReachingEnv) -> np.ndarray:
    """A policy that knows the model, as a baseline: the error of the hand decays like that of a damped spring."""
    q, v = env.plant.read()
    v2 = env.reduced.at(q, v=v).v2
    wanted = np.append(8.0 * env.observation[4:6], 0.0) - 5.0 * v2
    return env.reduced.allocate(q, env.reduced.inverse_dynamics(q, v2, wanted)) / LARGEST_INPUT


def no_input(env: ReachingEnv) -> np.ndarray:
    return np.zeros(3)


def mean_return(policy, episodes: int = 8) -> float:
    """Mean sum of the rewards over episodes with the seeds 0, 1, 2, ..."""
    env, total = ReachingEnv(), 0.0
    for seed in range(episodes):
        env.reset(seed=seed)
        over = False
        while not over:
            _, reward, terminated, truncated, _ = env.step(policy(env))
            total += reward
            over = terminated or truncated
    return total / episodes


if __name__ == "__main__":
    print(f"mean return: {mean_return(computed_torque):.1f} with the model, {mean_return(no_input):.1f} without inputs")
