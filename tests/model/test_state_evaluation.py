"""``at``: a value, computed once, over any leading axes; states as measured; what has no value is refused."""

from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from bodies import add_body, add_frame
from rnc_pin.model.evaluator import Evaluator, evaluator_for
from rnc_pin.model.generalized_forces import Actuation, PassiveForces
from rnc_pin.model.kinematics import Kinematics
from rnc_pin.model.reduction_data import ReductionData, VelocityRows
from rnc_pin.model.rows import OutputRows, OutputStack, RowStack
from rnc_pin.model.state_evaluation import StateEvaluation, kinematic_gradient
from systems import ALL, arm_on_base, random_states, space_robot, spinning_space_robot, tiago, without_outputs
from tolerances import KKT, ROUNDING

QUANTITIES = [
    "E", "E_inverse", "R", "R_dot", "M", "A", "A_dot", "A_star", "A_star_dot", "B", "J1", "J1_dot", "J2", "H",
    "V", "G", "C", "g", "b", "b_dot", "mu", "bias", "v", "v1", "v2", "gamma", "residual", "input_matrix",
    "condition", "smallest_singular_value", "kinetic_energy", "energy", "regular",
]  # fmt: skip


def states_of(reduced, count=6):
    q, v2 = (np.stack(each) for each in zip(*random_states(reduced, count), strict=True))
    return q, v2


def test_one_velocity_at_many_configurations_and_many_at_one():
    reduced = space_robot()
    q, v2 = states_of(reduced)
    T = np.zeros(3)
    expected = [reduced.forward_dynamics(each, v2[0], T) for each in q]
    np.testing.assert_allclose(reduced.forward_dynamics(q, v2[0], T), expected, atol=ROUNDING)
    expected = [reduced.forward_dynamics(q[0], each, T) for each in v2]
    np.testing.assert_allclose(reduced.forward_dynamics(q[0], v2, T), expected, atol=ROUNDING)
    for lead in ((0,), (2, 0)):  # no states
        at = np.zeros((*lead, 4)), np.zeros((*lead, 3))
        assert reduced.forward_dynamics(*at, np.zeros((*lead, 3))).shape == (*lead, 3)
        assert reduced.terms(*at).R.shape == (*lead, 4, 3)
        assert kinematic_gradient(reduced.at(at[0]), [0]).shape == (*lead, 1, 3, 1)
    with pytest.raises(rnc.InputError, match=r"q of shape \(6, 4\) and v2 of shape \(5, 3\) do not broadcast"):
        reduced.at(q, v2[:5])
    with pytest.raises(rnc.InputError, match="takes v2 or v, not both"):
        reduced.at(q, v2, v=reduced.at(q, v2).v)


def test_a_configuration_has_no_velocity():
    position = space_robot().at(space_robot().robot.configuration({"joint_2": 1.0})).position
    assert not hasattr(position, "acceleration")
    assert not hasattr(position, "jacobian_dot")
    with pytest.raises(rnc.InputError, match=r"'v' needs a velocity: use at\(q, v2\)"):
        _ = space_robot().at(position.q).v


NOT_FINITE = {
    "q v2 T": lambda reduced, q, v2, T: reduced.forward_dynamics(q, v2, T),
    "q v2 v2_dot": lambda reduced, q, v2, v2_dot: reduced.inverse_dynamics(q, v2, v2_dot),
    "q F": lambda reduced, q, F: reduced.allocate(q, F),
    "q v2": lambda reduced, q, v2: reduced.terms(q, v2),
    "q v": lambda reduced, q, v: reduced.at(q, v=v),
    "T": lambda reduced, T: reduced.at(SPACE_ROBOT_AT, np.zeros(3)).flow(T),
}
SPACE_ROBOT_AT = np.array([0.1, -0.4, 1.8, -1.1])


@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize("names", NOT_FINITE)
def test_what_is_not_finite_or_has_another_size_is_refused(names, bad):
    reduced, v2 = spinning_space_robot(), np.array([0.1, 0.2, -0.3])
    good = {"q": SPACE_ROBOT_AT, "v2": v2, "v": np.append(v2, 0.4), "T": v2, "F": v2, "v2_dot": v2}
    for spoilt in names.split():
        given = {name: np.stack([good[name]] * 2) for name in names.split()}
        given[spoilt][1, -1] = bad
        for one in (given, {name: array[1] for name, array in given.items()}):
            with pytest.raises(rnc.InputError, match=f"^{spoilt} holds values that are not finite"):
                NOT_FINITE[names](reduced, **one)
    with pytest.raises(rnc.InputError, match=r"has shape \(\d+,\), expected \(\.\.\., \d+\)"):
        NOT_FINITE[names](reduced, **{name: good[name][:-1] for name in names.split()})


def two_joints():
    """A planar arm whose tip is on the way of joint 1 alone: y = sin j1."""
    model = pin.Model()
    for name, kind in (("j1", "RZ"), ("j2", "PX")):
        add_body(model, name, kind, pin.Inertia.FromSphere(1.0, 0.1))
    add_frame(model, "tip", model.getJointId("j1"), (1.0, 0.0, 0.0))
    return rnc.NonholonomicSystem(rnc.Robot(model), [], ["j1", "j2"])


@pytest.mark.parametrize("off", [0.0, 1e-12, -1e-10])
def test_a_row_that_vanishes_is_singular(off):
    reduced = two_joints().reduce([rnc.FramePosition("tip", "y"), rnc.JointPosition("j2")])
    q, v2 = np.array([np.pi / 2 + off, 0.0]), np.array([1.0, 0.0])
    for call in (
        lambda: reduced.terms(q, v2),
        lambda: reduced.forward_dynamics(q, v2, np.zeros(2)),
        lambda: reduced.at(q, v2).measure(),
        lambda: reduced.at(np.stack([0 * q, q]), np.stack([v2, v2])).v,
    ):
        with pytest.raises(rnc.SingularityError) as caught:
            call()
        assert list(caught.value.rows) == ["tip_y"]
        assert caught.value.condition > 1e8
        np.testing.assert_array_equal(caught.value.q, q)
    assert reduced.at(q).smallest_singular_value < 1e-8
    assert reduced.at(np.zeros(2)).condition < 3


def test_a_continuous_joint_keeps_its_turns_however_seldom_it_is_sampled():
    model = pin.Model()
    add_body(model, "rotor", "RUBZ", pin.Inertia.FromSphere(1.0, 0.1))
    reduced = rnc.NonholonomicSystem(rnc.Robot(model), [], ["rotor"]).reduce([rnc.JointPosition("rotor")])
    run = rnc.free_motion(reduced, reduced.robot.configuration(), np.array([4.0]), 20.0, 1.0)
    np.testing.assert_allclose(run.x2[:, 0], 4.0 * run.time, atol=1e-6)


def test_without_outputs_no_velocities_are_ever_dependent():
    """A knife edge that turns all the way round: no two fixed entries of v would do everywhere."""
    model = pin.Model()
    slide = model.addJoint(0, pin.JointModelPX(), pin.SE3.Identity(), "x")
    across = model.addJoint(slide, pin.JointModelPY(), pin.SE3.Identity(), "y")
    add_body(model, "heading", "RZ", pin.Inertia.FromSphere(2.0, 0.3), across, frame="blade")
    reduced = rnc.NonholonomicSystem(rnc.Robot(model), [rnc.NoSideSlip("blade")], np.eye(3)).reduce()
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
    run = rnc.free_motion(reduced, q[0], np.array([1.0, 2.0]), np.pi, np.pi / 50, tolerance=(1e-11, 1e-12))
    expected = 0.3 + np.sin(2.0 * run.time) / 2.0, -0.2 + (1 - np.cos(2.0 * run.time)) / 2.0
    np.testing.assert_allclose(run.q[:, :2], np.stack(expected, axis=1), atol=1e-8)


def test_a_linear_model_without_outputs_has_the_same_eigenvalues():
    """Also in other entries of v than the default ones."""
    named, free = ALL["four_bar"](), without_outputs("four_bar")
    for crank in (0.4, 2.0, 4.1):
        q = named.assembled(np.array([crank, 0.5 - crank, 1.5]), hold=["crank"])
        T = named.allocate(q, named.inverse_dynamics(q, np.zeros(1), np.zeros(1)))
        expected = rnc.linearize(named, q, T=T).eigenvalues
        np.testing.assert_allclose(rnc.linearize(free, q, T=T).eigenvalues, expected, atol=1e-7)


def test_quantities_are_computed_once_and_read_only():
    """One state and many: a caller that writes to a quantity gets an error and changes nothing."""
    reduced = tiago()
    q, v2 = states_of(reduced, 2)
    one = reduced.at(q[0], v2[0])
    for state in (reduced.at(q, v2), one, reduced.evaluator.measured(np.array(one.q), np.array(one.v))):
        for name in QUANTITIES:
            found = getattr(state, name)
            assert state.q.ndim > 1 or np.ndim(found) == 0 or found is getattr(state, name), name
            if isinstance(found, np.ndarray) and found.ndim > q.ndim - 1:
                with pytest.raises(ValueError, match="read-only"):
                    found[...] = 0.0


N, MEET = 5, 0.3  # degrees of freedom; first coordinate at which the first two constraint rows are parallel


def arm():
    """Five joints of both kinds, each on the one before, with frames at the end."""
    model, joint, generator = pin.Model(), 0, np.random.default_rng(11)
    for name, kind in zip("abcde", ("PZ", "RX", "PY", "RZ", "RY"), strict=True):
        turn = pin.rpy.rpyToMatrix(*generator.uniform(-1, 1, 3))
        body = pin.Inertia(generator.uniform(1, 3), generator.uniform(-0.3, 0.3, 3), np.diag([0.3, 0.4, 0.5]))
        joint = add_body(model, name, kind, body, joint, at=pin.SE3(turn, np.ones(3)))
    add_frame(model, "tip", joint, pin.SE3(pin.rpy.rpyToMatrix(0.3, 0.5, -0.8), np.array([0.1, -0.2, 0.4])))
    return rnc.Robot(model)


class Line:
    """``c + d q``, a tensor for each state, and its rate ``d v``."""

    def __init__(self, constant, slope):
        self.constant, self.slope = np.asarray(constant, dtype=float), np.asarray(slope, dtype=float)

    def at(self, q):
        return self.constant + self.rate(q)

    def rate(self, v):
        return np.tensordot(v, self.slope, axes=(-1, 0))


def line(generator, *shape):
    return Line(generator.normal(size=shape), 0.4 * generator.normal(size=(N, *shape)))


class Given(OutputRows):
    """Rows ``weights(q) @ directions(q)`` that have to be ``weights(q) @ speeds(q)``; as outputs, with values."""

    def __init__(self, names, weights, directions, speeds=None, values=None):
        self.names, self.units, self.angular = tuple(names), ("",) * len(names), (False,) * len(names)
        self.weights, self.directions, self.speeds, self.values = weights, directions, speeds, values
        self.affine = speeds is not None

    def jacobian(self, at):
        return self.weights.at(at.q) @ self.directions.at(at.q)

    def jacobian_dot(self, at):
        W, W_dot = self.weights.at(at.q), self.weights.rate(at.v)
        return W_dot @ self.directions.at(at.q) + W @ self.directions.rate(at.v)

    def bias_acceleration(self, at):
        return np.matvec(self.jacobian_dot(at), at.v) - self.rate_dot(at)

    def rate(self, at):
        return np.matvec(self.weights.at(at.q), self.speeds.at(at.q)) if self.affine else self._zeros(at)

    def rate_dot(self, at):
        if not self.affine:
            return self._zeros(at)
        W, W_dot = self.weights.at(at.q), self.weights.rate(at.v)
        return np.matvec(W_dot, self.speeds.at(at.q)) + np.matvec(W, self.speeds.rate(at.v))

    def value(self, at):
        return self.values.at(at.q)


def outputs(names, directions, values):
    same = Line(np.eye(len(names)), np.zeros((N, len(names), len(names))))
    return Given(names, same, directions, values=values)


@pytest.fixture(scope="module")
def built():
    """Four rows that are combinations of two, three outputs of which the middle one is a quasi-velocity."""
    generator, robot = np.random.default_rng(5), arm()
    first, towards = generator.normal(size=(2, 2))
    constant = np.stack([first, first - MEET * towards, *generator.normal(size=(2, 2))])
    slope = np.zeros((N, 4, 2))
    slope[0, 1], slope[2:, 2:] = towards, 0.3 * generator.normal(size=(3, 2, 2))
    weights, directions, speeds = Line(constant, slope), line(generator, 2, N), line(generator, 2)
    rows = Given(["one", "two", "three", "four"], weights, directions, speeds)
    W = generator.normal(size=(1, N))
    ends = [outputs([f"x{k}"], line(generator, 1, N), line(generator, 1)) for k in range(2)]
    vertical = outputs(["y0", "y1"], line(generator, 2, N), line(generator, 2))
    reducing = [ends[0], VelocityRows(W, ["quasi"], [""]), ends[1]]
    actuation = Actuation(["b", "d", rnc.FrameForce("tip", "y"), rnc.FrameTorque("tip", "x")], robot)
    lengths = np.array([1.1, 0.9, 1.3, 0.7, 1.0, 2.0, 0.5])
    shared = Kinematics(robot), PassiveForces((), robot)
    x2, x1 = OutputStack(reducing), OutputStack([vertical])
    parts = ReductionData(robot, RowStack([rows]), (0, 1), actuation, x2, x1, 1e8, lengths, *shared)
    still = Actuation(generator.normal(size=(N, 4)), robot)
    steady = ReductionData(robot, RowStack([]), (), still, OutputStack([]), OutputStack([]), 1e8, lengths[:0], *shared)
    return SimpleNamespace(
        robot=robot, parts=parts, evaluator=evaluator_for(parts), steady=Evaluator(steady),
        rows=rows, weights=weights, directions=directions, speeds=speeds,
        vertical=vertical, ends=ends, W=W,
    )  # fmt: skip


@pytest.fixture
def system(built):
    """The same draws for each test, in whatever order they run."""
    return SimpleNamespace(**vars(built), generator=np.random.default_rng(8))


def states(generator, places):
    """Configurations whose first coordinates are where they are told to be, and velocities."""
    q = generator.uniform(-0.7, 0.7, (*places.shape, N))
    q[..., 0] = MEET + places
    return q, generator.normal(size=(*places.shape, 3))


PLACES = np.array([[0.5, 0.0, 1e-6], [-0.4, 1e-5, 0.9]])  # beside where the default rows meet


def plain(system, q, v2, T, damping, v=None):
    """Everything of one state, by the two directions that all four rows are made of, and Pinocchio alone."""
    model, data = system.robot.model, system.robot.model.createData()
    B, m, W, x = system.directions, system.speeds, system.weights, system.vertical
    J2 = np.vstack([system.ends[0].directions.at(q), system.W, system.ends[1].directions.at(q)])
    X = np.linalg.inv(np.vstack([B.at(q), J2]))
    R, b = X[:, 2:], X[:, :2] @ m.at(q)
    v = R @ v2 + b if v is None else v
    v2 = J2 @ v
    J2_dot = np.vstack([system.ends[0].directions.rate(v), 0 * system.W, system.ends[1].directions.rate(v)])
    E_dot = np.vstack([B.rate(v), J2_dot])
    R_dot, b_dot = -X @ E_dot @ R, X[:, :2] @ m.rate(v) - X @ E_dot @ b
    M, C = pin.crba(model, data, q), pin.computeCoriolisMatrix(model, data, q, v)
    M = np.triu(M) + np.triu(M, 1).T
    g = pin.computeGeneralizedGravity(model, data, q)
    actuators = np.zeros((N, 4))
    actuators[[1, 3], [0, 1]] = 1.0
    frame = pin.computeFrameJacobian(model, data, q, model.getFrameId("tip"), pin.LOCAL)
    actuators[:, 2], actuators[:, 3] = frame[1], frame[3]
    H, V = R.T @ M @ R, R.T @ (M @ R_dot + C @ R)
    G, reduced = R.T @ (g + M @ b_dot + C @ b), R.T @ actuators
    found = {"R": R, "b": b, "v": v, "v2": v2, "J2": J2, "R_dot": R_dot, "b_dot": b_dot, "M": M, "C": C, "g": g}
    found |= {"B": actuators, "H": H, "V": V, "G": G}
    found |= {"input_matrix": reduced, "bias": C @ v + g}
    all_rows, all_rates = W.at(q) @ B.at(q), W.at(q) @ m.at(q)
    all_rows_dot = W.rate(v) @ B.at(q) + W.at(q) @ B.rate(v)
    all_rates_dot = W.rate(v) @ m.at(q) + W.at(q) @ m.rate(v)
    J1, J1_dot = x.directions.at(q), x.directions.rate(v)
    found |= {"all_rows": all_rows, "J1": J1, "J1_dot": J1_dot, "v1": J1 @ v}
    found |= {"A_star": J1 @ R, "A_star_dot": J1_dot @ R + J1 @ R_dot}
    kinetic = 0.5 * v @ M @ v
    found |= {"kinetic_energy": kinetic, "energy": kinetic + pin.computePotentialEnergy(model, data, q)}

    def accelerations(force):
        v2_dot = np.linalg.solve(H, R.T @ force - V @ v2 - G)
        v_dot = R @ v2_dot + R_dot @ v2 + b_dot
        return v2_dot, v_dot, force - M @ v_dot - C @ v - g

    v2_dot, v_dot, left = accelerations(actuators @ T)
    calls = {"v2_dot": v2_dot, "contact_forces": -np.linalg.pinv(all_rows.T, rcond=1e-9) @ left}
    damped, damped_dot, _ = accelerations(actuators @ T - damping * v)
    calls |= {"flow": (v, damped, v @ (M @ damped_dot + C @ v + g)), "v_dot": v_dot}
    calls |= {"inverse_dynamics": H @ v2_dot + V @ v2 + G, "allocate": np.linalg.pinv(reduced) @ v2_dot, "left": left}
    return found, calls, all_rows, all_rows_dot, all_rates, all_rates_dot, J2_dot


def assert_close(there, here, what):
    np.testing.assert_allclose(there, here, rtol=1e-7, atol=1e-7 * (1 + np.abs(here).max(initial=0.0)), err_msg=what)


@pytest.mark.parametrize("measured", [False, True], ids=["reduced velocity", "measured velocity"])
@pytest.mark.parametrize("single", [True, False])
def test_all_of_it_where_other_rows_had_to_be_chosen(system, single, measured):
    """R, forces and what follows do not depend on the choice; gamma and rates are along a velocity that slips."""
    q, v2 = states(system.generator, PLACES)
    T, damping = system.generator.normal(size=(2, 3, 4)), np.linspace(0.1, 0.9, N)
    slipping, integrals = (system.generator.normal(size=(2, 3, size)) for size in (N, 3))
    for i in np.ndindex(2, 3):
        where, at = (i, ()) if single else (..., i)
        velocity = {"v": slipping[where]} if measured else {"v2": v2[where]}
        state = StateEvaluation.at(system.evaluator, q[where], **velocity)
        velocity = slipping[i] if measured else None
        calculated = plain(system, q[i], v2[i], T[i], damping, velocity)
        found, calls, all_rows, all_rows_dot, all_rates, all_rates_dot, J2_dot = calculated
        for name, here in found.items():
            assert_close(getattr(state, name)[at], here, name)
        kept, v = np.broadcast_to(state.kept, (2, 3, 2))[i], found["v"]
        default = PLACES[i] not in (0.0, 1e-6, 1e-5)
        assert (kept.tolist() == [0, 1]) == default
        A, A_dot = all_rows[kept], all_rows_dot[kept]
        of_rows = {
            "A": A, "A_dot": A_dot, "E": np.vstack([A, found["J2"]]), "E_dot": np.vstack([A_dot, J2_dot]),
            "mu": all_rates[kept], "residual": A @ v - all_rates[kept],
            "gamma": np.concatenate([A_dot @ v - all_rates_dot[kept], J2_dot @ v]),
        }  # fmt: skip
        for name, here in of_rows.items():
            assert_close(getattr(state, name)[at], here, name)
        assert_close(state.E_inverse[at] @ state.E[at], np.eye(N), "E_inverse")
        natural = [*np.array([1.1, 0.9, 1.3, 0.7])[kept].tolist(), 1.0, 2.0, 0.5]
        scaled = state.E[at] / np.maximum(np.linalg.norm(state.E[at], axis=1), natural)[:, None]
        assert_close(state.scaled_stack[at], scaled, "scaled_stack")
        values = np.linalg.svd(scaled, compute_uv=False)
        assert_close(np.asarray(state.condition)[at], values[0] / values[-1], "condition")
        assert_close(np.asarray(state.smallest_singular_value)[at], values[-1], "smallest_singular_value")
        assert np.asarray(state.regular)[at]
        check_measurements(system, state, i, at, found, integrals, of_rows["residual"])
        if not measured:
            check_forces(state, at, T[where], damping, calls, A if default else None)
            steady = StateEvaluation.at(system.steady, state.q)
            assert_close(steady.B[at], system.steady.data.actuation.constant, "constant B")


def check_forces(state, at, inputs, damping, calls, A):
    """A is None where other rows than the default ones are in use, so that multipliers mean nothing."""
    for call in ("v2_dot", "contact_forces"):
        assert_close(getattr(state, call)(inputs)[at], calls[call], call)
    for there, here in zip(state.flow(inputs, damping), calls["flow"], strict=True):
        assert_close(there[at], here, "flow")
    v2_dot = state.v2_dot(inputs)
    for call in ("v_dot", "inverse_dynamics", "allocate"):
        assert_close(getattr(state, call)(v2_dot)[at], calls[call], call)
    multipliers = state.multipliers(inputs)[at]
    if A is None:
        assert np.isnan(multipliers).all()
    else:
        assert_close(A.T @ multipliers, calls["left"], "multipliers")


def check_measurements(system, state, i, at, found, integrals, residual):
    b, J1, J1_dot = found["b"], found["J1"], found["J1_dot"]
    x1 = system.vertical.values.at(state.q[at])
    x2 = [each.values.at(state.q[at])[0] for each in system.ends]
    given = integrals[i] if at == () else integrals
    for integral, quasi, without in ((given, integrals[i][1], 0.0), (None, np.nan, 0.0)):
        measurement = state.measure(integral)
        expected = {
            "q": state.q[at], "v": found["v"], "v2": found["v2"], "x1": x1, "x2": np.array([x2[0], quasi, x2[1]]),
            "v1": J1 @ found["v"], "A_star": found["A_star"], "A_star_dot": found["A_star_dot"], "v1_offset": J1 @ b,
            "v1_offset_dot": J1_dot @ b + J1 @ found["b_dot"], "residual": residual,
        }  # fmt: skip
        for name, here in expected.items():
            size = 1 + np.nanmax(np.abs(here))
            np.testing.assert_allclose(getattr(measurement, name)[at], here, rtol=1e-7, atol=1e-6 * size, err_msg=name)
        assert (measurement.force_deficit, measurement.input_deficit) == (None, None)
        y1, y2 = state.outputs(integral)
        np.testing.assert_allclose(y1[at], x1, atol=1e-12)
        np.testing.assert_allclose(y2[at], [x2[0], without if integral is None else quasi, x2[1]], atol=1e-12)


def test_what_was_found_goes_over_to_other_velocities_and_other_reductions(system):
    """Terms of q alone, and Pinocchio's; nothing else."""
    of_q = ("position", "B", "all_rows", "E_inverse", "J1", "R", "A_star", "H", "mu", "b")
    of_v = ("v", "motion", "v1", "E_dot", "R_dot", "J1_dot", "A_star_dot", "b_dot", "g", "V", "G")
    for places in (np.array(0.7), np.array(0.0), PLACES):
        q, v2 = states(system.generator, places)
        state = StateEvaluation.at(system.evaluator, q, v2)
        found = {name: getattr(state, name) for name in (*of_q, *of_v)}
        values, slip = state.outputs()[0], system.generator.normal(size=(*places.shape, N))
        other = StateEvaluation(state, v=slip)
        assert (other.position, other.factorization) == (state.position, state.factorization)
        for name in of_q[1:]:
            np.testing.assert_array_equal(getattr(other, name), found[name])
        assert all(getattr(other, name) is not found[name] for name in of_v)
        np.testing.assert_array_equal(other.outputs()[0], values)
        assert np.shares_memory(other.E, state.E)
        np.testing.assert_array_equal(other.kept, state.kept)
        seen = StateEvaluation.at(system.evaluator, q, v=slip).in_reduction(system.evaluator)
        np.testing.assert_array_equal(seen.v, slip)
        same = state.in_reduction(evaluator_for(system.parts.in_entries([0, 1, 2], free=True), system.evaluator))
        assert (same.position, same.motion, same.v) == (state.position, state.motion, state.v)
        assert StateEvaluation.at(system.evaluator, q, v2).in_reduction(system.evaluator).q is q


@pytest.mark.parametrize("passive", [False, True])
def test_accelerations_of_rows_are_those_of_the_dynamics(passive):
    """Against the constrained dynamics of the full system, with inputs and without."""
    reduced = arm_on_base(forces=[rnc.forces.Spring(rnc.JointPosition("joint_1"), 30.0)] * passive).reduce()
    (q, v2), rows = random_states(reduced, 1, seed=3)[0], np.random.default_rng(4).normal(size=(3, 4))
    state = reduced.at(q, v2)
    by_input, free = (rows @ each for each in state.input_accelerations)
    A, T = state.A, np.array([3.0, -2.0, 1.0, 4.0])
    spring = np.zeros(5)
    if passive:
        spring[3] = -30.0 * q[reduced.robot.model.joints[reduced.robot.model.getJointId("joint_1")].idx_q]
    matrix = np.block([[state.M, A.T], [A, np.zeros((1, 1))]])
    bias = pin.nonLinearEffects(reduced.robot.model, reduced.robot.model.createData(), q, state.v) - spring
    for inputs in (np.zeros(4), T):
        right = np.concatenate([state.B @ inputs - bias, -(state.A_dot @ state.v)])
        v2_dot = np.linalg.lstsq(state.R, np.linalg.solve(matrix, right)[:5] - state.R_dot @ v2, rcond=None)[0]
        np.testing.assert_allclose(by_input @ inputs + free, rows @ v2_dot, rtol=KKT, atol=1e-10)
