"""Verification of planned inputs by re-integration with a fine step."""

from __future__ import annotations

import numpy as np

from rnc_pin.errors import RncError
from rnc_pin.optimal.action_models import Nodes
from rnc_pin.optimal.motion_plan import PlanVerification
from rnc_pin.optimal.transcription import Iterate, Transcription


def verify_inputs(problem: Transcription, at: Iterate, substeps: int) -> PlanVerification:
    """Integrate the inputs from the start without feedback, and compare with bounds and goal at every fine step."""
    model, K = problem.model, problem.K
    h = at.duration / K / substeps
    step = np.array([h])
    now, q, w = problem.start, [problem.start.q[0]], [problem.start.w[0]]
    try:
        for k in range(K):
            for _ in range(substeps):
                now = model.step(now, at.u[k : k + 1], step)
                q.append(now.q[0])
                w.append(now.w[0])
    except RncError as error:
        return PlanVerification(np.inf, f"re-integration fails: {error}", len(q) * h, np.inf, substeps)
    fine = Iterate(np.array(q), np.array(w), np.repeat(at.u, substeps, axis=0), at.duration)
    blocks = [bound for bound, _ in problem.blocks if bound is not problem.goal]
    same = Transcription(model, problem.start, K * substeps, [], blocks, problem.goal, (at.duration, at.duration))
    worst = same.worst(same.values(fine), at.duration)
    planned, found = Nodes(at.q, at.w), Nodes(fine.q[::substeps], fine.w[::substeps])
    deviation = float(np.abs(model.difference(planned, found)).max())
    return PlanVerification(worst.amount, worst.name, worst.time, deviation, substeps)
