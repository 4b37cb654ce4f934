"""``at``: a value, computed once, over any leading axes; states as measured; what has no value is refused."""

import numpy as np
import pinocchio as pin
import pytest
import scipy.linalg

import rnc_pin as rnc
from rnc_pin.control import PositionTracker, RedundancyController, VelocityGains, VelocityTracker
from rnc_pin.planning.references import Hold
from systems import ALL, mobile_manipulator, random_states, space_robot, spinning_space_robot, tiago, without_outputs
from tolerances import KKT, ROUNDING

QUANTITIES = [
    "E",
    "E_inverse",
    "R",
    "R_dot",
    "M",
    "A",
    "A_dot",
    "A_star",
    "A_star_dot",
    "B",
    "J1",
    "J1_dot",
    "J2",
    "H",
    "V",
    "G",
    "C",
    "g",
    "b",
    "b_dot",
    "mu",
    "bias",
    "v",
    "v1",
    "v2",
    "gamma",
    "residual",
    "input_matrix",
    "condition",
    "smallest_singular_value",
    "kinetic_energy",
    "energy",
    "regular",
]


def states_of(reduced, count=6):
    q, v2 = (np.stack(each) for each in zip(*random_states(reduced, count), strict=True))
    return q, v2


def assert_same(there, here, what):
    """Equal but for the rounding of two ways to solve."""
    scale = 1 + np.nan_to_num(np.abs(here)).max(initial=0.0)
    np.testing.assert_allclose(there, here, rtol=0, atol=KKT * scale, err_msg=what)


# ---------------------------------------------------------------------- a value


@pytest.mark.parametrize("name", ALL)
def test_many_states_say_what_each_says_alone(name):
    reduced = ALL[name]()
    q, v2 = states_of(reduced)
    generator = np.random.default_rng(3)
    T, a = generator.normal(size=(2, 3, reduced.p)), generator.normal(size=(2, 3, reduced.r))
    many = reduced.at(q.reshape(2, 3, -1), v2.reshape(2, 3, -1))
    for i, j in np.ndindex(2, 3):
        one = reduced.at(q[3 * i + j], v2[3 * i + j])
        for quantity in QUANTITIES:
            there, here = np.asarray(getattr(many, quantity)), np.asarray(getattr(one, quantity))
            assert there.shape == (2, 3, *here.shape), quantity
            assert_same(there[i, j], here, quantity)
        for call, given in (("v2_dot", T), ("inverse_dynamics", a), ("allocate", a), ("contact_forces", T)):
            assert_same(getattr(many, call)(given)[i, j], getattr(one, call)(given[i, j]), call)
        for there, here in zip(many.flow(T), one.flow(T[i, j]), strict=True):
            assert_same(there[i, j], here, "flow")
        for field, here in one.measure()._asdict().items():
            there = getattr(many.measure(), field)
            assert (there is None) == (here is None), field
            if here is not None:
                assert_same(there[i, j], here, field)


def test_one_velocity_at_many_configurations_and_many_at_one():
    reduced = space_robot()
    q, v2 = states_of(reduced)
    T = np.zeros(3)
    for given in ((q, v2[0]), (q[0], v2)):
        expected = [reduced.forward_dynamics(p, w, T) for p, w in np.broadcast(*map(list_of, given))]
        np.testing.assert_allclose(reduced.forward_dynamics(*given, T), expected, atol=ROUNDING)
    assert reduced.forward_dynamics(q[:0], v2[:0], np.zeros((0, 3))).shape == (0, 3)
    with pytest.raises(rnc.InputError, match=r"q of shape \(6, 4\) and v2 of shape \(5, 3\) do not broadcast"):
        reduced.at(q, v2[:5])


def list_of(states):
    rows = np.empty(1 if states.ndim == 1 else len(states), dtype=object)
    rows[:] = [states] if states.ndim == 1 else list(states)
    return rows


def test_it_stays_what_it_is():
    """Other states in between, arrays that the caller goes on using: neither reaches an evaluation."""
    reduced = tiago()
    (q, v2), (p, w) = random_states(reduced, 2)
    expected = {name: np.copy(getattr(reduced.at(q, v2), name)) for name in QUANTITIES}
    mine, my_v2 = q.copy(), v2.copy()
    state = reduced.at(mine, my_v2)
    _ = state.R, state.bias
    mine[:], my_v2[:] = p, w
    _ = reduced.forward_dynamics(p, w, np.zeros(reduced.p)), reduced.terms(p, w), reduced.energy(p, w)
    for name in QUANTITIES:
        np.testing.assert_allclose(getattr(state, name), expected[name], atol=ROUNDING, err_msg=name)


def test_each_quantity_is_computed_once(monkeypatch):
    """A whole tick, from the measurement to the first slope and the record, visits Pinocchio once for each thing."""
    reduced = tiago()
    ((q, v2),) = random_states(reduced, 1)
    T = np.ones(reduced.p)
    counts = {}

    def counted(name):
        call = getattr(pin, name)

        def wrapped(*arguments):
            counts[name] = counts.get(name, 0) + 1
            return call(*arguments)

        monkeypatch.setattr(pin, name, wrapped)

    for name in ("crba", "computeJointJacobians", "nonLinearEffects", "forwardKinematics", "computeCoriolisMatrix"):
        counted(name)
    state = reduced.at(q, v2)
    for _ in range(3):
        state.measure(np.zeros(reduced.r))
        state.flow(T)
        state.multipliers(T)
        state.contact_forces(T)
        state.allocate(state.inverse_dynamics(np.zeros(reduced.r)))
        _ = state.kinetic_energy, state.condition, state.terms()
    assert counts.pop("computeCoriolisMatrix") == 1
    # What the Coriolis matrix leaves behind is somebody else's: placements are set once more for what follows.
    assert counts.pop("computeJointJacobians", 0) <= 1
    assert counts.pop("forwardKinematics") <= 2
    assert counts == {"crba": 1, "nonLinearEffects": 1}
    assert state.R is state.R
    assert state.E_inverse is state.E_inverse


def test_a_configuration_has_no_velocity():
    position = space_robot().at(space_robot().robot.configuration({"joint_2": 1.0})).position
    assert not hasattr(position, "acceleration")
    assert not hasattr(position.with_velocity(np.zeros(4)), "jacobian_dot")
    with pytest.raises(rnc.InputError, match=r"'v' needs a velocity: use at\(q, v2\)"):
        _ = space_robot().at(position.q).v


# ---------------------------------------------------------------------- as measured


def test_a_measured_velocity_is_kept():
    reduced = mobile_manipulator()
    (q, v2), _ = random_states(reduced, 2)
    t = reduced.terms(q, v2)
    slip = np.array([0.02, -0.03, 0.01, 0.005, -0.004])
    seen = reduced.measured(q, t.v + slip)
    state = reduced.at(q)
    np.testing.assert_array_equal(seen.v, t.v + slip)
    np.testing.assert_allclose(seen.residual, t.A @ slip, atol=ROUNDING)
    np.testing.assert_allclose(seen.v1, state.J1 @ (t.v + slip), atol=ROUNDING)
    np.testing.assert_allclose(seen.v2, v2 + state.J2 @ slip, atol=ROUNDING)
    assert np.abs(seen.v1 - seen.A_star @ seen.v2).max() > 1e-3
    own = reduced.measure(q, v2)
    np.testing.assert_allclose(own.residual, 0.0, atol=ROUNDING)
    batch = reduced.measured(np.stack([q, q]), np.stack([t.v, t.v + slip]))
    np.testing.assert_allclose(batch.residual[1], seen.residual, atol=ROUNDING)
    with pytest.raises(rnc.InputError, match="takes v2 or v, not both"):
        reduced.at(q, v2, v=t.v)


def test_an_estimator_in_a_loop_of_its_own_learns_the_robot_that_is_there():
    """The real robot carries a load that the model knows nothing of; only the velocity as measured tells."""
    believed = space_robot()
    model = believed.robot.model.copy()
    loaded = model.getJointId("joint_3")
    model.inertias[loaded] = pin.Inertia(
        2.0 * model.inertias[loaded].mass, model.inertias[loaded].lever, 2.0 * model.inertias[loaded].inertia
    )
    joints = ["joint_1", "joint_2", "joint_3"]
    system = rnc.NonholonomicSystem(rnc.Robot(model), [rnc.MomentumConservation("platform")], joints)
    real = system.reduce(
        [rnc.FramePosition("tip", "xy"), rnc.JointPosition("joint_1")], [rnc.JointPosition("platform")]
    )
    (q, v2), _ = random_states(believed, 2)
    v = real.terms(q, v2).v
    replaced, seen = believed.measure(q, v2), believed.measured(q, v)
    assert np.abs(replaced.residual).max() < ROUNDING  # this is how the load stayed hidden
    assert np.abs(seen.residual).max() > 1e-3
    np.testing.assert_allclose(seen.v1, v[:1], atol=ROUNDING)


def test_a_run_records_what_was_measured():
    reduced = space_robot()
    q0 = reduced.robot.configuration({"joint_2": 1.8, "joint_3": -1.1})
    x2 = reduced.outputs(q0)[1]
    tracker = PositionTracker(Hold(x2 + np.array([0.1, 0.0, 0.0])))
    run = rnc.simulate(reduced, tracker, q0, 0.2, 0.002)
    for i in (0, 40, 100):
        seen = reduced.measured(run.q[i], run.v[i])
        np.testing.assert_allclose(run.v1[i], seen.v1, atol=ROUNDING)
        np.testing.assert_allclose(run.v2[i], seen.v2, atol=ROUNDING)
        np.testing.assert_allclose(run.constraint_residual[i], seen.residual, atol=ROUNDING)


# ---------------------------------------------------------------------- what has no value


@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize("make", [space_robot, tiago, spinning_space_robot], ids=lambda make: make.__name__)
def test_what_is_not_finite_is_refused_everywhere(make, bad):
    reduced = make()
    ((q, v2),) = random_states(reduced, 1)
    v, T = reduced.velocity(q, v2), np.zeros(reduced.p)
    good = {"q": q, "v2": v2, "v": v, "T": T, "F": v2, "v2_dot": v2, "integrals": v2, "along": v}
    calls = {
        "forward_dynamics": "q v2 T",
        "inverse_dynamics": "q v2 v2_dot",
        "flow": "q v2 T",
        "allocate": "q F",
        "multipliers": "q v2 T",
        "contact_forces": "q v2 T",
        "energy": "q v2",
        "terms": "q v2",
        "lagrangian_terms": "q v2",
        "inertia": "q",
        "input_matrix": "q",
        "drive_jacobian": "q",
        "basis_rate": "q along",
        "measure": "q v2",
        "measured": "q v",
        "outputs": "q",
        "velocity": "q v2",
        "constraint_residual": "q v",
        "condition": "q",
        "smallest_singular_value": "q",
        "stacked_rows": "q",
    }
    for call, names in calls.items():
        for spoilt in names.split():
            for batch in (False, True):
                given = {name: np.array(good[name]) for name in names.split()}
                given[spoilt][-1] = bad
                if batch:
                    given = {name: np.stack([good[name], array]) for name, array in given.items()}
                with pytest.raises(rnc.InputError) as caught:
                    getattr(reduced, call)(**given)
                assert "not finite" in str(caught.value), (call, spoilt, batch)
                assert "\n" not in str(caught.value)
        short = {name: good[name][:-1] for name in names.split()}
        with pytest.raises(rnc.InputError, match=r"has shape \(\d+,\), expected \(\.\.\., \d+\)"):
            getattr(reduced, call)(**short)


def test_every_call_takes_many_states():
    reduced = spinning_space_robot()
    q, v2 = states_of(reduced, 4)
    v = reduced.velocity(q, v2)
    for call, given in {
        "constraint_residual": (q, v),
        "basis_rate": (q, v),
        "drive_jacobian": (q,),
        "outputs": (q,),
        "energy": (q, v2),
        "condition": (q,),
        "kinematic_gradient": (q, [0, 2]),
        "log_determinant_gradient": (q, [0, 2]),
    }.items():
        states = [array for array in given if isinstance(array, np.ndarray)]
        rest = given[len(states) :]
        many = getattr(reduced, call)(*given)
        for i in range(len(q)):
            one = getattr(reduced, call)(*(array[i] for array in states), *rest)
            pairs = zip(many, one, strict=True) if isinstance(one, tuple) else [(many, one)]
            for there, here in pairs:
                np.testing.assert_allclose(there[i], here, atol=ROUNDING, err_msg=call)


def test_an_integral_that_a_task_needs_is_asked_for():
    reduced = mobile_manipulator()  # its third output is a speed
    names = reduced.reducing.names
    task = rnc.Task.of(reduced, names[1:], names[:1], reduced.vertical.names[:1])
    ((q, _),) = random_states(reduced, 1)
    rest = np.zeros(4)
    seen = reduced.measure(q, rest)
    assert np.isnan(seen.x2[2])
    assert np.isfinite(seen.x2[[0, 1, 3]]).all()
    redundant = RedundancyController(task, Hold(np.zeros(3)), Hold(np.zeros(1)), 1.0, 1.0)
    tracker = PositionTracker(Hold(np.zeros(4)))
    words = "a feedback gain acts on an output without a value: it is a quasi-velocity"
    for controller in (tracker, VelocityTracker(redundant, VelocityGains.paper())):
        with pytest.raises(rnc.InputError, match=words):
            controller.step(0.0, seen, controller.initial_state(reduced.measure(q, rest, rest)))
        controller.step(0.0, reduced.measure(q, rest, rest), controller.initial_state(reduced.measure(q, rest, rest)))
    without = RedundancyController(task, Hold(np.zeros(3)), Hold(np.zeros(1)), 1.0, np.array([1.0, 0.0, 1.0]))
    target, _ = without.step(0.0, seen, None)
    assert np.isfinite(target.v2).all()


# ---------------------------------------------------------------------- rows that vanish, forces that are shared


def two_joints():
    """A planar arm whose tip is on the way of joint 1 alone: y = sin j1."""
    model = pin.Model()
    model.name = "arm"
    first = model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "j1")
    second = model.addJoint(0, pin.JointModelPX(), pin.SE3.Identity(), "j2")
    for joint in (first, second):
        model.appendBodyToJoint(joint, pin.Inertia.FromSphere(1.0, 0.1), pin.SE3.Identity())
    tip = pin.SE3(np.eye(3), np.array([1.0, 0.0, 0.0]))
    model.addFrame(pin.Frame("tip", first, 0, tip, pin.FrameType.OP_FRAME))
    return rnc.NonholonomicSystem(rnc.Robot(model), [], ["j1", "j2"])


@pytest.mark.parametrize("off", [0.0, 1e-12, -1e-10])
def test_a_row_that_vanishes_is_singular(off):
    reduced = two_joints().reduce([rnc.FramePosition("tip", "y"), rnc.JointPosition("j2")])
    q, v2 = np.array([np.pi / 2 + off, 0.0]), np.array([1.0, 0.0])
    for call in (
        lambda: reduced.terms(q, v2),
        lambda: reduced.forward_dynamics(q, v2, np.zeros(2)),
        lambda: reduced.measure(q, v2),
        lambda: reduced.velocity(np.stack([0 * q, q]), np.stack([v2, v2])),
    ):
        with pytest.raises(rnc.SingularityError) as caught:
            call()
        assert list(caught.value.rows) == ["tip_y"]
        assert caught.value.condition > 1e8
        np.testing.assert_array_equal(caught.value.q, q)
    assert reduced.smallest_singular_value(q) < 1e-8
    assert reduced.condition(np.zeros(2)) < 3


def test_a_motion_goes_through_a_row_that_vanishes():
    """The plant does not care for the output that vanishes: joint 1 turns on at its constant rate."""
    system = two_joints()
    reduced = system.reduce([rnc.FramePosition("tip", "y"), rnc.JointPosition("j2")])
    run = rnc.free_motion(reduced, np.zeros(2), np.array([1.0, 0.5]), 3.0, 0.1, rtol=1e-10)
    np.testing.assert_allclose(run.q[:, 0], run.time, atol=1e-8)
    np.testing.assert_allclose(run.x2[:, 0], np.sin(run.time), atol=1e-8)


def test_two_wheels_of_one_axle_share_the_lateral_force():
    reduced = tiago()
    assert len(reduced.all_constraints.names) == 6
    for q, v2 in random_states(reduced, 4):
        T = np.linspace(-1, 1, reduced.p)
        state = reduced.at(q, v2)
        forces, multipliers = state.contact_forces(T), state.multipliers(T)
        by_name = dict(zip(reduced.all_constraints.names, forces, strict=True))
        left, right = by_name["lateral(wheel_left_link)"], by_name["lateral(wheel_right_link)"]
        np.testing.assert_allclose(left, right, rtol=1e-9)
        np.testing.assert_allclose(
            state.all_rows.T @ forces, state.A.T @ multipliers, atol=KKT * (1 + np.abs(forces).max())
        )
        # Independent of how rows were kept: the balance of the unreduced system, in the smallest forces that close it.
        full, v2_dot = reduced.lagrangian_terms(q, v2), state.v2_dot(T)
        t = reduced.terms(q, v2)
        left_over = full.B @ T - full.H @ (t.R @ v2_dot + t.R_dot @ v2) - full.C @ t.v - full.g
        smallest = np.linalg.lstsq(state.all_rows.T, left_over, rcond=1e-10)[0]
        np.testing.assert_allclose(forces, smallest, atol=KKT * (1 + np.abs(forces).max()))
    run = rnc.free_motion(reduced, q, v2, 0.02, 0.01)
    assert run.contact_forces.shape == (3, 6)
    np.testing.assert_allclose(run.contact_forces[0], reduced.contact_forces(q, v2, np.zeros(reduced.p)), atol=1e-9)


def test_a_continuous_joint_keeps_its_turns_however_seldom_it_is_sampled():
    model = pin.Model()
    model.name = "rotor"
    joint = model.addJoint(0, pin.JointModelRUBZ(), pin.SE3.Identity(), "rotor")
    model.appendBodyToJoint(joint, pin.Inertia.FromSphere(1.0, 0.1), pin.SE3.Identity())
    reduced = rnc.NonholonomicSystem(rnc.Robot(model), [], ["rotor"]).reduce([rnc.JointPosition("rotor")])
    run = rnc.free_motion(reduced, reduced.robot.configuration(), np.array([4.0]), 20.0, 1.0)
    np.testing.assert_allclose(run.x2[:, 0], 4.0 * run.time, atol=1e-6)


# ---------------------------------------------------------------------- without outputs


def test_without_outputs_no_velocities_are_ever_dependent():
    """A knife edge that turns all the way round: no two fixed entries of v would do everywhere."""
    model = pin.Model()
    model.name = "skate"
    slide = model.addJoint(0, pin.JointModelPX(), pin.SE3.Identity(), "x")
    across = model.addJoint(slide, pin.JointModelPY(), pin.SE3.Identity(), "y")
    turn = model.addJoint(across, pin.JointModelRZ(), pin.SE3.Identity(), "heading")
    model.appendBodyToJoint(turn, pin.Inertia.FromSphere(2.0, 0.3), pin.SE3.Identity())
    model.addFrame(pin.Frame("blade", turn, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    push = np.eye(3)
    reduced = rnc.NonholonomicSystem(rnc.Robot(model), [rnc.NoSideSlip("blade")], push).reduce()
    headings = np.linspace(0.0, 2 * np.pi, 73)
    q = np.stack([np.array([0.3, -0.2, heading]) for heading in headings])
    state = reduced.at(q, np.ones((73, 2)))
    assert np.abs(state.R).max() < 1e3
    chosen = {tuple(np.flatnonzero(J2.any(axis=0))) for J2 in state.J2}
    assert chosen == {(0, 2), (1, 2)}
    T = np.array([0.7, -0.4, 0.2])
    v2_dot, data = reduced.forward_dynamics(q, np.ones((73, 2)), T), model.createData()
    for i, heading in enumerate(headings):
        A = np.array([[-np.sin(heading), np.cos(heading), 0.0]])
        A_dot = np.array([[-np.cos(heading), -np.sin(heading), 0.0]]) * state.v[i, 2]
        vdot = pin.forwardDynamics(model, data, q[i], state.v[i], T, A, A_dot @ state.v[i])
        np.testing.assert_allclose(v2_dot[i], state.J2[i] @ vdot, atol=KKT)
    # A whole turn with constant force along: the blade keeps its speed about, and goes round.
    run = rnc.free_motion(reduced, q[0], np.array([1.0, 2.0]), np.pi, np.pi / 50, rtol=1e-11)
    expected = 0.3 + np.sin(2.0 * run.time) / 2.0, -0.2 + (1 - np.cos(2.0 * run.time)) / 2.0
    np.testing.assert_allclose(run.q[:, :2], np.stack(expected, axis=1), atol=1e-8)


def test_a_linear_model_without_outputs_has_the_same_eigenvalues():
    """Where it is linearised in other entries of v than the default ones, too."""
    named, free = ALL["four_bar"](), without_outputs("four_bar")
    for crank in (0.4, 2.0, 4.1):
        q = named.assembled(np.array([crank, 0.5 - crank, 1.5]), hold=["crank"])
        T = named.allocate(q, named.inverse_dynamics(q, np.zeros(1), np.zeros(1)))
        expected = rnc.linearize(named, q, T=T).eigenvalues
        np.testing.assert_allclose(rnc.linearize(free, q, T=T).eigenvalues, expected, atol=1e-7)


def test_constraints_that_lose_rank_only_where_the_robot_rests_are_refused():
    """Two edges that are parallel in the neutral configuration alone: random samples would not have seen it."""
    model = pin.Model()
    model.name = "two edges"
    base = model.addJoint(0, pin.JointModelPlanar(), pin.SE3.Identity(), "root_joint")
    model.appendBodyToJoint(base, pin.Inertia.FromSphere(1.0, 0.2), pin.SE3.Identity())
    hinge = model.addJoint(base, pin.JointModelRZ(), pin.SE3.Identity(), "hinge")
    model.appendBodyToJoint(hinge, pin.Inertia.FromSphere(1.0, 0.2), pin.SE3.Identity())
    for name, joint in (("front", hinge), ("rear", base)):
        model.addFrame(pin.Frame(name, joint, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    with pytest.raises(rnc.ConstraintError, match="rank of the constraints changes with the configuration"):
        rnc.NonholonomicSystem(rnc.Robot(model), [rnc.NoSideSlip("front"), rnc.NoSideSlip("rear")])


def test_the_null_space_is_that_of_the_rows():
    for name in ALL:
        reduced = ALL[name]()
        for q, _ in random_states(reduced, 2):
            state = reduced.at(q)
            basis = scipy.linalg.null_space(state.all_rows, rcond=1e-10)
            assert basis.shape[1] == reduced.r
            angle = scipy.linalg.subspace_angles(basis, state.R).max()
            assert angle < 1e-9 * np.linalg.cond(state.R)


def answers(reduced, q, v2, T, v):
    """What a model says of states, by name."""
    state = reduced.at(q, v2)
    found = {name: getattr(state, name) for name in QUANTITIES}
    found |= vars(reduced.terms(q, v2)) | vars(reduced.lagrangian_terms(q, v2))
    found |= reduced.measure(q, v2, v2)._asdict() | reduced.flow(q, v2, T, np.ones(reduced.n))._asdict()
    found |= {f"measured {name}": each for name, each in reduced.measured(q, v)._asdict().items()}
    found |= {
        "forward": reduced.forward_dynamics(q, v2, T),
        "inverse": reduced.inverse_dynamics(q, v2, v2),
        "inputs": reduced.allocate(q, v2) if reduced.p >= reduced.r else T,
        "multipliers": reduced.multipliers(q, v2, T),
        "contact_forces": reduced.contact_forces(q, v2, T),
        "energy": reduced.energy(q, v2),
        "drive": reduced.drive_jacobian(q),
        "gradient": reduced.kinematic_gradient(q, [0]),
        "gradient of nothing": reduced.kinematic_gradient(q, []),
        "determinant": reduced.log_determinant_gradient(q, [0]),
        "condition": reduced.condition(q),
        "singular value": reduced.smallest_singular_value(q),
        "position": reduced.position_residual(q),
    }
    x1, x2 = reduced.outputs(q)
    return found | {"x1 alone": x1, "x2 alone": x2}


@pytest.mark.parametrize("name", ALL)
@pytest.mark.parametrize("lead", [(0,), (2, 0), (0, 3)])
def test_no_states_have_answers_of_the_right_shapes(name, lead):
    reduced = ALL[name]()
    one = next(iter(random_states(reduced, 1)))[0]
    sizes = (reduced.robot.nq, reduced.r, reduced.p, reduced.n)
    q, v2, T, v = (np.zeros((2, size)) for size in sizes)
    q[:] = one
    expected = answers(reduced, q, v2, T, v)
    for what, found in answers(reduced, *(np.zeros((*lead, size)) for size in sizes)).items():
        if expected[what] is not None:
            assert np.shape(found) == (*lead, *np.shape(expected[what])[1:]), what
    assert reduced.at(one, np.zeros((*lead, reduced.r))).v.shape == (*lead, reduced.n)
    assert reduced.at(np.zeros((*lead, reduced.robot.nq)), np.zeros(reduced.r)).v.shape == (*lead, reduced.n)


# ---------------------------------------------------------------------- read-only


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_arrays_are_read_only(quantity):
    """One state and many: a caller that writes to a quantity gets an error and changes nothing."""
    reduced = tiago()
    q, v2 = states_of(reduced, 2)
    for state in (reduced.at(q, v2), reduced.at(q[0], v2[0])):
        found = getattr(state, quantity)
        if isinstance(found, np.ndarray) and found.ndim > q.ndim - 1:
            with pytest.raises(ValueError, match="read-only"):
                found[...] = 0.0


def test_a_controller_cannot_move_the_robot_by_its_measurement():
    """In place, it gets an error; the run so far is kept."""
    reduced = space_robot()

    class Writes:
        def initial_state(self, measurement):
            return None

        def step(self, t, measurement, state):
            measurement.q[0] += 0.1
            return rnc.control.Command(T=np.zeros(reduced.p)), None

    q0 = reduced.robot.configuration({"joint_1": -0.4, "joint_2": 1.8, "joint_3": -1.1})
    with pytest.raises(rnc.SimulationError, match="read-only") as caught:
        rnc.simulate(reduced, Writes(), q0, 0.1, 0.01)
    assert isinstance(caught.value.__cause__, ValueError)
