"""Controllers of parts of the outputs, and the two phases of section 4.2 together."""

import runpy

import numpy as np
import pytest

import rnc_pin as rnc
from places import ROOT
from rnc_pin.control import SplitController
from rnc_pin.control.controller import Command
from rnc_pin.model.reduced_kinematics import Measurement


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
    generator = np.random.default_rng(1)
    x2, v2, excess = generator.normal(size=(3, *batch, 5))
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


EXAMPLE = ROOT / "examples" / "two_phases.py"


def test_the_hand_arrives_first_and_stays_while_the_platform_drives(tmp_path, monkeypatch, capsys):
    """Figure 7, by the script in ``examples``."""
    monkeypatch.chdir(tmp_path)
    script = runpy.run_path(str(EXAMPLE), run_name="__main__")
    assert capsys.readouterr().out.strip()
    run, goal = script["run"], (-1.3, 0.0, 0.0)
    hand = np.linalg.norm(run.x2[:, :2], axis=1)
    platform = np.linalg.norm(run.x1 - goal[:2], axis=1) + np.abs(run.x2[:, 3] - goal[2])
    hand_arrived, all_arrived = (run.time[np.flatnonzero(error > 0.02)[-1] + 1] for error in (hand, platform))
    assert hand_arrived < all_arrived / 3
    assert hand[run.time > 4.0].max() < 0.02
    assert platform[-1] < 0.02
    assert np.abs(np.diff(run.x1[run.time < 4.0], axis=0)).max() < 1e-4  # the platform waited
