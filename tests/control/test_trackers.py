"""Controllers (8)-(9) in rate-free form, and (10): what the lemmas promise, in own loops as in simulations."""

from dataclasses import replace

import numpy as np
import pytest

import rnc_pin as rnc
from controlled_tasks import ARM_START, Cubic, gains_along, learnt_over, space_robot_task
from rnc_pin.control import (
    PositionGains,
    ReducingOutputController,
    VelocityGains,
    VelocityTarget,
    design_position_gains,
)
from rnc_pin.control.trackers import PositionState, PositionTracker, TrackerState, VelocityTracker
from rnc_pin.model.evaluation_results import Measurement
from simple_controllers import Counting, Memoryless
from systems import space_robot_in_joints


def in_joints():
    reduced = space_robot_in_joints()
    q0 = reduced.robot.configuration(ARM_START)
    return reduced, q0, reduced.at(q0).outputs()[1]


def test_error_converges_to_a_ball_that_shrinks_as_the_gains_grow():
    """Lemma 2."""
    reduced, q0, x2 = in_joints()
    balls = []
    for k in (8.0, 24.0):
        waves = rnc.planning.Harmonic(x2, 0.3 * np.ones(3), [0.1, 0.13, 0.16], ramp=2.0)
        tracker = PositionTracker(waves, PositionGains(k1=k, k2=3 * k, gamma=4.0, beta=k))
        run = rnc.simulate(reduced, tracker, q0, 6.0, 0.004)
        balls.append(np.linalg.norm(run.x2_desired - run.x2, axis=1)[run.time > 4.0].max())
    assert balls[1] < 0.6 * balls[0]


def test_position_error_decays_exponentially_from_far_away():
    """Lemma 2: at the rate that the closed form of the loop says, over and over, adaptation or not."""
    reduced, q0, x2 = in_joints()
    rate, gains = 3.0, design_position_gains(lambda q: reduced.at(q).H, q0, 0.002)
    for beta in (gains.beta, 1e-12):
        tracker = PositionTracker(rnc.planning.Hold(x2 + np.array([0.05, -0.04, 0.06])), replace(gains, beta=beta))
        run = rnc.simulate(reduced, tracker, q0, 2.4, 0.002)
        # The loop oscillates as it decays: the largest error of each 0.6 s is what counts.
        peaks = np.linalg.norm(run.x2_desired - run.x2, axis=1)[:1200].reshape(4, 300).max(axis=1)
        assert (peaks[1:] < peaks[:-1] * np.exp(-0.5 * rate * 0.6)).all(), peaks


def test_rate_free_form_is_the_papers_laws_with_rates():
    """(8)-(9) with the dot the scan lost, integrated by brute force with edot known, against ours."""
    generator = np.random.default_rng(3)
    g = PositionGains(k1=3.0, k2=5.0, gamma=2.0, beta=4.0, sigma=0.3)
    reference = rnc.planning.Harmonic([0.1, -0.2], [0.4, 0.3], [0.3, 0.2], ramp=0.5)
    phase = generator.uniform(0, 6, 2)

    def actual(t):
        return np.array([0.1, -0.2]) + 0.2 * np.sin(1.7 * t + phase) - 0.2 * np.sin(phase)

    def error(t):
        return reference.at(t).position - actual(t)

    def error_rate(t):
        return reference.at(t).velocity - 0.2 * 1.7 * np.cos(1.7 * t + phase)

    end, steps = 2.0, 4_000
    h = end / steps
    w, f, A, B = np.zeros(2), np.zeros(2), np.zeros((2, 2)), np.zeros((2, 2))

    def rates(t, w, f, A, B):
        e, edot, point = error(t), error_rate(t), reference.at(t)
        qf = edot + g.k2 * e / (g.k1 * g.gamma) - w / g.gamma
        return (
            -2 * g.gamma * w + g.gamma**2 * edot,
            -g.sigma * f + g.beta * qf,
            -g.sigma * A + g.beta * np.outer(qf, point.acceleration),
            -g.sigma * B + g.beta * np.outer(qf, point.velocity),
        )

    for k in range(steps):  # explicit midpoint
        t, state = k * h, (w, f, A, B)
        middle = [x + h / 2 * d for x, d in zip(state, rates(t, *state), strict=True)]
        w, f, A, B = (x + h * d for x, d in zip(state, rates(t + h / 2, *middle), strict=True))
    point = reference.at(end)
    F = A @ point.acceleration + B @ point.velocity + f + g.k1 * g.gamma**2 * w + g.k2 * g.gamma**2 * error(end)

    tracker = PositionTracker(reference, g)
    # The filter starts at rest at the present error, which is zero here, as the brute force does.
    state = tracker.initial_state(rnc.Measurement(x2=actual(0.0)))
    for k in range(2001):
        command, state = tracker.step(k * end / 2000, rnc.Measurement(x2=actual(k * end / 2000)), state)
    np.testing.assert_allclose(command.F, F, rtol=5e-3, atol=5e-3)


WHERE, ANGULAR = np.array([2, 0]), np.array([False, True])


@pytest.mark.parametrize("sigma", [0.0, 0.6])
@pytest.mark.parametrize("zone", [0.0, np.array([0.4, 0.1])])
@pytest.mark.parametrize("clipped", [False, True])
@pytest.mark.parametrize("first", [False, True])
def test_a_position_tracker_takes_the_step_of_its_law_output_by_output(sigma, zone, clipped, first):
    """With e held over the sample; what stays is the learnt force of the paper, not its part by integration."""
    generator, reference = np.random.default_rng(8), Cubic([0.1, 2.9], [0.5, -0.8], [0.4, 0.3], [-0.7, 1.1])
    gains = PositionGains(np.array([3.0, 5.0]), np.array([2.0, 7.0]), 1.7, np.array([4.0, 0.9]), sigma, zone)
    tracker = PositionTracker(reference, gains, WHERE, ANGULAR, [0.3, -2.0])
    x2, excess = generator.uniform(-1, 1, (7, 3)), generator.uniform(-1, 1, (7, 3))
    x2[:, 0] += 2.9
    size = ((7, 2), (7, 2, 5), (7, 2, 5))
    begin = PositionState(None if first else 1.1, *(generator.uniform(-1, 1, each) for each in size))
    t = 1.1 if first else 1.4
    elapsed = 0.0 if first else t - 1.1
    command, after = tracker.step(t, Measurement(x2=x2, force_deficit=excess if clipped else None), begin)
    now = reference.at(t)
    e = now.position - x2[:, WHERE]
    e[:, 1] = np.angle(np.exp(1j * e[:, 1]))
    z = (begin.z + 1.7**2 * e) * np.exp(-2 * 1.7 * elapsed) - 1.7**2 * e
    np.testing.assert_allclose(after.z, z, rtol=1e-12, atol=1e-13)
    w = z + 1.7**2 * e
    q = gains.k2 / gains.k1 / 1.7 * e - w / 1.7
    by = np.concatenate([[1.0], now.acceleration, now.velocity])
    rate = np.concatenate([[0], now.jerk, now.acceleration])
    kinds = set()
    for i, j in np.ndindex(7, 2):
        primed = begin.learnt[i, j] - begin.by_error[i, j]
        step = gains.beta[j] * e[i, j]
        source = gains.beta[j] * q[i, j] * by - step * rate - sigma * step * by
        new = learnt_over(elapsed, sigma, primed, source) + step * by
        quiet = abs(e[i, j]) < np.broadcast_to(zone, 2)[j]
        stays = quiet or (clipped and excess[i, WHERE[j]] * ((new - begin.learnt[i, j]) @ by) > 0)
        kinds.add(bool(stays))
        np.testing.assert_allclose(after.learnt[i, j], begin.learnt[i, j] if stays else new, rtol=1e-11, atol=1e-12)
        np.testing.assert_allclose(after.by_error[i, j], step * by, rtol=1e-12)
        F = after.learnt[i, j] @ by + gains.k1[j] * 1.7**2 * w[i, j] + gains.k2[j] * 1.7**2 * e[i, j] + [0.3, -2.0][j]
        np.testing.assert_allclose(command.F[i, j], F, rtol=1e-11)
    assert (kinds, after.time) == ({False, True} if clipped or np.any(zone) else {False}, t)
    for name, value in (("v2_desired", now.velocity), ("x2_desired", now.position)):
        np.testing.assert_array_equal(getattr(command, name)[:, WHERE], np.broadcast_to(value, (7, 2)))
        assert np.isnan(getattr(command, name)[:, 1]).all()


def test_a_position_tracker_starts_at_rest_with_nothing_learnt():
    """With a moving reference and an error; the first force is that of the error alone."""
    reference = Cubic([0.1, 2.9], [0.5, -0.8], [0.4, 0.3], [-0.7, 1.1])
    gains = PositionGains(np.array([3.0, 5.0]), np.array([2.0, 7.0]), 1.7, np.array([4.0, 0.9]), 0.3)
    tracker = PositionTracker(reference, gains, WHERE, ANGULAR, [0.3, -2.0])
    measured = Measurement(x2=np.random.default_rng(1).uniform(-1, 1, (3, 4, 3)))
    state = tracker.initial_state(measured)
    assert state.learnt.shape == (3, 4, 2, 5)
    assert not state.learnt.any()
    e = reference.at(0.0).position - measured.x2[..., WHERE]
    e[..., 1] = np.angle(np.exp(1j * e[..., 1]))
    np.testing.assert_allclose(state.z, -(1.7**2) * e, rtol=1e-13)
    assert state.time is None
    command, _ = tracker.step(0.0, measured, state)
    np.testing.assert_allclose(command.F, gains.k2 * 1.7**2 * e + [0.3, -2.0], rtol=1e-11)
    said = tracker.describe()
    assert said == {"type": "PositionTracker", "gains": gains.describe(), "gravity_compensation": [0.3, -2.0]}


def oscillation(r):
    """Return a velocity target that never rests: every joint at a frequency of its own."""
    reference = rnc.planning.Harmonic(np.zeros(r), 0.4 * np.ones(r), 0.2 + 0.07 * np.arange(r), ramp=1.0)
    return Memoryless(lambda t, _: VelocityTarget(v2=reference.at(t).velocity, v2_dot=reference.at(t).acceleration))


def test_velocity_error_converges_to_a_ball_that_shrinks_as_the_gains_grow():
    """Lemma 3."""
    reduced = space_robot_in_joints()
    q0 = reduced.robot.configuration({"joint_2": 1.2, "joint_3": -0.8})
    balls = []
    for k in (40.0, 120.0, 360.0):
        tracker = VelocityTracker(oscillation(reduced.r), VelocityGains(k=k, beta=k))
        run = rnc.simulate(reduced, tracker, q0, 8.0, 0.004, v2_0=np.array([0.5, -0.5, 0.5]))
        error = np.linalg.norm(run.v2_desired - run.v2, axis=1)
        balls.append(error[run.time > 4.0].max())
        assert balls[-1] < 0.2 * error[0]
    assert balls[1] < 0.6 * balls[0]
    assert balls[2] < 0.6 * balls[1]


def test_small_steps_are_the_papers_laws():
    """One short step from given gains: C, D and g move as (10) says, leak included."""
    generator = np.random.default_rng(1)
    r, h = 3, 1e-7
    g, C, D = generator.normal(size=r), generator.normal(size=(r, r)), generator.normal(size=(r, r * r))
    v2, v2d, v2d_dot = generator.normal(size=(3, r))

    target = Memoryless(lambda *_: VelocityTarget(v2d, v2d_dot))
    tracker = VelocityTracker(target, VelocityGains(k=7.0, beta=3.0, sigma=0.4))
    state = TrackerState(1.0, np.column_stack([g, C, D]), None)
    command, new = tracker.step(1.0 + h, rnc.Measurement(v2=v2), state)
    e, w = v2d - v2, np.kron(v2, v2d)
    np.testing.assert_allclose((new.g - g) / h, -0.4 * g + 3.0 * e, atol=1e-5)
    np.testing.assert_allclose((new.C - C) / h, -0.4 * C + 3.0 * np.outer(e, v2d_dot), atol=1e-5)
    np.testing.assert_allclose((new.D - D) / h, -0.4 * D + 3.0 * np.outer(e, w), atol=1e-5)
    np.testing.assert_allclose(command.F, C @ v2d_dot + D @ w + g + 7.0 * e, atol=1e-5)


def test_a_tuned_tracker_is_what_one_would_write_by_hand():
    reduced, kinematic, q0 = space_robot_task()
    tracker = rnc.tuned_tracker(reduced, kinematic, q0, 2.0, dt=0.004, design=rnc.control.GainDesign(adaptation=3.0))
    expected = gains_along(reduced, kinematic, q0, 2.0, dt=0.004, step=0.05)
    np.testing.assert_allclose(tracker.gains.k, expected.k)
    np.testing.assert_allclose(tracker.gains.beta, 3.0 * expected.k)
    design = rnc.control.GainDesign(bandwidth=20.0)
    slower = rnc.tuned_tracker(reduced, oscillation(reduced.r), q0, 2.0, 0.004, along=kinematic, design=design)
    np.testing.assert_allclose(slower.gains.k / slower.gains.k[0], expected.k / expected.k[0])
    with pytest.raises(rnc.InfeasibleError, match="sample faster"):
        rnc.tuned_tracker(reduced, kinematic, q0, 2.0, dt=0.2)


def said(v2, v2_dot):
    """A velocity target that is written down, and a state that counts."""
    return Counting(lambda *_: VelocityTarget(v2, v2_dot, np.array([7.0]), np.array([8.0, 9.0])))


@pytest.mark.parametrize("sigma", [0.0, 0.6])
@pytest.mark.parametrize("zone", [0.0, np.array([0.3, 0.05])])
@pytest.mark.parametrize("clipped", [False, True])
def test_a_velocity_tracker_takes_the_step_of_its_law_output_by_output(sigma, zone, clipped):
    """Learnt is from the error that the step along the regressor w leaves: ``x = s beta (e - |w|^2 x / k)``."""
    generator, k, beta, held = np.random.default_rng(5), np.array([3.0, 7.0]), np.array([11.0, 4.0]), [0.7, -1.3]
    v2, v2d, v2d_dot, excess = generator.uniform(-1, 1, (4, 6, 2))
    learnt = generator.normal(size=(6, 2, 7))
    tracker = VelocityTracker(said(v2d, v2d_dot), VelocityGains(k, beta, sigma, zone), held)
    measured = Measurement(v2=v2, force_deficit=excess if clipped else None)
    command, after = tracker.step(2.35, measured, TrackerState(2.0, learnt, 5))
    assert (after.time, after.target) == (2.35, 6)
    kinds = set()
    for i, j in np.ndindex(6, 2):
        w = np.concatenate([[1.0], v2d_dot[i], np.kron(v2[i], v2d[i])])
        error = v2d[i, j] - v2[i, j]
        seen = np.sign(error) * max(abs(error) - np.broadcast_to(zone, 2)[j], 0.0)
        s = learnt_over(0.35, sigma, 0.0, 1.0)
        added = s * beta[j] * seen / (1 + s * beta[j] * (w @ w) / k[j])
        expected = learnt[i, j] * np.exp(-0.35 * sigma) + added * w
        rests = seen == 0.0 or (clipped and np.sign(excess[i, j]) == np.sign(error))
        kinds.add(rests)
        if rests:
            expected = learnt[i, j]
        np.testing.assert_allclose([after.g[i, j], *after.C[i, j], *after.D[i, j]], expected, rtol=1e-12, atol=1e-13)
        np.testing.assert_allclose(command.F[i, j], expected @ w + k[j] * error + held[j], rtol=1e-12)
    assert kinds == ({False, True} if clipped or np.any(zone) else {False})
    assert command.v2_desired is v2d
    assert (command.x1_desired.tolist(), command.x2_desired.tolist()) == ([7.0], [8.0, 9.0])
    assert command.T is command.estimates is command.prediction_error is None


def test_a_velocity_tracker_starts_with_nothing_learnt_in_the_shape_of_what_it_sees():
    tracker = VelocityTracker(said(None, None), gravity_compensation=[2.0, -1.0])
    state = tracker.initial_state(Measurement(v2=np.ones((4, 3, 2))))
    assert (state.time, state.target) == (None, 5)
    assert [each.shape for each in (state.g, state.C, state.D)] == [(4, 3, 2), (4, 3, 2, 2), (4, 3, 2, 4)]
    assert not state.learnt.any()
    assert tracker.describe() == {
        "type": "VelocityTracker",
        "gains": {"k": 10.0, "beta": 10.0, "sigma": 0.1},
        "gravity_compensation": [2.0, -1.0],
        "target": {"type": "Counting"},
    }
    assert VelocityTracker(said(None, None)).describe()["gravity_compensation"] == 0.0


def test_gains_of_modes_are_gains_of_outputs_that_combine_the_others():
    """The tracker with modes S on joints moves as the tracker with single gains on the outputs ``S^T x2``."""
    robot = rnc.Robot.from_urdf("space_robot.urdf", gravity=(0, -9.81, 0))
    joints = robot.joint_names
    system = rnc.NonholonomicSystem(robot, [], joints)
    S = np.linalg.cholesky(np.cov(np.random.default_rng(2).normal(size=(4, 12)))) + 0.1
    names = [f"mode_{k}" for k in range(4)]
    combined = rnc.Output(lambda q: S.T @ q, lambda q: S.T, lambda q, v: np.zeros((4, 4)), names)
    in_joints, in_modes = system.reduce([rnc.JointPosition(name) for name in joints]), system.reduce([combined])
    q0 = robot.configuration({"joint_2": 1.2, "joint_3": -0.8})
    k, beta, zone = np.array([60.0, 90.0, 40.0, 70.0]), np.array([200.0, 100.0, 300.0, 50.0]), 0.01
    goal = q0 + np.array([0.3, -0.4, 0.5, 0.2])
    swing = rnc.planning.MinimumJerk(q0, goal, duration=1.0)
    turned = rnc.planning.MinimumJerk(S.T @ q0, S.T @ goal, duration=1.0)
    force = np.array([3.0, -2.0, 1.0, 0.5])
    gains = VelocityGains(k, beta, 0.2, zone, S), VelocityGains(k, beta, 0.2, np.abs(S.T) @ np.full(4, zone))
    of_modes = VelocityTracker(ReducingOutputController(in_joints, swing, k2=2.0), gains[0], force)
    target = ReducingOutputController(in_modes, turned, k2=2.0)
    alone = VelocityTracker(target, gains[1], np.linalg.solve(S, force))
    limited = [rnc.ReducedPlant(each, actuator_limits=True) for each in (in_joints, in_modes)]
    one = rnc.simulate(in_joints, of_modes, q0, 1.0, plant=limited[0])
    other = rnc.simulate(in_modes, alone, q0, 1.0, plant=limited[1])
    np.testing.assert_allclose(one.q, other.q, rtol=1e-7, atol=1e-8)
    np.testing.assert_allclose(one.T, other.T, rtol=1e-5, atol=1e-5)
    assert of_modes.describe()["gains"]["modes"] == S.tolist()
