"""Simulation of the run of a scenario or of a comparison, whose error is part of the result."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from rnc_pin.applications.scenario.builder import Experiment
from rnc_pin.control import State
from rnc_pin.control.whole_body import report_within
from rnc_pin.errors import RncError
from rnc_pin.simulation import Observer, Sample, SimulationOptions, Trajectory, simulate, simulate_phases


class Simulated(NamedTuple):
    """Motion of a run, the error that ended it early, and the largest amounts by which limits gave way, by name."""

    trajectory: Trajectory
    error: RncError | None
    gave_way: dict[str, float]


def simulated(
    experiment: Experiment, options: Callable[[Observer], SimulationOptions], observer: Observer | None
) -> Simulated:
    """Simulate an experiment. An error that ends it early is part of the result.

    Args:
        experiment: objects of the run.
        options: options of the run for an observer.
        observer: called with every ``Sample``.
    """
    state: State = None

    def watch(sample: Sample) -> None:
        nonlocal state
        state = sample.state
        if observer is not None:
            observer(sample)

    error: RncError | None = None
    try:
        trajectory = _trajectory(experiment, options(watch))
    except RncError as failure:
        if not isinstance(failure.trajectory, Trajectory):
            raise
        trajectory, error = failure.trajectory, failure
    report = report_within(experiment.controller, state)
    return Simulated(trajectory, error, {} if report is None else dict(report.worst))


def _trajectory(experiment: Experiment, options: SimulationOptions) -> Trajectory:
    settings, v2_0 = experiment.simulation, experiment.v2_0
    if experiment.phases:
        return simulate_phases(experiment.phases, experiment.q0, settings.dt, v2_0=v2_0, options=options)
    controlled = experiment.reduced, experiment.controller, experiment.q0
    plant = experiment.plant
    return simulate(*controlled, settings.duration, settings.dt, v2_0=v2_0, plant=plant, options=options)
