"""Panels of a run over time: lines that share an axis and a label.

To add a panel, add a function to ``_MAKERS``. It takes a run and the compared runs, and returns panels.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby, pairwise
from typing import TypeAlias

import numpy as np

from rnc_pin.simulation import Trajectory, tracking_errors
from rnc_pin.simulation.run_info import Columns

MAX_LINES = 6  # largest number of lines in a panel
_MAX_PANELS = 3  # largest number of panels of one quantity
_ALWAYS_SHOWN = 6  # number of lines of one quantity that are always shown
_MAX_NAME = 60  # characters
_MIN_ERROR = 1e-8  # smallest value on an error axis

Others: TypeAlias = Mapping[str, Trajectory]


@dataclass(frozen=True)
class Series:
    """Line of a panel, with its reference and the same line of compared runs.

    Attributes:
        name: readable name.
        values: values (N,) over the time of the run.
        desired: reference (N,), if any.
        compared: values of the compared runs by label, over their own time.
    """

    name: str
    values: np.ndarray
    desired: np.ndarray | None = None
    compared: Mapping[str, np.ndarray] = field(default_factory=dict)


@dataclass(frozen=True)
class Panel:
    """Lines that share an axis.

    Attributes:
        label: label of the axis, with the unit.
        series: lines, at most ``MAX_LINES`` if there are no compared runs.
        note: title of the legend, for example about lines that the panel omits.
        log: True if the axis is logarithmic; it begins at ``bottom``.
        bottom: fixed lower limit of the axis, if any.
    """

    label: str
    series: tuple[Series, ...]
    note: str = ""
    log: bool = False
    bottom: float | None = None


def panels(run: Trajectory, others: Others | None = None) -> list[Panel]:
    """All panels of a run: outputs with references, errors, inputs, estimates, normal forces, singularity margin.

    Args:
        run: run to show.
        others: compared runs by label.
    """
    return [panel for make in _MAKERS for panel in make(run, others or {})]


def outputs(run: Trajectory, others: Others, names: Iterable[str] | None = None) -> list[Panel]:
    """Panels of the outputs with their references, grouped by quantity; for quasi-velocities also their rates.

    Args:
        run: run to show.
        others: compared runs by label.
        names: names of the outputs, shown without rates; by default all outputs with rates, those with goals first.
    """
    found = list(names or ())
    if names is None:  # outputs with goals come first
        every = (*run.info.outputs.x2.names, *run.info.outputs.x1.names)
        found = sorted(every, key=lambda name: name not in run.info.goals)
    shown = []
    for label, group in _grouped_by(found, lambda name: _quantity(run, name)):
        most, note = (group, "") if names is not None else _largest_ranges(group, lambda name: _of(run, name), others)
        shown += _panels_of_outputs(run, others, label, most, note)
    return shown if names is not None else [*_rates(run, others), *shown]


def learning_panels(run: Trajectory, others: Others, quantity: str) -> list[Panel]:
    """Panels of the controller's parameter estimates ("estimates") or prediction errors ("prediction_error")."""
    values: np.ndarray = getattr(run, quantity)
    origin = run.info.provenance
    known = origin.estimates if quantity == "estimates" else origin.predicted
    units = {name: _in_si(unit) for name, unit in known.items()}
    names = list(units) or [f"{quantity} {column}" for column in range(values.shape[1])]

    def column(of: Trajectory, name: str) -> np.ndarray:
        scaled: np.ndarray = units.get(name, (1.0, ""))[0] * getattr(of, quantity)[:, names.index(name)]
        return scaled

    alike = {label: other for label, other in others.items() if getattr(other, quantity).shape == values.shape}

    def series(name: str) -> Series:
        compared = {label: column(other, name) for label, other in alike.items()}
        return Series(readable_name(name), column(run, name), None, compared)

    label, found = "estimate" if quantity == "estimates" else "measured less\npredicted rate", list[Panel]()
    for unit, group in _grouped_by(names, lambda name: units.get(name, (1.0, ""))[1]):
        found += _split(f"{label} [{unit}]" if unit else label, group, series, _lines_per_panel(others))
    return found


def _split(label: str, names: Sequence[str], series: Callable[[str], Series], most: int, note: str = "") -> list[Panel]:
    """Panels of one label, with at most so many lines each."""
    return [Panel(label, tuple(map(series, part)), note) for part in split_names(names, most)]


def _in_si(unit: str) -> tuple[float, str]:
    """Factor of a unit such as "10 kg", and the unit without the factor."""
    number, _, rest = unit.partition(" ")
    try:
        return (float(number), rest) if rest else (1.0, unit)
    except ValueError:
        return 1.0, unit


def readable_name(name: str) -> str:
    """Readable name; the middle of a long name is replaced by dots."""
    if len(name) > _MAX_NAME:
        name = f"{name[: _MAX_NAME // 2]}...{name[-_MAX_NAME // 2 :]}"
    return name.replace("_", " ").strip()


def split_names(names: Sequence[str], most: int = MAX_LINES) -> list[list[str]]:
    """Split names into groups of at most ``most``. Names with the same first word stay together."""
    if len(names) <= most:
        return [list(names)] if names else []
    groups = [list(group) for _, group in groupby(names, key=_first_word)]
    if len(groups) == 1 or len(groups) == len(names):
        count = -(-len(names) // most)
        bounds = [round(k * len(names) / count) for k in range(count + 1)]
        return [list(names[start:end]) for start, end in pairwise(bounds)]
    parts: list[list[str]] = []
    for group in groups:
        for part in split_names(group, most):
            if parts and len(parts[-1]) + len(part) <= most:
                parts[-1] += part
            else:
                parts.append(part)
    return parts


def _first_word(name: str) -> str:
    return name.lstrip("_").split("_")[0].rstrip("0123456789")


# ---------------------------------------------------------------------- outputs


def _find_output(run: Trajectory, name: str) -> tuple[str, Columns, int]:
    place = run.info.outputs.find(name)
    if place is None:
        raise KeyError(name)
    return place[0], run.info.outputs.of(place[0]), place[1]


def _of(run: Trajectory, name: str) -> np.ndarray:
    """Values of an output, (N,)."""
    kind, _, column = _find_output(run, name)
    values: np.ndarray = getattr(run, kind)[:, column]
    return values


def _largest_ranges(names: Sequence[str], values: Callable[[str], np.ndarray], others: Others) -> tuple[list[str], str]:
    """Names of the series with the largest range if there are too many, in the given order, and a note about it."""
    count = max(_ALWAYS_SHOWN, _MAX_PANELS * _lines_per_panel(others))
    if len(names) <= count:
        return list(names), ""
    most = set(sorted(names, key=lambda name: -float(np.ptp(values(name))))[:count])
    return [name for name in names if name in most], f"{count} of {len(names)}, moving most"


def _is_integral(run: Trajectory, name: str) -> bool:
    _, columns, column = _find_output(run, name)
    return columns.is_integral(column)


def _quantity(run: Trajectory, name: str) -> str:
    """Axis label of an output."""
    _, columns, column = _find_output(run, name)
    unit, integral = columns.units[column], _is_integral(run, name)
    if any(start <= column < start + 3 for start in columns.rotations):
        return f"rotation vector [{unit}]"
    kinds = {"m": "distance", "rad": "turned angle"} if integral else {"m": "position", "rad": "angle"}
    return f"{kinds.get(unit, 'integral' if integral else 'value')} [{unit or '-'}]"


def _grouped_by(names: Iterable[str], key: Callable[[str], str]) -> list[tuple[str, list[str]]]:
    groups: dict[str, list[str]] = {}
    for name in names:
        groups.setdefault(key(name), []).append(name)
    return list(groups.items())


def _lines_per_panel(others: Others) -> int:
    """Largest number of lines of the run in a panel, given the lines of the compared runs."""
    return max(1, MAX_LINES // (1 + len(others)))


def _line_name(run: Trajectory, name: str) -> str:
    return f"integral of {readable_name(name)}" if _is_integral(run, name) else readable_name(name)


def _panels_of_outputs(
    run: Trajectory, others: Others, label: str, names: Sequence[str], note: str = ""
) -> list[Panel]:
    def series(name: str) -> Series:
        kind, _, column = _find_output(run, name)
        desired = getattr(run, f"{kind}_desired")[:, column] if name in run.info.goals else None
        compared = {
            each: getattr(other, kind)[:, column]
            for each, other in others.items()
            if _has_same_outputs(other, run, kind)
        }
        return Series(_line_name(run, name), _of(run, name), desired, compared)

    room = _lines_per_panel(others)
    parts = [list(names)]
    if len(names) > room:  # outputs with references come first, in panels of their own
        parts = [[name for name in names if (name in run.info.goals) is wanted] for wanted in (True, False)]
    return [panel for group in parts for panel in _split(label, group, series, room, note)]


def _has_same_outputs(other: Trajectory, run: Trajectory, kind: str) -> bool:
    """True if another run has the same outputs of this kind."""
    return other.info.outputs.of(kind).names == run.info.outputs.of(kind).names


def _rates(run: Trajectory, others: Others) -> list[Panel]:
    """Panels of the quasi-velocities, whose integrals are not coordinates of the robot."""
    columns = run.info.outputs.x2
    names = [name for name in columns.names if _is_integral(run, name)]
    alike = {label: other for label, other in others.items() if _has_same_outputs(other, run, "x2")}

    def series(name: str) -> Series:
        column = columns.names.index(name)
        desired = run.v2_desired[:, column]
        compared = {label: other.v2[:, column] for label, other in alike.items()}
        return Series(readable_name(name), run.v2[:, column], desired if np.isfinite(desired).any() else None, compared)

    found = []
    for unit, group in _grouped_by(names, lambda name: columns.units[columns.names.index(name)]):
        kind = {"m": "speed", "rad": "angular velocity"}.get(unit, "rate")
        found += _split(f"{kind} [{unit or 1}/s]", group, series, _lines_per_panel(others))
    return found


def _errors(run: Trajectory, others: Others) -> list[Panel]:
    """Panels of the tracking errors by unit; of many errors only the largest."""
    errors = tracking_errors(run)
    compared = {label: tracking_errors(other) for label, other in others.items()}
    units = {name: _find_output(run, name)[1].units[_find_output(run, name)[2]] for name in errors}
    found = []
    for unit, names in _grouped_by(errors, lambda name: units[name]):
        room = _lines_per_panel(others)
        largest = sorted(names, key=lambda name: -float(np.nanmax(np.abs(errors[name]), initial=0.0)))[:room]
        series = []
        for name in [name for name in names if name in largest]:
            shown = {label: _magnitude(other[name]) for label, other in compared.items() if name in other}
            series.append(Series(_line_name(run, name), _magnitude(errors[name]), None, shown))
        # Values far below the errors are only sign changes, so the axis begins above them.
        bottom = max(_MIN_ERROR, 1e-4 * min(float(np.nanmax(each.values, initial=0.0)) for each in series))
        note = f"largest {room} of {len(names)}" if len(names) > room else ""
        found.append(Panel(f"error [{unit or '-'}]", tuple(series), note, log=True, bottom=bottom))
    return found


def _magnitude(error: np.ndarray) -> np.ndarray:
    """Absolute error plus a small positive value, because a logarithmic axis cannot show zero."""
    return np.abs(error) + _MIN_ERROR / 1e8


# ---------------------------------------------------------------------- inputs, estimates, normal forces, margin


def _inputs(run: Trajectory, others: Others) -> list[Panel]:
    """Panels of the actuator inputs by unit, without compared runs, which would hide them."""
    names, units = run.info.outputs.T, run.info.outputs.T_units
    kinds = {"N": "force [N]", "N m": "torque [N m]"}
    found = []
    for label, group in _grouped_by(
        names, lambda name: kinds.get(units[names.index(name)] if units else "", "input [N, N m]")
    ):
        most, note = _largest_ranges(group, lambda name: run.T[:, names.index(name)], {})
        found += _split(
            label, most, lambda name: Series(readable_name(name), run.T[:, names.index(name)]), MAX_LINES, note
        )
    return found


def _normal_forces(run: Trajectory, others: Others) -> list[Panel]:
    """Panels of the normal forces of the contacts; a contact with a negative force would lift off."""
    names, forces = run.info.outputs.normal_forces, run.normal_forces
    found = []
    for part in split_names(names):
        columns = [forces[:, names.index(name)] for name in part]
        lifts = any(float(np.nanmin(column, initial=0.0)) < 0.0 for column in columns)
        series = tuple(Series(readable_name(name), column) for name, column in zip(part, columns, strict=True))
        note = "below zero: would lift off" if lifts else ""
        found.append(Panel("normal force [N]", series, note, bottom=None if lifts else 0.0))
    return found


def _learning_panels(run: Trajectory, others: Others) -> list[Panel]:
    return [panel for each in ("estimates", "prediction_error") for panel in learning_panels(run, others, each)]


def _margin(run: Trajectory, others: Others) -> list[Panel]:
    compared = {label: other.singular_value for label, other in others.items()}
    series = Series("singularity margin", run.singular_value, None, compared)
    return [Panel("singularity\nmargin [-]", (series,), bottom=0.0)]


_MAKERS: tuple[Callable[[Trajectory, Others], list[Panel]], ...] = (
    outputs,
    _errors,
    _inputs,
    _learning_panels,
    _normal_forces,
    _margin,
)
