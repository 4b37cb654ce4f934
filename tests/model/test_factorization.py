"""Limits of dependence between rows: reselection, refusal, and forces that rows bear. Constant rows."""

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from bodies import add_body
from rnc_pin.model.assembly import Assembly
from rnc_pin.model.configuration_evaluation import ConfigurationEvaluation
from rnc_pin.model.evaluator import evaluator_for
from rnc_pin.model.factorization import dependences
from rnc_pin.model.generalized_forces import Actuation, PassiveForces
from rnc_pin.model.kinematics import Kinematics
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.reduction_data import ReductionData, VelocityRows
from rnc_pin.model.rows import OutputStack, RowStack, check_defined
from rnc_pin.model.state_evaluation import StateEvaluation
from systems import sleigh


class Rails(VelocityRows):
    """Constant rows, which are not the rate of anything."""

    def __init__(self, matrix, first="a"):
        super().__init__(np.array(matrix, dtype=float), [chr(ord(first) + k) for k in range(len(matrix))], [])


def on_rails(rows, kept, reducing, limit, lengths, free=False, masses=None, actuators=()):
    """Parts of a robot whose bodies slide along lines of their own."""
    model, n = pin.Model(), len(reducing[0])
    for k in range(n):
        add_body(model, f"s{k}", "PX", 1.0 if masses is None else masses[k])
    robot, blocks = rnc.Robot(model), [Rails(rows)] if len(rows) else []
    outputs = OutputStack([Rails(reducing, "x")])
    actuation, scales = Actuation(actuators, robot), np.array(lengths, dtype=float)
    shared = Kinematics(robot), PassiveForces((), robot)
    given = (robot, RowStack(blocks), kept, actuation, outputs, OutputStack([]), limit, scales)
    return ReductionData(*given, *shared, free)


def resting(parts, count=None):
    return ConfigurationEvaluation(evaluator_for(parts), np.zeros(parts.n if count is None else (count, parts.n)))


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
    found = dependences(state.E, state.E_inverse, state._data.lengths)
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


def test_settled_outputs_are_the_entries_that_were_chosen():
    for slope, chosen in ((1 / 900, ["s0", "s2"]), (1 / 1100, ["s1", "s2"])):
        rows, entries = edge(slope)
        parts = on_rails(rows, (0,), entries, 1e8, np.ones(3), free=True)
        free = ReducedModel(evaluator_for(parts), Assembly(parts.robot, []))
        settled = free.with_basis_at(np.zeros(3))
        assert list(settled.reducing.names) == chosen
        assert free.at(np.zeros(3)).R.tolist() == settled.at(np.zeros(3)).R.tolist()


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
        assert state.factorization.kept is not None


def test_constraints_that_lose_rank_keep_the_rows_that_they_had():
    """Two rows that are one, and a third at an angle with a sine below the limit, or rounding by its length."""
    for sine, size, length, chosen in (
        (2e-8, 3.0, 1.0, True), (0.5e-8, 3.0, 1.0, False), (0.5, 1e-9, 0.02, True), (0.5, 1e-9, 0.3, False),
        (0.5, 1.0, 0.0, False),
    ):  # fmt: skip
        rows = np.array([[1.0, 0, 0], [1.0, 0, 0], size * np.array([np.sqrt(1 - sine**2), sine, 0.0])])
        state = resting(on_rails(rows, (0, 1), [[0, 0, 1.0]], 1e12, [1.0, 1.0, length, 1.0]))
        assert (state.factorization.kept is not None) == chosen
        assert (state.regular, state.kept.shape) == (chosen, (2,))
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
            _ = ConfigurationEvaluation(evaluator_for(singular), at).R
        np.testing.assert_array_equal(told.value.q, first)
        assert not np.shares_memory(told.value.q, at)
        assert tuple(told.value.rows) == ("a", "b", "c", "y")
        assert told.value.condition == pytest.approx(values[0] / values[-1], rel=1e-3)
    nothing = on_rails([], (), np.diag([3.0, 0.0]), 1e8, [0.0, 0.0])
    with pytest.raises(rnc.SingularityError) as told:
        _ = resting(nothing).R
    assert (told.value.condition, tuple(told.value.rows)) == (pytest.approx(1e300), ("y",))
    assert resting(nothing).condition == np.inf
    np.testing.assert_array_equal(resting(nothing).scaled_stack, np.diag([1.0, 0.0]))
    short = on_rails([], (), np.diag([0.5, -3.0, 0.7]), 1e8, [0.2, 0.0, 1.4])
    np.testing.assert_array_equal(resting(short).scaled_stack, np.diag([1.0, -1.0, 0.5]))


def held(rows, T, lengths, masses=(2.0, 3.0, 5.0), count=None):
    """Bodies on rails that rows of which the first two count keep from moving, but for the last; pushed by T."""
    parts = on_rails(rows, (0, 1), [[0, 0, 1.0]], 1e8, lengths, False, masses, ["s0", "s1", "s2"])
    shape = () if count is None else (count,)
    state = StateEvaluation.at(evaluator_for(parts), np.zeros((*shape, 3)), np.ones((*shape, 1)))
    T = np.broadcast_to(T, (*shape, 3))
    np.testing.assert_allclose(state.v2_dot(T), T[..., 2:] / 5.0, rtol=1e-6)
    np.testing.assert_allclose(state.flow(T).power, T[..., 2], rtol=1e-6)
    return state.contact_forces(T), state.multipliers(T)


@pytest.mark.parametrize("count", [None, 2])
def test_short_rows_bear_forces_and_rounded_ones_do_not(count):
    """A row that was dropped bears its even share."""
    T, short = np.array([7.0, -4.0, 3.0]), 2e-10
    for size in (1.0, 1e3):
        forces, multipliers = held(size * np.diag([1.0, short, 0.0])[:2], T, [size, size * short, 1.0], count=count)
        lead = np.array([7.0 / size, -4.0 / (size * short)])
        np.testing.assert_allclose(multipliers, np.broadcast_to(lead, multipliers.shape), rtol=1e-9)
        np.testing.assert_allclose(forces, np.broadcast_to(-lead, forces.shape), rtol=1e-9)
    rows = np.array([[1.0, 0, 0], [0, 1.0, 0], [1.0, 0, 1e-7]])
    forces, _ = held(rows, T, np.ones(4), count=count)
    np.testing.assert_allclose(forces, np.broadcast_to([-3.5, 4.0, -3.5], forces.shape), atol=1e-5)


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
        (np.zeros((2, 0)), r"\(none\)", 0),
    ):
        words = rf"^actuators {names} reach rank {rank} of the 2 reduced forces: not every F can be realised$"
        with pytest.raises(rnc.ConstraintError, match=words):
            pushed(columns, count).allocate(F)
    for size in (1e-9, 1.0, 1e6):  # however small the forces, none are made up
        with pytest.raises(rnc.ConstraintError, match="reach rank 1 of the 2 reduced forces"):
            pushed(np.array([[0.3, 0.7], [0.9, 2.1 + 3e-13]]), count).allocate(size * F)
    assert not pushed([[2.0, 1.0], [-3.0, 5.0]], count).allocate(0 * F).any()


def test_one_of_many_states_whose_forces_have_no_bound():
    state = pushed(1e10 * np.eye(2), 2)
    state = StateEvaluation.at(state._evaluator, state.q, np.zeros((2, 2)))
    np.testing.assert_allclose(state.v2_dot([[1.0, 2.0], [3.0, -4.0]]), [[1e10, 2e10], [3e10, -4e10]])
    words = r"reduced acceleration is not finite: H is nearly singular or a force is too large$"
    with np.errstate(over="ignore", invalid="ignore"), pytest.raises(rnc.DivergenceError, match=words):
        state.v2_dot([[1.0, 2.0], [3.0, 1e300]])


def test_of_many_states_the_first_that_is_singular_is_told():
    """With its size and the names of its rows; what is not a number has an error of its own, where it comes from."""
    robot, generator = sleigh().robot, np.random.default_rng(0)
    q = np.stack([[robot.random_configuration(generator) for _ in range(3)] for _ in range(2)])
    sizes = np.array([[1.0, 2.0, 1.0], [1.0, 0.25, 0.1]])
    check_defined("small", q[0], np.array([np.nan, 1.0, 1.0]), 0.5, ("row",))
    with pytest.raises(rnc.SingularityError, match="small") as told:
        check_defined("small", q, sizes, 0.5, ("row",))
    assert (told.value.q.tolist(), told.value.condition, told.value.rows) == (q[1, 1].tolist(), 4.0, ("row",))
