"""Outputs that keep their value, beside models without the joint and beside equations that are written out here."""

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from rnc_pin.planning import Harmonic

ANGLE = 0.4


@pytest.fixture(scope="module")
def robot():
    return rnc.Robot.from_urdf("space_robot.urdf")


def test_a_welded_joint_is_a_locked_one(robot):
    """Its dynamics are those of Pinocchio's model without the joint."""
    welded = rnc.FixedOutput(rnc.JointPosition("joint_1"), ANGLE)
    reduced = rnc.NonholonomicSystem(robot, [welded], ["joint_2", "joint_3"]).reduce()
    q = reduced.assembled(robot.configuration({"joint_2": 0.7, "joint_3": -0.2}))
    assert not reduced.rheonomic
    assert not reduced.all_constraints.affine
    locked = pin.buildReducedModel(robot.model, [robot.joint_id("joint_1")], q)
    generator = np.random.default_rng(2)
    v, T = generator.normal(size=locked.nv), generator.normal(size=2)
    free = [k for k, name in enumerate(robot.velocity_names) if "joint_1" not in name]
    whole = np.zeros(robot.nv)
    whole[free] = v
    state = reduced.at(q, v=whole)
    found = state.acceleration(T)
    forces = np.zeros(locked.nv)
    forces[-2:] = T
    q_free = np.delete(q, robot.model.idx_qs[robot.joint_id("joint_1")])
    expected = pin.aba(locked, locked.createData(), q_free, v, forces)
    np.testing.assert_allclose(found[free], expected, rtol=1e-9, atol=1e-10)
    assert found[robot.velocity_names.index("joint_1")] == pytest.approx(0.0, abs=1e-12)


def test_a_hand_stays_on_its_wall(robot):
    """The distance to the wall is kept over a free motion, and the force on the hand does no work."""
    q0 = robot.configuration({"joint_1": 0.3, "joint_2": 0.5, "joint_3": 0.4})
    frame = robot.model.frames[-1].name
    place = rnc.FramePosition(frame, "x")
    value = place.bind(robot).value(rnc.NonholonomicSystem(robot).reduce().at(q0).position)
    reduced = rnc.NonholonomicSystem(robot, [rnc.FixedOutput(place, value)], robot.joint_names[1:]).reduce()
    start = np.linspace(0.1, 0.3, reduced.r)
    run = rnc.free_motion(reduced, q0, start, 1.0, 0.1, tolerance=1e-10)
    assert run.position_residual.max() < 1e-9
    np.testing.assert_allclose(run.energy, run.energy[0], rtol=1e-9)
    assert np.abs(run.contact_forces).max() > 1e-3


def test_what_cannot_be_kept_is_refused(robot):
    with pytest.raises(rnc.ConstraintError, match=r"fixed output joint_1: expected 1 numbers, found \[1, 2\]"):
        rnc.FixedOutput(rnc.JointPosition("joint_1"), [1, 2]).bind(robot)
    base = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
    with pytest.raises(rnc.ConstraintError, match="a speed has no value; PrescribedMotion prescribes its rate"):
        rnc.FixedOutput(rnc.FrameSpeed("sleigh", "x"), 0.0).bind(base)


def test_an_impact_takes_the_time_of_a_prescribed_motion(robot):
    """A joint that starts to follow its motion at t jumps to the rate of this time."""
    swing = Harmonic([0.0], [0.3], 0.5)
    driven = rnc.PrescribedMotion(rnc.JointPosition("joint_1"), swing)
    reduced = rnc.NonholonomicSystem(robot, [driven], ["joint_2", "joint_3"]).reduce()
    t = 0.8
    q = robot.configuration({"joint_1": swing.at(t).position[0]})
    jump = rnc.impact(reduced, q, np.zeros(robot.nv), t=t)
    assert jump.v[robot.velocity_names.index("joint_1")] == pytest.approx(swing.at(t).velocity[0], rel=1e-12)
    with pytest.raises(rnc.InputError, match="depend on time"):
        rnc.impact(reduced, q, np.zeros(robot.nv))


def test_a_scenario_file_welds_a_joint(tmp_path):
    text = (
        "robot: {urdf: space_robot.urdf}\nconstraints:\n  - {momentum: platform}\n"
        "  - {fixed_output: {output: {joint: joint_1}, value: 0.3}}\n"
        "actuators: [joint_2, joint_3]\ncontroller: {type: none}\nsimulation: {duration: 0.02, dt: 0.01}\n"
    )
    (tmp_path / "welded.yaml").write_text(text)
    scenario = rnc.Scenario.load(str(tmp_path / "welded.yaml"))
    assert "fixed(joint_1)" in scenario.system.constraints.names
    assert scenario.run().position_residual.max() < 1e-12
