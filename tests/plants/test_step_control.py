"""Integration steps and their error: closed forms of free bodies, finer integration, batches, contacts and runs."""

import json

import numpy as np
import pinocchio as pin
import pytest
import scipy

import rnc_pin as rnc
import systems
from bodies import add_body
from rnc_pin.applications.scenario.execution import execute
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.simulation.error_propagation import ErrorHistory, RunSamples
from simple_controllers import Idle, Memoryless

GRAVITY = 9.81
DIRECTION = np.array([0.3, 0.5, 0.81])


@pytest.fixture
def ball():
    robot = rnc.Robot.from_urdf("rolling_ball.urdf", base="free")
    return rnc.NonholonomicSystem(robot)


def thrown(system, spin):
    """Start of a flight, with a spin [rad/s]."""
    return system.robot.configuration({"root_joint": [0, 0, 2.0, 0, 0, 0, 1]}), np.r_[1.0, 0.0, 0.5, spin * DIRECTION]


def flight(plant, system, spin, duration=1.0, dt=0.01):
    plant.reset(*thrown(system, spin))
    for _ in range(round(duration / dt)):
        plant.advance(dt)
    return np.abs(plant.read()[0][:3] - parabola(duration)).max()


def parabola(t):
    return np.array([t, 0.0, 2.0 + 0.5 * t - 0.5 * GRAVITY * t * t])


@pytest.mark.parametrize("spin", [30.0, 100.0, 300.0])
def test_the_centre_of_a_spinning_body_flies_on_a_parabola(ball, spin):
    plant = rnc.ReducedPlant(ball.reduce())
    error = flight(plant, ball, spin)
    assert error < plant.tolerance  # of one second
    stated = plant.errors.folded().past[:3].max()
    assert error / 10 < stated < 10 * error


@pytest.mark.parametrize("spin", [10.0, 30.0, 100.0])
def test_a_fixed_number_states_its_error_and_the_number_that_would_do(ball, spin):
    reduced = ball.reduce()
    coarse = rnc.ReducedPlant(reduced, substeps=1)
    error, found = flight(coarse, ball, spin), coarse.errors.folded()
    assert found.past[:3].max() / 10 < error < 10 * found.past[:3].max()
    assert found.most == 1
    assert found.enough > 1
    assert flight(rnc.ReducedPlant(reduced, substeps=found.enough), ball, spin) < coarse.tolerance


def test_a_finer_tolerance_gives_a_smaller_error(ball):
    errors = [flight(rnc.ReducedPlant(ball.reduce(), tolerance=each), ball, 30.0, 0.2) for each in (1e-4, 1e-6, 1e-8)]
    assert errors[0] > 10 * errors[1] > 100 * errors[2]


def test_a_motion_gives_the_same_bits_again_and_after_a_rollback(ball):
    plant = rnc.ReducedPlant(ball.reduce())
    flight(plant, ball, 40.0, 0.3)
    middle, first = plant.checkpoint(), None
    for _ in range(2):
        plant.rollback(middle)
        for _ in range(150):
            plant.advance(0.01)
        found = plant.read()
        assert first is None or all(np.array_equal(*each) for each in zip(first, found, strict=True))
        first = found
    again = rnc.ReducedPlant(ball.reduce())
    flight(again, ball, 40.0, 0.3)
    assert np.array_equal(again.read()[0], pin.normalize(ball.robot.model, middle.q))


def test_the_runs_of_a_batch_choose_as_alone(ball):
    reduced, spins = ball.reduce(), (0.0, 5.0, 40.0, 200.0)
    starts = [thrown(ball, spin) for spin in spins]
    batch = rnc.plants.ReducedPlantBatch(rnc.ReducedPlant(reduced), len(spins))
    batch.reset(*(np.array(each) for each in zip(*starts, strict=True)))
    alone = [rnc.ReducedPlant(reduced) for _ in spins]
    for plant, start in zip(alone, starts, strict=True):
        plant.reset(*start)
    for _ in range(200):
        batch.advance(0.005)
        for plant in alone:
            plant.advance(0.005)
    q, v = batch.read()
    for run, plant in enumerate(alone):
        assert np.array_equal(q[run], plant.read()[0])
        assert np.array_equal(v[run], plant.read()[1])
        mine, its = batch.errors_of(run), plant.errors
        assert all(np.array_equal(*each) for each in zip(mine, its, strict=True))
    most = [plant.errors.most for plant in alone]
    assert most == sorted(most)
    assert most[0] < most[-1]


def test_a_robot_that_needs_one_step_takes_one():
    reduced = systems.space_robot()
    (q, v2), *_ = systems.random_states(reduced, 1, seed=2)
    plant = rnc.ReducedPlant(reduced)
    plant.reset(q, reduced.at(q, 0.2 * v2).v)
    for _ in range(200):
        plant.advance(0.002)
    assert plant.errors.most == 1


@pytest.mark.parametrize("friction", [False, True])
def test_damping_and_friction_keep_the_tolerance(friction):
    robot = systems.space_robot().robot
    model = robot.model.copy()
    model.damping[:] = 2.0
    model.upperDryFrictionLimit[:] = 0.5 * friction
    reduced = rnc.NonholonomicSystem(rnc.Robot(model)).reduce()
    q, v = pin.neutral(model), np.array([0.5, 2.0, -3.0, 4.0])[: model.nv]
    ends = []
    for options in ({}, {"substeps": 16}):
        plant = rnc.ReducedPlant(reduced, joint_damping=True, joint_friction=friction, **options)
        plant.reset(q, v)
        for _ in range(20):
            plant.advance(0.02)
        ends.append(plant.read()[0])
    assert 0 < np.abs(ends[0] - ends[1]).max() < 1e-6


def test_a_ball_that_spins_lands_at_its_time(ball):
    drop = 0.3
    contact = rnc.UnilateralContact(rnc.RollingBall("ball", 0.2), restitution=0.5)
    plant = rnc.ContactPlant(ball, [contact])
    plant.reset(
        ball.robot.configuration({"root_joint": [0, 0, 0.2 + drop, 0, 0, 0, 1]}), np.r_[np.zeros(3), 0, 30.0, 0]
    )
    for _ in range(30):
        plant.advance(0.01)
    _, landing = plant.contact_events
    assert landing.time == pytest.approx(np.sqrt(2 * drop / GRAVITY), abs=1e-8)
    inertia = float(np.diag(ball.robot.model.inertias[1].inertia)[0])
    mass = ball.robot.model.inertias[1].mass
    share = inertia / (inertia + mass * 0.2**2)  # of the spin that stays: momentum about the contact
    assert np.linalg.norm(plant.read()[1][3:]) == pytest.approx(30.0 * share, rel=1e-8)
    assert plant.errors.folded().past[:3].max() > 0


def test_a_run_states_its_error(ball, tmp_path):
    reduced, (q, v) = ball.reduce(), thrown(ball, 30.0)
    still = rnc.control.ZeroInput(reduced)
    runs = {
        substeps: rnc.simulate(
            reduced, still, q, 1.0, 0.01, v2_0=reduced.at(q, v=v).v2, plant=rnc.ReducedPlant(reduced, substeps=substeps)
        )
        for substeps in (None, 1)
    }
    for run in runs.values():
        true = np.abs(run.q[-1, :3] - parabola(1.0)).max()
        assert true / 10 < run.info.integration.accumulated["m"] < 10 * true
        summary = rnc.summarize(run)
        assert (
            json.loads(json.dumps(summary["integration"]))["accumulated"]["m"] == run.info.integration.accumulated["m"]
        )
        assert "integration" in str(summary)
        assert rnc.simulation.RunInfo.from_json(run.info.to_json()).integration == run.info.integration
    assert runs[None].info.integration.is_kept
    assert runs[None].info.verdict is None or runs[None].info.verdict.word == "succeeded"
    (finding,) = rnc.simulation.judge(runs[1]).findings
    assert str(finding.kind) == "integration"
    assert "substeps 1 is too small" in finding.message
    assert str(runs[1].info.integration.enough) in finding.message


def test_an_integrator_that_diverges_is_not_the_robot(ball):
    reduced, (q, v) = ball.reduce(), thrown(ball, 300.0)
    still, v2 = rnc.control.ZeroInput(reduced), reduced.at(q, v=v).v2
    with pytest.raises(rnc.DivergenceError, match=r"the integrator, not the robot.*substeps 1 is too small, set"):
        rnc.simulate(reduced, still, q, 1.0, 0.01, v2_0=v2, plant=rnc.ReducedPlant(reduced, substeps=1))
    assert rnc.simulate(reduced, still, q, 0.2, 0.01, v2_0=v2).outcome is rnc.Outcome.COMPLETED
    with pytest.raises(rnc.DivergenceError, match=r"diverged at t = .* s: reduced velocities reached"):
        rnc.simulate(reduced, still, q, 1.0, 0.01, v2_0=10 * v2)


@pytest.mark.parametrize("tolerance", [0.0, -1.0, np.nan, np.inf, "1e-6", True])
def test_a_tolerance_that_is_no_positive_number_is_refused(ball, tolerance):
    with pytest.raises(rnc.InputError, match="tolerance of a ReducedPlant has to be a positive number"):
        rnc.ReducedPlant(ball.reduce(), tolerance=tolerance)


def turning(tilt=0.0):
    """A rod of 2 kg on a motor at its end, its centre 0.5 m below or, tilted by pi, above; inertia J."""
    model = pin.Model()
    place = pin.SE3(pin.rpy.rpyToMatrix(tilt, 0.0, 0.0), np.zeros(3))
    add_body(model, "hinge", "RX", 2.0, com=(0, 0, -0.5), moments=0.1, at=place)
    return rnc.NonholonomicSystem(rnc.Robot(model), [], ["hinge"]).reduce(), 0.1 + 2.0 * 0.25


def swing(amplitude, frequency, t):
    """Angle of a pendulum that starts at rest; ``frequency`` is that of small swings."""
    k = np.sin(amplitude / 2)
    quarter = scipy.special.ellipk(k**2)
    sn, *_ = scipy.special.ellipj(quarter - frequency * t, k**2)
    return 2 * np.arcsin(k * sn)


def hanging(J, k, d):
    """Return a feedback of a rod that hangs: acceleration -k q - d v, in closed loop."""
    weight = 2.0 * GRAVITY * 0.5
    return Memoryless(lambda _, m: rnc.control.Command(T=weight * np.sin(m.q) - J * (k * m.q + d * m.v)))


class Erring(rnc.ReducedPlant):
    """Plant whose integration has errors (position, velocity) in its first samples."""

    erring: tuple[float, float]
    first: float

    def local_errors(self, motion, steps, charts, dt):
        return np.outer(motion[0] < self.first * dt, self.erring)


def largest_error(reduced, controller, dt, samples, erring, first=np.inf):
    """Largest errors of a rod at rest, whose integration has errors in its first samples."""
    plant = Erring(reduced)
    plant.erring, plant.first = erring, first
    plant.reset(np.zeros(1), np.zeros(1))
    history = ErrorHistory(plant, reduced, controller, dt, samples + 1)
    for sample in range(samples):
        history.mark(sample, None, np.zeros(1))
    rest = np.zeros((samples + 1, 1))
    return history.largest(RunSamples(dt * np.arange(samples + 1), rest, rest, rest), plant.errors)


def test_the_error_of_an_upright_pendulum_grows_with_its_exponent():
    (reduced, J), dt, samples = turning(np.pi), 0.01, 320
    exponent = np.sqrt(2.0 * GRAVITY * 0.5 / J)
    found = largest_error(reduced, Idle(1), dt, samples, (1e-9, 0.0), first=16)
    ages = dt * (samples - np.arange(1, 17))  # of the errors of the first 16 samples
    growth = np.exp(exponent * dt * samples) / 2
    assert growth > 1e4
    assert found[0] == pytest.approx(1e-9 * np.cosh(exponent * ages).sum(), rel=1e-6)
    assert found[1] == pytest.approx(1e-9 * exponent * np.sinh(exponent * ages).sum(), rel=1e-6)


def test_the_error_of_a_tracker_stays_at_the_local_one_over_the_rate():
    (reduced, J), dt, samples = turning(), 0.001, 8000
    k, d = 25.0, 10.0  # two poles at -5/s, of the closed loop
    a, b = 2e-8, 3e-8  # errors per second of the velocity and of the position
    found = largest_error(reduced, hanging(J, k, d), dt, samples, (b * dt, a * dt))
    assert found[0] == pytest.approx((a + d * b) / k, rel=0.02)  # zero-order hold
    assert found[1] == pytest.approx(b, rel=0.02)


@pytest.mark.parametrize("substeps", [1, 2, None])
def test_the_stated_error_of_a_swinging_pendulum_is_its_error(substeps):
    (reduced, J), dt = turning(), 0.02
    end, start = 3.0, np.array([2.5])
    plant = rnc.ReducedPlant(reduced, substeps=substeps)
    run = rnc.simulate(reduced, Idle(1), start, end, dt, plant=plant)
    weight = 2.0 * GRAVITY * 0.5 / J
    exact = swing(start[0], np.sqrt(weight), run.time)
    true = np.abs(run.q[:, 0] - exact).max()
    assert true / 2 < run.info.integration.accumulated["rad"] < 2 * true


def damped_arm():
    """An arm with viscous damping in its joints."""
    model = systems.space_robot().robot.model.copy()
    model.damping[:] = 2.0
    return rnc.NonholonomicSystem(rnc.Robot(model)).reduce()


@pytest.mark.parametrize("system", [damped_arm, systems.leaning_wheel, systems.four_bar])
def test_the_stated_error_holds_with_damping_rolling_and_loops(system):
    reduced = system()
    (q, v2), *_ = systems.random_states(reduced, 1, seed=3)
    start, dt, damped = reduced.assembled(q), 0.01, system is damped_arm
    plants = [
        rnc.ReducedPlant(reduced, joint_damping=damped, **options) for options in ({"substeps": 1}, {"substeps": 4})
    ]
    coarse, fine = (
        rnc.simulate(reduced, rnc.control.ZeroInput(reduced), start, 0.2, dt, v2_0=v2, plant=plant) for plant in plants
    )
    found = coarse.info.integration
    assert found.linearized
    true = max(np.abs(pin.difference(reduced.robot.model, *each)).max() for each in zip(coarse.q, fine.q, strict=True))
    assert true / 10 < max(found.accumulated.get(unit, 0.0) for unit in ("m", "rad")) < 10 * true


def test_an_error_beyond_a_linear_map_is_not_stated():
    """A pendulum that nearly stands at each turn: there its error grows a thousandfold."""
    (reduced, J), start = turning(), np.array([np.pi - 1e-3])
    run = rnc.simulate(reduced, Idle(1), start, 12.0, 0.05, plant=rnc.ReducedPlant(reduced, substeps=1))
    exact = swing(start[0], np.sqrt(2.0 * GRAVITY * 0.5 / J), run.time)
    assert np.abs(run.q[:, 0] - exact).max() > 1.0
    found = run.info.integration
    assert not found.linearized
    assert not found.accumulated
    assert "linear" in rnc.summarize(run)["integration"]["unknown"]


def test_a_controller_that_refuses_displaced_states_costs_the_propagation_only():
    (reduced, _), start = turning(), np.array([1.0])

    class Known(Idle):
        """Controller that knows the states of one run only."""

        def step(self, t, measurement, state):
            seen.setdefault(round(t, 9), measurement.q[0])
            if measurement.q[0] != seen[round(t, 9)]:
                raise LookupError("no such state")
            return super().step(t, measurement, state)

    seen = {}
    found = rnc.simulate(reduced, Known(1), start, 0.5, 0.01).info.integration
    assert not found.linearized
    assert found.accumulated["rad"] > 0


def test_runs_in_lock_step_state_the_errors_of_runs_alone():
    (reduced, _), target = turning(), rnc.planning.Hold([0.3])
    controller = rnc.control.VelocityTracker(rnc.control.ReducingOutputController(reduced, target))
    starts = np.array([[-1.0], [0.5], [1.5]])
    together = rnc.simulate(reduced, controller, starts, 0.5, dt=0.01)
    for run, q in zip(together, starts, strict=True):
        alone = rnc.simulate(reduced, controller, q, 0.5, dt=0.01).info.integration
        assert alone.linearized
        assert alone.accumulated["rad"] > 0
        assert run.info.integration == alone


def test_a_controller_that_damps_by_its_own_state_states_no_accumulated_error():
    """With its state held, a tracker that reads no velocities is a spring without a damper: errors seem to grow."""
    options = {"comparisons": {}, "plots": {}, "simulation.duration": 0.5}
    stated = execute(Scenario.load("space-robot-fixed-platform", options)).trajectory.info.integration
    assert not stated.accumulated
    assert "its own state" in stated.unknown


def test_a_program_with_limits_states_no_accumulated_error():
    reduced, _ = turning()
    task = rnc.control.tasks.OutputTask(rnc.JointPosition("hinge"), rnc.planning.Hold([0.3]))
    program = rnc.control.InverseDynamicsQP(reduced, [task], [rnc.control.limits.JointPositionLimit()], dt=0.01)
    run = rnc.simulate(reduced, program, np.zeros(1), 0.3, dt=0.01)
    assert not run.info.integration.accumulated
    assert "active limits" in rnc.summarize(run)["integration"]["unknown"]
    assert run.info.integration.local
