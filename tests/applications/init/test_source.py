"""Robot file of a draft: joints that its limits lock, before anything is guessed from its shape."""

import pytest
import yaml

import urdf_parts
from rnc_pin.applications.init import DraftOptions, draft
from urdf_parts import link

pytestmark = pytest.mark.usefixtures("brief")

FREE = (-2, 2)


def joint(name, parent, limits, more="", kind="revolute", axis="0 0 1", mass=1.0):
    """A joint of this name and the link that it carries, with ``_link`` after the name."""
    child = link(f"{name}_link", mass) if mass else f'<link name="{name}_link"/>'
    turning = urdf_parts.joint(name, parent, f"{name}_link", (0.3, 0, 0), axis, kind, limits=limits)
    return child + turning.replace("</joint>", f"{more}</joint>")


ARM = joint("shoulder", "base", FREE) + joint("elbow", "shoulder_link", FREE)


def drafted(joints, folder, **options):
    """(content, text) of the draft for an arm with these joints."""
    (folder / "r.urdf").write_text(urdf_parts.robot(link("base", 5.0), ARM, joints))
    text = draft(str(folder / "r.urdf"), folder, DraftOptions(base="fixed", **options))
    return yaml.safe_load(text), text


@pytest.mark.parametrize(("limits", "given"), [
    ((0, 0), {}), ((0.3, 0.3), {"kind": "prismatic"}), ((0.3, 0.30001), {"axis": "1 0 0", "mass": 0.0}),
])  # fmt: skip
def test_a_joint_without_a_range_is_locked_where_its_limits_hold_it(limits, given, tmp_path):
    """A joint of a force sensor: behind it there is a tool, or nothing with a mass."""
    content, text = drafted(joint("sensor", "elbow_link", limits, **given), tmp_path)
    assert content["robot"]["lock"] == pytest.approx({"sensor": limits[0]}, abs=1e-5)
    assert content["actuators"] == content["task"]["primary"] == ["shoulder", "elbow"]
    assert "# Assumed: locked, because the limits of the file leave no motion: sensor." in text


SENSOR = joint("sensor", "elbow_link", (0.2, 0.2), axis="1 0 0")


@pytest.mark.parametrize(("parts", "options", "lock", "moving"), [
    (SENSOR + joint("tool", "sensor_link", FREE), {}, {"sensor": 0.2}, ["shoulder", "elbow", "tool"]),
    (SENSOR, {"lock": {"sensor": 0.1}}, {"sensor": 0.1}, ["shoulder", "elbow"]),  # as the user chose
    (joint("finger", "elbow_link", (0, 0), '<mimic joint="elbow"/>'), {}, None, ["shoulder", "elbow"]),  # led
    (SENSOR + joint("gauge", "elbow_link", FREE, '<mimic joint="sensor" multiplier="2"/>'), {}, {"sensor": 0.2},
        ["shoulder", "elbow"]),
], ids=["tool", "chosen", "mimic", "follower"])  # fmt: skip
def test_what_is_locked_beside_a_joint_without_a_range(parts, options, lock, moving, tmp_path):
    content, _ = drafted(parts, tmp_path, **options)
    assert (content["robot"].get("lock"), content["task"]["primary"]) == (lock, moving)
    if "gauge" in parts:
        assert content["initial"]["q"]["gauge"] == pytest.approx(0.4)


def test_a_file_in_which_no_joint_has_a_range_states_none(tmp_path):
    text = draft("double_pendulum", tmp_path)
    assert yaml.safe_load(text)["task"]["primary"] == ["joint1", "joint2"]
    assert "the file states no limits: lower and upper are equal for every joint" in " ".join(text.split("\n# "))
