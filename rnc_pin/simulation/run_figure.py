"""Figure of a run of any system: its paths from above, and its panels over time.

Paths are those of bodies on the ground, and of frames whose x and y are outputs. Panels are lines that share an axis
and a unit. To add a panel, add its name to ``PLOTTED_QUANTITIES`` and its function to ``QUANTITIES``. It takes a run
and the compared runs, and returns panels.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import groupby
from types import MappingProxyType
from typing import NamedTuple, TypeAlias

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rnc_pin.errors import InputError, nearest
from rnc_pin.figures.panel import AXIS_NAMES, INTEGRAL_NAMES, MAX_LINES, Labels, Panel, Series, Sheet, Size
from rnc_pin.figures.panel_figure import MIN_HALF_SIZE, GroundPath, GroundPaths, PlaneView, draw_paths, panel_figure
from rnc_pin.figures.style import LegendEntry
from rnc_pin.simulation.run_data import PLOTTED_QUANTITIES, TOP_VIEW, RunData, columns_of_array, tracking_errors

_ALL = slice(None)
_SAME_PATH = 1e-3  # largest distance between two paths that count as one, over the extent


def ground_paths(run: RunData) -> list[GroundPath]:
    """Paths of a top view: bodies on the ground, and frames whose x and y are outputs.

    If no body is on the ground, a frame counts only if its z is not an output.

    Args:
        run: the run.
    """
    # x, y and heading of each body, side by side.
    poses = [run.ground_poses[:, start : start + 3] for start in range(0, run.ground_poses.shape[1], 3)]
    bodies = [
        GroundPath(name, pose[:, :2], pose[:, 2] if np.isfinite(pose[:, 2]).all() else None)
        for name, pose in zip(run.info.outputs.ground_poses.names, poses, strict=True)
    ]
    frames = _frames(run, bodies)
    scale = max([MIN_HALF_SIZE, *(each.extent for each in (*bodies, *frames))])
    found = list(bodies)
    for frame in frames:
        # A leaning body is drawn at another point than its frame but is the same body.
        same = [
            k
            for k, body in enumerate(found)
            if body.name == frame.name or np.abs(body.points - frame.points).max() < _SAME_PATH * scale
        ]
        if not same:
            found.append(frame)
        elif (one := found[same[0]]).desired is None and (frame.desired is not None or one.name == frame.name):
            # the actual path is that of the point that has a goal or the name, not that of the contact
            found[same[0]] = GroundPath(one.name, frame.points, one.headings, frame.desired)
    return found[:MAX_LINES]


def _frames(run: RunData, bodies: Sequence[GroundPath]) -> list[GroundPath]:
    columns: dict[str, tuple[np.ndarray, np.ndarray]] = {}  # values and goals of outputs that are places
    for kind in ("x1", "x2"):
        of, values, goals = run.info.outputs.of(kind), run.arrays[kind], run.arrays[f"{kind}_desired"]
        for k, name in enumerate(of.names):
            # Integrals along a body's own axes are no place.
            if of.units[k] == "m" and not of.is_integral(k):
                columns[name] = values[:, k], goals[:, k]
    found = []
    for name, x in columns.items():
        frame = name.removesuffix("_x")
        if frame == name or f"{frame}_y" not in columns or (not bodies and f"{frame}_z" in columns):
            continue
        points, desired = (np.column_stack(pair) for pair in zip(x, columns[f"{frame}_y"], strict=True))
        has_goal = f"{frame}_x" in run.info.goals and f"{frame}_y" in run.info.goals
        found.append(GroundPath(frame, points, None, desired if has_goal else None))
    return found


def compared_paths(run: RunData, others: Mapping[str, RunData]) -> GroundPaths:
    """Paths of a run with its planned path, and those of other runs by label.

    Args:
        run: the run.
        others: other runs by label.
    """
    plan = run.info.provenance.path
    planned = None if plan is None else np.array(plan.poses)[:, :2]
    return GroundPaths(ground_paths(run), planned, {label: ground_paths(other) for label, other in others.items()})


def plot_run(
    run: RunData,
    outputs: Sequence[str] | str | None,
    title: str | None,
    comparisons: Others,
    size: Size | None,
    labels: Mapping[str, str],
    name: str | None,
    part: slice = _ALL,
) -> Figure:
    """Figure of ``Trajectory.plot``, which has the same arguments, or of a part of its panels.

    Args:
        run: run to show.
        outputs, title, comparisons, size, labels, name: as for ``Trajectory.plot``.
        part: panels of this part only, without the top view if it starts later.
    """
    if len(run.time) < 2:
        raise InputError(f"the run has too few samples to plot: {len(run.time)}, expected at least 2")
    sheet, texts, own = Sheet.of(size), Labels(labels), name or run_name(run, comparisons)
    if labels:
        # A name that nothing has is a slip of the pen: a label would silently be missing.
        texts.check([own, *_label_names(run, comparisons)])
    paths = compared_paths(run, comparisons)

    def draw(axes: Axes) -> Sequence[LegendEntry]:
        return draw_paths(axes, paths, texts, own)

    drawn = PlaneView(draw, paths.aspect()) if paths.own and not part.start else None
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
    shown, times = panels(run, comparisons, chosen)[part], {label: each.time for label, each in comparisons.items()}
    if not shown and drawn is None:
        return Figure()  # no panel is in this part
    return panel_figure(shown, run.time, sheet, title=title, labels=texts, name=own, compared=times, view=drawn)


def run_name(run: RunData, comparisons: Others) -> str:
    """Legend entry of a run beside others: the name of its scenario if no other run has it.

    Args:
        run: the run.
        comparisons: the other runs by label.
    """
    name = (run.info.provenance.scenario or "this run").replace("-", " ")
    return name if name not in comparisons else "this run"


def _label_names(run: RunData, comparisons: Others) -> list[str]:
    """Names that labels of the figures of a run can replace: axes, lines, paths and runs."""
    words = [
        word for each in panels(run, comparisons) for word in (each.quantity, *(line.name for line in each.series))
    ]
    outputs, origin = run.info.outputs, run.info.provenance
    named = [*outputs.x2.names, *outputs.x1.names, *outputs.T.names, *origin.estimates, *origin.predicted]
    return [*named, *words, *(path.name for path in compared_paths(run, comparisons).own), *comparisons, *_FIXED]


_FIXED = ("time", "desired", "planned path", "goal", "x", "y")


_MAX_PANELS = 3  # largest number of panels of one quantity
_ALWAYS_SHOWN = 6  # number of lines of one quantity that are always shown
_MIN_ERROR = 1e-8  # smallest value on an error axis

Others: TypeAlias = Mapping[str, RunData]


class _Axis(NamedTuple):
    """Quantity and unit of an axis."""

    quantity: str
    unit: str


class _Line(NamedTuple):
    """Column of an array of a run, as a line on an axis.

    Attributes:
        name: name of the quantity.
        array, column: its place in a run.
        axis: axis on which it is drawn.
        factor: unit of the array over that of the axis.
        is_integral: True for the integral of the named quantity.
        goals: array of its desired values; "" for none.
    """

    name: str
    array: str
    column: int
    axis: _Axis
    factor: float = 1.0
    is_integral: bool = False
    goals: str = ""

    def values(self, run: RunData) -> np.ndarray:
        """Values (N,) in a run that has the array."""
        return np.asarray(self.factor * getattr(run, self.array)[:, self.column])

    def series(self, run: RunData, others: Others) -> Series:
        """Line of a run and of the other runs whose array has the same columns."""
        desired = getattr(run, self.goals)[:, self.column] if self.goals else None
        own = columns_of_array(run, self.array)
        alike = {label: other for label, other in others.items() if columns_of_array(other, self.array) == own}
        compared = {label: self.values(other) for label, other in alike.items()}
        return Series(self.name, self.values(run), desired, compared, self.is_integral)


def panels(run: RunData, others: Others, chosen: Sequence[str] | None = None) -> list[Panel]:
    """Panels of a run: outputs with references, errors, inputs, estimates, normal forces, singularity margin.

    Args:
        run: run to show.
        others: compared runs by label.
        chosen: names of outputs and of ``QUANTITIES``, in the order of the panels; all by default. The name of a
            quasi-velocity means its integral; "rates" has the quasi-velocities themselves.

    Raises:
        InputError: unknown name, or a quantity that the run does not have.
    """
    if chosen is None:
        return [panel for make in QUANTITIES.values() for panel in make(run, others)]
    shown: list[Panel] = []
    outputs = _output_lines(run)
    for is_output, group in groupby(chosen, lambda name: name in outputs):
        names = list(group)
        if is_output:
            shown += _panels(run, others, [outputs[name] for name in names], all_lines=True)
            continue
        for name in names:
            if name not in QUANTITIES:
                valid = [*run.info.outputs.x2.names, *run.info.outputs.x1.names, *PLOTTED_QUANTITIES]
                raise InputError(f"outputs: no output '{name}' in the run{nearest(name, valid)}")
            found = QUANTITIES[name](run, others)
            if not found:
                raise InputError(f"outputs: the run has no {name.replace('_', ' ')}")
            shown += found
    return shown


def _panels(run: RunData, others: Others, lines: Sequence[_Line], all_lines: bool = False) -> list[Panel]:
    """Panels of lines by their axes; lines with goals have panels of their own if there are too many for one.

    Args:
        run: run to show.
        others: compared runs by label.
        lines: lines of different names.
        all_lines: True shows all; by default those that move most.
    """
    room, found = _lines_per_panel(others), list[Panel]()
    for axis in dict.fromkeys(line.axis for line in lines):
        group = [line for line in lines if line.axis == axis]
        count, note, shown = max(_ALWAYS_SHOWN, _MAX_PANELS * room), "", group
        if len(group) > count and not all_lines:
            # Those that move most tell most; a constant one would only fill the legend.
            most = sorted(group, key=lambda line: -float(np.ptp(line.values(run))))[:count]
            shown, note = [line for line in group if line in most], f"{count} of {len(group)}, moving most"
        parts = [shown]
        if len(shown) > room:
            parts = [[line for line in shown if bool(line.goals) is wanted] for wanted in (True, False)]
        for part in filter(None, parts):
            # Panels of equal size, in the order of the lines.
            for places in np.array_split(np.arange(len(part)), -(-len(part) // room)):
                found.append(Panel(*axis, tuple(part[k].series(run, others) for k in places), note))
    return found


def _lines_per_panel(others: Others) -> int:
    """Largest number of lines of the run in a panel, given the lines of the compared runs."""
    return max(1, MAX_LINES // (1 + len(others)))


def _output_lines(run: RunData) -> dict[str, _Line]:
    """Lines of the outputs by name, those with goals first; of quasi-velocities the integrals."""
    found: dict[str, _Line] = {}
    for kind in ("x2", "x1"):
        columns = run.info.outputs.of(kind)
        for k, (name, unit) in enumerate(zip(columns.names, columns.units, strict=True)):
            integral = columns.is_integral(k)
            quantity = (INTEGRAL_NAMES if integral else AXIS_NAMES).get(unit, "integral" if integral else "value")
            if any(start <= k < start + 3 for start in columns.rotations):
                quantity = "rotation vector"
            goals = f"{kind}_desired" if name in run.info.goals else ""
            line = _Line(name, kind, k, _Axis(quantity, unit or "-"), is_integral=integral, goals=goals)
            found.setdefault(name, line)
    return dict(sorted(found.items(), key=lambda item: not item[1].goals))


def _outputs(run: RunData, others: Others) -> list[Panel]:
    """Panels of the outputs with their references, grouped by quantity."""
    return _panels(run, others, list(_output_lines(run).values()))


def _rates(run: RunData, others: Others) -> list[Panel]:
    """Panels of the quasi-velocities, whose integrals are not coordinates of the robot."""
    goals = ["v2_desired" if given else "" for given in np.isfinite(run.v2_desired).any(axis=0)]
    rates = [line._replace(goals=goals[line.column]) for line in _lines_of(run, "v2", "rate", AXIS_NAMES)]
    return _panels(run, others, [line for line in rates if run.info.outputs.x2.is_integral(line.column)])


def _errors(run: RunData, others: Others) -> list[Panel]:
    """Panels of the tracking errors by unit; of many errors only the largest."""
    errors, lines = tracking_errors(run), _output_lines(run)
    compared = {label: tracking_errors(other) for label, other in others.items()}
    found, room = [], _lines_per_panel(others)
    for unit in dict.fromkeys(lines[name].axis.unit for name in errors):
        names = [name for name in errors if lines[name].axis.unit == unit]
        # By the largest value and not the last: a peak in the middle matters too.
        largest = sorted(names, key=lambda name: -float(np.nanmax(np.abs(errors[name]), initial=0.0)))[:room]
        series = []
        for name in [name for name in names if name in largest]:
            shown = {label: _magnitude(other[name]) for label, other in compared.items() if name in other}
            series.append(Series(name, _magnitude(errors[name]), None, shown, is_integral=lines[name].is_integral))
        # Values far below the errors are only sign changes, so the axis begins above them.
        bottom = max(_MIN_ERROR, 1e-4 * min(float(np.nanmax(each.values, initial=0.0)) for each in series))
        note = f"largest {room} of {len(names)}" if len(names) > room else ""
        found.append(Panel("error", unit, tuple(series), note, log=True, bottom=bottom))
    return found


def _magnitude(error: np.ndarray) -> np.ndarray:
    """Absolute error plus a small positive value, because a logarithmic axis cannot show zero."""
    return np.abs(error) + _MIN_ERROR / 1e8


def _inputs(run: RunData, others: Others) -> list[Panel]:
    """Panels of the actuator inputs by unit, without compared runs, which would hide them."""
    return _panels(run, {}, _lines_of(run, "T", "input", AXIS_NAMES))


def learning_panels(run: RunData, others: Others, quantity: str) -> list[Panel]:
    """Panels of the controller's parameter estimates ("estimates") or prediction errors ("prediction_error").

    Args:
        run: run to show.
        others: compared runs by label.
        quantity: "estimates" or "prediction_error".
    """
    word = "estimate" if quantity == "estimates" else "prediction error"
    return _panels(run, others, _lines_of(run, quantity, word))


def _lines_of(run: RunData, array: str, word: str, words: Mapping[str, str] = MappingProxyType({})) -> list[_Line]:
    """Lines of all columns of an array, whose axes have the name ``word`` or those by unit in ``words``."""
    found = []
    for k, (name, stated) in enumerate(columns_of_array(run, array)):
        factor, unit = _in_si(stated)
        found.append(_Line(name, array, k, _Axis(words.get(unit, word), unit or "-"), factor))
    return found


def _in_si(unit: str) -> tuple[float, str]:
    """Factor of a unit such as "10 kg", and the unit without the factor."""
    number, _, rest = unit.partition(" ")
    try:
        return (float(number), rest) if rest else (1.0, unit)
    except ValueError:
        return 1.0, unit


def _normal_forces(run: RunData, others: Others) -> list[Panel]:
    """Panels of the normal forces of the contacts; a contact with a negative force would lift off."""
    found = []
    for panel in _panels(run, {}, _lines_of(run, "normal_forces", "normal force")):
        lifts = any(float(np.nanmin(each.values, initial=0.0)) < 0.0 for each in panel.series)
        note = "below zero: would lift off" if lifts else panel.note
        found.append(replace(panel, note=note, bottom=None if lifts else 0.0))
    return found


def _margin(run: RunData, others: Others) -> list[Panel]:
    compared = {label: other.singular_value for label, other in others.items()}
    series = Series("singularity margin", run.singular_value, None, compared)
    return [Panel("singularity margin", "-", (series,), bottom=0.0)]


QUANTITIES: dict[str, Callable[[RunData, Others], list[Panel]]] = {
    "rates": _rates,
    "outputs": _outputs,
    "errors": _errors,
    "inputs": _inputs,
    "estimates": partial(learning_panels, quantity="estimates"),
    "prediction_error": partial(learning_panels, quantity="prediction_error"),
    "normal_forces": _normal_forces,
    "margin": _margin,
}
"""Panels by the name that chooses them, in the order of the overview."""
