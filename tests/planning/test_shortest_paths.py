"""Closed forms of Reeds and Shepp beside OMPL's."""

import numpy as np
import pytest
from ompl import base

from rnc_pin.planning.shortest_paths import reeds_shepp_words, word_length


def length_to(*pose):
    return word_length(reeds_shepp_words(*pose)[0])


def test_lengths_are_those_of_ompl():
    generator, space = np.random.default_rng(1), base.ReedsSheppStateSpace(1.0)
    begin, end = space.allocState(), space.allocState()
    begin.setXY(0.0, 0.0)
    begin.setYaw(0.0)
    for _ in range(300):
        x, y, heading = generator.uniform([-4.0, -4.0, -np.pi], [4.0, 4.0, np.pi])
        end.setXY(x, y)
        end.setYaw(heading)
        assert length_to(x, y, heading) == pytest.approx(space.distance(begin, end), abs=1e-6)
    assert length_to(0.0, 0.0, np.pi) == pytest.approx(np.pi)  # three arcs of a third of a half turn each
