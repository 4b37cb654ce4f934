"""Which joints are wheels, and which of those are casters or are steered."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rnc_pin.robots.robot import Robot
from rnc_pin.scenario.draft.shapes import Shape, round_about, shapes

_LEVEL = 0.1  # largest vertical part of an axle, and largest horizontal part of a swivel's axis
_NEAR = 0.3  # how far above the ground a wheel's lowest point may be, in radii
_TURNS = 4 * np.pi  # a joint that turns farther than a wrist does is a wheel like a continuous one
_OMNIDIRECTIONAL = ("mecanum", "omni", "swedish")


@dataclass(frozen=True)
class Wheel:
    """A joint that is a wheel.

    Attributes:
        joint: its name.
        frame: at its centre, turning with it.
        radius: [m].
        measured: where the radius is from: "collision" or "visual" geometry, or "height" of the axle.
        center: in the world (3,) [m].
        axle: in the world (3,).
        swivel: the joint with a vertical axis that carries it, or None.
        trail: from the swivel's axis to the centre, across the axle [m].
        carriers: other joints between the wheel and the base, which move it.
        omnidirectional: named so: its rollers are not in the file.
    """

    joint: str
    frame: str
    radius: float
    measured: str
    center: np.ndarray
    axle: np.ndarray
    swivel: str | None
    trail: float
    carriers: tuple[str, ...]
    omnidirectional: bool

    @property
    def is_caster(self) -> bool:
        """Whether it turns after the base by itself."""
        return self.swivel is not None and ("caster" in _words(self) or self.trail > 0.2 * self.radius)

    @property
    def is_steered(self) -> bool:
        """Whether somebody has to turn it."""
        return self.swivel is not None and not self.is_caster


def find_wheels(robot: Robot, q: np.ndarray) -> list[Wheel]:
    """The wheels of a robot that stands on the ground at ``q`` (nq,)."""
    model = robot.model
    data = model.createData()
    pin.computeJointJacobians(model, data, q)
    pin.updateFramePlacements(model, data)
    geometry = {kind: shapes(robot, kind, q) for kind in ("collision", "visual")}
    root = 1 if model.joints[1].nv > 1 else 0
    lowest = [shape.bottom for shape in geometry["collision"] or geometry["visual"] if shape.joint == root]
    found: list[tuple[Wheel, float]] = []
    for index in range(1, model.njoints):
        joint, name = model.joints[index], model.names[index]
        if joint.nv != 1 or len(model.children[index]):
            continue
        axle = _axis(model, data, index)
        frame = body_frame(robot, index)
        named = any("wheel" in word.lower() for word in (name, frame))
        span = model.upperPositionLimit[joint.idx_q] - model.lowerPositionLimit[joint.idx_q]
        turns = joint.nq == 2 or not np.isfinite(span) or span > _TURNS + 1e-6
        if np.linalg.norm(axle) < 0.5 or abs(axle[2]) > _LEVEL or not (turns or named):
            continue
        center = data.oMi[index].translation.copy()
        for kind, everything in geometry.items():
            parts = [shape for shape in everything if shape.joint == index]
            disk = round_about(parts, center, axle)
            if disk is not None and disk.width < 2.5 * disk.radius:
                radius, bottom, measured = disk.radius, disk.bottom, kind
                break
        else:
            has_shape = any(shape.joint == index for each in geometry.values() for shape in each)
            if has_shape or not named or not 0.01 < center[2] < 1.0:
                continue
            radius, bottom, measured = float(center[2]), 0.0, "height"
        files = [shape.file for each in geometry.values() for shape in each if shape.joint == index]
        found.append((_wheel(robot, data, index, frame, radius, measured, axle, files), bottom))
    ground = min([*lowest, *(bottom for _, bottom in found)], default=0.0)
    return [wheel for wheel, bottom in found if bottom - ground < _NEAR * wheel.radius]


def _wheel(
    robot: Robot,
    data: pin.Data,
    index: int,
    frame: str,
    radius: float,
    measured: str,
    axle: np.ndarray,
    files: list[str],
) -> Wheel:
    model = robot.model
    center, swivel, trail = data.oMi[index].translation.copy(), None, 0.0
    carriers: list[str] = []
    parent = model.parents[index]
    while parent > 0 and model.joints[parent].nv == 1:
        axis = _axis(model, data, parent)
        if swivel is None and not carriers and np.hypot(axis[0], axis[1]) < _LEVEL and np.linalg.norm(axis) > 0.5:
            swivel = model.names[parent]
            offset = center - data.oMi[parent].translation
            trail = abs(float(np.cross(axle, [0.0, 0.0, 1.0]) @ offset))
        else:
            carriers.append(model.names[parent])
        parent = model.parents[parent]
    words = " ".join([model.names[index], frame, *files]).lower()
    omnidirectional = any(word in words for word in _OMNIDIRECTIONAL)
    return Wheel(
        model.names[index], frame, radius, measured, center, axle, swivel, trail, tuple(carriers), omnidirectional
    )


def _axis(model: pin.Model, data: pin.Data, joint: int) -> np.ndarray:
    """Axis in the world (3,) of a joint with one degree of freedom; zero where it slides."""
    jacobian = pin.getJointJacobian(model, data, joint, pin.LOCAL_WORLD_ALIGNED)
    column: np.ndarray = jacobian.reshape(6, model.nv)[3:, model.joints[joint].idx_v]  # (6,) where nv is 1
    return column


def body_frame(robot: Robot, joint: int) -> str:
    """The frame of the link behind a joint, or the joint's own, which is at the same place."""
    frames = [frame for frame in robot.model.frames if frame.parentJoint == joint]
    for frame in frames:
        if frame.type == pin.FrameType.BODY and np.allclose(frame.placement.translation, 0.0):
            return str(frame.name)
    return str(robot.model.names[joint])


@dataclass(frozen=True)
class DrawnAxle:
    """Wheels that are only drawn, on a body that cannot slip along their axle.

    Attributes:
        frame: with its origin on the axle.
        axis: the frame's own axis along the axle, "x" or "y" or "z".
        joint: index of the joint that carries it.
        radius: of the wheels [m].
        axle: in the world (3,).
    """

    frame: str
    axis: str
    joint: int
    radius: float
    axle: np.ndarray


def find_drawn_axles(robot: Robot, q: np.ndarray) -> list[DrawnAxle]:
    """Pairs of lying cylinders at the ground, fixed to one body: wheels that do not turn in the model."""
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, q)
    drawn = shapes(robot, "visual", q)
    ground = min((shape.bottom for shape in drawn), default=0.0)
    axles: list[DrawnAxle] = []
    disks = [s for s in drawn if s.axis is not None and abs(s.axis[2]) < _LEVEL and _thin(s)]
    for one in disks:
        for other in disks:
            if one.name >= other.name or one.joint != other.joint:
                continue
            axle, across = one.axis, other.points.mean(axis=0) - one.points.mean(axis=0)
            assert axle is not None
            radii = [_radius(each) for each in (one, other)]
            apart = np.linalg.norm(across)
            level = one.bottom - ground < _NEAR * radii[0]
            aligned = apart > radii[0] and abs(across @ axle) > 0.999 * apart
            if not level or not aligned or abs(radii[0] - radii[1]) > 1e-3 * radii[0]:
                continue
            place = _frame_on(robot, data, one.joint, one.points.mean(axis=0), axle)
            if place is not None and all(place[0] != each.frame for each in axles):
                axles.append(DrawnAxle(*place, one.joint, radii[0], axle))
    return axles


def _thin(disk: Shape) -> bool:
    assert disk.axis is not None
    return bool(np.ptp(disk.points @ disk.axis) < 1.5 * _radius(disk))


def _radius(cylinder: Shape) -> float:
    assert cylinder.axis is not None
    offsets = cylinder.points - cylinder.points.mean(axis=0)
    return float(np.linalg.norm(offsets - np.outer(offsets @ cylinder.axis, cylinder.axis), axis=1).max())


def _frame_on(robot: Robot, data: pin.Data, joint: int, point: np.ndarray, axle: np.ndarray) -> tuple[str, str] | None:
    """A frame of the body with its origin above or on the axle, and its own axis along it."""
    best = None
    for index, frame in enumerate(robot.model.frames):
        if frame.parentJoint != joint or frame.type != pin.FrameType.BODY:
            continue
        offset = data.oMf[index].translation - point
        along = np.abs(data.oMf[index].rotation.T @ axle)
        beside = offset - (offset @ axle) * axle
        if np.hypot(beside[0], beside[1]) < 1e-3 and along.max() > 0.999:
            best = (str(frame.name), "xyz"[int(along.argmax())])
    return best


def _words(wheel: Wheel) -> str:
    return f"{wheel.joint} {wheel.frame} {wheel.swivel}".lower()
