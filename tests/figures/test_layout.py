"""One layout rule for every size: nothing overlaps, nothing leaves the figure, no warning is issued."""

import gc
from dataclasses import replace
from itertools import combinations

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

import rnc_pin as rnc
from rnc_pin.applications.scenario.execution import execute
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.figures import Labels, Panel, Series, Sheet, panel_figure

PIXEL = 1.5  # that texts may touch [pixels]
SIZES = [None, "column", "page", (3.4, 18.0)]


@pytest.fixture(autouse=True)
def _freed():
    """Figures refer to themselves: a hundred large ones would wait for the collector, in 5 GB."""
    yield
    gc.collect(1)  # they are young; a full collection takes as long as a figure


@pytest.fixture(scope="module")
def drive():
    """One second of the fire truck, with paths from above, quasi-velocities, estimates of none and normal forces."""
    options = {"simulation.duration": 1.0, "simulation.dt": 0.02, "comparisons": {}}
    return execute(Scenario.load("fire-truck", options)).trajectory


def boxes(figure):
    """Boxes of axes with their tick labels and labels, and of legends."""
    figure.draw_without_rendering()
    renderer, found = FigureCanvasAgg(figure).get_renderer(), []  # without one, each box draws the figure again
    for axes in figure.axes:
        legend = axes.get_legend()
        parts = [axes.get_window_extent(renderer), *(axis.get_tightbbox(renderer) for axis in (axes.xaxis, axes.yaxis))]
        found.append(([part for part in parts if part is not None], legend and legend.get_window_extent(renderer)))
    return found


def check(figure):
    """Assert that no two axes or legends overlap, and that all are within the figure."""
    whole, found = figure.bbox, boxes(figure)
    for parts, legend in found:
        for box in [*parts, *filter(None, [legend])]:
            assert box.x0 >= whole.x0 - PIXEL
            assert box.y0 >= whole.y0 - PIXEL
            assert box.x1 <= whole.x1 + PIXEL
            assert box.y1 <= whole.y1 + PIXEL
        if legend is not None:
            assert overlap(legend, parts[0]) <= PIXEL
    every = [[*parts, *filter(None, [legend])] for parts, legend in found]
    for one, other in combinations(every, 2):
        for a in one:
            for b in other:
                assert overlap(a, b) <= PIXEL, (a, b)


def overlap(a, b):
    """Smaller side of the rectangle that two boxes share [pixels]."""
    return min(min(a.x1, b.x1) - max(a.x0, b.x0), min(a.y1, b.y1) - max(a.y0, b.y0))


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(("size", "compared"), [*((size, True) for size in SIZES), ("column", False)], ids=str)
def test_nothing_overlaps_at_any_size(drive, size, compared):
    """With a comparison, whose legends are larger; without one where there is least room."""
    others = {"another run with a long name": replace(drive, x2=drive.x2 + 0.1)} if compared else {}
    figure = drive.plot(size=size, comparisons=others, title="A title that is longer than one line of a column")
    check(figure)
    if size is not None:
        assert figure.get_figwidth() == ({"column": 3.4, "page": 7.0}.get(size) or size[0])
    if isinstance(size, tuple):
        assert figure.get_figheight() == size[1]


@pytest.mark.parametrize(("size", "points"), [(None, 10), ("column", 8), ("page", 8), ((3.0, 4.0), 8), ((14, 8), 14)])
def test_text_has_the_size_of_print(drive, size, points):
    """Of 8 points in a figure of a paper, also after a later ``savefig`` under the settings of Matplotlib."""
    figure = drive.plot(["tractor_x", "tractor_yaw"], size=size)
    figure.draw_without_rendering()
    for axes in figure.axes:
        labels = [axes.xaxis.label, axes.yaxis.label, *axes.get_xticklabels(), *axes.get_yticklabels()]
        assert {text.get_fontsize() for text in labels} == {points}
        assert {text.get_fontsize() for text in axes.get_legend().get_texts()} == {0.9 * points}


def test_a_size_without_room_is_refused_with_the_height_that_has_it(drive):
    words = r"size \(3.4, 2\): its panels need a height of ([\d.]+) inches"
    with pytest.raises(rnc.InputError, match=words) as refusal:
        drive.plot(["tractor_x", "tractor_yaw", "front_steering", "inputs"], size=(3.4, 2.0))
    height = float(str(refusal.value).split("height of ")[1].split()[0])
    check(drive.plot(["tractor_x", "tractor_yaw", "front_steering", "inputs"], size=(3.4, height)))


@pytest.mark.parametrize("size", ["colum", (3.4,), (1.0, 4.0), (3.4, np.nan), (3.4, "a"), 5.0, (3.4, 1000.0)])
def test_other_sizes_are_refused(drive, size):
    with pytest.raises(rnc.InputError, match=r"^size "):
        drive.plot("inputs", size=size)


def test_labels_replace_names_of_lines_axes_and_runs(drive):
    labels = {"tractor_x": r"$x_1$", "position": "place", "time": "$t$", "slower": "B", "desired": "wanted"}
    figure = drive.plot(["tractor_x", "tractor_y"], labels=labels, comparisons={"slower": drive}, name="A")
    (axes,) = figure.axes
    assert (axes.get_ylabel(), axes.get_xlabel()) == ("place [m]", "$t$ [s]")
    assert [text.get_text() for text in axes.get_legend().get_texts()] == ["$x_1$", "tractor y", "A", "B", "wanted"]
    with pytest.raises(rnc.InputError, match="nothing is named 'tractr_x'; did you mean 'tractor_x'"):
        drive.plot("tractor_x", labels={"tractr_x": "x"})


def test_names_are_text_and_no_formulas_also_for_latex(drive):
    """Names of strangers have dollars and underscores; LaTeX reads more characters as commands."""
    series = (Series("50%_of $a_1$ & #2", np.arange(3.0)),)
    for latex, text in ((False, r"50% of \$a 1\$ & #2"), (True, r"50\% of \$a 1\$ \& \#2")):
        with mpl.rc_context({"text.usetex": latex}):
            assert Labels().text("50%_of $a_1$ & #2") == text
    figure = panel_figure([Panel("share", "% of $x$", series)], np.arange(3.0), Sheet.of("column"))
    check(figure)
    assert figure.axes[0].get_ylabel() == r"share [% of \$x\$]"


def test_quantities_are_chosen_by_name(drive):
    figure = drive.plot(["inputs", "tractor_x", "top_view"])
    assert [axes.get_ylabel() for axes in figure.axes] == ["y [m]", "force [N]", "torque [N m]", "position [m]"]
    for name, message in {
        "input": "no output 'input' in the run; did you mean 'inputs'",
        "estimates": "the run has no estimates",
    }.items():
        with pytest.raises(rnc.InputError, match=message):
            drive.plot([name])
    with pytest.raises(rnc.InputError, match="expected at least one name"):
        drive.plot([])


def test_a_label_stands_beside_the_numbers_that_equal_scales_choose(drive):
    (axes,) = drive.plot("top_view", size=(7.8, 3.2)).axes
    axes.figure.draw_without_rendering()
    label = axes.yaxis.label.get_window_extent()
    axes.yaxis.label.set_visible(False)
    assert label.x1 <= axes.yaxis.get_tightbbox().x0 + PIXEL
