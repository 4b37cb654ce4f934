"""Mimic joints of a file in drafts: one motor moves all joints of a group, whichever of them has it."""

import pytest
import yaml

from rnc_pin.applications.init import DraftOptions, draft, find_uses
from rnc_pin.applications.scenario.execution import execute
from rnc_pin.applications.scenario.scenario import Scenario
from urdf_parts import BOX, joint, link, robot, transmissions, wheel, write

pytestmark = pytest.mark.usefixtures("brief")


def run_draft(text, folder, name="unit.urdf", **wishes):
    """(content of a draft, its text); its run succeeds."""
    drafted = draft(str(write(folder / name, text)), folder, DraftOptions(**wishes))
    (folder / "unit.yaml").write_text(drafted)
    brief = {"simulation.duration": 0.5, "simulation.dt": 0.01}
    assert execute(Scenario.load(str(folder / "unit.yaml"), brief)).trajectory.verdict.succeeded
    return yaml.safe_load(drafted), drafted


def following(text, leader, multiplier=1):
    return text.replace("</joint>", f'<mimic joint="{leader}" multiplier="{multiplier}"/></joint>')


def gripper(*named, efforts=(5.0, 5.0), multiplier=-1):
    """Two wheels and a gripper, whose joint mirror mimics the joint grip; named joints have transmissions."""
    limits = (-0.02, 0.02) if multiplier else (-1, 1)
    mirror = joint("mirror", "base", "right", (0.3, -0.1, 0.1), "0 1 0", "prismatic", efforts[1], limits)
    return robot(
        link("base", 10.0, BOX), wheel("l", "base", (0, 0.2, 0)), wheel("r", "base", (0, -0.2, 0)), link("left", 0.1),
        link("right", 0.1),
        joint("grip", "base", "left", (0.3, 0.1, 0.1), "0 1 0", "prismatic", efforts[0], (0, 0.05)),
        following(mirror, "grip", multiplier), transmissions(*named),
    )  # fmt: skip


WHEELS = ["l_joint", "r_joint"]


@pytest.mark.parametrize(("named", "efforts", "multiplier", "motor"), [
    ([], (5.0, 5.0), -1, "grip"),
    ("option", (5.0, 5.0), -1, "mirror"),
    ([*WHEELS, "grip"], (5.0, 5.0), -1, "grip"),
    ([*WHEELS, "grip", "mirror"], (5.0, 5.0), -1, "grip"),
    ([*WHEELS, "mirror"], (5.0, 5.0), -1, "mirror"),
    ([], (0.0, 5.0), -1, "mirror"),
    ([*WHEELS, "mirror"], (5.0, 5.0), 0, None),
    (WHEELS, (5.0, 5.0), -1, None),
])  # fmt: skip
def test_one_motor_moves_a_gripper(named, efforts, multiplier, motor, tmp_path):
    named, driven = ([], ["mirror"]) if named == "option" else (named, [])
    content, _ = run_draft(gripper(*named, efforts=efforts, multiplier=multiplier), tmp_path, driven=driven)
    assert content["actuators"] == [*WHEELS, *([motor] if motor else [])]
    assert content["task"]["primary"] == ["base_speed_x", "base_yaw", *([motor] if motor else [])]
    assert list(content["robot"].get("lock", {})) == ([] if motor else ["grip", "mirror"])


def test_a_use_that_starts_elsewhere_moves_the_follower_too(tmp_path):
    run_draft(gripper(), tmp_path)
    unit = Scenario.load(str(tmp_path / "unit.yaml"), {"initial.q": {"grip": 0.01, "mirror": -0.01}})
    made = find_uses(unit, ["base_speed_x"])[0][0].content({"grip": 0.02}, 1.0, "adaptive")
    assert made["initial"] == {"q": {"grip": 0.02}}


def test_a_lock_of_a_follower_locks_its_leader(tmp_path):
    content, text = run_draft(gripper(), tmp_path, lock={"mirror": 0.01})
    assert (content["robot"]["lock"], content["actuators"]) == ({"mirror": 0.01, "grip": -0.01}, WHEELS)
    assert "# Assumed: locked together with mirror, which mimics it: grip." in text


FINGERS = "".join(
    f'<body name="{name}" pos="0.2 {y} 0.05"><joint name="{name}" type="slide" axis="0 {axis} 0" range="0 0.03"/>'
    '<geom type="box" size="0.01 0.005 0.02" mass="0.03"/></body>'
    for name, y, axis in (("one", 0.02, 1), ("other", -0.02, -1))
)
DRIVE = '<body name="{0}" pos="{1} {2} 0"><joint name="{0}" axis="0 1 0"/>{3}</body>'
ROLL = '<geom type="cylinder" size="0.05 0.02" euler="90 0 0" mass="0.3"/>'
KNUCKLE = (
    '<body name="hub_{0}" pos="0.2 {1} 0"><joint name="steer_{0}" axis="0 0 1" range="-30 30"/>'
    '<geom size="0.02" mass="0.2"/><body name="f{0}"><joint name="f{0}" axis="0 1 0"/>' + ROLL + "</body></body>"
)
FIXED = '<joint name="lift" type="slide" axis="0 0 1" range="-1 1"/>'


def mjcf(parts, leader, follower, motors, base="<freejoint/>"):
    driven = "".join(f'<position joint="{each}" kp="20" forcerange="-9 9"/>' for each in motors)
    return (
        f'<mujoco model="unit"><worldbody><body name="base" pos="0 0 0.05">{base}'
        f'<geom type="box" size="0.2 0.1 0.03" pos="0 0 0.04" mass="4"/>{parts}</body></worldbody>'
        f'<equality><joint joint1="{follower}" joint2="{leader}"/></equality><actuator>{driven}</actuator></mujoco>'
    )


PAIR = "".join(DRIVE.format(name, 0, y, ROLL) for name, y in (("rl", 0.15), ("rr", -0.15)))
SKID = '<geom type="sphere" size="0.02" pos="-0.15 0 -0.03" mass="0.01"/>'
REAR = "".join(DRIVE.format(name, -0.2, y, ROLL) for name, y in (("rl", 0.15), ("rr", -0.15)))
CART = PAIR + SKID + FINGERS
FRONT = "".join(KNUCKLE.format(side, y) for side, y in (("l", 0.15), ("r", -0.15)))


@pytest.mark.filterwarnings("ignore::rnc_pin.ModelWarning")
@pytest.mark.parametrize("swapped", [False, True])
@pytest.mark.parametrize(("parts", "pair", "motors", "base", "primary", "lock"), [
    (FINGERS, ("one", "other"), ["lift", "one"], FIXED, ["lift", "one"], []),
    (CART, ("one", "other"), ["rl", "rr", "one"], "<freejoint/>", ["base_speed_x", "base_yaw", "one"], []),
    (CART, ("one", "other"), ["rl", "rr"], "<freejoint/>", ["base_speed_x", "base_yaw"], ["one", "other"]),
    (REAR + FRONT, ("steer_l", "steer_r"), ["rl", "rr", "steer_l"], "<freejoint/>", ["base_speed_x", "steer_l"], []),
], ids=["arm", "cart", "no motor", "car"])  # fmt: skip
def test_one_motor_moves_a_pair_of_an_mjcf_whichever_leads(parts, pair, motors, base, primary, lock, swapped, tmp_path):
    pytest.importorskip("mujoco")
    leader, follower = pair[::-1] if swapped else pair
    content, _ = run_draft(mjcf(parts, leader, follower, motors, base), tmp_path, "unit.xml")
    assert (content["actuators"], content["task"]["primary"]) == (motors, primary)
    assert {*content["robot"].get("lock", {})} == {*lock}
