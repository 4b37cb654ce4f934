"""Logs from tables and archives, and from motions."""

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc

TIME, ANGLE = 1_700_000_000.0 + np.arange(50) * 0.02, 0.3 * np.arange(50)
TICKS = np.mod(np.round(ANGLE * 4096 / (2 * np.pi)), 4096)
X, YAW = 0.1 * ANGLE, 0.02 * np.arange(50)
KEYS = {
    "joints": {"wheel": {"position": {"column": "ticks", "ticks": 4096, "wrap": 4096, "scale": -0.5}}},
    "frames": {"laser": {"x": "x", "yaw": "yaw"}},
}


def check(log):
    assert log.duration == pytest.approx(0.98)
    wheel, laser = log.channel("position", "wheel"), log.channel("pose", "laser")
    np.testing.assert_allclose(wheel.values[:, 0], -0.5 * ANGLE, atol=2 * np.pi / 4096)
    np.testing.assert_allclose(laser.values[:, 0], X)
    np.testing.assert_allclose(2 * np.arctan2(laser.values[:, 5], laser.values[:, 6]), YAW, atol=1e-12)
    assert not laser.values[:, 1:5].any()


def write_table(path, separator=", ", cell=None):
    lines = [separator.join(["time", "ticks", "x", "yaw"])]
    for k, row in enumerate(zip(TIME, TICKS, X, YAW, strict=True)):
        cells = [repr(float(each)) for each in row]
        if cell and cell[0] == k:
            cells[cell[1]] = cell[2]
        lines.append(separator.join(cells))
    path.write_text("# written by a test\n" + "\n".join(lines) + "\n\n")
    return path


@pytest.mark.parametrize(("name", "text"), [("comma", ", "), ("semicolon", ";"), ("tab", "\t"), ("space", "   ")])
def test_a_text_table(tmp_path, name, text):
    check(rnc.Log.read(write_table(tmp_path / "log.csv", text), {"separator": name, **KEYS}))


def test_a_mapping_file_and_columns_by_number(tmp_path):
    mapping = tmp_path / "log.yaml"
    mapping.write_text(
        "time: 0\nheader: true\njoints: {wheel: {position: {column: 1, ticks: 4096, wrap: 4096, scale: -0.5}}}\n"
        "frames: {laser: {x: 2, yaw: 3}}\n"
    )
    check(rnc.Log.read(write_table(tmp_path / "log.txt"), mapping))


def test_an_archive(tmp_path):
    np.savez(tmp_path / "log.npz", t=TIME, a=np.stack([TICKS, X], axis=1), yaw=YAW)
    counter = {**KEYS["joints"]["wheel"]["position"], "column": "a[0]"}
    keys = {"time": "t", "joints": {"wheel": {"position": counter}}, "frames": {"laser": {"x": "a[1]", "yaw": "yaw"}}}
    check(rnc.Log.read(tmp_path / "log.npz", keys))


def test_missing_cells_are_left_out(tmp_path):
    log = rnc.Log.read(write_table(tmp_path / "log.csv", cell=(7, 2, "")), KEYS)
    assert log.channel("pose", "laser").repairs == ("1 sample without a number",)
    assert len(log.channel("position", "wheel").time) == 50


def test_a_counter_wraps_in_the_order_of_time(tmp_path):
    path = write_table(tmp_path / "log.csv")
    head, *lines = path.read_text().split("\n")[1:-2]
    path.write_text("\n".join([head, *np.random.default_rng(0).permutation(lines)]))
    check(rnc.Log.read(path, KEYS))


def test_the_log_of_a_motion_has_what_sensors_would_see():
    robot = rnc.Robot.from_urdf("differential_drive.urdf", base="planar")
    time = np.linspace(0.0, 4.0, 81)
    v = np.tile([0.5, 0.0, 1.0, 3.0, 4.0], (81, 1))[:, : robot.nv]
    q = [robot.configuration()]
    for _ in time[1:]:
        q.append(pin.integrate(robot.model, q[-1], v[0] * 0.05))
    log = rnc.Log.of_motion(robot, time, np.array(q), v, {"left_wheel_joint": time}, ["left_wheel"])
    wheel = log.channel("position", "left_wheel_joint")
    start = robot.velocity_indices("left_wheel_joint").start
    np.testing.assert_allclose(wheel.values[:, 0], v[0, start] * time, atol=1e-9)  # more than a turn
    assert log.channel("effort", "left_wheel_joint").values[-1, 0] == 4.0
    assert log.names("pose") == ("left_wheel",)
