"""One evaluation beside plain algebra: rows given by formulas, on a robot in which nothing is zero, one or the same."""

from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from rnc_pin.model.actuation import Actuation
from rnc_pin.model.evaluation import Evaluation
from rnc_pin.model.parts import Parts, VelocityRows
from rnc_pin.model.row_stack import OutputStack, RowStack
from rnc_pin.model.rows import OutputRows

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

    def drift(self, at):
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
    parts = Parts(
        robot, RowStack([rows]), (0, 1), actuation, OutputStack(reducing), OutputStack([vertical]), 1e8, lengths
    )
    return SimpleNamespace(
        robot=robot, parts=parts, rows=rows, weights=weights, directions=directions, speeds=speeds,
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
    many = Evaluation(system.parts, q, v2)
    for i in np.ndindex(2, 3):
        state, at = (Evaluation(system.parts, q[i], v2[i]), ()) if single else (many, i)
        inputs = T[i] if single else T
        found, calls, all_rows, all_rows_dot, all_rates, all_rates_dot, J2_dot = plain(
            system, q[i], v2[i], T[i], damping
        )
        for name, here in found.items():
            assert_close(getattr(state, name)[at], here, name)
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
        assert_close(state.scaled_stack()[at], scaled, "scaled_stack")
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
            (Evaluation(system.parts, q[i], v=slipping[i]), ())
            if single
            else (
                Evaluation(system.parts, q, v=slipping),
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
        drift = np.concatenate([all_rows_dot[kept] @ v - all_rates_dot[kept], J2_dot @ v])
        assert_close(state.gamma[at], drift, "gamma")
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
        assert (measured.excess, measured.missing) == (None, None)


def test_what_was_found_goes_over_to_other_velocities_and_other_reductions(system):
    """What depends on q alone, and what Pinocchio has said; nothing else."""
    of_q = ("position", "B", "all_rows", "E_inverse", "J1", "R", "A_star", "H", "mu", "b")
    of_v = ("v", "motion", "rates", "v1", "E_dot", "R_dot", "J1_dot", "A_star_dot", "b_dot", "g", "V", "G")
    for places in (np.array(0.7), np.array(0.0), PLACES):
        q, v2 = states(system.generator, places)
        state = Evaluation(system.parts, q, v2)
        found = {name: getattr(state, name) for name in (*of_q, *of_v)}
        values, slip = state.outputs()[0], system.generator.normal(size=(*places.shape, N))
        other = state.moving(slip)
        assert all(getattr(other, name) is found[name] for name in of_q)
        assert all(getattr(other, name) is not found[name] for name in of_v)
        assert other.outputs()[0] is values
        assert other.E is state.E
        np.testing.assert_array_equal(other.kept, state.kept)
        seen = Evaluation(system.parts, q, v=slip).as_seen_by(system.parts)
        np.testing.assert_array_equal(seen.v, slip)
        same = state.as_seen_by(system.parts.in_entries([0, 1, 2], free=True))
        assert (same.position, same.motion, same.v) == (state.position, state.motion, state.v)
        assert Evaluation(system.parts, q, v2).as_seen_by(system.parts).q is q


# ---------------------------------------------------------------------- how dependent rows may be


class Rails(VelocityRows):
    """Constant rows, which are not the rate of anything."""

    def __init__(self, matrix, first="a"):
        super().__init__(np.array(matrix, dtype=float), [chr(ord(first) + k) for k in range(len(matrix))], [])


def on_rails(rows, kept, reducing, limit, lengths, free=False, masses=None, actuators=()):
    """Parts of a robot whose bodies slide along lines of their own."""
    model, n = pin.Model(), len(reducing[0])
    for k in range(n):
        joint = model.addJoint(0, pin.JointModelPX(), pin.SE3.Identity(), f"s{k}")
        body = pin.Inertia(1.0 if masses is None else masses[k], np.zeros(3), np.eye(3))
        model.appendBodyToJoint(joint, body, pin.SE3.Identity())
    robot, blocks = rnc.Robot(model), [Rails(rows)] if len(rows) else []
    outputs = OutputStack([Rails(reducing, "x")])
    actuation = Actuation(actuators, robot)
    return Parts(
        robot, RowStack(blocks), kept, actuation, outputs, OutputStack([]), limit, np.array(lengths, dtype=float), free
    )


def resting(parts, count=None):
    return Evaluation(parts, np.zeros(parts.n if count is None else (count, parts.n)))


def test_one_state_is_settled_at_once_where_norms_say_that_no_row_depends_on_the_others():
    """``(|E|^2 + lengths^2) |E^-1|^2`` below the limit squared; elsewhere row by row, with the same result."""
    sizes, lengths = np.array([0.5, 3.0, 4.0]), np.array([1.0, 2.0, 5.5])
    product = ((sizes**2).sum() + (lengths**2).sum()) * (sizes**-2.0).sum()
    for factor, quickly in ((1 + 1e-6, True), (1 - 1e-6, False)):
        parts = on_rails([], (), np.diag(sizes), np.sqrt(product) * factor, lengths)
        one, many = resting(parts), resting(parts, 2)
        _ = one.E, many.E
        assert ("R" in vars(one), one._settled[2] is True) == (quickly, quickly)
        assert one.regular.shape == ()
        assert one.regular
        np.testing.assert_array_equal(many.regular, [True, True])
        for state in (one, many):
            np.testing.assert_allclose(state.R, np.broadcast_to(np.diag(1 / sizes), state.R.shape), atol=1e-15)
            np.testing.assert_array_equal(state.E_inverse, state.R)


@pytest.mark.parametrize("count", [None, 3])
def test_each_row_is_as_dependent_as_its_angle_to_the_others_is_small(count):
    """One over its sine; a row that is shorter than elsewhere counts for what it is long there."""
    E = np.random.default_rng(2).normal(size=(4, 4)) * np.array([[0.3], [2.0], [5.0], [0.7]])
    lengths = np.array([0.1, 4.0, 0.2, 3.0])
    state = resting(on_rails(E[:2], (0, 1), E[2:], 1e8, lengths), count)
    expected = []
    for k in range(4):
        others = np.delete(E, k, axis=0)
        rest = np.linalg.norm(E[k] - np.linalg.lstsq(others.T, E[k])[0] @ others)
        expected.append(max(np.linalg.norm(E[k]), lengths[k]) / rest)
    found = state._dependences(state.E, state.E_inverse)
    np.testing.assert_allclose(found, np.broadcast_to(expected, found.shape), rtol=1e-10)
    assert found.shape == (*state.q.shape[:-1], 4)
    worst = max(expected)
    for limit, regular in ((worst * (1 + 1e-9), True), (worst * (1 - 1e-9), False)):
        state = resting(on_rails(E[:2], (0, 1), E[2:], limit, lengths), count)
        assert state.regular.shape == state.q.shape[:-1]
        assert (state.regular == regular).all()
        if not regular:
            with pytest.raises(rnc.SingularityError):
                _ = state.R


def edge(slope):
    """Row and entries 0 and 2 of a knife edge: the sine of its angle to the first entry is the slope."""
    return [[-np.sqrt(1 - slope**2), slope, 0.0]], np.eye(3)[[0, 2]]


@pytest.mark.parametrize("count", [None, 2])
def test_others_are_looked_for_from_a_thousandth_on_or_the_limit(count):
    for limit, slope, chosen in (
        (1e8, 1 / 900, [0, 2]),
        (1e8, 1 / 1100, [1, 2]),
        (1e8, 0.0, [1, 2]),
        (50.0, 1 / 45, [0, 2]),
        (50.0, 1 / 55, [1, 2]),
    ):
        rows, entries = edge(slope)
        state = resting(on_rails(rows, (0,), entries, limit, np.ones(3), free=True), count)
        np.testing.assert_array_equal(state.J2, np.broadcast_to(np.eye(3)[chosen], state.J2.shape))
        np.testing.assert_allclose(state.A @ state.R, np.zeros((*state.q.shape[:-1], 1, 2)), atol=1e-12)
        np.testing.assert_allclose(state.J2 @ state.R, np.broadcast_to(np.eye(2), (*state.q.shape[:-1], 2, 2)))
        assert state.regular.all()
        named = resting(on_rails(rows, (0,), entries, limit, np.ones(3)), count)  # outputs that are meant
        np.testing.assert_array_equal(named.J2, np.broadcast_to(entries, named.J2.shape))
        assert (named.regular == (slope * limit > 1)).all()


@pytest.mark.parametrize("count", [None, 2])
def test_rows_are_chosen_anew_where_they_are_not_well(count):
    """By the smallest singular value of those kept, ``sqrt(2) sin(a / 2)`` at an angle a; outputs are chosen anyway."""
    for value, kept in ((1.06e-3, [0, 1]), (0.94e-3, [0, 2]), (0.0, [0, 2])):
        angle = 2 * np.arcsin(value / np.sqrt(2))
        rows = np.array([[1.0, 0, 0, 0], [np.cos(angle), np.sin(angle), 0, 0], [0.1, 1.0, 0, 0]])
        rows *= np.array([[2.0], [0.4], [3.0]])
        lengths = [0.5, 0.3, 0.2, 1.0, 1.0]
        state = resting(on_rails(rows, (0, 1), np.eye(4)[[0, 2]], 1e8, lengths, free=True), count)
        np.testing.assert_array_equal(state.J2, np.broadcast_to(np.eye(4)[[2, 3]], state.J2.shape))
        found = np.broadcast_to(state.kept, (*state.q.shape[:-1], 2))
        assert found.tolist() == np.broadcast_to(kept, found.shape).tolist() or kept != [0, 1]
        assert (found == [0, 1]).all() == (kept == [0, 1])
        np.testing.assert_array_equal(state.A, rows[found])
        assert state._by_default is False


def test_rows_that_are_short_beside_their_length_elsewhere_count_for_less():
    """At right angles, the shorter of two is chosen where it is long for what it is."""
    for sizes, lengths, kept in (
        ((3.0, 1.0), (3.0, 1.0), None),
        ((3.0, 1.0), (1.0, 100.0), 1),
        ((3.0, 1.0), (300.0, 1.0), 2),
        ((0.1, 0.01), (0.0, 0.02), 2),  # what has no length elsewhere is rounding, whatever it is here
        ((0.1, 0.01), (0.2, 0.0), 1),
    ):
        rows = np.zeros((3, 3))
        rows[0, 0], rows[1, [0, 1]], rows[2, [0, 1]] = (
            1e-9,
            (0.9 * sizes[0], np.sqrt(0.19) * sizes[0]),
            (
                0.9 * sizes[1],
                -np.sqrt(0.19) * sizes[1],
            ),
        )
        state = resting(on_rails(rows, (0,), np.eye(3)[[1, 2]], 1e8, [1.0, *lengths, 1.0, 1.0]))
        assert state.kept.tolist() == ([kept] if kept else state.kept.tolist())
        assert state.regular


def test_constraints_that_lose_rank_keep_the_rows_that_they_had():
    """Two rows that are one, and a third at an angle with a sine below the limit, or rounding by its length."""
    for sine, size, length, chosen in (
        (2e-8, 3.0, 1.0, True),
        (0.5e-8, 3.0, 1.0, False),
        (0.5, 1e-9, 0.02, True),
        (0.5, 1e-9, 0.3, False),
        (0.5, 1.0, 0.0, False),
    ):
        third = size * np.array([np.sqrt(1 - sine**2), sine, 0.0])
        rows = np.array([[1.0, 0, 0], [1.0, 0, 0], third])
        state = resting(on_rails(rows, (0, 1), [[0, 0, 1.0]], 1e12, [1.0, 1.0, length, 1.0]))
        assert state._by_default != chosen
        assert state.regular == chosen
        assert state.kept.shape == (2,)
        if chosen:
            assert 2 in state.kept


def test_the_first_state_that_is_singular_is_told_with_the_rows_that_matter():
    """Weights 1, 0.2, 0.12 and 0.08 beside one: the last is below a tenth of the largest."""
    E = 0.8 * np.eye(5)
    E[4, :4] = 0.8 * np.array([-1.0, 0.2, 0.12, 0.08])
    parts = on_rails(E[:3], (0, 1, 2), E[3:], 1e8, np.full(5, 2.0))
    E[4, 4] = 1e-10
    singular = on_rails(E[:3], (0, 1, 2), E[3:], 1e8, np.full(5, 2.0))
    assert resting(parts).regular
    q = np.arange(30.0).reshape(2, 3, 5)
    values = np.linalg.svd(E / 2.0, compute_uv=False)
    for at, first in ((q, q[0, 0]), (q[1], q[1, 0]), (q[1, 2], q[1, 2])):
        with pytest.raises(rnc.SingularityError, match="singular configuration") as told:
            _ = Evaluation(singular, at).R
        np.testing.assert_array_equal(told.value.q, first)
        assert not np.shares_memory(told.value.q, at)
        assert tuple(told.value.rows) == ("a", "b", "c", "y")
        assert told.value.condition == pytest.approx(values[0] / values[-1], rel=1e-3)
    nothing = on_rails([], (), np.diag([3.0, 0.0]), 1e8, [0.0, 0.0])
    with pytest.raises(rnc.SingularityError) as told:
        _ = resting(nothing).R
    assert told.value.condition == pytest.approx(1e300)
    assert tuple(told.value.rows) == ("y",)
    assert resting(nothing).condition == np.inf
    np.testing.assert_array_equal(resting(nothing).scaled_stack(), np.diag([1.0, 0.0]))


# ---------------------------------------------------------------------- forces


def held(rows, T, lengths, masses=(2.0, 3.0, 5.0), count=None):
    """Bodies on rails that rows of which the first two count keep from moving, but for the last; pushed by T."""
    parts = on_rails(rows, (0, 1), [[0, 0, 1.0]], 1e8, lengths, False, masses, ["s0", "s1", "s2"])
    shape = () if count is None else (count,)
    state = Evaluation(parts, np.zeros((*shape, 3)), np.ones((*shape, 1)))
    T = np.broadcast_to(T, (*shape, 3))
    np.testing.assert_allclose(state.v2_dot(T), T[..., 2:] / 5.0, rtol=1e-6)
    return state.contact_forces(T), state.multipliers(T)


@pytest.mark.parametrize("count", [None, 2])
def test_short_rows_bear_forces_and_rounded_ones_do_not(count):
    """A row that a tenth of a billionth of another is long bears nothing; one that was dropped, its even share."""
    T = np.array([7.0, -4.0, 3.0])
    for short, bears in ((2e-10, True), (0.5e-10, False)):
        for size in (1.0, 1e3):
            rows = size * np.array([[1.0, 0, 0], [0, short, 0]])
            forces, multipliers = held(rows, T, [size, size * short, 1.0], count=count)
            lead = np.array([7.0 / size, -4.0 / (size * short)])
            np.testing.assert_allclose(multipliers, np.broadcast_to(lead, multipliers.shape), rtol=1e-9)
            np.testing.assert_allclose(forces, np.broadcast_to(lead * [1, bears], forces.shape), rtol=1e-9)
    rows = np.array([[1.0, 0, 0], [0, 1.0, 0], [1.0, 0, 1e-7]])
    forces, _ = held(rows, T, np.ones(4), count=count)
    np.testing.assert_allclose(forces, np.broadcast_to([3.5, -4.0, 3.5], forces.shape), atol=1e-5)


def pushed(columns, count=None):
    """Two reduced forces from inputs at constant columns, in batch where asked for."""
    parts = on_rails([], (), np.eye(2), 1e8, np.ones(2), False, None, np.array(columns, dtype=float))
    return resting(parts, count)


@pytest.mark.parametrize("count", [None, 3])
def test_inputs_are_the_smallest_that_give_the_forces(count):
    F = np.array([2.0, -6.0]) if count is None else np.array([[2.0, -6.0], [0.5, 4.0], [1e6, 1.0]])
    for columns in ([[2.0, 1.0], [-3.0, 5.0]], [[2.0, 1.0, 0.3], [-3.0, 5.0, 7.0]], [[1.0, 1.0], [1.0, 1.0 + 1e-9]]):
        T, matrix = pushed(columns, count).allocate(F), np.array(columns)
        atol = 1e-5 if columns[0][0] == 1.0 else 1e-8
        np.testing.assert_allclose(np.matvec(matrix, T), F, atol=atol * np.abs(F).max())
        if matrix.shape[1] == 3:  # nothing of what moves nothing
            np.testing.assert_allclose(T @ np.cross(*matrix), 0.0, atol=1e-8 * np.abs(T).max())
    for columns, names, rank in (
        ([[1.0, 2.0], [2.0, 4.0]], r"T\[0\], T\[1\]", 1),
        ([[1.0], [2.0]], r"T\[0\]", 1),
        ([[0.0, 0.0], [0.0, 0.0]], r"T\[0\], T\[1\]", 0),
        ([[1.0, 1.0, 1.0], [1.0, 1.0, 1.0 + 0.7e-10]], r"T\[0\], T\[1\], T\[2\]", 1),
        (np.zeros((2, 0)), r"\(none\)", 0),
    ):
        words = rf"^actuators {names} reach rank {rank} of the 2 reduced forces: not every F can be realised$"
        with pytest.raises(rnc.ConstraintError, match=words):
            pushed(columns, count).allocate(F)
    assert np.isfinite(pushed([[1.0, 1.0, 1.0], [1.0, 1.0, 1.0 + 5e-10]], count).allocate(F)).all()


def test_one_of_many_states_whose_forces_have_no_bound():
    state = pushed(1e10 * np.eye(2), 2)
    state = Evaluation(state._parts, state.q, np.zeros((2, 2)))
    np.testing.assert_allclose(state.v2_dot([[1.0, 2.0], [3.0, -4.0]]), [[1e10, 2e10], [3e10, -4e10]])
    with (
        np.errstate(over="ignore", invalid="ignore"),
        pytest.raises(rnc.DivergenceError, match=r"accelerations have no bound$"),
    ):
        state.v2_dot([[1.0, 2.0], [3.0, 1e300]])
