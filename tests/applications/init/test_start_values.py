"""Start values of joints: within limits, and where the loops of the file close, away from their dead centres."""

import numpy as np
import pytest
import yaml

import rnc_pin as rnc
from rnc_pin.applications.init import DraftOptions, draft
from rnc_pin.applications.init.evidence import joint_limits
from rnc_pin.applications.init.start_values import start_values
from rnc_pin.applications.scenario.execution import execute
from rnc_pin.applications.scenario.scenario import Scenario
from urdf_parts import joint, link, robot, write

pytest.importorskip("mujoco", reason="mujoco is an optional extra and not installed")
pytestmark = pytest.mark.usefixtures("brief")  # the runs below are whole

FINGER = """<mujoco><compiler angle="radian"/><worldbody>
  <body name="crank"><joint name="crank" axis="0 1 0" {crank}/><geom type="capsule" fromto="0 0 0 0 0 .3" size=".02"/>
    <body name="coupler" pos="0 0 .3"><joint name="coupler" axis="0 1 0" {coupler}/>
      <geom type="capsule" fromto="0 0 0 1 0 0" size=".02"/></body></body>
  <body name="rocker" pos="1 0 0"><joint name="rocker" axis="0 1 0" {rocker}/>
    <geom type="capsule" fromto="0 0 0 0 0 .3" size=".02"/>
    <body name="tip" pos="0 0 .3"><joint name="tip" axis="0 1 0" range="0.2 0.6"/><geom size=".05"/></body></body>
  </worldbody><equality><connect body1="coupler" body2="rocker" anchor="1 0 0"/></equality>
  <actuator><motor joint="crank"/><motor joint="tip"/></actuator></mujoco>"""
"""Opposite sides have equal lengths: crank and rocker stay parallel, and the coupler turns back by their angle."""


def finger(folder, **joints):
    return write(folder / "finger.xml", FINGER.format(**joints))


CLOSED = {
    "zero, on limits": ({"crank": 'range="0 0.8"', "coupler": 'range="-0.9 0"', "rocker": 'range="0 1"'},
        {"crank": 0, "coupler": 0, "rocker": 0}),
    "as the file draws it": (  # zero is no longer upright, so that it closes nothing
        {"crank": 'range="0.4 0.8" ref="0.5"', "coupler": 'ref="0.1"', "rocker": 'range="-0.5 0.5" ref="-0.2"'},
        {"crank": 0.5, "coupler": 0.1, "rocker": -0.2},
    ),
    "nearest the middle": (  # (0.6 + 0.5 + 0.4) / 3 for the angle of the crank
        {"crank": 'range="0.2 1"', "coupler": 'range="-0.7 -0.3"', "rocker": 'range="0.2 0.6"'},
        {"crank": 0.5, "coupler": -0.5, "rocker": 0.5},
    ),
    "nearest the middle, at a limit": (
        {"crank": 'range="0.2 1.8"', "coupler": 'range="-1.8 -0.2"', "rocker": 'range="0.1 0.3"'},
        {"crank": 0.3, "coupler": -0.3, "rocker": 0.3},
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", CLOSED)
def test_joints_of_a_loop_start_where_it_closes_within_their_limits(case, tmp_path):
    joints, expected = CLOSED[case]
    robot = rnc.Robot.from_mjcf(finger(tmp_path, **joints))
    start = start_values(robot)
    assert start == pytest.approx({**expected, "tip": 0.4}, abs=1e-6)
    system = rnc.NonholonomicSystem(robot, [rnc.LoopClosure(*each) for each in robot.closures])
    assert np.abs(system.assembly.residual(robot.configuration(start))).max() < 1e-8  # the ends of the loop meet
    for name, value in start.items():
        low, high = joint_limits(robot, name)
        assert low - 1e-8 <= value <= high + 1e-8


def test_joints_outside_a_loop_start_as_before_and_a_loop_that_no_limit_admits_is_refused(tmp_path):
    robot = rnc.Robot.from_mjcf(finger(tmp_path, crank='range="0.5 1"', coupler='range="0.1 1"', rocker=""))
    assert start_values(robot) == {"crank": 0.75, "coupler": 0.55, "rocker": 0, "tip": 0.4}
    with pytest.raises(rnc.RncError, match="no configuration near q satisfies closure"):
        draft(str(tmp_path / "finger.xml"), tmp_path, DraftOptions())


def jaws(*followers, lower=0.0, upper=0.5):
    """A gripper: followers of the joint lead, each (multiplier, offset, lower, upper)."""
    parts = [link("base"), link("finger"), joint("lead", "base", "finger", (0, 0, 0), kind="revolute")]
    parts[2] = parts[2].replace("<limit ", f'<limit lower="{lower}" upper="{upper}" ')
    for k, (multiplier, offset, low, high) in enumerate(followers):
        follows = joint(f"jaw_{k}", "base", f"jaw_{k}_link", (0, 0.1 * k, 0), kind="revolute", limits=(low, high))
        mimic = f'<mimic joint="lead" multiplier="{multiplier}" offset="{offset}"/></joint>'
        parts += [link(f"jaw_{k}_link"), follows.replace("</joint>", mimic)]
    return robot(*parts)


@pytest.mark.parametrize(("limits", "followers", "expected"), [
    ((0.0, 0.5), [], 0.01),  # two percent of the range inside of zero
    ((-0.5, 0.0), [], -0.01),
    ((-0.001, 0.499), [], 0.009),
    ((-0.3, 0.5), [], 0.0),
    ((0.1, 0.5), [], 0.3),
    ((0.0, 0.5), [(1, 0, 0, 0.5)], 0.01),
    ((0.0, 0.5), [(-1, 0, -0.5, 0), (2, 0, 0, 0.6)], 0.006),  # the range of the second
    ((0.0, 0.5), [(-1, 0, 0, 0.5)], 0.0),  # the only position
    ((0.0, 0.5), [(1, 1, 0, 0.5)], 0.25),  # none
])  # fmt: skip
def test_a_joint_starts_where_it_and_its_mimic_joints_are_within_their_limits(limits, followers, expected, tmp_path):
    (tmp_path / "jaws.urdf").write_text(jaws(*followers, lower=limits[0], upper=limits[1]))
    start = start_values(rnc.Robot.from_urdf(tmp_path / "jaws.urdf"))
    assert start["lead"] == pytest.approx(expected)
    for k, (multiplier, offset, low, high) in enumerate(followers):
        assert start[f"jaw_{k}"] == pytest.approx(multiplier * expected + offset)
        assert offset or low <= start[f"jaw_{k}"] <= high


def test_the_motion_of_a_leader_keeps_the_limits_of_its_mimic_joints(tmp_path):
    text = draft(str(write(tmp_path / "jaws.urdf", jaws((-1, 0, -0.3, 0), (1, 0.1, 0, 0.3)))), tmp_path, DraftOptions())
    (tmp_path / "jaws.yaml").write_text(text)
    content = yaml.safe_load(text)
    assert content["initial"]["q"]["lead"] == 0.004  # inside of 0 and 0.2
    assert content["reference"]["primary"]["minimum_jerk"]["by"] == [0.0588]  # 0.3 of the way to 0.2
    assert execute(Scenario.load(str(tmp_path / "jaws.yaml"))).trajectory.verdict.succeeded


def test_mimic_joints_in_a_circle_end_no_search(tmp_path):
    parts = [link("base"), link("one"), link("other")]
    for name, parent, of in (("one", "base", "other"), ("other", "one", "one")):
        turning = joint(f"{name}_joint", parent, name, (0, 0, 0.2), kind="revolute", limits=(-1, 1))
        parts.append(turning.replace("</joint>", f'<mimic joint="{of}_joint"/></joint>'))
    (tmp_path / "circle.urdf").write_text(robot(*parts))
    assert start_values(rnc.Robot.from_urdf(tmp_path / "circle.urdf")) == {"one_joint": 0.0, "other_joint": 0.0}


BEAM = '<geom type="capsule" fromto="0 0 0 {}" size="0.01"/>'


def four_bar(angle, motor, lengths=(0.1, 0.3, 0.2, 0.3), sense=1, rocker=""):
    """A crank, a coupler and a rocker in the plane x, z, with zero where the crank has an angle [rad]; lengths [m]."""
    crank, coupler, arm, apart = lengths
    tip = crank * np.array([np.cos(angle), np.sin(angle)])
    diagonal = np.array([apart, 0.0]) - tip
    length = np.linalg.norm(diagonal)
    elbow = np.arccos(np.clip((coupler**2 + length**2 - arm**2) / (2 * coupler * length), -1, 1))
    along = np.arctan2(diagonal[1], diagonal[0]) + elbow
    beam = coupler * np.array([np.cos(along), np.sin(along)])
    end = tip + beam - [apart, 0.0]
    tip, beam, end = (f"{x:.12g} 0 {z:.12g}" for x, z in (tip, beam, end))
    axis = f'axis="0 {-sense} 0"'
    return (
        '<mujoco model="four_bar"><compiler angle="radian"/><worldbody>'
        f'<body name="crank"><joint name="crank" {axis}/>{BEAM.format(tip)}'
        f'<body name="coupler" pos="{tip}"><joint name="coupler" axis="0 -1 0"/>{BEAM.format(beam)}</body></body>'
        f'<body name="rocker" pos="{apart} 0 0"><joint name="rocker" {axis} {rocker}/>{BEAM.format(end)}</body>'
        f'</worldbody><equality><connect body1="coupler" body2="rocker" anchor="{beam}"/></equality>'
        f'<actuator><motor joint="{motor}"/></actuator></mujoco>'
    )


def drafted(text, folder):
    written = draft(str(write(folder / "loop.xml", text)), folder, DraftOptions())
    run = execute(Scenario.load(str(write(folder / "loop.yaml", written)), {"simulation.dt": 0.01})).trajectory
    assert run.verdict.succeeded
    return written.replace("\n# ", " "), yaml.safe_load(written), run


def test_a_motion_turns_away_from_the_dead_centre(tmp_path):
    """The rocker turns back where crank and coupler are in line, at 0.505 rad of the crank."""
    text, content, run = drafted(four_bar(0.7, "rocker", sense=-1), tmp_path)
    assert content["reference"]["primary"]["minimum_jerk"]["by"] == [-0.2]
    assert run.x2[-1, 0] - run.x2[0, 0] == pytest.approx(-0.2, abs=1e-3)
    assert "its loop ends" not in text


def test_a_loop_with_little_room_moves_little(tmp_path):
    """A dead centre is 0.02 rad ahead of the crank, and a limit of the rocker behind it."""
    folded = np.pi / 3 - 0.02
    text, content, run = drafted(four_bar(folded, "crank", (0.3, 0.1, 0.2, 0.3), rocker='range="-0.01 0.5"'), tmp_path)
    (step,) = content["reference"]["primary"]["minimum_jerk"]["by"]
    assert 0.005 < step < 0.02
    assert f"crank moves by {step:g} only: its loop ends at a dead centre" in text
    assert run.q[:, 2].min() > -0.01


def linkage(rack):
    """A car whose tie rod couples the knuckles: one rod in one loop, or two rods to a rack in two loops."""
    rear, front = (
        '<body name="{0}" pos="{1} {2} 0"><joint name="{0}" axis="0 1 0"/>' + DISK + "</body>",
        '<body name="k{0}" pos="0.5 {1} 0"><joint name="steer_{0}" axis="0 0 1" range="-0.6 0.6"/>'
        '<geom size="0.02" mass="0.2"/><body name="f{0}"><joint name="f{0}" axis="0 1 0"/>'
        + DISK
        + '</body><body name="arm_{0}" pos="-0.1 {2} 0"><geom size="0.01" mass="0.05"/>{3}</body></body>',
    )
    rod = '<body name="tie_{0}"><joint name="tie_{0}" axis="0 0 1"/><geom size="0.01" mass="0.1"/></body>'
    slide = '<joint name="rack" type="slide" axis="0 1 0"/><geom size="0.02" mass="1"/>'
    slide = f'<body name="rack" pos="0.4 0 0">{slide}</body>' if rack else ""
    sides = (("l", 0.2, -0.03), ("r", -0.2, 0.03))
    wheels = "".join(rear.format(f"r{side}", 0, y) for side, y, _ in sides)
    held = {"l": rod.format("l"), "r": rod.format("r") if rack else ""}
    wheels += "".join(front.format(side, y, arm, held[side]) for side, y, arm in sides)
    ends = [("tie_l", "rack", -0.17), ("tie_r", "rack", 0.17)] if rack else [("tie_l", "arm_r", -0.34)]
    loops = "".join(f'<connect body1="{rod}" body2="{end}" anchor="0 {at} 0"/>' for rod, end, at in ends)
    motors = "".join(f'<motor joint="{each}"/>' for each in ("rack" if rack else "steer_l", "rl", "rr"))
    return (
        '<mujoco model="linkage"><worldbody><body name="chassis" pos="0 0 0.1"><freejoint/>'
        f'<geom type="box" size="0.3 0.1 0.04" pos="0.25 0 0.03" mass="8"/>{wheels}{slide}</body>'
        f"</worldbody><equality>{loops}</equality><actuator>{motors}</actuator></mujoco>"
    )


DISK = '<geom type="cylinder" size="0.1 0.02" euler="90 0 0" mass="0.5"/>'


@pytest.mark.parametrize("rack", [False, True], ids=["tie rod", "rack"])
def test_a_linkage_steers_both_wheels_of_a_car(rack, tmp_path):
    text = draft(str(write(tmp_path / "car.xml", linkage(rack))), tmp_path, DraftOptions())
    content = yaml.safe_load(text)
    assert "# base planar: 4 wheels, steered like a car" in text
    assert "loops of the file couple steer_l and steer_r" in text
    kinds = [next(iter(each)) for each in content["constraints"]]
    assert kinds == ["rolling_wheel"] * 4 + ["loop_closure"] * (2 if rack else 1)
    assert content["actuators"] == ["rl", "rr", "rack" if rack else "steer_l"]
