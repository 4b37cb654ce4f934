"""The tractor with trailers: what its constraints leave, and how it turns."""

import numpy as np
import pytest

from textbook_systems import tractor_trailers


@pytest.mark.parametrize("n", [0, 1, 2, 5])
def test_a_tractor_with_n_trailers(n):
    reduced = tractor_trailers(n)
    assert (reduced.n, reduced.m, reduced.r) == (4 + n, 2 + n, 2)
    assert not reduced.dropped_rows


def test_trailers_turn_as_their_kinematics_say():
    """``thetadot_i = v_(i-1) sin(theta_(i-1) - theta_i) / L`` with ``v_i = v_(i-1) cos(theta_(i-1) - theta_i)``."""
    reduced = tractor_trailers(3)
    generator = np.random.default_rng(0)
    for _ in range(5):
        steering, *hitches = generator.uniform(-0.8, 0.8, 4)
        joints = {"front_steering": steering, **{f"hitch_{i}": hitch for i, hitch in enumerate(hitches, start=1)}}
        q = reduced.robot.configuration({"root_joint": generator.uniform(-2, 2, 3), **joints})
        u = 1.3
        v = reduced.terms(q, np.array([u, 0.4])).v
        rate, speed = u * np.tan(steering), u
        assert v[2] == pytest.approx(rate)
        for number, hitch in enumerate(hitches, start=1):
            turn = v[reduced.robot.velocity_indices(f"hitch_{number}")][0]
            following = -speed * np.sin(hitch)  # hitch = theta_i - theta_(i-1)
            assert turn == pytest.approx(following - rate)
            rate, speed = following, speed * np.cos(hitch)
