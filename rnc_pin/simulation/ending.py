"""What ended a run, as an error of ours."""

from __future__ import annotations

from collections.abc import Callable
from typing import NoReturn

from rnc_pin.errors import DivergenceError, LimitError, PartialRun, RncError, SimulationError, SingularityError
from rnc_pin.simulation.run_info import Outcome

_OUTCOMES = {SingularityError: Outcome.SINGULAR, DivergenceError: Outcome.DIVERGED, LimitError: Outcome.LIMIT}
_LONGEST = 300  # letters of what somebody else's error says


def raise_with(so_far: Callable[[RncError], PartialRun], error: Exception, culprit: str, t: float) -> NoReturn:
    """Raise what ended a run, with the run so far in its ``trajectory``; to be called where it has been caught.

    Args:
        so_far: the run, given how it ended.
        error: what was raised.
        culprit: who was at work, in words.
        t: when [s].

    Raises:
        RncError: the error itself where it is one of ours, else a SimulationError with the error as its cause.
    """
    told = _told(error, culprit, t)
    told.trajectory = so_far(told)
    if told is error:
        raise
    raise told from error


def outcome_of(error: RncError) -> Outcome:
    """How a run ended that ended with an error."""
    return next((outcome for kind, outcome in _OUTCOMES.items() if isinstance(error, kind)), Outcome.FAILED)


def _told(error: Exception, culprit: str, t: float) -> RncError:
    """An error that can carry the run so far."""
    if isinstance(error, RncError):
        if isinstance(error, SingularityError | DivergenceError) and error.time is None:
            error.time = t
        return error
    said = " ".join(str(error).split())
    said = f": {said[:_LONGEST]}" if said else ""
    return SimulationError(f"{culprit} raised {type(error).__name__} at t = {t:.3f} s{said}")
