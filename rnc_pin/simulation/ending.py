"""What ended a run, as an error of ours."""

from __future__ import annotations

from rnc_pin.errors import DivergenceError, LimitError, RncError, SimulationError, SingularityError
from rnc_pin.simulation.run_info import Outcome

_OUTCOMES = {SingularityError: Outcome.SINGULAR, DivergenceError: Outcome.DIVERGED, LimitError: Outcome.LIMIT}
_LONGEST = 300  # letters of what somebody else's error says


def ending(error: Exception, culprit: str, t: float) -> RncError:
    """An error that can carry the run so far.

    Args:
        error: what was raised.
        culprit: who was at work, in words.
        t: when [s].
    """
    if isinstance(error, RncError):
        if isinstance(error, SingularityError | DivergenceError) and error.time is None:
            error.time = t
        return error
    said = " ".join(str(error).split())
    said = f": {said[:_LONGEST]}" if said else ""
    return SimulationError(f"{culprit} raised {type(error).__name__} at t = {t:.3f} s{said}")


def outcome_of(error: RncError) -> Outcome:
    """How a run ended that ended with an error."""
    return next((outcome for kind, outcome in _OUTCOMES.items() if isinstance(error, kind)), Outcome.FAILED)
