"""Plots and animation of a run."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np

from rnc_pin.errors import RncError, few
from rnc_pin.interruption import interruptible
from rnc_pin.scenario.execution import Plan, Result
from rnc_pin.scenario.saved_run import view_of
from rnc_pin.scenario.schema.scenario import PlotSettings
from rnc_pin.visualization.drawn_model import DrawnModel
from rnc_pin.visualization.limit_plot import plot_limits
from rnc_pin.visualization.plot_style import save
from rnc_pin.visualization.plots import plot_learning, plot_outputs, plot_run, plot_top_view
from rnc_pin.visualization.recording import Recording
from rnc_pin.visualization.top_view import ground_paths


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


def picture_names(plan: Plan) -> list[str]:
    """Names of the pictures that a run can write."""
    return [
        *(f"{name}.png" for name in plan.experiment.scenario.plots),
        "overview.png",
        "top_view.png",
        "limits.png",
        "animation.html",
    ]


def draw_pictures(
    plan: Plan, result: Result, folder: Path, progress: Callable[[float, str], None] | None = None
) -> Drawn:
    """Write the pictures of a result; none if it has fewer than two samples.

    An error in one picture does not affect the other pictures or the data.

    Args:
        plan: the plan of the run.
        result: the result of the run.
        folder: folder for the pictures.
        progress: called with the number of finished pictures and the name of the next.
    """
    drawn = Drawn()
    for done, (name, make) in enumerate(_pictures(plan, result) if len(result.trajectory.time) > 1 else ()):
        if progress is not None:
            progress(done, name)
        path = folder / name
        try:
            with interruptible(), np.errstate(over="ignore", invalid="ignore"):  # values of diverged runs overflow
                something = make(path)
            if something:
                drawn.written.append(name)
        except KeyboardInterrupt:
            path.unlink(missing_ok=True)
            return replace(drawn, interrupted=True)
        except Exception as error:
            path.unlink(missing_ok=True)
            kind = "" if isinstance(error, RncError) else f"{type(error).__name__}: "
            drawn.failures[name] = kind + (" ".join(str(error).split()) or "no reason given")
    return drawn


def _pictures(plan: Plan, result: Result) -> Iterator[tuple[str, Callable[[Path], bool]]]:
    """Yield the name and writer of each picture. A writer returns True if there is something to draw."""
    for name, settings in plan.experiment.scenario.plots.items():
        yield f"{name}.png", partial(_plot, result, settings)
    yield "overview.png", partial(_overview, plan, result)
    yield "top_view.png", partial(_top_view, plan, result)
    yield "limits.png", partial(_limits, plan, result)
    yield "animation.html", partial(_animation, plan, result)


def _plot(result: Result, settings: PlotSettings, path: Path) -> bool:
    labels = result.comparisons if settings.comparisons is None else settings.comparisons
    shown = {label: result.comparisons[label] for label in labels if label in result.comparisons}
    if settings.quantity == "outputs":
        figure = plot_outputs(result.trajectory, settings.outputs, settings.title, shown)
    else:
        figure = plot_learning(result.trajectory, settings.quantity, settings.title, shown)
    save(figure, path)
    return True


def _overview(plan: Plan, result: Result, path: Path) -> bool:
    save(plot_run(result.trajectory, plan.experiment.scenario.title), path)
    return True


def _top_view(plan: Plan, result: Result, path: Path) -> bool:
    if not ground_paths(result.trajectory):
        return False
    experiment = plan.experiment
    save(plot_top_view(result.trajectory, experiment.scenario.title, result.comparisons, experiment.obstacles), path)
    return True


def _limits(plan: Plan, result: Result, path: Path) -> bool:
    if result.limits is None or not (result.limits.uses or result.limits.clearances):
        return False
    save(plot_limits(result.limits, plan.experiment.scenario.title), path)
    return True


def _animation(plan: Plan, result: Result, path: Path) -> bool:
    scenario, reduced = plan.experiment.scenario, plan.experiment.reduced
    visual = reduced.robot.visual_model
    if visual is None or not len(visual.geometryObjects):
        return False
    view = view_of(scenario)
    view = replace(view, hide=[*view.hide, "compared"])  # users can switch this layer on
    drawn_model = DrawnModel(reduced.robot, reduced, plan.experiment.obstacles)
    Recording(drawn_model, result.trajectory, view, scenario.title or plan.name, result.comparisons).save(path)
    return True
