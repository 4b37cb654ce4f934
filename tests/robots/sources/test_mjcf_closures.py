"""Loops that an MJCF closes by ``<connect>`` and ``<weld>``, beside what MuJoCo says of them."""

import warnings

import numpy as np
import pytest

import rnc_pin as rnc
from rnc_pin.model.kinematics import Kinematics
from urdf_parts import write

TREE = """<mujoco><compiler angle="radian"/>{head}<worldbody><site name="w" pos="0.2 0.1 0" euler="0.1 0.2 0.3"/>
  <body name="a" pos="0.1 0 0.2" euler="0.3 -0.2 0.1"><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
    <joint name="a1" axis="0 1 0"/><joint name="a2" axis="0 0 1" ref="0.2"/>
    <body name="b" pos="0.4 0 0.1" euler="0 0.5 0"><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
      <joint name="b1" axis="0 1 0"/><site name="s" pos="0.1 0.2 0.3" euler="0.4 0 0.2"/></body></body>
  <body name="c" pos="1 0 0" quat="0.8 0.6 0 0"><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
    <joint name="c1" axis="0 1 0"/><joint name="c2" type="slide" axis="1 0 0"/>
    <site name="t" pos="0 0.1 0" euler="0 0.3 0"/></body>
  <body name="hook" mocap="true"/></worldbody><equality>{equality}</equality></mujoco>"""

LOOPS = {
    "connect": '<connect body1="b" body2="c" anchor="0.1 0.2 0.3"/>',
    "connect to the world": '<connect body1="b" anchor="0.1 0.2 0.3"/>',
    "connect sites": '<connect site1="s" site2="t"/>',
    "connect a site to the world": '<connect site1="w" site2="t"/>',
    "weld": '<weld body1="b" body2="c"/>',
    "weld to the world": '<weld body1="c"/>',
    "weld with a pose": '<weld body1="b" body2="c" anchor="0.1 0 0.2" relpose="0.1 0.2 0.3 0.9 0.1 -0.2 0.3"/>',
    "weld sites": '<weld site1="s" site2="t"/>',
    "weld that turns": '<weld body1="b" body2="c" anchor="0.1 0 0.2" torquescale="0"/>',
}


@pytest.mark.parametrize("name", LOOPS)
def test_a_loop_is_as_far_from_closed_as_in_mujoco(name, tmp_path):
    """The gap of three coordinates, at random configurations; and all angles at which MuJoCo has it closed."""
    mujoco = pytest.importorskip("mujoco", reason="mujoco is an optional extra and not installed")
    text = TREE.format(head="", equality=LOOPS[name])
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    robot = rnc.Robot.from_mjcf(write(tmp_path / "r.xml", text))
    (closure,) = robot.closures
    rows = rnc.LoopClosure(*closure).bind(robot)
    generator = np.random.default_rng(0)
    for scale in (0.0, 0.3, 1.0):
        values = {joint: generator.uniform(-scale, scale) for joint in robot.joint_names}
        values["a2"] += 0.2  # where the file has it
        for joint, value in values.items():
            data.qpos[model.joint(joint).qposadr[0]] = value
        mujoco.mj_forward(model, data)
        position = Kinematics(robot).position(robot.configuration(values))
        gap = np.linalg.norm(data.efc_pos[:3])
        # A weld's residual is a screw, whose length differs unless it is small; its points are checked by a connection.
        frame_a, frame_b, kind, offset_a, offset_b, _ = closure
        point = rnc.LoopClosure(frame_a, frame_b, "point", offset_a, offset_b).bind(robot)
        assert np.linalg.norm(point.residual(position)) == pytest.approx(gap, abs=1e-9)
        if kind == "frame":
            angles = 2 * np.arcsin(min(1.0, np.linalg.norm(data.efc_pos[3:6])))
            assert np.linalg.norm(rows.residual(position)[3:]) == pytest.approx(angles, abs=1e-6)


def test_loops_that_are_not_active_or_moved_by_a_user_are_none(tmp_path):
    equality = '<connect body1="b" body2="c" anchor="0 0 0" active="false"/><weld body1="hook" body2="b"/>'
    assert rnc.Robot.from_mjcf(write(tmp_path / "r.xml", TREE.format(head="", equality=equality))).closures == ()


@pytest.mark.parametrize(("equality", "words"), [
    ('<connect body1="b" body2="d" anchor="0 0 0"/>', "unknown element 'd' in equality .*expected one of: a, "),
    ('<weld site1="s" site2="r"/>', "unknown element 'r' in equality"),
    ('<connect body1="b" anchor="0 0"/>', "<connect>: anchor takes 3 finite numbers"),
    ('<weld body1="b" relpose="0 0 nan 1 0 0 0"/>', "relpose takes 7 finite numbers"),
])  # fmt: skip
def test_a_loop_of_nothing_is_refused_by_name(equality, words, tmp_path):
    with pytest.raises(rnc.ModelError, match=words):
        rnc.Robot.from_mjcf(write(tmp_path / "r.xml", TREE.format(head="", equality=equality)))


def test_a_loop_that_stays_open_is_warned_of(tmp_path):
    robot = rnc.Robot.from_mjcf(write(tmp_path / "r.xml", TREE.format(head="", equality=LOOPS["connect"])))
    with pytest.warns(rnc.ModelWarning, match="loops that the file closes are open: b and c"):
        rnc.NonholonomicSystem(robot)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        system = rnc.NonholonomicSystem(robot, [rnc.LoopClosure(*closure) for closure in robot.closures])
    assert system.m == 3
