"""Forces on some outputs by some actuators, controllers of parts of the outputs, and the two phases of section 4.2."""

import runpy

import numpy as np
import pytest

import rnc_pin as rnc
from controlled_tasks import Cubic
from places import ROOT
from rnc_pin.control import JacobianTransposeController, PositionTracker, SplitController, effective_inertia
from rnc_pin.control.controller import Command
from rnc_pin.model.evaluation_results import Measurement
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
    M = effective_inertia(reduced, q, TIP, ON)
    for i in range(4):
        assert np.flatnonzero(command.T[i]).tolist() == sorted(places)
        here = reduced.at(q[i])
        drive, one = here.J2 @ here.B, reduced.at(q[i], v2[i]).measure()
        np.testing.assert_allclose(law.step(0.0, one, law.initial_state(one))[0].T, command.T[i], rtol=1e-9)
        for place in places:
            assert command.T[i, place] == pytest.approx(drive[TIP, place] @ asked.F[i])
        T = np.zeros(reduced.p)
        T[places] = drive[TIP][:, places].T @ [0.8, -1.9]
        moved = reduced.forward_dynamics(q[i], np.zeros(3), T) - reduced.forward_dynamics(q[i], np.zeros(3), 0 * T)
        np.testing.assert_allclose(M[i] @ moved[TIP], [0.8, -1.9], atol=1e-8)
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


class Part:
    """A controller that says what it sees."""

    def __init__(self, factor, **more):
        self.factor, self.more = factor, more

    def initial_state(self, measurement):
        return measurement.v2.shape

    def step(self, t, measurement, state):
        excess = 0.0 if measurement.force_deficit is None else measurement.force_deficit
        F = self.factor * measurement.x2 + t * measurement.v2 + excess
        return Command(F=F, **self.more), (*state, self.factor)


@pytest.mark.parametrize("batch", [(), (3,)])
def test_parts_see_and_command_outputs_of_their_own(batch):
    first, second = Part(2.0, v2_desired=np.array([5.0, 6.0])), Part(-3.0, x2_desired=np.array([7.0]))
    third = Part(0.5, x1_desired=np.array([8.0]), v2_desired=np.array([1.0]), x2_desired=np.array([2.0]))
    fourth = Part(0.7, x1_desired=np.array([9.0]))
    places = ([3, 0], [1], [4], [2])
    split = SplitController([*zip((first, second, third, fourth), map(np.array, places), strict=True)], 5)
    x2, v2, excess = np.random.default_rng(1).normal(size=(3, *batch, 5))
    factors = np.array([2.0, -3.0, 0.7, 2.0, 0.5])
    for given in (None, excess):
        m = Measurement(x2=x2, v2=v2, force_deficit=given)
        states = split.initial_state(m)
        assert states == ((*batch, 2), (*batch, 1), (*batch, 1), (*batch, 1))
        command, after = split.step(0.3, m, states)
        np.testing.assert_allclose(command.F, factors * x2 + 0.3 * v2 + (0.0 if given is None else given), rtol=1e-14)
        assert after == tuple((*state, part) for state, part in zip(states, (2.0, -3.0, 0.5, 0.7), strict=True))
        np.testing.assert_array_equal(command.v2_desired, np.broadcast_to([6, np.nan, np.nan, 5, 1], x2.shape))
        np.testing.assert_array_equal(command.x2_desired, np.broadcast_to([np.nan, 7, np.nan, np.nan, 2], x2.shape))
        assert command.x1_desired.tolist() == [8.0]
    said = split.describe()
    assert [part["outputs"] for part in said["parts"]] == [[3, 0], [1], [4], [2]]
    assert {part["type"] for part in said["parts"]} == {"Part"}
    for chosen, r, found in (
        (([0], [2]), 3, "[0, 2], expected each of 0 to 2"),
        (([0, 1], [1]), 2, "[0, 1, 1], expected each of 0 to 1"),
    ):
        with pytest.raises(rnc.ConfigurationError) as caught:
            SplitController([(first, np.array(each)) for each in chosen], r)
        assert str(caught.value) == f"the parts command outputs {found} once"


def test_the_hand_arrives_first_and_stays_while_the_platform_drives(tmp_path, monkeypatch, capsys):
    """Figure 7, by the script in ``examples``."""
    monkeypatch.chdir(tmp_path)
    script = runpy.run_path(str(ROOT / "examples" / "two_phases.py"), run_name="__main__")
    assert capsys.readouterr().out.strip()
    run, goal = script["run"], (-1.3, 0.0, 0.0)
    hand = np.linalg.norm(run.x2[:, :2], axis=1)
    platform = np.linalg.norm(run.x1 - goal[:2], axis=1) + np.abs(run.x2[:, 3] - goal[2])
    hand_arrived, all_arrived = (run.time[np.flatnonzero(error > 0.02)[-1] + 1] for error in (hand, platform))
    assert hand_arrived < all_arrived / 3
    assert hand[run.time > 4.0].max() < 0.02
    assert platform[-1] < 0.02
    assert np.abs(np.diff(run.x1[run.time < 4.0], axis=0)).max() < 1e-4  # the platform waited
