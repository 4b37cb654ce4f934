"""Evaluation without the compiled kernel."""

from rnc_pin.model.evaluator import Evaluator
from rnc_pin.model.state_evaluation import StateEvaluation


def by_numpy(reduced, q, *, t=None, **velocity):
    """Evaluation of the same rows without the kernel."""
    evaluator = Evaluator(reduced.reduction_data)
    return StateEvaluation.at(evaluator, q.copy(), t=t, **{name: each.copy() for name, each in velocity.items()})
