"""A loop's state from a file, with what its controller remembers tried before it is believed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy import ndarray as Array

from rnc_pin.control.protocol import Controller, State
from rnc_pin.errors import ConfigurationError, InputError, RncError, printable
from rnc_pin.loop.command import inputs_of, read_answer
from rnc_pin.loop.loop_state import LoopState
from rnc_pin.loop.saved_state import read_state
from rnc_pin.loop.state_checks import check_memory, check_state
from rnc_pin.loop.velocity import VelocityEstimate
from rnc_pin.model.measurement import Measurement
from rnc_pin.model.reduced_model import ReducedModel


def restored(
    path: Path, reduced: ReducedModel, make: Callable[[Measurement], Controller]
) -> tuple[LoopState, Controller | None]:
    """A state that a loop can go on from, and the controller that it is of.

    Args:
        path: of the file.
        reduced: the model of the loop.
        make: gives the controller of a first measurement.

    Raises:
        ConfigurationError: no such file, or no state of a loop with this model and controller.
    """
    made: list[Controller] = []

    def initial_state(q: Array) -> State:
        measurement = reduced.measured(q, np.zeros(reduced.n), np.zeros(reduced.r))
        made[:] = [make(measurement)]
        return made[0].initial_state(measurement)

    try:
        state = read_state(path, (LoopState, VelocityEstimate), initial_state)
        check_state(state, reduced)
        if made and not state.failed:
            _try(state, reduced, made[0], initial_state(state.q))
    except ConfigurationError:
        raise
    except RncError as error:
        raise ConfigurationError(f"{path}: no state of this loop: {error}") from None
    if state.trouble is not None:
        state = state._replace(trouble=printable(state.trouble))
    return state, made[0] if made else None


def _try(state: LoopState, reduced: ReducedModel, controller: Controller, initial: State) -> None:
    """Refuse what a controller cannot go on from.

    Raises:
        RncError: of another kind or shape, not finite, or its step fails.
    """
    nothing = np.zeros(reduced.r)
    here = reduced.at(state.q, nothing if state.v2 is None else state.v2)
    measurement = here.measure(nothing if state.integrals is None else state.integrals)
    elapsed = 0.0 if state.time is None else state.time - (state.time if state.begin is None else state.begin)
    try:
        command, after = read_answer(controller.step(elapsed, measurement, state.controller))
    except RncError:
        raise
    except Exception as error:  # of a state of the wrong shape it raises whatever it comes across
        raise InputError(f"the controller raises {type(error).__name__}: {error}") from None
    check_memory(state.controller, initial, after)
    inputs_of(reduced, here, command)
