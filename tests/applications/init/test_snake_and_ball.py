"""Drafts of snakes on passive wheels and of spherical robots."""

from xml.etree import ElementTree

import numpy as np
import pytest

from rnc_pin.applications.init import DraftOptions, draft
from rnc_pin.applications.init.evidence import named_as_driven
from rnc_pin.applications.scenario.execution import execute
from rnc_pin.applications.scenario.files import read_yaml
from rnc_pin.applications.scenario.scenario import Scenario
from urdf_parts import ball, cart, snake, transmissions

pytestmark = pytest.mark.usefixtures("brief")


def drafted(text, folder, **wishes):
    (folder / "robot.urdf").write_text(text)
    path = folder / "robot.yaml"
    path.write_text(draft(str(folder / "robot.urdf"), folder, DraftOptions(**wishes)))
    words = path.read_text()
    return read_yaml(path), next(line for line in words.splitlines() if line.startswith("# base")), path


def test_a_snake_winds_its_way(tmp_path):
    """It goes one wave, and its joints swing one after the other as far as the serpenoid asks for."""
    content, kind, path = drafted(snake(6, forward=1, drawn=True), tmp_path)
    assert kind == "# base planar: a snake of 6 bodies on wheels that nothing drives"
    assert content["constraints"] == [{"no_side_slip": {"frame": f"body_{k}_right", "axis": "y"}} for k in range(6)]
    prepared = Scenario.load(str(path), {"simulation.dt": 0.04, "controller.tracker": "computed_torque"}).build()
    result = execute(prepared)
    assert result.summary["outcome"] == "completed"
    values = [prepared.experiment.reduced.robot.joint_values(q) for q in result.trajectory.q[::2]]
    x = [each["root_joint"][0] for each in values]
    way = content["reference"]["primary"]["via_points"]["points"][-1][0]
    assert way == pytest.approx(-6 * 0.2)  # as long as the body
    assert 0.85 < (x[-1] - x[0]) / way < 1.0  # shorter for its bends
    joints = np.array([[each[f"yaw_{k}"] for k in range(1, 6)] for each in values])
    swings = np.ptp(joints, axis=0) / 2
    np.testing.assert_allclose(swings, 2 * 0.5 * np.sin(np.pi / 6), rtol=0.15)


def test_the_wheels_of_a_snake_are_not_driven(tmp_path):
    content, kind, path = drafted(snake(5), tmp_path)
    assert kind == "# base planar: a snake of 5 bodies on wheels that nothing drives"
    assert content["actuators"] == [f"yaw_{k}" for k in range(1, 5)]
    assert "lock" not in content["robot"]
    assert len([each for each in content["constraints"] if "rolling_wheel" in each]) == 10
    assert content["view"]["ground"] == pytest.approx(-0.04)
    assert content["reference"]["primary"]["via_points"]["points"][-1][0] == pytest.approx(5 * 0.2)  # it lies behind
    summary = execute(Scenario.load(str(path), {"simulation.duration": 0.1})).summary
    assert summary["outcome"] == "completed"
    assert summary["constraint_residual_max"] < 1e-9


@pytest.mark.parametrize(("options", "words"), [
    ({"yaw": "hitch_{}"}, "trailers"),  # towed
    ({"effort": 0.0}, "car"),  # nothing drives the joints
    ({"bodies": 3}, "car"),  # too few that they would be a snake without being called one
])  # fmt: skip
def test_other_rows_of_bodies_are_no_snakes(options, words, tmp_path):
    _, kind, _ = drafted(snake(**{"bodies": 4, **options}), tmp_path)
    assert "snake" not in kind
    assert words in kind or "any direction" in kind or "differential" in kind


def test_what_the_file_drives_decides(tmp_path):
    """Transmissions on the wheels make no snake; on joints without an effort they do."""
    driven = transmissions(*(f"yaw_{k}" for k in range(1, 4)))
    assert "a snake of 4 bodies" in drafted(snake(4, effort=0.0, extra=driven), tmp_path)[1]
    driven += transmissions("body_0_left_joint", "body_0_right_joint")
    assert "snake" not in drafted(snake(4, extra=driven), tmp_path)[1]


@pytest.mark.parametrize(("text", "expected"), [
    ('<transmission><type/><joint name="a"><hardwareInterface/></joint></transmission>', {"a"}),
    ('<ros2_control><joint name="a"><command_interface name="effort"/></joint></ros2_control>', {"a"}),
    ('<ros2_control><joint name="a"><state_interface name="position"/></joint></ros2_control>', set()),
    ('<gazebo><plugin filename="diff"><left_joint>a</left_joint><right_joint>b</right_joint></plugin></gazebo>',
     {"a", "b"}),
    ('<gazebo><plugin filename="x"><joint_name>a, b</joint_name><torque>a</torque></plugin></gazebo>', {"a", "b"}),
    ('<gazebo><plugin filename="libgazebo_ros_joint_state_publisher.so"><jointName>a</jointName></plugin></gazebo>',
     set()),
    ('<transmission><joint name="stranger"/></transmission>', set()),
])  # fmt: skip
def test_joints_that_a_file_drives(text, expected):
    joints = '<joint name="a"/><joint name="b"/>'
    named, is_list = named_as_driven(ElementTree.fromstring(f"<robot>{joints}{text}</robot>"))
    assert set(named) == expected
    assert is_list == (bool(expected) and "plugin" not in text)


# ---------------------------------------------------------------------- spherical robots


def test_a_ball_rolls_as_its_pendulum_turns(tmp_path):
    """The shell turns the other way round than the pendulum in it, and goes as far as it turns."""
    content, kind, path = drafted(ball(), tmp_path)
    assert kind == "# base free: a ball that joints inside it roll"
    assert content["constraints"] == [{"rolling_ball": {"frame": "shell", "radius": 0.3}}]
    assert content["actuators"] == ["drive", "lean"]
    assert content["initial"]["q"]["root_joint"][:3] == [0, 0, 0.3]
    prepared = Scenario.load(str(path), {"simulation.dt": 0.02}).build()
    result = execute(prepared)
    assert result.summary["outcome"] == "completed"
    assert result.summary["constraint_residual_max"] < 1e-8
    q = result.trajectory.q
    np.testing.assert_allclose(q[:, 2], 0.3, atol=1e-9)
    values = prepared.experiment.reduced.robot.joint_values(q[-1])
    assert result.summary["max_error"]["drive"] < 0.3
    gone = q[-1, 0] - q[0, 0]
    # The pendulum hangs nearly straight below, so that the shell turns as far as the drive did, against it.
    assert gone == pytest.approx(-0.3 * 3.0, rel=0.25)
    assert values["root_joint"][0] == pytest.approx(gone)


def test_a_shell_may_be_a_mesh(tmp_path):
    lines, faces, size = [], [], 16
    for i in range(size + 1):
        for j in range(size):
            a, b = np.pi * i / size, 2 * np.pi * j / size
            lines.append(f"v {0.3 * np.sin(a) * np.cos(b):.6f} {0.3 * np.sin(a) * np.sin(b):.6f} {0.3 * np.cos(a):.6f}")
    for i in range(size):
        for j in range(size):
            one, other = i * size + j + 1, i * size + (j + 1) % size + 1
            faces.append(f"f {one} {other} {one + size}")
    (tmp_path / "shell.obj").write_text("\n".join([*lines, *faces]) + "\n")
    content, kind, _ = drafted(ball('<mesh filename="shell.obj"/>'), tmp_path)
    assert kind == "# base free: a ball that joints inside it roll"
    assert content["constraints"][0]["rolling_ball"]["radius"] == pytest.approx(0.3, abs=1e-4)


@pytest.mark.parametrize("text", [
    ball('<box size="0.6 0.6 0.6"/>'), ball('<sphere radius="0.1"/>'), ball(effort=0.0).replace("shell", "core"),
])  # fmt: skip
def test_other_bodies_are_no_balls(text, tmp_path):
    """A box, a ball that something sticks out of, and one in which nothing is driven."""
    assert "a ball that" not in drafted(text, tmp_path)[1]


# ---------------------------------------------------------------------- carts


def test_wheels_that_the_file_does_not_drive_are_not_driven(tmp_path):
    """Four wheels of which a plugin drives the rear ones: the others roll along."""
    content, _, path = drafted(cart(front=0.25, rear=-0.25), tmp_path)
    assert content["actuators"] == ["rear_left_joint", "rear_right_joint"]
    assert (
        "Which wheels are driven? rear_left_joint, rear_right_joint (95 % sure: named by a plugin)" in path.read_text()
    )
    assert "# - front_left_joint  # uncomment it if it has a motor" in path.read_text()
    assert execute(Scenario.load(str(path), {"simulation.duration": 0.1})).summary["outcome"] == "completed"
