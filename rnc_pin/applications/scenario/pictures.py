"""Plots and animation of a run, one after the other.

Matplotlib and Meshcat take a second to import: functions that draw import them.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import partial
from importlib import import_module
from pathlib import Path

import numpy as np

from rnc_pin import figures, simulation, visualization
from rnc_pin.applications.scenario.execution import Result, ShowProgress
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.errors import RncError, few
from rnc_pin.interruption import interruptible

ANIMATION = "animation.html"
_MOST_PANELS = 8  # panels of the overview; the others are in a second picture


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
        causes: dict[str, list[str]] = {}  # a missing package has one cause for all pictures
        for name, why in self.failures.items():
            causes.setdefault(why, []).append(name)
        return "; ".join(f"{few(names)} could not be drawn: {why}" for why, names in causes.items())


def picture_names(scenario: Scenario) -> list[str]:
    """Names of the pictures that a run can write.

    Args:
        scenario: the scenario of the run.
    """
    content = scenario.content
    formats = {name: plot.formats or content.figures.formats for name, plot in content.plots.items()}
    # Names of all that may be written, so that the folder refuses foreign files before the run.
    formats |= dict.fromkeys(("overview", "overview_2", "top_view", "limits"), content.figures.formats)
    return list(dict.fromkeys([*(f"{name}.{each}" for name, found in formats.items() for each in found), ANIMATION]))


def draw_pictures(scenario: Scenario, result: Result, folder: Path, progress: ShowProgress | None = None) -> Drawn:
    """Write the pictures of a result; none if it was interrupted or has fewer than two samples.

    An error in one picture does not affect the other pictures or the data.

    Args:
        scenario: the scenario of the run.
        result: the result of the run.
        folder: folder for the pictures.
        progress: called with the number of finished pictures and the name of the next.
    """
    if result.interrupted or len(result.trajectory.time) < 2:
        return Drawn()  # who interrupts a run does not wait for its pictures
    written: list[str] = []
    failures: dict[str, str] = {}
    for number, name in enumerate(picture_names(scenario)):
        if progress is not None:
            progress(number, name)
        # One after the other and on its own: labels and fonts are a user's, and may fail in one picture.
        try:
            found = _drawn(scenario, result, folder / name)
        except KeyboardInterrupt:
            return Drawn(written, failures, interrupted=True)
        if isinstance(found, str):
            failures[name] = found
        elif found:
            written.append(name)
    return Drawn(written, failures)


def _drawn(scenario: Scenario, result: Result, path: Path) -> bool | str:
    """Write a picture. Return False if there is nothing to draw, and the error if it fails.

    Raises:
        KeyboardInterrupt: the user interrupted it.
    """
    try:
        is_page = path.name == ANIMATION
        # Not interruptible: C libraries turn Ctrl-C during imports into their own errors.
        import_module(f"rnc_pin.visualization.{'recording' if is_page else 'plots'}")
        with interruptible(), np.errstate(over="ignore", invalid="ignore"):  # values of diverged runs overflow
            return (write_animation if is_page else _write_plot)(scenario, result, path)
    except KeyboardInterrupt:
        path.unlink(missing_ok=True)  # it is half a picture
        raise
    except Exception as error:
        path.unlink(missing_ok=True)
        kind = "" if isinstance(error, RncError) else f"{type(error).__name__}: "  # "ValueError" tells where to look
        return kind + (" ".join(str(error).split()) or "no reason given")


# ------------------------------------------------------------------ page


def write_animation(scenario: Scenario, result: Result, path: Path) -> bool:
    """Write the page of a run.

    Args:
        scenario: its scenario.
        result: the run.
        path: path of the page.

    Raises:
        ModelError: the robot has no geometry.
    """
    content = scenario.content
    view = replace(content.view, hide=[*content.view.hide, "compared"])  # users can switch this layer on
    drawn, title = scenario.experiment.drawn_model, content.title or scenario.name
    visualization.Recording(drawn, result.trajectory, view, title, result.comparisons).save(path)
    return True


# ------------------------------------------------------------------ plots


def _write_plot(scenario: Scenario, result: Result, path: Path) -> bool:
    """Write the plot that the file name means; False if there is nothing to draw."""
    parts = {"overview": slice(_MOST_PANELS), "overview_2": slice(_MOST_PANELS, None)}
    own = {"top_view": _top_view, "limits": _limits} | {name: partial(_overview, part) for name, part in parts.items()}
    if path.stem in own:
        return own[path.stem](scenario, result, path)
    common, settings = scenario.content.figures, scenario.content.plots[path.stem]
    chosen = result.comparisons if settings.comparisons is None else settings.comparisons
    shown = {label: result.comparisons[label] for label in chosen if label in result.comparisons}
    size, title = settings.size or common.size, settings.title
    result.trajectory.plot(settings.outputs, title=title, comparisons=shown, size=size, labels=common.labels, file=path)
    return True


def _overview(part: slice, scenario: Scenario, result: Result, path: Path) -> bool:
    content = scenario.content
    figure = simulation.plot_run(result.trajectory, None, content.title, {}, None, content.figures.labels, None, part)
    if figure.axes:
        figures.save(figure, path)
    return bool(figure.axes)


def _top_view(scenario: Scenario, result: Result, path: Path) -> bool:
    if not simulation.ground_paths(result.trajectory):  # an arm on a table has no path over the ground
        return False
    experiment, settings = scenario.experiment, scenario.content.figures
    obstacles, title = experiment.obstacles, experiment.scenario.title
    robot = experiment.reduced.robot if obstacles else None  # beside obstacles, the room that the robot needs counts
    run, others, labels = result.trajectory, result.comparisons, figures.Labels(settings.labels)
    figures.save(visualization.plot_top_view(run, title, others, obstacles, robot, settings.size, labels), path)
    return True


def _limits(scenario: Scenario, result: Result, path: Path) -> bool:
    if result.limits is None or not (result.limits.uses or result.limits.clearances):
        return False
    title, settings = scenario.content.title, scenario.content.figures
    labels = figures.Labels(settings.labels)
    figures.save(visualization.plot_limits(result.limits, title, settings.size, labels), path)
    return True
