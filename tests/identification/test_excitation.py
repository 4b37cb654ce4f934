"""Motions for identification: within the limits of the file at a finer replay, and better than random ones."""

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from benchmarks.identification import ARM, arm, floating


def limited_arm():
    """The arm on the ground with limits that bind."""
    robot = arm(base=False)
    model = robot.model
    model.lowerPositionLimit[:], model.upperPositionLimit[:] = [-0.8, -0.3, -1.0], [0.5, 0.9, 1.2]
    model.upperVelocityLimit[:] = [1.5, 1.0, 2.0]
    model.upperEffortLimit[:] = [8.0, 40.0, 15.0]
    return rnc.NonholonomicSystem(robot, (), ARM).reduce([rnc.JointPosition(name) for name in ARM])


def replayed(reduced, motion, q, count):
    """Configurations, velocities and accelerations in smaller steps than those of the search."""
    dt, states = motion.duration / count, []
    for t in dt * np.arange(count + 1):
        state = reduced.at(q, motion.v2(t))
        states.append((q, state.v, state.v_dot(motion.v2_dot(t))))
        middle = pin.integrate(reduced.robot.model, q, dt / 2 * state.v)
        q = pin.integrate(reduced.robot.model, q, dt * reduced.at(middle, motion.v2(t + dt / 2)).v)
    return [np.array(each) for each in zip(*states, strict=True)]


@pytest.fixture(scope="module")
def limited():
    """The arm with limits, and its motion."""
    reduced = limited_arm()
    return reduced, rnc.excite(reduced, 6.0, np.zeros(3), rates=3.0, tries=10)


def test_a_finer_replay_stays_within_the_limits_of_the_file(limited):
    reduced, motion = limited
    model = reduced.robot.model
    q, v, a = replayed(reduced, motion, np.zeros(3), 1500)
    assert ((model.lowerPositionLimit < q) & (q < model.upperPositionLimit)).all()
    assert (np.abs(v) < model.upperVelocityLimit).all()
    efforts = np.array([pin.rnea(model, model.createData(), *each) for each in zip(q, v, a, strict=True)])
    assert (np.abs(efforts) < model.upperEffortLimit).all()
    used = [np.abs(v).max(axis=0) / model.upperVelocityLimit, np.abs(efforts).max(axis=0) / model.upperEffortLimit]
    assert max(map(np.max, used)) > 0.6  # some limit is nearly used
    np.testing.assert_allclose(q[-1], q[0], atol=1e-6)  # series have zero mean
    np.testing.assert_allclose([*motion.v2(0.0), *motion.v2_dot(0.0), *motion.v2(6.0)], 0.0, atol=1e-12)


@pytest.mark.parametrize("base", [True, False])
def test_the_motion_shows_parameters_better_than_random_ones(base):
    robot = arm(base=base)
    system = floating(robot) if base else rnc.NonholonomicSystem(robot, (), ARM)
    reduced = system.reduce([rnc.JointPosition(name) for name in ARM])
    motion = rnc.excite(reduced, 6.0, robot.configuration(), rates=2.0, tries=12)
    assert motion.condition < 0.7 * motion.random_condition
    # On the ground, 1 behind the vertical axis and 7 behind others.
    assert len(motion.parameters) == (31 if base else 15)


def test_velocities_and_accelerations_belong_together(limited):
    _, motion = limited
    slope = (motion.v2(1.3 + 1e-6) - motion.v2(1.3 - 1e-6)) / 2e-6
    np.testing.assert_allclose(motion.v2_dot(1.3), slope, rtol=1e-6, atol=1e-7)


def test_no_motion_within_limits_names_the_limit():
    reduced = limited_arm()
    reduced.robot.model.upperEffortLimit[1] = 1.0
    weak = rnc.NonholonomicSystem(reduced.robot, (), ARM).reduce([rnc.JointPosition(name) for name in ARM])
    with pytest.raises(rnc.InfeasibleError, match=r"no motion .* is within the limits: the effort of arm_2"):
        rnc.excite(weak, 6.0, np.zeros(3), rates=3.0)


@pytest.mark.parametrize(
    ("change", "words"), [({"rates": -1.0}, "rates: expected positive"), ({"share": 2.0}, "share")]
)
def test_wrong_numbers_are_refused(change, words):
    with pytest.raises(rnc.ConfigurationError, match=words):
        rnc.excite(limited_arm(), 6.0, np.zeros(3), **{"rates": 1.0, **change})
