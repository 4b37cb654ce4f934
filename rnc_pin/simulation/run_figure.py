"""Figure of a run of any system: its paths from above, and its panels over time.

Paths are those of bodies on the ground, and of frames whose x and y are outputs. Panels are lines that share an axis
and a unit. To add a panel, add its name to ``PLOTTED_QUANTITIES`` and its function to ``QUANTITIES``. It takes a run
and the compared runs, and returns panels.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from itertools import groupby
from typing import NamedTuple, TypeAlias, TypeVar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rnc_pin.errors import InputError, nearest
from rnc_pin.figures.panel import AXIS_NAMES, INTEGRAL_NAMES, MAX_LINES, Labels, Panel, Series, Sheet, Size, split_names
from rnc_pin.figures.panel_figure import MIN_HALF_SIZE, GroundPath, GroundPaths, PlaneView, draw_paths, panel_figure
from rnc_pin.figures.style import LegendEntry
from rnc_pin.simulation.run_data import PLOTTED_QUANTITIES, TOP_VIEW, RunData, tracking_errors

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
        for name, pose in zip(run.info.outputs.ground_poses, poses, strict=True)
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
    columns: dict[str, tuple[str, int]] = {}
    for kind in ("x1", "x2"):
        of = run.info.outputs.of(kind)
        # Integrals along a body's own axes are no place.
        columns |= {name: (kind, k) for k, name in enumerate(of.names) if of.units[k] == "m" and not of.is_integral(k)}
    found = []
    for name, (kind, column) in columns.items():
        frame = name.removesuffix("_x")
        if frame == name or f"{frame}_y" not in columns or (not bodies and f"{frame}_z" in columns):
            continue
        pair = [(kind, column), columns[f"{frame}_y"]]
        points, desired = (
            np.column_stack([getattr(run, kind + ending)[:, column] for kind, column in pair])
            for ending in ("", "_desired")
        )
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
    words = [word for make in QUANTITIES.values() for panel in make(run, comparisons) for word in panel.words]
    outputs, origin = run.info.outputs, run.info.provenance
    named = [*outputs.x2.names, *outputs.x1.names, *outputs.T, *origin.estimates, *origin.predicted]
    return [*named, *words, *(path.name for path in compared_paths(run, comparisons).own), *comparisons, *_FIXED]


_FIXED = ("time", "desired", "planned path", "goal", "x", "y")


_MAX_PANELS = 3  # largest number of panels of one quantity
_ALWAYS_SHOWN = 6  # number of lines of one quantity that are always shown
_MIN_ERROR = 1e-8  # smallest value on an error axis

Others: TypeAlias = Mapping[str, RunData]
_Key = TypeVar("_Key")


class _Axis(NamedTuple):
    """Quantity and unit of an axis."""

    quantity: str
    unit: str


def panels(run: RunData, others: Others | None = None, chosen: Sequence[str] | None = None) -> list[Panel]:
    """Panels of a run: outputs with references, errors, inputs, estimates, normal forces, singularity margin.

    Args:
        run: run to show.
        others: compared runs by label.
        chosen: names of outputs and of ``QUANTITIES``, in the order of the panels; all by default. The name of a
            quasi-velocity means its integral; "rates" has the quasi-velocities themselves.

    Raises:
        InputError: unknown name, or a quantity that the run does not have.
    """
    others = others or {}
    if chosen is None:
        return [panel for make in QUANTITIES.values() for panel in make(run, others)]
    shown: list[Panel] = []
    for is_output, group in groupby(chosen, lambda name: run.info.outputs.find(name) is not None):
        names = list(group)
        if is_output:
            shown += output_panels(run, others, names)
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


def output_panels(run: RunData, others: Others, names: Sequence[str] | None = None) -> list[Panel]:
    """Panels of the outputs with their references, grouped by quantity; of quasi-velocities the integrals.

    Args:
        run: run to show.
        others: compared runs by label.
        names: names of the outputs; all by default, those with goals first.
    """
    found = list(names or ())
    if names is None:  # outputs with goals come first
        every = (*run.info.outputs.x2.names, *run.info.outputs.x1.names)
        found = sorted(every, key=lambda name: name not in run.info.goals)
    shown = []
    for axis, group in _grouped_by(found, lambda name: _axis(run, name)):
        most, note = group, ""
        if names is None:
            most, note = _largest_ranges(group, lambda name: _Output.of(run, name).values(run), others)
        shown += _panels_of_outputs(run, others, axis, most, note)
    return shown


def learning_panels(run: RunData, others: Others, quantity: str) -> list[Panel]:
    """Panels of the controller's parameter estimates ("estimates") or prediction errors ("prediction_error").

    Args:
        run: run to show.
        others: compared runs by label.
        quantity: "estimates" or "prediction_error".
    """
    values: np.ndarray = getattr(run, quantity)
    origin = run.info.provenance
    known = origin.estimates if quantity == "estimates" else origin.predicted
    units = {name: _in_si(unit) for name, unit in known.items()}
    names = list(units) or [f"{quantity} {column}" for column in range(values.shape[1])]

    def column(of: RunData, name: str) -> np.ndarray:
        return np.asarray(units.get(name, (1.0, ""))[0] * getattr(of, quantity)[:, names.index(name)])

    # A compared controller may learn something else, whose curves belong to no panel of this run.
    alike = {label: other for label, other in others.items() if getattr(other, quantity).shape == values.shape}

    def series(name: str) -> Series:
        return Series(name, column(run, name), None, {label: column(other, name) for label, other in alike.items()})

    word = "estimate" if quantity == "estimates" else "prediction error"
    return _by_axis(names, lambda name: _Axis(word, units.get(name, (1.0, ""))[1] or "-"), series, others)


def _split(
    axis: _Axis, names: Sequence[str], series: Callable[[str], Series], most: int, note: str = ""
) -> list[Panel]:
    """Panels of one axis, with at most so many lines each."""
    return [Panel(*axis, tuple(map(series, part)), note) for part in split_names(names, most)]


def _by_axis(
    names: Sequence[str], axis: Callable[[str], _Axis], series: Callable[[str], Series], others: Others
) -> list[Panel]:
    """Panels of series, grouped by the axes of their names."""
    return [
        panel
        for own, group in _grouped_by(names, axis)
        for panel in _split(own, group, series, _lines_per_panel(others))
    ]


def _in_si(unit: str) -> tuple[float, str]:
    """Factor of a unit such as "10 kg", and the unit without the factor."""
    number, _, rest = unit.partition(" ")
    try:
        return (float(number), rest) if rest else (1.0, unit)
    except ValueError:
        return 1.0, unit


# ---------------------------------------------------------------------- outputs


class _Output(NamedTuple):
    """Output of a run: its array, "x1" or "x2", and its column there."""

    kind: str
    column: int
    unit: str
    is_integral: bool
    is_rotation: bool

    @classmethod
    def of(cls, run: RunData, name: str) -> _Output:
        """Output with this name, which the run has."""
        found = run.info.outputs.find(name)
        assert found is not None
        (kind, k), columns = found, run.info.outputs.of(found[0])
        rotates = any(start <= k < start + 3 for start in columns.rotations)
        return cls(kind, k, columns.units[k], columns.is_integral(k), rotates)

    def values(self, run: RunData, suffix: str = "") -> np.ndarray:
        """Values (N,) in a run with the same outputs; with the suffix "_desired" their goals."""
        return np.asarray(getattr(run, self.kind + suffix)[:, self.column])


def _largest_ranges(names: Sequence[str], values: Callable[[str], np.ndarray], others: Others) -> tuple[list[str], str]:
    """Names of the series with the largest range if there are too many, in the given order, and a note about it."""
    count = max(_ALWAYS_SHOWN, _MAX_PANELS * _lines_per_panel(others))
    if len(names) <= count:
        return list(names), ""
    # Those that move most tell most; a constant one would only fill the legend.
    most = set(sorted(names, key=lambda name: -float(np.ptp(values(name))))[:count])
    return [name for name in names if name in most], f"{count} of {len(names)}, moving most"


def _axis(run: RunData, name: str) -> _Axis:
    """Axis of an output."""
    *_, unit, integral, rotates = _Output.of(run, name)
    if rotates:
        return _Axis("rotation vector", unit)
    names = INTEGRAL_NAMES if integral else AXIS_NAMES
    return _Axis(names.get(unit, "integral" if integral else "value"), unit or "-")


def _grouped_by(names: Iterable[str], key: Callable[[str], _Key]) -> list[tuple[_Key, list[str]]]:
    groups: dict[_Key, list[str]] = {}
    for name in names:
        groups.setdefault(key(name), []).append(name)
    return list(groups.items())


def _lines_per_panel(others: Others) -> int:
    """Largest number of lines of the run in a panel, given the lines of the compared runs."""
    return max(1, MAX_LINES // (1 + len(others)))


def _panels_of_outputs(run: RunData, others: Others, axis: _Axis, names: Sequence[str], note: str = "") -> list[Panel]:
    def series(name: str) -> Series:
        output = _Output.of(run, name)
        desired = output.values(run, "_desired") if name in run.info.goals else None
        alike = {each: other for each, other in others.items() if _has_same_outputs(other, run, output.kind)}
        compared = {each: output.values(other) for each, other in alike.items()}
        return Series(name, output.values(run), desired, compared, is_integral=output.is_integral)

    room = _lines_per_panel(others)
    parts = [list(names)]
    if len(names) > room:  # outputs with references come first, in panels of their own
        parts = [[name for name in names if (name in run.info.goals) is wanted] for wanted in (True, False)]
    return [panel for group in parts for panel in _split(axis, group, series, room, note)]


def _has_same_outputs(other: RunData, run: RunData, kind: str) -> bool:
    """True if another run has the same outputs of this kind."""
    return other.info.outputs.of(kind).names == run.info.outputs.of(kind).names


def _rates(run: RunData, others: Others) -> list[Panel]:
    """Panels of the quasi-velocities, whose integrals are not coordinates of the robot."""
    columns = run.info.outputs.x2
    names = [name for column, name in enumerate(columns.names) if columns.is_integral(column)]
    alike = {label: other for label, other in others.items() if _has_same_outputs(other, run, "x2")}

    def series(name: str) -> Series:
        column = columns.names.index(name)
        desired = run.v2_desired[:, column]
        compared = {label: other.v2[:, column] for label, other in alike.items()}
        return Series(name, run.v2[:, column], desired if np.isfinite(desired).any() else None, compared)

    def axis(name: str) -> _Axis:
        unit = columns.units[columns.names.index(name)]
        return _Axis(AXIS_NAMES.get(f"{unit}/s", "rate"), f"{unit or 1}/s")

    return _by_axis(names, axis, series, others)


def _errors(run: RunData, others: Others) -> list[Panel]:
    """Panels of the tracking errors by unit; of many errors only the largest."""
    errors = tracking_errors(run)
    compared = {label: tracking_errors(other) for label, other in others.items()}
    found = []
    for unit, names in _grouped_by(errors, lambda name: _Output.of(run, name).unit):
        room = _lines_per_panel(others)
        # By the largest value and not the last: a peak in the middle matters too.
        largest = sorted(names, key=lambda name: -float(np.nanmax(np.abs(errors[name]), initial=0.0)))[:room]
        series = []
        for name in [name for name in names if name in largest]:
            shown = {label: _magnitude(other[name]) for label, other in compared.items() if name in other}
            integral = _Output.of(run, name).is_integral
            series.append(Series(name, _magnitude(errors[name]), None, shown, is_integral=integral))
        # Values far below the errors are only sign changes, so the axis begins above them.
        bottom = max(_MIN_ERROR, 1e-4 * min(float(np.nanmax(each.values, initial=0.0)) for each in series))
        note = f"largest {room} of {len(names)}" if len(names) > room else ""
        found.append(Panel("error", unit or "-", tuple(series), note, log=True, bottom=bottom))
    return found


def _magnitude(error: np.ndarray) -> np.ndarray:
    """Absolute error plus a small positive value, because a logarithmic axis cannot show zero."""
    return np.abs(error) + _MIN_ERROR / 1e8


# ---------------------------------------------------------------------- inputs, estimates, normal forces, margin


def _inputs(run: RunData, others: Others) -> list[Panel]:
    """Panels of the actuator inputs by unit, without compared runs, which would hide them."""
    names, units = run.info.outputs.T, run.info.outputs.T_units
    found = []
    for unit, group in _grouped_by(names, lambda name: units[names.index(name)] if units else ""):
        most, note = _largest_ranges(group, lambda name: run.T[:, names.index(name)], {})
        axis = _Axis(AXIS_NAMES.get(unit, "input"), unit or "-")
        found += _split(axis, most, lambda name: Series(name, run.T[:, names.index(name)]), MAX_LINES, note)
    return found


def _normal_forces(run: RunData, others: Others) -> list[Panel]:
    """Panels of the normal forces of the contacts; a contact with a negative force would lift off."""
    names, forces = run.info.outputs.normal_forces, run.normal_forces
    found = []
    for part in split_names(names):
        columns = [forces[:, names.index(name)] for name in part]
        lifts = any(float(np.nanmin(column, initial=0.0)) < 0.0 for column in columns)
        series = tuple(Series(name, column) for name, column in zip(part, columns, strict=True))
        note = "below zero: would lift off" if lifts else ""
        found.append(Panel("normal force", "N", series, note, bottom=None if lifts else 0.0))
    return found


def _margin(run: RunData, others: Others) -> list[Panel]:
    compared = {label: other.singular_value for label, other in others.items()}
    series = Series("singularity margin", run.singular_value, None, compared)
    return [Panel("singularity margin", "-", (series,), bottom=0.0)]


QUANTITIES: dict[str, Callable[[RunData, Others], list[Panel]]] = {
    "rates": _rates,
    "outputs": output_panels,
    "errors": _errors,
    "inputs": _inputs,
    "estimates": partial(learning_panels, quantity="estimates"),
    "prediction_error": partial(learning_panels, quantity="prediction_error"),
    "normal_forces": _normal_forces,
    "margin": _margin,
}
"""Panels by the name that chooses them, in the order of the overview."""
