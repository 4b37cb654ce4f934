"""Motions of single reducing outputs at unit rate, for gradients along them."""

from __future__ import annotations

import numpy as np

from rnc_pin.control.whole_body.control_sample import ControlSample
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.state_evaluation import StateEvaluation


def along_unit_motions(reduced: ReducedModel, sample: ControlSample) -> StateEvaluation:
    """Return the end of a sample, evaluated with each column of R as velocity; one leading axis (r,).

    Rates of this evaluation are derivatives along single reducing outputs.
    """
    columns = sample.end.R.T
    q = np.broadcast_to(sample.end.q, (len(columns), reduced.robot.nq))
    return reduced.at(q, v=columns, t=sample.time)
