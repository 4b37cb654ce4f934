"""Gains that are scaled to an inertia, beside their closed forms."""

import re
from types import SimpleNamespace

import numpy as np
import pytest

import rnc_pin as rnc
from controlled_tasks import space_robot_task
from rnc_pin.control import GainDesign, PositionGains, VelocityGains, design_position_gains, design_velocity_gains
from rnc_pin.control.gain_design import OUTER_GAINS, adaptation_rate, fastest_rate, gravity_loads, inertia_of_modes


def test_paper_preset():
    gains = VelocityGains()
    assert (gains.k, gains.beta, gains.sigma) == (10.0, 10.0, 0.1)
    outer = OUTER_GAINS["paper"]
    assert (outer.k21, outer.alpha, outer.k, outer.rate) == (0.0, 1.0, 0.1, 0.2)
    assert (outer.tolerance, outer.max_speed) == (0.015, (0.3, 0.3))  # the goal of figure 7 is met within 0.02 m


def test_the_preset_of_the_paper_reads_no_inertia():
    assert design_velocity_gains(None, None, 0.01, GainDesign("paper")) == VelocityGains()
    assert design_position_gains(None, None, 0.01, GainDesign("paper")) == PositionGains()
    for design in (design_velocity_gains, design_position_gains):
        with pytest.raises(rnc.ConfigurationError, match="preset 'scald' is not known; did you mean 'scaled'"):
            design(None, None, 0.01, GainDesign("scald"))


UNEVEN = np.array([[[1.0, 0.6], [0.6, 4.0]], [[4.0, 0.0], [0.0, 16.0]]])


def test_gains_scaled_to_an_inertia_are_those_of_the_window():
    reduced = SimpleNamespace(at=lambda q: SimpleNamespace(H=UNEVEN[: len(q)]))
    region, D = np.zeros((2, 3)), np.array([2.0, 8.0])
    for dt, delay, fastest in ((0.002, 0.0, 100.0), (0.002, 0.011, np.pi / 4 / 0.012), (0.01, 0.02, 20.0)):
        gains = design_velocity_gains(reduced, region, dt, GainDesign(adaptation=3.0, delay=delay, slowest=2.0))
        np.testing.assert_allclose(gains.k, 0.35 * fastest * D, rtol=1e-12)
        np.testing.assert_allclose(gains.beta, 3.0 * gains.k, rtol=1e-12)
        assert gains.sigma == 0.1
    for bandwidth in (4.0 * (1 + 1e-12), 35.0 * (1 - 1e-12)):
        design = GainDesign(bandwidth=bandwidth, adaptation=1.0, slowest=2.0)
        assert design_velocity_gains(reduced, region, 0.002, design).k == pytest.approx(bandwidth * D)
    for bandwidth in (3.999, 35.001):
        with pytest.raises(rnc.ConfigurationError, match="rad/s is outside the window 4 to 35"):
            design_velocity_gains(reduced, region, 0.002, GainDesign(bandwidth=bandwidth, slowest=2.0))
    one = design_velocity_gains(reduced, region, 0.002, GainDesign(adaptation=1.0), outputs=np.array([1]))
    assert one.k == pytest.approx([0.5 * 100.0 * 8.0])
    second = SimpleNamespace(at=lambda q: SimpleNamespace(H=UNEVEN[1:][: len(q)]))
    alone = design_velocity_gains(second, np.zeros(3), 0.002, GainDesign(adaptation=1.0))
    assert alone.k == pytest.approx([400.0, 1600.0])
    with pytest.raises(rnc.ConfigurationError, match=r"delay of a loop has to be a time \[s\], not negative"):
        design_velocity_gains(reduced, region, 0.002, GainDesign(delay=-1e-9))


def test_position_gains_scaled_to_an_inertia_are_those_of_the_closed_form():
    """``omega^2 = gamma / (dt + 2 delay)`` of the slowest motion, and the fade asked for, along a typical diagonal."""
    D, gamma, rate = np.array([2.0, 8.0]), 8.0, 3.0

    def designed(dt, delay=0.0):
        return design_position_gains(lambda q: UNEVEN, None, dt, GainDesign(delay=delay))

    for dt, delay in ((0.001, 0.0), (0.001, 0.002)):
        gains = designed(dt, delay)
        square = gamma / (dt + 2 * delay) * 0.35
        np.testing.assert_allclose(gains.k1 * gamma**4 + gains.k2 * gamma**2, square * D)
        np.testing.assert_allclose(2 * gains.k2 * gamma**3, rate * square * D)
        assert (gains.gamma, gains.sigma, gains.beta.tolist()) == (gamma, 0.1, D.tolist())
    # The window: omega at least four times the rate of the quickest, ``sqrt(2)`` of a typical one.
    edge = gamma * 0.35 / ((4 * rate) ** 2 * 2.0)
    designed(edge * (1 - 1e-9))
    words = r"every 0.00982\d* s allows oscillations of 16.9 rad/s, a decay rate of 3/s with gamma 8 needs more"
    with pytest.raises(rnc.InfeasibleError, match=words):
        designed(edge + 1e-4)


def test_gains_describe_themselves():
    plain = {"k1": 10.0, "k2": 10.0, "gamma": 2.0, "beta": 10.0, "sigma": 0.1}
    assert PositionGains().describe() == plain
    assert PositionGains(dead_zone=0.02).describe() == {**plain, "dead_zone": 0.02}
    assert VelocityGains(dead_zone=np.array([0.0, 0.1])).describe()["dead_zone"] == [0.0, 0.1]


def test_gains_of_modes_have_the_rates_of_the_window_where_single_outputs_have_none():
    """Joints of an arm at 100 Hz: one gain for each joint fits no sampling, gains of modes are ``bandwidth H``."""
    robot = rnc.Robot.from_example("ur5_robot")
    reduced = rnc.NonholonomicSystem(robot, [], robot.joint_names).reduce()
    q0 = robot.configuration({"shoulder_lift_joint": -1.2, "elbow_joint": 1.5, "wrist_2_joint": 1.0})
    with pytest.raises(rnc.InfeasibleError, match="no velocity gains suit this region"):
        design_velocity_gains(reduced, q0, 0.01, GainDesign(overrides={"k": 5.0}))
    gains = design_velocity_gains(reduced, q0, 0.01)
    K = gains.modes @ np.diag(gains.k) @ gains.modes.T
    np.testing.assert_allclose(K, 20.0 * reduced.at(q0).H, rtol=1e-9, atol=1e-12)
    region = q0 + np.random.default_rng(3).uniform(-0.3, 0.3, (9, robot.nq))
    gains = design_velocity_gains(reduced, region, 0.01)
    K = gains.modes @ np.diag(gains.k) @ gains.modes.T
    rates = np.linalg.eigvals(np.linalg.solve(reduced.at(region).H, np.broadcast_to(K, (9, 6, 6)))).real
    assert rates.max() == pytest.approx(20.0)
    assert rates.min() >= 4.0
    asked = design_velocity_gains(reduced, region, 0.01, design=GainDesign(bandwidth=10.0))
    np.testing.assert_allclose(asked.modes @ np.diag(asked.k) @ asked.modes.T, K * (asked.k / gains.k)[0], rtol=1e-9)
    with pytest.raises(rnc.InfeasibleError, match="no velocity gains suit this region"):
        design_velocity_gains(reduced, region, 0.01, GainDesign(overrides={"k": 5.0}))  # a gain of single outputs


def test_the_typical_inertia_is_the_geometric_mean_of_both_means():
    """``X P^-1 X = Q``; of a single matrix it is that matrix."""
    roots = np.random.default_rng(8).normal(size=(5, 4, 4)) + 2.0 * np.eye(4)
    H = roots @ roots.mT
    found = inertia_of_modes(H)
    X = found.modes @ np.diag(found.weights) @ found.modes.T
    P, Q = H.mean(axis=0), np.linalg.inv(np.linalg.inv(H).mean(axis=0))
    np.testing.assert_allclose(X @ np.linalg.solve(P, X), Q, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found.eigenvalues, np.sort(np.linalg.eigvals(np.linalg.solve(X, H)).real, axis=1))
    np.testing.assert_allclose(inertia_of_modes(H[:1]).eigenvalues, np.ones((1, 4)))


@pytest.mark.parametrize(("dt", "delay"), [(0.002, 0.0), (0.01, 0.0), (0.01, 0.02), (0.002, 0.05), (0.01, 0.15)])
def test_default_adaptation_under_gravity_leaves_a_phase_margin(dt, delay):
    """Phase of ``rate (s + a) / s^2 exp(-age s)`` where its magnitude is one, for all rates that the design accepts."""
    age, a = delay + dt / 2, adaptation_rate(True, dt, delay)
    for rate in np.linspace(4.0, max(4.0, fastest_rate(dt, delay)), 50):
        w = np.sqrt((rate**2 + np.sqrt(rate**4 + 4.0 * (rate * a) ** 2)) / 2.0)
        assert abs(rate * (1j * w + a) / (1j * w) ** 2) == pytest.approx(1.0)
        assert np.degrees(np.arctan(w / a) - w * age) > 20.0
    assert (adaptation_rate(False, dt, delay), adaptation_rate(True, 0.01, 0.0)) == (1.0, 20.0)


def test_gravity_loads_the_outputs_that_lift_something():
    arm = rnc.Robot.from_urdf("space_robot.urdf", gravity=(0, -9.81, 0))
    lifting = rnc.NonholonomicSystem(arm).reduce()
    level = rnc.NonholonomicSystem(rnc.Robot.from_urdf("space_robot.urdf")).reduce()
    q = arm.configuration({"joint_1": 0.3})
    assert gravity_loads(lifting, q)
    assert not gravity_loads(level, q)
    robot = rnc.Robot.from_urdf("space_robot.urdf", gravity=(0, 0, -9.81))
    assert not gravity_loads(rnc.NonholonomicSystem(robot).reduce(), q)  # all axes are vertical


def test_refused_gains_tell_when_where_and_which_rows_are_nearly_singular():
    """An arm that is straight at 0.5 s: E of its tip loses rank there, as the determinant of its Jacobian does."""
    robot = rnc.Robot.from_urdf("space_robot.urdf", lock={"platform": 0.0, "joint_1": 0.0})
    reduced = rnc.NonholonomicSystem(robot, [], robot.joint_names).reduce([rnc.FramePosition("tip", "xy")])
    times = np.linspace(0.0, 1.0, 11)
    region = np.array([robot.configuration({"joint_2": 0.4, "joint_3": 0.5 - t + 1e-4}) for t in times])
    with pytest.raises(rnc.InfeasibleError) as caught:
        design_velocity_gains(reduced, region, 0.002, times=times)
    error, index = caught.value, int(np.argmin(np.abs(region[:, -1])))
    assert error.time == times[index]
    np.testing.assert_array_equal(error.q, region[index])
    assert error.rows == ("tip_x", "tip_y")
    values = np.linalg.svd(reduced.at(region[index]).scaled_stack, compute_uv=False)
    assert error.singular_value == pytest.approx(values[-1])
    assert f"nearly singular at t = {error.time:.2f} s at q = [0.4, " in str(error)
    assert str(error).endswith("nearer goals, another start or path, or other outputs")
    assert len(str(error)) < 400
    assert "sample faster" not in str(error)


def test_refused_gains_advise_a_sampling_period_only_if_it_has_gains():
    reduced, kinematic, q0 = space_robot_task()
    _, region = rnc.kinematic_rollout(reduced, kinematic, q0, 6.0, 0.1)
    with pytest.raises(rnc.InfeasibleError, match=r"sample faster, at least every ([\d.]+) s") as caught:
        design_velocity_gains(reduced, region, 0.2)
    period = float(re.search(r"at least every ([\d.]+) s", str(caught.value))[1])
    design_velocity_gains(reduced, region, 0.95 * period)
    with pytest.raises(rnc.InfeasibleError):
        design_velocity_gains(reduced, region, 1.1 * period)
    with pytest.raises(rnc.InfeasibleError, match="the delay is too long for any sampling"):
        design_velocity_gains(reduced, region, 0.002, GainDesign(delay=0.5))
