"""End of a run: its outcome, and the error that carries the run so far."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from rnc_pin.errors import DivergenceError, LimitError, RncError, SimulationError, SingularityError
from rnc_pin.interruption import interruptible, uninterrupted
from rnc_pin.simulation.run_info import Outcome
from rnc_pin.simulation.trajectory import Trajectory

_OUTCOMES = {SingularityError: Outcome.SINGULAR, DivergenceError: Outcome.DIVERGED, LimitError: Outcome.LIMIT}
_LONGEST = 300  # largest number of characters from the message of a foreign error

MODEL = "the model"
Finish = Callable[[Outcome, str | None], Trajectory]


@dataclass
class Progress:
    """Progress of a run, for its error messages."""

    time: float = 0.0
    """[s]"""
    active_component: str = MODEL


def complete_run(advance: Callable[[Progress], str | None], finish: Finish) -> Trajectory:
    """Run to the end and return the trajectory; Ctrl-C ends the run early.

    Args:
        advance: the whole run; returns the reason if it failed without an error.
        finish: function from the outcome and its reason to the trajectory so far.

    Raises:
        RncError: ``advance`` raised an error. ``error.trajectory`` has the trajectory so far.
    """
    progress, outcome, reason = Progress(), Outcome.COMPLETED, None
    with uninterrupted():
        try:
            with interruptible():
                reason = advance(progress)
        except KeyboardInterrupt:
            outcome = Outcome.INTERRUPTED
        except Exception as error:
            failure = run_error(error, progress.active_component, progress.time)
            failure.trajectory = finish(outcome_of(failure), str(failure))
            raise failure  # noqa: B904 (run_error sets the cause)
        return finish(outcome if reason is None else Outcome.FAILED, reason)


def run_error(error: Exception, component: str, t: float) -> RncError:
    """Return an error of a run as an RncError, which can carry the run so far.

    Args:
        error: error that was caught.
        component: name of the component that raised it.
        t: time [s].

    Returns:
        The error itself if it is an RncError, else a SimulationError with the error as its cause.
    """
    if isinstance(error, RncError):
        if isinstance(error, SingularityError | DivergenceError) and error.time is None:
            error.time = t
        return error
    message = " ".join(str(error).split())
    message = f": {message[:_LONGEST]}" if message else ""
    failure = SimulationError(f"{component} raised {type(error).__name__} at t = {t:.3f} s{message}")
    failure.__cause__ = error
    return failure


def outcome_of(error: RncError) -> Outcome:
    """Outcome of a run that an error ended."""
    return next((outcome for kind, outcome in _OUTCOMES.items() if isinstance(error, kind)), Outcome.FAILED)
