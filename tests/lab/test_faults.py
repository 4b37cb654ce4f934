"""Plants that differ from what their controller believes: sensors, actuators, masses, ground."""

import json
import re
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from itertools import pairwise
from multiprocessing import get_context

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from rnc_pin.applications.scenario.execution import execute
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.plants import ChangingPlant, FaultyPlant, ReducedPlant
from systems import arm_on_base, mobile_manipulator

DT = 0.01


def faulty(**faults):
    reduced = mobile_manipulator()
    plant = FaultyPlant(ReducedPlant(reduced), rnc.Faults(**faults), reduced, seed=3)
    plant.reset(reduced.robot.configuration({"joint_1": 0.4, "joint_2": 1.2}), np.array([0.4, 0.0, 0.3, 0.1, -0.2]))
    return plant


def errors(plant, samples):
    model = mobile_manipulator().robot.model
    q, v = plant.actual()
    read = [plant.read() for _ in range(samples)]
    return (np.array([pin.difference(model, q, each) for each, _ in read]), np.array([each for _, each in read]) - v)


def test_noise_has_its_standard_deviation_and_no_mean():
    in_q, in_v = errors(faulty(position_noise=1e-3, velocity_noise=0.1), 2000)
    assert in_q.std(axis=0) == pytest.approx(np.full(5, 1e-3), rel=0.1)
    assert in_q.mean(axis=0) == pytest.approx(np.zeros(5), abs=1e-4)
    assert in_v.std(axis=0) == pytest.approx(np.full(5, 0.1), rel=0.1)
    assert in_v.mean(axis=0) == pytest.approx(np.zeros(5), abs=1e-2)


def test_noise_is_the_same_each_time_and_does_not_depend_on_other_faults():
    one, two = errors(faulty(position_noise=1e-3), 20), errors(faulty(position_noise=1e-3, velocity_noise=1.0), 20)
    assert np.array_equal(one[0], two[0])
    plant = faulty(position_noise=1e-3)
    first = errors(plant, 20)
    plant.reset(*plant.actual())
    assert np.array_equal(errors(plant, 20)[0], first[0])


def test_encoders_count():
    plant = faulty(counts=4096)
    plant.advance(DT)
    step = 2 * np.pi / 4096
    (q, _), (exact, _) = plant.read(), plant.actual()
    assert q[4:] / step == pytest.approx(np.round(q[4:] / step), abs=1e-6)  # joints
    assert 0 < np.abs(q[4:] - exact[4:]).max() <= step / 2
    assert not errors(plant, 1)[1].any()


def test_delayed_and_lost_samples():
    plant, plain = faulty(delay=3), faulty()
    late, seen = [], []
    for _ in range(10):
        late.append(plant.read()[0])
        seen.append(plain.read()[0])
        plant.advance(DT)
        plain.advance(DT)
    assert np.array_equal(late[3:], seen[:-3])
    lost = faulty(dropped=0.5)
    reads = []
    for _ in range(200):
        reads.append(lost.read()[0])
        lost.advance(1e-4)
    assert np.mean([np.array_equal(a, b) for a, b in pairwise(reads)]) == pytest.approx(0.5, abs=0.1)


def heavier(factor):
    robot = rnc.Robot.from_urdf("mobile_manipulator.urdf", base="planar")
    for joint, inertia in enumerate(robot.model.inertias):
        robot.model.inertias[joint] = pin.Inertia(factor * inertia.mass, inertia.lever, factor * inertia.inertia)
    return arm_on_base(robot).reduce()


@pytest.mark.parametrize("kind", ["other masses", "load in mid-run"])
def test_energy_less_work_is_constant_whatever_is_wrong(kind):
    reduced, other = mobile_manipulator(), heavier(1.4)
    plant, own = ReducedPlant(other), slice(None)
    if kind == "load in mid-run":
        plant, own = ChangingPlant(ReducedPlant(reduced), plant, 0.1), slice(10, None)
    target = rnc.control.ReducingOutputController(reduced, rnc.planning.Hold(np.zeros(4)), k2=0.0)
    controller, plant = rnc.control.ComputedTorque(reduced, target), FaultyPlant(plant, rnc.Faults(), reduced)
    start = reduced.robot.configuration({"joint_1": 0.4, "joint_2": 1.2})
    run = rnc.simulate(reduced, controller, start, 0.3, DT, v2_0=[0.3, 0.1, 0.2, 0.1], plant=plant)
    moved, balance = np.ptp(run.energy), run.energy - run.work
    assert moved > 1e-2
    np.testing.assert_allclose(balance, balance[0], atol=1e-7 * moved)
    expected = [other.at(q, v=v).energy for q, v in zip(run.q, run.v, strict=True)]
    np.testing.assert_allclose(run.energy[own], expected[own], rtol=1e-12)


def experiment(name, **options):
    options = {key.replace("__", "."): value for key, value in options.items()}
    return Scenario.load(name, {"comparisons": {}, **options}).experiment


def test_truth_differs_from_belief():
    made = experiment("space-robot", faults={"masses": 0.3})
    true, believed = made.plant.plant.reduced.robot.model, made.reduced.robot.model
    ratios = [a.mass / b.mass for a, b in zip(true.inertias[1:4], believed.inertias[1:4], strict=False)]
    assert all(0.7 <= ratio <= 1.3 and ratio != 1.0 for ratio in ratios)
    stuck = {"masses": 0.3, "stuck": {"joint": "joint_2", "time": 0.5}}
    later = experiment("space-robot", faults=stuck).plant.plant._after.reduced.robot.model
    assert later.inertias[2].mass == true.inertias[2].mass  # drawn by the seed


@pytest.mark.parametrize("report", [ReducedPlant.report, None], ids=["it reports", "it does not"])
def test_limits_of_the_plant_under_the_faults_are_told(report):
    reduced = mobile_manipulator()

    class Weak(ReducedPlant):
        def apply(self, T):
            self.applied = np.clip(T, -0.1, 0.1)

    Weak.report = report
    plant = FaultyPlant(Weak(reduced), rnc.Faults(effort=0.05), reduced)
    plant.reset(reduced.robot.configuration(), np.zeros(reduced.n))
    plant.apply(np.array([0.01, -0.04, 0.3, -2.0]))
    np.testing.assert_allclose(plant.report().applied, [0.01, -0.04, 0.05, -0.05])


def test_a_joint_gets_stuck():
    made = experiment("space-robot", faults={"stuck": {"joint": "joint_2", "time": 0.5}}, simulation__dt=0.01)
    run = rnc.simulate(made.reduced, made.controller, made.q0, 1.0, 0.01, plant=made.plant)
    column = made.reduced.robot.velocity_indices("joint_2").start
    assert np.abs(run.v[run.time > 0.505, column]).max() < 1e-9 < np.abs(run.v[run.time < 0.495, column]).max()


@pytest.mark.parametrize(("faults", "line"), [
    ({"stuck": {"joint": "joint_9"}}, r"faults: no joint 'joint_9' in robot 'space_robot'; did you mean"),
    ({"noise": 1.0}, r"faults: 'noise' is not known"),
    ({"dropped": 3.0}, r"faults: fault dropped: expected a fraction of at most 1, found 3"),
])  # fmt: skip
def test_wrong_faults_are_one_line(call, faults, line):
    status, _, said = call("run", "space-robot", "--set", f"faults={json.dumps(faults)}")
    assert status == 2
    assert re.search(line, said)
    assert said.count("\n") == 1


NOISE = {"position_noise": 1e-4, "velocity_noise": 1e-3, "dropped": 0.05, "masses": 0.2}
FAULTY = {"simulation.duration": 0.2, "faults": NOISE, "seed": 7, "comparisons": {}}


def bits(plant: str) -> bytes:
    run = execute(Scenario.load("unicycle", {**FAULTY, "plant": plant})).trajectory
    return b"".join(array.tobytes() for array in (run.q, run.v, run.T, run.v_measured, run.estimates, run.slip))


def test_the_same_seed_gives_the_same_bits_everywhere():
    pytest.importorskip("mujoco")
    plants = ["reduced", "mujoco"]
    here = [bits(plant) for plant in plants]
    with ThreadPoolExecutor(2) as threads:
        assert list(threads.map(bits, plants)) == here
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as processes:
        assert list(processes.map(bits, plants)) == here
