"""Radii of wheels from the evidence that is left where meshes are missing."""

import warnings

import numpy as np
import pytest
import yaml

import rnc_pin as rnc
from rnc_pin.applications.init import draft, draft_with_decisions
from rnc_pin.applications.init.evidence import DriveEvidence
from rnc_pin.applications.init.robot_at_start import RobotAtStart
from rnc_pin.applications.init.source import FileNames
from urdf_parts import write

pytestmark = pytest.mark.usefixtures("brief")

BASE = """<link name="{root}"/><joint name="stand" type="fixed"><parent link="{root}"/><child link="base_link"/>
  <origin xyz="0 0 {height}"/></joint><link name="base_link"><inertial><origin xyz="0 0 0.15"/><mass value="10"/>
  <inertia ixx="0.1" iyy="0.2" izz="0.3" ixy="0" ixz="0" iyz="0"/></inertial>
  <collision><origin xyz="0 0 0.15"/><geometry><box size="0.5 0.3 0.15"/></geometry></collision>
  <collision><geometry><mesh filename="bumper.stl"/></geometry></collision></link>"""

WHEEL = """<link name="{side}_wheel"><inertial><mass value="0.5"/><inertia ixx="0.0022" iyy="0.0042" izz="0.0022"
  ixy="0" ixz="0" iyz="0"/></inertial>{shapes}</link><joint name="{side}_joint" type="continuous">
  <origin xyz="0 {y} 0"/>
  <parent link="base_link"/><child link="{side}_wheel"/><axis xyz="0 1 0"/><limit effort="9" velocity="9"/></joint>"""

HUB_LINK = """<link name="{side}_hub"><collision><origin rpy="1.5708 0 0"/><geometry><cylinder radius="0.03"
  length="0.05"/></geometry></collision></link><joint name="{side}_hub_joint" type="fixed"><parent link="{side}_wheel"/>
  <child link="{side}_hub"/></joint>"""

MESH = '<{kind}><geometry><mesh filename="package://nowhere/meshes/tyre.stl"/></geometry></{kind}>'
DISK = '<{kind}><origin rpy="1.5708 0 0"/><geometry><cylinder radius="{radius}" length="0.05"/></geometry></{kind}>'

TYRE, SKIN = (MESH.format(kind=kind) for kind in ("collision", "visual"))
HUB = DISK.format(kind="collision", radius=0.03)
GUESS = "MEASURE the radius: no round shape of the wheel was read, the value"
DISK_130 = pytest.approx(0.13, abs=1e-3)  # sqrt(2 * 0.0042 / 0.5)


def cart(folder, shapes, links="", root="anchor", height=0):
    wheels = "".join(
        (WHEEL + links).format(side=side, y=y, shapes=shapes) for side, y in (("left", 0.2), ("right", -0.2))
    )
    return write(folder / "cart.urdf", f'<robot name="cart">{BASE.format(root=root, height=height)}{wheels}</robot>')


SEEN = DISK.format(kind="visual", radius=0.14)


@pytest.mark.parametrize(("shapes", "options", "radius", "remark"), [
    (TYRE + SEEN, {}, 0.14, "radius from the visual geometry"),
    (HUB + TYRE + SEEN, {}, 0.14, "radius from the visual geometry"),
    (HUB + TYRE, {"root": "base_footprint", "height": 0.145}, 0.145, f"{GUESS} is the axle's height"),
    (HUB + TYRE, {}, DISK_130, f"{GUESS} fits its inertia as a solid disk"),
    (TYRE, {"links": HUB_LINK}, DISK_130, f"{GUESS} fits its inertia as a solid disk"),
    ("", {}, DISK_130, f"{GUESS} fits its inertia as a solid disk"),
    (HUB, {}, 0.03, "radius from the collision geometry"),  # no mesh that the radius needs is missing
    (HUB + SKIN, {}, 0.03, "radius from the collision geometry"),
])  # fmt: skip
def test_a_wheel_without_its_mesh_is_not_measured_by_its_hub(shapes, options, radius, remark, tmp_path):
    with pytest.warns(rnc.ModelWarning, match="not found") as said:
        text = draft(str(cart(tmp_path, shapes, **options)), tmp_path)
    wheels = [each["rolling_wheel"] for each in yaml.safe_load(text)["constraints"] if "rolling_wheel" in each]
    assert [each["radius"] for each in wheels] == [radius, radius]
    assert text.count(f"# {remark}\n") == 2
    if TYRE in shapes:
        assert len(said) == 1, "the radius is not compared with the hub"


def test_a_body_keeps_no_part_of_the_geometry_that_lacks_a_mesh_and_the_base_does(tmp_path):
    robot = rnc.Robot.from_urdf(cart(tmp_path, HUB + TYRE + SEEN))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", rnc.ModelWarning)
        shapes = RobotAtStart(robot, {}, FileNames(), DriveEvidence({}, False, {})).shapes
    assert [each.name for each in shapes["collision"]] == ["base_link_0"]
    assert [each.name for each in shapes["visual"]] == ["left_wheel_0", "right_wheel_0"]
    lost = {"base_link": ("bumper.stl",), "left_wheel": ("tyre.stl",), "right_wheel": ("tyre.stl",)}
    assert (robot.missing_meshes("collision"), robot.missing_meshes("visual")) == (lost, {})


def radii(folder, shapes):
    text = draft(str(cart(folder, shapes)), folder)
    return [each["rolling_wheel"]["radius"] for each in yaml.safe_load(text)["constraints"] if "rolling_wheel" in each]


@pytest.mark.filterwarnings("ignore:.*not found:rnc_pin.ModelWarning")  # the bumper's mesh
def test_a_rounded_right_angle_makes_no_wheel_larger(tmp_path):
    tire = '<collision><origin rpy="1.57 0 0"/><geometry><cylinder radius="0.14" length="0.4"/></geometry></collision>'
    assert radii(tmp_path, tire) == [0.14, 0.14]


@pytest.mark.filterwarnings("ignore:.*not found:rnc_pin.ModelWarning")
@pytest.mark.parametrize("count", [8, 9, 11])
def test_an_odd_number_of_rollers_makes_no_wheel_larger(count, tmp_path):
    roller = '<collision><origin xyz="{} 0 {}"/><geometry><sphere radius="0.02"/></geometry></collision>'
    angles = 2 * np.pi * np.arange(count) / count
    rollers = "".join(roller.format(0.12 * np.sin(each), -0.12 * np.cos(each)) for each in angles)
    assert radii(tmp_path, DISK.format(kind="collision", radius=0.13) + rollers) == [0.14, 0.14]


@pytest.mark.filterwarnings("ignore:.*not found:rnc_pin.ModelWarning")
@pytest.mark.parametrize("mass", [0.5, 0.9])
def test_pairs_that_turn_on_and_on_without_names_and_meshes_are_a_question(mass, tmp_path):
    """Two wheels of one axle and no round inertia; a body of another mass is no mate."""
    text = cart(tmp_path, TYRE + SKIN, height=0.13).read_text().replace("_wheel", "_part")
    text = text.replace('iyy="0.0042"', 'iyy="0.0022"').replace('<mass value="0.5"/>', f'<mass value="{mass}"/>', 1)
    (tmp_path / "cart.urdf").write_text(text)
    asked = [each.question for each in draft_with_decisions(str(tmp_path / "cart.urdf"), tmp_path).questions]
    assert ("Are left_joint, right_joint wheels?" in asked) == (mass == 0.5)
