"""Limits of the robot's file in plans: kept by default, replaced row by row, and refused at once."""

from dataclasses import replace
from functools import partial

import numpy as np
import pinocchio as pin
import pytest

import forklifts
import rnc_pin as rnc
import systems
from benchmarks.planned_models import mobile_manipulator, tractor
from driven_bases import KINDS, drafted_model
from node_rows import check_rows
from rnc_pin.motion.optimal import FileLimits, InputBound, OutputBound, SolverSettings, VelocityBound
from rnc_pin.motion.optimal.costs import NodeData
from rnc_pin.motion.planning.action_models import Nodes, action_model
from rnc_pin.verdict import FindingKind, Severity

AHEAD = (1.0, 0.0, 0.0)
FEW = SolverSettings(nodes=20)
SWERVE = partial(drafted_model, KINDS["four steered drives"])


def lift_plan(reduced, lift, duration=8.0, settings=FEW, **options):
    start, goal = reduced.robot.configuration(), forklifts.goal_of(AHEAD, lift)
    return rnc.optimal.plan(reduced, start, goal, duration, settings=settings, seeds=0, **options)


def test_goals_as_configurations_and_starts_are_compared_too(tmp_path):
    reduced = forklifts.forklift(tmp_path)
    low, high = (reduced.robot.configuration({"lift_joint": lift}) for lift in (0.2, 1.5))
    with pytest.raises(rnc.InfeasibleError, match=r"goal: value of lift_joint = 1\.5 is above the limit 1\.4 of the"):
        rnc.optimal.plan(reduced, low, high, 4.0)
    with pytest.raises(rnc.InfeasibleError, match=r"start: value of lift_joint = 1\.5 is above the limit 1\.4 of the"):
        rnc.optimal.plan(reduced, high, low, 4.0)
    fast = [0.0, 0.0, 0.8]
    with pytest.raises(rnc.InfeasibleError, match=r"start: velocity of lift_joint = 0\.8 is above the limit 0\.5"):
        rnc.optimal.plan(reduced, low, low, 4.0, v2_0=fast)
    with pytest.raises(rnc.InfeasibleError, match=r"goal: value of lift_joint = 0\.2 is above the limit 0\.1 of its"):
        rnc.optimal.plan(reduced, low, low, 4.0, bounds=[OutputBound("lift_joint", 0.0, 0.1)])


@pytest.mark.parametrize("form", ["kinematic", "acceleration"])
def test_velocities_of_the_file_hold_during_the_motion(tmp_path, form):
    """A lift of 1.2 m in 3 s needs a speed of 0.4 m/s on average; without limits, a parabola has 0.6 m/s."""
    reduced = forklifts.forklift(tmp_path)
    plan = lift_plan(reduced, 1.2, duration=3.0, form=form)
    rates = plan.u[:, 2] if form == "kinematic" else plan.w[:, 2]
    assert rates.max() <= 0.5 + 1e-4
    if form == "acceleration":
        assert rates.max() == pytest.approx(0.995 * 0.5, abs=1e-6)  # feedback has the rest
        same = [VelocityBound({"lift_joint": -0.5}, {"lift_joint": 0.5})], [OutputBound("lift_joint", 0.0, 1.4)]
        for bounds in same:
            restated = lift_plan(reduced, 1.2, duration=3.0, form=form, bounds=bounds)  # it is the run that needs it
            assert restated.w[:, 2].max() == pytest.approx(0.995 * 0.5, abs=1e-6)
        at_the_limit = lift_plan(reduced, 1.2, duration=3.0, form=form, settings=replace(FEW, reserve=0.0))
        assert at_the_limit.w[:, 2].max() == pytest.approx(0.5, abs=1e-6)
        free = lift_plan(reduced, 1.2, duration=3.0, form=form, limits=FileLimits(velocity=False))
        assert free.w[:, 2].max() == pytest.approx(0.6, rel=0.01)
    wider = lift_plan(reduced, 1.2, duration=2.0, form=form, bounds=[VelocityBound({"lift_joint": -1.0})])
    assert wider.q[-1, 4] == pytest.approx(1.2, abs=1e-4)  # a stated row replaces both sides
    with pytest.raises(rnc.InfeasibleError, match="no plan in 2 s"):
        lift_plan(reduced, 1.2, duration=2.0, form=form)


def test_a_reserve_ends_where_the_start_or_the_goal_is(tmp_path):
    """The lift starts at its lower limit and ends at the upper one."""
    plan = lift_plan(forklifts.forklift(tmp_path), 1.4)
    assert plan.q[[0, -1], 4].tolist() == pytest.approx([0.0, 1.4], abs=1e-6)


def test_velocities_of_joints_that_are_no_outputs_hold():
    """The hitch turns with speed and steering; its limit is the smallest here."""
    reduced = tractor(1)
    reduced.robot.model.upperVelocityLimit[reduced.robot.velocity_indices("hitch_1")] = 0.08
    start = reduced.robot.configuration({"hitch_1": 0.6})
    ahead = {rnc.FramePosition("tractor", "xy"): [3.0, 0.0]}
    straight = {"bounds": [InputBound(-2.0, 2.0)], "settings": SolverSettings(nodes=20), "seeds": 0}
    hitch = reduced.robot.velocity_indices("hitch_1").start
    plans = [rnc.optimal.plan(reduced, start, ahead, 6.0, limits=each, **straight) for each in (None, FileLimits())]
    fastest = [np.abs(reduced.at(plan.q, plan.w).v[:, hitch]).max() for plan in plans]
    assert fastest[0] > 0.1
    assert fastest[1] == pytest.approx(0.995 * 0.08, abs=1e-6)


def test_efforts_of_the_file_hold_in_the_dynamic_form(tmp_path):
    """80 kg with 10 N: 0.2 m take at least 2 sqrt(0.2 / 0.125) = 2.53 s without gravity."""
    reduced = forklifts.forklift(tmp_path, effort=10, gravity=(0.0, 0.0, 0.0))
    plan = lift_plan(reduced, 0.2, duration=2.7, form="dynamic")
    assert np.abs(plan.u[:, 2]).max() == pytest.approx(10.0, abs=1e-3)
    with pytest.raises(rnc.InfeasibleError, match=r"no plan in 2\.4 s"):
        lift_plan(reduced, 0.2, duration=2.4, form="dynamic")
    for free in ({"limits": FileLimits(effort=False)}, {"bounds": [InputBound({"lift_joint": -40.0})]}):
        assert np.abs(lift_plan(reduced, 0.2, duration=2.4, form="dynamic", **free).u[:, 2]).max() > 10.5


def test_an_effort_limit_of_zero_counts_as_not_stated_and_is_found(tmp_path):
    reduced = forklifts.forklift(tmp_path, effort=0)
    plan = lift_plan(reduced, 0.5, form="dynamic")
    found = plan.verdict.first
    assert (found.kind, found.where, found.severity) == (FindingKind.EFFORT, "lift_joint", Severity.DEGRADES)
    assert found.amount == np.abs(plan.u[:, 2]).max()
    assert "whose effort limit in the robot's file is 0 and counts as not stated" in found.message
    assert not lift_plan(reduced, 0.5, form="dynamic", bounds=[InputBound({"lift_joint": -2e3})]).verdict.findings


@pytest.mark.parametrize("form", ["kinematic", "acceleration", "dynamic"])
@pytest.mark.parametrize("model", [partial(tractor, 2), mobile_manipulator, systems.space_robot_in_joints, SWERVE])
def test_derivatives_of_all_limits_are_those_of_central_differences(form, model):
    reduced = model()
    model, generator = action_model(reduced, form), np.random.default_rng(0)
    q = np.array([reduced.random_configuration(generator, 0.4) for _ in range(3)])
    at, u = Nodes(q, 0.3 * generator.normal(size=(3, model.nw))), 0.3 * generator.normal(size=(3, model.nu))
    limits = FileLimits().bind(model, [])
    assert limits
    for block in limits:
        x = check_rows(model, block, at, u).J[:, :, : model.nx]
        if form != "kinematic" and block.of_state:  # at the end there is no input
            last = block.rows(NodeData(model, at, None, np.zeros(3)), True)
            np.testing.assert_allclose(last.J[:, :, : model.nx], x, atol=1e-9)


def test_a_plan_aims_steered_wheels_without_a_lateral_row():
    reduced = SWERVE()
    model, data = reduced.robot.model, reduced.robot.model.createData()
    goal, few = {rnc.FramePosition("base", "xy"): [0.8, 0.4], rnc.FrameYaw("base"): 0.5}, SolverSettings(nodes=12)
    plan = rnc.optimal.plan(reduced, reduced.robot.configuration(), goal, 4.0, seeds=0, settings=few)
    for q, v in zip(plan.q, reduced.at(plan.q, plan.w).v, strict=True):
        pin.forwardKinematics(model, data, q, v)
        for wheel in ("w0", "w1", "w2", "w3"):  # along its axle a wheel moves as its hub
            hub = pin.getFrameVelocity(model, data, model.getFrameId(wheel), pin.ReferenceFrame.LOCAL)
            assert abs(hub.linear[1]) < 0.01
