"""Comparison of logs with models."""

from dataclasses import replace

import numpy as np
import pytest

import rnc_pin as rnc
from rnc_pin.lab.calibration.calibration import PoseProblem
from rnc_pin.lab.calibration.rolling_motion import RollingMotion
from rolled_logs import DIFFERENTIAL, TRICYCLE


def test_the_error_of_a_right_model_is_the_noise_of_the_sensor(tmp_path):
    true = replace(TRICYCLE, true=TRICYCLE.nominal)
    found = rnc.compare(true.system(tmp_path), true.log(0), "sensor")
    assert list(found.errors) == [1.0, 10.0, np.inf]  # the log has 30 s
    for error in found.errors.values():
        assert error.mean == pytest.approx(0.005 * np.sqrt(np.pi / 2), rel=0.05)  # of the noise (Rayleigh)
    # The rear wheel is not measured: it rolls in any case, and only its lateral row can slip.
    assert list(found.slip) == ["rolling(front)", "lateral(front)", "lateral(rear)"]


def test_slip_is_that_of_the_closed_form(tmp_path):
    """A left wheel of another radius slips by the difference of the radii times its rate; nothing else slips."""
    other = replace(DIFFERENTIAL, true={**DIFFERENTIAL.nominal, "rl": 0.11})
    system, log = other.system(tmp_path), other.log(3, noise=0.0, ticks=0)
    motion = RollingMotion(system, log, (), "sensor")
    problem = PoseProblem(motion, log.channel("pose", "sensor"), True)
    _, slip = motion.slip(problem.base_poses(motion.time))
    slip = slip.reshape(-1, 2, 4).sum(axis=1)  # from pose to pose: between them, poses are interpolated
    whole = np.isfinite(slip).all(axis=1)
    assert whole.mean() > 0.99
    turned = np.diff(log.channel("position", "left_joint").at(motion.time[::2])[:, 0])
    slips = dict(zip(motion.used, slip.T, strict=True))
    np.testing.assert_allclose(slips["rolling(left)"][whole], 0.01 * turned[whole], atol=3e-6)
    for name in ("rolling(right)", "lateral(left)", "lateral(right)"):
        np.testing.assert_allclose(slips[name][whole], 0.0, atol=3e-6)


def test_the_replay_is_the_measured_path_of_a_right_model(tmp_path):
    true = replace(TRICYCLE, true=TRICYCLE.nominal)
    found = rnc.compare(true.system(tmp_path), true.log(0, noise=0.0, ticks=0), "sensor")
    replay = found.replay
    np.testing.assert_allclose(replay.predicted, replay.measured, atol=1e-4)
    np.testing.assert_allclose(replay.q[:, :2], replay.predicted[:, :2])


def test_fingers_that_are_coupled_to_each_other_only_need_no_log(tmp_path):
    log, cart = DIFFERENTIAL.log(0), DIFFERENTIAL.system(tmp_path)
    robot = cart.robot.attach(rnc.Robot.from_example("panda"), "base")
    carrying = rnc.NonholonomicSystem(robot, DIFFERENTIAL.constraints(DIFFERENTIAL.nominal))
    assert rnc.compare(carrying, log, "sensor").errors == rnc.compare(cart, log, "sensor").errors
