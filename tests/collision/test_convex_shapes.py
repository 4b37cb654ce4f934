"""Hulls of meshes with more edges at a corner than coal takes."""

import numpy as np
import pytest

from rnc_pin.collision.convex_shapes import hull_of

ANGLES = np.linspace(0.0, 2 * np.pi, 400, endpoint=False)
RING = np.column_stack([np.cos(ANGLES), np.sin(ANGLES), 0 * ANGLES])


def test_a_drum_of_many_corners_keeps_its_shape():
    """Its flat faces are fans about one corner at first."""
    hull = hull_of(np.vstack([RING, RING + np.array([0.0, 0.0, 2.0])]), "drum")
    assert hull.num_points == 800
    assert hull.computeVolume() == pytest.approx(2.0 * 200 * np.sin(2 * np.pi / 400), rel=1e-9)


def test_the_tip_of_a_fine_cone_gets_a_box_that_contains_it():
    hull = hull_of(np.vstack([RING, [[0.0, 0.0, 1.0]]]), "cone")
    assert hull.num_points == 8
    assert hull.computeVolume() == pytest.approx(4.0)
