"""Axles of wheels that are only drawn: knife edges without side slip."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rnc_pin.applications.init.robot_at_start import RobotAtStart
from rnc_pin.applications.init.shapes import LEVEL, NEAR, Shape, across
from rnc_pin.applications.init.tolerances import ALIGNED, PLACED


@dataclass(frozen=True)
class DrawnAxle:
    """Axle of wheels that are only drawn, on a body without side slip along this axle.

    Attributes:
        frame: frame with its origin above or on the axle.
        axis: local axis of the frame along the axle, "x", "y" or "z".
        joint: index of the parent joint.
        radius: wheel radius [m].
        axle: axle direction in the world frame (3,).
        center: midpoint of the wheels in the world frame (3,) [m].
    """

    frame: str
    axis: str
    joint: int
    radius: float
    axle: np.ndarray
    center: np.ndarray


def find_drawn_axles(at_start: RobotAtStart) -> list[DrawnAxle]:
    """Return pairs of coaxial horizontal disks at the ground on one body: wheels without joints in the model."""
    drawn = at_start.shapes["visual"] or at_start.shapes["collision"]
    ground = min((shape.bottom for shape in drawn), default=0.0)
    axles: list[DrawnAxle] = []
    disks = [s for s in drawn if s.axis is not None and abs(s.axis[2]) < LEVEL and _thin(s)]
    for one in disks:
        for other in disks:
            if one.name >= other.name or one.joint != other.joint:
                continue
            axle, between = one.axis, other.points.mean(axis=0) - one.points.mean(axis=0)
            assert axle is not None
            radii = [_radius(each) for each in (one, other)]
            apart = np.linalg.norm(between)
            level = one.bottom - ground < NEAR * radii[0]
            aligned = apart > radii[0] and abs(between @ axle) > (1 - 0.5 * ALIGNED) * apart
            if not level or not aligned or abs(radii[0] - radii[1]) > 0.1 * radii[0]:
                continue
            place = _frame_on(at_start, one.joint, one.points.mean(axis=0), axle, max(PLACED, 0.2 * radii[0]))
            if place is not None and all(place[0] != each.frame for each in axles):
                center = (one.points.mean(axis=0) + other.points.mean(axis=0)) / 2
                axles.append(DrawnAxle(*place, one.joint, radii[0], axle, center))
    return axles


def _thin(disk: Shape) -> bool:
    assert disk.axis is not None
    return bool(np.ptp(disk.points @ disk.axis) < 1.5 * _radius(disk))


def _radius(cylinder: Shape) -> float:
    assert cylinder.axis is not None
    offsets = cylinder.points - cylinder.points.mean(axis=0)
    return float(np.linalg.norm(across(offsets, cylinder.axis), axis=1).max())


def _frame_on(
    at_start: RobotAtStart, joint: int, point: np.ndarray, axle: np.ndarray, near: float
) -> tuple[str, str] | None:
    """Frame of the body with its origin above or on the axle [m], and its local axis along the axle, or None."""
    best = None
    for index, frame in enumerate(at_start.robot.model.frames):
        if frame.parentJoint != joint or frame.type != pin.FrameType.BODY:
            continue
        offset = at_start.data.oMf[index].translation - point
        along = np.abs(at_start.data.oMf[index].rotation.T @ axle)
        beside = across(offset, axle)
        if np.hypot(beside[0], beside[1]) < near and along.max() > np.cos(2 * ALIGNED):
            best = (str(frame.name), "xyz"[int(along.argmax())])
    return best
