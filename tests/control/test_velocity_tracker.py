"""Controllers (10) and (12): what the lemmas promise, in a loop of one's own as in the simulation."""

import numpy as np
import pytest

import rnc_pin as rnc
from controlled_tasks import wide
from rnc_pin.control import (
    PositionGains,
    ReducingOutputController,
    RedundancyController,
    TrackerState,
    VelocityGains,
    VelocityTarget,
    VelocityTracker,
)
from rnc_pin.integrators import LieRungeKutta4
from rnc_pin.planning import Harmonic, Hold, MinimumJerk
from rnc_pin.plants.reduced import ConstrainedDynamics
from systems import mobile_manipulator, random_states, space_robot, space_robot_in_joints
from tolerances import FINITE_DIFFERENCE, ROUNDING

START = {"joint_1": -0.4, "joint_2": 1.8, "joint_3": -1.1}


def space_robot_task(duration=6.0, k3=2.0, k21=2.0):
    reduced = space_robot()
    q0 = reduced.robot.configuration(START)
    _, x2 = reduced.outputs(q0)
    task = rnc.Task.of(reduced, ["tip_x", "tip_y"], ["joint_1"])
    kinematic = RedundancyController(
        task, MinimumJerk(x2[:2], [1.15, 0.6], duration), MinimumJerk([0.0], [0.4], duration), k3, k21
    )
    return reduced, kinematic, q0


def scaled(reduced, kinematic, q0, duration, dt=0.002):
    _, region = rnc.kinematic_rollout(reduced, kinematic, q0, duration, 0.1)
    return VelocityGains.scaled(reduced, region, dt)


class Oscillation:
    """A velocity target that never rests: every joint at a frequency of its own."""

    def __init__(self, reduced):
        r = reduced.r
        self.reference = Harmonic(np.zeros(r), 0.4 * np.ones(r), 0.2 + 0.07 * np.arange(r), ramp=1.0)

    def initial_state(self, measurement):
        return None

    def step(self, t, measurement, state):
        point = self.reference.at(t)
        return VelocityTarget(v2=point.velocity, v2_dot=point.acceleration), None


# ---------------------------------------------------------------------- (12)


@pytest.mark.parametrize("k21", [0.0, 2.0])
def test_redundancy_controller_gives_the_vertical_rate_that_it_wants(k21):
    """(12) in the paper's words: A3 v21d + A4 v22d = x1d_dot + k3 (x1d - x1)."""
    reduced, kinematic, _ = space_robot_task(k21=k21)
    for q, v2 in random_states(reduced, 5, seed=2):
        measured = reduced.measure(q, v2)
        target, _ = kinematic.step(1.3, measured, None)
        x1d, x21d = kinematic.vertical.at(1.3), kinematic.primary.at(1.3)
        wanted = x1d.velocity + 2.0 * (x1d.position - measured.x1)
        np.testing.assert_allclose(measured.A_star @ target.v2, wanted, atol=ROUNDING)
        np.testing.assert_allclose(
            target.v2[:2], x21d.velocity + k21 * (x21d.position - measured.x2[:2]), atol=ROUNDING
        )


def test_rate_of_the_target_is_exact():
    """Along a motion of the model, v2d_dot is the derivative of v2d."""
    reduced, kinematic, _ = space_robot_task()
    integrator, h = LieRungeKutta4(reduced.robot), 1e-4
    T = np.array([0.3, -0.2, 0.1])

    def rate(q, y):
        v, v2_dot, _ = reduced.flow(q, y, T)
        return v, v2_dot

    for q, v2 in random_states(reduced, 5, seed=3, condition=30.0):
        targets = []
        for k in (-2, -1, 1, 2):
            p, y = integrator.step(rate, q, v2, k * h)
            targets.append(kinematic.step(1.3 + k * h, reduced.measure(p, y), None)[0].v2)
        difference = (targets[0] - 8 * targets[1] + 8 * targets[2] - targets[3]) / (12 * h)
        exact = kinematic.step(1.3, reduced.measure(q, v2), None)[0].v2_dot
        np.testing.assert_allclose(exact, difference, atol=FINITE_DIFFERENCE * (1 + np.abs(exact).max()))


def test_redundancy_controller_takes_any_square_partition():
    """The mobile manipulator: the distance is held by the drive while hand and heading have goals of their own."""
    robot = rnc.Robot.from_urdf("mobile_manipulator.urdf", base="planar")
    drive = [rnc.FrameForce("base", "x"), rnc.FrameTorque("base", "z"), "joint_1", "joint_2"]
    reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("axle")], drive).reduce(
        [rnc.FramePosition("tip", "xy"), rnc.FrameSpeed("base"), rnc.FrameYaw("base")], [rnc.Distance("base", "tip")]
    )
    q0 = robot.configuration({"joint_1": 0.4, "joint_2": 1.2})
    x1, x2 = reduced.outputs(q0)
    task = rnc.Task.of(reduced, ["tip_x", "tip_y", "base_yaw"], ["base_speed_x"])
    goal = x2[[0, 1, 3]] + np.array([1.0, 0.3, 0.2])
    kinematic = RedundancyController(task, MinimumJerk(x2[[0, 1, 3]], goal, 5.0), Hold(x1), 2.0, 2.0)
    run = rnc.simulate(reduced, VelocityTracker(kinematic, scaled(reduced, kinematic, q0, 5.0)), q0, 6.0)
    errors = rnc.summarize(run)["final_error"]
    assert set(errors) == {"tip_x", "tip_y", "base_yaw", "distance_base_tip"}
    assert max(errors.values()) < 0.01
    assert run.x2[-1, 2] > 0.5  # the platform drove along


@pytest.mark.parametrize("posture", [False, True])
def test_wide_a4_reaches_the_vertical_rate_at_the_least_cost(posture):
    reduced, kinematic, _ = wide(weights=np.array([1.0, 4.0]), posture=posture)
    for q, v2 in random_states(reduced, 5, seed=4, condition=30.0):
        measured = reduced.measure(q, v2)
        v22 = kinematic.step(1.0, measured, None)[0].v2[2:]
        x1d = kinematic.vertical.at(1.0)
        A4 = measured.A_star[:, 2:]
        wanted = (
            x1d.velocity
            + 2.0 * (x1d.position - measured.x1)
            - measured.A_star[:, :2] @ kinematic.step(1.0, measured, None)[0].v2[:2]
        )
        np.testing.assert_allclose(A4 @ v22, wanted, atol=ROUNDING * 10)
        z = kinematic.secondary(1.0, measured)[0] if posture else np.zeros(2)
        null = np.array([-A4[0, 1], A4[0, 0]])
        assert abs(null @ (np.array([1.0, 4.0]) * (v22 - z))) < 1e-9 * (1 + np.abs(v22).max())  # stationary


def test_rate_of_the_wide_target_is_exact():
    reduced, kinematic, _ = wide(weights=np.array([1.0, 4.0]), posture=True)
    integrator, h = LieRungeKutta4(reduced.robot), 1e-4
    T = np.array([0.3, -0.2, 0.1, 0.2])

    def rate(q, y):
        v, v2_dot, _ = reduced.flow(q, y[:4], T)
        return v, np.concatenate([v2_dot, y[:4]])

    for q, v2 in random_states(reduced, 4, seed=5, condition=20.0):
        targets = []
        for k in (-2, -1, 1, 2):
            p, y = integrator.step(rate, q, np.concatenate([v2, np.zeros(4)]), k * h)
            targets.append(kinematic.step(1.3 + k * h, reduced.measure(p, y[:4], y[4:]), None)[0].v2)
        difference = (targets[0] - 8 * targets[1] + 8 * targets[2] - targets[3]) / (12 * h)
        exact = kinematic.step(1.3, reduced.measure(q, v2), None)[0].v2_dot
        np.testing.assert_allclose(exact, difference, atol=FINITE_DIFFERENCE * (1 + np.abs(exact).max()))


def test_posture_uses_the_freedom_that_is_left():
    ends = {}
    for posture in (False, True):
        reduced, kinematic, q0 = wide(posture=posture)
        _, path = rnc.kinematic_rollout(reduced, kinematic, q0, 5.0, 0.05)
        x1, x2 = reduced.outputs(path)
        np.testing.assert_allclose(x1[-1], kinematic.vertical.at(9.0).position, atol=1e-3)
        np.testing.assert_allclose(x2[-1, :2], kinematic.primary.at(9.0).position, atol=1e-3)
        ends[posture] = abs(x2[-1, 3] - x2[0, 3])
    assert ends[True] < 0.2 * ends[False]


def test_redundancy_controller_refuses_what_it_cannot_do():
    reduced = mobile_manipulator()
    task = rnc.Task.of(reduced, ["tip_x", "tip_y", "base_yaw"], ["base_speed_x"])  # one redundant, three vertical
    with pytest.raises(rnc.ConfigurationError, match=r"needs as many redundant as vertical outputs, found 1 .* and 3"):
        RedundancyController(task, Hold(np.zeros(3)), Hold(np.zeros(3)))
    reduced = space_robot()
    task = rnc.Task.of(reduced, ["tip_x", "tip_y"], ["joint_1"])
    with pytest.raises(rnc.ConfigurationError, match="the primary reference has 3 values for 2 outputs"):
        RedundancyController(task, Hold(np.zeros(3)), Hold(np.zeros(1)))


def test_redundancy_controller_says_where_it_is_singular():
    reduced, kinematic, q0 = space_robot_task()
    measured = reduced.measure(q0, np.zeros(3))
    flat = measured._replace(A_star=measured.A_star * [[1.0, 1.0, 0.0]])
    with pytest.raises(rnc.SingularityError, match="A4 is singular") as caught:
        kinematic.step(1.0, flat, None)
    assert caught.value.rows == ("platform", "joint_1")
    np.testing.assert_array_equal(caught.value.q, q0)
    assert caught.value.condition == pytest.approx(1e300)
    nearly = measured._replace(A_star=np.array([[1.0, 1.0, -1e-12]]), q=None)
    with pytest.raises(rnc.SingularityError, match="A4 is singular") as caught:
        kinematic.step(1.0, nearly, None)
    assert caught.value.q.size == 0
    assert caught.value.condition == pytest.approx(1e12)


def test_task_refuses_wrong_names():
    reduced = space_robot()
    with pytest.raises(rnc.ConfigurationError, match="no reducing output 'tip_z'; did you mean 'tip_"):
        rnc.Task.of(reduced, ["tip_z", "tip_y"], ["joint_1"])
    with pytest.raises(rnc.ConfigurationError, match="'joint_1' is neither primary nor redundant"):
        rnc.Task.of(reduced, ["tip_x", "tip_y"], [])
    with pytest.raises(rnc.ConfigurationError, match="duplicate output"):
        rnc.Task.of(reduced, ["tip_x", "tip_y", "joint_1"], ["joint_1"])


# ---------------------------------------------------------------------- (10)


def test_velocity_error_converges_to_a_ball_that_shrinks_as_the_gains_grow():
    """Lemma 3."""
    reduced = space_robot_in_joints()
    q0 = reduced.robot.configuration({"joint_2": 1.2, "joint_3": -0.8})
    balls = []
    for k in (40.0, 120.0, 360.0):
        tracker = VelocityTracker(Oscillation(reduced), VelocityGains(k=k, beta=k))
        run = rnc.simulate(reduced, tracker, q0, 8.0, 0.004, v2_0=np.array([0.5, -0.5, 0.5]))
        error = np.linalg.norm(run.v2_desired - run.v2, axis=1)
        balls.append(error[run.time > 4.0].max())
        assert balls[-1] < 0.2 * error[0]
    assert balls[1] < 0.6 * balls[0]
    assert balls[2] < 0.6 * balls[1]


def test_velocity_error_decays_exponentially_from_far_away():
    """Lemma 3: at first as fast as feedback over inertia says, adaptation or not."""
    reduced = space_robot_in_joints()
    q0 = reduced.robot.configuration({"joint_2": 1.2, "joint_3": -0.8})
    k = 100.0
    slowest = k / np.linalg.eigvalsh(reduced.inertia(q0))[-1]
    still = ReducingOutputController(reduced, Hold(reduced.outputs(q0)[1]), k2=0.0)
    run = rnc.simulate(reduced, VelocityTracker(still, VelocityGains(k, k)), q0, 4.0 / slowest, v2_0=0.1 * np.ones(3))
    error = np.linalg.norm(run.v2, axis=1)
    assert error[-1] < 0.2 * error[0]


def test_adaptation_learns():
    """Without adaptation the same gains leave a larger error."""
    reduced = space_robot_in_joints()
    q0 = reduced.robot.configuration({"joint_2": 1.2, "joint_3": -0.8})
    late = {}
    for beta in (1e-12, 40.0):
        tracker = VelocityTracker(Oscillation(reduced), VelocityGains(k=40.0, beta=beta))
        run = rnc.simulate(reduced, tracker, q0, 6.0, 0.004)
        late[beta] = np.linalg.norm(run.v2_desired - run.v2, axis=1)[run.time > 3.0].mean()
    assert late[40.0] < 0.6 * late[1e-12]


@pytest.mark.parametrize("dt", [0.002, 0.01])
def test_adaptation_is_stable_when_the_regressor_is_large(dt):
    """beta |w|^2 dt far above 2, where explicit Euler diverges."""
    reduced = space_robot_in_joints()
    q0 = reduced.robot.configuration({"joint_2": 1.2, "joint_3": -0.8})

    class Fast(Oscillation):
        def __init__(self, reduced):
            self.reference = Harmonic(np.zeros(3), 1.5 * np.ones(3), [1.0, 0.8, 1.2], ramp=1.0)

    tracker = VelocityTracker(Fast(reduced), VelocityGains(k=60.0, beta=1e4))
    run = rnc.simulate(reduced, tracker, q0, 3.0, dt)
    regressor = (run.v2_desired**2).sum(axis=1) * (run.v2**2).sum(axis=1)
    assert 1e4 * regressor.max() * dt > 20
    assert np.abs(run.v2_desired - run.v2).max() < 0.5 * np.abs(run.v2_desired).max()


def test_small_steps_are_the_papers_laws():
    """One short step from given gains: C, D and g move as (10) says, leak included."""
    generator = np.random.default_rng(1)
    r, h = 3, 1e-7
    g, C, D = generator.normal(size=r), generator.normal(size=(r, r)), generator.normal(size=(r, r * r))
    v2, v2d, v2d_dot = generator.normal(size=(3, r))

    class Target:
        def initial_state(self, measurement):
            return None

        def step(self, t, measurement, state):
            return VelocityTarget(v2d, v2d_dot), None

    tracker = VelocityTracker(Target(), VelocityGains(k=7.0, beta=3.0, sigma=0.4))
    state = TrackerState(1.0, g, C, D, None)
    command, new = tracker.step(1.0 + h, rnc.Measurement(v2=v2), state)
    e, w = v2d - v2, np.kron(v2, v2d)
    np.testing.assert_allclose((new.g - g) / h, -0.4 * g + 3.0 * e, atol=1e-5)
    np.testing.assert_allclose((new.C - C) / h, -0.4 * C + 3.0 * np.outer(e, v2d_dot), atol=1e-5)
    np.testing.assert_allclose((new.D - D) / h, -0.4 * D + 3.0 * np.outer(e, w), atol=1e-5)
    np.testing.assert_allclose(command.F, C @ v2d_dot + D @ w + g + 7.0 * e, atol=1e-5)


def test_leak_is_exact_over_any_time():
    """With no error the gains decay as exp(-sigma t), in one step or in many."""
    reduced = space_robot_in_joints()
    q = reduced.robot.configuration({"joint_2": 1.2})
    still = ReducingOutputController(reduced, Hold(reduced.outputs(q)[1]))
    tracker = VelocityTracker(still, VelocityGains(sigma=0.7))
    measured = reduced.measure(q, np.zeros(3))
    start = tracker.initial_state(measured)._replace(time=0.0, g=np.ones(3))
    one = tracker.step(2.0, measured, start)[1]
    many = start
    for t in np.linspace(0.1, 2.0, 20):
        many = tracker.step(float(t), measured, many)[1]
    np.testing.assert_allclose(one.g, np.exp(-1.4), atol=ROUNDING)
    np.testing.assert_allclose(many.g, one.g, atol=ROUNDING)


def test_time_that_runs_backwards_is_refused():
    reduced, kinematic, q0 = space_robot_task()
    tracker = VelocityTracker(kinematic)
    measured = reduced.measure(q0, np.zeros(3))
    _, state = tracker.step(1.0, measured, tracker.initial_state(measured))
    with pytest.raises(rnc.InputError, match="backwards"):
        tracker.step(0.5, measured, state)


# ---------------------------------------------------------------------- gains


def test_paper_preset():
    gains = VelocityGains.paper()
    assert (gains.k, gains.beta, gains.sigma) == (10.0, 10.0, 0.1)


def test_scaled_gains_keep_the_loop_inside_what_sampling_allows():
    reduced, kinematic, q0 = space_robot_task()
    _, region = rnc.kinematic_rollout(reduced, kinematic, q0, 6.0, 0.1)
    gains = VelocityGains.scaled(reduced, region, dt=0.002)
    rates = np.linalg.eigvals(np.linalg.solve(reduced.inertia(region), np.diag(gains.k)[None])).real
    assert rates.max() * 0.002 <= 0.2 + ROUNDING
    assert rates.min() > 4.0


def test_normalised_gains_need_a_bound_on_the_inertia_alone():
    """Every rate of the loop is at least the bandwidth wherever the bound holds, whatever H is."""
    reduced, kinematic, q0 = space_robot_task()
    _, region = rnc.kinematic_rollout(reduced, kinematic, q0, 6.0, 0.2)
    H = reduced.inertia(region)
    rows = np.abs(H).sum(axis=-1).max(axis=0)  # Gershgorin: diag(rows) - H is positive semidefinite
    for bound in (np.linalg.eigvalsh(H).max(), rows):
        gains = VelocityGains.normalised(bound, bandwidth=5.0, adaptation=2.0)
        K = np.diag(np.broadcast_to(gains.k, reduced.r))
        assert np.linalg.eigvals(np.linalg.solve(H, np.broadcast_to(K, H.shape))).real.min() > 5.0 - ROUNDING
        np.testing.assert_allclose(gains.beta, 2.0 * gains.k)
    for bound in (0.0, [1.0, -1.0], np.nan):
        with pytest.raises(rnc.ConfigurationError, match="a bound on the inertia has to be positive"):
            VelocityGains.normalised(bound)


@pytest.mark.parametrize("lighter", [1.0, 3.0, 30.0, 1e4])
def test_normalised_position_gains_fade_at_their_rate_from_the_bound_down(lighter):
    gains, inertia = PositionGains.normalised(20.0, gamma=8.0, rate=3.0), 20.0 / lighter
    k1, k2 = gains.k1 * gains.gamma**4, gains.k2 * gains.gamma**2
    # H s^2 e = -k1 gamma^2 w - k2 gamma^2 e, w (s + 2 gamma) = gamma^2 s e
    roots = np.roots([inertia, 2 * gains.gamma * inertia, k1 + k2, 2 * gains.gamma * k2])
    assert roots.real.max() < -3.0
    with pytest.raises(rnc.ConfigurationError, match="gamma has to be above twice the rate"):
        PositionGains.normalised(20.0, gamma=6.0, rate=3.0)


def test_an_empty_window_is_said_with_its_figures():
    reduced, kinematic, q0 = space_robot_task()
    _, region = rnc.kinematic_rollout(reduced, kinematic, q0, 6.0, 0.1)
    with pytest.raises(rnc.ConfigurationError, match=r"no velocity gains suit this region: .* need a bandwidth of"):
        VelocityGains.scaled(reduced, region, dt=0.2)
    with pytest.raises(rnc.ConfigurationError, match="outside the window"):
        VelocityGains.scaled(reduced, region, dt=0.002, bandwidth=1e6)


# ---------------------------------------------------------------------- protocol


def test_scaled_gains_track_the_space_robot():
    reduced, kinematic, q0 = space_robot_task(duration=3.0)
    run = rnc.simulate(reduced, VelocityTracker(kinematic, scaled(reduced, kinematic, q0, 3.0)), q0, 4.0)
    summary = rnc.summarize(run)
    assert max(summary["final_error"].values()) < 0.001
    assert max(summary["max_error"].values()) < 0.005
    assert summary["constraint_residual_max"] < 1e-9


def test_the_papers_gains_stay_bounded_on_the_space_robot():
    reduced, kinematic, q0 = space_robot_task(k21=0.0)
    summary = rnc.summarize(rnc.simulate(reduced, VelocityTracker(kinematic), q0, 8.0, 0.004))
    assert max(summary["max_error"].values()) < 0.5
    assert summary["final_error"]["platform"] < 0.02


def test_a_loop_of_ones_own_is_the_simulation_to_the_bit():
    """Controllers keep nothing to themselves, so a plain loop gives the same numbers; so does resuming half-way."""
    reduced, kinematic, q0 = space_robot_task(duration=1.0)
    tracker = VelocityTracker(kinematic, scaled(reduced, kinematic, q0, 1.0))
    run = rnc.simulate(reduced, tracker, q0, 0.4, 0.002)
    integrator, q, plant = LieRungeKutta4(reduced.robot), q0, ConstrainedDynamics(reduced)
    y = plant.start(q, np.zeros(reduced.n))
    state = tracker.initial_state(reduced.measure(q, np.zeros(3)))
    for sample in range(201):
        measurement = reduced.measured(q, plant.seen(q, y).v)
        command, state = tracker.step(sample * 0.002, measurement, state)
        T = reduced.allocate(q, command.F)
        np.testing.assert_array_equal(T, run.T[sample])
        np.testing.assert_array_equal(q, run.q[sample])
        seen, y = plant.settled(q, y)
        q, y = integrator.step(plant.rate(T), q, y, 0.002, plant.first_slope(seen, T))


def test_stepping_twice_from_one_state_gives_one_answer():
    reduced, kinematic, q0 = space_robot_task()
    tracker = VelocityTracker(kinematic)
    measured = reduced.measure(q0, 0.1 * np.ones(3))
    state = tracker.initial_state(measured)._replace(time=0.0)
    first, second = (tracker.step(0.1, measured, state) for _ in range(2))
    np.testing.assert_array_equal(first[0].F, second[0].F)
    for a, b in zip(first[1][:4], second[1][:4], strict=True):
        np.testing.assert_array_equal(a, b)


def test_a_batch_of_robots_is_one_call():
    reduced, kinematic, _ = space_robot_task()
    tracker = VelocityTracker(kinematic, VelocityGains(k=np.array([10.0, 20.0, 5.0]), beta=4.0))
    q, v2 = (np.stack(each) for each in zip(*random_states(reduced, 4), strict=True))
    measured = reduced.measure(q, v2)
    state = tracker.initial_state(measured)
    for t in (0.5, 0.6):
        command, state = tracker.step(t, measured, state)
    assert command.F.shape == (4, 3)
    for i in range(4):
        one = reduced.measure(q[i], v2[i])
        alone = tracker.initial_state(one)
        for t in (0.5, 0.6):
            single, alone = tracker.step(t, one, alone)
        np.testing.assert_allclose(single.F, command.F[i], atol=ROUNDING * (1 + np.abs(single.F).max()))


def test_reducing_outputs_alone_on_a_free_flyer():
    """Seven joints of a free-floating arm follow; nobody looks after the base, which turns."""
    fingers = {"panda_finger_joint1": 0.0, "panda_finger_joint2": 0.0}
    robot = rnc.Robot.from_example("panda", base="free", gravity=(0, 0, 0), lock=fingers)
    joints = [f"panda_joint{i}" for i in range(1, 8)]
    system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("root_joint")], joints)
    reduced = system.reduce([rnc.JointPosition(joint) for joint in joints], [rnc.FrameYaw("panda_link0")])
    q0 = robot.configuration({"panda_joint2": -0.5, "panda_joint4": -2.0, "panda_joint6": 1.6})
    _, x2 = reduced.outputs(q0)
    kinematic = ReducingOutputController(reduced, MinimumJerk(x2, x2 + 0.3, 1.0), k2=2.0)
    gains = scaled(reduced, kinematic, q0, 1.0, dt=0.001)
    run = rnc.simulate(reduced, VelocityTracker(kinematic, gains), q0, 1.2, 0.001)
    assert max(rnc.summarize(run)["final_error"].values()) < 5e-3
    assert run.constraint_residual.max() < 1e-9
    assert np.abs(run.x1[-1] - run.x1[0]).max() > 1e-2


def test_a_tuned_tracker_is_what_one_would_write_by_hand():
    reduced, kinematic, q0 = space_robot_task()
    tracker = rnc.tuned_tracker(reduced, kinematic, q0, 2.0, dt=0.004, step=0.1, adaptation=3.0)
    expected = scaled(reduced, kinematic, q0, 2.0, dt=0.004)
    np.testing.assert_allclose(tracker.gains.k, expected.k)
    np.testing.assert_allclose(tracker.gains.beta, 3.0 * expected.k)
    slower = rnc.tuned_tracker(reduced, Oscillation(reduced), q0, 2.0, 0.004, along=kinematic, step=0.1, bandwidth=20.0)
    np.testing.assert_allclose(slower.gains.k / slower.gains.k[0], expected.k / expected.k[0])
    with pytest.raises(rnc.InfeasibleError, match="sample faster"):
        rnc.tuned_tracker(reduced, kinematic, q0, 2.0, dt=0.2)
