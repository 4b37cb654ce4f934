"""Grip as a limit on multipliers: closed forms, what slows down with time, and references that are slowed."""

import numpy as np
import pytest

import rnc_pin as rnc
import systems
from rnc_pin.planning import MinimumJerk, Slowed, TaskReference, ViaPoints
from rnc_pin.scenario.run import plan
from rnc_pin.simulation import grip_along, within_grip

G = 9.81


@pytest.fixture(scope="module")
def sleigh():
    return systems.sleigh()


def test_the_side_force_of_a_sleigh_in_a_steady_turn_is_m_v_w(sleigh):
    """Of 2 kg, its center of mass 0.3 m ahead of the blade; a torque keeps the turn steady."""
    grip = rnc.Grip(sleigh, friction=0.5)
    q = sleigh.robot.configuration({"root_joint": [1.0, 2.0, 0.7]})
    for v, w in ((1.0, 2.0), (3.0, -1.0)):
        expected = 2.0 * abs(v * w)
        np.testing.assert_allclose(grip.used_by(q, [v, w], np.zeros(2)), [expected / (0.5 * 2.0 * G)], rtol=1e-9)
    # The same by itself, without torque: the turn slows down and takes m c^2 / I of it away.
    np.testing.assert_allclose(grip.forces(q, [1.0, 2.0], np.zeros(2)), [4.0 / (1 + 2.0 * 0.3**2 / 0.5)], rtol=1e-9)
    known = rnc.Grip(sleigh, friction=0.5, loads={"sleigh": 4.0})
    np.testing.assert_allclose(known.used_by(q, [1.0, 2.0], np.zeros(2)), [2.0], rtol=1e-9)


def test_slower_by_s_it_takes_s_squared_less(sleigh):
    grip, generator = rnc.Grip(sleigh, friction=0.5), np.random.default_rng(0)
    q = np.stack([sleigh.robot.random_configuration(generator) for _ in range(20)])
    v2, v2_dot = generator.normal(size=(2, 20, 2))
    used = grip.used_by(q, v2, v2_dot)
    np.testing.assert_allclose(grip.used_by(q, v2 / 1.7, v2_dot / 1.7**2), used / 1.7**2, rtol=1e-9)


def test_loads_are_those_of_statics():
    """They add up to the weight, and where three supports are enough they balance its moment."""
    experiment = plan("wheels-uncertain", {"comparisons": {}}).experiment
    reduced, q = experiment.reduced, experiment.q0
    grip = rnc.Grip(reduced, friction=0.6)
    loads = grip.loads(q, np.zeros(reduced.r), np.zeros(reduced.p))
    weight = G * sum(inertia.mass for inertia in list(reduced.robot.model.inertias)[1:])
    np.testing.assert_allclose(loads.sum(), weight, rtol=1e-9)
    assert grip.names == ("left_wheel", "right_wheel")


def test_a_disk_on_a_free_base_carries_its_own_weight():
    robot = rnc.Robot.from_urdf("rolling_disk.urdf", base="free")
    system = rnc.NonholonomicSystem(robot, [rnc.RollingWheel("disk", radius=0.3, axis="y")])
    reduced = system.reduce([rnc.FrameAngularVelocity("disk", axis) for axis in "xyz"])
    q = reduced.assembled(robot.configuration())
    mass = sum(inertia.mass for inertia in list(robot.model.inertias)[1:])
    load = rnc.Grip(reduced, friction=0.5).loads(q, np.zeros(3), np.zeros(reduced.p))
    np.testing.assert_allclose(load, [mass * G], rtol=1e-9)


def turn(duration=2.0):
    """A metre and a half turn at once."""
    return MinimumJerk([0.0, 0.0], [1.5, 1.5], duration)


def rolled_out(sleigh, reference):
    target = rnc.control.ReducingOutputController(sleigh, reference)
    return rnc.kinematic_rollout(sleigh, target, sleigh.robot.configuration(), reference.duration, 0.02)


def test_a_reference_that_needs_more_than_the_grip_is_told_by_how_much(sleigh):
    """At the middle of a quintic rates are 15/8 of the mean: m v w there, while nothing accelerates."""
    grip = rnc.Grip(sleigh, friction=0.1)
    needed = grip_along(sleigh, grip, *rolled_out(sleigh, turn()))
    rate = 1.5 / 2.0 * 15 / 8
    assert needed.used >= rate**2 / (0.1 * G) * 0.99
    np.testing.assert_allclose(needed.time_scale, np.sqrt(needed.used), rtol=1e-6)
    slowed = grip_along(sleigh, grip, *rolled_out(sleigh, Slowed(turn(), needed.time_scale)))
    np.testing.assert_allclose(slowed.used, 1.0, rtol=2e-2)
    assert "times the grip that 'sleigh' has" in needed.complaints()[0]
    assert not slowed.complaints() or slowed.used < 1.02


def test_slowed_references_have_slowed_derivatives():
    reference = ViaPoints([0.0, 1.0, 2.0], [[0.0], [1.0], [0.5]])
    slowed = Slowed(reference, 2.0)
    assert slowed.duration == 4.0
    h = 1e-5
    for t in (0.7, 1.9, 3.1):
        for order in range(3):
            difference = (slowed.at(t + h)[order] - slowed.at(t - h)[order]) / (2 * h)
            np.testing.assert_allclose(slowed.at(t)[order + 1], difference, atol=1e-5)
    with pytest.raises(rnc.InputError, match="time scale factor of a reference has to be positive"):
        Slowed(reference, 0.0)


def test_preflight_warns_and_the_reference_is_slowed_until_it_holds(sleigh):
    task = rnc.Task.of(sleigh, list(sleigh.reducing.names), [])
    reference, q0 = TaskReference(turn(), rnc.planning.Hold([])), sleigh.robot.configuration()
    grip = rnc.Grip(sleigh, friction=0.1)

    def follow(reference):
        return rnc.control.ReducingOutputController(sleigh, reference.primary)

    slowed = within_grip(sleigh, task, reference, q0, grip, controller=follow)
    assert slowed.duration > reference.duration
    needed = grip_along(sleigh, grip, *rolled_out(sleigh, slowed.primary))
    assert needed.used < 1.01
    assert within_grip(sleigh, task, slowed, q0, rnc.Grip(sleigh, friction=0.2), controller=follow) is slowed


def test_a_second_factor_is_asked_of_the_slowed_reference(sleigh):
    """What an error at the start asks for does not slow down, so that the first factor is not enough."""
    task = rnc.Task.of(sleigh, list(sleigh.reducing.names), [])
    reference, grip = TaskReference(turn(), rnc.planning.Hold([])), rnc.Grip(sleigh, friction=0.02)
    q0 = sleigh.robot.configuration({"root_joint": [0.0, 0.0, 0.1]})

    def needed(primary, dt):
        follow = rnc.control.ReducingOutputController(sleigh, primary)
        return grip_along(sleigh, grip, *rnc.kinematic_rollout(sleigh, follow, q0, primary.duration, dt))

    first = needed(reference.primary, 0.02).time_scale
    second = needed(Slowed(reference.primary, first), 0.02 * first).time_scale
    assert second > 1.001
    slowed = within_grip(
        sleigh, task, reference, q0, grip, controller=lambda r: rnc.control.ReducingOutputController(sleigh, r.primary)
    )
    assert slowed.duration == pytest.approx(2.0 * first * second, rel=1e-9)
    assert needed(slowed.primary, 0.02 * first * second).used < 1.005


@pytest.mark.parametrize(
    ("friction", "loads", "words"),
    [
        (0.0, None, "friction of the ground has to be positive"),
        (0.5, {"slegh": 1.0}, "no gripping contact 'slegh'; did you mean 'sleigh'"),
        (0.5, {"sleigh": -1.0}, "load of 'sleigh' has to be positive"),
    ],
)
def test_what_is_no_grip_is_refused(sleigh, friction, loads, words):
    with pytest.raises(rnc.ConfigurationError, match=words):
        rnc.Grip(sleigh, friction, loads)


def test_a_scenario_is_warned_of_its_grip_refused_or_slowed():
    """A unicycle whose wheels would slip on ice."""
    quiet = {"comparisons": {}, "simulation.duration": 4.0}
    needed = plan("unicycle", {**quiet, "grip": {"friction": 0.01}}).experiment.warnings
    assert "times the grip that" in needed[0]
    with pytest.raises(rnc.InfeasibleError, match="times the grip that"):
        plan("unicycle", {**quiet, "grip": {"friction": 0.01}, "preflight": "refuse"})
    assert not plan("unicycle", {**quiet, "grip": {"friction": 5.0}, "preflight": "refuse"}).experiment.warnings
    slowed = plan("unicycle", {**quiet, "grip": {"friction": 0.01, "slow": True}})
    assert "slowed down by a factor of" in slowed.experiment.warnings[0]
    with pytest.raises(rnc.ConfigurationError, match="grip: requires a controller over a velocity tracker"):
        plan("mobile-manipulator-two-phase", {**quiet, "grip": {"friction": 0.5}})


def test_factors_by_which_a_scenario_slows_references_multiply():
    """One factor is not quite enough on this ground, and the next is asked of what is slowed already.

    Forces of inertia fall with the square: on a ground that grips a quarter as well everything takes twice as long.
    """
    made, factors = {}, {}
    for friction in (0.005, 0.02):
        changes = {"comparisons": {}, "simulation.duration": 4.0, "grip.friction": friction, "grip.slow": True}
        made[friction] = plan("unicycle", changes).experiment
        (said,) = made[friction].warnings  # and nothing of wheels that slip
        factors[friction] = float(said.split("by a factor of ")[1].split(" so")[0])
    assert factors[0.005] == pytest.approx(2 * factors[0.02], rel=0.01)
    each = made[0.02]
    run = rnc.simulate(each.reduced, each.controller, each.q0, 4.0 * factors[0.02], 0.01)
    used = rnc.Grip(each.reduced, 0.02).used_by(run.q, run.v2, np.gradient(run.v2, 0.01, axis=0))
    assert 0.9 < used.max() < 1.02
