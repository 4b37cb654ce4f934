"""Radii of wheels beside the heights of their centres and the shapes of their links."""

import numpy as np
import pytest

import rnc_pin as rnc
from rnc_pin.applications.scenario.builder import build_reduced, start_of
from rnc_pin.applications.scenario.execution import execute
from rnc_pin.applications.scenario.files import find_scenario, read_yaml
from rnc_pin.applications.scenario.plant_builder import start_findings
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.applications.scenario.schema.scenario import validate
from rnc_pin.constraints.wheel_heights import wheel_height_findings
from rnc_pin.verdict import FindingKind, Severity
from zoo import MECANUM, WHEELS, load


def cart(height=0.17, shape="", turn="1.5707963267948966 0 0"):
    """Two wheels at a height, on an axle along y; ``shape`` is their collision geometry."""
    drawn = f'<collision><origin rpy="{turn}"/><geometry>{shape}</geometry></collision>' if shape else ""
    inertial = '<inertial><mass value="2"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>'
    parts = [f'<link name="base">{inertial}</link>']
    for side, y in (("left", 0.3), ("right", -0.3)):
        parts.append(
            f'<link name="wheel_{side}">{inertial}{drawn}</link>'
            f'<joint name="{side}" type="continuous"><parent link="base"/><child link="wheel_{side}"/>'
            f'<origin xyz="0 {y} {height}"/><axis xyz="0 1 0"/></joint>'
        )
    return f'<robot name="cart">{"".join(parts)}</robot>'


def findings(folder, radius=0.25, base="planar", q=None, stated=None, ground=None, **of_cart):
    (folder / "cart.urdf").write_text(cart(**of_cart))
    robot = rnc.Robot.from_urdf(folder / "cart.urdf", base=base)
    sides = ("left", "right")
    wheels = [rnc.RollingWheel(f"wheel_{each}", radius, ground=ground) for each in sides]
    reduced = rnc.NonholonomicSystem(robot, wheels).reduce()
    return wheel_height_findings(reduced, robot.configuration({} if q is None else q), stated)


def summary(found):
    return [(each.where, str(each.severity), round(each.amount, 6)) for each in found]


def both(severity, amount):
    return [(f"wheel_{side}", severity, amount) for side in ("left", "right")]


# ---------------------------------------------------------------------- heights


def test_a_wheel_that_reaches_below_the_ground(tmp_path):
    found = findings(tmp_path)
    assert summary(found) == both("degrades", 0.08)
    assert found[0].kind is FindingKind.MODEL
    assert found[0].message == (
        "wheel_left: radius 0.25 m, but its centre is 0.17 m above the ground: the contact point is 0.08 m below the "
        "ground"
    )


def test_a_wheel_that_hangs_above_the_ground(tmp_path):
    found = findings(tmp_path, radius=0.1)
    assert summary(found) == both("degrades", 0.07)
    assert found[0].message.endswith("the contact point is 0.07 m above the ground")


def test_differences_that_rounding_explains_are_notes(tmp_path):
    assert findings(tmp_path, radius=0.17) == ()
    assert summary(findings(tmp_path, radius=0.1716)) == both("note", 0.0016)  # 0.9 %
    assert summary(findings(tmp_path, radius=0.18, height=0.1755)) == both("note", 0.0045)  # half a digit
    assert summary(findings(tmp_path, radius=0.1800, height=0.174)) == both("degrades", 0.006)
    assert summary(findings(tmp_path, radius=0.1725)) == both("degrades", 0.0025)  # 1.4 %, of four digits


def test_the_height_of_the_ground_may_be_stated(tmp_path):
    assert findings(tmp_path, radius=0.25, stated=-0.08) == ()
    assert summary(findings(tmp_path, radius=0.17, stated=-0.08)) == both("degrades", 0.08)
    assert findings(tmp_path, radius=0.25, ground=rnc.GroundPlane(point=(3.0, 1.0, -0.08), velocity=(1, 0, 0))) == ()
    lower = rnc.GroundPlane(point=(0.0, 0.0, -0.5))
    assert summary(findings(tmp_path, radius=0.25, ground=lower)) == both("degrades", 0.42)


@pytest.mark.parametrize("height", [0.0, -0.2, 5.0])
def test_a_base_may_be_described_at_any_height(tmp_path, height):
    assert findings(tmp_path, height=height) == ()


def test_a_conveyor_at_zero_states_no_height(tmp_path):
    conveyor = rnc.GroundPlane(velocity=(0.3, 0.0, 0.0))
    assert findings(tmp_path, height=0.0, ground=conveyor) == ()
    assert summary(findings(tmp_path, ground=conveyor)) == both("degrades", 0.08)


def test_a_measured_wheel_may_be_at_any_height(tmp_path):
    shape = '<cylinder radius="0.25" length="0.04"/>'
    assert findings(tmp_path, shape=shape) == ()
    assert summary(findings(tmp_path, shape=shape, stated=0.0)) == both("degrades", 0.08)


def test_no_contact_is_claimed_of_a_base_in_the_air(tmp_path):
    high = {"root_joint": [0.0, 0.0, 3.0, 0.0, 0.0, 0.0, 1.0]}
    assert findings(tmp_path, base="free", q=high) == ()
    robot = rnc.Robot.from_urdf(tmp_path / "cart.urdf", base="free")
    reduced = rnc.NonholonomicSystem(robot, [rnc.RollingWheel("wheel_left", 0.25, vertical=False)]).reduce()
    assert wheel_height_findings(reduced, robot.configuration()) == ()


def test_a_leaning_wheel_touches_with_its_lowest_point(tmp_path):
    """The axle is 0.3 rad from the horizontal: the contact point is ``radius cos(0.3)`` below the centre."""
    text = cart(height=0.25 * np.cos(0.3)).replace(
        '<axis xyz="0 1 0"/>', f'<axis xyz="0 {np.cos(0.3)} {np.sin(0.3)}"/>'
    )
    (tmp_path / "leaning.urdf").write_text(text)
    robot = rnc.Robot.from_urdf(tmp_path / "leaning.urdf", base="planar")
    reduced = rnc.NonholonomicSystem(robot, [rnc.RollingWheel("wheel_left", 0.25)]).reduce()
    assert wheel_height_findings(reduced, robot.configuration()) == ()
    upright = rnc.NonholonomicSystem(robot, [rnc.RollingWheel("wheel_left", 0.27)]).reduce()
    (found,) = wheel_height_findings(upright, robot.configuration())
    assert found.amount == pytest.approx(0.02 * np.cos(0.3))


@pytest.mark.parametrize("kind", [rnc.RollingBall, rnc.Caster])
def test_balls_and_casters_are_compared_too(tmp_path, kind):
    (tmp_path / "cart.urdf").write_text(cart())
    robot = rnc.Robot.from_urdf(tmp_path / "cart.urdf", base="planar")
    system = rnc.NonholonomicSystem(robot, [rnc.RollingWheel("wheel_left", 0.17), kind("wheel_right", 0.25)])
    found = wheel_height_findings(system.reduce(), robot.configuration())
    assert summary(found) == [("wheel_right", "degrades", 0.08)]


@pytest.mark.parametrize(("radius", "word", "severities"), [
    (0.17, "succeeded", []), (0.1716, "succeeded", ["note"] * 2), (0.25, "degraded", ["degrades"] * 2),
])  # fmt: skip
def test_a_run_with_a_radius_that_does_not_fit_is_degraded(tmp_path, radius, word, severities):
    (tmp_path / "cart.urdf").write_text(cart())
    wheels = "".join(f"  - rolling_wheel: {{frame: wheel_{each}, radius: {radius}}}\n" for each in ("left", "right"))
    (tmp_path / "cart.yaml").write_text(
        f"robot: {{urdf: cart.urdf, base: planar}}\nconstraints:\n{wheels}actuators: [left, right]\n"
        "outputs: {reducing: [frame_speed: {frame: base, axis: x}, frame_yaw: base]}\n"
        "reference: {primary: {minimum_jerk: {to: [0.1, 0.05], duration: 1}}}\n"
        "controller: {type: reducing_outputs, preset: scaled}\nsimulation: {duration: 1.2, dt: 0.01}\n"
    )
    made = Scenario.load(str(tmp_path / "cart.yaml")).build()
    verdict = execute(made).trajectory.verdict
    found = [each for each in verdict.findings if each.kind is FindingKind.MODEL and each.where]
    assert (verdict.word, [str(each.severity) for each in found]) == (word, severities)
    assert list(made.experiment.warnings) == [str(each) for each in found if each.severity is Severity.DEGRADES]


# ---------------------------------------------------------------------- shapes


@pytest.mark.parametrize("shape", ['<cylinder radius="0.17" length="0.04"/>', '<sphere radius="0.17"/>'])
@pytest.mark.parametrize("base", ["planar", "free"])
def test_a_radius_is_compared_with_the_shape_of_the_link(tmp_path, shape, base):
    found = findings(tmp_path, radius=0.2, height=0.0, shape=shape, base=base)
    assert summary(found) == both("degrades", 0.03)
    assert found[0].message == "wheel_left: radius 0.2 m, but its collision shape has 0.17 m"
    assert findings(tmp_path, radius=0.17, height=0.0, shape=shape, base=base) == ()


@pytest.mark.parametrize("shape", ['<cylinder radius="0.1" length="0.04"/>', '<sphere radius="0.1"/>'])
def test_a_round_shape_beside_the_axle_is_not_the_wheel(tmp_path, shape):
    """Such as the housing of a hub, parallel to the axle."""
    beside = '1.5707963267948966 0 0" xyz="0.05 0 0'
    assert findings(tmp_path, radius=0.17, height=0.0, shape=shape, turn=beside) == ()


def test_height_and_shape_are_one_finding(tmp_path):
    found = findings(tmp_path, radius=0.2, shape='<sphere radius="0.17"/>')
    assert summary(found) == both("degrades", 0.03)
    assert found[0].message == (
        "wheel_left: radius 0.2 m, but its centre is 0.17 m above the ground and its collision shape has 0.17 m: "
        "the contact point is 0.03 m below the ground"
    )


def test_a_mesh_is_measured_about_the_axle(tmp_path):
    angles = np.linspace(0, 2 * np.pi, 49)[:-1]
    rim = [(0.17 * np.cos(a), y, 0.17 * np.sin(a)) for a in angles for y in (-0.02, 0.02)]
    corners = [*rim, (0, -0.02, 0), (0, 0.02, 0)]
    faces = [(2 * k + 1, 2 * ((k + 1) % 48) + 1, len(rim) + 1) for k in range(48)]
    faces += [(2 * k + 2, 2 * ((k + 1) % 48) + 2, len(rim) + 2) for k in range(48)]
    lines = [f"v {x} {y} {z}" for x, y, z in corners] + [f"f {a} {b} {c}" for a, b, c in faces]
    (tmp_path / "rim.obj").write_text("\n".join(lines) + "\n")
    shape = '<mesh filename="rim.obj"/>'
    assert summary(findings(tmp_path, radius=0.2, height=0.0, shape=shape, turn="0 0 0")) == both("degrades", 0.03)


def test_other_shapes_say_nothing(tmp_path):
    for shape in ('<box size="0.3 0.04 0.3"/>', '<cylinder radius="0.1" length="0.6"/>'):
        turn = "0 0 0"  # a cylinder along z is no wheel about y
        assert findings(tmp_path, radius=0.2, height=0.0, shape=shape, turn=turn) == ()


@pytest.mark.parametrize(("out", "compared"), [(0.158, False), (0.14, True)])
def test_rollers_that_reach_beyond_their_hub_are_the_rim(tmp_path, out, compared):
    rollers = "".join(
        f'<collision><origin xyz="{out * np.cos(a)} 0 {out * np.sin(a)}"/><geometry><sphere radius="0.02"/></geometry>'
        "</collision>"
        for a in 2 * np.pi * np.arange(9) / 9
    )
    hub = f'<cylinder radius="0.17" length="0.04"/></geometry></collision>{rollers}<collision><geometry>'
    hub += '<cylinder radius="0.03" length="0.04"/>'
    assert len(findings(tmp_path, radius=0.2, height=0.0, shape=hub)) == (2 if compared else 0)


# ---------------------------------------------------------------------- no false alarm

BUILT_IN = [path.stem for path in sorted(find_scenario("tiago").parent.glob("*.yaml"))]


@pytest.mark.parametrize("name", BUILT_IN)
def test_built_in_scenarios_have_no_findings(name):
    path = find_scenario(name)
    scenario = validate(read_yaml(path), name)
    reduced = build_reduced(scenario, path.parent)[1]
    assert start_findings(scenario, reduced, start_of(scenario, reduced)[0]) == ()


@pytest.mark.parametrize("name", sorted({*WHEELS} - {"pr2"}))
def test_robots_of_the_zoo_have_no_findings(name):
    frames, radius, base = WHEELS[name]
    sides = MECANUM.get(name)
    rollers = [None] * len(frames) if sides is None else [side * np.pi / 4 for side in sides]
    robot = load(name, base)
    wheels = [rnc.RollingWheel(frame, radius, roller=each) for frame, each in zip(frames, rollers, strict=True)]
    reduced = rnc.NonholonomicSystem(robot, wheels).reduce()
    assert [
        str(each)
        for each in wheel_height_findings(reduced, robot.configuration())
        if each.severity is not Severity.NOTE
    ] == []


# ---------------------------------------------------------------------- commands

SCENARIO = """
robot: {urdf: cart.urdf, base: planar}
constraints:
  - rolling_wheel: {frame: wheel_left, radius: 0.25}
  - rolling_wheel: {frame: wheel_right, radius: 0.17}
actuators: [left, right]
outputs: {reducing: [{frame_speed: {frame: base}}, {frame_yaw: base}]}
controller: {type: reducing_outputs, tracker: computed_torque}
simulation: {duration: 0.1, dt: 0.01}
"""
SAID = "wheel_left: radius 0.25 m, but its centre is 0.17 m above the ground: the contact point is 0.08 m below the"


def test_runs_and_inspect_warn(tmp_path, call):
    (tmp_path / "cart.urdf").write_text(cart())
    path = tmp_path / "cart.yaml"
    path.write_text(SCENARIO)
    assert Scenario.load(str(path)).experiment.warnings == (f"{SAID} ground",)
    status, _, error = call("inspect", str(path))
    assert status == 0
    assert SAID in error.replace("\n", " ")
    path.write_text(SCENARIO.replace("0.25", "0.17"))
    assert Scenario.load(str(path)).experiment.warnings == ()
