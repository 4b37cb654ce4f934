"""Trackers and laws beside a plain rewriting of each: whole results, unequal numbers, signs mixed, batches."""

from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from controlled_tasks import Cubic
from rnc_pin.control import (
    ChainedStabilizer,
    ComputedTorque,
    JointLimits,
    PositionGains,
    PositionTracker,
    Posture,
    ReducingOutputController,
    SingularityDistance,
    TrackerState,
    UnicycleStabilizer,
    UnknownMass,
    VelocityGains,
    VelocityTarget,
    VelocityTracker,
)
from rnc_pin.control.position_tracker import PositionState
from rnc_pin.model.measurement import Measurement
from rnc_pin.planning import Hold

# ---------------------------------------------------------------------- trackers


class Said:
    """A velocity target that is written down, and a state that counts."""

    def __init__(self, v2, v2_dot):
        self.target = VelocityTarget(v2, v2_dot, np.array([7.0]), np.array([8.0, 9.0]))

    def initial_state(self, measurement):
        return 5

    def step(self, t, measurement, state):
        return self.target, state + 1


def learnt_over(elapsed, sigma, before, drive):
    """Where ``ydot = -sigma y + drive`` is after a time."""
    fade = np.exp(-sigma * elapsed)
    return before * fade + drive * ((1 - fade) / sigma if sigma else elapsed)


@pytest.mark.parametrize("sigma", [0.0, 0.6])
@pytest.mark.parametrize("zone", [0.0, np.array([0.3, 0.05])])
@pytest.mark.parametrize("clipped", [False, True])
def test_a_velocity_tracker_takes_the_step_of_its_law_output_by_output(sigma, zone, clipped):
    """Learnt is from the error that the step along the regressor w leaves: ``x = s beta (e - |w|^2 x / k)``."""
    generator, k, beta, held = np.random.default_rng(5), np.array([3.0, 7.0]), np.array([11.0, 4.0]), [0.7, -1.3]
    v2, v2d, v2d_dot, excess = generator.uniform(-1, 1, (4, 6, 2))
    g, C, D = generator.normal(size=(6, 2)), generator.normal(size=(6, 2, 2)), generator.normal(size=(6, 2, 4))
    tracker = VelocityTracker(Said(v2d, v2d_dot), VelocityGains(k, beta, sigma, zone), held)
    measured = Measurement(v2=v2, force_deficit=excess if clipped else None)
    command, after = tracker.step(2.35, measured, TrackerState(2.0, g, C, D, 5))
    assert (after.time, after.target) == (2.35, 6)
    kinds = set()
    for i, j in np.ndindex(6, 2):
        products = np.kron(v2[i], v2d[i])
        w = np.concatenate([[1.0], v2d_dot[i], products])
        before = np.concatenate([[g[i, j]], C[i, j], D[i, j]])
        error = v2d[i, j] - v2[i, j]
        seen = np.sign(error) * max(abs(error) - np.broadcast_to(zone, 2)[j], 0.0)
        s = learnt_over(0.35, sigma, 0.0, 1.0)
        added = s * beta[j] * seen / (1 + s * beta[j] * (w @ w) / k[j])
        expected = before * np.exp(-0.35 * sigma) + added * w
        rests = seen == 0.0 or (clipped and np.sign(excess[i, j]) == np.sign(error))
        kinds.add(rests)
        if rests:
            expected = before
        found = np.concatenate([[after.g[i, j]], after.C[i, j], after.D[i, j]])
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-13)
        np.testing.assert_allclose(command.F[i, j], expected @ w + k[j] * error + held[j], rtol=1e-12)
    assert kinds == ({False, True} if clipped or np.any(zone) else {False})
    assert command.v2_desired is v2d
    assert (command.x1_desired.tolist(), command.x2_desired.tolist()) == ([7.0], [8.0, 9.0])
    assert command.T is command.estimates is command.prediction_error is None


def test_a_velocity_tracker_starts_with_nothing_learnt_in_the_shape_of_what_it_sees():
    tracker = VelocityTracker(Said(None, None), gravity_compensation=[2.0, -1.0])
    state = tracker.initial_state(Measurement(v2=np.ones((4, 3, 2))))
    assert (state.time, state.target) == (None, 5)
    shapes = [(4, 3, 2), (4, 3, 2, 2), (4, 3, 2, 4)]
    assert [each.shape for each in state[1:4]] == shapes
    assert not any(each.any() for each in state[1:4])
    said = tracker.describe()
    assert said == {
        "type": "VelocityTracker",
        "gains": {"k": 10.0, "beta": 10.0, "sigma": 0.1},
        "gravity_compensation": [2.0, -1.0],
        "target": {"type": "Said"},
    }
    assert VelocityTracker(Said(None, None)).describe()["gravity_compensation"] == 0.0


WHERE, ANGULAR = np.array([2, 0]), np.array([False, True])


def unprimed(state, gains, point):
    """[f A B] of the paper."""
    w = np.concatenate([[1.0], point.acceleration, point.velocity])
    primed = np.concatenate([state.f[..., None], state.A, state.B], axis=-1)
    return primed + (gains.beta * state.e)[..., None] * w, w


@pytest.mark.parametrize("sigma", [0.0, 0.6])
@pytest.mark.parametrize("zone", [0.0, np.array([0.4, 0.1])])
@pytest.mark.parametrize("clipped", [False, True])
@pytest.mark.parametrize("first", [False, True])
def test_a_position_tracker_takes_the_step_of_its_law_output_by_output(sigma, zone, clipped, first):
    """With e held over the sample; what stays is the learnt force of the paper, not what is primed of it."""
    generator, reference = np.random.default_rng(8), Cubic([0.1, 2.9], [0.5, -0.8], [0.4, 0.3], [-0.7, 1.1])
    gains = PositionGains(np.array([3.0, 5.0]), np.array([2.0, 7.0]), 1.7, np.array([4.0, 0.9]), sigma, zone)
    tracker = PositionTracker(reference, gains, WHERE, ANGULAR, [0.3, -2.0])
    x2, excess = generator.uniform(-1, 1, (7, 3)), generator.uniform(-1, 1, (7, 3))
    x2[:, 0] += 2.9
    size = ((7, 2), (7, 2), (7, 2, 2), (7, 2, 2), (7, 2))
    begin = PositionState(None if first else 1.1, *(generator.uniform(-1, 1, each) for each in size))
    t = 1.1 if first else 1.4
    elapsed = 0.0 if first else t - 1.1
    command, after = tracker.step(t, Measurement(x2=x2, force_deficit=excess if clipped else None), begin)
    now, before = reference.at(t), reference.at(1.1)
    e = now.position - x2[:, WHERE]
    e[:, 1] = np.angle(np.exp(1j * e[:, 1]))
    np.testing.assert_allclose(after.e, e, atol=1e-14)
    z = (begin.z + 1.7**2 * e) * np.exp(-2 * 1.7 * elapsed) - 1.7**2 * e
    np.testing.assert_allclose(after.z, z, rtol=1e-12, atol=1e-13)
    w = z + 1.7**2 * e
    q = gains.k2 / gains.k1 / 1.7 * e - w / 1.7
    learnt, _ = unprimed(begin, gains, before)
    found, regressor = unprimed(after, gains, now)
    kinds = set()
    for i, j in np.ndindex(7, 2):
        by, rate = (
            np.concatenate([[1.0], now.acceleration, now.velocity]),
            np.concatenate([[0], now.jerk, now.acceleration]),
        )
        primed = np.concatenate([[begin.f[i, j]], begin.A[i, j], begin.B[i, j]])
        step = gains.beta[j] * e[i, j]
        new = (
            learnt_over(elapsed, sigma, primed, gains.beta[j] * q[i, j] * by - step * rate - sigma * step * by)
            + step * by
        )
        quiet = abs(e[i, j]) < np.broadcast_to(zone, 2)[j]
        stays = quiet or (clipped and excess[i, WHERE[j]] * ((new - learnt[i, j]) @ by) > 0)
        kinds.add(bool(stays))
        np.testing.assert_allclose(found[i, j], learnt[i, j] if stays else new, rtol=1e-11, atol=1e-12)
        F = found[i, j] @ regressor + gains.k1[j] * 1.7**2 * w[i, j] + gains.k2[j] * 1.7**2 * e[i, j] + [0.3, -2.0][j]
        np.testing.assert_allclose(command.F[i, j], F, rtol=1e-11)
    assert kinds == ({False, True} if clipped or np.any(zone) else {False})
    assert after.time == t
    for name, value in (("v2_desired", now.velocity), ("x2_desired", now.position)):
        np.testing.assert_array_equal(getattr(command, name)[:, WHERE], np.broadcast_to(value, (7, 2)))
        assert np.isnan(getattr(command, name)[:, 1]).all()


def test_a_position_tracker_starts_at_rest_with_nothing_learnt():
    """Where the reference moves and the error is not zero; the first force is that of the error alone."""
    reference = Cubic([0.1, 2.9], [0.5, -0.8], [0.4, 0.3], [-0.7, 1.1])
    gains = PositionGains(np.array([3.0, 5.0]), np.array([2.0, 7.0]), 1.7, np.array([4.0, 0.9]), 0.3)
    tracker = PositionTracker(reference, gains, WHERE, ANGULAR, [0.3, -2.0])
    measured = Measurement(x2=np.random.default_rng(1).uniform(-1, 1, (3, 4, 3)))
    state = tracker.initial_state(measured)
    learnt, _ = unprimed(state, gains, reference.at(0.0))
    assert learnt.shape == (3, 4, 2, 5)
    np.testing.assert_allclose(learnt, 0.0, atol=1e-13)
    e = reference.at(0.0).position - measured.x2[..., WHERE]
    e[..., 1] = np.angle(np.exp(1j * e[..., 1]))
    np.testing.assert_allclose(state.e, e, atol=1e-14)
    np.testing.assert_allclose(state.z, -(1.7**2) * e, rtol=1e-13)
    assert state.time is None
    command, _ = tracker.step(0.0, measured, state)
    np.testing.assert_allclose(command.F, gains.k2 * 1.7**2 * e + [0.3, -2.0], rtol=1e-11)
    said = tracker.describe()
    assert said == {"type": "PositionTracker", "gains": gains.describe(), "gravity_compensation": [0.3, -2.0]}


# ---------------------------------------------------------------------- secondary objectives


def sliders(*ends):
    """A chain of sliding joints with these limits, as a system whose redundant columns are the identity's."""
    model, bounds = pin.Model(), [np.array([1e3])] * 2
    for index, (low, high) in enumerate(ends):
        limits = [np.array([low]), np.array([high])]
        joint = model.addJoint(model.njoints - 1, pin.JointModelPX(), pin.SE3.Identity(), f"j{index}", *bounds, *limits)
        model.appendBodyToJoint(joint, pin.Inertia(1.0, np.zeros(3), np.eye(3)), pin.SE3.Identity())
    return SimpleNamespace(robot=rnc.Robot(model))


def test_a_joint_has_ends_where_both_are_numbers_below_ten_billion_and_in_order():
    task, far = SimpleNamespace(redundant=np.arange(1)), 1e10
    near, beyond = np.nextafter(far, 0.0), np.finfo(float).max
    for low, high in ((-near, near), (-near, 0.0), (0.0, near), (-3.0, -2.0), (2.0, 3.0)):
        assert JointLimits(sliders((low, high)), task).describe()["zone"] == [0.1 * (high - low)]
    for low, high in (
        (-far, 2.0),
        (-np.inf, 2.0),
        (-beyond, 2.0),
        (-2.0, far),
        (-2.0, np.inf),
        (-2.0, beyond),
        (2.0, 2.0),
        (3.0, 2.0),
    ):
        with pytest.raises(rnc.ConfigurationError, match=r"no joint of robot '.*' has position limits"):
            JointLimits(sliders((low, high)), task)
        both = JointLimits(sliders((low, high), (1.0, 3.0)), task)
        assert both.describe()["zone"] == pytest.approx([0.2])


class Cubes(SingularityDistance):
    """Its gradient is written down."""

    def gradient(self, q):
        return q**3


def test_the_distance_from_singularity_is_differentiated_over_at_most_a_fifty_thousandth():
    """At zero the difference of ``q^3`` along v is ``h^2 v^3``, which tells h; one state and batches of two axes."""
    reduced, gains = sliders(*[(-1.0, 1.0)] * 3), np.array([0.5, 2.0, 3.0])
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


@pytest.mark.parametrize("batch", [(), (2,), (2, 4)])
def test_where_redundant_outputs_move_nothing_the_distance_has_no_gradient(batch):
    """Said with the first configuration of a batch."""
    rows = np.zeros((*batch, 2, 4))
    reduced = SimpleNamespace(
        at=lambda q: SimpleNamespace(A_star=rows), kinematic_gradient=lambda q, of: np.zeros((*batch, 2, 4, 3))
    )
    task = SimpleNamespace(
        redundant=np.array([3, 0, 1]),
        vertical=np.array([1]),
        vertical_names=("height",),
        redundant_names=("a", "b", "c"),
    )
    q = np.random.default_rng(1).normal(size=(*batch, 5))
    with pytest.raises(rnc.SingularityError, match=r"cannot move the vertical ones \(A4 is singular\)") as caught:
        SingularityDistance(reduced, task).gradient(q)
    np.testing.assert_array_equal(caught.value.q, q.reshape(-1, 5)[0])
    assert caught.value.condition == np.inf
    assert caught.value.rows == ("height", "a", "b", "c")


# ---------------------------------------------------------------------- what is so where nobody says otherwise


def test_settings_that_nobody_gives_are_those_of_the_documentation():
    """Round numbers that users have come to rely on, each as its owner describes it."""
    reduced, task = sliders((-1.0, 1.0)), SimpleNamespace(redundant=np.arange(1), redundant_coordinates=None)
    assert Posture(task, Hold([0.0])).describe()["k"] == 1.0
    assert JointLimits(reduced, task).describe() == {"type": "JointLimits", "k": 0.1, "zone": [pytest.approx(0.2)]}
    assert SingularityDistance(reduced, task).describe()["k"] == 0.1
    one = SimpleNamespace(r=1, reducing=SimpleNamespace(coordinates=None))
    follow = ReducingOutputController(one, Hold([0.0]))
    assert follow.describe() == {"type": "ReducingOutputController", "k2": 2.0}
    torque = {"type": "ComputedTorque", "k": 20.0, "target": follow.describe()}
    assert ComputedTorque(one, follow).describe() == torque
    chain = {"type": "ChainedStabilizer", "n": 3, "k": 0.5, "rate": 1.5, "max_input": 1000.0}
    assert ChainedStabilizer(3).describe() == chain
    stabilizer = UnicycleStabilizer(np.zeros(3), np.arange(2)).describe()
    rates = {"begin": 0.0, "k": 0.5, "rate": 1.5, "tolerance": 0.002, "ramp_time": 1.0, "max_speed": [1.0, 1.0]}
    assert stabilizer == {"type": "UnicycleStabilizer", "goal": [0.0, 0.0, 0.0], **rates}
    assert UnknownMass("wrist").unit == 1.0
    gains = VelocityGains.normalised(3.0)
    assert (gains.k, gains.beta, gains.sigma, gains.dead_zone) == (12.0, 12.0, 0.1, 0.0)
    five = SimpleNamespace(inertia=lambda q: np.array([[[5.0]]]))
    for dt, rate in ((0.01, 20.0), (0.05, 4.0)):
        gains = VelocityGains.scaled(five, np.zeros(2), dt)
        assert (gains.k, gains.beta, gains.sigma, gains.dead_zone) == (pytest.approx([5.0 * rate]), gains.k, 0.1, 0.0)
    with pytest.raises(rnc.InfeasibleError, match="at least 4/s need a bandwidth of 4 rad/s"):
        VelocityGains.scaled(five, np.zeros(2), 0.05 * (1 + 1e-9))
    for made in (PositionGains.normalised(5.0), PositionGains.scaled(np.array([[[5.0]]]), 0.01)):
        assert (made.gamma, made.sigma, made.dead_zone) == (8.0, 0.1, 0.0)
        square = made.k1 * 8.0**4 + made.k2 * 8.0**2
        np.testing.assert_allclose(2 * made.k2 * 8.0**3, 3.0 * square)
        assert made.beta == 5.0
        assert square == pytest.approx(5.0 * (144.0 if made.k1.ndim == 0 else 800.0))


def test_gains_are_given_up_to_the_edge_of_their_windows():
    """Numbers that are exact in binary: at the edge itself they still suit."""
    one = np.array([[[1.0]]])
    gains = PositionGains.scaled(one, 0.5, 8.0, 1.0)
    assert (gains.k1.tolist(), gains.k2.tolist()) == ([15.0 / 8.0**4], [16.0 / 2.0 / 8.0**3])
    with pytest.raises(rnc.InfeasibleError, match=r"allows oscillations of 4 rad/s, a decay rate of 1/s with gamma 8"):
        PositionGains.scaled(one, 0.5 * (1 + 1e-9), 8.0, 1.0)
    slow = PositionGains.normalised(2.0, gamma=1.0, rate=0.3)
    assert 2 * slow.k2 == pytest.approx(0.3 * (slow.k1 + slow.k2))
    assert slow.k1 + slow.k2 == pytest.approx(2.0 * 1.2**2)
    assert VelocityGains.scaled(SimpleNamespace(inertia=lambda q: one), np.zeros(1), 0.1, 2.0, 2.0).k == [2.0]
    region = np.array([[[2.0, 0.5], [0.5, 1.0]], [[3.0, -0.2], [-0.2, 4.0]], [[0.7, 0.1], [0.3, 5.0]]])
    flat = PositionGains.scaled(region, 0.002)
    grid = PositionGains.scaled(region[None], 0.002)
    np.testing.assert_allclose(flat.beta, np.sqrt([0.7 * 3.0, 1.0 * 5.0]))
    np.testing.assert_array_equal([flat.k1, flat.k2, flat.beta], [grid.k1, grid.k2, grid.beta])
    for delay in (-1e-9, float("inf"), float("nan")):
        with pytest.raises(rnc.ConfigurationError) as caught:
            PositionGains.scaled(one, 0.001, delay=delay)
        assert str(caught.value) == f"delay of a loop has to be a time [s], not negative, found {delay}"
    for bound in (0.0, -1.0, float("inf"), [1.0, float("nan")]):
        with pytest.raises(rnc.ConfigurationError, match="a bound on the inertia has to be positive, found "):
            PositionGains.normalised(bound)
