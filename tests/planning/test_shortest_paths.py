"""Closed forms of Dubins and of Reeds and Shepp beside those of OMPL, and beside random words."""

import numpy as np
import pytest
from ompl import base

from rnc_pin.planning.shortest_paths import driven_pose, dubins_words, reeds_shepp_words, word_length


def dubins_length(*pose):
    return word_length(dubins_words(*pose)[0])


def reeds_shepp_length(*pose):
    return word_length(reeds_shepp_words(*pose)[0])


def test_lengths_are_those_of_ompl():
    generator = np.random.default_rng(1)
    for space, length in (
        (base.ReedsSheppStateSpace(1.0), reeds_shepp_length),
        (base.DubinsStateSpace(1.0), dubins_length),
    ):
        begin, end = space.allocState(), space.allocState()
        begin.setXY(0.0, 0.0)
        begin.setYaw(0.0)
        for _ in range(300):
            x, y, heading = generator.uniform([-4.0, -4.0, -np.pi], [4.0, 4.0, np.pi])
            end.setXY(x, y)
            end.setYaw(heading)
            assert length(x, y, heading) == pytest.approx(space.distance(begin, end), abs=1e-6)


def test_no_random_word_is_shorter_than_the_closed_forms():
    generator = np.random.default_rng(0)
    for _ in range(100):
        curvatures, lengths = generator.integers(-1, 2, 4), generator.uniform(-1.5, 1.5, 4)
        length = np.abs(lengths).sum()
        assert reeds_shepp_length(*driven_pose(list(zip(curvatures, lengths, strict=True)))) <= length + 1e-9
        assert dubins_length(*driven_pose(list(zip(curvatures, np.abs(lengths), strict=True)))) <= length + 1e-9
    assert reeds_shepp_length(0.0, 0.0, np.pi) == pytest.approx(np.pi)  # three arcs of a third of a half turn each
    assert dubins_length(0.0, 0.0, np.pi) == pytest.approx(
        7 * np.pi / 3
    )  # both tangent circles: 60, 300 and 60 degrees
