"""Derivatives of the dynamics, beside differences and those of bodies and inputs written out."""

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import HealthCheck, assume, given, settings

import rnc_pin as rnc
from kinds import ILL_SCALED, KINDS
from random_systems import TOUCHING, recipes, reduced_of
from rnc_pin.analysis.derivatives import _at_one_state as at_one_state
from rnc_pin.analysis.derivatives import state_derivatives
from rnc_pin.model.user_functions import gradient
from systems import bicycle, mobile_manipulator, random_states, spinning_space_robot, sprung_arm, tiago
from textbook_systems import rail_sliders


@pytest.mark.parametrize("affine", [False, True])
@pytest.mark.parametrize("moving", [False, True])
def test_the_error_of_differences_is_that_of_two_steps(affine, moving):
    """Of eighth order, one step twice the other: the difference of both is 255 times the error of the finer one."""
    k = 20.0

    def push(q):
        return np.array([[np.sin(k * q[0]), 2.0, np.sin(k * q[0])], [0.0, 0.0, 0.0]])

    def rate(q):
        return 0.7 * np.sin(k * q[1:])

    def rate_dot(q, v):
        return 0.7 * k * np.cos(k * q[1:]) * v[1:]

    row, both = np.array([[0.0, 1.0]]), np.array([[1.0, 1.0]])
    moved = rnc.Pfaffian(lambda q: row, lambda q, v: 0 * row, None, *((rate, rate_dot) if affine else ()))
    output = rnc.Output(lambda q: both @ q, lambda q: both, lambda q, v: 0 * both, ["both"])
    reduced = rnc.NonholonomicSystem(rail_sliders(2), [moved], push).reduce([output])
    q, T = np.array([0.13, -0.21]), np.array([0.03, 0.5, -0.08])
    found = state_derivatives(reduced, q, np.array([0.4 * moving]), T)
    along_0, along_1 = found.v2_dot_q[0]
    error = abs(along_0 / (T[0] + T[2]) - k * np.cos(k * q[0]))
    estimate = 255 * error * np.abs(T).sum()
    # The other row's body accelerates by mu' mu, of which mu'' is found by differences.
    exact = (0.7 * k) ** 2 * (np.cos(k * q[1]) ** 2 - np.sin(k * q[1]) ** 2) * affine
    assert along_1 == pytest.approx(exact, rel=1e-6, abs=1e-12)
    assert found.difference_error == pytest.approx(estimate + 255 * abs(along_1 - exact), rel=0.05)


BLOCKS = ("v", "v2_dot", "v_q", "v_v2", "v2_dot_q", "v2_dot_v2", "v2_dot_T")
BOTH_WAYS = 1e-10  # the two paths, relative
EXACT = 1e-9  # eighth-order differences of the dynamics, relative


def near(found, expected, tolerance, what=""):
    scale = max(1.0, np.abs(expected).max(initial=0.0))
    np.testing.assert_allclose(found, expected, rtol=0, atol=tolerance * scale, err_msg=what)


def check_differences(reduced, found, q, v2, T, tolerance=EXACT, step=1e-3):
    """All derivatives against differences of the dynamics, which are quadratic in v2 and linear in T."""
    model = reduced.robot.model
    near(found.v_q, gradient(model, lambda p: np.array(reduced.at(p, v2).v), q, step), tolerance, "v_q")
    near(found.v2_dot_q, gradient(model, lambda p: reduced.forward_dynamics(p, v2, T), q, step), tolerance, "v2_dot_q")
    ahead, behind = ([reduced.forward_dynamics(q, v2 + s * unit, T) for unit in np.eye(reduced.r)] for s in (1, -1))
    near(found.v2_dot_v2, np.transpose(np.subtract(ahead, behind)) / 2, tolerance, "v2_dot_v2")
    pushed = [reduced.forward_dynamics(q, v2, T + unit) - found.v2_dot for unit in np.eye(reduced.p)]
    near(found.v2_dot_T, np.reshape(pushed, (reduced.p, reduced.r)).T, tolerance, "v2_dot_T")


@pytest.mark.parametrize("name", [name for name in KINDS if name != "forces"])
def test_every_built_in_kind_is_in_closed_form(name):
    reduced = KINDS[name]()
    assert rnc.kernel == "numpy" or reduced.evaluator.kernel
    for q, v2 in random_states(reduced, 2, condition=300.0 if name in ILL_SCALED else 50.0):
        T = np.linspace(-1.0, 2.0, reduced.p)
        found = state_derivatives(reduced, q, v2, T)
        assert found.difference_error == 0.0
        check_differences(reduced, found, q, v2, T)


def test_forces_of_every_kind_are_in_closed_form():
    """Beside differences of the dynamics. Friction is not quadratic in v2."""
    reduced = sprung_arm()
    q, v2 = random_states(reduced, 1)[0]
    T = np.linspace(-1.0, 1.0, reduced.p)
    found = state_derivatives(reduced, q, v2, T)
    assert found.difference_error == 0.0
    by_q = gradient(reduced.robot.model, lambda p: reduced.forward_dynamics(p, v2, T), q, 1e-3)
    near(found.v2_dot_q, by_q, 1e-7, "v2_dot_q")
    steps = 1e-4 * np.eye(reduced.r)
    by_v2 = [reduced.forward_dynamics(q, v2 + h, T) - reduced.forward_dynamics(q, v2 - h, T) for h in steps]
    near(found.v2_dot_v2, np.transpose(by_v2) / 2e-4, 1e-7, "v2_dot_v2")


@settings(max_examples=12, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(recipes())
def test_derivatives_of_random_systems(recipe):
    try:
        reduced = reduced_of(recipe)
        ((q, v2),) = random_states(reduced, 1, condition=50.0)
    except (rnc.RncError, RuntimeError, AssertionError):  # AssertionError: no configuration is well conditioned
        assume(False)
    assume(reduced.r and reduced.at(q).factorization.kept is None)
    assume(np.linalg.cond(reduced.at(q).H) < 1e4)
    v2 = v2 / np.maximum(1.0, np.abs(reduced.at(q, v2).v).max())
    T = np.ones(reduced.p)
    found, plain = state_derivatives(reduced, q, v2, T), at_one_state(reduced, reduced.at(q, v2), T)
    for each in BLOCKS:
        near(getattr(found, each), getattr(plain, each), BOTH_WAYS, each)
    assert plain.difference_error == 0.0 or {"rows", "belt", "skate", *TOUCHING} & {*recipe.constraints}
    check_differences(reduced, found, q, v2, T, 1e-7)


@pytest.mark.parametrize("moving", [True, False])
def test_rows_over_time_are_differentiated_at_a_constant_time(moving):
    """A row and a rate of a user, and the heading of the hand, at a time other than zero; at rest too."""
    robot = mobile_manipulator().robot
    swing = rnc.planning.Harmonic([0.1], amplitude=[0.3], frequency=0.5, phase=0.4)
    row = rnc.Pfaffian(
        lambda q, t: np.array([[np.sin(t + q[0]), np.cos(t), 0.3 * t, 0.0, q[1] * t]]),
        rate=lambda q, t: np.array([np.sin(2 * t + q[0] * q[1])]),
        rheonomic=True,
    )
    rows = [row, rnc.PrescribedMotion(rnc.FrameYaw("tip"), swing)]
    reduced = rnc.NonholonomicSystem(robot, rows, ["joint_1", "joint_2"]).reduce()
    q = robot.configuration({"root_joint": (0.3, -0.2, 0.9), "joint_1": 0.4, "joint_2": -0.7})
    v2, T, t = moving * np.array([0.5, -0.3, 0.8])[: reduced.r], np.array([1.0, -2.0]), 0.8
    found, frozen = state_derivatives(reduced, q, v2, T, t=t), reduced.frozen(t)
    check_differences(frozen, found, q, v2, T)
    assert 0 < found.difference_error < 1e-10
    many = state_derivatives(reduced, np.stack([q, q]), v2, T, t=[0.0, t])
    for each in BLOCKS:
        np.testing.assert_array_equal(getattr(many, each)[1], getattr(found, each))
        near(getattr(state_derivatives(frozen, q, v2, T), each), getattr(found, each), BOTH_WAYS, each)
    with pytest.raises(rnc.InputError, match=r"prescribed\(tip_yaw\).* t=0.0"):
        state_derivatives(reduced, q, v2, T)


@pytest.mark.parametrize("make", [mobile_manipulator, spinning_space_robot, bicycle])
def test_blocks_of_states_are_as_each(make):
    reduced = make()
    q, v2 = (np.stack(each) for each in zip(*random_states(reduced, 6), strict=True))
    T = np.random.default_rng(2).normal(size=(6, reduced.p))
    many = state_derivatives(reduced, q, v2, T)
    square = state_derivatives(reduced, q.reshape(2, 3, -1), v2.reshape(2, 3, -1), T.reshape(2, 3, -1))
    shared = state_derivatives(reduced, q, v2, T[0])
    for k in range(6):
        one, same = state_derivatives(reduced, q[k], v2[k], T[k]), state_derivatives(reduced, q[k], v2[k], T[0])
        for each in (*BLOCKS, "difference_error"):
            np.testing.assert_array_equal(getattr(many, each)[k], getattr(one, each), err_msg=each)
            np.testing.assert_array_equal(getattr(square, each)[divmod(k, 3)], getattr(one, each), err_msg=each)
            np.testing.assert_array_equal(getattr(shared, each)[k], getattr(same, each), err_msg=each)
    n, r, p = reduced.n, reduced.r, reduced.p
    none = state_derivatives(reduced, q[:0], v2[:0], T[:0])
    shapes = ((n,), (r,), (n, n), (n, r), (r, n), (r, r), (r, p))
    assert [getattr(none, each).shape for each in BLOCKS] == [(0, *shape) for shape in shapes]
    with pytest.raises(rnc.InputError, match=rf"T of shape \(5, {p}\) does not broadcast to states of shape \(6,\)"):
        state_derivatives(reduced, q, v2, T[:5])


def test_results_cannot_be_changed_and_repeat_to_the_bit():
    reduced = tiago()
    (q, v2), (p, w) = random_states(reduced, 2)
    T = np.ones(reduced.p)
    first, _, again = (state_derivatives(reduced, *state, T) for state in ((q, v2), (p, w), (q, v2)))
    for each in BLOCKS:
        np.testing.assert_array_equal(getattr(again, each), getattr(first, each))
    with pytest.raises(ValueError, match="read-only"):
        first.v_q[0] = 1.0


def test_rows_that_replace_the_default_rows_have_derivatives():
    """Two rows for one velocity; at q = 0 the default one vanishes."""

    def rows(q):
        return np.array([[np.sin(q[0]), 0.0, np.sin(q[0]) * q[2]], [np.cos(q[0]), 0.0, np.cos(q[0]) * q[2]]])

    def rows_dot(q, v):
        c, s = np.cos(q[0]) * v[0], -np.sin(q[0]) * v[0]
        return np.array([[c, 0.0, c * q[2] + np.sin(q[0]) * v[2]], [s, 0.0, s * q[2] + np.cos(q[0]) * v[2]]])

    system = rnc.NonholonomicSystem(rail_sliders(3), [rnc.Pfaffian(rows, rows_dot)], np.eye(3))
    reduced = system.reduce([rnc.JointPosition("s1"), rnc.JointPosition("s2")])
    v2, T = np.array([0.3, -0.8]), np.array([0.2, 0.5, -1.0])
    replaced = 0
    for angle in (0.0, np.pi / 2):
        q = np.array([angle, 0.4, 0.7])
        replaced += reduced.at(q).factorization.kept is not None
        check_differences(reduced, state_derivatives(reduced, q, v2, T), q, v2, T, 1e-8)
    assert replaced == 1


@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # the kernel is not used
def test_joints_with_axes_that_depend_on_their_position_take_differences():
    """Pinocchio's derivatives are wrong for them: the same arm with joints of one degree of freedom is the oracle."""

    def arm(composite):
        model, place = pin.Model(), pin.SE3(pin.rpy.rpyToMatrix(0.3, -0.4, 0.5), np.array([0.2, 0.1, -0.3]))

        def added(parent, first, second, name):
            if composite:
                return model.addJoint(parent, pin.JointModelComposite(first).addJoint(second, place), place, name)
            return model.addJoint(model.addJoint(parent, first, place, name), second, place, f"{name} 2")

        joint = added(0, pin.JointModelRX(), pin.JointModelRY(), "both")
        slide = added(joint, pin.JointModelPX(), pin.JointModelPY(), "slide")  # its axes are constant
        model.appendBodyToJoint(joint, pin.Inertia(2.0, np.array([0.1, 0.4, -0.3]), np.diag([0.2, 0.3, 0.4])), place)
        hand = model.addJoint(slide, pin.JointModelRX(), place, "hand")
        model.addFrame(pin.Frame("tip", hand, place, pin.FrameType.OP_FRAME))
        model.appendBodyToJoint(hand, pin.Inertia(1.0, np.array([0.3, 0.1, 0.2]), np.diag([0.3, 0.2, 0.1])), place)
        return rnc.NonholonomicSystem(rnc.Robot(model), [], np.eye(5)).reduce()

    q, v2, T = np.random.default_rng(5).uniform(-1, 1, (3, 5))
    with pytest.warns(rnc.ModelWarning, match="axes of both depend on the joint's own position"):
        reduced = arm(composite=True)
    chain = arm(composite=False)
    ours, state = reduced.at(q, v2), chain.at(q, v2)
    near(ours.acceleration(T), state.acceleration(T), 1e-12, "accelerations")
    near(ours.G, state.G, 1e-12, "G")
    tip = rnc.NonholonomicSystem(reduced.robot, []).reduce(vertical=[rnc.FramePosition("tip", "x")]).at(q, v2)
    for read in (lambda: ours.C, lambda: ours.V, lambda: reduced.terms(q, v2), lambda: tip.A_star_dot):
        with pytest.raises(rnc.ModelError, match="axes of 'both' depend on its own position; accelerations are known"):
            read()
    tracker = rnc.control.ComputedTorque(reduced, rnc.control.ReducingOutputController(reduced, rnc.planning.Hold(q)))
    rnc.simulate(reduced, tracker, q, duration=0.02, dt=0.01)  # without outputs, a run needs no rates
    found, expected = state_derivatives(reduced, q, v2, T), state_derivatives(chain, q, v2, T)
    assert 0 < found.difference_error < 1e-8
    for each in BLOCKS:
        near(getattr(found, each), getattr(expected, each), 1e-9, each)
