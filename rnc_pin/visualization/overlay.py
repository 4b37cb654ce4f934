"""Overlay in the corner of the page: time, errors of the outputs with goals, singularity margin."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple, TypedDict

import numpy as np

from rnc_pin.planning.car_path import continued_back, path_distances
from rnc_pin.simulation import OutputNames, PlannedPath
from rnc_pin.visualization.drawn_state import DrawnState, output_error, tracked_frames
from rnc_pin.visualization.scene_kinematics import SceneKinematics

_MAX_ERRORS = 5
_PATH_BEHIND = 20.0  # [m]


class OverlayRow(NamedTuple):
    """Number on the overlay: its label, unit, value and optional colour."""

    label: str
    unit: str
    value: Callable[[DrawnState], float]
    color: Callable[[DrawnState], np.ndarray] | None = None


class OverlayLabel(TypedDict):
    """Label of a row, as ``page.js`` reads it."""

    label: str
    unit: str
    chip: bool


class Overlay:
    """Rows of the overlay.

    Args:
        outputs: names of the outputs.
        goals: outputs that have goals.
        kinematics: kinematics of the robot.
        plan: planned path, if any.
        margin: True if the states have a singularity margin.
    """

    def __init__(
        self,
        outputs: OutputNames,
        goals: Sequence[str],
        kinematics: SceneKinematics,
        plan: PlannedPath | None,
        margin: bool,
    ) -> None:
        errors: list[OverlayRow] = []
        shown: set[tuple[str, int]] = set()

        def add(label: str, unit: str, places: Sequence[tuple[str, int]]) -> None:
            shown.update(places)
            errors.append(OverlayRow(f"error of {_words(label)}", unit, _size_of_error(outputs, places)))

        for frame, places in tracked_frames(outputs, goals, kinematics.robot).items():
            add(frame, "m", list(places.values()))
        for name in goals:
            place = outputs.find(name)
            if place is None or place in shown:
                continue
            kind, k = place
            columns = outputs.of(kind)
            if k in columns.rotations:
                add(name.removesuffix("_x"), "rad", [(kind, k), (kind, k + 1), (kind, k + 2)])
            else:
                add(f"integral of {name}" if columns.is_integral(k) else name, columns.units[k], [place])
        self.rows = [
            OverlayRow("time", "s", lambda state: state.time),
            *errors[:_MAX_ERRORS],
            *_off_track(plan, kinematics),
        ]
        if margin:
            self.rows.append(
                OverlayRow(
                    "singularity margin", "", lambda state: state.margin, lambda state: margin_color(state.margin)
                )
            )

    def labels(self) -> list[OverlayLabel]:
        """Labels of the rows."""
        return [{"label": row.label, "unit": row.unit, "chip": row.color is not None} for row in self.rows]

    def values(self, state: DrawnState) -> tuple[list[float], list[str | None]]:
        """Values and colours of the rows at a state."""
        values = [float(row.value(state)) for row in self.rows]
        chips = [None if row.color is None else _hex(row.color(state)) for row in self.rows]
        return values, chips


def _off_track(plan: PlannedPath | None, kinematics: SceneKinematics) -> list[OverlayRow]:
    if not plan or not plan.trailer:
        return []
    # The trailer starts behind the path, so the path is continued backwards in a straight line.
    points = continued_back(np.array(plan.poses), _PATH_BEHIND)
    point = kinematics.point(plan.trailer)
    return [
        OverlayRow(
            f"{_words(plan.trailer)} off the planned path",
            "m",
            lambda state: float(path_distances(point(state)[None, :2], points)[0]),
        )
    ]


def margin_color(margin: float) -> np.ndarray:
    """Colour (3,) for the smallest singular value of E on a log scale: vermillion near a singularity, blue far away."""
    stops = np.array([[0xD5, 0x5E, 0x00], [0xE6, 0x9F, 0x00], [0x56, 0xB4, 0xE9], [0x00, 0x72, 0xB2]]) / 255
    where = np.interp(np.log10(max(margin, 1e-6) if np.isfinite(margin) else 1e-6), [-2.3, -0.3], [0.0, 3.0])
    return np.array([np.interp(where, np.arange(4), channel) for channel in stops.T])


def _words(name: str) -> str:
    return name.replace("_", " ")


def _hex(color: np.ndarray) -> str:
    return "#" + "".join(f"{round(255 * float(channel)):02x}" for channel in color)


def _size_of_error(outputs: OutputNames, places: Sequence[tuple[str, int]]) -> Callable[[DrawnState], float]:
    def value(state: DrawnState) -> float:
        return float(np.linalg.norm([output_error(outputs, state, kind)[k] for kind, k in places]))

    return value
