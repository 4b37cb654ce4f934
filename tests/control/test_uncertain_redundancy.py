"""Uncertain kinematics (14)-(21): the regressor is exact, the estimator is Lemma 4's, and it is worth having."""

from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import pytest
import yaml

import rnc_pin as rnc
from controlled_tasks import estimating
from rnc_pin.applications.scenario.files import find_scenario, read_yaml, with_options
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.control.estimation import adapt
from rnc_pin.robots.robot_files import find_urdf
from systems import floating_robot, in_tip_and_joint, random_states
from tolerances import ROUNDING


def heavier(folder):
    """The space robot with links of other masses."""
    tree = ElementTree.parse(find_urdf("space_robot.urdf"))
    for link, factor in (("link_1", 0.3), ("link_2", 2.5), ("link_3", 1.7)):
        for each in (tree.find(f"link[@name='{link}']/inertial/{what}") for what in ("mass", "inertia")):
            each.attrib.update({key: str(factor * float(value)) for key, value in each.attrib.items()})
    tree.write(folder / "heavier.urdf")
    return {"robot.urdf": "heavier.urdf"}


def other_wheels(folder):
    """The differential drive with wheels of other sizes, farther apart."""
    tree = ElementTree.parse(find_urdf("differential_drive.urdf"))
    for joint, side in (("left_wheel_joint", 0.45), ("right_wheel_joint", -0.45)):
        tree.find(f"joint[@name='{joint}']/origin").set("xyz", f"0 {side} 0")
    tree.write(folder / "other.urdf")
    radii = {f"constraints.{k}.rolling_wheel.radius": radius for k, radius in enumerate((0.17, 0.06))}
    return {"robot.urdf": "other.urdf", **radii}


@pytest.mark.parametrize("preset", ["scaled", "paper"])
@pytest.mark.parametrize(
    ("name", "make"), [("space-robot-uncertain", heavier), ("wheels-uncertain", other_wheels)], ids=["masses", "wheels"]
)
def test_two_plants_of_one_belief_get_the_same_inputs_at_the_same_measurement(name, make, preset, tmp_path):
    """Gains, controller and allocation together: what is unknown of the plant decides nothing."""
    quiet = {"comparisons": {}, "plots": {}, "controller.preset": preset, "simulation.duration": 1.0}
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump(with_options(read_yaml(find_scenario(name)), {**make(tmp_path), **quiet})))
    known, other = Scenario.load(name, quiet).experiment, Scenario.load(str(path)).experiment
    states = list(random_states(known.reduced, 5, condition=50.0))
    inputs, differ = [], []
    for experiment in (known, other):
        reduced, controller, state = experiment.reduced, experiment.controller, None
        for k, (q, v2) in enumerate(states):
            v = known.reduced.at(q, v2).v  # as sensors give it
            measured = reduced.at(q, v=v).measure(np.zeros(reduced.r))
            state = controller.initial_state(measured) if state is None else state
            command, state = controller.step(0.01 * k, measured, state)
            inputs.append(reduced.allocate(q, command.F) if command.T is None else command.T)
            differ.append(reduced.at(q).A_star)
    assert np.abs(np.array(differ[:5]) - differ[5:]).max() > 0.01  # the truth would tell them apart
    np.testing.assert_allclose(inputs[:5], inputs[5:], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("gain", [0.1, 10.0, 1e6])
def test_estimation_error_never_grows(gain, generator):
    """Lemma 4, in discrete time, for any gain: V = |p - phat|^2 / 2."""
    p, guess = np.array([1.0, 2.0, 0.5]), np.array([0.2, 5.0, 3.0])
    low, high = np.full(3, 0.1), np.full(3, 6.0)
    distances = [np.linalg.norm(p - guess)]
    for _ in range(200):
        W = generator.normal(size=(2, 3))
        guess = adapt(guess, W, W @ (p - guess), gain, 0.01, low, high)
        distances.append(np.linalg.norm(p - guess))
    assert (np.diff(distances) <= ROUNDING).all()
    assert distances[-1] < (0.9 if gain < 1 else 0.05) * distances[0]


def masses_as_believed(p):
    """The space robot with other masses of its links, built anew: what the estimates mean."""
    model = rnc.Robot.from_urdf("space_robot.urdf").model
    for joint, value in zip((2, 3, 4), p, strict=True):
        model.inertias[joint] = pin.Inertia.FromDynamicParameters(value * model.inertias[joint].toDynamicParameters())
    return in_tip_and_joint(floating_robot(model=model))


def misjudged(count):
    """States with what a controller believes of them: law, controller, true and believed model, q, v2, measurement."""
    believed = (1.6, 0.4, 1.5)
    reduced, law, _, controller = estimating(0.0, believed)
    for q, v2 in random_states(reduced, count, condition=50.0):
        yield law, controller, reduced, masses_as_believed(believed), q, v2, reduced.at(q, v2).measure()


def test_the_uncertain_law_is_that_of_a_robot_with_the_masses_believed():
    """Rates included, to the last term: nothing of the true A_star and A_star_dot is left in it."""
    for law, controller, _, other, q, v2, measured in misjudged(4):
        guess = other.at(q, v2).measure()
        assert np.abs(guess.A_star_dot - measured.A_star_dot).max() > 1e-3
        seen = measured._replace(A_star=guess.A_star, A_star_dot=guess.A_star_dot)
        expected, _ = law.step(1.3, seen, None)
        command, _ = controller.step(1.3, measured, controller.initial_state(measured))
        np.testing.assert_allclose(command.v2_desired, expected.v2, atol=ROUNDING * (1 + np.abs(expected.v2).max()))
        np.testing.assert_allclose(command.T, expected.v2_dot, atol=1e-9 * (1 + np.abs(expected.v2_dot).max()))


def test_the_vertical_error_is_driven_by_the_prediction_error_alone():
    """(17): ``e1_dot + k3 e1 = x1hat_dot - x1_dot`` under (16), where the rates are those asked for; k3 is 2."""
    for law, controller, reduced, other, q, _, measured in misjudged(3):
        v2d = controller.step(1.3, measured, controller.initial_state(measured))[0].v2_desired
        moved, predicted = reduced.at(q, v2d).measure().v1, other.at(q, v2d).measure().v1  # truth, and (15)
        wanted = law.vertical.at(1.3)
        error, error_rate = wanted.position - measured.x1, wanted.velocity - moved
        np.testing.assert_allclose(error_rate + 2.0 * error, predicted - moved, atol=1e-9 * (1 + np.abs(moved).max()))
        assert np.abs(predicted - moved).max() > 1e-3


def test_the_prediction_error_is_that_of_19_and_in_proportion_to_that_of_15():
    """``J E = (Ahat n) (x1_dot - x1hat_dot)``, the hat that of (15), n a turn of the base that leaves x2 alone."""
    for _, controller, reduced, other, q, v2, measured in misjudged(3):
        E = controller.step(0.0, measured, controller.initial_state(measured))[0].prediction_error
        alone = np.linalg.solve(np.vstack([np.eye(4)[0], reduced.at(q).J2]), np.eye(4)[0])
        momentum = other.at(q).A @ alone
        apart = measured.v1 - other.at(q, v2).measure().v1
        np.testing.assert_allclose(10.0 * E, momentum * apart, atol=1e-9 * (1 + np.abs(E).max()))
        assert np.abs(E).max() > 1e-3
