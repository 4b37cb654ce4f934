"""Regressors, estimators, gains and laws beside closed forms: names, units, thresholds, many states and one."""

from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from controlled_tasks import LIMITS, TASK, chain_rate, manipulator, wide
from rnc_pin.control import (
    ChainedStabilizer,
    Combined,
    Estimator,
    JointLimits,
    MomentumRegressor,
    PositionGains,
    Posture,
    RedundancyController,
    SingularityDistance,
    SlitheringReference,
    UnknownMass,
    UnknownRadius,
    UnknownTrack,
    VelocityGains,
    WheelRegressor,
)
from rnc_pin.control.estimator import believed
from rnc_pin.control.slithering import DrivenPath
from rnc_pin.model.measurement import Measurement
from rnc_pin.planning import Hold, MinimumJerk
from systems import (
    drifting_manipulator,
    fire_truck,
    free_flying_panda,
    random_states,
    space_robot,
    spinning_space_robot,
)
from tolerances import FINITE_DIFFERENCE, ROUNDING

# ---------------------------------------------------------------------- regressors


@pytest.mark.parametrize(
    ("make", "base", "joints", "rates"),
    [
        (space_robot, "platform", ("joint_1", "joint_3"), ["rad/s"]),
        (drifting_manipulator, "root_joint", ("joint_1", "joint_2"), ["m/s", "m/s", "rad/s"]),
        (free_flying_panda, "root_joint", ("panda_joint2", "panda_joint7"), ["m/s"] * 3 + ["rad/s"] * 3),
    ],
    ids=["turning", "planar", "free"],
)
def test_unknown_masses_say_what_they_predict_in_units_of_their_own(make, base, joints, rates):
    """``y = Y p`` where the momentum is zero, with one mass in kg and one in units of 0.25 kg."""
    robot = make().robot
    regressor = MomentumRegressor(robot, base, [UnknownMass(joints[0]), UnknownMass(joints[1], unit=0.25)])
    size = len(rates)
    assert regressor.names == tuple(f"mass behind {joint}" for joint in joints)
    assert regressor.units == ("kg", "0.25 kg")
    assert regressor.predicted == tuple(robot.velocity_names[:size])
    assert regressor.predicted_units == tuple(rates)
    masses = np.array([robot.model.inertias[robot.joint_id(joint)].mass for joint in joints])
    generator, data = np.random.default_rng(3), robot.model.createData()
    for _ in range(3):
        q, v = robot.random_configuration(generator), generator.normal(size=robot.nv)
        A = pin.crba(robot.model, data, q)[:size]
        v[:size] = -np.linalg.solve(A[:, :size], A[:, size:] @ v[size:])
        y, Y = regressor.regress(q, v)
        np.testing.assert_allclose(Y @ (masses / [1.0, 0.25]), y, atol=1e-9 * (1 + np.abs(y).max()))
        assert np.abs(y).max() > 1e-4
    for index, unit in enumerate((1.0, 0.25)):
        true = robot.model.inertias[robot.joint_id(joints[index])]
        found = regressor.inertia(index, 0.4)
        assert found.mass == pytest.approx(0.4 * unit)
        np.testing.assert_allclose(found.lever, true.lever, atol=1e-12)
        np.testing.assert_allclose(found.inertia, true.inertia * found.mass / true.mass, atol=1e-12)


def test_a_base_that_turns_with_nothing_known_is_refused():
    robot = space_robot().robot
    with pytest.raises(rnc.ConfigurationError, match="no body of known mass turns with joint 'platform'"):
        MomentumRegressor(robot, "platform", [UnknownMass(name) for name in robot.joint_names])


def test_unknown_wheels_say_which_rows_they_enter_and_no_others():
    robot = rnc.Robot.from_urdf("differential_drive.urdf", base="planar")
    left, right = "left_wheel", "right_wheel"
    system = rnc.NonholonomicSystem(robot, [rnc.RollingWheel(wheel, 0.1) for wheel in (left, right)])
    reduced = system.reduce()
    rolling = {left: f"rolling({left})", right: f"rolling({right})"}
    for unknown, names, rows in (
        ([UnknownRadius([left])], ("radius of left_wheel",), (rolling[left],)),
        ([UnknownRadius([right])], ("radius of right_wheel",), (rolling[right],)),
        ([UnknownTrack([left, right])], ("track of left_wheel, right_wheel",), tuple(rolling.values())),
        (
            [UnknownRadius([right]), UnknownTrack([left, right]), UnknownRadius([left])],
            ("radius of right_wheel", "track of left_wheel, right_wheel", "radius of left_wheel"),
            tuple(rolling.values()),
        ),
    ):
        regressor = WheelRegressor(reduced, unknown)
        assert (regressor.names, regressor.units) == (names, ("m",) * len(names))
        assert (regressor.predicted, regressor.predicted_units) == (rows, ("m/s",) * len(rows))
        q, v = robot.configuration({"root_joint": (0.3, 0.2, 0.7)}), reduced.velocity(robot.configuration(), [0.4, 0.9])
        assert regressor.regress(q, v)[1].shape == (len(rows), len(names))
    for unknown, words in (
        ([], "name at least one unknown radius or track"),
        ([UnknownTrack([left])], r"unknown track: expected two wheels, found \['left_wheel'\]"),
        ([UnknownTrack([left, right, left])], "unknown track: expected two wheels, found"),
        ([UnknownTrack(left)], "unknown track: expected two wheels, found 'left_wheel'"),
        ([UnknownRadius([])], r"unknown radius: expected a list of wheels, found \[\]"),
        ([UnknownRadius([left, left])], "unknown radius: wheel 'left_wheel' is named twice"),
        ([UnknownRadius([left]), UnknownRadius([right, left])], "unknown radius: wheel 'left_wheel' is named twice"),
        ([UnknownRadius(["left_wheal"])], "unknown radius: no rolling wheel 'left_wheal'; did you mean 'left_wheel'"),
    ):
        with pytest.raises(rnc.ConfigurationError, match=words):
            WheelRegressor(reduced, unknown)


# ---------------------------------------------------------------------- estimator


class Known:
    """A regression of two parameters that is written down, and a model that shows what it believes."""

    names, Y = ("one", "two"), np.array([[2.0, 0.5], [0.0, 1.0], [1.0, -1.0]])

    def regress(self, q, v):
        return q * v, self.Y

    def estimated(self, reduced):
        return SimpleNamespace(at=lambda p: tuple(p))


def estimator(initial=(1.0, 2.0), affine=False, **settings):
    return Estimator(SimpleNamespace(affine=affine), Known(), initial, **settings)


def test_estimates_take_the_step_of_the_law_within_their_bounds():
    """Implicit, so that it never overshoots: ``p + s Y^T (1 + s Y Y^T)^-1 e`` with s the gain times the time."""
    measured, Y = Measurement(q=np.array([1.0, 2.0, 3.0]), v=np.array([3.0, 1.0, -0.5])), Known.Y
    free = estimator(alpha=0.7, bounds=(0.1, [50.0, 60.0]))
    assert free.model == (1.0, 2.0)
    first, error = free.step(3.0, measured, free.initial_state())
    np.testing.assert_allclose(error, [0.0, 0.0, -0.5])
    assert first.time == 3.0
    assert first.p.tolist() == [1.0, 2.0]  # no time has passed
    second, same = free.step(3.5, measured, first)
    np.testing.assert_array_equal(same, error)
    expected = first.p + 0.35 * Y.T @ np.linalg.solve(np.eye(3) + 0.35 * Y @ Y.T, error)
    np.testing.assert_allclose(second.p, expected, rtol=1e-12)
    assert free.model == tuple(second.p)
    assert free.initial_state().p.tolist() == [1.0, 2.0]
    assert free.model == (1.0, 2.0)
    for settings in ({"alpha": 0.0}, {"dead_zone": 0.5}, {"dead_zone": np.array([0.0, 0.0, 0.6])}):
        still = estimator(**settings)
        assert still.step(9.0, measured, still.initial_state()._replace(time=0.0))[0].p.tolist() == [1.0, 2.0]
    held = estimator(alpha=10.0, bounds=([0.9, 1.99], [1.1, 2.01]))
    for sign, edge in ((1.0, [1.1, 1.99]), (-1.0, [0.9, 2.01])):
        pull = Measurement(q=np.array([1.0, 2.0, 3.0]), v=np.array([3.0, 1.0, -1 / 3]) + sign * np.array([0, 0, 9.0]))
        assert held.step(9.0, pull, held.initial_state()._replace(time=0.0))[0].p.tolist() == edge
    assert free.describe() == {
        "alpha": 0.7,
        "dead_zone": 0.0,
        "initial": {"one": 1.0, "two": 2.0},
        "bounds": [[0.1, 0.1], [50.0, 60.0]],
    }
    with pytest.raises(rnc.InputError, match="time runs backwards: 2 s after 3 s"):
        free.step(2.0, measured, first)


def test_estimates_may_begin_at_their_bounds_and_not_beyond():
    for initial in ((0.5, 3.0), (3.0, 0.5)):
        assert estimator(initial, bounds=(0.5, 3.0)).initial.tolist() == list(initial)
    for settings, words in (
        ({"initial": (1.0,)}, "1 initial estimates for 2 unknown parameters"),
        ({"initial": (1.0, 2.0, 3.0)}, "3 initial estimates for 2 unknown parameters"),
        ({"initial": (1.0, 3.001), "bounds": (0.5, 3.0)}, "of the two, 3.001, has to be within its bounds 0.5 and 3$"),
        ({"initial": (0.499, 9.0), "bounds": (0.5, 3.0)}, "of the one, 0.499, has to be within its bounds 0.5 and 3$"),
        ({"bounds": (0.0, 3.0)}, r"have to be positive and in order, found \(0.0, 3.0\)"),
        ({"bounds": (3.0, 3.0)}, "have to be positive and in order"),
        ({"bounds": (0.1, [5.0, 0.1])}, "have to be positive and in order"),
        ({"bounds": (0.1, [5.0, 6.0, 7.0])}, "bounds of estimates: 3 values for 2 unknown parameters"),
        ({"affine": True}, "but the momentum is not zero"),
    ):
        with pytest.raises(rnc.ConfigurationError, match=words):
            estimator(**settings)


def test_what_is_believed_takes_the_place_of_what_is_true():
    guess = SimpleNamespace(A_star=np.eye(2), A_star_dot=2 * np.eye(2), input_matrix=np.array([[1.0, 2.0], [3.0, 4.0]]))
    seen = believed(Measurement(x1=np.ones(2), residual=np.ones(1), force_deficit=np.ones(2)), guess)
    assert seen.residual is None
    assert seen.A_star is guess.A_star
    assert seen.A_star_dot is guess.A_star_dot
    assert seen.force_deficit.tolist() == seen.x1.tolist() == [1.0, 1.0]
    assert believed(Measurement(input_deficit=np.array([1.0, -1.0])), guess).force_deficit.tolist() == [-1.0, -1.0]


# ---------------------------------------------------------------------- gains

UNEVEN = np.array([[[1.0, 0.6], [0.6, 4.0]], [[4.0, 0.0], [0.0, 16.0]]])
"""Diagonals whose geometric mean is (2, 8); scaled by it the eigenvalues are 0.5 -+ 0.15, and 2."""


def test_gains_scaled_to_an_inertia_are_those_of_the_window():
    reduced = SimpleNamespace(inertia=lambda q: UNEVEN[: len(q)])
    region, D = np.zeros((2, 3)), np.array([2.0, 8.0])
    for dt, delay, fastest in ((0.002, 0.0, 100.0), (0.002, 0.011, np.pi / 4 / 0.012), (0.01, 0.02, 20.0)):
        gains = VelocityGains.scaled(reduced, region, dt, slowest=2.0, adaptation=3.0, sigma=0.3, delay=delay)
        np.testing.assert_allclose(gains.k, 0.35 * fastest * D, rtol=1e-12)
        np.testing.assert_allclose(gains.beta, 3.0 * gains.k, rtol=1e-12)
        assert gains.sigma == 0.3
    for bandwidth in (4.0 * (1 + 1e-12), 35.0 * (1 - 1e-12)):
        assert VelocityGains.scaled(reduced, region, 0.002, bandwidth, 2.0).k == pytest.approx(bandwidth * D)
    for bandwidth in (3.999, 35.001):
        with pytest.raises(rnc.ConfigurationError, match="rad/s is outside the window 4 to 35"):
            VelocityGains.scaled(reduced, region, 0.002, bandwidth, 2.0)
    one = VelocityGains.scaled(reduced, region, 0.002, outputs=np.array([1]))
    assert one.k == pytest.approx([0.5 * 100.0 * 8.0])
    alone = VelocityGains.scaled(SimpleNamespace(inertia=lambda q: UNEVEN[1:][: len(q)]), np.zeros(3), 0.002)
    assert alone.k == pytest.approx([400.0, 1600.0])
    words = r"at least 20/s need a bandwidth of 40 rad/s, sampling every 0.002 s with a delay of 0.5 s allows 0.549; "
    with pytest.raises(rnc.InfeasibleError, match=words + r"sample faster .*\(eigenvalues 0.35 to 2\)"):
        VelocityGains.scaled(reduced, region, 0.002, slowest=20.0, delay=0.5)
    for delay in (-1e-9, np.inf, np.nan):
        with pytest.raises(rnc.ConfigurationError, match=r"delay of a loop has to be a time \[s\], not negative"):
            VelocityGains.scaled(reduced, region, 0.002, delay=delay)


def test_position_gains_scaled_to_an_inertia_are_those_of_the_closed_form():
    """``omega^2 = gamma / (dt + 2 delay)`` of the slowest motion, and the fade asked for, along a typical diagonal."""
    D, gamma, rate = np.array([2.0, 8.0]), 8.0, 1.5
    for dt, delay in ((0.001, 0.0), (0.001, 0.002)):
        gains = PositionGains.scaled(UNEVEN, dt, gamma, rate, 0.2, delay)
        square = gamma / (dt + 2 * delay) * 0.35
        np.testing.assert_allclose(gains.k1 * gamma**4 + gains.k2 * gamma**2, square * D)
        np.testing.assert_allclose(2 * gains.k2 * gamma**3, rate * square * D)
        assert (gains.gamma, gains.sigma, gains.beta.tolist()) == (gamma, 0.2, D.tolist())
    # The window: omega at least four times the rate of the quickest, ``sqrt(2)`` of a typical one.
    edge = gamma * 0.35 / ((4 * rate) ** 2 * 2.0)
    PositionGains.scaled(UNEVEN, edge * (1 - 1e-9), gamma, rate)
    words = r"every 0.0389 s allows oscillations of 8.48 rad/s, a decay rate of 1.5/s with gamma 8 needs more"
    with pytest.raises(rnc.InfeasibleError, match=words):
        PositionGains.scaled(UNEVEN, round(edge + 1e-5, 4), gamma, rate)
    one = np.array([[[1.0]]])
    PositionGains.scaled(one, 1e-4, 1.0, 1.99)
    with pytest.raises(rnc.InfeasibleError, match="gamma 1 needs more"):
        PositionGains.scaled(one, 1e-4, 1.0, 2.0)


def test_gains_of_a_bound_are_those_of_the_closed_form_and_describe_themselves():
    bound = np.array([3.0, 0.5])
    gains = VelocityGains.normalised(bound, sigma=0.4)
    np.testing.assert_allclose(gains.k, 4.0 * bound)
    np.testing.assert_allclose(gains.beta, 4.0 * bound)
    assert gains.describe() == {"k": [12.0, 2.0], "beta": [12.0, 2.0], "sigma": 0.4}
    position = PositionGains.normalised(bound, gamma=7.0, rate=2.0, sigma=0.4)
    np.testing.assert_allclose(position.k1 * 7.0**4 + position.k2 * 7.0**2, 64.0 * bound)
    np.testing.assert_allclose(2 * position.k2 * 7.0**3 / 64.0, 2.0 * bound)
    np.testing.assert_allclose(position.beta, bound)
    for rate in (0.0, -1.0, 3.5):
        with pytest.raises(rnc.ConfigurationError, match="gamma has to be above twice the rate"):
            PositionGains.normalised(bound, gamma=7.0, rate=rate)
    plain = {"k1": 10.0, "k2": 10.0, "gamma": 2.0, "beta": 10.0, "sigma": 0.1}
    assert PositionGains.paper().describe() == PositionGains().describe() == plain
    assert PositionGains(dead_zone=0.02).describe() == {**plain, "dead_zone": 0.02}
    assert VelocityGains(dead_zone=np.array([0.0, 0.1])).describe()["dead_zone"] == [0.0, 0.1]


# ---------------------------------------------------------------------- redundancy and what is left of it


@pytest.mark.parametrize("posture", [False, True])
def test_a_batch_with_more_redundant_than_vertical_outputs_is_each_state_alone(posture):
    reduced, kinematic, _ = wide(weights=np.array([1.0, 4.0]), posture=posture)
    states = random_states(reduced, 6, seed=4, condition=30.0)
    q, v2 = (np.reshape(each, (2, 3, -1)) for each in zip(*states, strict=True))
    still = np.zeros((2, 3, reduced.r))
    together = kinematic.step(1.0, reduced.measure(q, v2, still))[0]
    for i in np.ndindex(2, 3):
        alone = kinematic.step(1.0, reduced.measure(q[i], v2[i], still[i]))[0]
        for name in ("v2", "v2_dot", "x1", "x2"):
            np.testing.assert_allclose(getattr(together, name)[i], getattr(alone, name), rtol=1e-8, atol=1e-9)
    assert np.isnan(together.x2[..., 2:]).all()
    np.testing.assert_array_equal(together.x2[0, 1, :2], kinematic.primary.at(1.0).position)
    np.testing.assert_array_equal(together.x1[1, 2], kinematic.vertical.at(1.0).position)
    said = kinematic.describe()
    assert (said["k3"], said["k21"], said["weights"]) == (2.0, 2.0, [1.0, 4.0])
    assert ("secondary" in said) == posture


def test_vertical_outputs_that_drift_by_themselves_get_the_rate_they_need_nevertheless():
    """With an angular momentum that is not zero: ``A_star v2 + offset = x1d_dot + k3 (x1d - x1)``."""
    reduced = spinning_space_robot()
    task = rnc.Task.of(reduced, ["tip_x", "tip_y"], ["joint_1"])
    tip = MinimumJerk([0.9, 0.4], [1.1, -0.3], 2.0)
    law = RedundancyController(task, tip, Hold([0.3]), 1.7)
    assert "weights" not in law.describe()
    for q, v2 in random_states(reduced, 4, condition=30.0):
        measured = reduced.measure(q, v2)
        target = law.step(0.7, measured)[0]
        np.testing.assert_array_equal(target.v2[:2], tip.at(0.7).velocity)  # by default nothing is fed back here
        np.testing.assert_array_equal(target.v2_dot[:2], tip.at(0.7).acceleration)
        np.testing.assert_allclose(
            measured.A_star @ target.v2 + measured.v1_offset, 1.7 * (0.3 - measured.x1), atol=ROUNDING
        )
        rate = measured.A_star_dot @ target.v2 + measured.A_star @ target.v2_dot + measured.v1_offset_dot
        np.testing.assert_allclose(rate, -1.7 * measured.v1, atol=1e-9)
        assert abs(measured.v1_offset[0]) > 1e-3


def test_secondary_objectives_are_worth_their_gains_and_describe_themselves():
    reduced, task = manipulator()
    zero = Posture(task, Hold([0.2, -0.1]), np.array([0.0, 3.0]))
    (q, v2), *_ = random_states(reduced, 1, seed=6, condition=20.0)
    z, z_dot = zero(0.0, reduced.measure(q, v2))  # the speed has no integral, and no gain
    shoulder = reduced.outputs(q)[1][3]
    np.testing.assert_allclose(z, [0.0, 3.0 * np.angle(np.exp(1j * (-0.1 - shoulder)))], atol=ROUNDING)
    np.testing.assert_allclose(z_dot, [0.0, -3.0 * v2[3]], atol=ROUNDING)
    gains = np.array([0.5, 2.0])
    limits, distance = JointLimits(reduced, task, gains, 0.5), SingularityDistance(reduced, task, gains)
    measured = reduced.measure(q, v2)
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


def test_objectives_add_up():
    parts = [lambda t, m, k=k: (np.array([k, t]), np.array([2.0 * k, -t])) for k in (1.0, 5.0, 11.0)]
    for count, total in ((1, 1.0), (2, 6.0), (3, 17.0)):
        z, z_dot = Combined(parts[:count])(0.5, None)
        assert z.tolist() == [total, 0.5 * count]
        assert z_dot.tolist() == [2.0 * total, -0.5 * count]


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
    reduced = SimpleNamespace(robot=rnc.Robot(model), basis_rate=lambda q, v: (R, R_dot))
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


@pytest.mark.parametrize("max_input", [0.5, 1e9])
def test_a_long_chain_and_the_rate_of_its_command(max_input):
    stabilizer, h = ChainedStabilizer(5, 0.6, 1.4, max_input), 1e-6
    for x, u in zip(*np.random.default_rng(2).uniform(-1, 1, (2, 6, 5)), strict=True):
        x[0] = np.sign(x[0]) * (0.5 + abs(x[0]))
        np.testing.assert_allclose(stabilizer.coordinates(x), [x[i] / x[0] ** (i - 1) for i in range(1, 5)])
        law = np.array([-0.6 * x[0], -stabilizer.P @ stabilizer.coordinates(x)])
        command = stabilizer.command(x)
        np.testing.assert_allclose(command, law / max(1.0, np.hypot(*law) / max_input), rtol=1e-12)
        ahead, behind = (stabilizer.command(x + sign * h * chain_rate(x, u[:2])) for sign in (1, -1))
        rate = (ahead - behind) / (2 * h)
        np.testing.assert_allclose(
            stabilizer.command_rate(x, u[:2]), rate, atol=FINITE_DIFFERENCE * (1 + np.abs(rate).max())
        )


# ---------------------------------------------------------------------- slithering


@pytest.mark.parametrize("turn", [1.0, -1.0], ids=["left", "right"])
def test_a_trailer_behind_a_tractor_on_a_circle_cuts_half_the_angle_of_its_chord(turn):
    """Heading ``psi - asin(L / 2 rho)``; it turns as the tractor does, and faster as that speeds up."""
    reduced, rho, speed, growth = fire_truck(), 2.0, 0.7, 0.3
    reference = SlitheringReference(reduced, rnc.Task.of(reduced, *TASK), "tractor", "rear_axle")
    names = list(reduced.vertical.names)
    x, y, yaw, trailer = (names.index(name) for name in ("tractor_x", "tractor_y", "tractor_yaw", "trailer_yaw"))

    def measured(psi):
        x1, v1, A_star, A_star_dot = np.zeros(4), np.zeros(4), np.zeros((4, 3)), np.zeros((4, 3))
        x1[[x, y, yaw]] = rho * np.sin(psi), turn * rho * (1 - np.cos(psi)), turn * psi
        v1[[x, y, yaw]] = speed * np.cos(psi), turn * speed * np.sin(psi), turn * speed / rho
        A_star[[x, y], 0] = np.cos(psi), turn * np.sin(psi)
        A_star_dot[[x, y], 0] = np.array([-np.sin(psi), turn * np.cos(psi)]) * speed / rho
        x1[trailer] = turn * (psi - 0.3)
        return Measurement(x1=x1, v1=v1, v2=np.array([speed, 0, 0]), A_star=A_star, A_star_dot=A_star_dot)

    state = reference.initial_state(measured(0.0))
    assert state.heading == pytest.approx(0.0)
    np.testing.assert_allclose(state.path, [[-2.0, 0, 0, -2.0], [0, 0, 0, 0]])
    for psi in np.arange(0.005, 1.6, 0.005):
        point, state = reference.step(measured(psi), np.array([growth, 0.0, 0.0]), state)
    cut = np.arcsin(1.0 / (2 * rho))
    np.testing.assert_allclose(point.position, turn * (psi - cut), atol=1e-6)
    np.testing.assert_allclose(point.velocity, turn * speed / rho, atol=1e-6)
    np.testing.assert_allclose(point.acceleration, turn * growth / rho, atol=1e-5)
    assert np.isnan(point.jerk).all()
    driven = np.diff(state.path[:, 3])
    assert driven.min() > reference.spacing * (1 - 1e-9)
    assert 2.0 < state.path[-1, 3] - state.path[0, 3] < 2.0 + 3 * driven.max()


def test_places_are_remembered_a_spacing_apart_and_forgotten_when_the_tractor_backs_over_them():
    reduced = fire_truck()
    reference = SlitheringReference(reduced, rnc.Task.of(reduced, *TASK), "tractor", "rear_axle", spacing=0.25)
    assert reference.window == 1.25
    path = np.array([[0.0, 0, 0, 0], [0.5, 0, 0, 0.5], [1.0, 0.0, 0.0, 1.0]])
    for ahead, kept, new in (
        (0.25, 3, True),
        (0.2499, 3, False),
        (-0.2499, 3, False),
        (-0.25, 2, True),  # as far as that ahead of the place before
        (-0.2501, 2, False),
        (-0.7499, 2, False),
        (-0.75, 1, True),
        (-0.7501, 1, False),
        (-5.0, 1, False),
    ):
        found = reference._recorded(path, 1.0 + ahead, 0.1, 0.3)
        assert len(found) == kept + new
        np.testing.assert_array_equal(found[:kept], path[:kept])
        if new:
            np.testing.assert_allclose(found[-1], [1.0 + ahead, 0.1, 0.3, path[kept - 1, 3] + np.hypot(0.25, 0.1)])
    turned = np.array([[0.0, 0.0, np.pi / 2, 0.0]])
    assert len(reference._recorded(turned, 5.0, 0.2499, 0.0)) == 1
    assert len(reference._recorded(turned, -5.0, 0.2501, 0.0)) == 2
    assert isinstance(reference.initial_state(reduced.measure(reduced.robot.configuration(), np.zeros(3))), DrivenPath)
