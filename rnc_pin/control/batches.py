"""Controllers of many runs at once: the declaration, and the states of single runs.

A controller whose attribute ``accepts_batches`` is True also takes the measurements of B runs, each field with a
leading axis (B, ...), and returns commands with that axis. Every row has the bits of a step of that run alone.
Its state then consists of nested tuples of arrays (B, ...), and of values that all runs share, such as the time.
A state of another form has a method ``together(states)`` that returns a ``RunStates``.
An error of a step in which several runs take part names no run; the runs are then stepped one by one.

``simulate`` steps other controllers once for each run of a batch.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np

from rnc_pin.control.controller import State
from rnc_pin.model.measurement import Measurement

Runs = int | slice | np.ndarray
"""Index of one run, or a mask or indices of some runs."""


class NotStackable(ValueError):
    """States of runs that one state cannot hold."""


class RunStates(ABC):
    """States of many runs that arrays (B, ...) cannot hold, because their sizes differ."""

    @abstractmethod
    def of_runs(self, runs: Runs) -> State:
        """Return the states of some runs, by a mask or indices, or the state of one run, by its index."""


def accepts_batches(controller: object) -> bool:
    """True if a controller declares that it takes the measurements of many runs."""
    return getattr(controller, "accepts_batches", False) is True


def stack_states(states: Sequence[State]) -> State:
    """State of many runs from a state of each.

    Raises:
        NotStackable: a value that is no array differs between the runs, or arrays have different shapes.
    """
    first = states[0]
    if isinstance(first, np.ndarray):
        if any(not isinstance(each, np.ndarray) or each.shape != first.shape for each in states):
            raise NotStackable
        return np.stack(states)
    if hasattr(first, "together"):
        if any(type(each) is not type(first) for each in states):
            raise NotStackable
        return first.together(states)
    if isinstance(first, tuple):
        if any(type(each) is not type(first) or len(each) != len(first) for each in states):
            raise NotStackable
        return _like(first, [stack_states(parts) for parts in zip(*states, strict=True)])
    if any(type(each) is not type(first) or each != first for each in states):
        raise NotStackable
    return first


def state_of_runs(state: State, runs: Runs) -> State:
    """State of some runs, by a mask or indices, or of one run, by its index."""
    if isinstance(state, np.ndarray):
        return state[runs]
    if isinstance(state, RunStates):
        return state.of_runs(runs)
    if isinstance(state, tuple):
        return _like(state, [state_of_runs(part, runs) for part in state])
    return state


def with_states(states: State, runs: Sequence[int], each: Sequence[State]) -> State:
    """States of many runs with new ones of some runs.

    Raises:
        NotStackable: a value that is no array differs, or a state has another form.
    """
    if isinstance(states, np.ndarray):
        if any(not isinstance(own, np.ndarray) or own.shape != states.shape[1:] for own in each):
            raise NotStackable
        states = states.copy()
        states[list(runs)] = each
        return states
    if isinstance(states, tuple) and all(type(own) is type(states) and len(own) == len(states) for own in each):
        return _like(states, [with_states(part, runs, own) for part, *own in zip(states, *each, strict=True)])
    if isinstance(states, RunStates | tuple) or any(type(own) is not type(states) or own != states for own in each):
        raise NotStackable
    return states


def measurement_of_run(measurement: Measurement, run: int) -> Measurement:
    """Measurement of one run of a batch."""
    return Measurement._make([None if field is None else field[run] for field in measurement])


def _like(first: tuple[State, ...], parts: list[State]) -> tuple[State, ...]:
    make = getattr(first, "_make", None)
    return tuple(parts) if make is None else make(parts)
