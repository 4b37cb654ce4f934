"""Secondary objectives: exact rates, finite at the limits, and worth having while the vertical outputs are tracked."""

from functools import cache
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest
import yaml

import rnc_pin as rnc
from controlled_tasks import LIMITS, limited_sliders, manipulator
from rnc_pin.applications.scenario.files import find_scenario, read_yaml, with_options
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.control import Combined, ComputedTorque, JointLimits, Posture, RedundancyController, SingularityDistance
from rnc_pin.model.reduced_kinematics import Measurement
from rnc_pin.planning import Hold, MinimumJerk
from systems import mobile_manipulator, random_states, space_robot
from tolerances import FINITE_DIFFERENCE, ROUNDING


@cache
def tiago():
    """Eight joints, the torso's prismatic one among them, are redundant for the position of the wrist."""
    robot = rnc.Robot.from_example("tiago_no_hand", base="planar", lock={"head_1_joint": 0.0, "head_2_joint": 0.0})
    wheels = ["wheel_left", "wheel_right"]
    arm = [name for name in robot.joint_names if name != "root_joint" and "wheel" not in name]
    rolling = [rnc.RollingWheel(f"{wheel}_link", 0.0985) for wheel in wheels]
    system = rnc.NonholonomicSystem(robot, rolling, [*(f"{wheel}_joint" for wheel in wheels), *arm])
    outputs = [rnc.FrameSpeed("base_link"), rnc.FrameYaw("base_link"), *(rnc.JointPosition(name) for name in arm)]
    reduced = system.reduce(outputs, [rnc.FramePosition("arm_7_link")])
    return reduced, rnc.Task.of(reduced, ["base_link_speed_x", "base_link_yaw"], arm)


def every(reduced, task):
    return {
        "limits": JointLimits(reduced, task, k=0.4, margin=0.4),
        "singularity": SingularityDistance(reduced, task, 0.3),
    }


SYSTEMS = {"manipulator": manipulator, "tiago": tiago}
CONDITION = {"manipulator": 20.0, "tiago": 50.0}


def slopes(reduced, function, q, directions, h=1e-5):
    """Central differences along tangent vectors."""
    model = reduced.robot.model
    ends = ([function(pin.integrate(model, q, sign * h * d)) for d in directions] for sign in (1.0, -1.0))
    return np.subtract(*ends) / (2 * h)


@pytest.mark.parametrize("name", ["limits", "singularity"])
@pytest.mark.parametrize("system", SYSTEMS)
def test_rate_is_that_of_the_objective_along_the_motion(system, name):
    reduced, task = SYSTEMS[system]()
    objective, h, moved = every(reduced, task)[name], 1e-4, 0.0
    for q, v2 in random_states(reduced, 4, seed=6, condition=CONDITION[system]):
        measured = reduced.at(q, v2).measure()
        near = [pin.integrate(reduced.robot.model, q, k * h * measured.v) for k in (-2, -1, 1, 2)]
        z = [objective(0.0, reduced.at(p, v2).measure())[0] for p in near]
        difference = (z[0] - 8 * z[1] + 8 * z[2] - z[3]) / (12 * h)
        exact = objective(0.0, measured)[1]
        np.testing.assert_allclose(exact, difference, atol=FINITE_DIFFERENCE * (1 + np.abs(exact).max()))
        moved = max(moved, np.abs(exact).max())
    assert moved > 0.1


@pytest.mark.parametrize("system", SYSTEMS)
def test_distance_from_singularity_climbs_the_determinants(system):
    """Independent: differences of log det along the columns of R, with the stack from the rows themselves."""
    reduced, task = SYSTEMS[system]()
    objective = SingularityDistance(reduced, task)

    def height(q):
        A4 = reduced.terms(q, np.zeros(reduced.r)).A_star[task.vertical][:, task.redundant]
        return np.linalg.slogdet(reduced.at(q).E)[1] + 0.5 * np.linalg.slogdet(A4 @ A4.T)[1]

    for q, _ in random_states(reduced, 3, seed=7, condition=CONDITION[system]):
        R = reduced.at(q).R
        uphill = slopes(reduced, height, q, R[:, task.redundant].T)
        np.testing.assert_allclose(objective.gradient(q), uphill, atol=FINITE_DIFFERENCE * (1 + np.abs(uphill).max()))


def test_batches_are_one_call():
    reduced, task = manipulator()
    q, v2 = (np.stack(each) for each in zip(*random_states(reduced, 4, seed=9, condition=20.0), strict=True))
    parts = every(reduced, task)
    objective = Combined([*parts.values(), Posture(task, Hold(np.zeros(2)))])
    still = np.zeros((4, reduced.r))
    together = objective(0.0, reduced.at(q, v2).measure(still))
    for i in range(4):
        one = reduced.at(q[i], v2[i]).measure(still[i])
        for whole, alone in zip(together, objective(0.0, one), strict=True):
            np.testing.assert_allclose(whole[i], alone, atol=1e-6 * (1 + np.abs(alone).max()))
        added = sum(part(0.0, one)[0] for part in objective.parts)
        np.testing.assert_allclose(together[0][i], added, atol=ROUNDING * (1 + np.abs(added).max()))


def reach(objective):
    """The tip goes 0.8 m ahead while the platform turns a little."""
    reduced, task = manipulator()
    q0 = reduced.robot.configuration({"joint_1": 0.5, "joint_2": -1.2})
    x1, x2 = reduced.at(q0).outputs()
    tip, heading = MinimumJerk(x2[:2], x2[:2] + np.array([0.8, 0.1]), 4.0), MinimumJerk(x1, x1 - 0.1, 4.0)
    return reduced, RedundancyController(task, tip, heading, 2.0, 2.0, secondary=objective), q0


def test_joint_limits_keep_a_joint_inside_while_the_rest_is_tracked():
    """The elbow, which is no output, would run into its limit; with the objective the run completes."""
    reduced, task = manipulator()
    model = reduced.robot.model
    elbow = model.joints[reduced.robot.joint_id("joint_2")].idx_q
    runs = {}
    for objective in (None, JointLimits(reduced, task, k=0.3, margin=0.2)):
        _, kinematic, q0 = reach(objective)
        torque = ComputedTorque(reduced, kinematic, 20.0)
        try:
            runs[objective is not None] = rnc.simulate(
                reduced, torque, q0, 6.0, 0.004, options=rnc.SimulationOptions(stop=rnc.Stop(position_limits=True))
            )
        except rnc.LimitError as error:
            runs[objective is not None] = error.trajectory
    assert runs[False].outcome == "limit"
    assert runs[True].outcome == "completed"
    assert runs[True].q[:, elbow].max() < LIMITS["joint_2"][1] - 0.01
    errors = rnc.summarize(runs[True])["max_error"]
    assert set(errors) == {"tip_x", "tip_y", "base_yaw"}
    assert max(errors.values()) < 2e-3


def test_nonsense_is_refused():
    reduced, task = manipulator()
    for call, words in (
        (lambda: JointLimits(reduced, task, joints=["root_joint"]), "joint 'root_joint' has no position limits"),
        (lambda: JointLimits(reduced, task, joints=["joint_3"]), "no joint 'joint_3'.*; did you mean 'joint_"),
        (lambda: JointLimits(reduced, task, k=[1.0, 2.0, 3.0]), "has to be a number or 2"),
        (lambda: SingularityDistance(reduced, task, k=-1.0), "not negative"),
        (lambda: Combined([]), "at least one secondary"),
        (lambda: Posture(task, Hold(np.zeros(3))), "the redundant reference has 3 values for 2"),
    ):
        with pytest.raises(rnc.RncError, match=words):
            call()
    square = space_robot()
    task = rnc.Task.of(square, ["tip_x", "tip_y"], ["joint_1"])
    objective = Posture(task, Hold(np.zeros(1)))
    with pytest.raises(rnc.ConfigurationError, match=r"no freedom left: .* found 1 \(joint_1\) and 1 \(platform\)"):
        RedundancyController(task, Hold(np.zeros(2)), Hold(np.zeros(1)), secondary=objective)


WIDE = {
    "task": {"primary": ["tip_x", "tip_y"], "redundant": ["base_speed_x", "base_yaw"]},
    "reference.primary": {"minimum_jerk": {"by": [0.4, 0.1], "duration": 2}},
    "comparisons": {},
    "simulation.duration": 1.0,
}


def scenario_of(changes, folder):
    path = folder / "mine.yaml"
    path.write_text(yaml.safe_dump(with_options(read_yaml(find_scenario("mobile-manipulator")), {**WIDE, **changes})))
    return Scenario.load(str(path)).experiment


def test_a_scenario_adds_its_objectives_up(tmp_path):
    wanted = {"posture": {"k": [0.0, 3.0]}, "joint_limits": {"joints": ["joint_2"]}, "singularity": {"k": 0.05}}
    experiment = scenario_of(
        {"controller.secondary": wanted, "reference.redundant": {"hold": {"value": [0, 0.3]}}}, tmp_path
    )
    reduced = experiment.reduced
    task = rnc.Task.of(reduced, **WIDE["task"])
    parts = [
        Posture(task, Hold(np.array([0.0, 0.3])), np.array([0.0, 3.0])),
        JointLimits(reduced, task, joints=["joint_2"]),
        SingularityDistance(reduced, task, 0.05),
    ]
    measured = reduced.at(experiment.q0, np.full(reduced.r, 0.1)).measure()
    built = experiment.controller.target.secondary
    for got, expected in zip(built(0.5, measured), Combined(parts)(0.5, measured), strict=True):
        np.testing.assert_allclose(got, expected, atol=ROUNDING)


@pytest.mark.parametrize(("changes", "words"), [
    ({"task": {"primary": ["tip_x", "tip_y", "base_yaw"], "redundant": ["base_speed_x"]}, "reference": {}},
        r"controller.secondary: .* no freedom left: .* found 1 \(base_speed_x\) and 1 \(distance_base_tip\)"),
    ({"controller.secondary": {}}, "controller.secondary: expected at least one of posture"),
    ({"controller.secondary": {"postur": {}}}, "controller.secondary: 'postur' is not known; did you mean 'posture'"),
    ({"controller.secondary": {"joint_limits": {"joints": ["joint_3"]}}}, "controller.secondary: no joint 'joint_3'"),
    ({"controller.secondary": {"joint_limits": {"margin": 0.8}}}, "controller.secondary.joint_limits.margin"),
    ({"controller.secondary": {"singularity": {"k": [1, 2, 3]}}}, "controller.secondary: k .* number or 2"),
    ({"controller.type": "reducing_outputs"}, "controller.secondary: does not belong to type"),
])  # fmt: skip
def test_a_scenario_that_asks_for_too_much_is_refused(changes, words, tmp_path):
    with pytest.raises(rnc.ConfigurationError, match=words):
        scenario_of({"controller.secondary": {"posture": {}}, **changes}, tmp_path)


def test_a_joint_has_ends_where_both_are_numbers_below_ten_billion_and_in_order():
    task, far = SimpleNamespace(redundant=np.arange(1)), 1e10
    near, beyond = np.nextafter(far, 0.0), np.finfo(float).max
    for low, high in ((-near, near), (-near, 0.0), (0.0, near), (-3.0, -2.0), (2.0, 3.0)):
        assert JointLimits(limited_sliders((low, high)), task).describe()["zone"] == [0.1 * (high - low)]
    for low, high in (
        (-far, 2.0), (-np.inf, 2.0), (-beyond, 2.0), (-2.0, far), (-2.0, np.inf), (-2.0, beyond), (2.0, 2.0),
        (3.0, 2.0),
    ):  # fmt: skip
        with pytest.raises(rnc.ConfigurationError, match=r"no joint of robot '.*' has position limits"):
            JointLimits(limited_sliders((low, high)), task)
        both = JointLimits(limited_sliders((low, high), (1.0, 3.0)), task)
        assert both.describe()["zone"] == pytest.approx([0.2])


class Cubes(SingularityDistance):
    """Its gradient is written down."""

    def gradient(self, q):
        return q**3


def test_the_distance_from_singularity_is_differentiated_over_at_most_a_fifty_thousandth():
    """At zero the difference of ``q^3`` along v is ``h^2 v^3``, which tells h; one state and batches of two axes."""
    reduced, gains = limited_sliders(*[(-1.0, 1.0)] * 3), np.array([0.5, 2.0, 3.0])
    distance = Cubes(reduced, SimpleNamespace(redundant=np.arange(3)), gains)
    velocities = np.random.default_rng(2).uniform(-4, 4, (2, 5, 3))
    for v in (velocities, velocities[0], velocities[1, 3]):
        z, z_dot = distance(0.0, Measurement(q=np.zeros(v.shape), v=v))
        h = 2e-5 / (1 + np.abs(v).max())
        assert not z.any()
        np.testing.assert_allclose(z_dot, gains * h**2 * v**3, rtol=1e-12)
    q = velocities / 8
    z, z_dot = distance(0.0, Measurement(q=q, v=velocities))
    np.testing.assert_array_equal(z, gains * q**3)
    np.testing.assert_allclose(z_dot, gains * 3 * q**2 * velocities, atol=1e-8)


def test_secondary_objectives_are_worth_their_gains_and_describe_themselves():
    reduced, task = manipulator()
    zero = Posture(task, Hold([0.2, -0.1]), np.array([0.0, 3.0]))
    (q, v2), *_ = random_states(reduced, 1, seed=6, condition=20.0)
    z, z_dot = zero(0.0, reduced.at(q, v2).measure())  # the speed has no integral, and no gain
    shoulder = reduced.at(q).outputs()[1][3]
    np.testing.assert_allclose(z, [0.0, 3.0 * np.angle(np.exp(1j * (-0.1 - shoulder)))], atol=ROUNDING)
    np.testing.assert_allclose(z_dot, [0.0, -3.0 * v2[3]], atol=ROUNDING)
    gains = np.array([0.5, 2.0])
    limits, distance = JointLimits(reduced, task, gains, 0.5), SingularityDistance(reduced, task, gains)
    measured = reduced.at(q, v2).measure()
    np.testing.assert_allclose(distance(0.0, measured)[0], gains * distance.gradient(q), rtol=1e-12)
    for value, unit in zip(limits(0.0, measured), JointLimits(reduced, task, 1.0, 0.5)(0.0, measured), strict=True):
        np.testing.assert_allclose(value, gains * unit, rtol=1e-12)
    assert zero.describe() == {"type": "Posture", "k": [0.0, 3.0]}
    assert limits.describe() == {"type": "JointLimits", "k": [0.5, 2.0], "zone": [1.5, pytest.approx(0.575)]}
    assert distance.describe() == {"type": "SingularityDistance", "k": [0.5, 2.0]}
    parts = Combined([zero, distance]).describe()
    assert parts == {"type": "Combined", "parts": [zero.describe(), distance.describe()]}
    for margin in (0.0, 0.5001, -0.1):
        with pytest.raises(rnc.ConfigurationError, match=f"share of the range, 0 to 0.5, found {margin}"):
            JointLimits(reduced, task, margin=margin)
    assert JointLimits(reduced, task, k=0.0).describe()["k"] == 0.0
    assert len(LIMITS) == len(JointLimits(reduced, task).describe()["zone"])


def test_joints_of_several_freedoms_leave_the_ends_of_each():
    """Potential ``s^3 / 3`` in zones of a quarter of the range; what has no ends, or whose ends meet, is left alone."""
    model = pin.Model()
    ends = {"table": ([-1.0, -np.inf, -0.5], [1.0, np.inf, 2.5]), "slide": ([1.0], [3.0]), "stuck": ([2.0], [2.0])}
    for name, (low, high) in ends.items():
        kind = pin.JointModelTranslation() if len(low) == 3 else pin.JointModelPX()
        bounds = [np.full(len(low), 1e3)] * 2 + [np.array(low), np.array(high)]
        joint = model.addJoint(model.njoints - 1, kind, pin.SE3.Identity(), name, *bounds)
        model.appendBodyToJoint(joint, pin.Inertia(1.0, np.zeros(3), np.eye(3)), pin.SE3.Identity())
    generator = np.random.default_rng(9)
    R, R_dot, gains = *generator.normal(size=(2, 5, 2)), np.array([0.5, 2.0])
    reduced = SimpleNamespace(robot=rnc.Robot(model), at=lambda q, v, t: SimpleNamespace(R=R, R_dot=R_dot))
    objective = JointLimits(reduced, SimpleNamespace(redundant=np.arange(2)), gains, 0.25)
    assert objective.describe()["zone"] == [0.5, 0.75, 0.5]
    q, v = np.array([0.9, 50.0, -0.2, 1.2, 2.0]), generator.normal(size=5)
    depths = np.array([0.4 / 0.5, 0.0, -0.45 / 0.75, -0.3 / 0.5, 0.0])
    zones = np.array([0.5, 1.0, 0.75, 0.5, 1.0])
    gradient, hessian = depths * np.abs(depths) / zones, 2 * np.abs(depths) / zones**2
    z, z_dot = objective(0.0, Measurement(q=q, v=v))
    np.testing.assert_allclose(z, -gains * (R.T @ gradient), rtol=1e-12)
    np.testing.assert_allclose(z_dot, -gains * (R_dot.T @ gradient + R.T @ (hessian * v)), rtol=1e-12)
    for inside in ([0.5, 0.0, 0.25, 1.5, 2.0], [-0.5, 0.0, 1.75, 2.5, 2.0]):
        assert not objective(0.0, Measurement(q=np.array(inside), v=v))[0].any()
    with pytest.raises(rnc.ConfigurationError, match="joint 'stuck' has no position limits"):
        JointLimits(reduced, SimpleNamespace(redundant=np.arange(2)), gains, 0.25, ["stuck"])


def test_a_distance_to_singular_configurations_where_one_is():
    """The platform's coordinate x across its heading: driving does not move it."""
    robot = mobile_manipulator().robot
    system = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("axle")])
    reduced = system.reduce(
        [rnc.JointPosition("joint_1"), rnc.JointPosition("joint_2"), rnc.FrameSpeed("base"), rnc.FrameYaw("base")],
        [rnc.FramePosition("base", "y")],
    )
    task = rnc.Task.of(reduced, ["joint_1", "joint_2", "base_yaw"], ["base_speed_x"], ["base_y"])
    q = robot.configuration({"root_joint": [0.3, 0.1, 0.0]})
    for given in (q, np.stack([q, 2.0 * q - robot.configuration()])[:, None]):  # of a batch the first is told
        with pytest.raises(rnc.SingularityError, match=r"cannot move the vertical ones \(A4 is singular\)") as told:
            SingularityDistance(reduced, task).gradient(given)
        assert told.value.rows == ("base_y", "base_speed_x")
        assert told.value.condition == np.inf
        np.testing.assert_array_equal(told.value.q, q)
