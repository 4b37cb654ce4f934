"""Assumptions of a draft about the base: its kind, constraints, actuators, outputs and locked joints."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from rnc_pin.applications.init.decision import DraftDecision
from rnc_pin.applications.init.wheel_detection import Wheel
from rnc_pin.io import Json

Entry = str | Mapping[str, Json]

UNMEASURED = "MEASURE the radius: no round shape of the wheel was read"
DRIVEN, TURNED, BENT = 0.5, 0.4, 0.2  # displacements of the reference: base, heading, joint [m, rad, rad]


@dataclass
class BaseAssumptions:
    """Assumptions of a draft about the base.

    Attributes:
        base: "fixed", "planar", "free", or None for the base of the file.
        kind: description of the assumed base, with its reason.
        frame: frame of the base.
        constraints: constraint entries, with a remark on each.
        actuators: actuator entries of the base, wheels and steering, with a remark on each.
        outputs: candidate reducing outputs, the preferred one first, with the displacement of each reference.
        vertical: entries of the vertical outputs, such as the pose of the base.
        lock: joints to lock, with their values.
        notes: assumptions and doubts, a line each.
        passive: joints without an actuator.
        ground: height of the ground [m], or None if unknown.
        weightless: True if the scenario has no gravity.
        feedback: settings of the controller that the base needs, or None.
        feedback_remark: remark on that controller.
        path: function from names of primary outputs and a duration [s] to their reference; None for a minimum-jerk
            displacement.
        duration: duration of the reference [s].
        pose: initial joint values that the base needs instead of the default.
        initial: initial values of joints with several degrees of freedom.
        untracked: outputs without a reference.
        lean: horizontal axis in the world frame (3,) of a small initial tilt of the base, or None.
        v2: initial output rates, to be kept constant instead of a reference.
        travel: displacement of a base on wheels in the trial run [m]; 0 for other robots.
        without_effort: joints with effort 0 in the file, which states an effort of other joints.
        idle: wheels without a motor, by assumption.
        decisions: decisions behind these assumptions, with their evidence.
    """

    base: str | None
    kind: str
    frame: str = ""
    constraints: list[tuple[Entry, str]] = field(default_factory=list)
    actuators: list[tuple[Entry, str]] = field(default_factory=list)
    outputs: list[tuple[Mapping[str, Json], float]] = field(default_factory=list)
    vertical: list[Mapping[str, Json]] = field(default_factory=list)
    lock: dict[str, float | list[float]] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    passive: set[str] = field(default_factory=set)
    ground: float | None = None
    weightless: bool = False
    feedback: Mapping[str, Json] | None = None
    feedback_remark: str = "uses the model: state feedback by linearize and lqr at the start"
    path: Callable[[Sequence[str], float], Mapping[str, Json]] | None = None
    duration: float = 5
    pose: dict[str, float] = field(default_factory=dict)
    initial: dict[str, list[float]] = field(default_factory=dict)
    untracked: set[str] = field(default_factory=set)
    lean: np.ndarray | None = None
    v2: dict[str, float] = field(default_factory=dict)
    travel: float = 0.0
    without_effort: set[str] = field(default_factory=set)
    idle: list[str] = field(default_factory=list)
    decisions: list[DraftDecision] = field(default_factory=list)

    def hold(self, joints: Iterable[str], start: Mapping[str, float], why: str) -> None:
        """Lock joints at their start values, and note the reason."""
        named = list(dict.fromkeys(joints))
        if named:
            self.lock.update({joint: start.get(joint, 0.0) for joint in named})
            self.notes.append(f"{why}: {', '.join(named)}")

    def lock_carriers(self, wheels: Iterable[Wheel], start: Mapping[str, float]) -> None:
        """Lock the joints that would lift wheels."""
        carriers = (joint for wheel in wheels for joint in wheel.carriers)
        self.hold(carriers, start, "locked, because they would lift wheels off the ground")

    def add_planar_pose_outputs(self) -> None:
        """Add position on the ground and heading to the candidate outputs."""
        self.outputs += zip(place_and_heading(self.frame), (DRIVEN, TURNED), strict=True)


def place_and_heading(frame: str) -> list[dict[str, Json]]:
    """Output entries for the position on the ground and the heading of a frame."""
    return [{"frame_position": {"frame": frame, "axes": "xy"}}, {"frame_yaw": frame}]


def rolls(wheel: Wheel, **more: Json) -> dict[str, Json]:
    """Constraint entry of a rolling wheel."""
    return {"rolling_wheel": {"frame": wheel.frame, "radius": round(wheel.radius, 6), **more}}


def measured(wheel: Wheel) -> str:
    """Remark on the source of a wheel's radius."""
    if wheel.measured == "height":
        return f"{UNMEASURED}, the value is the axle's height"
    if wheel.measured == "inertia":
        return f"{UNMEASURED}, the value fits its inertia as a solid disk"
    return f"radius from the {wheel.measured} geometry"
