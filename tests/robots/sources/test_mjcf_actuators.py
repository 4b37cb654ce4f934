"""Joints that the actuators of an MJCF drive, and drafts that drive no others."""

import pytest

import rnc_pin as rnc
from rnc_pin.applications.scenario.files import read_yaml
from urdf_parts import write

pytestmark = pytest.mark.usefixtures("brief")

GEOM = '<geom type="capsule" fromto="0 0 0 0 0 .4" size=".03" mass="1"/>'
ARM = f"""<mujoco><worldbody><body><joint name="a" axis="0 1 0"/>{GEOM}
  <site name="p"/><body pos="0 0 .4"><joint name="b" axis="0 1 0"/>{GEOM}<site name="q"/>
    <body pos="0 0 .4"><joint name="c" axis="0 1 0"/>{GEOM}</body></body></body></worldbody>
  <tendon><fixed name="t"><joint joint="b" coef="1"/><joint joint="c" coef="-1"/></fixed>
  <spatial name="s"><site site="p"/><site site="q"/></spatial></tendon>
  <actuator>{{}}</actuator></mujoco>"""


@pytest.mark.filterwarnings("ignore:.*<tendon> is left out")
@pytest.mark.parametrize(("actuators", "passive"), [
    ("", ""),
    ('<motor joint="a"/>', "bc"),
    ('<position joint="a"/><velocity jointinparent="c"/>', "b"),
    ('<general tendon="t"/>', "a"),
    ('<general tendon="s"/><motor joint="a"/>', ""),  # the joints of a path are not told
    ('<motor site="thruster"/>', ""),
])  # fmt: skip
def test_joints_without_an_actuator_have_no_effort(actuators, passive, tmp_path):
    robot = rnc.Robot.from_mjcf(write(tmp_path / "r.xml", ARM.format(actuators)))
    limits = dict(zip(robot.joint_names, robot.model.upperEffortLimit, strict=True))
    assert "".join(name for name, limit in limits.items() if limit == 0) == passive


def test_an_actuator_of_an_unknown_joint_is_refused(tmp_path):
    with pytest.raises(rnc.ModelError, match=r"unknown transmission target 'aa' .*; did you mean 'a'"):
        rnc.Robot.from_mjcf(write(tmp_path / "r.xml", ARM.format('<motor joint="aa"/>')))


CAR = """<mujoco><worldbody><geom type="plane" size="5 5 .1"/>
<body pos="0 0 .1">{free}<geom type="box" size=".2 .1 .03" mass="4"/>
 <body pos="0 .12 0"><joint name="left" axis="0 1 0"/>{wheel}</body>
 <body pos="0 -.12 0"><joint name="right" axis="0 1 0"/>{wheel}</body>
 <body pos=".1 0 .03"><joint name="pan" axis="0 0 1"/><joint name="tilt" axis="0 1 0"/>
   <geom type="box" size=".03 .03 .03" pos=".05 0 0" mass=".1"/></body>
</body></worldbody><actuator>{actuators}</actuator></mujoco>"""
WHEEL = '<geom type="cylinder" size=".1 .02" euler="90 0 0" mass=".5"/>'


@pytest.mark.parametrize("free", ["<freejoint/>", ""], ids=["free", "fixed"])
def test_bodies_without_names_are_drafted_and_passive_joints_are_not_driven(
    free, call, tmp_path, monkeypatch, no_pictures
):
    """Bodies have the same names with every base that is tried."""
    monkeypatch.chdir(tmp_path)
    actuators = '<motor joint="left"/><motor joint="right"/><position joint="pan"/>'
    write(tmp_path / "car.xml", CAR.format(free=free, wheel=WHEEL, actuators=actuators))
    status, _, complaint = call("init", "car.xml", "--out", "car.yaml")
    assert status == 0
    assert complaint.count("rnc-pin: warning: ") == ("its centre is 0 m above the ground" in complaint)  # of wheels
    draft, text = read_yaml(tmp_path / "car.yaml"), (tmp_path / "car.yaml").read_text()
    assert draft["robot"]["base"] == "planar"
    assert "2 wheels, differential drive" in text
    assert ": asked for" not in text
    assert "tilt" not in draft["actuators"]
    assert {"left", "right", "pan"} <= set(draft["actuators"])
    assert call("run", "car.yaml", "--set", "simulation.duration=0.2", "--set", "plots={}", "--out", "out")[0] == 0
