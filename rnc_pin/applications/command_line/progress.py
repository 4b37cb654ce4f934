"""Progress of a command: a bar on a terminal, else one line per stage."""

from __future__ import annotations

from typing import Protocol

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from rnc_pin.applications.command_line.messages import announce


class Advance(Protocol):
    """Callback that reports progress and the current activity."""

    def __call__(self, done: float, text: str | None = None) -> None: ...


class ProgressBar:
    """Progress bar on stderr; its context yields an ``Advance`` callback.

    Args:
        console: console of the bar.
        total: value at 100 %.
        text: current activity. Without a terminal only this line is printed.
        quiet: print nothing.
    """

    def __init__(self, console: Console, total: float, text: str, quiet: bool) -> None:
        if not console.is_terminal:
            announce(text, quiet)
        self._bar = Progress(
            TextColumn("{task.description}", markup=False),
            BarColumn(),
            TextColumn("{task.percentage:>3.0f} %"),
            TimeElapsedColumn(),
            TimeRemainingColumn(),
            console=console,
            disable=quiet or not console.is_terminal,
        )
        self._task = self._bar.add_task(text, total=total)
        self._shown, self._grain = 0.0, total / 400
        self._text: str | None = None

    def __enter__(self) -> Advance:
        self._bar.start()
        return self._advance

    def begin_at(self, done: float) -> None:
        """Count this much as done before the start: the estimate of the remaining time leaves it out."""
        self._bar.reset(self._task, completed=int(done))

    def _advance(self, done: float, text: str | None = None) -> None:
        # Called at every sample: update the bar only at visible changes.
        if done >= self._shown or text != self._text:
            self._shown, self._text = done + self._grain, text
            self._bar.update(self._task, completed=done, description=text)

    def __exit__(self, *error: object) -> None:
        if error[0] is None:
            self._bar.update(self._task, completed=self._bar.tasks[0].total)
        self._bar.stop()
