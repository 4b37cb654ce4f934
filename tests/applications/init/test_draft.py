"""Drafted scenarios: what they guess, and that they run as they are."""

import re
from pathlib import Path

import numpy as np
import pytest
import yaml

from places import ROOT
from rnc_pin.applications.init import DraftOptions, draft
from rnc_pin.applications.scenario.execution import execute
from rnc_pin.applications.scenario.files import read_yaml
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.robots.robot_files import find_urdf
from urdf_parts import joint, link, robot, wheel, write

pytestmark = [
    pytest.mark.filterwarnings(
        "error",
        "ignore:zmq.eventloop.ioloop is deprecated:DeprecationWarning",
        "ignore:.* rounded in the file:rnc_pin.errors.ModelWarning",
        "ignore:centauro.* has a <limit> without lower and upper:rnc_pin.errors.ModelWarning",
    ),
    pytest.mark.usefixtures("brief"),
]


def drafted(source, folder, **options):
    """(the scenario's content, its path)."""
    path = folder / "draft.yaml"
    path.write_text(draft(str(source), folder, DraftOptions(**options)))
    return read_yaml(path), path


def test_a_draft_names_no_folder_of_the_computer(tmp_path):
    (tmp_path / "robots").mkdir()
    (tmp_path / "mine").mkdir()
    robot = tmp_path / "robots" / "car.urdf"
    robot.write_text(find_urdf("car.urdf", tmp_path).read_text())
    content, path = drafted(robot, tmp_path / "mine")
    assert content["robot"]["urdf"] == "../robots/car.urdf"
    text = path.read_text()
    assert not [folder for folder in (tmp_path, ROOT, Path.home()) if str(folder) in text]
    assert re.findall(r"[\s'\"=:]/\w\S*", text) == []


def outcome_of(path, duration, warnings=()):
    options = {"simulation.duration": duration, **({"simulation.dt": 0.01} if duration > 1 else {})}
    prepared = Scenario.load(str(path), options).build()
    assert [each.split(":")[0] for each in prepared.experiment.warnings] == list(warnings)
    return execute(prepared).summary


def radii(content):
    wheels = [each["rolling_wheel"] for each in content["constraints"] if "rolling_wheel" in each]
    return {wheel["frame"]: wheel["radius"] for wheel in wheels}


BASES = {  # wheels and their radii, how many outputs, the base's
    "tiago_no_hand": ({"wheel_left_link": 0.0985, "wheel_right_link": 0.0985}, 12,
        ["base_link_speed_x", "base_link_yaw"]),
    "tiago_pro": ({f"wheel_{end}_{side}_link": 0.0762 for end in ("front", "rear") for side in ("left", "right")}, 22,
        ["base_link_x", "base_link_y", "base_link_yaw"]),
    "centauro": ({}, 18, ["pelvis_x", "pelvis_y", "pelvis_yaw"]),
}  # fmt: skip


@pytest.mark.parametrize(("name", "expected"), BASES.items(), ids=BASES)
def test_a_draft_for_a_wheeled_robot_runs_as_it_is(name, expected, tmp_path):
    wheels, size, base = expected
    content, path = drafted(name, tmp_path)
    assert (content["robot"]["base"], radii(content)) == ("planar", pytest.approx(wheels))
    assert (len(content["task"]["primary"]), content["task"]["primary"][: len(base)]) == (size, base)
    summary = outcome_of(path, 0.2 if name == "tiago_no_hand" else 0.05)
    assert summary["outcome"] == "completed"
    assert max(summary["max_error"].values()) < 5e-3
    assert summary["constraint_residual_max"] < 1e-9


@pytest.mark.parametrize(("name", "constraints", "primary"), [
    ("space_robot.urdf", [{"momentum": "platform"}], ["joint_1", "joint_2", "joint_3"]),
    ("mobile_manipulator.urdf", [{"no_side_slip": {"frame": "axle", "axis": "y"}}],
        ["base_speed_x", "base_yaw", "joint_1", "joint_2"]),
    ("fire_truck.urdf", [{"no_side_slip": {"frame": f"{each}_axle", "axis": "y"}} for each in ("tractor", "front",
        "rear")], ["tractor_speed_x", "front_steering", "rear_steering"]),
    ("panda", [], [*(f"panda_joint{k}" for k in range(1, 8)), "panda_finger_joint1"]),
])  # fmt: skip
def test_a_draft_for_a_robot_without_wheels_runs_as_it_is(name, constraints, primary, tmp_path):
    content, path = drafted(name, tmp_path)
    assert (content.get("constraints", []), content["task"]["primary"]) == (constraints, primary)
    if "no_side_slip" in str(constraints):
        assert "# Assumed: wheels are not joints of this file" in path.read_text()
    summary = outcome_of(path, 0.5)
    assert summary["outcome"] == "completed"
    assert max(summary["max_error"].values()) < 1e-2


PAIR = wheel("left", "base", (0, 0.2, 0)) + wheel("right", "base", (0, -0.2, 0))


def cart(*parts):
    return robot(link("base", 10, '<box size="0.5 0.3 0.1"/>'), *parts, name="cart")


def test_the_radius_of_a_mesh(tmp_path):
    angles = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    corners = [(0.123 * np.cos(a), y, 0.123 * np.sin(a)) for a in angles for y in (-0.02, 0.02)]
    faces = [(i, (i + 2) % 32, i + 1 if i % 2 == 0 else (i + 1) % 32) for i in range(32)]
    lines = [f"v {x:.9f} {y:.9f} {z:.9f}" for x, y, z in corners] + [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in faces]
    (tmp_path / "wheel.obj").write_text("\n".join(lines) + "\n")
    parts = [
        link(name, shape='<mesh filename="wheel.obj"/>') + joint(f"{name}_joint", "base", name, (0, y, 0))
        for name, y in (("left", 0.2), ("right", -0.2))
    ]
    content, _ = drafted(write(tmp_path / "cart.urdf", cart(*parts)), tmp_path)
    assert radii(content) == pytest.approx({"left": 0.123, "right": 0.123}, abs=1e-5)


def test_init_writes_what_inspect_and_run_accept(call, tmp_path, monkeypatch, no_pictures):
    monkeypatch.chdir(tmp_path)
    write(tmp_path / "cart.urdf", cart(PAIR))
    status, out, error = call("init", "cart.urdf")
    assert (status, error) == (0, "")
    assert "wrote cart.yaml" in out
    status, out, error = call("inspect", "cart.yaml", "--samples", 4, "--json")
    assert (status, error) == (0, "")
    assert yaml.safe_load(out)["actuation_rank"] == 2
    assert call("run", "cart.yaml", "--set", "simulation.duration=0.1")[0] == 0
    before = (tmp_path / "cart.yaml").read_bytes()
    status, out, error = call("init", "cart.urdf", "--base", "free")
    assert (status, out) == (2, "")
    assert "add --force" in error
    assert (tmp_path / "cart.yaml").read_bytes() == before
    assert call("init", "cart.urdf", "--base", "free", "--force")[0] == 0
    assert (tmp_path / "cart.yaml").read_bytes() != before


def test_init_of_a_xacro_file_takes_its_arguments(call, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = cart(PAIR).replace("<robot ", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" ')
    text = text.replace('radius="0.1"', "radius=\"${xacro.arg('size')}\"").replace(
        '<link name="base">', '<xacro:arg name="size" default="0.1"/><link name="base">'
    )
    write(tmp_path / "cart.urdf.xacro", text)
    assert call("init", "cart.urdf.xacro", "--arg", "size=0.15")[0] == 0
    content = read_yaml(tmp_path / "cart.yaml")
    assert radii(content) == {"left": 0.15, "right": 0.15}
    assert content["robot"]["xacro_arguments"] == {"size": 0.15}
    options = ("--arg", "size=0.15", "--duration", "0.05", "--no-browser")
    assert call("drive", "cart.urdf.xacro", *options)[0] == 0
    assert read_yaml(tmp_path / "runs/cart-drive/scenario.yaml")["robot"]["xacro_arguments"] == {"size": 0.15}
    status, *_, said = call("drive", "cart.yaml", *options)
    assert status == 2
    assert "--arg and --package-dir are for a robot" in said


def test_two_axles_that_are_only_drawn_leave_the_base_its_turn(tmp_path):
    disk, lying = '<cylinder radius="0.1" length="0.04"/>', "1.570796 0 0"
    parts = [link("base", 9, moment=1), link("arm", 9, moment=1), joint("a", "base", "arm", (0, 0, 0), "0 0 1")]
    for k, (x, y) in enumerate([(0.3, 0.2), (0.3, -0.2), (-0.1, 0.2), (-0.1, -0.2)]):
        parts.append(link(f"w{k}", 0.1, disk, geometry="visual"))
        parts.append(joint(f"j{k}", "base", f"w{k}", (x, y, 0.1), kind="fixed", effort=None, rpy=lying))
    content, path = drafted(write(tmp_path / "cart.urdf", robot(*parts, name="cart")), tmp_path)
    assert content["constraints"] == [{"no_side_slip": {"frame": "base", "axis": "y", "at": [0.1, 0.0, 0.0]}}]
    assert content["task"]["primary"] == ["base_speed_x", "base_yaw", "a"]
    assert "2 axles of one body cannot all roll in a turn" in path.read_text()
    assert outcome_of(path, 0.5)["outcome"] == "completed"


def test_a_name_with_control_characters_gives_a_draft_that_can_be_read(tmp_path):
    text = find_urdf("differential_drive.urdf", Path()).read_text()
    name = re.search(r'<robot name="([^"]*)"', text)[1]
    strange = text.replace(f'name="{name}"', 'name="cart\u009b2J\u0085"', 1)
    (tmp_path / "robot.urdf").write_text(strange, encoding="utf-8")
    path = tmp_path / "robot.yaml"
    path.write_text(draft(str(tmp_path / "robot.urdf"), tmp_path, DraftOptions()), encoding="utf-8")
    assert r"cart\x9b2J" in path.read_text(encoding="utf-8").splitlines()[0]
    Scenario.load(str(path)).build()
