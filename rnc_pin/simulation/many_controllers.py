"""Controllers of runs in lock-step: one call for all runs if they share one that accepts batches."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from itertools import compress
from typing import NamedTuple

import numpy as np
from numpy import ndarray as Array

from rnc_pin.control.controller import (
    Command,
    Controller,
    NotStackable,
    State,
    accepts_batches,
    stack_states,
    state_of_runs,
    with_states,
)
from rnc_pin.model.reduced_kinematics import Measurement


class Answer(NamedTuple):
    """Commands of all runs."""

    command: Command
    """Fields (B, ...); NaN in the rows of the runs without a value."""
    states: State
    """States of the controllers after the step."""
    failed: Array
    """Mask (B,) of the runs whose controller raised an error, or gave another command than expected."""


class ManyControllers:
    """Controllers of many runs, and their states: one call for all runs if they share one that accepts batches.

    Args:
        controllers: controller of each run.
        states: state of each controller.
    """

    def __init__(self, controllers: Sequence[Controller], states: Sequence[State]) -> None:
        self._each, self._shared = list(controllers), False
        self.states: State = list(states)
        if accepts_batches(controllers[0]) and all(each is controllers[0] for each in controllers):
            with suppress(NotStackable):
                self.states, self._shared = stack_states(states), True

    def step(self, t: float, measurement: Measurement, apart: Array) -> Answer:
        """Return the commands of all runs at time t [s]; those of the mask ``apart`` (B,) mean nothing.

        ``states`` does not change.
        """
        if not self._shared:
            return self._in_turn(t, measurement, self.states, apart)
        every = np.ones(len(self._each), dtype=bool)
        try:
            command, states = self._each[0].step(t, measurement, self.states)
            if isinstance(command, Command) and _of_shapes(command, measurement):
                return Answer(command, states, ~every)
            return Answer(Command(), None, every)
        except Exception:  # of one run, which is not known
            found = self._in_turn(t, measurement, [self.state(place) for place in range(len(every))], apart)
            if (found.failed & ~apart).any():
                return found
            try:
                return found._replace(states=stack_states(found.states))
            except NotStackable:
                return found._replace(failed=every)

    def state(self, place: int) -> State:
        """State of the controller of one run."""
        return state_of_runs(self.states, place) if self._shared else self.states[place]

    def keep(self, staying: Array) -> None:
        """Keep only the runs of a mask (B,)."""
        self._each = list(compress(self._each, staying))
        self.states = state_of_runs(self.states, staying) if self._shared else list(compress(self.states, staying))

    def put(self, places: Sequence[int], states: Sequence[State]) -> bool:
        """Replace the states of some runs; False if they do not fit to the others."""
        if self._shared:
            try:
                self.states = with_states(self.states, places, states)
            except NotStackable:
                return False
        for place, state in zip(places, [] if self._shared else states, strict=not self._shared):
            self.states[place] = state
        return True

    def _in_turn(self, t: float, measurement: Measurement, before: Sequence[State], apart: Array) -> Answer:
        """Commands of one controller after the other."""
        commands: list[object] = []
        states: list[State] = []
        failed = np.zeros(len(before), dtype=bool)
        for place, (controller, state) in enumerate(zip(self._each, before, strict=True)):
            if apart[place]:
                commands.append(None)
                states.append(state)
                continue
            seen = state_of_runs(measurement, place)
            if seen.input_deficit is not None and not seen.input_deficit.any():
                seen = seen._replace(input_deficit=None, force_deficit=None)
            command: object = None
            try:
                command, state = controller.step(t, seen, state)
            except Exception:  # alone it raises the same error
                failed[place] = True
            commands.append(command)
            states.append(state)
        together, misfits = _together(commands, failed, measurement)
        return Answer(together, states, failed | misfits)


def _sizes(measurement: Measurement) -> dict[str, int]:
    """Size of the goals and forces of a command by name."""
    r, k = measurement.v2.shape[-1], measurement.x1.shape[-1]
    return {"F": r, "v2_desired": r, "x1_desired": k, "x2_desired": r}


def _of_shapes(command: Command, measurement: Measurement) -> bool:
    """True if the fields of a command of all runs have their rows."""
    count, sizes = len(measurement.v2), _sizes(measurement)
    given = {name: getattr(command, name) for name in sizes}
    return all(value is None or np.shape(value) == (count, sizes[name]) for name, value in given.items())


def _together(commands: Sequence[object], failed: Array, measurement: Measurement) -> tuple[Command, Array]:
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
