"""Processor time of functions, taken in turn, and of commands.

Processor time counts every thread of a process and nothing that others do on the same machine.
"""

from __future__ import annotations

import resource
import statistics
import subprocess
import time
from collections.abc import Callable, Sequence

import numpy as np

Measurement = Callable[[], Sequence[float]]


def in_turn(measurements: Sequence[Measurement], rounds: int) -> list[np.ndarray]:
    """Medians over rounds of every measurement.

    In each round all are taken one after the other, so that all see the same machine; one more round goes before and
    does not count.

    Args:
        measurements: functions without arguments that return their figures, always as many.
        rounds: how often.
    """
    taken: list[list[Sequence[float]]] = [[] for _ in measurements]
    for _ in range(rounds + 1):
        for figures, measure in zip(taken, measurements, strict=True):
            figures.append(measure())
    return [np.median(figures[1:], axis=0) for figures in taken]


def used_by(function: Callable[[], object], states: int) -> Measurement:
    """The measurement of a function that goes through some states: processor time of each [s]."""

    def measure() -> Sequence[float]:
        start = time.process_time()
        function()
        return ((time.process_time() - start) / states,)

    return measure


def one_by_one(function: Callable[..., object], *columns: np.ndarray) -> Measurement:
    """The measurement of a function at one state after the other; each differs from the last: nothing can be kept.

    Args:
        function: takes a row of each column.
        columns: arrays with a row for each state, such as q and v2.
    """
    states = list(zip(*columns, strict=True))

    def calls() -> None:
        for state in states:
            function(*state)

    return used_by(calls, len(states))


def used_by_command(command: Sequence[str], launches: int) -> float:
    """Median processor time of a command, in user and system mode, its threads and children among it [s].

    Raises:
        subprocess.CalledProcessError: it failed.
    """
    figures = []
    for _ in range(launches):
        before = processor_time_of_children()
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        figures.append(processor_time_of_children() - before)
    return statistics.median(figures)


def processor_time_of_children() -> float:
    """Processor time of all finished children so far [s]."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime
