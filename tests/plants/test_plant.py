"""Integration steps and their error: closed forms of free bodies, finer integration, batches, contacts and runs."""

import json

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc

GRAVITY = 9.81
DIRECTION = np.array([0.3, 0.5, 0.81])


@pytest.fixture
def ball():
    robot = rnc.Robot.from_urdf("rolling_ball.urdf", base="free")
    return rnc.NonholonomicSystem(robot)


def thrown(system, spin):
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
    assert error < plant.errors.total < 1000 * error  # turns, which err most, move no centre


@pytest.mark.parametrize("spin", [10.0, 30.0, 100.0])
def test_a_fixed_number_states_its_error_and_the_number_that_would_do(ball, spin):
    reduced = ball.reduce()
    coarse = rnc.ReducedPlant(reduced, substeps=1)
    error, found = flight(coarse, ball, spin), coarse.errors
    assert error < found.total
    assert found.most == 1
    assert found.enough > 1
    assert flight(rnc.ReducedPlant(reduced, substeps=found.enough), ball, spin) < coarse.tolerance


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


def test_a_run_states_its_error(ball, tmp_path):
    reduced, (q, v) = ball.reduce(), thrown(ball, 30.0)
    still, v2 = rnc.control.ZeroInput(reduced), reduced.at(q, v=v).v2
    plants = {substeps: rnc.ReducedPlant(reduced, substeps=substeps) for substeps in (None, 1)}
    runs = {key: rnc.simulate(reduced, still, q, 1.0, 0.01, v2_0=v2, plant=each) for key, each in plants.items()}
    for run in runs.values():
        found = run.info.integration
        assert np.abs(run.q[-1, :3] - parabola(1.0)).max() < found.total
        summary = rnc.summarize(run)
        assert json.loads(json.dumps(summary["integration"]))["sum"] == found.total
        assert "integration" in str(summary)
        assert rnc.simulation.RunInfo.from_json(run.info.to_json()).integration == found
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


@pytest.mark.parametrize("tolerance", [0.0, np.inf, "1e-6", True])
def test_a_tolerance_that_is_no_positive_number_is_refused(ball, tolerance):
    with pytest.raises(rnc.InputError, match="tolerance of a plant has to be a positive number"):
        rnc.ReducedPlant(ball.reduce(), tolerance=tolerance)
