"""Execution of many scenarios at once, each with the bits of its execution alone."""

from __future__ import annotations

import time
from collections.abc import Hashable, Sequence

import numpy as np

from rnc_pin.control.whole_body.whole_body_program import program_of
from rnc_pin.errors import RncError
from rnc_pin.scenario.execution import Plan, Result, run_options
from rnc_pin.scenario.run_verdict import judged_summary
from rnc_pin.simulation import sample_count
from rnc_pin.simulation.side_by_side import RunArguments, lock_step_key, simulate_side_by_side


def batch_key(plan: Plan) -> Hashable | None:
    """Key that plans have in common if ``execute_together`` takes them; None for a plan that has to be alone."""
    experiment = plan.experiment
    if plan.comparisons or experiment.phases or program_of(experiment.controller) is not None:
        return None
    return lock_step_key(_arguments(plan))


def execute_together(plans: Sequence[Plan]) -> list[Result | RncError]:
    """Run plans with the same ``batch_key`` in lock-step, each with the bits of ``execute``; or their errors.

    Args:
        plans: what to run; each on objects of its own, except for the model.
    """
    start = time.perf_counter()
    with np.errstate(over="ignore", invalid="ignore"):  # diverged values
        found: list[Result | RncError] = []
        for plan, run in zip(plans, simulate_side_by_side([_arguments(plan) for plan in plans]), strict=True):
            if run.started:
                trajectory, wall_time = run.trajectory, (time.perf_counter() - start) / len(plans)
                summary, limits = judged_summary(plan.experiment, trajectory, {}, wall_time)
                found.append(Result(trajectory, summary, _reported(run.error), limits=limits))
            else:
                assert isinstance(run.error, RncError)
                found.append(run.error)
    return found


def _reported(error: Exception | None) -> RncError | None:
    assert error is None or isinstance(error, RncError)
    return error


def _arguments(plan: Plan) -> RunArguments:
    experiment, settings = plan.experiment, plan.experiment.simulation
    return RunArguments(
        reduced=experiment.reduced,
        controller=experiment.controller,
        q0=experiment.q0,
        samples=sample_count(settings.duration, settings.dt),
        dt=settings.dt,
        v2_0=experiment.v2_0,
        plant=experiment.plant,
        options=run_options(plan, experiment),
    )
