"""Errors that end a run."""

from __future__ import annotations

from collections.abc import Callable
from typing import NoReturn

from rnc_pin.errors import DivergenceError, LimitError, PartialRun, RncError, SimulationError, SingularityError
from rnc_pin.simulation.run_info import Outcome

_OUTCOMES = {SingularityError: Outcome.SINGULAR, DivergenceError: Outcome.DIVERGED, LimitError: Outcome.LIMIT}
_LONGEST = 300  # largest number of characters from the message of a foreign error


def raise_with(so_far: Callable[[RncError], PartialRun], error: Exception, component: str, t: float) -> NoReturn:
    """Raise the error that ended a run, with the run so far in its ``trajectory``. Call it in the ``except`` clause.

    Args:
        so_far: function from the error to the run so far.
        error: error that was caught.
        component: name of the component that raised it.
        t: time [s].

    Raises:
        RncError: the error itself if it is an RncError, else a SimulationError with the error as its cause.
    """
    told = _told(error, component, t)
    told.trajectory = so_far(told)
    if told is error:
        raise
    raise told from error


def outcome_of(error: RncError) -> Outcome:
    """Outcome of a run that ended with an error."""
    return next((outcome for kind, outcome in _OUTCOMES.items() if isinstance(error, kind)), Outcome.FAILED)


def _told(error: Exception, component: str, t: float) -> RncError:
    """Convert an error to an RncError, which can carry the run so far."""
    if isinstance(error, RncError):
        if isinstance(error, SingularityError | DivergenceError) and error.time is None:
            error.time = t
        return error
    said = " ".join(str(error).split())
    said = f": {said[:_LONGEST]}" if said else ""
    return SimulationError(f"{component} raised {type(error).__name__} at t = {t:.3f} s{said}")
