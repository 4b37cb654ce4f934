"""Steps of the controllers of many runs: together if they accept batches, else one run after the other."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from itertools import compress
from typing import Any, NamedTuple

import numpy as np
from numpy import ndarray as Array

from rnc_pin.control.batches import (
    NotStackable,
    accepts_batches,
    measurement_of_run,
    stack_states,
    state_of_runs,
)
from rnc_pin.control.controller import Command, Controller, State
from rnc_pin.model.measurement import Measurement


class Answer(NamedTuple):
    """Commands of all runs."""

    command: Command
    """Fields (B, ...); NaN in the rows of the runs without a value."""
    states: Any
    """States of the controllers after the step."""
    failed: Array
    """Mask (B,) of the runs whose controller raised an error, or gave another command than expected."""


class StepsOfRuns(ABC):
    """Controllers of many runs, and their states."""

    @abstractmethod
    def step(self, t: float, measurement: Measurement) -> Answer:
        """Return the commands of all runs at time t [s], without a change of the states."""

    @abstractmethod
    def commit(self, answer: Answer) -> None:
        """Take over the states of an answer."""

    @abstractmethod
    def state(self, place: int) -> State:
        """Return the state of the controller of one run."""

    @abstractmethod
    def keep(self, staying: Array) -> None:
        """Keep only the runs of a mask (B,)."""


def steps_of_runs(controllers: Sequence[Controller], states: Sequence[State]) -> StepsOfRuns:
    """Return the controllers of many runs in the fastest form that they allow."""
    first = controllers[0]
    if accepts_batches(first) and all(each is first for each in controllers):
        try:
            return StepsTogether(first, stack_states(states), len(states))
        except NotStackable:
            pass
    return StepsInTurn(controllers, states)


class StepsTogether(StepsOfRuns):
    """One controller that accepts batches."""

    def __init__(self, controller: Controller, state: State, count: int) -> None:
        self._controller, self._state, self._count = controller, state, count

    def step(self, t: float, measurement: Measurement) -> Answer:
        try:
            command, state = self._controller.step(t, measurement, self._state)
            if not isinstance(command, Command) or not _of_shapes(command, measurement):
                return Answer(Command(), None, np.ones(self._count, dtype=bool))
            return Answer(command, state, np.zeros(self._count, dtype=bool))
        except Exception:  # of one run, which is not known
            places = range(self._count)
            alone = StepsInTurn([self._controller] * self._count, [self.state(place) for place in places])
            found = alone.step(t, measurement)
            if found.failed.any():
                return found
            try:
                return found._replace(states=stack_states(found.states))
            except NotStackable:
                return found._replace(failed=np.ones(self._count, dtype=bool))

    def commit(self, answer: Answer) -> None:
        self._state = answer.states

    def state(self, place: int) -> State:
        return state_of_runs(self._state, place)

    def keep(self, staying: Array) -> None:
        self._state, self._count = state_of_runs(self._state, staying), int(staying.sum())


class StepsInTurn(StepsOfRuns):
    """A controller for each run."""

    def __init__(self, controllers: Sequence[Controller], states: Sequence[State]) -> None:
        self._controllers, self._states = list(controllers), list(states)

    def step(self, t: float, measurement: Measurement) -> Answer:
        commands: list[Command] = []
        states: list[State] = []
        failed = np.zeros(len(self._states), dtype=bool)
        for place, (controller, state) in enumerate(zip(self._controllers, self._states, strict=True)):
            seen = measurement_of_run(measurement, place)
            if seen.input_deficit is not None and not seen.input_deficit.any():
                seen = seen._replace(input_deficit=None, force_deficit=None)
            command: Any = None
            try:
                command, state = controller.step(t, seen, state)
            except Exception:  # alone it raises the same error
                failed[place] = True
            commands.append(command)
            states.append(state)
        together, misfits = _together(commands, failed, measurement)
        return Answer(together, states, failed | misfits)

    def commit(self, answer: Answer) -> None:
        self._states = answer.states

    def state(self, place: int) -> State:
        return self._states[place]

    def keep(self, staying: Array) -> None:
        self._controllers = list(compress(self._controllers, staying))
        self._states = list(compress(self._states, staying))


def _sizes(measurement: Measurement) -> dict[str, int]:
    """Size of the goals and forces of a command by name."""
    r, k = measurement.v2.shape[-1], measurement.x1.shape[-1]
    return {"F": r, "v2_desired": r, "x1_desired": k, "x2_desired": r}


def _of_shapes(command: Command, measurement: Measurement) -> bool:
    """True if the fields of a command of all runs have their rows."""
    count, sizes = len(measurement.v2), _sizes(measurement)
    given = {name: getattr(command, name) for name in sizes}
    return all(value is None or np.shape(value) == (count, sizes[name]) for name, value in given.items())


def _together(commands: Sequence[Command], failed: Array, measurement: Measurement) -> tuple[Command, Array]:
    """Command of all runs, and the mask (B,) of those whose own has another form."""
    count, misfits = len(commands), np.zeros(len(commands), dtype=bool)
    present = [name for name in Command._fields if any(getattr(each, name, None) is not None for each in commands)]
    sizes, fields = _sizes(measurement), {}
    for name in present:
        shapes = [np.shape(value) for each in commands if (value := getattr(each, name, None)) is not None]
        shape = (sizes[name],) if name in sizes else shapes[0]
        field = np.full((count, *shape), np.nan)
        for place, each in enumerate(commands):
            value = getattr(each, name, None)
            if value is None:
                misfits[place] |= name not in ("v2_desired", "x1_desired", "x2_desired")
            elif np.shape(value) == shape:
                field[place] = value
            else:
                misfits[place] = True
        fields[name] = field
    for place, each in enumerate(commands):
        misfits[place] |= not failed[place] and not isinstance(each, Command)
    return Command(**fields), misfits
