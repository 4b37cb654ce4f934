"""One evaluation beside plain algebra: rows given by formulas, on a robot in which nothing is zero, one or the same."""

from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from rnc_pin.model.actuation import Actuation
from rnc_pin.model.reduction_data import ReductionData, VelocityRows
from rnc_pin.model.row_stack import OutputStack, RowStack
from rnc_pin.model.rows import OutputRows
from rnc_pin.model.state_evaluation import StateEvaluation

N, MEET = 5, 0.3  # degrees of freedom; first coordinate at which the first two constraint rows are parallel


def arm():
    """Five joints of both kinds, each on the one before, with frames at the end."""
    model = pin.Model()
    model.name = "arm"
    joint, generator = 0, np.random.default_rng(11)
    for name, kind in zip("abcde", ("PZ", "RX", "PY", "RZ", "RY"), strict=True):
        turn = pin.rpy.rpyToMatrix(*generator.uniform(-1, 1, 3))
        joint = model.addJoint(joint, getattr(pin, f"JointModel{kind}")(), pin.SE3(turn, np.ones(3)), name)
        body = pin.Inertia(generator.uniform(1, 3), generator.uniform(-0.3, 0.3, 3), np.diag([0.3, 0.4, 0.5]))
        model.appendBodyToJoint(joint, body, pin.SE3.Identity())
    place = pin.SE3(pin.rpy.rpyToMatrix(0.3, 0.5, -0.8), np.array([0.1, -0.2, 0.4]))
    model.addFrame(pin.Frame("tip", joint, 0, place, pin.FrameType.OP_FRAME))
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
def system():
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
    parts = ReductionData(
        robot, RowStack([rows]), (0, 1), actuation, OutputStack(reducing), OutputStack([vertical]), 1e8, lengths
    )
    still = Actuation(generator.normal(size=(N, 4)), robot)
    steady = ReductionData(robot, RowStack([]), (), still, OutputStack([]), OutputStack([]), 1e8, lengths[:0])
    return SimpleNamespace(
        robot=robot, parts=parts, steady=steady, rows=rows, weights=weights, directions=directions, speeds=speeds,
        vertical=vertical, ends=ends, W=W, generator=np.random.default_rng(8),
    )  # fmt: skip


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
    G = R.T @ (g + M @ b_dot + C @ b)
    reduced = R.T @ actuators
    found = {
        "R": R,
        "b": b,
        "v": v,
        "v2": v2,
        "J2": J2,
        "R_dot": R_dot,
        "b_dot": b_dot,
        "M": M,
        "C": C,
        "g": g,
        "B": actuators,
        "H": H,
        "V": V,
        "G": G,
    }
    found |= {"input_matrix": reduced, "bias": C @ v + g}
    all_rows = W.at(q) @ B.at(q)
    all_rates = W.at(q) @ m.at(q)
    all_rows_dot = W.rate(v) @ B.at(q) + W.at(q) @ B.rate(v)
    all_rates_dot = W.rate(v) @ m.at(q) + W.at(q) @ m.rate(v)
    J1, J1_dot = x.directions.at(q), x.directions.rate(v)
    found |= {
        "all_rows": all_rows,
        "J1": J1,
        "J1_dot": J1_dot,
        "v1": J1 @ v,
        "A_star": J1 @ R,
        "A_star_dot": J1_dot @ R + J1 @ R_dot,
    }
    kinetic = 0.5 * v @ M @ v
    found |= {"kinetic_energy": kinetic, "energy": kinetic + pin.computePotentialEnergy(model, data, q)}

    def accelerations(force):
        v2_dot = np.linalg.solve(H, R.T @ force - V @ v2 - G)
        v_dot = R @ v2_dot + R_dot @ v2 + b_dot
        return v2_dot, v_dot, force - M @ v_dot - C @ v - g

    v2_dot, v_dot, left = accelerations(actuators @ T)
    calls = {"v2_dot": v2_dot, "contact_forces": np.linalg.pinv(all_rows.T, rcond=1e-9) @ left}
    damped, damped_dot, _ = accelerations(actuators @ T - damping * v)
    calls |= {"flow": (v, damped, v @ (M @ damped_dot + C @ v + g)), "v_dot": v_dot}
    calls |= {"inverse_dynamics": H @ v2_dot + V @ v2 + G, "allocate": np.linalg.pinv(reduced) @ v2_dot, "left": left}
    return found, calls, all_rows, all_rows_dot, all_rates, all_rates_dot, J2_dot


def assert_close(there, here, what):
    np.testing.assert_allclose(there, here, rtol=1e-7, atol=1e-7 * (1 + np.abs(here).max(initial=0.0)), err_msg=what)


@pytest.mark.parametrize("single", [True, False])
def test_all_of_it_where_other_rows_had_to_be_chosen(system, single):
    """R, the forces and all that follows do not depend on the choice; what is of the rows is of those in A."""
    q, v2 = states(system.generator, PLACES)
    T, damping = system.generator.normal(size=(2, 3, 4)), np.linspace(0.1, 0.9, N)
    many = StateEvaluation.at(system.parts, q, v2)
    for i in np.ndindex(2, 3):
        state, at = (StateEvaluation.at(system.parts, q[i], v2[i]), ()) if single else (many, i)
        inputs = T[i] if single else T
        found, calls, all_rows, all_rows_dot, all_rates, all_rates_dot, J2_dot = plain(
            system, q[i], v2[i], T[i], damping
        )
        for name, here in found.items():
            assert_close(getattr(state, name)[at], here, name)
        assert_close(StateEvaluation.at(system.steady, state.q).B[at], system.steady.actuation.constant, "constant B")
        kept = np.broadcast_to(state.kept, (2, 3, 2))[i]
        default = PLACES[i] not in (0.0, 1e-6, 1e-5)
        assert kept.tolist() == [0, 1] or not default
        assert (kept.tolist() == [0, 1]) == default
        A, A_dot = all_rows[kept], all_rows_dot[kept]
        assert_close(state.A[at], A, "A")
        assert_close(state.A_dot[at], A_dot, "A_dot")
        assert_close(state.E[at], np.vstack([A, found["J2"]]), "E")
        assert_close(state.E_dot[at], np.vstack([A_dot, J2_dot]), "E_dot")
        assert_close(state.E_inverse[at] @ state.E[at], np.eye(N), "E_inverse")
        assert_close(state.mu[at], all_rates[kept], "mu")
        v = found["v"]
        assert_close(state.gamma[at], np.concatenate([A_dot @ v - all_rates_dot[kept], J2_dot @ v]), "gamma")
        assert_close(state.residual[at], np.zeros(2), "residual")
        for call in ("v2_dot", "contact_forces"):
            assert_close(getattr(state, call)(inputs)[at], calls[call], call)
        for there, here in zip(state.flow(inputs, damping), calls["flow"], strict=True):
            assert_close(there[at], here, "flow")
        v2_dot = state.v2_dot(inputs)
        for call in ("v_dot", "inverse_dynamics", "allocate"):
            assert_close(getattr(state, call)(v2_dot)[at], calls[call], call)
        multipliers = state.multipliers(inputs)[at]
        if default:
            assert_close(A.T @ multipliers, calls["left"], "multipliers")
        else:
            assert np.isnan(multipliers).all()
        lengths = np.linalg.norm(state.E[at], axis=1)
        natural = np.concatenate([system.parts.lengths[:0], np.array([1.1, 0.9, 1.3, 0.7])[kept], [1.0, 2.0, 0.5]])
        scaled = state.E[at] / np.maximum(lengths, natural)[:, None]
        assert_close(state.scaled_stack[at], scaled, "scaled_stack")
        values = np.linalg.svd(scaled, compute_uv=False)
        assert_close(np.asarray(state.condition)[at], values[0] / values[-1], "condition")
        assert_close(np.asarray(state.smallest_singular_value)[at], values[-1], "smallest_singular_value")
        assert np.asarray(state.regular)[at]


@pytest.mark.parametrize("single", [True, False])
def test_all_of_it_of_a_velocity_as_measured(system, single):
    """What is measured slips: gamma and rates are along it, and R, b and A keep to what the rows say."""
    q, v2 = states(system.generator, PLACES)
    slipping = system.generator.normal(size=(2, 3, N))
    integrals = system.generator.normal(size=(2, 3, 3))
    for i in np.ndindex(2, 3):
        state, at = (
            (StateEvaluation.at(system.parts, q[i], v=slipping[i]), ())
            if single
            else (
                StateEvaluation.at(system.parts, q, v=slipping),
                i,
            )
        )
        found, _, all_rows, all_rows_dot, all_rates, all_rates_dot, J2_dot = plain(
            system, q[i], v2[i], np.zeros(4), np.zeros(N), slipping[i]
        )
        kept, v = np.broadcast_to(state.kept, (2, 3, 2))[i], slipping[i]
        for name, here in found.items():
            assert_close(getattr(state, name)[at], here, name)
        assert_close(state.residual[at], all_rows[kept] @ v - all_rates[kept], "residual")
        bias_acceleration = np.concatenate([all_rows_dot[kept] @ v - all_rates_dot[kept], J2_dot @ v])
        assert_close(state.gamma[at], bias_acceleration, "gamma")
        b, J1, J1_dot = found["b"], found["J1"], found["J1_dot"]
        x1 = system.vertical.values.at(q[i])
        x2 = [each.values.at(q[i])[0] for each in system.ends]
        own = integrals[i][1]
        given = integrals[i] if single else integrals
        measured, without = state.measure(given), state.measure()
        for measurement, quasi in ((measured, own), (without, np.nan)):
            expected = {
                "q": q[i], "v": v, "v2": found["v2"], "x1": x1, "x2": np.array([x2[0], quasi, x2[1]]), "v1": J1 @ v,
                "A_star": found["A_star"], "A_star_dot": found["A_star_dot"], "v1_offset": J1 @ b,
                "v1_offset_dot": J1_dot @ b + J1 @ found["b_dot"],
                "residual": all_rows[kept] @ v - all_rates[kept],
            }  # fmt: skip
            for name, here in expected.items():
                there = getattr(measurement, name)[at]
                np.testing.assert_allclose(
                    there, here, rtol=1e-7, atol=1e-6 * (1 + np.nanmax(np.abs(here))), err_msg=name
                )
        for integral, quasi in ((given, own), (None, 0.0)):
            y1, y2 = state.outputs(integral)
            np.testing.assert_allclose(y1[at], x1, atol=1e-12)
            np.testing.assert_allclose(y2[at], [x2[0], quasi, x2[1]], atol=1e-12)
        assert (measured.force_deficit, measured.input_deficit) == (None, None)


def test_what_was_found_goes_over_to_other_velocities_and_other_reductions(system):
    """What depends on q alone, and what Pinocchio has said; nothing else."""
    of_q = ("position", "B", "all_rows", "E_inverse", "J1", "R", "A_star", "H", "mu", "b")
    of_v = ("v", "motion", "rates", "v1", "E_dot", "R_dot", "J1_dot", "A_star_dot", "b_dot", "g", "V", "G")
    for places in (np.array(0.7), np.array(0.0), PLACES):
        q, v2 = states(system.generator, places)
        state = StateEvaluation.at(system.parts, q, v2)
        found = {name: getattr(state, name) for name in (*of_q, *of_v)}
        values, slip = state.outputs()[0], system.generator.normal(size=(*places.shape, N))
        other = state.with_velocity(slip)
        assert all(getattr(other, name) is found[name] for name in of_q)
        assert all(getattr(other, name) is not found[name] for name in of_v)
        assert other.outputs()[0] is values
        assert other.E is state.E
        np.testing.assert_array_equal(other.kept, state.kept)
        seen = StateEvaluation.at(system.parts, q, v=slip).in_reduction(system.parts)
        np.testing.assert_array_equal(seen.v, slip)
        same = state.in_reduction(system.parts.in_entries([0, 1, 2], free=True))
        assert (same.position, same.motion, same.v) == (state.position, state.motion, state.v)
        assert StateEvaluation.at(system.parts, q, v2).in_reduction(system.parts).q is q
