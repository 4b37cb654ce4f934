"""Radii of wheels beside the heights of their centres."""

import numpy as np
import pytest

import rnc_pin as rnc
from rnc_pin.applications.scenario.builder import build_system, start_findings, start_of
from rnc_pin.applications.scenario.execution import execute
from rnc_pin.applications.scenario.files import built_in_names, find_scenario, read_yaml
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.applications.scenario.schema.scenario import validate
from rnc_pin.constraints.wheeled_base import wheel_height_findings
from rnc_pin.verdict import FindingKind, Severity
from urdf_parts import joint, link, robot
from zoo import MECANUM, WHEELS, load


def cart(height=0.17):
    """Two wheels at a height, on an axle along y."""
    parts = [link(name) for name in ("base", "wheel_left", "wheel_right")]
    for side, y in (("left", 0.3), ("right", -0.3)):
        parts.append(joint(side, "base", f"wheel_{side}", (0, y, height)))
    return robot(*parts, name="cart")


def findings(folder, radius=0.25, base="planar", q=None, stated=None, ground=None, height=0.17):
    (folder / "cart.urdf").write_text(cart(height))
    robot = rnc.Robot.from_urdf(folder / "cart.urdf", base=base)
    sides = ("left", "right")
    wheels = [rnc.RollingWheel(f"wheel_{each}", radius, ground=ground) for each in sides]
    reduced = rnc.NonholonomicSystem(robot, wheels).reduce()
    return wheel_height_findings(reduced, robot.configuration({} if q is None else q), stated)


def summary(found):
    return [(each.where, str(each.severity), round(each.amount, 6)) for each in found]


def both(severity, amount):
    return [(f"wheel_{side}", severity, amount) for side in ("left", "right")]


BELOW = rnc.GroundPlane(point=(3.0, 1.0, -0.08), velocity=(1, 0, 0))
CONVEYOR = rnc.GroundPlane(velocity=(0.3, 0.0, 0.0))


@pytest.mark.parametrize(("given", "expected"), [
    ({"radius": 0.1}, both("degrades", 0.07)),
    ({"radius": 0.17}, []),
    ({"radius": 0.1716}, both("note", 0.0016)),  # 0.9 %
    ({"radius": 0.18, "height": 0.1755}, both("note", 0.0045)),  # half a digit
    ({"radius": 0.1800, "height": 0.174}, both("degrades", 0.006)),
    ({"radius": 0.1725}, both("degrades", 0.0025)),  # 1.4 %, of four digits
    ({"stated": -0.08}, []),
    ({"radius": 0.17, "stated": -0.08}, both("degrades", 0.08)),
    ({"ground": BELOW}, []),
    ({"ground": rnc.GroundPlane(point=(0.0, 0.0, -0.5))}, both("degrades", 0.42)),
    *(({"height": height}, []) for height in (0.0, -0.2, 5.0)),  # a base may be described at any height
    ({"height": 0.0, "ground": CONVEYOR}, []),  # one at zero states no height
    ({"ground": CONVEYOR}, both("degrades", 0.08)),
])  # fmt: skip
def test_radii_are_compared_with_heights(tmp_path, given, expected):
    assert summary(findings(tmp_path, **given)) == expected


def test_a_wheel_that_reaches_below_the_ground(tmp_path):
    found = findings(tmp_path)
    assert summary(found) == both("degrades", 0.08)
    assert found[0].kind is FindingKind.MODEL
    assert found[0].message == (
        "wheel_left: radius 0.25 m, but its centre is 0.17 m above the ground: the contact point is 0.08 m below the "
        "ground"
    )


def test_no_contact_is_claimed_of_a_base_in_the_air(tmp_path):
    assert findings(tmp_path, base="free", q={"root_joint": [0.0, 0.0, 3.0, 0.0, 0.0, 0.0, 1.0]}) == ()
    robot = rnc.Robot.from_urdf(tmp_path / "cart.urdf", base="free")
    reduced = rnc.NonholonomicSystem(robot, [rnc.RollingWheel("wheel_left", 0.25, vertical=False)]).reduce()
    assert wheel_height_findings(reduced, robot.configuration()) == ()


def test_a_leaning_wheel_touches_with_its_lowest_point(tmp_path):
    """The axle is 0.3 rad from the horizontal: the contact point is ``radius cos(0.3)`` below the centre."""
    text = cart(height=0.25 * np.cos(0.3)).replace('axis xyz="0 1 0"', f'axis xyz="0 {np.cos(0.3)} {np.sin(0.3)}"')
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
def test_a_run_with_a_radius_that_does_not_fit_is_degraded(tmp_path, call, radius, word, severities):
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
    warned = [str(each) for each in found if each.severity is Severity.DEGRADES]
    assert list(made.experiment.warnings) == warned
    said = call("inspect", tmp_path / "cart.yaml", "--samples", 4)[2].replace("\n", " ")
    assert all(each in said for each in warned)


@pytest.mark.parametrize("name", built_in_names())
def test_built_in_scenarios_have_no_findings(name):
    path = find_scenario(name)
    scenario = validate(read_yaml(path), name)
    reduced = scenario.reduced(build_system(scenario, path.parent))
    assert start_findings(scenario, reduced, start_of(scenario, reduced)[0]) == ()


@pytest.mark.parametrize("name", sorted({*WHEELS} - {"pr2"}))
def test_robots_of_the_zoo_have_no_findings(name):
    frames, radius, base = WHEELS[name]
    sides = MECANUM.get(name)
    rollers = [None] * len(frames) if sides is None else [side * np.pi / 4 for side in sides]
    robot = load(name, base)
    wheels = [rnc.RollingWheel(frame, radius, roller=each) for frame, each in zip(frames, rollers, strict=True)]
    findings = wheel_height_findings(rnc.NonholonomicSystem(robot, wheels).reduce(), robot.configuration())
    assert {each.severity for each in findings} <= {Severity.NOTE}
