"""Execution of a scenario: the run, its comparisons, and their result files: data, plots and animation.

Matplotlib and Meshcat take a second to import: functions that draw import them.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, cast

import numpy as np

from rnc_pin import figures, simulation, visualization
from rnc_pin.applications.scenario.scenario import Scenario, slug
from rnc_pin.applications.scenario.simulated_run import judged_summary, run_summary
from rnc_pin.errors import RncError, few
from rnc_pin.interruption import interruptible
from rnc_pin.io import dump_json
from rnc_pin.simulation import Compared, LimitReplay, Observer, Outcome, Sample, Summary, Trajectory

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_PLAN = "plan.npz"
_REPORTS = 400  # progress reports of a run
ShowProgress = Callable[[float, str], None]
"""Callback that takes the progress so far, and the name of what is under way."""


@dataclass(frozen=True)
class Result:
    """Result of a run. ``trajectory.verdict`` tells whether it succeeded."""

    trajectory: Trajectory
    summary: Summary
    error: RncError | None = None
    comparisons: dict[str, Trajectory] = field(default_factory=dict)
    limits: LimitReplay | None = None
    """Use of joint limits and distances over time; None for a run without samples."""

    @property
    def interrupted(self) -> bool:
        """True if the user interrupted the run or one of its comparisons."""
        return any(each.outcome is Outcome.INTERRUPTED for each in (self.trajectory, *self.comparisons.values()))


def execute(scenario: Scenario, observer: Observer | None = None, progress: ShowProgress | None = None) -> Result:
    """Run a scenario, and then its comparisons.

    Args:
        scenario: what to run.
        observer: called with every ``Sample`` of the run itself.
        progress: called with the simulated time so far [s], of all runs together, and the name of the one under way.

    Returns:
        The result; a run that failed keeps what it reached, with ``error`` set, and has no comparisons. Those after an
        interruption are missing.
    """
    with np.errstate(over="ignore", invalid="ignore"):  # diverged values
        # The wall time of the summary is that of the simulation, without building and drawing.
        start = time.perf_counter()
        trajectory, error = scenario.simulated(_watched(scenario, observer, progress, 0.0, scenario.name))
        trajectory, summary, limits = judged_summary(scenario.experiment, trajectory, time.perf_counter() - start)
        # Beside a failed run, comparisons would show nothing.
        succeeded = error is None and trajectory.outcome is Outcome.COMPLETED
        others = _comparisons(scenario, summary, progress) if succeeded else {}
    return Result(trajectory, summary, error, others, limits)


def _comparisons(scenario: Scenario, summary: Summary, progress: ShowProgress | None) -> dict[str, Trajectory]:
    """Run the comparisons by label, up to one that is interrupted, and add their part of the summary."""
    found: dict[str, Trajectory] = {}
    before = scenario.duration
    for label, other in scenario.comparisons.items():
        run, failure = other.simulated(_watched(other, None, progress, before, f"{scenario.name}: {label}"))
        before += other.duration
        whole = run_summary(other.experiment, run)
        # Of a comparison the errors count; its limits and its verdict are not those of the run.
        compared = cast(Compared, {key: value for key, value in whole.items() if key in Compared.__annotations__})
        if failure is not None:
            compared["message"] = str(failure)
        summary.setdefault("comparisons", {})[label] = compared
        found[label] = run
        if run.outcome is Outcome.INTERRUPTED:
            break
    return found


def _watched(
    scenario: Scenario, observer: Observer | None, progress: ShowProgress | None, before: float, name: str
) -> Observer:
    """Observer of a run that reports its progress, from the time of all runs before it [s]."""
    last = scenario.duration * (1.0 - 1e-9)
    due = 0.0

    def watch(sample: Sample) -> None:
        nonlocal due
        # Reports at all samples would slow the run down; the last one always counts.
        if sample.time >= min(due, last):
            due = sample.time + last / _REPORTS
            if progress is not None:
                progress(before + sample.time, name)
        if observer is not None:
            observer(sample)

    return watch


def write(scenario: Scenario, result: Result, folder: Path) -> list[str]:
    """Write the data of a result: trajectories, summary and scenario. Return the names of the files.

    Args:
        scenario: the scenario.
        result: its result.
        folder: folder of the files.

    Raises:
        OSError: a file cannot be written.
    """
    result.trajectory.save(folder / "trajectory.npz")
    for label, other in result.comparisons.items():
        other.save(folder / _comparison_file(label))
    if scenario.experiment.plan is not None:
        scenario.experiment.plan.save(folder / _PLAN)
    (folder / "summary.json").write_text(dump_json(result.summary) + "\n", encoding="utf-8")
    scenario.save(folder / "scenario.yaml")
    return _data_names(scenario, result.comparisons)


def result_names(scenario: Scenario) -> list[str]:
    """Names of all files that a run can write: those of ``write``, and its pictures.

    Args:
        scenario: the scenario of the run.
    """
    return [*_data_names(scenario, scenario.comparisons), *picture_names(scenario)]


def _data_names(scenario: Scenario, comparisons: Iterable[str]) -> list[str]:
    plans = [] if scenario.experiment.plan is None else [_PLAN]
    return ["trajectory.npz", *map(_comparison_file, comparisons), *plans, "summary.json", "scenario.yaml"]


def _comparison_file(label: str) -> str:
    return f"trajectory_{slug(label)}.npz"


# ------------------------------------------------------------------ pictures

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
            if _drawn(scenario, result, folder / name):
                written.append(name)
        except KeyboardInterrupt:
            return Drawn(written, failures, interrupted=True)
        except Exception as error:
            # "ValueError" tells where to look.
            kind = "" if isinstance(error, RncError) else f"{type(error).__name__}: "
            failures[name] = kind + (" ".join(str(error).split()) or "no reason given")
    return Drawn(written, failures)


def _drawn(scenario: Scenario, result: Result, path: Path) -> bool:
    """Write a picture. Return False if there is nothing to draw."""
    try:
        is_page = path.name == ANIMATION
        # Not interruptible: C libraries turn Ctrl-C during imports into their own errors.
        import_module(f"rnc_pin.visualization.{'recording' if is_page else 'plots'}")
        with interruptible(), np.errstate(over="ignore", invalid="ignore"):  # values of diverged runs overflow
            if is_page:
                write_animation(scenario, result, path)
            elif (figure := _figure(scenario, result, path.stem)) is not None:
                figures.save(figure, path)
            return is_page or figure is not None
    except BaseException:
        path.unlink(missing_ok=True)  # it is half a picture
        raise


def write_animation(scenario: Scenario, result: Result, path: Path) -> None:
    """Write the page of a run.

    Args:
        scenario: its scenario.
        result: the run.
        path: path of the page.

    Raises:
        ModelError: the robot has no geometry.
    """
    view = scenario.content.view
    view = replace(view, hide=[*view.hide, "compared"])  # users can switch this layer on
    shown = scenario.experiment.drawn_model, result.trajectory, view, scenario.title, result.comparisons
    visualization.Recording(*shown).save(path)


def _figure(scenario: Scenario, result: Result, name: str) -> Figure | None:
    """Draw the plot of a name; None if there is nothing to draw."""
    content, run, others, limits = scenario.content, result.trajectory, result.comparisons, result.limits
    title, size, texts = content.title, content.figures.size, content.figures.labels
    labels = figures.Labels(texts)
    if name in ("overview", "overview_2"):
        part = slice(_MOST_PANELS) if name == "overview" else slice(_MOST_PANELS, None)
        overview = simulation.plot_run(run, None, title, {}, None, texts, None, part)
        return overview if overview.axes else None
    if name == "limits":
        if limits is None or not (limits.uses or limits.clearances):
            return None
        return visualization.plot_limits(limits, title, size, labels)
    if name == "top_view":
        if not simulation.ground_paths(run):  # an arm on a table has no path over the ground
            return None
        obstacles, reduced = scenario.experiment.obstacles, scenario.experiment.reduced
        robot = reduced.robot if obstacles else None  # beside obstacles, the room that the robot needs counts
        return visualization.plot_top_view(run, title, others, obstacles, robot, size, labels)
    settings = content.plots[name]
    chosen = others if settings.comparisons is None else settings.comparisons
    shown = {label: others[label] for label in chosen if label in others}
    return run.plot(settings.outputs, title=settings.title, comparisons=shown, size=settings.size or size, labels=texts)
