"""Evaluators: what a compiled one declines, when it is compared, and the names of what it fills."""

from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest

import rnc_pin as rnc
from rnc_pin import _kernel
from rnc_pin.math.linear_algebra import null_space
from rnc_pin.model import reduced_kinematics
from rnc_pin.model.compiled import evaluator_for
from rnc_pin.model.compiled_states import CompiledArraysAtQ, CompiledArraysAtV
from rnc_pin.model.evaluator import _Filled
from rnc_pin.model.numpy_evaluator import NumPyEvaluator
from rnc_pin.model.state_evaluation import StateEvaluation
from systems import mobile_manipulator, random_states, tiago

needs_kernel = pytest.mark.skipif(_kernel.library is _kernel.NUMPY_ALONE, reason="NumPy evaluates every model")


@needs_kernel
def test_whole_calls_of_a_compiled_evaluator_are_those_of_numpy_where_it_declines():
    """Two velocities depend on each other so nearly that others replace them."""
    reduced = mobile_manipulator()
    ((q, v2),) = random_states(reduced, 1)
    W = null_space(reduced.at(q).A).T
    W[1] = np.cos(1e-4) * W[0] + np.sin(1e-4) * W[1]
    data = reduced.reduction_data.in_velocities(W, free=True)
    compiled, plain = evaluator_for(data, reduced.evaluator), NumPyEvaluator(data)
    assert compiled.compiled
    assert compiled.at(q).compiled_kinematics is None
    T, external, damping = np.ones(data.p), np.full(data.n, 0.1), np.full(data.n, 0.2)
    for call in (
        lambda by: by.forward_dynamics(q, v2, T, None),
        lambda by: by.inverse_dynamics(q, v2, v2, None),
        lambda by: by.terms(q, v2).V,
        lambda by: by.state_derivative(q.copy(), v2, T, external, damping)[1],
        lambda by: by.admissible_velocity(q.copy(), v2)[0],
        lambda by: by.measured(q.copy(), np.ones(data.n)).residual,
    ):
        np.testing.assert_allclose(call(compiled), call(plain), rtol=1e-9)


def test_an_evaluator_is_made_again_from_its_data():
    reduced = mobile_manipulator()
    ((q, v2),) = random_states(reduced, 1)
    copied = deepcopy(reduced)
    assert copied.evaluator.compiled == reduced.evaluator.compiled
    assert copied.evaluator.data is copied.reduction_data
    T = np.ones(reduced.p)
    np.testing.assert_array_equal(copied.forward_dynamics(q, v2, T), reduced.forward_dynamics(q, v2, T))
    state = reduced.at(q, v2)
    expected = state.A_star_dot.copy()
    np.testing.assert_allclose(deepcopy(state).A_star_dot, expected, rtol=1e-12, atol=1e-15)
    assert not {"arrays_at_q", "arrays_at_v"} & vars(deepcopy(state)).keys()


@needs_kernel
def test_rows_that_were_compared_are_not_compared_again(monkeypatch):
    """Velocities ``W v`` have constant rows; other outputs are new."""
    reduced = tiago()
    data, compared = reduced.reduction_data, []
    monkeypatch.setattr("rnc_pin.model.compiled._difference", lambda found: compared.append(found.data) or 0.0)
    entries = data.in_entries(range(data.r))
    assert entries.varies_as(data)
    assert evaluator_for(entries, reduced.evaluator).compiled
    assert not compared
    other = replace(data, vertical=type(data.vertical)([rnc.FramePosition(tiago_frame(reduced)).bind(data.robot)]))
    assert not other.varies_as(data)
    evaluator_for(other, reduced.evaluator)
    evaluator_for(entries)
    evaluator_for(entries, NumPyEvaluator(data))
    assert compared == [other, entries, entries]


def tiago_frame(reduced):
    return reduced.robot.model.frames[-1].name


@pytest.mark.parametrize("arrays", [CompiledArraysAtQ, CompiledArraysAtV])
def test_arrays_have_the_names_of_quantities(arrays):
    """An array by another name would never be used."""
    records = {"vertical", "biases", "rates"}
    names = {name for name, entry in vars(arrays).items() if hasattr(entry, "__get__") and name[0] != "_"} - records
    methods = {"position_of", "output_values"}  # of ``ArraysAtQ``
    for name in names - methods:
        quantity = getattr(StateEvaluation, name, None) or getattr(reduced_kinematics, name)
        assert isinstance(quantity, _Filled) or hasattr(quantity, "__wrapped__"), name


def test_a_library_without_a_kernel_declines_every_call():
    assert _kernel.NUMPY_ALONE.track(np.zeros(3), 1.0) is False
    assert (rnc.kernel == "numpy") == (_kernel.library is _kernel.NUMPY_ALONE)
