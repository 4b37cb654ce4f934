"""Plots and animation of a run, drawn by one process or by several.

Matplotlib and Meshcat take a second to import. So a process imports ``plot_files`` or ``saved_run`` only to draw
with them, if possible while the simulation runs.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from rnc_pin.applications.scenario.execution import Result
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.applications.scenario.shared_tasks import Report, SharedTasks
from rnc_pin.errors import RncError, few
from rnc_pin.interruption import interruptible

ANIMATION = "animation.html"
_MOST_HELPERS = 2  # more would wait for the slowest picture


@dataclass(frozen=True)
class Drawn:
    """Result of drawing.

    Attributes:
        written: names of the pictures.
        failures: name of each failed picture to its error message.
        interrupted: True if the user interrupted the drawing.
    """

    written: list[str] = field(default_factory=list)
    failures: dict[str, str] = field(default_factory=dict)
    interrupted: bool = False

    def __str__(self) -> str:
        """One line with the failures."""
        causes: dict[str, list[str]] = {}
        for name, why in self.failures.items():
            causes.setdefault(why, []).append(name)
        return "; ".join(f"{few(names)} could not be drawn: {why}" for why, names in causes.items())


def picture_names(scenario: Scenario) -> list[str]:
    """Names of the pictures that a run can write."""
    content = scenario.content
    formats = {name: plot.formats or content.figures.formats for name, plot in content.plots.items()}
    own = ["overview", "top_view", "limits", *(["plan"] if scenario.experiment.plan else [])]
    formats |= dict.fromkeys(own, content.figures.formats)
    return list(dict.fromkeys([*(f"{name}.{each}" for name, found in formats.items() for each in found), ANIMATION]))


_Picture = bool | str
"""Result of drawing a picture: True if it is written, False if there is nothing to draw; or the error."""


class Artists(SharedTasks[tuple[Result, Path], _Picture]):
    """Processes that draw the pictures of a run, as a context. All but this one get ready while the simulation runs.

    Args:
        scenario: the scenario of the run.
        processes: largest number of processes.
    """

    def __init__(self, scenario: Scenario, processes: int = 1) -> None:
        self.names = picture_names(scenario)
        order = range(len(self.names))
        # The animation takes longest. This process draws it: the others have imported Matplotlib.
        numbers = order if processes == 1 else [order[-1], *order[:-1]]

        def draw(number: int, common: tuple[Result, Path], report: Report) -> _Picture:
            report(number, 0.0)
            return _drawn(scenario, common[0], common[1] / self.names[number])

        super().__init__(draw, numbers, min(processes - 1, _MOST_HELPERS), _import_writers)


def draw_pictures(
    scenario: Scenario,
    result: Result,
    folder: Path,
    progress: Callable[[float, str], None] | None = None,
    artists: Artists | None = None,
) -> Drawn:
    """Write the pictures of a result; none if it has fewer than two samples.

    An error in one picture does not affect the other pictures or the data.

    Args:
        scenario: the scenario of the run.
        result: the result of the run.
        folder: folder for the pictures.
        progress: called with the number of finished pictures and the name of the next.
        artists: processes that draw; by default this one.
    """
    if len(result.trajectory.time) < 2:
        return Drawn()
    interrupted = False
    with artists or Artists(scenario) as shared:
        names = shared.names

        def report(number: int, _: float) -> None:
            if progress is not None:
                progress(len(shared.found), names[number])

        shared.begin((result, folder))
        try:
            found = shared.results(report)
        except KeyboardInterrupt:
            interrupted, found = True, dict(shared.found)
    if interrupted:
        for name in (name for number, name in enumerate(names) if number not in found):
            (folder / name).unlink(missing_ok=True)
    return Drawn(
        [names[number] for number, each in sorted(found.items()) if each is True],
        {names[number]: each for number, each in sorted(found.items()) if isinstance(each, str)},
        interrupted,
    )


def _import_writers() -> None:
    for name in (ANIMATION, ""):
        _writer(name)


def _writer(name: str) -> Callable[[Scenario, Result, Path], bool]:
    """Function that writes a file of this name."""
    if name == ANIMATION:
        from rnc_pin.applications.scenario.saved_run import write_animation

        return write_animation
    from rnc_pin.applications.scenario.plot_files import write_plot

    return write_plot


def _drawn(scenario: Scenario, result: Result, path: Path) -> _Picture:
    """Write a picture, if there is something to draw.

    Raises:
        KeyboardInterrupt: the user interrupted it.
    """
    try:
        write = _writer(path.name)  # not interruptible: C libraries turn Ctrl-C during imports into their own errors
        with interruptible(), np.errstate(over="ignore", invalid="ignore"):  # values of diverged runs overflow
            return write(scenario, result, path)
    except KeyboardInterrupt:
        path.unlink(missing_ok=True)
        raise
    except Exception as error:
        path.unlink(missing_ok=True)
        kind = "" if isinstance(error, RncError) else f"{type(error).__name__}: "
        return kind + (" ".join(str(error).split()) or "no reason given")
