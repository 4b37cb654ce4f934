"""What a draft says of the base: how it stands in the world, what drives it, what is held still for that."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from rnc_pin.plain import Json
from rnc_pin.scenario.draft.wheels import Wheel

Entry = str | Mapping[str, Json]

DRIVEN, TURNED, BENT = 0.5, 0.4, 0.2  # how far the reference goes [m, rad, rad]


@dataclass
class Mobility:
    """What a draft says of the base, before the rest of the robot.

    Attributes:
        base: "fixed", "planar", "free", or None for what the file says.
        kind: what it was taken for, and from what.
        frame: of the base.
        constraints: entries and a remark on each.
        actuators: entries of the base, wheels and steering, and a remark on each.
        outputs: candidates for reducing outputs, the most wanted first, and how far their references go.
        vertical: where the base is.
        lock: joint and value, to be held still.
        notes: assumptions and doubts, a line each.
        passive: joints that nothing drives.
        ground: height of the ground [m], where it is known.
        weightless: whether gravity is taken away.
        feedback: settings of a controller that the base needs, or nothing.
        feedback_remark: on that controller.
        reference: of primary outputs by name, where it is not a motion from rest to rest by what the outputs say.
        duration: of the reference [s].
        pose: values of single joints at the start, where the base needs others than zero.
        initial: values at the start besides those of joints, by joint.
        untracked: outputs that have no reference.
        lean: horizontal axis of the world (3,) about which the base leans at the start, a little; or None.
        v2: rates of outputs at the start, which are kept: there is no other reference then.
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
    feedback_remark: str = "knows the model: feedback of the state, by linearize and lqr at the start"
    reference: Callable[[Sequence[str]], Mapping[str, Json]] | None = None
    duration: float = 5
    pose: dict[str, float] = field(default_factory=dict)
    initial: dict[str, list[float]] = field(default_factory=dict)
    untracked: set[str] = field(default_factory=set)
    lean: np.ndarray | None = None
    v2: dict[str, float] = field(default_factory=dict)

    def hold(self, joints: Iterable[str], start: Mapping[str, float], why: str) -> None:
        """Lock joints at the start, and say why."""
        named = list(dict.fromkeys(joints))
        if named:
            self.lock.update({joint: start.get(joint, 0.0) for joint in named})
            self.notes.append(f"{why}: {', '.join(named)}")

    def hold_carriers(self, wheels: Iterable[Wheel], start: Mapping[str, float]) -> None:
        """Lock the joints that would move wheels."""
        carriers = (joint for wheel in wheels for joint in wheel.carriers)
        self.hold(carriers, start, "locked, because they would lift wheels off the ground")

    def go_anywhere(self) -> None:
        """Want its place on the ground and its heading as outputs."""
        self.outputs += zip(place_and_heading(self.frame), (DRIVEN, TURNED), strict=True)


def place_and_heading(frame: str) -> list[dict[str, Json]]:
    """Entries of the outputs that say where a frame is on the ground."""
    return [{"frame_position": {"frame": frame, "axes": "xy"}}, {"frame_yaw": frame}]


def rolls(wheel: Wheel, **more: Json) -> dict[str, Json]:
    """The entry of a wheel."""
    return {"rolling_wheel": {"frame": wheel.frame, "radius": round(wheel.radius, 6), **more}}


def measured(wheel: Wheel) -> str:
    """Where its radius is from."""
    if wheel.measured == "height":
        return "MEASURE the radius: the file has no shape for this wheel, it is the axle's height"
    if wheel.measured == "inertia":
        return "MEASURE the radius: the file has no shape for this wheel, a solid disk of its inertia has this one"
    return f"radius from the {wheel.measured} geometry"
