"""Analyses of odd robots, whole results at once: beside the mechanics written out, and at limits from both sides."""

import numpy as np
import pinocchio as pin
import pytest
import scipy.linalg
import scipy.optimize

import rnc_pin as rnc
import systems
from rnc_pin.analysis.equilibrium import _Search
from systems import random_states, rolling_base
from textbook_systems import BLADE, PLACES, WHEEL, G, cart_robot, hanging_chain, wheeled_pendulum

# ---------------------------------------------------------------------- grip


def cart(base="planar", gravity=-G):
    """Rows that act on no point come first, wheels last; one wheel skids, and a blade helps the other.

    Its contacts are b (rolling and lateral), the blade of the base, and a (rolling).
    """
    robot = cart_robot(base, gravity)
    gear = np.zeros((1, robot.nv))
    gear[0, robot.velocity_indices("mast")], gear[0, robot.velocity_indices("b_spin")] = 1.0, -0.2
    rows = [
        rnc.Pfaffian(lambda q: gear, lambda q, v: 0 * gear, ["gear"]),
        rnc.Caster("nose", WHEEL),
        rnc.RollingWheel("b", WHEEL),
        rnc.NoSideSlip("base", at=tuple(BLADE)),
        rnc.Caster("tail", WHEEL),
        rnc.RollingWheel("a", WHEEL, lateral=False),
    ]
    rows = rows if base == "planar" else [rows[0], *rows[2:3], rows[5], rows[1]]
    system = rnc.NonholonomicSystem(robot, rows, ["a_spin", "b_spin"])
    return system.reduce([rnc.FrameSpeed("base"), rnc.FrameAngularVelocity("base", "z")])


def by_name(reduced, q, v2, T):
    """Multipliers by name of their row, from the balance of Newton and Euler: the least ones."""
    robot = reduced.robot
    v = reduced.velocity(q, v2)
    a = reduced.at(q, v2).v_dot(reduced.forward_dynamics(q, v2, T))
    B = np.zeros((robot.nv, 2))
    B[robot.velocity_indices("a_spin"), 0] = B[robot.velocity_indices("b_spin"), 1] = 1.0
    left = B @ T - pin.rnea(robot.model, robot.model.createData(), q, v, a)
    rows = reduced.at(q).all_rows
    found = np.linalg.pinv(rows.T, rcond=1e-9) @ left
    np.testing.assert_allclose(rows.T @ found, left, atol=1e-8 * (1 + np.abs(left).max()))
    return dict(zip(reduced.all_constraints.names, found, strict=True))


def resting(robot, q, names):
    """Forces of least norm at rest that carry the weight and its moment, by name.

    The blade of the base has no width: it takes a couple about its heading, too.
    """
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, q)
    base = data.oMf[robot.frame_id("base")]
    points = {name: data.oMf[robot.frame_id(name)].translation for name in PLACES} | {"base": base.act(BLADE)}
    center = pin.centerOfMass(robot.model, data, q)
    balance = np.vstack([np.ones(len(names)), np.stack([(points[name] - center)[:2] for name in names], axis=-1)])
    if "base" in names:
        spread = np.sqrt(np.stack([points[name][:2] for name in names]).var(axis=0).sum())
        hx, hy = base.rotation[:2, 0]
        balance = np.column_stack([balance, spread * np.array([0.0, -hy, hx])])
    weight = G * sum(inertia.mass for inertia in list(robot.model.inertias)[1:])
    share = (np.linalg.pinv(balance) @ [1.0, 0.0, 0.0])[: len(names)]
    return dict(zip(names, weight * share, strict=True))


def test_the_grip_of_a_cart_is_that_of_its_rows_and_of_statics():
    """Whatever stands ahead of a contact's rows, and wherever the mast leans: over (2, 3) states."""
    reduced, friction = cart(), 0.7
    grip, robot = rnc.Grip(reduced, friction), reduced.robot
    assert grip.names == ("b", "base", "a")
    generator = np.random.default_rng(4)
    q = np.stack([[robot.random_configuration(generator) for _ in range(3)] for _ in range(2)])
    v2, T = generator.normal(size=(2, 2, 3, 2))
    forces, loads = np.empty((2, 2, 3, 3))
    for i in np.ndindex(2, 3):
        rows = by_name(reduced, q[i], v2[i], T[i])
        sideways = rows["lateral(b)"], next(value for name, value in rows.items() if "no_side_slip" in name)
        forces[i] = np.hypot(rows["rolling(b)"], sideways[0]), abs(sideways[1]), abs(rows["rolling(a)"])
        carried = resting(robot, q[i], ("b", "base", "a", "nose", "tail"))
        loads[i] = [carried[name] for name in grip.names]
    assert loads.min() > 1.0
    still = np.zeros_like(v2)
    np.testing.assert_allclose(grip.forces(q, v2, T), forces, rtol=1e-7)
    np.testing.assert_allclose(grip.loads(q, still, 0.0 * T), loads, rtol=1e-7)
    np.testing.assert_allclose(grip.used(q, v2, T), forces / (friction * grip.loads(q, v2, T)), rtol=1e-7)
    known = rnc.Grip(reduced, friction, {"a": 0.4})
    np.testing.assert_allclose(known.loads(q, still, 0.0 * T)[..., :2], loads[..., :2], rtol=1e-7)
    np.testing.assert_array_equal(known.loads(q, v2, T)[..., 2], 0.4)


@pytest.mark.parametrize("heading", [0.3, 2.0])
def test_a_support_that_would_pull_carries_nothing(heading):
    """The mast's weight far out: one of three supports would have to pull; the load is nothing there."""
    robot = cart_robot()
    mast = robot.model.getJointId("mast")
    robot.model.inertias[mast] = pin.Inertia(60.0, np.array([0.9, 0.0, 0.2]), np.eye(3))
    reduced = rnc.NonholonomicSystem(
        robot, [rnc.Caster("tail", WHEEL), rnc.RollingWheel("a", WHEEL, lateral=False), rnc.RollingWheel("b", WHEEL)]
    ).reduce()
    q = robot.configuration({"root_joint": (1.0, -2.0, 0.7), "mast": heading})
    carried = resting(robot, q, ("a", "b", "tail"))
    assert min(carried.values()) < 0.0
    grip = rnc.Grip(reduced, 0.5)
    loads = grip.loads(q, np.zeros(reduced.r), np.zeros(0))
    np.testing.assert_allclose(loads, np.maximum([carried["a"], carried["b"]], 0.0), rtol=1e-9, atol=1e-12)
    normal = grip.normal.at(reduced.at(q, np.zeros(reduced.r)), np.zeros(0))
    for name, force in zip(grip.normal.names, normal, strict=True):
        np.testing.assert_allclose(force, carried[name], rtol=1e-9)


def test_two_supports_balance_what_they_can():
    """Both wheels of an axle, their weight beside it: nothing balances it across, and along the axle levers do."""
    robot = rnc.Robot(rolling_base({"l": (0.0, 0.3), "r": (0.0, -0.3)}, WHEEL))
    wheels = [rnc.RollingWheel(name, WHEEL) for name in "lr"]
    reduced = rnc.NonholonomicSystem(robot, wheels).reduce()
    left = 0.5 + 20.0 * 0.02 / 23.0 / 0.6  # of the weight: 20 kg stand 0.02 m to the left, two wheels of 1.5 kg
    loads = rnc.Grip(reduced, 0.5).loads(robot.configuration(), np.zeros(reduced.r), np.zeros(0))
    np.testing.assert_allclose(loads, 23.0 * G * np.array([left, 1 - left]), rtol=1e-9)


def test_wheels_of_a_free_base_carry_what_their_vertical_rows_do():
    """In a turn too, in which the inner one lifts off: then it has no grip, whatever it needs."""
    reduced, friction = cart("free"), 0.4
    grip, generator = rnc.Grip(reduced, friction), np.random.default_rng(1)
    assert grip.names == ("b", "a")
    q = np.stack(
        [reduced.assembled(reduced.robot.configuration({"mast": angle}))[None] for angle in (0.3, 2.0, -1.0)], 1
    )
    v2, T = np.array([[1.0, 0.2], [-0.5, 0.6], [3.0, 3.0]])[None], generator.normal(size=(1, 3, 2))
    loads, forces = grip.loads(q, v2, T), grip.forces(q, v2, T)
    assert loads.shape == forces.shape == (1, 3, 2)
    for k in range(3):
        rows = by_name(reduced, q[0, k], v2[0, k], T[0, k])
        np.testing.assert_allclose(
            loads[0, k], [max(-rows["vertical(b)"], 0.0), max(-rows["vertical(a)"], 0.0)], rtol=1e-6, atol=1e-9
        )
        np.testing.assert_allclose(
            forces[0, k], [np.hypot(rows["rolling(b)"], rows["lateral(b)"]), abs(rows["rolling(a)"])], rtol=1e-6
        )
    assert loads[0, :2].min() > 10.0
    lifted = loads == 0
    assert lifted.sum() == 1
    used = grip.used(q, v2, T)
    assert np.isinf(used[lifted]).all()
    np.testing.assert_allclose(used[~lifted], forces[~lifted] / (friction * loads[~lifted]), rtol=1e-12)


@pytest.mark.parametrize("gravity", [0.0, 3.0])
def test_without_weight_nothing_grips_that_has_to(gravity):
    """No gravity, or one that lifts: loads are zero; at rest none is asked for."""
    reduced = cart(gravity=gravity)
    grip, q = rnc.Grip(reduced, 0.5), reduced.robot.configuration({"mast": 0.2})
    rest = np.zeros(2)
    assert grip.loads(q, rest, rest).tolist() == [0.0] * 3
    assert grip.used(q, rest, rest).tolist() == [0.0] * 3
    assert grip.used(q, [0.5, 0.8], [0.3, 0.1]).tolist() == [np.inf] * 3


@pytest.mark.parametrize(("friction", "loads"), [(np.inf, None), (np.nan, None), (0.5, {"a": 0.0}), (-0.1, None)])
def test_grip_has_limits(friction, loads):
    with pytest.raises(rnc.ConfigurationError, match="has to be positive"):
        rnc.Grip(cart(), friction, loads)


def test_a_loop_grips_no_ground():
    """Its rows act on points, and keep a position."""
    with pytest.raises(rnc.ConfigurationError, match="no contact of this system grips the ground by friction"):
        rnc.Grip(systems.four_bar(), 0.5)


class Skate:
    """A blade of one's own making: it says of no frame that it is its."""

    def bind(self, robot):
        return rnc.NoSideSlip("base").bind(robot)


def test_a_contact_without_a_frame_has_the_name_of_its_row():
    reduced = rnc.NonholonomicSystem(cart_robot(), [rnc.Caster("nose", WHEEL), Skate()]).reduce()
    assert rnc.Grip(reduced, 0.5).names == ("no_side_slip(base.y)",)


def test_accelerations_ask_for_the_grip_of_the_inputs_that_give_them():
    reduced, generator = cart(), np.random.default_rng(7)
    grip = rnc.Grip(reduced, 0.5)
    for q, v2 in random_states(reduced, 3):
        T = generator.normal(size=2)
        v2_dot = reduced.forward_dynamics(q, v2, T)
        np.testing.assert_allclose(grip.used_by(q, v2, v2_dot), grip.used(q, v2, T), rtol=1e-7)


# ---------------------------------------------------------------------- equilibria


def test_a_fast_turn_is_steady_too():
    """Whoever stands 0.45 m above the axle is thrown out, until weight and centrifugal force balance."""
    reduced = wheeled_pendulum()
    v2 = np.array([0.0, 0.0, 7.0])
    found = rnc.equilibrium(reduced, reduced.robot.configuration({"pitch": 1.2}), v2=v2)
    np.testing.assert_allclose(reduced.forward_dynamics(found.q, v2, found.T), 0, atol=1e-7)
    assert found.residual < 1e-7


@pytest.mark.parametrize(("guess", "hold"), [((0.5, 0.9, -0.4), ()), ((-0.6, 0.3, 1.4), ()), ((0.5, 0.9, -0.4), (1,))])
def test_of_a_surface_of_equilibria_the_nearest_is_found(guess, hold):
    """A chain with a free first hinge rests with its centre of mass below that: the rest is a constrained minimum."""
    reduced = hanging_chain(["hinge_1", "hinge_2"])
    found = rnc.equilibrium(reduced, guess, hold=[f"hinge_{k}" for k in hold])

    def across(q):
        return np.array([2.5, 1.5, 0.5]) @ np.sin(np.cumsum(q))

    kept = [{"type": "eq", "fun": lambda q, k=k: q[k] - guess[k]} for k in hold]
    expected = scipy.optimize.minimize(
        lambda q: np.sum((q - guess) ** 2),
        guess,
        constraints=[{"type": "eq", "fun": across}, *kept],
        options={"ftol": 1e-14},
        method="SLSQP",
    )
    np.testing.assert_allclose(found.q, expected.x, atol=1e-5)
    np.testing.assert_allclose(across(found.q), 0, atol=1e-9)
    q = np.cumsum(found.q)  # weights below a hinge, with their levers
    expected_T = [G * (1.5 * np.sin(q[1]) + 0.5 * np.sin(q[2])), G * 0.5 * np.sin(q[2])]
    np.testing.assert_allclose(found.T, expected_T, atol=1e-8)


def test_of_inputs_that_hold_the_smallest_are_taken():
    """Three drives on two hinges, of unlike inertias."""
    B = np.array([[1.0, 0.5, -2.0], [0.0, 1.0, 3.0]])
    reduced = hanging_chain(B, 2)
    found = rnc.equilibrium(reduced, [0.4, -1.1])
    np.testing.assert_array_equal(found.q, [0.4, -1.1])
    needed = G * np.array([1.5 * np.sin(0.4) + 0.5 * np.sin(-0.7), 0.5 * np.sin(-0.7)])
    np.testing.assert_allclose(found.T, np.linalg.pinv(B) @ needed, atol=1e-9)
    assert found.residual < 1e-9


def test_what_does_not_rest_says_by_how_much():
    """All joints held but one that cannot help: the rate of the last hinge, to three digits."""
    reduced = hanging_chain([], 2)
    q = np.array([0.2, 1.9])
    rates = reduced.forward_dynamics(q, np.zeros(2), np.zeros(0))
    worst = int(np.argmax(np.abs(rates)))
    with pytest.raises(rnc.ConstraintError) as told:
        rnc.equilibrium(reduced, q, hold=["hinge_0", "hinge_1"])
    assert str(told.value) == (
        "no equilibrium found near the guess: at best the rate of "
        f"'{reduced.reducing.names[worst]}' changes by {rates[worst]:.3g} a second"
    )


def test_a_gap_that_stays_is_told_in_metres():
    """Every joint of an open loop held: the larger of the distances of its ends, and the row it is of."""
    robot = systems.four_bar().robot
    closure = rnc.LoopClosure("coupler_tip", "rocker_tip", "point")
    reduced = rnc.NonholonomicSystem(robot, [closure]).reduce([rnc.JointPosition("crank")])
    for crank, rocker in ((1.0, 2.2), (0.2, 1.5)):
        q = robot.configuration({"crank": crank, "coupler": -0.4, "rocker": rocker})
        data = robot.model.createData()
        pin.framesForwardKinematics(robot.model, data, q)
        a, b = (data.oMf[robot.frame_id(name)] for name in ("coupler_tip", "rocker_tip"))
        gap = np.abs(a.rotation.T @ (b.translation - a.translation))[[0, 2]]
        assert np.ptp(gap) > 0.01
        with pytest.raises(rnc.ConstraintError) as told:
            rnc.equilibrium(reduced, q, hold=robot.joint_names)
        said = f"closure_{'xz'[int(np.argmax(gap))]}(coupler_tip, rocker_tip) is left {gap.max():.3g} from zero"
        assert str(told.value).endswith(f", and {said}")


def driven_bicycle():
    """One that nothing keeps upright."""
    robot = systems.bicycle().robot
    wheels = [rnc.RollingWheel("rear", 0.3), rnc.RollingWheel("front", 0.3)]
    return rnc.NonholonomicSystem(robot, wheels, ["rear_wheel"]).reduce()


@pytest.mark.parametrize(
    "make",
    [wheeled_pendulum, lambda: hanging_chain(["hinge_1", "hinge_2"]), systems.four_bar, driven_bicycle],
    ids=["pendulum on wheels", "chain", "four-bar", "bicycle"],
)
def test_a_step_towards_an_equilibrium_is_that_of_newton(make):
    """Far from one, moving, loops open: forces that inputs do not reach vanish to first order, and so do gaps."""
    reduced = make()
    model, generator = reduced.robot.model, np.random.default_rng(5)
    q = reduced.robot.random_configuration(generator, 0.4)
    v2, free = 0.6 * generator.normal(size=reduced.r), np.ones(reduced.n, dtype=bool)
    free[-1] = False
    search = _Search(reduced, v2, free, q)
    here = search._at(q)
    state = reduced.at(q, v2)
    scale = 1 / np.sqrt(np.diag(state.H))
    influence = scale[:, None] * state.input_matrix
    np.testing.assert_allclose(influence.T @ here.force, 0, atol=1e-9)  # T leaves the least
    np.testing.assert_allclose(here.force, scale * (state.H @ here.v2_dot), atol=1e-9)
    np.testing.assert_allclose(here.v2_dot, reduced.forward_dynamics(q, v2, here.T), atol=1e-9)
    step, basis = search._newton(here)
    unreached = scipy.linalg.null_space(influence.T)

    def left(p):
        moved = reduced.at(p, v2)
        force = unreached.T @ (scale * (moved.H @ moved.v2_dot(here.T)))
        return np.concatenate([force, reduced.assembly.residual(p)[reduced.assembly.leading]])

    assert np.abs(left(q)).max() > 0.1
    h = 1e-5

    def along(way):
        return (left(pin.integrate(model, q, h * way)) - left(pin.integrate(model, q, -h * way))) / (2 * h)

    np.testing.assert_allclose(along(step), -left(q), atol=1e-5 * (1 + np.abs(left(q)).max()))
    assert step[-1] == 0.0
    np.testing.assert_allclose(basis.T @ basis, np.eye(basis.shape[1]), atol=1e-12)
    for way in basis.T:
        np.testing.assert_allclose(along(way), 0, atol=1e-5)
    assert basis.shape[1] == reduced.n - 1 - len(left(q))
    np.testing.assert_allclose(basis.T @ step, 0, atol=1e-9)  # no longer than it has to be
