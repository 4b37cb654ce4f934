"""Runs whose constraints appear and vanish, against closed forms."""

import json

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from bodies import add_body, free_body
from simple_controllers import Inputs

G, MASS, RADIUS, HEIGHT = 9.81, 2.0, 0.1, 0.3


@pytest.fixture(scope="module")
def robot():
    """A free ball."""
    return free_body(MASS, 0.4 * MASS * RADIUS**2, ball=[0, 0, 0])


@pytest.fixture(scope="module")
def free(robot):
    return rnc.NonholonomicSystem(robot, [], [rnc.FrameForce("ball", "z")]).reduce()


@pytest.fixture(scope="module")
def rolling(robot):
    return rnc.NonholonomicSystem(robot, [rnc.RollingBall("ball", RADIUS)], [rnc.FrameForce("ball", "z")]).reduce()


def at_height(robot, height):
    q = robot.configuration()
    q[2] = height
    return q


LANDS = rnc.OutputCrossing(rnc.FramePosition("ball", "z"), RADIUS)


def test_dropped_ball_lands_and_rolls(robot, free, rolling):
    """Time and speed of a free fall; then 5/7 of the sliding speed remains (I = 2/5 m R^2)."""
    speed = 0.6
    v0 = np.array([speed, 0, 0, 0, 0, 0])
    phases = [rnc.Phase(free, 1.0, until=LANDS, name="fall"), rnc.Phase(rolling, 0.1, name="roll")]
    run = rnc.simulate_phases(phases, at_height(robot, RADIUS + HEIGHT), dt=0.01, v2_0=v0)
    fall = np.sqrt(2 * HEIGHT / G)
    landing = run.info.phases[1]
    assert landing.start == pytest.approx(fall, abs=1e-12)
    assert run.info.phases[0].end == "ball_z = 0.1"
    first = landing.first_sample
    assert run.time[first] == run.time[first - 1]
    np.testing.assert_allclose(run.v[first], [5 / 7 * speed, 0, 0, 0, 5 / 7 * speed / RADIUS, 0], atol=1e-10)
    vertical = next(name for name in landing.impulses if name.startswith("vertical"))
    assert landing.impulses[vertical] == pytest.approx(MASS * G * fall)
    lost = 0.5 * MASS * ((G * fall) ** 2 + 2 / 7 * speed**2)
    assert landing.energy_loss == pytest.approx(lost)
    # One recording: the rows exist in one phase, energy minus work is constant, the summary lists the impact.
    assert np.isfinite(run.multipliers).all()
    assert not run.multipliers[:first].any()
    np.testing.assert_allclose(run.normal_forces[first:, 0], MASS * G, rtol=1e-9)
    assert np.ptp(run.energy - run.work) < 1e-9
    assert run.phase.tolist() == [0] * first + [1] * (len(run.time) - first)
    summary = json.loads(json.dumps(rnc.summarize(run)))
    assert summary["impacts"] == [
        {"time": landing.start, "phase": "roll", "impulses": dict(landing.impulses), "energy_loss": landing.energy_loss}
    ]


def test_lift_off_releases_or_stops(robot, free, rolling):
    """A pull that grows as a T / s lifts the ball when it equals the weight."""
    rate = 100.0
    pull = Inputs(lambda t: [rate * t])
    q0, exact = at_height(robot, RADIUS), MASS * G / rate
    lifted = rnc.Phase(rolling, 1.0, pull, on_lift_off="release")
    run = rnc.simulate_phases([lifted, rnc.Phase(free, 0.1, pull)], q0, dt=0.001)
    assert exact <= run.info.phases[1].start <= exact + 0.001  # the input is held over a sample
    assert run.info.phases[0].end == "lift-off of ball"
    assert run.normal_forces.min() > -0.2
    words = r"phase '1'.*contact 'ball' lifts off at t = 0\.197 s.* only push"
    with pytest.raises(rnc.LimitError, match=words) as caught:
        rnc.simulate_phases([rnc.Phase(rolling, 1.0, pull, on_lift_off="stop")], q0, dt=0.001)
    assert caught.value.trajectory.outcome is rnc.Outcome.LIMIT
    with pytest.raises(rnc.ConfigurationError, match="was released, but the next phase has it again"):
        rnc.simulate_phases([lifted, rnc.Phase(rolling, 0.1)], q0, dt=0.001)
    with pytest.raises(rnc.ConfigurationError, match="requires a next phase"):
        rnc.simulate_phases([lifted], q0)
    loss = rnc.Phase(rolling, 1.0, pull, until=rnc.ContactLoss("ball"))
    again = rnc.simulate_phases([loss, rnc.Phase(free, 0.1)], q0, dt=0.001)
    assert again.info.phases[1].start == run.info.phases[1].start


def test_one_phase_is_the_plain_run_to_the_bit(rolling, robot, tmp_path):
    plain = rnc.simulate(rolling, Inputs(lambda t: [t]), at_height(robot, RADIUS), 0.1, 0.01, v2_0=[0.3, 0.2, 0.1])
    phase = rnc.Phase(rolling, 0.1, Inputs(lambda t: [t]))
    run = rnc.simulate_phases([phase], at_height(robot, RADIUS), 0.01, v2_0=[0.3, 0.2, 0.1])
    for name in ("time", "q", "v", "v2", "T", "energy", "work", "contact_forces", "normal_forces"):
        np.testing.assert_array_equal(getattr(run, name), getattr(plain, name))
    assert "phases" not in plain.meta
    run.save(tmp_path / "run.npz")
    assert rnc.Trajectory.load(tmp_path / "run.npz").info.phases == run.info.phases


def test_phases_from_the_state_before_them(robot, free, rolling):
    found = []

    def roll(q, v, t):
        found.append((q[2], v[2]))
        return rnc.Phase(rolling, 0.02)

    fall = np.sqrt(2 * HEIGHT / G)
    rnc.simulate_phases([rnc.Phase(free, 1.0, until=LANDS), roll], at_height(robot, RADIUS + HEIGHT), dt=0.01)
    assert found == [pytest.approx((RADIUS, -G * fall))]


def test_refusals(robot, free, rolling):
    q0 = at_height(robot, RADIUS + HEIGHT)
    words = r"phase '1', from t = 0.000 s: 'ball_z = 0.1' did not occur within 0.1 s"
    with pytest.raises(rnc.SimulationError, match=words):
        rnc.simulate_phases([rnc.Phase(free, 0.1, until=LANDS)], q0, dt=0.01)
    with pytest.raises(rnc.InputError, match=r"phase 'late', from t = 0.100 s: .*violates vertical") as caught:
        rnc.simulate_phases([rnc.Phase(free, 0.1), rnc.Phase(rolling, 0.1, name="late")], q0, dt=0.01)
    assert len(caught.value.trajectory.time) == 11
    rebound = rnc.Phase(rolling, 0.1, restitution=0.5)
    with pytest.raises(rnc.ConstraintError, match="name a contact that rebounds in 'impact'"):
        rnc.simulate_phases([rnc.Phase(free, 1.0, until=LANDS), rebound], q0, dt=0.01)
    with pytest.raises(rnc.ConfigurationError, match="MuJoCo and other plants have contacts of their own"):
        rnc.Phase(free, 0.1, plant=object())
    with pytest.raises(rnc.ConfigurationError, match="no contact or constraint row 'bal'; did you mean 'ball'"):
        rnc.simulate_phases([rnc.Phase(rolling, 0.1, until=rnc.ContactLoss("bal"))], at_height(robot, RADIUS))
    separating = rnc.Phase(rolling, 0.1, on_lift_off="stop")
    upwards = rnc.OutputCrossing(rnc.FramePosition("ball", "z"), RADIUS, "rising")
    below, v0 = at_height(robot, RADIUS - 0.01), [0, 0, 2.0, 0, 0, 0]
    with pytest.raises(rnc.ConstraintError, match=r"the impact pulls at 'ball' with 3.9 N s"):
        rnc.simulate_phases([rnc.Phase(free, 0.1, until=upwards), separating], below, dt=0.01, v2_0=v0)


def test_a_motion_that_starts_with_its_phase_conserves_momentum():
    """Cart that coasts to x = 0.3, where a motor starts to move a weight on it: ``(M + m) X' + m s' = P``."""
    cart, weight, speed, amplitude, rate = 2.0, 0.5, 0.4, 0.1, 1.0
    model = pin.Model()
    first = add_body(model, "cart", "PX", cart, moments=1e-3)
    add_body(model, "weight", "PX", weight, first, moments=1e-3)
    robot = rnc.Robot(model)
    locked = rnc.NonholonomicSystem(robot, [rnc.Pfaffian(lambda q: np.array([[0.0, 1.0]]))]).reduce()
    motion = rnc.planning.Harmonic([0.0], [amplitude], rate, ramp=0.0)
    swing = rnc.PrescribedMotion(rnc.JointPosition("weight"), motion, start_time=1.0)  # a period after its start
    driven = rnc.NonholonomicSystem(robot, [swing]).reduce()
    until = rnc.OutputCrossing(rnc.JointPosition("cart"), 0.3, "rising")
    phases = [rnc.Phase(locked, 2.0, until=until), rnc.Phase(driven, 0.5)]
    run = rnc.simulate_phases(phases, np.zeros(2), 0.005, v2_0=[speed])
    start = run.info.phases[1]
    assert start.start == pytest.approx(0.3 / speed)
    after = run.phase == 1
    s, s_dot = (
        np.array([getattr(motion.at(1.0 + t), each)[0] for t in run.time[after] - start.start])
        for each in ("position", "velocity")
    )
    momentum, share = (cart + weight) * speed, weight / (cart + weight)
    np.testing.assert_allclose(run.v[after, 0], speed - share * s_dot, atol=1e-9)
    np.testing.assert_allclose(run.q[after, 0], 0.3 + speed * (run.time[after] - start.start) - share * s, atol=1e-7)
    np.testing.assert_allclose(run.q[after, 1], s, atol=1e-12)
    # The motor sets the weight in motion at once: it adds energy of the reduced mass.
    gain = 0.5 * cart * weight / (cart + weight) * s_dot[0] ** 2
    assert start.energy_loss == pytest.approx(-gain)
    assert momentum == pytest.approx(float(run.v[-1] @ [cart + weight, weight]))
    assert np.ptp(run.energy - run.work) < 1e-7


def test_a_plain_run_stops_at_lift_off(rolling, robot):
    options = rnc.SimulationOptions(rnc.Stop(lift_off=True))
    with pytest.raises(rnc.LimitError, match=r"contact 'ball' lifts off at t = 0\.200 s") as caught:
        rnc.simulate(rolling, Inputs(lambda t: [100.0 * t]), at_height(robot, RADIUS), 1.0, 0.01, options=options)
    assert len(caught.value.trajectory.time) == 20
    with pytest.raises(rnc.LimitError, match=r"lifts off at t = 0\.000 s"):
        rnc.free_motion(
            rolling, at_height(robot, RADIUS), np.zeros(3), 0.1, inputs=[30.0],
            options=rnc.SimulationOptions(rnc.Stop(lift_off=True)),
        )  # fmt: skip
