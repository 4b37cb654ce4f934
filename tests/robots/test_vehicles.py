"""The vehicles' URDFs: what moves, what the constraints leave, and where gaits take them."""

import numpy as np
import pytest

import rnc_pin as rnc
from rnc_pin.applications.scenario.execution import execute
from rnc_pin.applications.scenario.scenario import Scenario
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


def test_the_gait_of_the_snakeboard_carries_it_away_and_its_mirror_image_back():
    def way(amplitude):
        options = {
            "simulation.duration": 3.0,
            "simulation.dt": 0.01,
            "reference.primary.harmonic.amplitude": amplitude,
            "plots": {},
        }
        run = execute(Scenario.load("snakeboard", options)).trajectory
        assert np.abs(run.T).max() < 1.0
        return run.x1[-1]

    forth, back = way([0.7, 0.3, -0.3]), way([0.7, -0.3, 0.3])
    assert forth[0] > 0.1
    # Turned round by half a turn, the board with its trucks the other way is the same machine.
    np.testing.assert_allclose(back[0], -forth[0], atol=1e-6)
    still = way([0.7, 0.0, 0.0])
    assert abs(still[0]) < 1e-9


def test_the_unicycle_rolls_as_far_as_its_wheel_turns():
    run = execute(Scenario.load("unicycle", {"simulation.duration": 2.0, "comparisons": {}, "plots": {}})).trajectory
    robot = rnc.Robot.from_urdf("unicycle.urdf", base="planar")
    wheel = robot.velocity_indices("axle")
    np.testing.assert_allclose(run.v[:, 0], 0.25 * run.v[:, wheel][:, 0], atol=1e-12)
    assert np.abs(run.v[:, 0]).max() > 0.05
    np.testing.assert_allclose(run.v[:, 1], 0.0, atol=1e-12)
