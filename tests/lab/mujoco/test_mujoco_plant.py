"""MuJoCo as the plant: the same robot, the same motion, and wheels that grip only so far."""

import importlib
import re
import sys

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from bodies import add_body, add_frame
from refusals import refused
from rnc_pin.errors import missing_extra
from systems import arm_on_base, differential_drive, floating_robot, sleigh

mujoco = pytest.importorskip("mujoco", reason="comes with the extra mujoco")

from rnc_pin.lab.mujoco import MuJoCoPlant, MuJoCoSettings  # noqa: E402
from rnc_pin.lab.mujoco.body_tree import BodyTree, RobotCoordinates  # noqa: E402
from rnc_pin.lab.mujoco.contact_bodies import contact_bodies  # noqa: E402
from simple_controllers import Inputs  # noqa: E402


def every_kind_of_joint():
    """A chain on a planar base with every kind of joint that both have, anywhere and about any axis."""
    pin.seed(1)
    model, slanted = pin.Model(), np.array([0.6, 0.0, 0.8])
    stack = pin.JointModelComposite()
    for inner in (pin.JointModelRX(), pin.JointModelPY(), pin.JointModelRUBZ()):
        stack.addJoint(inner, pin.SE3.Random())
    kinds = [
        pin.JointModelPlanar(), pin.JointModelRevoluteUnaligned(slanted), pin.JointModelPrismaticUnaligned(slanted),
        pin.JointModelSpherical(), pin.JointModelRUBY(), pin.JointModelTranslation(), pin.JointModelSphericalZYX(),
        stack,
    ]  # fmt: skip
    joint = 0
    for number, kind in enumerate(kinds):
        joint = model.addJoint(joint, kind, pin.SE3.Random(), f"joint_{number}")
        inertia = pin.Inertia(1.3, np.array([0.1, 0.2, -0.3]), np.diag([0.3, 0.4, 0.5]) + 0.01)
        model.appendBodyToJoint(joint, inertia, pin.SE3.Random())
    model.armature[3:] = 0.2
    return rnc.Robot(model)


def floating_panda():
    satellite = rnc.Robot.from_urdf("satellite.urdf", base="free", gravity=(0, 0, 0))
    fingers = {"panda_finger_joint1": 0.03, "panda_finger_joint2": 0.03}
    return satellite.attach(rnc.Robot.from_example("panda", lock=fingers), "mount")


ROBOTS = {
    "space robot": lambda: rnc.Robot.from_urdf("space_robot.urdf"),
    "mobile manipulator": lambda: rnc.Robot.from_urdf("mobile_manipulator.urdf", base="planar"),
    "floating arm": floating_panda,
    "TIAGo": lambda: rnc.Robot.from_example("tiago_no_hand", base="planar"),
    "every kind of joint": every_kind_of_joint,
}


class Written:
    def __init__(self, robot):
        spec = mujoco.MjSpec()
        tree = BodyTree(spec, robot, "as it is", False)
        self.robot, self.model = robot, spec.compile()
        self.data = mujoco.MjData(self.model)
        tree.finish(self.model, self.data, False)
        self.joints = RobotCoordinates(tree)

    def velocity(self, q, v):
        other = mujoco.MjData(self.model)
        self.joints.write(q, v, other.qpos, other.qvel)
        return other.qvel.copy()


@pytest.mark.parametrize("name", ROBOTS)
def test_masses_and_accelerations_are_those_of_pinocchio(name):
    robot = ROBOTS[name]()
    written = Written(robot)
    model, data, generator = written.model, written.data, np.random.default_rng(3)
    for _ in range(3):
        q = pin.integrate(robot.model, pin.neutral(robot.model), generator.uniform(-2, 2, robot.nv))
        v, force = generator.normal(size=robot.nv), 10 * generator.normal(size=robot.nv)
        written.joints.write(q, v, data.qpos, data.qvel)
        q_read, v_read = written.joints.read(data.qpos, data.qvel)
        np.testing.assert_allclose(pin.difference(robot.model, q, q_read), 0, atol=1e-14)
        np.testing.assert_allclose(v_read, v, atol=1e-14)

        data.qfrc_applied[:] = 0
        written.joints.add_force(data.qpos, force, data.qfrc_applied)
        mujoco.mj_forward(model, data)
        columns = [written.velocity(q, each) for each in np.eye(robot.nv)]
        inertia = np.empty((robot.nv, robot.nv))
        for k, column in enumerate(columns):
            momentum = np.empty(model.nv)
            mujoco.mj_mulM(model, data, momentum, column)
            inertia[:, k] = [momentum @ other for other in columns]
        expected = pin.crba(robot.model, robot.model.createData(), q)
        np.testing.assert_allclose(np.triu(inertia), np.triu(expected), rtol=0, atol=1e-10 * np.abs(expected).max())

        step = 1e-6
        v_dot = pin.aba(robot.model, robot.model.createData(), q, v, force)
        after = written.velocity(pin.integrate(robot.model, q, step * v), v + step * v_dot)
        np.testing.assert_allclose((after - data.qvel) / step, data.qacc, rtol=0, atol=1e-5 * np.abs(data.qacc).max())


def driven(reduced, q0, v2_0, T, duration, **settings):
    """A plant and the exact motion of the reduced model: (plant, difference of q, difference of v)."""
    exact = rnc.free_motion(reduced, q0, v2_0, duration, duration / 10, T)
    plant = MuJoCoPlant(reduced, MuJoCoSettings(**settings), q0)
    assert isinstance(plant, rnc.plants.Plant)
    plant.reset(q0, reduced.at(q0, v2_0).v)
    plant.apply(np.zeros(reduced.p) if T is None else T)
    plant.advance(duration)
    assert plant.data.time == pytest.approx(duration)
    q, v = plant.read()
    return plant, np.abs(pin.difference(reduced.robot.model, exact.q[-1], q)).max(), np.abs(v - exact.v[-1]).max()


def test_a_space_robot_keeps_its_momentum():
    system = floating_robot()
    q0 = system.robot.configuration({"joint_1": -0.4, "joint_2": 1.8, "joint_3": -1.1})
    plant, q, v = driven(system.reduce(), q0, np.zeros(3), np.array([0.5, -0.3, 0.2]), 1.5)
    assert max(q, v) < 1e-10
    assert np.abs(plant.slip()).max() < 1e-10
    assert (plant.wheel_names, plant.friction_used().shape) == ((), (0,))


def test_geared_joints_and_closed_loops(robot):
    gear = rnc.JointCoupling("joint_2", "joint_1", ratio=-0.5, offset=0.1)
    system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform"), gear], ["joint_1", "joint_3"])
    q0 = system.assembled(robot.configuration({"joint_1": 0.4}), ["joint_1"])
    _, q, _ = driven(system.reduce(), q0, np.zeros(2), np.array([1.0, 0.2]), 2.0)
    assert q < 1e-7

    system = rnc.NonholonomicSystem(robot, [rnc.LoopClosure("platform_body", "tip", kind="point")], ["joint_1"])
    q0 = system.assembled(robot.configuration({"joint_1": 0.5, "joint_2": 2.0, "joint_3": 1.5}))
    reduced = system.reduce()
    plant, q, _ = driven(reduced, q0, np.zeros(2), np.array([2.0]), 1.0)
    assert q < 1e-5
    assert np.abs(reduced.assembly.residual(plant.read()[0])).max() < 1e-6


def test_steered_wheels_turn_about_one_centre():
    model, mass = pin.Model(), pin.Inertia(1.0, np.zeros(3), np.eye(3))
    for name, side in (("left", 0.5), ("right", -0.5)):
        kind = pin.JointModelRZ() if name == "left" else pin.JointModelRevoluteUnaligned(np.array([0.0, 0.0, -1.0]))
        add_body(model, name, kind, mass, at=(1.5, side, 0.0))
    system = rnc.NonholonomicSystem(rnc.Robot(model), [rnc.AckermannSteering("left", "right", "universe")], ["left"])
    reduced = system.reduce()
    plant, q, v = driven(reduced, np.zeros(2), np.zeros(1), np.array([0.5]), 2.0)
    assert max(q, v) < 1e-3
    assert np.abs(reduced.assembly.residual(plant.read()[0])).max() < 1e-5


def test_a_leaning_disk_rolls():
    robot = rnc.Robot.from_urdf("rolling_disk.urdf", base="free")
    system = rnc.NonholonomicSystem(robot, [rnc.RollingWheel("disk", radius=0.3, axis="y")])
    tilted = pin.Quaternion(pin.rpy.rpyToMatrix(0.3, 0.0, 0.0)).coeffs()
    q0 = system.assembled(robot.configuration({"root_joint": [0, 0, 0.3, *tilted]}))
    reduced = system.reduce([rnc.FrameAngularVelocity("disk", axis) for axis in "xyz"])
    plant, q, _ = driven(reduced, q0, np.array([0.2, 4.0, 0.5]), None, 1.0)
    assert plant.stance == "as it is"
    assert q < 5e-3


def test_what_is_on_a_slope_rolls_down():
    """A ball by ``5/7 g sin a``, a hoop by ``1/2 g sin a``; the plane need not contain the origin."""
    angle, place = 0.2, np.array([0.3, -0.2, 0.5])
    down, normal = np.array([np.cos(angle), 0.0, -np.sin(angle)]), np.array([np.sin(angle), 0.0, np.cos(angle)])
    slope = rnc.GroundPlane(normal=tuple(normal), point=tuple(place))
    for file, share, kind in (
        ("rolling_ball.urdf", 5 / 7, rnc.RollingBall("ball", 0.2, slope)),
        ("rolling_hoop.urdf", 1 / 2, rnc.RollingWheel("disk", 0.25, axis="y", ground=slope)),
    ):
        robot = rnc.Robot.from_urdf(file, base="free")
        reduced = rnc.NonholonomicSystem(robot, [kind]).reduce()
        q0 = robot.configuration({"root_joint": [*(place + kind.radius * normal), 0, 0, 0, 1]})
        plant = MuJoCoPlant(reduced, q0=q0)
        plant.reset(q0, np.zeros(6))
        plant.advance(1.0)
        moved = plant.read()[0][:3] - q0[:3]
        np.testing.assert_allclose(moved, share / 2 * 9.81 * np.sin(angle) * down, atol=2e-3)


@pytest.mark.parametrize("radius", [0.0, 0.03])
def test_what_stands_on_points_or_balls_stands_as_high_as_they_say(radius):
    """A table on three casters, points or balls, whose frames are turned in all directions."""
    model = pin.Model()
    root = add_body(model, "root_joint", "FreeFlyer", 3.0, com=(0.02, 0.01, 0.1), moments=0.1)
    corners = {"front": (0.4, 0.0, 0.0), "left": (-0.3, 0.3, np.pi), "right": (-0.3, -0.3, 0.5 * np.pi)}
    for name, (x, y, roll) in corners.items():
        add_frame(model, name, root, pin.SE3(pin.rpy.rpyToMatrix(roll, 0.0, 0.3), np.array([x, y, -0.5])))
    robot = rnc.Robot(model)
    reduced = rnc.NonholonomicSystem(robot, [rnc.Caster(name, radius) for name in corners]).reduce()
    q0 = robot.configuration({"root_joint": [0, 0, 0.5 + radius, 0, 0, 0, 1]})
    assert np.abs(reduced.assembly.residual(q0)).max() < 1e-12
    plant = MuJoCoPlant(reduced, q0=q0)
    plant.reset(q0, np.zeros(6))
    plant.advance(0.5)
    q, v = plant.read()
    assert plant.stance == "as it is"
    np.testing.assert_allclose(q, q0, atol=5e-4)  # they sink in by less, and a ball for a point is 1 mm high
    np.testing.assert_allclose(v, 0, atol=1e-3)


def test_a_differential_drive_grips_and_follows_the_model():
    reduced = differential_drive()
    q0, T = reduced.robot.configuration(), np.array([0.5, 0.6])
    plant, q, v = driven(reduced, q0, np.zeros(2), T, 1.0, integrator="implicitfast")
    assert (plant.stance, plant.casters) == ("free", ("caster[0]", "caster[1]"))
    assert max(q, v) < 1e-2  # angles of wheels, which are ten times what the base goes [m]
    assert np.abs(plant.slip()).max() < 1e-3
    used = plant.friction_used()
    assert plant.wheel_names == ("left_wheel", "right_wheel")
    assert ((used > 0.02) & (used < 0.2)).all()

    finer, coarse = (driven(reduced, q0, np.zeros(2), T, 0.1, step=step)[1] for step in (1e-4, 4e-4))
    assert finer < 0.5 * coarse


def test_wheels_on_ice_slip_at_the_limit_of_their_grip():
    reduced = differential_drive()
    plant = MuJoCoPlant(reduced, MuJoCoSettings(friction=(0.05, 0.0, 0.0)))
    plant.reset(reduced.robot.configuration(), np.zeros(5))
    plant.apply(np.array([3.0, 3.0]))
    plant.advance(1.0)
    np.testing.assert_allclose(plant.friction_used(), 1.0, atol=1e-3)
    assert np.abs(plant.slip()).max() > 1.0
    # No more than mu times the weight drives 22 kg.
    assert plant.read()[1][0] < 0.05 * 9.81 * 1.01


@pytest.mark.parametrize(("friction", "word"), [(1.0, "succeeded"), (0.05, "failed")])
def test_wheels_that_slide_are_in_the_verdict(friction, word):
    """Torques of 1 N m on wheels of 0.1 m need 20 N of grip: more than 5 % of the load on ice."""
    reduced = differential_drive()
    plant = MuJoCoPlant(reduced, MuJoCoSettings(friction=(friction, 0.0, 0.0)))
    run = rnc.simulate(reduced, Inputs(lambda t: np.ones(2)), reduced.robot.configuration(), 0.5, 0.01, plant=plant)
    slips = {each.where for each in run.verdict.findings if each.kind == "slip" and each.severity == "fails"}
    assert (slips, run.verdict.word) == ({"left_wheel", "right_wheel"} if word == "failed" else set(), word)


@pytest.mark.parametrize(("share", "slips"), [(0.995, False), (1.3, True)])
def test_a_robot_that_is_held_at_the_limit_of_friction_does_not_slip_before_it_slides(share, slips):
    """A push across two wheels, scaled to a share of what their friction holds."""

    def rests(push):
        reduced = differential_drive(rnc.forces.Wrench("base", (0.0, push, 0.0)))
        plant = MuJoCoPlant(reduced, MuJoCoSettings(friction=(0.5, 0.0, 0.0)))
        idle = Inputs(lambda t: np.zeros(2))
        return rnc.simulate(reduced, idle, reduced.robot.configuration(), 0.5, 0.01, plant=plant)

    run = rests(share * 10.0 / rests(10.0).friction_used[-1].max())
    assert run.friction_used[-1].max() > 0.99
    assert any(each.kind == "slip" for each in run.verdict.findings) == slips
    assert (run.slip_speed.max() > 0.05) == slips
    assert slips or np.abs(run.q[-1, :2]).max() < 1e-3


def test_slip_that_ends_before_the_next_sample_is_in_the_verdict():
    """0.2 m/s across the wheels end in 0.04 s on ice with 5 m/s^2, and a sample is 0.1 s."""
    reduced = differential_drive()
    plant = MuJoCoPlant(reduced, MuJoCoSettings(friction=(0.5, 0.0, 0.0)))

    class Thrown(MuJoCoPlant):
        def reset(self, q, v):
            super().reset(q, np.array([0.0, 0.2, 0.0, 0.0, 0.0]))

    plant.__class__ = Thrown
    run = rnc.simulate(reduced, Inputs(lambda t: np.zeros(2)), reduced.robot.configuration(), 0.4, 0.1, plant=plant)
    assert run.friction_used[1:].max() < 0.9
    np.testing.assert_allclose(run.slip_speed[1], 0.2, atol=0.02)
    assert {each.where for each in run.verdict.findings if each.kind == "slip"} >= {"left_wheel", "right_wheel"}


def test_forces_on_a_car_become_torques_of_its_drawn_wheels():
    robot = rnc.Robot.from_urdf("car.urdf", base="planar")
    edges = [rnc.NoSideSlip("front_axle"), rnc.NoSideSlip("rear_axle")]
    system = rnc.NonholonomicSystem(robot, edges, [rnc.FrameForce("rear_axle", "x"), "front_steering"])
    reduced = system.reduce([rnc.FrameSpeed("rear_axle"), rnc.JointPosition("front_steering")])
    q0, v2, T = robot.configuration(), np.array([0.5, 0.0]), np.array([10.0, 0.05])
    plant, q, _ = driven(reduced, q0, v2, T, 1.0)
    assert (plant.stance, plant.casters, plant.wheel_driven) == ("free", (), ("force(rear_axle.x)",))
    assert plant.wheel_names == ("front_axle[0]", "front_axle[1]", "rear_axle[0]", "rear_axle[1]")
    assert q < 1e-3

    plant.reset(q0, np.zeros(robot.nv))
    plant.apply(np.array([1e4, 0.0]))  # more than its tyres can hold
    plant.advance(0.2)
    np.testing.assert_allclose(plant.friction_used()[2:], 1.0, atol=1e-2)
    assert 0.5 * 9.81 < plant.read()[1][0] / 0.2 < 9.81
    plant.apply(np.zeros(2))
    plant.advance(0.1)
    assert plant.friction_used().max() < 0.1


def test_what_would_tip_is_held_level():
    reduced = arm_on_base().reduce()
    q0 = reduced.robot.configuration({"joint_1": 0.5, "joint_2": -1.2})
    plant, q, _ = driven(reduced, q0, np.array([0.3, 0.2, 0.0, 0.0]), np.array([5.0, 3.0, 0.5, 0.2]), 1.0)
    assert (plant.stance, plant.wheel_driven) == ("level", ("force(base.x)", "torque(base.z)"))
    assert q < 1e-3


def test_one_wheel_cannot_turn_itself_and_is_turned():
    robot = rnc.Robot.from_urdf("unicycle.urdf", base="planar")
    turn = rnc.FrameTorque("fork", "z")
    reduced = rnc.NonholonomicSystem(robot, [rnc.RollingWheel("wheel", 0.25)], ["axle", turn]).reduce()
    plant, q, _ = driven(reduced, robot.configuration(), np.zeros(2), np.array([0.5, 0.02]), 1.0)
    assert plant.wheel_driven == ()
    assert q < 1e-3


def test_a_blade_is_a_knife_edge():
    reduced = sleigh()
    plant, q, v = driven(reduced, reduced.robot.configuration(), np.array([0.0, 1.0]), None, 2.0)
    assert plant.wheel_names == ("sleigh",)
    assert max(q, v) < 3e-3


def test_wheels_that_skid_hold_on_forward_alone():
    robot = rnc.Robot.from_urdf("differential_drive.urdf", base="planar")
    wheels = [rnc.RollingWheel(f"{side}_wheel", 0.1, lateral=False) for side in ("left", "right")]
    system = rnc.NonholonomicSystem(robot, wheels, ["left_wheel_joint", "right_wheel_joint"])
    reduced = system.reduce([rnc.FrameSpeed("base"), rnc.FrameSpeed("base", "y"), rnc.FrameYaw("base")])
    _, q, v = driven(reduced, robot.configuration(), np.array([0.0, 0.3, 0.0]), np.array([0.1, 0.12]), 1.0)
    assert max(q, v) < 1e-2


def test_limits_and_damping_on_request():
    robot = rnc.Robot.from_urdf("mobile_manipulator.urdf")
    reduced = rnc.NonholonomicSystem(robot, [], robot.joint_names).reduce()
    q0 = robot.configuration({"joint_1": 62.8, "joint_2": 1.0})
    stopped = MuJoCoPlant(reduced, MuJoCoSettings(joint_limits=True, joint_damping=True, effort_limits=True), q0)
    stopped.reset(q0, np.zeros(2))
    stopped.apply(np.array([1e6, 0.0]))
    assert stopped.applied.tolist() == [reduced.actuation.limits[0], 0.0]  # as the loop is told
    stopped.advance(0.5)
    assert stopped.read()[0][0] < 62.84
    assert stopped.model.dof_damping.tolist() == robot.model.damping.tolist()


def test_a_gimbal_without_mass_moves_as_the_reduced_plant():
    model = pin.Model()
    ring = model.addJoint(0, pin.JointModelRX(), pin.SE3.Identity(), "ring")
    add_body(model, "body", "RY", 2.0, ring, com=(0.1, 0.05, -0.4), moments=(0.3, 0.2, 0.1))
    reduced, ends = rnc.NonholonomicSystem(rnc.Robot(model), [], ["ring"]).reduce(), []
    for plant in (rnc.ReducedPlant(reduced, substeps=2), MuJoCoPlant(reduced)):
        plant.reset(np.array([0.3, 0.5]), np.array([1.0, -0.4]))
        plant.apply(np.array([0.7]))
        plant.advance(0.05)
        ends.append(np.concatenate(plant.read()))
    np.testing.assert_allclose(ends[1], ends[0], atol=1e-6)


def test_what_is_not_finite_is_refused_and_what_becomes_so_ends_the_run(tmp_path, monkeypatch, robot):
    monkeypatch.chdir(tmp_path)
    reduced = rnc.NonholonomicSystem(robot, [], robot.joint_names).reduce()
    plant = MuJoCoPlant(reduced)
    plant.reset(robot.configuration(), np.zeros(4))
    with pytest.raises(rnc.InputError, match="T holds values that are not finite"):
        plant.apply(np.array([np.nan, 0.0, 0.0, 0.0]))
    with pytest.raises(rnc.InputError, match=r"T has shape \(3,\)"):
        plant.apply(np.zeros(3))
    with pytest.raises(rnc.InputError, match=r"v has shape \(3,\)"):
        plant.reset(robot.configuration(), np.zeros(3))
    plant.apply(np.full(4, 1e200))
    with pytest.raises(rnc.DivergenceError, match="is not finite"):
        plant.advance(1.0)
    assert not list(tmp_path.iterdir())  # MuJoCo writes logs where it stands


def test_without_mujoco_one_line_says_how_to_get_it(monkeypatch):
    for name in [each for each in sys.modules if each.startswith("rnc_pin.lab.mujoco")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "mujoco", None)
    package = importlib.import_module("rnc_pin.lab.mujoco")
    assert package.MuJoCoSettings().step == 0.0005
    with pytest.raises(rnc.ConfigurationError, match=re.escape(missing_extra("mujoco"))):
        _ = package.MuJoCoPlant


def test_drawn_wheels_are_found_without_hubs_and_shafts():
    robot = rnc.Robot.from_urdf("fire_truck.urdf", base="planar")
    edges = [rnc.NoSideSlip(frame) for frame in ("front_axle", "tractor_axle", "rear_axle")]
    system = rnc.NonholonomicSystem(robot, edges)
    found = contact_bodies(robot, [place.block for place in system.rows.places])
    assert [each.radius for each in found] == [0.13] * 6
    assert [round(each.center[1], 6) for each in found] == [-0.24, 0.24, -0.26, 0.26, -0.24, 0.24]


def in_mujoco(constraints, file="differential_drive.urdf", base="planar", gravity=None):
    robot = rnc.Robot.from_urdf(file, base=base, gravity=gravity)
    return MuJoCoPlant(rnc.NonholonomicSystem(robot, constraints, robot.joint_names[1:2]).reduce())


def screw():
    model = pin.Model()
    add_body(model, "spindle", pin.JointModelHX(0.1), 1.0)
    return MuJoCoPlant(rnc.NonholonomicSystem(rnc.Robot(model), [], ["spindle"]).reduce())


def wheel(side="left", radius=0.1, **options):
    return rnc.RollingWheel(f"{side}_wheel", radius, **options)


def on_ground(ground):
    return in_mujoco([rnc.RollingBall("ball", 0.2, ground=ground)], "rolling_ball.urdf", "free")


ROW, SLOPE = np.array([[0.0, 1.0, 1.0, 1.0]]), rnc.GroundPlane(normal=(0.1, 0.0, 1.0))
LEVEL = rnc.Pfaffian(lambda q: ROW, lambda q, v: 0 * ROW, names=["level"])

test_what_does_not_fit_is_refused_in_one_line = refused([
    (lambda: in_mujoco([LEVEL], "space_robot.urdf", "fixed"), r"MuJoCo: level \(Pfaffian\) has no equivalent"),
    (screw, r"no joint like 'spindle' \(JointModelHX\)"),
    (lambda: in_mujoco([wheel()], gravity=(0, 0, 0)), r"of wheel 'left_wheel' needs weight, and gravity is \[0"),
    (lambda: in_mujoco([wheel(roller=0.7)]), "'left_wheel' has oblique rollers"),
    (lambda: in_mujoco([wheel(), wheel("right", 0.08)]), r"'right_wheel' is 0\.02 m above the ground"),
    (lambda: in_mujoco([wheel(ground=SLOPE), wheel("right")], base="free"), "roll on different planes"),
    (lambda: in_mujoco([rnc.NoSideSlip("left_wheel", "x")], base="fixed"), "nothing presses wheel 'left_wheel'"),
    (lambda: on_ground(rnc.SphericalGround(1.0, (0.0, 0.0, 1.0))), r"rolling_x\(ball\) rolls on a SphericalGround"),
    (lambda: on_ground(rnc.GroundPlane(spin=1.0)), "rolls on a GroundPlane that .* plant 'reduced'"),
    (lambda: in_mujoco([rnc.RollingBody("ball", rnc.Sphere(0.2))], "rolling_ball.urdf", "free"),
        r"rolling_x\(ball\) \(RollingBody\) has no equivalent"),
    (lambda: MuJoCoSettings(integrator="RK5"), "did you mean 'RK4'"),
    (lambda: MuJoCoSettings(step=0.0), "step of MuJoCoSettings has to be above 0, found 0.0"),
    (lambda: MuJoCoSettings(settling=float("nan")), "settling of MuJoCoSettings has to be at least 0, found nan"),
    (lambda: MuJoCoSettings(friction=(1.0, -0.1, 0.0)), "three numbers"),
    (lambda: MuJoCoSettings(friction="ice"), "three numbers"),
    (lambda: MuJoCoSettings(stance="standing"), "stance 'standing' is not known"),
], error=rnc.ConfigurationError)  # fmt: skip
