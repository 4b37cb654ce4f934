"""Grip as a limit on multipliers: closed forms, what slows down with time, and references that are slowed."""

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import linprog, minimize

import rnc_pin as rnc
import systems
from rnc_pin.applications.scenario.execution import execute
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.control.whole_body.limit_stack import ContactCones
from rnc_pin.model.rows import Rows
from rnc_pin.planning import MinimumJerk, Slowed, TaskReference
from rnc_pin.simulation import grip_along, within_grip
from systems import random_states, rolling_base
from textbook_systems import BLADE, PLACES, WHEEL, G, cart_robot


@pytest.fixture(scope="module")
def gripping():
    return systems.sleigh()


def test_the_side_force_of_a_sleigh_in_a_steady_turn_is_m_v_w(gripping):
    """Of 2 kg, its center of mass 0.3 m ahead of the blade; a torque keeps the turn steady."""
    grip = rnc.Grip(gripping, friction=0.5)
    q = gripping.robot.configuration({"root_joint": [1.0, 2.0, 0.7]})
    for v, w in ((1.0, 2.0), (3.0, -1.0)):
        expected = 2.0 * abs(v * w)
        np.testing.assert_allclose(grip.used_by(q, [v, w], np.zeros(2)), [expected / (0.5 * 2.0 * G)], rtol=1e-9)
    # The same by itself, without torque: the turn slows down and takes m c^2 / I of it away.
    np.testing.assert_allclose(grip.forces(q, [1.0, 2.0], np.zeros(2)), [4.0 / (1 + 2.0 * 0.3**2 / 0.5)], rtol=1e-9)
    known = rnc.Grip(gripping, friction=0.5, loads={"sleigh": 4.0})
    np.testing.assert_allclose(known.used_by(q, [1.0, 2.0], np.zeros(2)), [2.0], rtol=1e-9)


def test_slower_by_s_it_takes_s_squared_less(gripping):
    grip, generator = rnc.Grip(gripping, friction=0.5), np.random.default_rng(0)
    q = np.stack([gripping.robot.random_configuration(generator) for _ in range(20)])
    v2, v2_dot = generator.normal(size=(2, 20, 2))
    used = grip.used_by(q, v2, v2_dot)
    np.testing.assert_allclose(grip.used_by(q, v2 / 1.7, v2_dot / 1.7**2), used / 1.7**2, rtol=1e-9)


def turn(duration=2.0):
    """A metre and a half turn at once."""
    return MinimumJerk([0.0, 0.0], [1.5, 1.5], duration)


def rolled_out(gripping, reference):
    target = rnc.control.ReducingOutputController(gripping, reference)
    return rnc.kinematic_rollout(gripping, target, gripping.robot.configuration(), reference.duration, 0.02)


def test_a_reference_that_needs_more_than_the_grip_is_told_by_how_much(gripping):
    """At the middle of a quintic rates are 15/8 of the mean: m v w there, while nothing accelerates."""
    grip = rnc.Grip(gripping, friction=0.1)
    needed = grip_along(gripping, grip, *rolled_out(gripping, turn()))
    rate = 1.5 / 2.0 * 15 / 8
    assert needed.used >= rate**2 / (0.1 * G) * 0.99
    np.testing.assert_allclose(needed.time_scale, np.sqrt(needed.used), rtol=1e-6)
    slowed = grip_along(gripping, grip, *rolled_out(gripping, Slowed(turn(), needed.time_scale)))
    np.testing.assert_allclose(slowed.used, 1.0, rtol=2e-2)
    assert "times the grip that 'sleigh' has" in needed.complaints()[0]
    assert not slowed.complaints() or slowed.used < 1.02


def test_preflight_warns_and_the_reference_is_slowed_until_it_holds(gripping):
    task = rnc.Task.of(gripping, list(gripping.reducing.names), [])
    reference, q0 = TaskReference(turn(), rnc.planning.Hold([])), gripping.robot.configuration()
    grip = rnc.Grip(gripping, friction=0.1)

    def follow(reference):
        return rnc.control.ReducingOutputController(gripping, reference.primary)

    slowed = within_grip(gripping, task, reference, q0, grip, controller=follow)
    assert slowed.duration > reference.duration
    needed = grip_along(gripping, grip, *rolled_out(gripping, slowed.primary))
    assert needed.used < 1.01
    assert within_grip(gripping, task, slowed, q0, rnc.Grip(gripping, friction=0.2), controller=follow) is slowed


def test_a_second_factor_is_asked_of_the_slowed_reference(gripping):
    """Demands of an error at the start do not slow down, so that the first factor is not enough."""
    task = rnc.Task.of(gripping, list(gripping.reducing.names), [])
    reference, grip = TaskReference(turn(), rnc.planning.Hold([])), rnc.Grip(gripping, friction=0.02)
    q0 = gripping.robot.configuration({"root_joint": [0.0, 0.0, 0.1]})

    def needed(primary, dt):
        follow = rnc.control.ReducingOutputController(gripping, primary)
        return grip_along(gripping, grip, *rnc.kinematic_rollout(gripping, follow, q0, primary.duration, dt))

    first = needed(reference.primary, 0.02).time_scale
    second = needed(Slowed(reference.primary, first), 0.02 * first).time_scale
    assert second > 1.001
    slowed = within_grip(
        gripping, task, reference, q0, grip,
        controller=lambda r: rnc.control.ReducingOutputController(gripping, r.primary),
    )  # fmt: skip
    assert slowed.duration == pytest.approx(2.0 * first * second, rel=1e-9)
    assert needed(slowed.primary, 0.02 * first * second).used < 1.005


@pytest.mark.parametrize(("friction", "loads", "words"), [
    (0.0, None, "friction: expected a positive number"),
    (0.5, {"slegh": 1.0}, "no gripping contact 'slegh'; did you mean 'sleigh'"),
    (0.5, {"sleigh": 0.0}, "load of 'sleigh' has to be positive"),
    (np.inf, None, "friction: expected a positive number"),
    (np.nan, None, "friction: expected a positive number"),
])  # fmt: skip
def test_what_is_no_grip_is_refused(gripping, friction, loads, words):
    with pytest.raises(rnc.ConfigurationError, match=words):
        rnc.Grip(gripping, friction, loads)


def test_a_scenario_is_warned_of_its_grip_refused_or_slowed():
    """A unicycle whose wheels would slip on ice."""
    quiet = {"comparisons": {}, "simulation.duration": 4.0}
    needed = Scenario.load("unicycle", {**quiet, "grip": {"friction": 0.01}}).experiment.warnings
    assert "times the grip that" in needed[0]
    with pytest.raises(rnc.InfeasibleError, match="times the grip that"):
        Scenario.load("unicycle", {**quiet, "grip": {"friction": 0.01}, "preflight": "refuse"}).build()
    assert not Scenario.load(
        "unicycle", {**quiet, "grip": {"friction": 5.0}, "preflight": "refuse"}
    ).experiment.warnings
    slowed = Scenario.load("unicycle", {**quiet, "grip": {"friction": 0.01, "slow": True}}).build()
    assert "slowed down by a factor of" in slowed.experiment.warnings[0]
    with pytest.raises(rnc.ConfigurationError, match="grip: requires a controller over a velocity tracker"):
        Scenario.load("mobile-manipulator-two-phase", {**quiet, "grip": {"friction": 0.5}}).build()


@pytest.mark.parametrize(("grip", "word"), [({"friction": 0.1}, "failed"), ({"friction": 0.2}, "succeeded")])
def test_a_run_that_needs_more_than_the_stated_friction_fails(grip, word):
    """It once succeeded: only the references were compared.

    The ground pushes the robot at its one wheel: along the ground, this force is the rate of the momentum.
    """
    made = Scenario.load("unicycle", {"comparisons": {}, "plots": {}, "simulation.duration": 3.0, "grip": grip}).build()
    run = execute(made).trajectory
    assert run.verdict.word == word
    robot = made.experiment.reduced.robot
    weight = -robot.model.gravity.linear[2] * pin.computeTotalMass(robot.model)
    forces, data = [], robot.model.createData()
    acceleration = np.gradient(run.v, run.time, axis=0)
    for q, v, a in zip(run.q, run.v, acceleration, strict=True):
        pin.computeCentroidalMomentumTimeVariation(robot.model, data, q, v, a)
        forces.append(np.linalg.norm(data.dhg.linear[:2]))
    needed = max(forces[1:-1]) / (grip["friction"] * weight)
    found = [each for each in run.verdict.findings if each.kind == "slip"]
    assert bool(found) == (needed > 1.0)
    if found:
        assert (found[0].where, found[0].amount) == ("wheel", pytest.approx(needed, rel=0.01))


def test_factors_by_which_a_scenario_slows_references_multiply():
    """One factor is not quite enough on this ground, and the next is asked of what is slowed already.

    Forces of inertia fall with the square: on a ground that grips a quarter as well everything takes twice as long.
    """
    made, factors = {}, {}
    for friction in (0.005, 0.02):
        changes = {"comparisons": {}, "simulation.duration": 4.0, "grip.friction": friction, "grip.slow": True}
        made[friction] = Scenario.load("unicycle", changes).experiment
        (said,) = made[friction].warnings  # and nothing of wheels that slip
        factors[friction] = float(said.split("by a factor of ")[1].split(" so")[0])
    assert factors[0.005] == pytest.approx(2 * factors[0.02], rel=0.01)
    each = made[0.02]
    run = rnc.simulate(each.reduced, each.controller, each.q0, 4.0 * factors[0.02], 0.01)
    used = rnc.Grip(each.reduced, 0.02).used_by(run.q, run.v2, np.gradient(run.v2, 0.01, axis=0))
    assert 0.9 < used.max() < 1.0


class TwoCasters(Rows):
    """A bar with a caster at both ends, as a constraint of a user's own: two rows that carry."""

    holonomic = (True, True)
    on_ground = True
    units = ("m/s", "m/s")

    def bind(self, robot):
        self.parts = [rnc.Caster(name, WHEEL).bind(robot) for name in ("nose", "tail")]
        self.names = ("front", "back")
        return self

    def jacobian(self, at):
        return np.concatenate([part.jacobian(at) for part in self.parts], axis=-2)

    def jacobian_dot(self, at):
        return np.concatenate([part.jacobian_dot(at) for part in self.parts], axis=-2)

    def bias_acceleration(self, at):
        return np.concatenate([part.bias_acceleration(at) for part in self.parts], axis=-1)

    def residual(self, at):
        return np.concatenate([part.residual(at) for part in self.parts], axis=-1)

    def lines_of_action(self, at):
        both = [part.lines_of_action(at) for part in self.parts]
        return tuple(np.concatenate(each, axis=-2) for each in zip(*both, strict=True))


class Wheel:
    """A wheel under a name of a user's own, which says of no frame that it is its."""

    def bind(self, robot):
        return rnc.RollingWheel("b", WHEEL).bind(robot)


def test_a_bar_of_two_casters_carries_as_two_do():
    robot = cart_robot()
    wheel = rnc.RollingWheel("a", WHEEL)
    apart = [wheel, rnc.Caster("nose", WHEEL), rnc.Caster("tail", WHEEL)]
    q = robot.configuration({"root_joint": (0.3, -0.2, 1.1), "mast": 0.8})
    loads = []
    for rows in (apart, [wheel, TwoCasters()]):
        reduced = rnc.NonholonomicSystem(robot, rows).reduce()
        loads.append(rnc.Grip(reduced, 0.5).loads(q, np.zeros(reduced.r), np.zeros(0)))
    assert loads[0] > 1.0
    np.testing.assert_allclose(loads[1], loads[0], rtol=1e-12)


def test_a_wheel_without_a_frame_has_the_name_of_its_first_row():
    reduced = rnc.NonholonomicSystem(cart_robot(), [rnc.Caster("nose", WHEEL), Wheel()]).reduce()
    assert rnc.Grip(reduced, 0.5).names == ("rolling(b)",)


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
    v = reduced.at(q, v2).v
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


def test_a_loop_grips_no_ground():
    """Its rows act on points, and keep a position."""
    with pytest.raises(rnc.ConfigurationError, match="no contact of this system grips the ground by friction"):
        rnc.Grip(systems.four_bar(), 0.5)


def test_accelerations_ask_for_the_grip_of_the_inputs_that_give_them():
    reduced, generator = cart(), np.random.default_rng(7)
    grip = rnc.Grip(reduced, 0.5)
    for q, v2 in random_states(reduced, 3):
        T = generator.normal(size=2)
        v2_dot = reduced.forward_dynamics(q, v2, T)
        np.testing.assert_allclose(grip.used_by(q, v2, v2_dot).max(), grip.used(q, v2, T).max(), rtol=1e-7)


def test_a_robot_on_two_wheels_skids_on_a_circle_at_the_root_of_mu_g_rho():
    """Both wheels skid together: the outer one has more load and takes more of the force.

    The load of one wheel is m (g / 2 -+ v^2 h / (rho track)): an evenly shared force would skid there earlier.
    """
    friction, rho, height, track = 0.5, 2.0, 0.3, 0.4
    reduced = systems.on_two_wheels(height=height, track=track)
    grip, q = rnc.Grip(reduced, friction), reduced.robot.configuration({"root_joint": (1.0, -2.0, 0.7)})
    evenly = np.sqrt(rho * friction * G / (1 + 2 * friction * height / track))
    speeds = np.array([1.0, evenly, 3.1, np.sqrt(friction * G * rho), 3.2])
    v2 = np.stack([speeds, speeds / rho], axis=1)
    used = grip.used(np.tile(q, (5, 1)), v2, np.zeros((5, 2)))
    np.testing.assert_allclose(used, np.tile(speeds[:, None] ** 2 / (friction * G * rho), 2), rtol=1e-7)
    assert grip.is_choice(q).tolist() == [True, True]
    forces, loads = (of(q, v2[1], np.zeros(2)) for of in (grip.forces, grip.loads))
    assert (forces / (friction * loads)).max() == pytest.approx(1.0, rel=1e-7)
    inner = 10.0 * (G / 2 - speeds[1] ** 2 * height / (rho * track))
    np.testing.assert_allclose(loads.min(), inner, rtol=1e-6)


def least_largest_share(torques, friction):
    """Of the car of ``on_four_wheels`` at rest: Newton and Euler for one body, and a solver for smooth programs."""
    mass = 20.0
    center = np.array([0.05, 0.02, 0.1 + WHEEL])
    places = np.array([[*xy, 0.0] for xy in systems.CORNERS.values()])
    driving = np.asarray(torques) / WHEEL
    inertial = np.array([driving.sum(), 0.0, mass * G])  # force of the ground

    def forces(z):
        return np.stack([driving, z[:4], z[4:8]], axis=1)

    def balance(z):
        each = forces(z)
        moment = np.cross(places - center, each).sum(axis=0)
        return np.concatenate([(each.sum(axis=0) - inertial)[1:], moment])

    def room(z):
        return z[8] * friction * z[4:8] - np.linalg.norm(forces(z)[:, :2], axis=1)

    start = np.concatenate([np.zeros(4), np.full(4, mass * G / 4), [2.0]])
    constraints = [
        {"type": "eq", "fun": balance},
        {"type": "ineq", "fun": room},
        {"type": "ineq", "fun": lambda z: z[4:8]},
    ]
    found = minimize(
        lambda z: z[8], start, constraints=constraints, method="SLSQP", options={"ftol": 1e-13, "maxiter": 900}
    )
    # Rounding may end the line search before the last digits; the comparison needs five of them, at a feasible point.
    assert found.success or found.status == 8
    assert np.abs(balance(found.x)).max() < 1e-8
    assert min(room(found.x).min(), found.x[4:8].min()) > -1e-8
    return found.x[8]


def test_four_wheels_share_weight_and_side_forces_so_that_the_largest_share_is_least():
    reduced, friction = systems.on_four_wheels(), 0.6
    grip, q = rnc.Grip(reduced, friction), reduced.robot.configuration()
    assert grip.is_choice(q).all()
    for torques in ([1.0, 1.0, 1.0, 1.0], [3.0, 0.0, 0.0, 0.0], [2.0, -1.0, 0.5, 0.3], [0.0, 0.0, 4.0, 1.0]):
        least = least_largest_share(torques, friction)
        assert grip.used(q, np.zeros(1), np.array(torques)).max() == pytest.approx(least, rel=1e-5)
        even = grip.forces(q, np.zeros(1), np.array(torques)) / (
            friction * grip.loads(q, np.zeros(1), np.array(torques))
        )
        assert even.max() > least


def test_the_program_of_whole_body_control_has_the_same_forces():
    """Its pyramids lie inside the cones: feasible above the share divided by the cosine, infeasible below the share."""
    reduced, generator = systems.on_four_wheels(), np.random.default_rng(2)
    q = reduced.robot.configuration()
    for T in generator.normal(size=(5, 4)):
        share = rnc.Grip(reduced, 1.0).used(q, np.zeros(1), T).max()
        for friction, feasible in ((0.999 * share, False), (1.001 * share / np.cos(np.pi / 8), True)):
            bounds = ContactCones(reduced, friction).at(reduced.at(q, np.zeros(1)))
            room = bounds.upper - bounds.rows[:, :4] @ T
            free = bounds.rows[:, 4:]
            found = linprog(np.zeros(free.shape[1]), free, room, bounds=(None, None))
            assert (found.status == 0) == feasible
