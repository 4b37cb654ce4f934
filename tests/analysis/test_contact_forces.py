"""Grip as a limit on multipliers: closed forms, what slows down with time, and references that are slowed."""

from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import linprog, minimize

import rnc_pin as rnc
import systems
from rnc_pin.applications.scenario.execution import execute
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.motion.whole_body.limit_stack import ContactCones
from rnc_pin.simulation import judge
from rnc_pin.simulation.preflight import RolloutEvaluation, friction_demand
from simple_controllers import Inputs
from systems import rolling_base
from textbook_systems import BLADE, PLACES, WHEEL, G, cart_robot


@pytest.fixture(scope="module")
def gripping():
    return systems.sleigh()


def loads_of(grip, reduced, q, v2, T):
    """Loads of the contacts that grip, of least norm; zero where the ground would have to pull."""
    normal = np.maximum(grip.normal.at(reduced.at(q, v2), T), 0.0)
    return normal[..., [grip.normal.names.index(name) for name in grip.names]]


def test_the_side_force_of_a_sleigh_in_a_steady_turn_is_m_v_w(gripping):
    """Of 2 kg; a torque keeps the turn steady."""
    grip = rnc.Grip(gripping, friction=0.5)
    q = gripping.robot.configuration({"root_joint": [1.0, 2.0, 0.7]})
    for v, w in ((1.0, 2.0), (3.0, -1.0)):
        state = gripping.at(q, [v, w])
        found = grip.used_at(state, state.allocate(state.inverse_dynamics(np.zeros(2))))
        np.testing.assert_allclose(found, [2.0 * abs(v * w) / (0.5 * 2.0 * G)], rtol=1e-9)


def turn(duration=2.0):
    """A metre and a half turn at once."""
    return rnc.planning.MinimumJerk([0.0, 0.0], [1.5, 1.5], duration)


def rolled_out(gripping, reference):
    target = rnc.control.ReducingOutputController(gripping, reference)
    path = rnc.kinematic_rollout(gripping, target, gripping.robot.configuration(), reference.duration, 0.02)
    return RolloutEvaluation(gripping, *path)


def test_a_reference_that_needs_more_than_the_grip_is_told_by_how_much(gripping):
    """At the middle of a quintic rates are 15/8 of the mean: m v w there, while nothing accelerates."""
    grip = rnc.Grip(gripping, friction=0.1)
    needed = friction_demand(rolled_out(gripping, turn()), grip)
    rate = 1.5 / 2.0 * 15 / 8
    assert needed.used >= rate**2 / (0.1 * G) * 0.99
    np.testing.assert_allclose(needed.time_scale, np.sqrt(needed.used), rtol=1e-6)
    slowed = friction_demand(rolled_out(gripping, turn(2.0 * needed.time_scale)), grip)
    np.testing.assert_allclose(slowed.used, 1.0, rtol=2e-2)
    assert "times the grip that 'sleigh' has" in needed.complaints()[0]
    assert not slowed.complaints() or slowed.used < 1.02


@pytest.mark.parametrize("friction", [0.0, np.inf, np.nan])
def test_what_is_no_grip_is_refused(gripping, friction):
    with pytest.raises(rnc.ConfigurationError, match="friction: expected a positive number"):
        rnc.Grip(gripping, friction)
    with pytest.raises(rnc.ConfigurationError, match="no contact of this system grips the ground by friction"):
        rnc.Grip(systems.four_bar(), 0.5)


def test_a_scenario_is_warned_of_its_grip_or_refused():
    quiet = {"comparisons": {}, "simulation.duration": 4.0}
    needed = Scenario.load("unicycle", {**quiet, "grip": {"friction": 0.01}}).experiment.warnings
    assert "times the grip that" in needed[0]
    with pytest.raises(rnc.InfeasibleError, match="times the grip that"):
        Scenario.load("unicycle", {**quiet, "grip": {"friction": 0.01}, "preflight": "refuse"}).build()
    good = {**quiet, "grip": {"friction": 5.0}, "preflight": "refuse"}
    assert not Scenario.load("unicycle", good).experiment.warnings
    with pytest.raises(rnc.ConfigurationError, match="grip: requires a controller over a velocity tracker"):
        Scenario.load("mobile-manipulator-two-phase", {**quiet, "grip": {"friction": 0.5}}).build()


@pytest.mark.parametrize(("grip", "word"), [({"friction": 0.1}, "failed"), ({"friction": 0.2}, "succeeded")])
def test_a_run_that_needs_more_than_the_stated_friction_fails(grip, word):
    made = Scenario.load("unicycle", {"comparisons": {}, "plots": {}, "simulation.duration": 3.0, "grip": grip}).build()
    run = execute(made).trajectory
    assert run.verdict.word == word
    robot = made.experiment.reduced.robot
    weight = -robot.model.gravity.linear[2] * pin.computeTotalMass(robot.model)
    forces, data = [], robot.model.createData()
    for q, v, a in zip(run.q, run.v, np.gradient(run.v, run.time, axis=0), strict=True):
        pin.computeCentroidalMomentumTimeVariation(robot.model, data, q, v, a)
        forces.append(np.linalg.norm(data.dhg.linear[:2]))
    needed = max(forces[1:-1]) / (grip["friction"] * weight)
    found = [each for each in run.verdict.findings if each.kind == "slip"]
    assert bool(found) == (needed > 1.0)
    if found:
        assert (found[0].where, found[0].amount) == ("wheel", pytest.approx(needed, rel=0.01))


@pytest.mark.parametrize(("friction", "word"), [(0.07, "failed"), (0.09, "succeeded")])
def test_a_contact_that_needs_the_most_friction_between_two_samples_is_judged_there(gripping, friction, word):
    """One sample of 0.4 s beside forty of the same motion: the side force rises and falls within it."""
    grip, q0 = rnc.Grip(gripping, friction), gripping.robot.configuration()
    inputs = Inputs(lambda t: [4.0, -1.0])
    coarse, fine = (rnc.simulate(gripping, inputs, q0, 0.4, dt, v2_0=[0.5, 2.0]) for dt in (0.4, 0.01))
    most = [grip.used_by_forces(run.q, run.contact_forces, run.normal_forces).max() for run in (coarse, fine)]
    assert most[0] < 1.0
    verdict = judge(coarse, grip=grip)
    assert verdict.word == word
    assert [each.amount for each in verdict.findings] == [pytest.approx(most[1], rel=0.02)] * (word == "failed")


def test_a_wheel_without_a_frame_has_the_name_of_its_first_row():
    mine = SimpleNamespace(bind=rnc.RollingWheel("b", WHEEL).bind)  # it says of no frame that it is its
    reduced = rnc.NonholonomicSystem(cart_robot(), [rnc.Caster("nose", WHEEL), mine]).reduce()
    assert rnc.Grip(reduced, 0.5).names == ("rolling(b)",)


def cart(base="planar", gravity=-G):
    """Rows that act on no point come first, wheels last: b (rolling, lateral), the blade of the base, a (rolling)."""
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


def resting(robot, q, names):
    """Forces of least norm at rest by name; the blade has no width: it takes a couple about its heading, too."""
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


def test_loads_of_a_cart_are_those_of_statics():
    """Whatever stands ahead of a contact's rows, and wherever the mast leans: over (2, 3) states."""
    reduced = cart()
    grip, robot = rnc.Grip(reduced, 0.7), reduced.robot
    assert grip.names == ("b", "base", "a")
    generator = np.random.default_rng(4)
    q = np.stack([[robot.random_configuration(generator) for _ in range(3)] for _ in range(2)])
    loads = np.empty((2, 3, 3))
    for i in np.ndindex(2, 3):
        carried = resting(robot, q[i], ("b", "base", "a", "nose", "tail"))
        loads[i] = [carried[name] for name in grip.names]
    assert loads.min() > 1.0
    rest = np.zeros((2, 3, 2))
    np.testing.assert_allclose(loads_of(grip, reduced, q, rest, rest), loads, rtol=1e-7)


@pytest.mark.parametrize("heading", [0.3, 2.0])
def test_a_support_that_would_pull_carries_nothing(heading):
    robot = cart_robot()
    mast = robot.model.getJointId("mast")
    robot.model.inertias[mast] = pin.Inertia(60.0, np.array([0.9, 0.0, 0.2]), np.eye(3))
    wheels = [rnc.RollingWheel("a", WHEEL, lateral=False), rnc.RollingWheel("b", WHEEL)]
    reduced = rnc.NonholonomicSystem(robot, [rnc.Caster("tail", WHEEL), *wheels]).reduce()
    q = robot.configuration({"root_joint": (1.0, -2.0, 0.7), "mast": heading})
    carried = resting(robot, q, ("a", "b", "tail"))
    assert min(carried.values()) < 0.0
    grip = rnc.Grip(reduced, 0.5)
    loads = loads_of(grip, reduced, q, np.zeros(reduced.r), np.zeros(0))
    np.testing.assert_allclose(loads, np.maximum([carried["a"], carried["b"]], 0.0), rtol=1e-9, atol=1e-12)
    normal = grip.normal.at(reduced.at(q, np.zeros(reduced.r)), np.zeros(0))
    for name, force in zip(grip.normal.names, normal, strict=True):
        np.testing.assert_allclose(force, carried[name], rtol=1e-9)


def test_two_supports_balance_what_they_can():
    """Both wheels of an axle, their weight beside it: nothing balances it across, and along the axle levers do."""
    robot = rnc.Robot(rolling_base({"l": (0.0, 0.3), "r": (0.0, -0.3)}, WHEEL))
    reduced = rnc.NonholonomicSystem(robot, [rnc.RollingWheel(name, WHEEL) for name in "lr"]).reduce()
    left = 0.5 + 20.0 * 0.02 / 23.0 / 0.6  # of the weight: 20 kg stand 0.02 m to the left, two wheels of 1.5 kg
    grip, rest = rnc.Grip(reduced, 0.5), np.zeros(reduced.r)
    loads = loads_of(grip, reduced, robot.configuration(), rest, np.zeros(0))
    np.testing.assert_allclose(loads, 23.0 * G * np.array([left, 1 - left]), rtol=1e-9)


def test_a_wheel_that_lifts_off_in_a_turn_has_no_grip():
    reduced, friction = cart("free"), 0.4
    grip = rnc.Grip(reduced, friction)
    assert grip.names == ("b", "a")
    q = reduced.assembled(reduced.robot.configuration({"mast": -1.0}))
    state, T = reduced.at(q, [3.0, 3.0]), np.array([0.3, -0.7])
    rows = dict(zip(reduced.all_constraints.names, state.contact_forces(T), strict=True))
    assert rows["vertical(a)"] < 0 < rows["vertical(b)"] or rows["vertical(b)"] < 0 < rows["vertical(a)"]
    along = {"b": np.hypot(rows["rolling(b)"], rows["lateral(b)"]), "a": abs(rows["rolling(a)"])}
    for name, used in zip(grip.names, grip.used(q, [3.0, 3.0], T), strict=True):
        load = rows[f"vertical({name})"]
        assert used == (np.inf if load < 0 else pytest.approx(along[name] / (friction * load), rel=1e-9))


@pytest.mark.parametrize("gravity", [0.0, 3.0])
def test_without_weight_nothing_grips_that_has_to(gravity):
    reduced = cart(gravity=gravity)
    grip, q = rnc.Grip(reduced, 0.5), reduced.robot.configuration({"mast": 0.2})
    rest = np.zeros(2)
    assert grip.used(q, rest, rest).tolist() == [0.0] * 3
    assert grip.used(q, [0.5, 0.8], [0.3, 0.1]).tolist() == [np.inf] * 3


def test_a_robot_on_two_wheels_skids_on_a_circle_at_the_root_of_mu_g_rho():
    """Both at once: the load of one is m (g / 2 -+ v^2 h / (rho track)), the outer takes more of the force."""
    friction, rho, height, track = 0.5, 2.0, 0.3, 0.4
    reduced = systems.on_two_wheels(height=height, track=track)
    grip, q = rnc.Grip(reduced, friction), reduced.robot.configuration({"root_joint": (1.0, -2.0, 0.7)})
    evenly = np.sqrt(rho * friction * G / (1 + 2 * friction * height / track))
    speeds = np.array([1.0, evenly, 3.1, np.sqrt(friction * G * rho), 3.2])
    v2 = np.stack([speeds, speeds / rho], axis=1)
    used = grip.used(np.tile(q, (5, 1)), v2, np.zeros((5, 2)))
    np.testing.assert_allclose(used, np.tile(speeds[:, None] ** 2 / (friction * G * rho), 2), rtol=1e-7)
    assert grip.is_choice(np.tile(q, (5, 1))).tolist() == [[True, True]] * 5
    loads = loads_of(grip, reduced, q, v2[1], np.zeros(2))
    inner = 10.0 * (G / 2 - speeds[1] ** 2 * height / (rho * track))
    np.testing.assert_allclose(loads.min(), inner, rtol=1e-6)


def least_largest_share(torques, friction):
    """Of the car of ``on_four_wheels`` at rest: Newton and Euler for one body, and a solver for smooth programs."""
    mass, center = 20.0, np.array([0.05, 0.02, 0.1 + WHEEL])
    places = np.array([[*xy, 0.0] for xy in systems.CORNERS.values()])
    driving = np.asarray(torques) / WHEEL
    inertial = np.array([driving.sum(), 0.0, mass * G])  # force of the ground

    def forces(z):
        return np.stack([driving, z[:4], z[4:8]], axis=1)

    def balance(z):
        each = forces(z)
        return np.concatenate([(each.sum(axis=0) - inertial)[1:], np.cross(places - center, each).sum(axis=0)])

    def room(z):
        return z[8] * friction * z[4:8] - np.linalg.norm(forces(z)[:, :2], axis=1)

    start = np.concatenate([np.zeros(4), np.full(4, mass * G / 4), [2.0]])
    bounds = (("eq", balance), ("ineq", room), ("ineq", lambda z: z[4:8]))
    constraints = [{"type": kind, "fun": function} for kind, function in bounds]
    options = {"ftol": 1e-13, "maxiter": 900}
    found = minimize(lambda z: z[8], start, constraints=constraints, method="SLSQP", options=options)
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


def test_the_program_of_whole_body_control_has_the_same_forces():
    """Its pyramids lie inside the cones: feasible above the share divided by the cosine, infeasible below the share."""
    reduced, generator = systems.on_four_wheels(), np.random.default_rng(2)
    q = reduced.robot.configuration()
    ahead = reduced.at(np.tile(q, (2, 1)), np.zeros((2, 1)))
    for T in generator.normal(size=(5, 4)):
        share = rnc.Grip(reduced, 1.0).used(q, np.zeros(1), T).max()
        for friction, feasible in ((0.999 * share, False), (1.001 * share / np.cos(np.pi / 8), True)):
            cones = ContactCones(reduced, friction)
            bounds = cones.at(reduced.at(q, np.zeros(1)))
            room, free = bounds.upper - bounds.rows[:, :4] @ T, bounds.rows[:, 4:]
            found = linprog(np.zeros(free.shape[1]), free, room, bounds=(None, None))
            assert (found.status == 0) == feasible
            excess = cones.excess(ahead, np.array([0.0 * T, T]))
            least = np.maximum(-bounds.upper, -room)  # of the least forces, at rest and under T
            assert excess.max() < 1e-9 if feasible else np.abs(excess - least).max() < 1e-9
