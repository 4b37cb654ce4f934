"""TIAGo and a Panda on a satellite: figures of acceptance, measured apart from the reduction, and what made them."""

import json

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from bodies import add_body
from tolerances import ROUNDING

RADIUS = 0.0985
TRANSIENT = 1.0  # [s]
BRIEF = ["simulation.duration=1.6", "simulation.dt=0.004"]
HURRIED = [
    "accept=[goal]",
    "simulation.duration=2.5", BRIEF[1], "reference.primary.minimum_jerk.duration=1.5", "controller.platform.begin=1.5"
]  # fmt: skip


def run_of(call, name, folder, *options):
    """A built-in scenario run from the command line, without its comparisons: summary and trajectory."""
    arguments = ["run", name, "--out", str(folder), "--set", "comparisons={}", "--set", "view.trail=[]"]
    for option in options:
        arguments += ["--set", option]
    status, _, complaint = call(*arguments)
    assert status == 0, complaint
    return json.loads((folder / "summary.json").read_text()), rnc.Trajectory.load(folder / "trajectory.npz")


def hand_error(trajectory, kind, columns):
    late = trajectory.time > TRANSIENT
    return np.abs(getattr(trajectory, kind) - getattr(trajectory, f"{kind}_desired"))[late][:, columns].max()


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("runs")


@pytest.mark.parametrize(("name", "options", "kind"), [("tiago", BRIEF, "x1"), ("tiago-two-phase", HURRIED, "x2")])
def test_tiago_keeps_its_hand_on_the_path_and_its_wheels_on_the_ground(call, name, options, kind, folder, no_pictures):
    summary, run = run_of(call, name, folder / name, *options)
    assert summary["outcome"] == "completed"
    assert hand_error(run, kind, slice(3)) < 0.01
    robot = rnc.Robot.from_example("tiago_no_hand", base="planar", lock=run.meta["config"]["robot"]["lock"])
    model, data = robot.model, robot.model.createData()
    moved = np.abs(run.v[:, :3]).max()
    assert moved > 0.05
    for q, v in zip(run.q[::20], run.v[::20], strict=True):
        pin.forwardKinematics(model, data, q, v)
        for wheel in ("wheel_left_link", "wheel_right_link"):
            center = pin.getFrameVelocity(model, data, robot.frame_id(wheel), pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
            assert np.abs(center.linear + np.cross(center.angular, [0.0, 0.0, -RADIUS])).max() < 1e-9
    # What two wheels on one axle roll off differs by the turn: an integral of the slip over the whole run.
    left, right = (model.joints[robot.joint_id(f"wheel_{side}_joint")] for side in ("left", "right"))
    rolled = [np.unwrap(np.arctan2(run.q[:, j.idx_q + 1], run.q[:, j.idx_q])) if j.nq == 2 else run.q[:, j.idx_q]
              for j in (left, right)]  # fmt: skip
    yaw = np.unwrap(np.arctan2(run.q[:, 3], run.q[:, 2]))
    pin.framesForwardKinematics(model, data, robot.configuration())
    wheels = (data.oMf[robot.frame_id(f"wheel_{side}_link")].translation for side in ("left", "right"))
    apart = np.subtract(*wheels)
    difference = RADIUS * (rolled[1] - rolled[0])
    sign = np.sign(difference @ yaw)
    np.testing.assert_allclose(sign * (difference - difference[0]), apart[1] * (yaw - yaw[0]), atol=1e-8)


def test_a_mounted_robot_moves_as_it_does_alone():
    satellite = rnc.Robot.from_urdf("satellite.urdf", base="free", gravity=(0, 0, 0))
    arm = rnc.Robot.from_example("panda")
    place = pin.SE3(pin.rpy.rpyToMatrix(0.3, -0.2, 0.5), np.array([0.1, 0.2, 0.3]))
    both = satellite.attach(arm, "mount", place)
    assert both.nv == satellite.nv + arm.nv
    np.testing.assert_array_equal(both.model.gravity.linear, np.zeros(3))
    with_base = rnc.Robot.from_example("panda", base="free")  # a fixed base's own link has its mass, too
    total, *parts = (pin.computeTotalMass(each.model) for each in (both, satellite, with_base))
    assert total == pytest.approx(sum(parts))
    generator = np.random.default_rng(0)
    base, q = satellite.random_configuration(generator), arm.random_configuration(generator)
    data, alone = both.model.createData(), arm.model.createData()
    pin.framesForwardKinematics(both.model, data, np.r_[base, q])
    pin.framesForwardKinematics(arm.model, alone, q)
    expected = data.oMf[both.frame_id("mount")] * place * alone.oMf[arm.frame_id("panda_hand")]
    assert expected.isApprox(data.oMf[both.frame_id("panda_hand")], ROUNDING)
    shapes = len(satellite.visual_model.geometryObjects) + len(arm.visual_model.geometryObjects)
    assert len(both.visual_model.geometryObjects) == shapes


def test_what_cannot_be_mounted_is_refused():
    satellite = rnc.Robot.from_urdf("satellite.urdf", base="free")
    with pytest.raises(rnc.ModelError, match="both have a frame 'satellite'"):
        satellite.attach(rnc.Robot(*_renamed()), "mount")
    with pytest.raises(rnc.ModelError, match="has a moving base: load it with base='fixed'"):
        satellite.attach(rnc.Robot.from_urdf("mobile_manipulator.urdf", base="planar"), "mount")
    with pytest.raises(rnc.ModelError, match=r"no frame 'mout'.*'mount'"):
        satellite.attach(rnc.Robot.from_urdf("space_robot.urdf"), "mout")


def _renamed():
    model = pin.Model()
    model.name = "other"
    add_body(model, "turn", "RZ", 1.0, frame="satellite")
    return (model,)
