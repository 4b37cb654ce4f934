"""Outputs that keep a value or follow a motion, beside models without the joint and equations written out here."""

from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest
import scipy

import rnc_pin as rnc
from bodies import add_body, add_frame
from refusals import refused
from rnc_pin.model.kinematics import Kinematics
from rnc_pin.motion.planning import Harmonic, Hold, InTurn, MinimumJerk
from simple_controllers import Idle


def test_an_impact_takes_the_time_of_a_prescribed_motion(robot):
    swing = Harmonic([0.0], [0.3], 0.5)
    driven = rnc.PrescribedMotion(rnc.JointPosition("joint_1"), swing)
    reduced = rnc.NonholonomicSystem(robot, [driven], ["joint_2", "joint_3"]).reduce()
    t = 0.8
    q = robot.configuration({"joint_1": swing.at(t).position[0]})
    jump = rnc.impact(reduced, q, np.zeros(robot.nv), t=t)
    assert jump.v[robot.velocity_names.index("joint_1")] == pytest.approx(swing.at(t).velocity[0], rel=1e-12)
    with pytest.raises(rnc.InputError, match="depend on time"):
        rnc.impact(reduced, q, np.zeros(robot.nv))


LENGTH, MASS, GRAVITY = 0.4, 1.3, 9.81


@pytest.fixture(scope="module")
def pendulum():
    """Pendulum on a pivot that slides vertically; at angle zero it stands upright."""
    model = pin.Model()
    pivot = add_body(model, "pivot", "PZ", 0.5, moments=1e-3)
    add_body(model, "hinge", "RY", MASS, pivot, com=(0.0, 0.0, LENGTH), moments=1e-9)
    model.damping = np.array([0.0, 0.2])
    robot = rnc.Robot(model)
    shaken = Harmonic([0.0], [0.02], 30.0, phase=np.pi / 2, ramp=0.2)
    system = rnc.NonholonomicSystem(robot, [rnc.PrescribedMotion(rnc.JointPosition("pivot"), shaken)], ["hinge"])
    return SimpleNamespace(robot=robot, shaken=shaken, system=system, reduced=system.reduce())


def kapitza(shaken, times, damping=0.0):
    """Angles of the pendulum whose pivot is shaken: ``I th'' = m l (g + z'') sin th - d th'``."""

    def rates(t, x):
        torque = MASS * LENGTH * (GRAVITY + shaken.at(t).acceleration[0]) * np.sin(x[0]) - damping * x[1]
        return [x[1], torque / (MASS * LENGTH**2 + 1e-9)]

    precise = {"rtol": 1e-12, "atol": 1e-12, "max_step": 0.005}
    return scipy.integrate.solve_ivp(rates, (0, times[-1]), [0.3, 0.0], "DOP853", times, **precise).y[0]


def test_a_sampled_run_with_damping_knows_the_time_of_each_stage(pendulum):
    plant = rnc.ReducedPlant(pendulum.reduced, joint_damping=True, substeps=2)
    run = rnc.simulate(pendulum.reduced, Idle(1), np.array([0.0, 0.3]), 0.2, dt=0.002, plant=plant)
    np.testing.assert_allclose(run.q[:, 1], kapitza(pendulum.shaken, run.time, 0.2), atol=1e-5)


def test_a_loop_counts_the_time_of_the_constraints_from_its_first_step(pendulum):
    loop = rnc.ControlLoop(pendulum.reduced, Idle(1), 0.01)
    for k in range(3):
        t = 7.0 + 0.01 * k
        v = np.array([pendulum.shaken.at(t - 7.0).velocity[0], 0.4])
        loop.step(t, np.array([pendulum.shaken.at(t - 7.0).position[0], 0.3]), v)
        assert np.abs(loop.last.measurement.residual).max() < 1e-12


def test_evaluations_need_the_time_and_take_one_for_each_state(pendulum, generator):
    reduced, q, v2 = pendulum.reduced, generator.uniform(-0.3, 0.3, (4, 2)), generator.uniform(-1, 1, (4, 1))
    times = np.array([0.05, 0.1, 0.3, 0.9])
    together = reduced.at(q, v2, t=times)
    for k, t in enumerate(times):
        alone, point = reduced.at(q[k], v2[k], t=t), pendulum.shaken.at(t)
        np.testing.assert_allclose(alone.v, [point.velocity[0], v2[k, 0]], rtol=1e-12)
        np.testing.assert_allclose(alone.v_dot(np.array([0.5])), [point.acceleration[0], 0.5], rtol=1e-12)
        for name in ("v", "H", "G", "b_dot"):
            np.testing.assert_allclose(getattr(together, name)[k], getattr(alone, name), rtol=1e-12, atol=1e-12)
        frozen = reduced.frozen(t)
        np.testing.assert_array_equal(frozen.at(q[k], v2[k]).G, alone.G)
        np.testing.assert_array_equal(frozen.forward_dynamics(q[k], v2[k], [0.2]), alone.v2_dot([0.2]))
        assert frozen.assembled(q[k])[0] == pytest.approx(point.position[0], abs=1e-12)
    for call in (
        lambda: reduced.at(q[0], v2[0]),
        lambda: reduced.forward_dynamics(q[0], v2[0], [0.0]),
        lambda: rnc.linearize(reduced, q[0], v2[0]),
    ):
        with pytest.raises(rnc.InputError, match=r"prescribed\(pivot\): .* t=0.0.*frozen"):
            call()
    with pytest.raises(rnc.InputError, match="t has shape"):
        reduced.at(q, v2, t=times[:3])
    assert rnc.analyze(reduced, samples=4).rank == 1


OUTPUTS = {
    "position": (rnc.FramePosition("hand", "xyz"), 3),
    "orientation": (rnc.FrameOrientation("hand"), 3),
    "yaw": (rnc.FrameYaw("hand"), 1),
    "speed": (rnc.FrameSpeed("hand", "y"), 1),
    "angular velocity": (rnc.FrameAngularVelocity("hand", "z"), 1),
}


@pytest.mark.parametrize("name", OUTPUTS)
def test_rates_of_the_rows_are_those_of_their_residual_over_time(name, generator):
    """On a free-flying body, along a motion that satisfies the rows: differences over time of all that has a rate."""
    model = pin.Model()
    body = add_body(model, "root_joint", "FreeFlyer", 2.0)
    add_frame(model, "hand", body, pin.SE3(pin.exp3(np.array([0.3, -0.5, 0.9])), np.array([0.2, 0.1, -0.4])))
    robot, (output, size) = rnc.Robot(model), OUTPUTS[name]
    motion = MinimumJerk(generator.uniform(-0.4, 0.4, size), generator.uniform(-0.4, 0.4, size), 1.3)
    rows = rnc.PrescribedMotion(output, motion).bind(robot)
    kinematics, q, t = Kinematics(robot), robot.random_configuration(generator), 0.6

    def at(s, v=None):
        here = kinematics.position(pin.integrate(model, q, s * along), t + s)
        return here if v is None else here.with_velocity(v)

    def admissible():
        here = kinematics.position(q, t)
        return np.linalg.lstsq(rows.jacobian(here), rows.rate(here), rcond=None)[0]

    along = admissible()
    moving, step = at(0.0, along), 1e-4

    def difference(of):
        return (8 * (of(at(step)) - of(at(-step))) - of(at(2 * step)) + of(at(-2 * step))) / (12 * step)

    np.testing.assert_allclose(rows.rate_dot(moving), difference(rows.rate), atol=1e-8)
    np.testing.assert_allclose(rows.jacobian_dot(moving), difference(rows.jacobian), atol=1e-8)
    expected = rows.jacobian_dot(moving) @ along - rows.rate_dot(moving)
    np.testing.assert_allclose(rows.bias_acceleration(moving), expected, atol=1e-10)
    if any(rows.holonomic):
        q = rnc.NonholonomicSystem(robot, [rnc.PrescribedMotion(output, motion)]).assembly.project(q, t=t)
        along = admissible()
        np.testing.assert_allclose(rows.residual(kinematics.position(q, t)), 0.0, atol=1e-11)
        np.testing.assert_allclose(difference(rows.residual), 0.0, atol=1e-8)


def test_a_holonomic_row_of_the_user_may_move(robot):
    """The first joint follows sin(2 t); its functions take one number as time."""
    rate, residual = lambda q, t: np.array([2 * np.cos(2 * float(t))]), lambda q, t: q[1:2] - np.sin(2 * float(t))
    driven = rnc.Pfaffian(lambda q, t: np.eye(4)[1:2], rate=rate, residual=residual, rheonomic=True)
    reduced = rnc.NonholonomicSystem(robot, [driven], ["joint_2", "joint_3"]).reduce()
    run = rnc.free_motion(reduced, robot.configuration(), np.zeros(3), 0.5, 0.1)
    np.testing.assert_allclose(run.q[:, 1], np.sin(2 * run.time), atol=1e-11)
    assert np.ptp(run.energy - run.work) < 1e-9


def test_rows_that_demand_two_things_are_refused(robot):
    row = np.eye(4)[:1]

    def turning(speed, name):
        return rnc.Pfaffian(
            lambda q: row, lambda q, v: 0 * row, [name], rate=lambda q: np.array([speed]),
            rate_dot=lambda q, v: np.zeros(1),
        )  # fmt: skip

    assert rnc.NonholonomicSystem(robot, [turning(0.5, "a"), turning(0.5, "b")]).m == 1
    words = r"'b' contradicts the others: it requires 0.7, the others require 0.5"
    with pytest.raises(rnc.ConstraintError, match=words):
        rnc.NonholonomicSystem(robot, [turning(0.5, "a"), turning(0.7, "b")])


SWING = Harmonic([0.0], [0.3], 0.5)


def doubled(wrong):
    """A swing of which one rate is twice what it should be."""

    def at(t):
        return (point := SWING.at(t))._replace(**{wrong: 2.0 * getattr(point, wrong)})

    return SimpleNamespace(size=1, duration=np.inf, at=at)


def prescribed(motion):
    return rnc.PrescribedMotion(rnc.JointPosition("joint_1"), motion)


test_what_cannot_be_kept_is_refused = refused([
    (rnc.FixedOutput(rnc.JointPosition("joint_1"), [1, 2]), r"joint_1: expected 1 numbers, found \[1, 2\]"),
    (rnc.FixedOutput(rnc.FrameSpeed("tip", "x"), 0.0), "a speed has no value; PrescribedMotion prescribes its rate"),
    (prescribed(Harmonic([0, 0], 1.0, 1.0)), r"joint_1: expected a Reference of size 1, found .* of size 2"),
    (prescribed(0.3), r"expected a Reference of size 1, found 0\.3"),
    (prescribed(doubled("velocity")), "joint_1: its velocity is not the rate of its position"),
    (prescribed(doubled("acceleration")), "joint_1: its acceleration is not the rate of its velocity"),
    (rnc.Pfaffian(lambda q, t: np.eye(4)[:1], names=["belt"], rate=lambda q, t: np.array([t**2]),
        rate_dot=lambda q, v, t: np.array([t]), rheonomic=True), r"rate_dot\(q, v\).* row 'belt'"),
    (rnc.MomentumConservation("platform", [1.0, 2.0]), "takes 1 finite number, found"),
    (rnc.MomentumConservation("platform", np.nan), "takes 1 finite number, found nan"),
    (rnc.Pfaffian(lambda q: np.eye(4)[:1], rate_dot=lambda q, v: v[:1]), "only together"),
    (rnc.Pfaffian(np.eye(4)[:1]), "'rows' of a Pfaffian constraint has to be a function.*found ndarray"),
    (rnc.Pfaffian(lambda q: np.eye(4)[:1], rate=np.ones(1)), "'rate' of a Pfaffian constraint has to be"),
    (rnc.Pfaffian(lambda q: np.eye(4)[:1], rate=lambda q: q[:1], residual=lambda q: q[:1]), "'residual', not both"),
], lambda kind: kind.bind(rnc.Robot.from_urdf("space_robot.urdf")), rnc.ConstraintError)  # fmt: skip


@pytest.mark.parametrize(
    "motion", [SWING, Hold([0.3]), InTurn([MinimumJerk([0.0], [0.3], 0.4), MinimumJerk([0.3], [0.0], 0.4, begin=0.4)])]
)
def test_motions_at_rest_and_in_turn_are_their_own(robot, motion):
    prescribed(motion).bind(robot)
