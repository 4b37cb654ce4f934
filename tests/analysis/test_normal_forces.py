"""Normal forces: two ways to compute them beside each other, closed forms, and lift-offs that are told."""

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import minimize

import rnc_pin as rnc
from bodies import add_body
from rnc_pin.analysis import NormalForces, first_lift_off
from rnc_pin.analysis.normal_forces import balanced
from rnc_pin.math.convex_programs import nonnegative
from rnc_pin.motion.planning import MinimumJerk
from rnc_pin.motion.whole_body import InverseDynamicsQP
from rnc_pin.simulation import ReducedPlant, margins_along
from simple_controllers import Inputs, silent

WHEELS = ["left_wheel_joint", "right_wheel_joint"]
G = 9.81


def cart(base, gravity=None):
    """A differential drive on two wheels and a caster ahead of them."""
    robot = rnc.Robot.from_urdf("differential_drive.urdf", base=base, gravity=gravity)
    contacts = [rnc.RollingWheel(wheel, 0.1) for wheel in ("left_wheel", "right_wheel")]
    system = rnc.NonholonomicSystem(robot, [*contacts, rnc.Caster("nose", radius=0.1)], WHEELS)
    reduced = system.reduce([rnc.JointPosition(wheel) for wheel in WHEELS])
    return reduced, reduced.assembled(robot.configuration())


def test_forces_from_the_motion_are_the_multipliers_of_a_free_base(generator):
    """The same robot twice: on a planar base no row carries, on a free base three rows do."""
    (planar, q_planar), (free, q_free) = cart("planar"), cart("free")
    v2, T = generator.normal(size=(20, 2)) * 8.0, generator.normal(size=(20, 2)) * 20.0
    ours = NormalForces(planar).at(planar.at(np.tile(q_planar, (20, 1)), v2), T)
    state = free.at(np.tile(q_free, (20, 1)), v2)
    vertical = [name.startswith("vertical") for name in free.all_constraints.names]
    np.testing.assert_allclose(ours, state.contact_forces(T)[:, vertical], atol=1e-9 * 215.0)
    np.testing.assert_allclose(NormalForces(free).at(state, T), ours, atol=1e-9 * 215.0)
    assert (ours < 0).any()


HOOK = (-0.3, 0.1, 0.35)
"""Point of the cart's base at which something pulls [m]."""
PULLS = [
    lambda z: [rnc.forces.Wrench("hook", (-60.0, 20.0, 15.0), (3.0, -2.0, 1.0))],
    lambda z: [rnc.forces.Wrench("hook", (-60.0, 20.0, 15.0), (3.0, -2.0, 1.0), axes="own")],
    lambda z: [rnc.forces.Spring(rnc.FramePosition("hook"), 80.0, (-0.9, 0.4, 0.5 + z))],
    lambda z: [rnc.forces.Damper(rnc.FramePosition("hook", "xz"), 30.0), rnc.forces.Spring(rnc.FrameTilt("hook"), 9.0)],
    lambda z: [rnc.forces.SmoothFriction(rnc.FrameSpeed("hook"), 12.0, 0.1), rnc.forces.Wrench("nose", (0, 0, -30.0))],
    lambda z: [rnc.forces.Spring(rnc.JointPosition(WHEELS[0]), 50.0, 0.3)],
    lambda z: [rnc.forces.Damper(rnc.CenterOfMass(), 25.0), rnc.forces.Spring(rnc.Distance("hook", "nose"), 500.0)],
]


def pulled(base, forces, constraints=(), actuators=WHEELS):
    """The cart of ``cart`` with a hook, with forces and more constraints."""
    robot = rnc.Robot.from_urdf("differential_drive.urdf", base=base)
    root = robot.model.frames[robot.frame_id("base")]
    hook = root.placement * pin.SE3(pin.rpy.rpyToMatrix(0.3, -0.2, 0.5), np.array(HOOK))
    robot.model.addFrame(pin.Frame("hook", root.parentJoint, hook, pin.FrameType.OP_FRAME))
    contacts = [rnc.RollingWheel(wheel, 0.1) for wheel in ("left_wheel", "right_wheel")]
    contacts += [rnc.Caster("nose", radius=0.1), *constraints]
    system = rnc.NonholonomicSystem(robot, contacts, actuators, forces=forces)
    reduced = system.reduce([rnc.JointPosition(wheel) for wheel in WHEELS[len(constraints) :]])
    return reduced, reduced.assembled(robot.configuration())


@pytest.mark.parametrize("forces", PULLS)
def test_what_pulls_at_a_planar_base_loads_its_wheels_as_on_a_free_base(forces, generator):
    """The ground of the planar base is a radius of its wheels below the world's origin."""
    (planar, q_planar), (free, q_free) = pulled("planar", forces(0.0)), pulled("free", forces(0.1))
    v2, T = generator.normal(size=(9, 2)), generator.normal(size=(9, 2))
    models = [(model, np.tile(q, (9, 1))) for model, q in ((planar, q_planar), (free, q_free))]
    np.testing.assert_allclose(*(NormalForces(model).at(model.at(q, v2), T) for model, q in models), atol=1e-7)
    np.testing.assert_allclose(*(rnc.Grip(model, 0.9).used(q, v2, T) for model, q in models), atol=1e-6)


@pytest.mark.parametrize(("forces", "constraints", "actuators", "name"), [
    ([rnc.forces.ForceFunction(lambda q, v: -0.1 * v, name="drag")], [], WHEELS, "drag"),
    ([rnc.forces.Damper(rnc.Output(None, lambda q: np.eye(5)[:1], names=["x"]), 1.0)], [], WHEELS, "damper"),
    ([], [rnc.FixedOutput(rnc.FramePosition("hook", "x"), -0.3)], WHEELS, "hook"),
    ([], [], np.eye(5)[:, :1], "T.0."),
])  # fmt: skip
def test_an_unknown_wrench_on_a_planar_base_leaves_its_loads_unknown(forces, constraints, actuators, name):
    reduced, q = pulled("planar", forces, constraints, actuators)
    states, T = reduced.at(q, np.zeros(reduced.r)), np.zeros(reduced.p)
    assert np.isnan(NormalForces(reduced).at(states, T)).all()
    stop = rnc.SimulationOptions(rnc.Stop(lift_off=True))
    for use in (
        lambda: rnc.Grip(reduced, 0.5),
        lambda: InverseDynamicsQP(reduced, [], dt=0.01),
        lambda: rnc.simulate(reduced, Inputs(lambda _: T), q, 0.05, 0.01, options=stop),
    ):
        with pytest.raises(rnc.ConfigurationError, match=f"loads of the contacts are unknown.*{name}"):
            use()
    run = rnc.simulate(reduced, Inputs(lambda _: T), q, 0.05, 0.01)
    assert run.verdict.word == "degraded"
    assert str(run.verdict.first).startswith("the loads of left_wheel, right_wheel, nose are unknown")


@pytest.mark.parametrize("base", ["planar", "free"])
def test_a_run_names_the_first_contact_that_would_lift_off(base):
    reduced, q = cart(base)
    normal, rest = NormalForces(reduced), reduced.at(q, np.zeros(2))
    still, pushed = (normal.at(rest, np.full(2, T))[2] for T in (0.0, 1.0))
    limit = still / (still - pushed)  # torque of both wheels at which the nose carries nothing: forces are affine in it
    held = rnc.simulate(reduced, Inputs(lambda _: [0.99 * limit] * 2), q, 0.05, 0.01)
    lifted = rnc.simulate(reduced, Inputs(lambda _: [1.5 * limit] * 2), q, 0.05, 0.01)
    assert rnc.summarize(held)["lift_off"] is None
    found = rnc.summarize(lifted)["lift_off"]
    assert (found["contact"], found["time"]) == ("nose", 0.0)
    still = NormalForces(reduced).at(reduced.at(q, np.zeros(2)), np.zeros(2))[2]
    assert found["force"] == pytest.approx(-0.5 * still, rel=1e-9)
    assert found["lowest"] <= found["force"]
    assert lifted.info.outputs.normal_forces.names == ("left_wheel", "right_wheel", "nose")
    np.testing.assert_allclose(lifted.normal_forces.sum(axis=1), 215.82, rtol=1e-6)
    # The product of speed and yaw rate rises and falls in one sample; its quarters are judged, to 1 % of the weight.
    coarse, fine = (rnc.simulate(reduced, Inputs(lambda _: [-18, -6]), q, 0.4, dt, v2_0=[30, 30]) for dt in (0.4, 0.01))
    assert coarse.normal_forces.min() > 0
    for run, where, lowest in (
        (coarse, "left_wheel", fine.normal_forces[10:40:10]),
        (lifted, "nose", lifted.normal_forces),
    ):
        (told,) = (each for each in run.verdict.findings if each.kind == "lift_off")
        assert (told.where, told.amount) == (where, pytest.approx(-lowest.min(), abs=2.2))
        assert rnc.summarize(run)["lift_off"]["contact"] == where
    assert held.verdict.succeeded
    options = rnc.SimulationOptions(rnc.Stop(lift_off=True))
    with pytest.raises(rnc.LimitError, match=r"'left_wheel' lifts off at t = 0\.100 s"):
        rnc.simulate(reduced, Inputs(lambda _: [-18, -6]), q, 0.4, 0.4, v2_0=[30, 30], options=options)


def test_forces_are_those_of_the_masses_that_move():
    reduced, q = cart("planar")
    other, _ = cart("planar")
    for joint, inertia in enumerate(other.robot.model.inertias):
        other.robot.model.inertias[joint] = pin.Inertia(2 * inertia.mass, inertia.lever, 2 * inertia.inertia)
    plant = rnc.plants.FaultyPlant(ReducedPlant(other), rnc.Faults(), reduced)
    heavy = rnc.simulate(reduced, Inputs(lambda _: [2.0, 2.0]), q, 0.05, 0.01, plant=plant)
    light = rnc.simulate(reduced, Inputs(lambda _: [1.0, 1.0]), q, 0.05, 0.01)
    np.testing.assert_allclose(heavy.normal_forces, 2 * light.normal_forces, rtol=1e-9)
    unknown = rnc.simulate(reduced, Inputs(lambda _: [1.0, 1.0]), q, 0.05, 0.01, plant=silent(ReducedPlant(reduced)))
    assert unknown.normal_forces.shape == (6, 0)


def test_where_nothing_presses_on_the_ground_there_are_no_normal_forces():
    assert NormalForces(cart("planar", gravity=(0, 0, 0))[0]).names == ()
    robot = rnc.Robot.from_urdf("space_robot.urdf")  # bolted to the world
    reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("tip")], robot.joint_names).reduce()
    assert NormalForces(reduced).names == ()
    for rail in ("PX", "PY"):  # that carries what turns on it
        model = pin.Model()
        add_body(model, "turn", "RZ", 1.0, add_body(model, "rail", rail, 1.0), frame="body")
        reduced = rnc.NonholonomicSystem(rnc.Robot(model), [rnc.NoSideSlip("body", at=(0.3, 0, 0))]).reduce()
        assert NormalForces(reduced).names == ()


def test_preflight_and_grip_report_a_caster_that_lifts_off():
    reduced, q = cart("planar")
    for duration, lifts in ((6.0, False), (0.9, True)):
        controller = rnc.control.ReducingOutputController(reduced, MinimumJerk(np.zeros(2), [12.0, 12.0], duration))
        plain = margins_along(reduced, controller, q, duration)
        needed = margins_along(reduced, controller, q, duration, grip=rnc.Grip(reduced, friction=5.0)).grip
        assert needed.used < 1.0
        assert (needed.lift_off, needed.complaints()) == (plain.lift_off, plain.complaints())
        assert [each[:34] for each in plain.complaints()] == ["contact 'nose' would lift off at t"] * lifts


def test_four_supports_carry_what_they_can_without_pulling():
    """Least norm alone pulls at a corner: it is the closest that pushes instead, by a general optimiser."""
    corners = np.array([[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]])
    gives = np.vstack([np.ones(4), corners[:, 1], -corners[:, 0]])
    place = np.array([0.7, 0.6])
    needed = np.array([10.0, 10.0 * place[1], -10.0 * place[0]])
    assert (np.linalg.pinv(gives) @ needed).min() < 0
    forces = balanced(gives[None], np.zeros((1, 3, 0)), needed[None])[0]
    assert forces.min() >= 0
    np.testing.assert_allclose(gives @ forces, needed, atol=1e-9)
    inside = {"type": "eq", "fun": lambda f: gives @ f - needed}
    best = minimize(lambda f: f @ f, np.full(4, 2.5), bounds=[(0, None)] * 4, constraints=inside)
    np.testing.assert_allclose(forces, best.x, atol=1e-4)
    outside = balanced(gives[None], np.zeros((1, 3, 0)), (needed * [1, 2, 2])[None])[0]  # it would tip over
    np.testing.assert_allclose(outside, np.linalg.pinv(gives) @ (needed * [1, 2, 2]), atol=1e-9)
    np.testing.assert_array_equal(nonnegative(np.array([1.0, -1.0]), np.zeros((2, 0))), [1.0, -1.0])


def test_the_first_lift_off_is_the_first_below_rounding():
    times, forces = np.arange(4.0), np.array([[5.0, 5.0], [9.0, -1.3e-5], [10.5, -2e-5], [12.0, -2.0]])
    found = first_lift_off(times, forces, ("front", "rear"))
    assert (found.contact, found.time, found.force, found.lowest) == ("rear", 2.0, -2e-5, -2.0)
    assert str(found) == "contact 'rear' would lift off at t = 2.00 s: the model pulls it down with up to 2 N"
    assert first_lift_off(times, np.full((4, 1), np.nan), ("front",)) is None
    assert first_lift_off(times, forces[:, :0], ()) is None


def test_forces_of_two_free_directions_are_the_projection_on_a_triangle():
    """Of three forces with a given sum; what is below zero is taken from the others evenly."""
    free = np.linalg.svd(np.ones((1, 3)))[2][1:].T
    for forces, expected in (([1.0, -0.2, -0.3], [0.5, 0.0, 0.0]), ([0.7, 0.5, -0.2], [0.6, 0.4, 0.0])):
        np.testing.assert_allclose(nonnegative(np.array(forces), free), expected, atol=1e-12)
