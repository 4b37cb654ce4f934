"""Unknown wheel radii and tracks, (14)-(21) for rolling rows: exact, Lemma 4, blind to the truth, worth having."""

from functools import cache
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import pytest
import yaml

import rnc_pin as rnc
from bodies import add_body, add_frame
from rnc_pin.applications.scenario.execution import execute
from rnc_pin.applications.scenario.files import find_scenario, read_yaml, with_options
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.control import (
    RedundancyController,
    UncertainRedundancyController,
    UnknownRadius,
    UnknownTrack,
    WheelRegressor,
)
from rnc_pin.planning import Harmonic, Hold
from rnc_pin.robots.robot_files import find_urdf
from systems import random_states
from tolerances import ROUNDING

DRIVE = ("left_wheel", "right_wheel")
TIAGO = ("wheel_left_link", "wheel_right_link")


def reduce(robot, wheels, radii, point):
    """Wheel angles steer a point ahead of the axle."""
    joints = [name.removesuffix("_link").removesuffix("_joint") + "_joint" for name in wheels]
    rolling = [rnc.RollingWheel(wheel, radius) for wheel, radius in zip(wheels, radii, strict=True)]
    system = rnc.NonholonomicSystem(robot, rolling, joints)
    return system.reduce([rnc.JointPosition(joint) for joint in joints], [rnc.FramePosition(point, "xy")])


def drive(radii=(0.1, 0.1), track=0.4, folder=None):
    """The differential drive, with other wheels where its URDF is rewritten into a folder."""
    path = find_urdf("differential_drive.urdf")
    if folder is not None:
        tree = ElementTree.parse(path)
        for joint, side in (("left_wheel_joint", 0.5), ("right_wheel_joint", -0.5)):
            tree.find(f"joint[@name='{joint}']/origin").set("xyz", f"0 {side * track} 0")
        path = folder / "other.urdf"
        tree.write(path)
    return reduce(rnc.Robot.from_urdf(path, base="planar"), DRIVE, radii, "nose")


@cache
def tiago():
    whole = rnc.Robot.from_example("tiago_no_hand", base="planar")
    still = {name: 0.1 for name in whole.joint_names if name != "root_joint" and "wheel" not in name}
    robot = rnc.Robot.from_example("tiago_no_hand", base="planar", lock=still)
    return reduce(robot, TIAGO, (0.0985, 0.0985), "base_imu_link")


def own_and_track(wheels):
    return [UnknownRadius(wheels[:1]), UnknownRadius(wheels[1:]), UnknownTrack(wheels)]


def shared_and_track(wheels):
    return [UnknownRadius(wheels), UnknownTrack(wheels)]


CASES = {
    "drive, radii of their own": (drive, DRIVE, own_and_track, [0.1, 0.1, 0.4]),
    "drive, one radius": (drive, DRIVE, shared_and_track, [0.1, 0.4]),
    "TIAGo, radii of their own": (tiago, TIAGO, own_and_track, [0.0985, 0.0985, 0.4044]),
    "TIAGo, one radius": (tiago, TIAGO, shared_and_track, [0.0985, 0.4044]),
}


@pytest.mark.parametrize("case", CASES)
def test_regressor_is_exact_at_the_true_wheels(case):
    make, wheels, unknown, truth = CASES[case]
    reduced = make()
    regressor = WheelRegressor(reduced, unknown(wheels))
    assert regressor.predicted == tuple(f"rolling({wheel})" for wheel in wheels)  # the others say nothing here
    for q, v2 in random_states(reduced, 5):
        y, Y = regressor.regress(q, reduced.terms(q, v2).v)
        np.testing.assert_allclose(Y @ truth, y, atol=ROUNDING)
        assert np.abs(y).max() > 1e-3


def test_closed_form_of_a_differential_drive():
    """v_x = r (wl + wr) / 2 and yaw rate = r (wr - wl) / track, from the regression alone."""
    reduced = drive()
    regressor = WheelRegressor(reduced, own_and_track(DRIVE))
    q = reduced.robot.configuration({"root_joint": [0.3, -0.2, 0.7]})
    left, right, speed, yaw = 3.0, 5.0, 0.41, 0.52
    v = np.zeros(5)
    v[0], v[2] = speed, yaw
    v[reduced.robot.velocity_indices("left_wheel_joint")] = left
    v[reduced.robot.velocity_indices("right_wheel_joint")] = right
    y, Y = regressor.regress(q, v)
    np.testing.assert_allclose(np.abs(Y), [[left, 0, yaw / 2], [0, right, yaw / 2]], atol=ROUNDING)
    p = np.linalg.lstsq(*(WheelRegressor(reduced, shared_and_track(DRIVE)).regress(q, v)[i] for i in (1, 0)))[0]
    np.testing.assert_allclose(p, [2 * speed / (left + right), 2 * speed / (left + right) * (right - left) / yaw])
    np.testing.assert_allclose(np.abs(y), speed, atol=ROUNDING)


def test_the_estimated_model_is_the_other_robot(tmp_path):
    """A copy with shifted joints and rows of other radii against a URDF that was written so."""
    truth = np.array([0.13, 0.08, 0.55])
    other, reduced = drive(truth[:2], truth[2], tmp_path), drive()
    model = WheelRegressor(reduced, own_and_track(DRIVE)).estimated(reduced).at(truth)
    for q, v2 in random_states(other, 5):
        believed, true = model.at(q, v2).measure(), other.at(q, v2).measure()
        for name in ("v", "x1", "x2", "v1", "A_star", "A_star_dot"):
            np.testing.assert_allclose(getattr(believed, name), getattr(true, name), atol=ROUNDING)


def cambered():
    """A free body on two wheels that lean outwards: track and radii enter every row."""
    model = pin.Model()
    base = add_body(model, "root_joint", "FreeFlyer", 5.0)
    for name, side in (("left", 1.0), ("right", -1.0)):
        placement = pin.SE3(pin.rpy.rpyToMatrix(side * 0.2, 0.1, 0.0), np.array([0.1, side * 0.3, 0.05]))
        joint = add_body(model, f"{name}_joint", "RUBY", 1.0, base, moments=0.01, at=placement)
        add_frame(model, name, joint, (0.0, side * 0.02, 0.0))
    return rnc.Robot(model)


@pytest.mark.parametrize("unknown", [own_and_track, shared_and_track])
def test_true_wheels_are_never_read(unknown, tmp_path):
    """Two systems that differ in radii and track alone: one measurement gives one answer."""
    targets = []
    measurements = [drive().at(q, v2).measure() for q, v2 in random_states(drive(), 4)]
    for reduced in (drive(), drive((0.17, 0.06), 0.9, tmp_path)):
        task = rnc.Task.of(reduced, [], reduced.reducing.names)
        controller = RedundancyController(task, Hold(np.zeros(0)), Harmonic(np.zeros(2), [0.3, 0.2], 0.1))
        regressor = WheelRegressor(reduced, unknown(DRIVE))
        guess = [0.15, 0.3] if unknown is shared_and_track else [0.15, 0.12, 0.3]
        estimating = UncertainRedundancyController(reduced, controller, regressor, guess, (0.02, 2.0), 20.0)
        state = estimating.initial_state(measurements[0])
        for k, measured in enumerate(measurements):
            target, state = estimating.step(0.01 * k, measured, state)
            targets.append(np.concatenate([target.v2, target.v2_dot, target.estimates, target.prediction_error]))
    np.testing.assert_allclose(targets[:4], targets[4:], rtol=ROUNDING, atol=ROUNDING)


def test_at_the_true_wheels_it_is_the_class_1_controller():
    reduced = tiago()
    task = rnc.Task.of(reduced, [], reduced.reducing.names)
    controller = RedundancyController(task, Hold(np.zeros(0)), Harmonic(np.zeros(2), [0.3, 0.2], 0.1))
    regressor = WheelRegressor(reduced, shared_and_track(TIAGO))
    estimating = UncertainRedundancyController(reduced, controller, regressor, [0.0985, 0.4044], (0.02, 2.0))
    for q, v2 in random_states(reduced, 3):
        measured = reduced.at(q, v2).measure()
        exact, _ = controller.step(1.0, measured, None)
        target, _ = estimating.step(1.0, measured, estimating.initial_state(measured))
        np.testing.assert_allclose(target.v2, exact.v2, atol=1e-9 * (1 + np.abs(exact.v2).max()))
        np.testing.assert_allclose(target.v2_dot, exact.v2_dot, atol=1e-8 * (1 + np.abs(exact.v2_dot).max()))


def wheels_of(unknown, folder):
    changes = {"controller.unknown": unknown, "comparisons": {}, "plots": {}, "simulation.duration": 1.0}
    path = folder / "mine.yaml"
    path.write_text(yaml.safe_dump(with_options(read_yaml(find_scenario("wheels-uncertain")), changes)))
    return Scenario.load(str(path)).experiment


def test_a_scenario_names_what_is_unknown(tmp_path):
    unknown = {
        "radii": [{"wheels": ["left_wheel"], "initial": 0.12}, {"wheels": ["right_wheel"], "initial": 0.09}],
        "tracks": [{"wheels": ["left_wheel", "right_wheel"], "initial": 0.3}],
    }
    experiment = wheels_of(unknown, tmp_path)
    np.testing.assert_array_equal(experiment.controller.estimator.initial, [0.12, 0.09, 0.3])
    assert experiment.provenance.to_json()["estimates"] == {
        "radius of left_wheel": "m",
        "radius of right_wheel": "m",
        "track of left_wheel, right_wheel": "m",
    }
    assert experiment.provenance.to_json()["predicted"] == {"rolling(left_wheel)": "m/s", "rolling(right_wheel)": "m/s"}


@pytest.mark.parametrize(("unknown", "words"), [
    ({}, "controller.unknown.base: is missing"),
    ({"radii": []}, "controller.unknown: name at least one radius or track"),
    ({"radii": [{"wheels": ["left_wheel"]}]}, r"controller.unknown.radii\[0\].initial: is missing"),
    ({"radii": [{"wheels": ["left_weel"], "initial": 0.1}]}, "controller.unknown: .*did you mean 'left_wheel'"),
    ({"tracks": [{"wheels": ["left_wheel"], "initial": 0.1}]}, "unknown track: expected two wheels"),
    ({"radii": [{"wheels": ["left_wheel"], "initial": 9}]}, "radius of left_wheel, 9, has to be within its bounds"),
    ({"radii": [{"wheels": ["left_wheel"], "initial": 9}], "base": "x"}, "controller.unknown: 'base' is not known"),
])  # fmt: skip
def test_a_scenario_with_unknown_nonsense_is_refused(unknown, words, tmp_path):
    with pytest.raises(rnc.ConfigurationError, match=words):
        wheels_of(unknown, tmp_path)


def test_controllers_of_other_classes_take_unknown_wheels_too():
    unknown = {"controller.unknown": {"radii": [{"wheels": ["wheel"], "initial": 0.4}]}}
    quiet = {"comparisons": {}, "plots": {}, "simulation.dt": 0.004, "simulation.duration": 4.0}
    run = execute(Scenario.load("unicycle", {**quiet, **unknown})).trajectory
    assert run.outcome == "completed"
    assert run.estimates[-1] == pytest.approx([0.25], rel=1e-3)
    with pytest.raises(rnc.ConfigurationError, match="needs 'unknown', which is missing"):
        Scenario.load("unicycle", {"controller.alpha": 1.0}).build()


def test_class_1_with_something_unknown_is_the_type_of_its_own():
    quiet = {"comparisons": {}, "plots": {}, "simulation.dt": 0.01, "simulation.duration": 1.0}
    own = execute(Scenario.load("wheels-uncertain", quiet)).trajectory
    same = execute(Scenario.load("wheels-uncertain", {**quiet, "controller.type": "redundancy"})).trajectory
    assert own.estimates.size
    np.testing.assert_array_equal(own.T, same.T)
    np.testing.assert_array_equal(own.estimates, same.estimates)
