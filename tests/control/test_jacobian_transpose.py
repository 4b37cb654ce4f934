"""Forces on some outputs from actuators that are on, by the transpose of the Jacobian."""

import numpy as np
import pytest

import rnc_pin as rnc
from controlled_tasks import Cubic
from rnc_pin.control import JacobianTransposeController, PositionTracker, effective_inertia
from systems import random_states, space_robot

ON = ["joint_3", "joint_1"]
TIP = np.array([1, 0])


def test_forces_on_some_outputs_come_from_the_actuators_that_are_on():
    """By virtual work, on a batch; the others give nothing. What is moved is what those actuators feel."""
    reduced = space_robot()
    names = list(reduced.actuation.names)
    places = [names.index(name) for name in ON]
    q, v2 = (np.stack(each) for each in zip(*random_states(reduced, 4, seed=3, condition=30.0), strict=True))
    reference = Cubic([0.4, 0.9], [0.5, -0.8], [0.4, 0.3], [-0.7, 1.1])
    tracker = PositionTracker(reference, outputs=TIP)
    law = JacobianTransposeController(reduced, tracker, ON)
    m = reduced.at(q, v2).measure()
    state = law.initial_state(m)
    command, after = law.step(0.0, m, state)
    asked, learnt = tracker.step(0.0, m, state)
    assert after.time == learnt.time
    assert command.F is None
    np.testing.assert_array_equal(command.x2_desired, asked.x2_desired)
    M = law.effective_inertia(q)
    np.testing.assert_array_equal(M, effective_inertia(reduced, q, TIP, ON))
    for i in range(4):
        assert np.flatnonzero(command.T[i]).tolist() == sorted(places)
        here = reduced.at(q[i])
        drive = here.J2 @ here.B
        one = reduced.at(q[i], v2[i]).measure()
        np.testing.assert_allclose(law.step(0.0, one, law.initial_state(one))[0].T, command.T[i], rtol=1e-9)
        for place in places:
            assert command.T[i, place] == pytest.approx(drive[TIP, place] @ asked.F[i])
        T = np.zeros(reduced.p)
        T[places] = drive[TIP][:, places].T @ [0.8, -1.9]
        moved = (reduced.forward_dynamics(q[i], np.zeros(3), T) - reduced.forward_dynamics(q[i], np.zeros(3), 0 * T))[
            TIP
        ]
        np.testing.assert_allclose(M[i] @ moved, [0.8, -1.9], atol=1e-8)
    said = law.describe()
    assert (said["type"], said["active"]) == ("JacobianTransposeController", ON)
    assert said["tracker"] == tracker.describe()
    for active, words in (
        (["joint_3"], "1 active actuators cannot drive 2 outputs"),
        (["joint_3", "joint_1", "joint_3"], "active actuator 'joint_3' is named twice"),
        (["joint_1", "joint_3", "joint_3", "joint_1"], "active actuator 'joint_1' is named twice"),
        (["joint_1", "jount_1"], "no actuator 'jount_1'; did you mean 'joint_1'?"),
    ):
        with pytest.raises(rnc.ConfigurationError) as caught:
            JacobianTransposeController(reduced, tracker, active)
        assert str(caught.value).startswith(words)
    assert JacobianTransposeController(reduced, tracker, names).describe()["active"] == names
