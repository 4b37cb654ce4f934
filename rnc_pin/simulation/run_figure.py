"""Figure of a run of any system: its paths from above, and its panels over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rnc_pin.errors import InputError
from rnc_pin.figures.ground_path import draw_paths
from rnc_pin.figures.panel import Labels
from rnc_pin.figures.panel_figure import PlaneView, panel_figure
from rnc_pin.figures.sheet import Sheet, Size
from rnc_pin.figures.style import LegendEntry
from rnc_pin.simulation.run_data import RunData
from rnc_pin.simulation.run_panels import QUANTITIES, TOP_VIEW, Others, panels
from rnc_pin.simulation.run_paths import compared_paths


def plot_run(
    run: RunData,
    outputs: Sequence[str] | str | None,
    title: str | None,
    comparisons: Others,
    size: Size | None,
    labels: Mapping[str, str],
    name: str | None,
) -> Figure:
    """Figure of ``Trajectory.plot``, which has the same arguments."""
    if len(run.time) < 2:
        raise InputError(f"the run has too few samples to plot: {len(run.time)}, expected at least 2")
    sheet, texts, own = Sheet.of(size), Labels(labels), name or run_name(run, comparisons)
    if labels:
        texts.check([own, *_label_names(run, comparisons)])
    paths = compared_paths(run, comparisons)

    def draw(axes: Axes) -> Sequence[LegendEntry]:
        return draw_paths(axes, paths, texts, own)

    drawn = PlaneView(draw, paths.aspect()) if paths.own else None
    chosen = None
    if outputs is not None:
        given = [outputs] if isinstance(outputs, str) else list(outputs)
        if not given:
            raise InputError("outputs: expected at least one name; leave it out to plot all")
        chosen = [each for each in given if each != TOP_VIEW]
        if TOP_VIEW not in given:
            drawn = None
        elif drawn is None:
            raise InputError(f"outputs: the run has no {TOP_VIEW}: no body on the ground, no frame with x and y")
    shown, times = panels(run, comparisons, chosen), {label: other.time for label, other in comparisons.items()}
    return panel_figure(shown, run.time, sheet, title=title, labels=texts, name=own, compared=times, view=drawn)


def run_name(run: RunData, comparisons: Others) -> str:
    """Legend entry of a run beside others: the name of its scenario if no other run has it."""
    name = (run.info.provenance.scenario or "this run").replace("-", " ")
    return name if name not in comparisons else "this run"


def _label_names(run: RunData, comparisons: Others) -> list[str]:
    """Names that labels of the figures of a run can replace: axes, lines, paths and runs."""
    words = [word for make in QUANTITIES.values() for panel in make(run, comparisons) for word in panel.words]
    outputs, origin = run.info.outputs, run.info.provenance
    named = [*outputs.x2.names, *outputs.x1.names, *outputs.T, *origin.estimates, *origin.predicted]
    paths = [path.name for path in compared_paths(run, comparisons).own]
    return [*named, *words, *paths, *comparisons, *_FIXED]


_FIXED = ("time", "desired", "planned path", "goal", "x", "y")
