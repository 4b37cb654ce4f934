"""Logs from tables, archives and bags that their own libraries write, and from motions."""

import os
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from places import ROOT

MEASURED = Path(os.environ.get("RNC_PIN_LOGS", ROOT.parent / "shared" / "data" / "logs"))
TIME = 1_700_000_000.0 + np.arange(50) * 0.02
ANGLE = 0.3 * np.arange(50)
TICKS = np.mod(np.round(ANGLE * 4096 / (2 * np.pi)), 4096)
X, YAW = 0.1 * ANGLE, 0.02 * np.arange(50)
KEYS = {
    "joints": {"wheel": {"position": {"column": "ticks", "ticks": 4096, "wrap": 4096, "scale": -0.5}}},
    "frames": {"laser": {"x": "x", "yaw": "yaw"}},
}


def check(log):
    """The log is that of the columns above."""
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
    path = write_table(tmp_path / "log.csv", text)
    check(rnc.Log.read(path, {"separator": name, **KEYS}))


def test_a_mapping_file_and_columns_by_number(tmp_path):
    mapping = tmp_path / "log.yaml"
    mapping.write_text(
        "time: 0\nheader: true\njoints: {wheel: {position: {column: 1, ticks: 4096, wrap: 4096, scale: -0.5}}}\n"
        "frames: {laser: {x: 2, yaw: 3}}\n"
    )
    check(rnc.Log.read(write_table(tmp_path / "log.txt"), mapping))


def test_an_archive(tmp_path):
    np.savez(tmp_path / "log.npz", t=TIME, a=np.stack([TICKS, X], axis=1), yaw=YAW)
    keys = {
        "time": "t",
        "joints": {"wheel": {"position": {**KEYS["joints"]["wheel"]["position"], "column": "a[0]"}}},
        "frames": {"laser": {"x": "a[1]", "yaw": "yaw"}},
    }
    check(rnc.Log.read(tmp_path / "log.npz", keys))


def write_bag(path, version):
    """A bag of ROS 1, of ROS 2 in SQLite or in MCAP; wheel and laser have other rates and stamps than the recording."""
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import StoragePlugin
    from rosbags.rosbag2 import Writer as Writer2
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if version == "bag" else Stores.ROS2_HUMBLE)
    if version == "bag":  # the package of these messages is not in the store of ROS 1
        store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage"))
    types = store.types
    plugin = {"mcap": StoragePlugin.MCAP, "sqlite": StoragePlugin.SQLITE3}
    writer = Writer1(path) if version == "bag" else Writer2(path, version=9, storage_plugin=plugin[version])
    serialize = store.serialize_ros1 if version == "bag" else store.serialize_cdr

    def vector(kind, *values):
        return types[f"geometry_msgs/msg/{kind}"](*values)

    def header(stamp, frame=""):
        time = types["builtin_interfaces/msg/Time"](int(stamp // 10**9), int(stamp % 10**9))
        counted = {"seq": 0} if version == "bag" else {}
        return types["std_msgs/msg/Header"](stamp=time, frame_id=frame, **counted)

    def turned(yaw):
        return vector("Quaternion", 0.0, 0.0, np.sin(yaw / 2), np.cos(yaw / 2))

    with writer:
        kinds = {
            "/joint_states": "sensor_msgs/msg/JointState", "/odom": "nav_msgs/msg/Odometry",
            "/tf": "tf2_msgs/msg/TFMessage", "/pose": "geometry_msgs/msg/PoseStamped",
            "/cmd_vel": "geometry_msgs/msg/Twist",
        }  # fmt: skip
        topics = {name: writer.add_connection(name, kind, typestore=store) for name, kind in kinds.items()}

        def write(topic, stamp, *values, **named):
            message = types[kinds[topic]](*values, **named)
            writer.write(topics[topic], stamp, serialize(message, kinds[topic]))

        covariance = np.zeros(36)
        for k in range(50):
            stamp = round(TIME[0]) * 10**9 + k * 20_000_000
            recorded = stamp + 3_000_000
            write("/joint_states", recorded, header(stamp), ["other", "left"], np.array([9.0, ANGLE[k]]),
                  np.array([8.0, 15.0]), np.array([]))  # fmt: skip
            place = vector("Pose", vector("Point", X[k], 0.0, 0.0), turned(YAW[k]))
            twist = vector("Twist", vector("Vector3", 1.5, 0.0, 0.0), vector("Vector3", 0.0, 0.0, 1.0))
            write(
                "/odom", recorded, header(stamp, "odom"), "base_link", vector("PoseWithCovariance", place, covariance),
                vector("TwistWithCovariance", twist, covariance),
            )  # fmt: skip
            write("/pose", recorded, header(stamp), place)
            moved = vector("Transform", vector("Vector3", X[k], 0.0, 0.0), turned(YAW[k]))
            write("/tf", recorded, [vector("TransformStamped", header(stamp, "/map"), "/laser_link", moved)])
            write("/cmd_vel", recorded, vector("Vector3", 1.0, 0.0, 0.0), vector("Vector3", 0.0, 0.0, 0.5))
    return path


@pytest.mark.parametrize("version", ["bag", "sqlite", "mcap"])
def test_a_bag_that_rosbags_writes(tmp_path, version):
    pytest.importorskip("rosbags")
    path = write_bag(tmp_path / ("log.bag" if version == "bag" else "log"), version)
    topics = {
        "/joint_states": {"joints": {"left": "wheel"}},
        "/odom": {"pose": "base"},
        "/tf": {"frames": {"laser_link": "laser"}, "parent": "map"},
        "/pose": {"pose": "tool"},
    }
    paths = [path, *path.glob("*.mcap")] if path.is_dir() else [path]  # MCAP alone too
    for each in paths:
        log = rnc.Log.read(each, {"topics": topics})
        np.testing.assert_allclose(log.channel("position", "wheel").values[:, 0], ANGLE)
        np.testing.assert_allclose(log.channel("velocity", "wheel").values, 15.0)
        assert "effort(wheel)" not in log.channels  # measured by no message
        for frame in ("base", "laser", "tool"):
            pose = log.channel("pose", frame)
            np.testing.assert_allclose(pose.values[:, 0], X)
            np.testing.assert_allclose(2 * np.arctan2(pose.values[:, 5], pose.values[:, 6]), YAW, atol=1e-12)
            np.testing.assert_allclose(pose.time, TIME - TIME[0], atol=1e-6)
    log = rnc.Log.read(path, {"topics": {"/pose": {"pose": "tool", "stamp": "bag"}}})  # the time of recording
    np.testing.assert_allclose(np.diff(log.channel("pose", "tool").time), 0.02, atol=1e-6)


def test_bags_that_do_not_fit_are_refused(tmp_path):
    pytest.importorskip("rosbags")
    path = write_bag(tmp_path / "log.bag", "bag")
    broken = tmp_path / "broken.bag"
    broken.write_bytes(path.read_bytes()[:3000])
    cases = [
        (path, {"/odm": {"pose": "base"}}, "no topic '/odm'; did you mean '/odom'?"),
        (path, {"/tf": {"pose": "base"}}, "topic '/tf' with TFMessage: expected frames, found pose"),
        (path, {"/cmd_vel": {"pose": "base"}}, "topic '/cmd_vel' has messages geometry_msgs/msg/Twist"),
        (path, {"/joint_states": {"joints": {"lef": "wheel"}}},
         "no message of /joint_states has a value that the mapping uses"),
        (broken, {"/odom": {"pose": "base"}}, "cannot be read as a bag"),
        (tmp_path / "none.bag", {"/odom": {"pose": "base"}}, "No such file or directory"),
    ]  # fmt: skip
    for file, topics, message in cases:
        with pytest.raises(rnc.ConfigurationError) as error:
            rnc.Log.read(file, {"topics": topics})
        assert str(error.value).startswith(f"{file}: {message}"), error.value
        assert "\n" not in str(error.value)


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


@pytest.mark.skipif(not MEASURED.is_dir(), reason=f"measured logs are not in {MEASURED}")
def test_measured_tables():
    log = rnc.Log.read(
        MEASURED / "tricycle" / "dataset.txt",
        {
            "separator": "space",
            "time": 1,
            "joints": {
                "steering": {"position": {"column": 3, "ticks": 8192, "wrap": 8192, "scale": 0.1}},
                "traction": {"position": {"column": 4, "ticks": 5000, "wrap": 4294967296}},
            },
            "frames": {"laser": {"x": 10, "y": 11, "yaw": 12}},
        },
    )
    steering, traction = log.channel("position", "steering"), log.channel("position", "traction")
    assert len(steering.time) == 2434
    assert np.abs(steering.values).max() < 0.25  # it wraps at zero
    # The counter overflows at 2^32 and goes on: from 4294859756 to 5543456.
    turns = (5543456 + 2**32 - 4294859756) / 5000
    assert traction.values[-1, 0] - traction.values[0, 0] == pytest.approx(2 * np.pi * turns)
    arm = rnc.Log.read(
        MEASURED / "tiago" / "tiago_effort.csv",
        {"time": "t", "joints": {"torso_lift_joint": {"effort": "- torso_lift_joint_effort"}}},
    )
    assert arm.channel("effort", "torso_lift_joint").values[1, 0] == 1.653
