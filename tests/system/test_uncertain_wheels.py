"""Unknown wheel radii and tracks, (14)-(21) for rolling rows, in models, controllers and scenarios."""

from xml.etree import ElementTree

import numpy as np
import pytest
import yaml

import rnc_pin as rnc
from rnc_pin.applications.scenario.files import find_scenario, read_yaml, with_options
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.control import UnknownRadius, UnknownTrack, WheelRegressor
from rnc_pin.robots.robot_files import find_urdf
from systems import random_states
from tolerances import ROUNDING

DRIVE = ("left_wheel", "right_wheel")


def drive(radii=(0.1, 0.1), track=0.4, folder=None):
    """Wheel angles steer a point ahead of the axle; other wheels where the URDF is rewritten into a folder."""
    path = find_urdf("differential_drive.urdf")
    if folder is not None:
        tree = ElementTree.parse(path)
        for joint, side in (("left_wheel_joint", 0.5), ("right_wheel_joint", -0.5)):
            tree.find(f"joint[@name='{joint}']/origin").set("xyz", f"0 {side * track} 0")
        path = folder / "other.urdf"
        tree.write(path)
    joints = [f"{wheel}_joint" for wheel in DRIVE]
    rolling = [rnc.RollingWheel(wheel, radius) for wheel, radius in zip(DRIVE, radii, strict=True)]
    system = rnc.NonholonomicSystem(rnc.Robot.from_urdf(path, base="planar"), rolling, joints)
    return system.reduce([rnc.JointPosition(joint) for joint in joints], [rnc.FramePosition("nose", "xy")])


def test_the_estimated_model_is_the_other_robot(tmp_path):
    """A copy with shifted joints and rows of other radii against a URDF that was written so."""
    truth = np.array([0.13, 0.08, 0.55])
    other, reduced = drive(truth[:2], truth[2], tmp_path), drive()
    unknown = [UnknownRadius(DRIVE[:1]), UnknownRadius(DRIVE[1:]), UnknownTrack(DRIVE)]
    model = WheelRegressor(reduced, unknown).estimated(reduced).with_parameters(truth)
    for q, v2 in random_states(other, 5):
        believed, true = model.at(q, v2).measure(), other.at(q, v2).measure()
        for name in ("v", "x1", "x2", "v1", "A_star", "A_star_dot"):
            np.testing.assert_allclose(getattr(believed, name), getattr(true, name), atol=ROUNDING)


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
    record = experiment.provenance.to_json()
    names = ("radius of left_wheel", "radius of right_wheel", "track of left_wheel, right_wheel")
    assert record["estimates"] == dict.fromkeys(names, "m")
    assert record["predicted"] == {"rolling(left_wheel)": "m/s", "rolling(right_wheel)": "m/s"}


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
