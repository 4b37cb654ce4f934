"""How far a command is."""

from __future__ import annotations

from collections.abc import Callable

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn


class ProgressBar:
    """A progress bar on stderr; gives a function that takes how far it is."""

    def __init__(self, console: Console, total: float, text: str, quiet: bool) -> None:
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

    def __enter__(self) -> Callable[[float], None]:
        self._bar.start()
        return self._advance

    def _advance(self, done: float) -> None:
        # Called at every sample: the bar need not know of each.
        if done >= self._shown:
            self._shown = done + self._grain
            self._bar.update(self._task, completed=done)

    def __exit__(self, *error: object) -> None:
        if error[0] is None:
            self._bar.update(self._task, completed=self._bar.tasks[0].total)
        self._bar.stop()
