"""Planned paths of a car beside the closed forms of Dubins and of Reeds and Shepp, and these closed forms."""

import numpy as np
import pytest
from ompl import base

from benchmarks.path_lengths import driven_length, forward_plan, turning_plan
from benchmarks.planned_models import car
from rnc_pin.planning.shortest_paths import driven_pose, dubins_length, reeds_shepp_length


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


@pytest.mark.parametrize("pose", [(3.0, 1.0, -0.5), (1.0, 2.0, 2.5)])
def test_the_limit_of_a_small_effort_weight_is_the_path_of_dubins(pose):
    plan = forward_plan(car(), pose, starts=1, finer=[(40, 0.01)])
    assert driven_length(plan) == pytest.approx(dubins_length(*pose), rel=1e-2)
    assert plan.info.verification.violation < 1e-2


def test_the_fastest_motion_with_bounded_turning_rate_takes_the_length_of_reeds_and_shepp():
    pose = (0.85, 1.84, 0.27)
    plan = turning_plan(pose, nodes=30, solutions=1)
    assert plan.duration == pytest.approx(reeds_shepp_length(*pose), rel=2e-3)
    assert plan.info.verification.violation < 1e-2
