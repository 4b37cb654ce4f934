"""A batch of plants against plants of their own: every run has the same bits."""

import copy
import pickle

import numpy as np
import pytest

import rnc_pin as rnc
import systems

DT = 0.02


@pytest.fixture
def generator():
    return np.random.default_rng(3)


def started(reduced, runs, **options):
    """A batch, and single plants, at the same random states."""
    states = systems.random_states(reduced, runs, seed=1)
    q = np.array([reduced.assembled(q) for q, _ in states])
    v = np.array([reduced.at(each, v2).v for each, (_, v2) in zip(q, states, strict=True)])
    batch = rnc.plants.ReducedPlantBatch(rnc.ReducedPlant(reduced, **options), runs)
    batch.reset(q, v)
    plants = [rnc.ReducedPlant(reduced, **options) for _ in range(runs)]
    for plant, q_0, v_0 in zip(plants, q, v, strict=True):
        plant.reset(q_0, v_0)
    return batch, plants


def compare(batch, plants):
    q, v = batch.read()
    for run, plant in enumerate(plants):
        alone = plant.read()
        assert np.array_equal(q[run], alone[0])
        assert np.array_equal(v[run], alone[1])
        assert np.array_equal(batch.integrals[run], plant.integrals)
        assert np.array_equal(batch.applied[run], plant.applied)
        assert batch.work[run] == plant.work


def step(batch, plants, T):
    batch.apply(T)
    batch.advance(DT)
    for plant, T_alone in zip(plants, np.asarray(T), strict=True):
        plant.apply(T_alone)
        plant.advance(DT)


@pytest.mark.parametrize(
    "name", ["space_robot", "mobile_manipulator", "fire_truck", "four_bar", "spinning_space_robot"]
)
def test_every_run_has_the_bits_of_a_plant_of_its_own(name, generator):
    reduced = systems.ALL[name]()
    batch, plants = started(reduced, 4)
    for _ in range(25):
        step(batch, plants, 3.0 * generator.standard_normal((4, reduced.p)))
    compare(batch, plants)


def test_copies_continue_in_mid_run(generator):
    """A copy has no memory of the kernel, and makes it again: for the model, and for the chart of each run."""
    reduced = systems.fire_truck()
    batch, plants = started(reduced, 3)
    for _ in range(30):
        step(batch, plants, [[40.0, 5.0, -5.0], [-40.0, -2.0, 3.0], [0.0, 0.0, 0.0]])
    _ = batch.measure() if batch.measures else batch.read()
    copies = [pickle.loads(pickle.dumps(batch)), copy.deepcopy(batch)]
    inputs = 20.0 * generator.standard_normal((30, 3, reduced.p))
    for T in inputs:
        step(batch, plants, T)
    compare(batch, plants)
    for other in copies:
        assert other.size == 3
        for T in inputs:
            other.apply(T)
            other.advance(DT)
        compare(other, plants)
        if batch.measures:
            (states, inside), (found, measured) = batch.measure(), other.measure()
            assert np.array_equal(measured, inside)
            assert np.array_equal(found.R_dot, states.R_dot)
    copies[0].keep([0, 2])
    copies[0].advance(DT)
    assert len(copies[0].read()[0]) == 2


def test_charts_are_replaced_for_each_run(generator):
    reduced = systems.fire_truck()
    batch, plants = started(reduced, 3)
    batch.reset(plants[2].read()[0], np.zeros(reduced.n), runs=[2])  # this one rests
    plants[2].reset(plants[2].read()[0], np.zeros(reduced.n))
    before = [plant.checkpoint().chart for plant in plants]
    for _ in range(60):
        step(batch, plants, [[40.0, 5.0, -5.0], [-40.0, -2.0, 3.0], [0.0, 0.0, 0.0]])
        compare(batch, plants)
    replaced = [plant.checkpoint().chart is not chart for plant, chart in zip(plants, before, strict=True)]
    assert replaced == [True, True, False]


def test_damping_limits_and_substeps(generator):
    robot = rnc.Robot.from_example("panda", lock={"panda_finger_joint1": 0.0, "panda_finger_joint2": 0.0})
    reduced = rnc.NonholonomicSystem(robot, [], [f"panda_joint{k}" for k in range(1, 8)]).reduce()
    robot.model.damping[:] = 0.5
    options = {"joint_damping": True, "actuator_limits": True, "substeps": 2}
    batch, plants = started(reduced, 2, **options)
    for _ in range(5):
        step(batch, plants, 500.0 * generator.standard_normal((2, 7)))
    compare(batch, plants)
    assert np.abs(batch.applied).max() == 87.0
    assert np.array_equal(batch.external, [plant.external for plant in plants])


def test_friction_of_the_actuators_acts_in_every_run(generator):
    reduced = systems.sleigh()
    plant = rnc.ReducedPlant(reduced)
    plant.set_actuator_friction(0.4)
    _, plants = started(reduced, 2)
    batch = rnc.plants.ReducedPlantBatch(plant, 2)
    batch.reset(*(np.array(each) for each in zip(*(one.read() for one in plants), strict=True)))
    for one in plants:
        one.set_actuator_friction(0.4)
    for _ in range(5):
        step(batch, plants, generator.standard_normal((2, reduced.p)))
    compare(batch, plants)
    assert (batch.work < 0).all()


def test_a_run_that_fails_rests_and_the_others_go_on():
    reduced = systems.sleigh()
    batch, plants = started(reduced, 3)
    batch.apply([[1.0, 0.1], [1e300, 0.0], [-1.0, 0.0]])
    for plant, T in zip(plants, batch.applied, strict=True):
        plant.apply(T)
    for _ in range(2):
        batch.advance(DT)
    for plant in (plants[0], plants[2]):
        plant.advance(DT), plant.advance(DT)
    with pytest.raises(rnc.DivergenceError) as alone:
        plants[1].advance(DT), plants[1].advance(DT)
    q, v = batch.read()
    assert batch.failed.tolist() == [False, True, False]
    assert str(batch.errors[1]) == str(alone.value)
    assert np.isnan(v[1]).all()
    for run in (0, 2):
        assert np.array_equal(v[run], plants[run].read()[1])

    batch.reset(plants[0].read()[0], np.zeros(3), runs=[1])  # as an episode that starts again
    batch.advance(DT)
    q_after, _ = batch.read()
    assert not batch.failed.any()
    assert np.array_equal(q_after[1], plants[0].read()[0])
    assert not np.array_equal(q_after[0], q[0])


def test_a_single_plant_continues_from_a_run_of_a_batch():
    reduced = systems.mobile_manipulator()
    batch, plants = started(reduced, 2)
    T = np.ones((2, reduced.p))
    step(batch, plants, T)
    taken = rnc.ReducedPlant(reduced)
    taken.rollback(batch.checkpoint(1))
    taken.advance(DT)
    batch.advance(DT)
    assert np.array_equal(taken.read()[1], batch.read()[1][1])


@pytest.mark.parametrize(("call", "message"), [
    (lambda b: b.reset(np.zeros((3, 4)), np.zeros(3)), "q has shape"),
    (lambda b: b.apply(np.zeros(2)), "T has shape"),
    (lambda b: rnc.plants.ReducedPlantBatch(b.reduced, 2), "expected a ReducedPlant, found ReducedModel"),
    (lambda b: rnc.plants.ReducedPlantBatch(rnc.ReducedPlant(b.reduced), 0), "size of a ReducedPlantBatch"),
    (lambda b: rnc.plants.ReducedPlantBatch(rnc.ReducedPlant(b.reduced), 2).read(), "run 0 has not started"),
])  # fmt: skip
def test_wrong_shapes_are_refused(call, message):
    with pytest.raises(rnc.InputError, match=message):
        call(rnc.plants.ReducedPlantBatch(rnc.ReducedPlant(systems.sleigh()), 2))


def test_runs_whose_constraints_depend_on_time_start_at_zero():
    robot = rnc.Robot.from_urdf("space_robot.urdf")
    swing = rnc.planning.Harmonic([0.0], amplitude=[0.3], frequency=0.5)
    driven = rnc.PrescribedMotion(rnc.JointPosition("joint_1"), swing)
    reduced = rnc.NonholonomicSystem(robot, [driven], ["joint_2", "joint_3"]).reduce()
    q0, v0 = reduced.assembled(robot.configuration()), np.zeros(reduced.n)
    batch, plants = rnc.plants.ReducedPlantBatch(rnc.ReducedPlant(reduced), 2), []
    batch.reset(q0, v0)
    for _ in range(2):
        plants.append(rnc.ReducedPlant(reduced))
        plants[-1].reset(q0, v0)
    for _ in range(5):
        step(batch, plants, np.array([[1.0, 0.5], [-2.0, 0.3]]))
    compare(batch, plants)
