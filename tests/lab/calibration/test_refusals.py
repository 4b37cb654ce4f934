"""Refusals of logs, calibrations and base parameters, each in one line."""

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from bodies import add_body
from rnc_pin.lab.calibration import EncoderScale, JointShift, SensorPlace, WheelRadius
from rnc_pin.lab.logs import Channel, LogMapping, unwrapped
from rolled_logs import DIFFERENTIAL, TRICYCLE
from urdf_parts import write

WRONG, MODEL, INPUT, UNSEEN = rnc.ConfigurationError, rnc.ModelError, rnc.InputError, rnc.InfeasibleError
WHEEL = {"joints": {"wheel": {"position": "a"}}}
PLACE = [SensorPlace("x")]


def calibrated(folder, unknown, vehicle=DIFFERENTIAL, without="", base="planar", sensor="sensor", **options):
    robot = rnc.Robot.from_urdf(write(folder / "file.urdf", vehicle.urdf(vehicle.nominal)), base=base)
    log = rnc.Log(each for each in vehicle.log(0, duration=2.0) if each.of != without)
    return rnc.calibrate(
        rnc.NonholonomicSystem(robot, vehicle.constraints(vehicle.nominal)), log, unknown, sensor, **options
    )


def read(folder, keys, text="time,a,b\n0,0,0\n1,1,1\n2,2,2\n"):
    return rnc.Log.read(write(folder / "log.csv", text), keys)


def read_mapping(folder, text):
    return LogMapping.of(write(folder / "log.yaml", text))


def read_archive(folder, keys, **arrays):
    np.savez(folder / "log.npz", **arrays)
    return rnc.Log.read(folder / "log.npz", keys)


def counter(*counts):
    return unwrapped(np.array(counts), 8192, "steering")


def corrected(**corrections):
    corrections = {name: rnc.logs.Correction(**each) for name, each in corrections.items()}
    return DIFFERENTIAL.log(0, duration=2.0).corrected(corrections)


def pendulum():
    model = pin.Model()
    add_body(model, "hinge", "RX", 1.0, com=(1, 1, 1))
    return rnc.NonholonomicSystem(rnc.Robot(model), (), ["hinge"]).reduce()


@pytest.mark.parametrize(("call", "error", "words"), [
    # channels and logs
    (lambda at: Channel("positon", "a", [0, 1], [[0], [1]]), WRONG, "quantity 'positon' is not known; did you mean"),
    (lambda at: Channel("position", "a", [0, 1], [0, 1]), INPUT, r"\(2,\) stamps with values \(2,\), expected \(N,\)"),
    (lambda at: Channel("position", "a", [0, np.inf], [[0], [1]]), INPUT, "stamp 1 is inf, expected a finite time"),
    (lambda at: Channel("position", "a", [0, 0], [[0], [1]]), INPUT, "1 sample left, expected at least 2"),
    (lambda at: Channel("pose", "a", [0, 1], [[0] * 7] * 2), INPUT, "quaternion 0 has length 0, expected 1"),
    (lambda at: rnc.Log([]), WRONG, "a log needs at least one channel"),
    (lambda at: rnc.Log([Channel("position", "a", [0, 1], [[0], [1]])] * 2), WRONG, "duplicate channel"),
    (lambda at: corrected(left_joit={"scale": 2.0}), WRONG, "corrections.left_joit: the log has no such channel; did"),
    (lambda at: corrected(sensor={"scale": 2.0}), WRONG, "expected only a delay, 'sensor' is no measured joint"),
    (lambda at: counter(0, 9000), WRONG, "steering: counts from 0 to 9000 do not wrap after 8192"),
    (lambda at: counter(0, 4000), WRONG, "step 1 is 4000 of 8192 counts, so that its direction is not known"),
    # mappings and files
    (lambda at: read_mapping(at, "joint: {}"), WRONG, "log.yaml: .*'joint' is not known; did you mean 'joints'"),
    (lambda at: read_mapping(at, "joints: {w: {position: {column: a, tick: 3}}}"), WRONG, "'tick' is not known; did"),
    (lambda at: read_mapping(at, "joints: {w: {position: {column: a, ticks: 0}}}"), WRONG, "expected greater than 0"),
    (lambda at: read_mapping(at, "- 1"), WRONG, "expected a mapping with keys such as joints or frames"),
    (lambda at: read_mapping(at, "a: ["), WRONG, "log.yaml: not YAML"),
    (lambda at: read(at, WHEEL, "time,a\n0,0\n1,1.2.3\n"), WRONG, "convert string '1.2.3' .* at data line 2, column 2"),
    (lambda at: read(at, {"joints": {"wheel": {"position": "aa"}}}), WRONG, "no column 'aa'; did you mean 'a'"),
    (lambda at: read(at, {"header": True, "joints": {"wheel": {"position": 9}}}), WRONG,
        "invalid column index 9 at data line 1 with 3 columns"),
    (lambda at: read(at, {"frames": {"laser": {"qw": "a"}}}), WRONG, "frames.laser: lacks qx, qy, qz"),
    (lambda at: read(at, {}), WRONG, "its mapping names no column of a joint or a frame"),
    (lambda at: read(at, WHEEL, "time,a\n0,0\ninf,1\n"), WRONG, r"position\(wheel\): stamp 1 is inf, expected a"),
    (lambda at: read_archive(at, WHEEL, time=np.arange(3), a=np.zeros((3, 2))), WRONG,
        r"'a' has shape \(3, 2\), expected a vector, or name\[k\]"),
    (lambda at: read_archive(at, WHEEL, time=np.arange(3)), WRONG, "no array 'a'"),
    # calibrations
    (lambda at: calibrated(at, []), WRONG, "name at least one unknown parameter"),
    (lambda at: calibrated(at, [WheelRadius("lef")]), MODEL, "no frame 'lef' in robot 'vehicle'; did you mean 'left'"),
    (lambda at: calibrated(at, [WheelRadius("base")]), WRONG, "radius of base: no wheel or ball rolls there"),
    (lambda at: calibrated(at, [WheelRadius("left")] * 2), WRONG, "the radius of left is named twice"),
    (lambda at: calibrated(at, [JointShift("root_joint", "x")]), WRONG, "along x: 'root_joint' is the base"),
    (lambda at: calibrated(at, [JointShift({}, "x")]), WRONG, "place of joints: expected a joint, or joints with"),
    (lambda at: calibrated(at, [EncoderScale("left_joit")]), MODEL, "no joint 'left_joit' in robot 'vehicle'; did you"),
    (lambda at: calibrated(at, PLACE, held_out=1.0), WRONG, "held_out: expected a share of 0 to 0.9, found 1.0"),
    (lambda at: calibrated(at, PLACE, sensor="left"), WRONG,
        "sensor 'left' is on a body behind joint 'left_joint', expected a frame of the base"),
    (lambda at: calibrated(at, PLACE, sensor="base"), WRONG, r"the log has no pose\(base\); did you mean 'pose\(sens"),
    (lambda at: calibrated(at, PLACE, heading=False, base="free"), WRONG, "calibration needs a planar base"),
    (lambda at: calibrated(at, [SensorPlace("yaw")], heading=False), UNSEEN, "not determine the yaw of the sensor"),
    (lambda at: calibrated(at, PLACE, TRICYCLE, without="front_joint"), WRONG,
        "joints fork_joint do not determine the motion of the base: expected positions of front_joint, rear_joint too"),
    # base parameters
    (lambda at: rnc.base_parameters(pendulum(), samples=0), WRONG, "expected samples of at least 1 .* found 0"),
    (lambda at: rnc.base_parameters(pendulum(), tolerance=0.0), WRONG, "a tolerance between 0 and 1, found .* 0.0"),
])  # fmt: skip
def test_what_does_not_fit_is_refused_in_one_line(call, error, words, tmp_path):
    with pytest.raises(error, match=words) as refusal:
        call(tmp_path)
    assert "\n" not in str(refusal.value)
