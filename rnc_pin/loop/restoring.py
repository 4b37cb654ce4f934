"""Restore a loop's state from a file, after a trial step of its controller."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy import ndarray as Array

from rnc_pin.control.controller import Controller, State
from rnc_pin.errors import ConfigurationError, InputError, RncError, printable
from rnc_pin.loop.command import input_of, unpack_step
from rnc_pin.loop.loop_state import LoopState
from rnc_pin.loop.saved_state import read_state
from rnc_pin.loop.state_checks import check_memory, check_state
from rnc_pin.loop.velocity import VelocityEstimate
from rnc_pin.model.measurement import Measurement
from rnc_pin.model.reduced_model import ReducedModel


def restore(
    path: Path, reduced: ReducedModel, make: Callable[[Measurement], Controller]
) -> tuple[LoopState, Controller | None]:
    """Return the state of a loop from a file, and its controller.

    Args:
        path: path of the file.
        reduced: model of the loop.
        make: function from the first measurement to the controller.

    Raises:
        ConfigurationError: the file does not exist, or its state does not fit this model and controller.
    """
    made: list[Controller] = []

    def initial_state(q: Array) -> State:
        measurement = reduced.at(q, v=np.zeros(reduced.n), t=0.0).measure(np.zeros(reduced.r))
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
        raise ConfigurationError(f"{path}: the state does not fit this loop: {error}") from None
    if state.fault is not None:
        state = state._replace(fault=printable(state.fault))
    return state, made[0] if made else None


def _try(state: LoopState, reduced: ReducedModel, controller: Controller, initial: State) -> None:
    """Check the stored state of a controller by one step.

    Raises:
        RncError: its type or shape is wrong, it is not finite, or the step fails.
    """
    nothing = np.zeros(reduced.r)
    elapsed = 0.0 if state.time is None else state.time - (state.time if state.begin is None else state.begin)
    here = reduced.at(state.q, nothing if state.v2 is None else state.v2, t=elapsed)
    measurement = here.measure(nothing if state.integrals is None else state.integrals)
    try:
        command, after = unpack_step(controller.step(elapsed, measurement, state.controller))
    except RncError:
        raise
    except Exception as error:  # a state of the wrong shape can raise any error
        raise InputError(f"the controller raises {type(error).__name__}: {error}") from None
    check_memory(state.controller, initial, after)
    input_of(reduced, here, command)
