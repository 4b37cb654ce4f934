"""Comparison of logs with models of which one number is wrong."""

from dataclasses import replace

import numpy as np
import pytest

import rnc_pin as rnc
from rnc_pin.identification.calibration import PoseProblem
from rnc_pin.identification.logs import Channel
from rnc_pin.identification.rolling_motion import RollingMotion
from rolled_logs import DIFFERENTIAL, TRICYCLE, signal


def test_a_right_model_has_no_suspect(tmp_path):
    true = replace(TRICYCLE, true=TRICYCLE.nominal)
    found = rnc.compare(true.system(tmp_path), true.log(0), "sensor")
    assert found.suspects == ()
    assert found.conclusion == "no number of the model explains the error: it is noise of the sensor"
    assert list(found.errors) == [1.0, 10.0, np.inf]  # the log has 30 s
    for error in found.errors.values():
        assert error.mean == pytest.approx(0.005 * np.sqrt(np.pi / 2), rel=0.05)  # of the noise (Rayleigh)
    # The rear wheel is not measured: it rolls in any case, and only its lateral row can slip.
    assert list(found.slip) == ["rolling(front)", "lateral(front)", "lateral(rear)"]


def _with_slip(log, seed):
    """The left wheel turns by a third more than it rolls, from 8 to 10 s and from 20 to 22 s."""
    parts = []
    for each in log:
        if each.name == "position(left_joint)":
            rate = 4 * signal(np.random.default_rng(seed))(each.time) + 2
            spins = ((each.time > 8) & (each.time < 10)) | ((each.time > 20) & (each.time < 22))
            more = np.cumsum(0.3 * np.where(spins, rate, 0.0)) * 0.02
            each = Channel("position", "left_joint", each.time, each.values + more[:, None])
        parts.append(each)
    return rnc.Log(parts)


def _late(log, name, by):
    return rnc.Log(Channel(each.quantity, each.of, each.time + by * (each.of == name), each.values) for each in log)


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize(("assumption", "name", "vehicle", "change", "spoil"), [
    ("radius", "radius of left", DIFFERENTIAL, {"rl": 0.105}, None),
    ("radius", "radius of front", TRICYCLE, {"r": 0.126}, None),
    ("place", "place of left_joint, right_joint along y", DIFFERENTIAL, {"track": 0.56}, None),
    ("encoder", "offset of fork_joint", TRICYCLE, {"offset fork_joint": 0.05}, None),
    ("sensor", "x of the sensor", TRICYCLE, {"sx": 1.0}, None),
    ("delay", "delay of the sensor", DIFFERENTIAL, {}, lambda log, seed: _late(log, "sensor", 0.2)),
    ("delay", "delay of fork_joint", TRICYCLE, {}, lambda log, seed: _late(log, "fork_joint", 0.3)),
    ("slip", "slip of rolling(left)", DIFFERENTIAL, {}, _with_slip),
    (None, None, DIFFERENTIAL, {}, None),
    (None, None, TRICYCLE, {}, None),
])  # fmt: skip
def test_the_assumption_that_fails_first_is_the_true_one(assumption, name, vehicle, change, spoil, seed, tmp_path):
    true = replace(vehicle, true={**vehicle.nominal, **change})
    log = true.log(seed)
    found = rnc.compare(true.system(tmp_path), log if spoil is None else spoil(log, seed), "sensor")
    first = found.first
    assert (first and first.assumption, first and first.name) == (assumption, name), found
    if name and change:
        assert first.value == pytest.approx(next(iter(change.values())), abs=3e-3)
        assert found.conclusion.startswith(f"the {name} fails first: ")


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
