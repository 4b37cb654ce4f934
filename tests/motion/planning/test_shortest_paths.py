"""Closed forms of Reeds and Shepp beside OMPL's."""

import numpy as np
import pytest
from ompl import base

from rnc_pin.motion.planning.shortest_paths import reeds_shepp_words, word_length


def length_to(x, y, heading):
    """Length of the shortest word, and all words end at the pose."""
    words = reeds_shepp_words(x, y, heading)
    for word in words:
        place, turned = 0.0, 0.0
        for curvature, length in word:
            turn = 1j * curvature * length
            place += np.exp(1j * turned) * length * ((np.exp(turn) - 1.0) / turn if turn else 1.0)
            turned += turn.imag
        assert abs(place - x - 1j * y) + abs(np.exp(1j * turned) - np.exp(1j * heading)) < 1e-12
    return word_length(words[0])


def test_lengths_are_those_of_ompl():
    generator, space = np.random.default_rng(1), base.ReedsSheppStateSpace(1.0)
    begin, end = space.allocState(), space.allocState()
    begin.setXY(0.0, 0.0)
    begin.setYaw(0.0)
    for digits in [9, 0] * 150:  # whole numbers are ends of the ranges of formulas
        x, y, heading = generator.uniform([-4.0, -4.0, -np.pi], [4.0, 4.0, np.pi]).round(digits)
        end.setXY(x, y)
        end.setYaw(heading)
        assert length_to(x, y, heading) == pytest.approx(space.distance(begin, end), abs=1e-6)
    assert length_to(0.0, 0.0, np.pi) == pytest.approx(np.pi)  # three arcs of a third of a half turn each
