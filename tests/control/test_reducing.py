"""Reducing outputs follow a reference."""

from types import SimpleNamespace

import numpy as np
import pytest

import rnc_pin as rnc
from controlled_tasks import (
    Cubic,
    gains_along,
)
from rnc_pin.control import (
    ReducingOutputController,
    VelocityTracker,
)
from rnc_pin.math.coordinates import Coordinates
from rnc_pin.model.measurement import Measurement
from rnc_pin.planning import Hold, MinimumJerk


def test_reducing_outputs_alone_on_a_free_flyer():
    """Seven joints of a free-floating arm follow; nobody looks after the base, which turns."""
    fingers = {"panda_finger_joint1": 0.0, "panda_finger_joint2": 0.0}
    robot = rnc.Robot.from_example("panda", base="free", gravity=(0, 0, 0), lock=fingers)
    joints = [f"panda_joint{i}" for i in range(1, 8)]
    system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("root_joint")], joints)
    reduced = system.reduce([rnc.JointPosition(joint) for joint in joints], [rnc.FrameYaw("panda_link0")])
    q0 = robot.configuration({"panda_joint2": -0.5, "panda_joint4": -2.0, "panda_joint6": 1.6})
    _, x2 = reduced.at(q0).outputs()
    kinematic = ReducingOutputController(reduced, MinimumJerk(x2, x2 + 0.3, 1.0), k2=2.0)
    gains = gains_along(reduced, kinematic, q0, 1.0, dt=0.001)
    run = rnc.simulate(reduced, VelocityTracker(kinematic, gains), q0, 1.2, 0.001)
    assert max(rnc.summarize(run)["final_error"].values()) < 5e-3
    assert run.constraint_residual.max() < 1e-9
    assert np.abs(run.x1[-1] - run.x1[0]).max() > 1e-2


@pytest.mark.parametrize("monitored", [False, True])
def test_reducing_outputs_follow_at_their_gains(monitored):
    """Angles by the shorter way; batches; what is monitored is said and moves nothing."""
    reference, k2 = Cubic([0.1, 2.9], [0.5, -0.8], [0.4, 0.3], [-0.7, 1.1]), np.array([1.7, 0.6])
    reduced = SimpleNamespace(r=2, reducing=SimpleNamespace(coordinates=Coordinates([False, True])))
    aside = (np.array([2, 0]), Hold([0.5, 0.6])) if monitored else None
    law = ReducingOutputController(reduced, reference, k2, aside)
    generator = np.random.default_rng(1)
    m = Measurement(x1=np.zeros((4, 3)), x2=generator.uniform(-2, 2, (4, 2)), v2=generator.normal(size=(4, 2)))
    target, state = law.step(0.3, m, law.initial_state(m))
    point = reference.at(0.3)
    error = point.position - m.x2
    error[:, 1] = np.angle(np.exp(1j * error[:, 1]))
    np.testing.assert_allclose(target.v2, point.velocity + k2 * error, rtol=1e-12)
    np.testing.assert_allclose(target.v2_dot, point.acceleration + k2 * (point.velocity - m.v2), rtol=1e-12)
    np.testing.assert_array_equal(target.x2, np.tile(point.position, (4, 1)))
    assert state is target.estimates is target.prediction_error is None
    if monitored:
        np.testing.assert_array_equal(target.x1, np.tile([0.6, np.nan, 0.5], (4, 1)))
    else:
        assert target.x1 is None
    with pytest.raises(rnc.ConfigurationError, match="the reducing reference has 3 values for 2 outputs"):
        ReducingOutputController(reduced, Hold(np.zeros(3)))
    assert law.describe() == {"type": "ReducingOutputController", "k2": [1.7, 0.6]}
