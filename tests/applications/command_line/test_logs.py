"""``rnc-pin calibrate``: the files that it writes, read back, and a tutorial's chain of commands."""

import json
from dataclasses import replace

import numpy as np
import pytest
import yaml

import rnc_pin as rnc
from rnc_pin.identification import SensorPlace
from rnc_pin.identification.logs import Correction
from rolled_logs import CAR, DIFFERENTIAL, TRICYCLE

ROBOT = (
    "robot: {urdf: vehicle.urdf, base: planar}\n"
    "constraints:\n  - rolling_wheel: {frame: front, radius: 0.12}\n  - rolling_wheel: {frame: rear, radius: 0.1}\n"
    "actuators: [fork_joint, front_joint]\n"
    "outputs: {reducing: [{joint: fork_joint}, {joint: front_joint}]}\n"
)
NUMBERS = (
    "radius of front", "place of fork_joint along x", "scale of fork_joint", "offset of fork_joint", "x of the sensor",
    "y of the sensor",
)  # fmt: skip


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    TRICYCLE.system(tmp_path)
    (tmp_path / "robot.yaml").write_text(ROBOT)
    TRICYCLE.log(0).save("log.npz")
    return tmp_path


def estimates(*names):
    return [word for name in names for word in ("--estimate", name)]


def test_the_written_scenario_moves_like_the_robot(folder, call):
    """The files say all numbers: with them, the log needs no further parameter."""
    status, out, _ = call("calibrate", "robot.yaml", "log.npz", *estimates(*NUMBERS), "--out", "new")
    assert status == 0
    assert "wrote calibration.json, mapping.yaml, robot.urdf, scenario.yaml into new" in out
    report = json.loads((folder / "new" / "calibration.json").read_text())
    found = {each["name"]: each["value"] for each in report["parameters"]}
    assert tuple(found) == NUMBERS
    scenario = rnc.Scenario.load("new/scenario.yaml")
    assert [kind.radius for kind in scenario.system.kinds] == [found["radius of front"], 0.1]
    place = scenario.robot.model.jointPlacements[scenario.robot.joint_id("fork_joint")].translation
    np.testing.assert_allclose(place, [found["place of fork_joint along x"], 0.0, 0.12], atol=1e-9)
    mapping = yaml.safe_load((folder / "new" / "mapping.yaml").read_text())
    assert mapping == {"corrections": {"fork_joint": {
        "scale": found["scale of fork_joint"], "offset": found["offset of fork_joint"]}}}  # fmt: skip
    # Another log of the true robot, through the command and through Python.
    TRICYCLE.log(5, noise=0.0, ticks=0).save("other.npz")
    _, out, _ = call("compare", "new/scenario.yaml", "other.npz", "--mapping", "new/mapping.yaml", "--json")
    errors = json.loads(out)["errors"]
    assert errors[-1]["mean"] < 5e-3
    _, out, _ = call("compare", "robot.yaml", "other.npz", "--json")
    assert json.loads(out)["errors"][-1]["mean"] > 0.1
    log = rnc.Log.load("other.npz").corrected({"fork_joint": Correction(**mapping["corrections"]["fork_joint"])})
    again = rnc.calibrate(scenario.system, log, [SensorPlace("x")], "sensor")
    assert again.errors["nominal"].mean == pytest.approx(errors[-1]["mean"], rel=1e-6)


def test_a_second_calibration_continues_from_the_first(folder, call):
    call("calibrate", "robot.yaml", "log.npz", *estimates(*NUMBERS), "--out", "new")
    mapping = ("--mapping", "new/mapping.yaml")
    status, _, _ = call("calibrate", "new/scenario.yaml", "log.npz", *mapping, *estimates(*NUMBERS), "--out", "next")
    assert status == 0
    first, second = (yaml.safe_load((folder / each / "mapping.yaml").read_text()) for each in ("new", "next"))
    reports = [json.loads((folder / each / "calibration.json").read_text())["parameters"] for each in ("new", "next")]
    std = {each["name"]: each["std"] for each in reports[0]}
    for key in ("scale", "offset"):
        one, other = (each["corrections"]["fork_joint"][key] for each in (first, second))
        assert one == pytest.approx(other, abs=0.1 * std[f"{key} of fork_joint"])  # the iterations end there
    for each in reports[1]:
        assert abs(each["value"] - each["file"]) < 0.1 * each["std"]


def test_by_default_it_estimates_what_compare_names(folder, call):
    wrong = {**TRICYCLE.nominal, "offset fork_joint": 0.05}
    replace(TRICYCLE, true=wrong).log(1).save("log.npz")
    status, out, _ = call("calibrate", "robot.yaml", "log.npz", "--json")
    assert status == 0
    (only,) = json.loads(out)["parameters"]
    assert only["name"] == "offset of fork_joint"
    assert only["value"] == pytest.approx(0.05, abs=4 * only["std"])
    replace(TRICYCLE, true=TRICYCLE.nominal).log(1).save("log.npz")
    status, _, error = call("calibrate", "robot.yaml", "log.npz")
    assert (status, error.count("\n")) == (2, 1)
    assert "no number explains the difference from robot.yaml; name what to estimate: --estimate NAME" in error


def test_bad_requests_are_one_line(folder, call):
    for words, message in (
        (("--estimate", "size of front"), "'size of front' is no number that a log can show: expected 'radius of"),
        (("--estimate", "radius of frnt"), "no frame 'frnt' in robot 'vehicle'; did you mean 'front'?"),
        (("--estimate", "radius of front", "--estimate", "scale of front_joint"),
         "the log does not determine the combination"),
    ):  # fmt: skip
        status, _, error = call("calibrate", "robot.yaml", "log.npz", *words)
        assert status in (1, 2)
        assert message in error
        assert error.count("\n") == 1
    (folder / "bad.yaml").write_text("corrections: {sensor: {scale: 2.0}}\n")
    status, _, error = call("calibrate", "robot.yaml", "log.npz", "--mapping", "bad.yaml")
    assert "corrections.sensor: expected only a delay, 'sensor' is no measured joint" in error


def test_the_online_estimator_starts_from_a_calibration(tmp_path):
    found = rnc.calibrate(DIFFERENTIAL.system(tmp_path), DIFFERENTIAL.log(2), DIFFERENTIAL.unknown, "sensor")
    reduced = found.system.reduce([rnc.JointPosition("left_joint"), rnc.JointPosition("right_joint")])
    unknown = [
        rnc.control.UnknownRadius(["left"]), rnc.control.UnknownRadius(["right"]),
        rnc.control.UnknownTrack(["left", "right"]),
    ]  # fmt: skip
    regressor = rnc.control.WheelRegressor(reduced, unknown)
    np.testing.assert_allclose(regressor.values_of(found.system), found.values[:3], rtol=1e-12)
    np.testing.assert_allclose(regressor.values_of(DIFFERENTIAL.system(tmp_path)), [0.1, 0.1, 0.5], rtol=1e-12)
    estimator = rnc.control.Estimator(reduced, regressor, initial=regressor.values_of(found.system))
    np.testing.assert_array_equal(estimator.initial, regressor.values_of(found.system))


@pytest.mark.parametrize("seed", [26, 33])
def test_a_log_that_hardly_shows_a_number_converges(seed, tmp_path):
    """A car that steers little: its track and wheelbase change their paths over short windows less than the noise."""
    found = rnc.calibrate(CAR.system(tmp_path), CAR.log(seed), CAR.unknown, "sensor", resolution=np.inf)
    assert (np.abs(found.values - list(CAR.true.values())) < 4 * found.std).all()
