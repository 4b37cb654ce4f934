"""Settings that nobody gives are those of the documentation."""

from types import SimpleNamespace

import numpy as np
import pytest

import rnc_pin as rnc
from controlled_tasks import limited_sliders
from rnc_pin.control import (
    ChainedStabilizer,
    ComputedTorque,
    JointLimits,
    PositionGains,
    Posture,
    ReducingOutputController,
    SingularityDistance,
    UnicycleStabilizer,
    UnknownMass,
    VelocityGains,
)
from rnc_pin.planning import Hold


def test_settings_that_nobody_gives_are_those_of_the_documentation():
    """Round numbers that users have come to rely on, each as its owner describes it."""
    reduced, task = limited_sliders((-1.0, 1.0)), SimpleNamespace(redundant=np.arange(1), redundant_coordinates=None)
    assert Posture(task, Hold([0.0])).describe()["k"] == 1.0
    assert JointLimits(reduced, task).describe() == {"type": "JointLimits", "k": 0.1, "zone": [pytest.approx(0.2)]}
    assert SingularityDistance(reduced, task).describe()["k"] == 0.1
    one = SimpleNamespace(r=1, reducing=SimpleNamespace(coordinates=None))
    follow = ReducingOutputController(one, Hold([0.0]))
    assert follow.describe() == {"type": "ReducingOutputController", "k2": 2.0}
    torque = {"type": "ComputedTorque", "k": 20.0, "target": follow.describe()}
    assert ComputedTorque(one, follow).describe() == torque
    chain = {"type": "ChainedStabilizer", "n": 3, "k": 0.5, "rate": 1.5, "max_input": 1000.0}
    assert ChainedStabilizer(3).describe() == chain
    stabilizer = UnicycleStabilizer(np.zeros(3), np.arange(2)).describe()
    rates = {"begin": 0.0, "k": 0.5, "rate": 1.5, "tolerance": 0.002, "ramp_time": 1.0, "max_speed": [1.0, 1.0]}
    assert stabilizer == {"type": "UnicycleStabilizer", "goal": [0.0, 0.0, 0.0], **rates}
    assert UnknownMass("wrist").unit == 1.0
    gains = VelocityGains.normalised(3.0)
    assert (gains.k, gains.beta, gains.sigma, gains.dead_zone) == (12.0, 12.0, 0.1, 0.0)
    five = SimpleNamespace(at=lambda q: SimpleNamespace(H=np.array([[[5.0]]])))
    for dt, rate in ((0.01, 20.0), (0.05, 4.0)):
        gains = VelocityGains.scaled(five, np.zeros(2), dt)
        assert (gains.k, gains.beta, gains.sigma, gains.dead_zone) == (pytest.approx([5.0 * rate]), gains.k, 0.1, 0.0)
    with pytest.raises(rnc.InfeasibleError, match="at least 4/s need a bandwidth of 4 rad/s"):
        VelocityGains.scaled(five, np.zeros(2), 0.05 * (1 + 1e-9))
    for made in (PositionGains.normalised(5.0), PositionGains.scaled(np.array([[[5.0]]]), 0.01)):
        assert (made.gamma, made.sigma, made.dead_zone) == (8.0, 0.1, 0.0)
        square = made.k1 * 8.0**4 + made.k2 * 8.0**2
        np.testing.assert_allclose(2 * made.k2 * 8.0**3, 3.0 * square)
        assert made.beta == 5.0
        assert square == pytest.approx(5.0 * (144.0 if made.k1.ndim == 0 else 800.0))
