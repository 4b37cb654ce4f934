"""Effects of limits for ``rnc-pin inspect``: at the start of a scenario, or along a run."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from rnc_pin.analysis import LimitEffect, limit_effects
from rnc_pin.applications.scenario.builder import Experiment
from rnc_pin.applications.scenario.controllers.whole_body import WholeBodySettings
from rnc_pin.applications.scenario.saved_run import load_run
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.control import ComputedTorque, InverseDynamicsQP, VelocityQP, VelocityTracker
from rnc_pin.errors import ConfigurationError, RncError

_STATES = 21


class ExaminedLimits(NamedTuple):
    """Effects of the limits of a scenario's program.

    Attributes:
        effects: effect at each state; empty without a program.
        problem: reason for which the program could not be examined; None if there is none.
    """

    effects: tuple[LimitEffect, ...]
    problem: str | None


def examine_limits(scenario: Scenario, run: Path | None) -> ExaminedLimits:
    """Return the effects of limits at the start of a scenario, or at 21 states of a run.

    Args:
        scenario: the scenario.
        run: folder of a run, or its trajectory; None for the start.

    Raises:
        RncError: the run cannot be read, or does not belong to the scenario.
    """
    if not isinstance(scenario.content.controller, WholeBodySettings):
        if run is not None:
            raise ConfigurationError("--run: the controller of the scenario is no program with limits, as 'qp' is")
        return ExaminedLimits((), None)
    try:
        experiment = scenario.experiment
    except RncError as error:
        return ExaminedLimits((), f"the controller cannot be built: {error}")
    states = [(0.0, experiment.q0, experiment.v2_0)] if run is None else _along(run, experiment)
    reduced = experiment.reduced
    try:
        return ExaminedLimits(limit_effects(_program(experiment), states, reduced.robot.nq, reduced.r), None)
    except RncError as error:
        return ExaminedLimits((), str(error))


def _program(experiment: Experiment) -> VelocityQP:
    """Program at velocity level with the tasks and limits of the controller, for the interval of the simulation."""
    controller: object = experiment.controller
    if isinstance(controller, VelocityTracker | ComputedTorque):
        controller = controller.target
    if not isinstance(controller, VelocityQP | InverseDynamicsQP):
        raise ConfigurationError(f"limits of {type(controller).__name__} are not examined")
    damping = controller.damping if isinstance(controller, VelocityQP) else 0.0
    dt = experiment.simulation.dt
    return VelocityQP(experiment.reduced, controller.tasks, controller.limits, dt=dt, damping=damping)


def _along(source: Path, experiment: Experiment) -> list[tuple[float, np.ndarray, np.ndarray]]:
    run = load_run(source).trajectory
    expected = experiment.reduced.robot.nq, experiment.reduced.r
    if (run.q.shape[1], run.v2.shape[1]) != expected:
        raise ConfigurationError(
            f"--run: {source} has nq, r = {run.q.shape[1]}, {run.v2.shape[1]}, expected {expected}"
        )
    places = np.unique(np.linspace(0, len(run.time) - 1, _STATES).round().astype(int)).tolist()
    return [(float(run.time[k]), run.q[k], run.v2[k]) for k in places]


def sentences_of(found: ExaminedLimits) -> tuple[str, ...]:
    """Return the effects in words, a line for each state at which limits are active."""
    if found.problem is not None:
        return (f"limits: not examined, {found.problem}",)
    lines = []
    for effect in found.effects:
        if effect.active or effect.exceeded:
            worst = max(effect.task_error, key=lambda name: abs(effect.task_error[name]))
            lines.append(
                f"limits at t = {effect.time:.3g} s: {', '.join(effect.active)}; they leave {effect.freedom} motions; "
                f"largest change of a task: {worst} by {effect.task_error[worst]:.3g}"
            )
            if effect.exceeded:
                gave = ", ".join(f"{name} by {value:.3g}" for name, value in effect.exceeded.items())
                lines.append(f"limits that gave way: {gave}")
    if found.effects and not lines:
        lines.append(f"limits: none is active at the {len(found.effects)} states examined")
    return tuple(lines)
