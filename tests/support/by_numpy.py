"""Evaluation without the compiled kernel, and a mark for tests that need it."""

import pytest

from rnc_pin import _kernel
from rnc_pin.model.evaluator import Evaluator
from rnc_pin.model.state_evaluation import StateEvaluation

needs_library = pytest.mark.skipif(
    _kernel.library is _kernel.NUMPY_ALONE, reason="NumPy evaluates: no library, or RNC_PIN_KERNEL=numpy"
)


def by_numpy(reduced, q, *, t=None, **velocity):
    """Evaluation of the same rows without the kernel."""
    evaluator = Evaluator(reduced.reduction_data)
    return StateEvaluation.at(evaluator, q.copy(), t=t, **{name: each.copy() for name, each in velocity.items()})
