"""Robot file of a draft: joints that its limits lock, before anything is guessed from its shape."""

import pytest
import yaml

from rnc_pin.applications.init import DraftOptions, draft

pytestmark = pytest.mark.usefixtures("brief")

INERTIAL = '<inertial><mass value="{}"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>'
FREE = 'lower="-2" upper="2"'


def joint(name, parent, limits, more="", kind="revolute", axis="0 0 1", mass=1.0):
    """A joint of this name and the link that it carries, with ``_link`` after the name."""
    inertial = INERTIAL.format(mass) if mass else ""
    return (
        f'<link name="{name}_link">{inertial}</link><joint name="{name}" type="{kind}"><origin xyz="0.3 0 0"/>'
        f'<parent link="{parent}"/><child link="{name}_link"/><axis xyz="{axis}"/>'
        f'<limit {limits} effort="9" velocity="2"/>{more}</joint>'
    )


def drafted(joints, folder, **options):
    """(content, text) of the draft for a robot with these joints."""
    (folder / "r.urdf").write_text(f'<robot name="r"><link name="base">{INERTIAL.format(5)}</link>{joints}</robot>')
    text = draft(str(folder / "r.urdf"), folder, DraftOptions(**options))
    return yaml.safe_load(text), text


ARM = joint("shoulder", "base", FREE) + joint("elbow", "shoulder_link", FREE)


@pytest.mark.parametrize(("kind", "axis"), [("revolute", "1 0 0"), ("prismatic", "0 0 1")])
@pytest.mark.parametrize("limits", ['lower="0" upper="0"', 'lower="0.3" upper="0.3"', 'lower="0.3" upper="0.30001"'])
def test_a_joint_without_a_range_is_locked_where_its_limits_hold_it(kind, axis, limits, tmp_path):
    """A joint of a force sensor: behind it there is a tool, or nothing with a mass."""
    for mass in (0.2, 0.0):
        sensor = joint("sensor", "elbow_link", limits, kind=kind, axis=axis, mass=mass)
        content, text = drafted(ARM + sensor, tmp_path, base="fixed")
        value = float(limits.split('"')[1])
        assert content["robot"]["lock"] == pytest.approx({"sensor": value}, abs=1e-5)
        assert content["actuators"] == content["task"]["primary"] == ["shoulder", "elbow"]
        assert "# Assumed: locked, because the limits of the file leave no motion: sensor." in text


def test_a_tool_behind_a_locked_sensor_can_move(tmp_path):
    sensor = joint("sensor", "elbow_link", 'lower="0" upper="0"', axis="1 0 0")
    content, _ = drafted(ARM + sensor + joint("tool", "sensor_link", FREE), tmp_path, base="fixed")
    assert content["task"]["primary"] == ["shoulder", "elbow", "tool"]


def test_a_locked_joint_keeps_the_value_that_the_user_chose(tmp_path):
    sensor = joint("sensor", "elbow_link", 'lower="0" upper="0"')
    content, text = drafted(ARM + sensor, tmp_path, base="fixed", lock={"sensor": 0.1})
    assert content["robot"]["lock"] == {"sensor": 0.1}
    assert "leave no motion" not in text


def test_a_joint_that_mimics_is_not_locked_by_its_own_limits(tmp_path):
    """Its leader moves it; some files leave zeros here."""
    finger = joint("finger", "elbow_link", 'lower="0" upper="0"', '<mimic joint="elbow"/>')
    content, _ = drafted(ARM + finger, tmp_path, base="fixed")
    assert "lock" not in content["robot"]
    assert content["task"]["primary"] == ["shoulder", "elbow"]


def test_what_follows_a_locked_joint_stands_still(tmp_path):
    sensor = joint("sensor", "elbow_link", 'lower="0.2" upper="0.2"')
    gauge = joint("gauge", "elbow_link", FREE, '<mimic joint="sensor" multiplier="2"/>')
    content, _ = drafted(ARM + sensor + gauge, tmp_path, base="fixed")
    assert content["robot"]["lock"] == {"sensor": 0.2}
    assert content["task"]["primary"] == ["shoulder", "elbow"]
    assert content["initial"]["q"]["gauge"] == pytest.approx(0.4)


def test_a_file_in_which_no_joint_has_a_range_states_none(tmp_path):
    """As the double pendulum of example-robot-data."""
    text = draft("double_pendulum", tmp_path)
    assert yaml.safe_load(text)["task"]["primary"] == ["joint1", "joint2"]
    assert "the file states no limits: lower and upper are equal for every joint" in " ".join(text.split("\n# "))
