"""Detection of wheels: round shapes about a horizontal axle at the ground; names only help."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from rnc_pin.applications.init.evidence import body_frame, has_word, joint_limits, turning_axis
from rnc_pin.applications.init.robot_at_start import (
    ALIGNED,
    GEOMETRY,
    LEVEL,
    NEAR,
    PLACED,
    SAME,
    RobotAtStart,
    Shape,
    across,
    fitted_disk,
    joints_without_mesh,
    placed,
)
from rnc_pin.io import Json

UPRIGHT = 1e-5  # horizontal part of a unit axis below which a pivot is vertical up to rounding
_SIZES = (0.003, 1.5)  # plausible radii if no shape gives one [m]
_WHEEL = ".*wheel|wheel.*|tire|tyre|.*caster|caster.*|.*castor|castor.*"
_NO_WHEEL = "reaction_wheel|flywheel|momentum_wheel|steering_?wheel|rotor|propeller|prop|pulley|gear|spider"


@dataclass(frozen=True)
class Pivot:
    """Joint with a nearly vertical axis that carries wheels.

    Attributes:
        joint: joint name.
        index: joint index in the model.
        point: point on the axis in the world frame (3,) [m].
        axis: axis in the world frame (3,), upward.
        is_continuous: True if it can turn through a full revolution.
    """

    joint: str
    index: int
    point: np.ndarray
    axis: np.ndarray
    is_continuous: bool

    def offset(self, point: np.ndarray) -> np.ndarray:
        """Return the horizontal vector (3,) from the axis to a point (3,)."""
        away = point - self.point
        away = away - away[2] / self.axis[2] * self.axis
        return np.asarray(away)


@dataclass(frozen=True)
class Wheel:
    """Wheel with a joint.

    Attributes:
        joint: joint name; of a wheel that is only drawn, the joint that carries it.
        frame: frame fixed to the wheel, with its origin at the center.
        radius: radius [m].
        measured: source of the radius: "collision" or "visual" geometry, "height" of the axle or "inertia".
        center: center in the world frame (3,) [m].
        axle: axle direction in the world frame (3,).
        pivots: nearly vertical joints between the wheel and the base, the nearest to the wheel first.
        carriers: other joints between the wheel and the base that move the wheel.
        rollers: joints of the rollers on the rim.
        is_ball: True if the wheel is a sphere.
        edge: settings of the knife edge that stands for a wheel without a joint about its axle; else None.
        imbalance: distance of its center of mass from the axle [m].
    """

    joint: str
    frame: str
    radius: float
    measured: str
    center: np.ndarray
    axle: np.ndarray
    pivots: tuple[Pivot, ...] = ()
    carriers: tuple[str, ...] = ()
    rollers: tuple[str, ...] = ()
    is_ball: bool = False
    edge: Mapping[str, Json] | None = None
    imbalance: float = 0.0

    @property
    def heading(self) -> np.ndarray:
        """Horizontal rolling direction in the world frame (3,)."""
        along = np.cross(self.axle, [0.0, 0.0, 1.0])
        return np.asarray(along / np.linalg.norm(along))

    def is_beside(self, other: Wheel) -> bool:
        """Return whether the same joints carry another wheel."""
        chains = [(*each.carriers, *(pivot.joint for pivot in each.pivots)) for each in (self, other)]
        return chains[0] == chains[1]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of joint, frame and nearest pivot."""
        return self.joint, self.frame, *(each.joint for each in self.pivots[:1])


@dataclass(frozen=True)
class _Candidate:
    index: int
    frame: str
    axle: np.ndarray
    center: np.ndarray
    named: bool
    doubtful: bool
    """True if its name means another part: it is a wheel if its shape stands on the ground of other wheels."""
    turns_once: bool
    """True if its limits permit one turn, as those of a wrist: it is doubtful too, but for a pair on one axle line."""
    parts: dict[str, list[Shape]]
    rollers: tuple[int, ...]


def find_wheels(at_start: RobotAtStart) -> list[Wheel]:
    """Return the wheels that touch the ground."""
    found, unmeasured = _measured_wheels(at_start)
    wheels = _on_the_ground(found, at_start.shapes["collision"] or at_start.shapes["visual"], at_start.root)
    for candidate in unmeasured if wheels else ():  # their radius is their height above the common ground
        ground = min(wheel.center[2] - wheel.radius for wheel in wheels)
        height = float(candidate.center[2] - ground)
        if _is_plausible(height) and height < 2 * max(wheel.radius for wheel in wheels):
            wheels.append(_wheel(at_start, candidate, _Size(height, ground, "height")))
    carriers = {joint for wheel in wheels for joint in wheel.carriers}
    return [wheel for wheel in wheels if wheel.joint not in carriers]


def find_virtual_joints(at_start: RobotAtStart) -> list[str]:
    """Return joints at the height of axles that move no shape and nearly no mass beside a wheel: virtual wheels.

    Controllers of steered bases ask for such a wheel in the middle of each axle, and for a pivot above it.
    """
    model, data = at_start.robot.model, at_start.data
    wheels = [each for each in _candidates(at_start) if any(each.parts.values())]
    shaped = {shape.joint for every in at_start.shapes.values() for shape in every}
    shaped = shaped.union(*(joints_without_mesh(at_start.robot, kind) for kind in GEOMETRY))
    lightest = min((float(model.inertias[each.index].mass) for each in wheels), default=0.0)
    found = []
    virtual = 0.01  # largest mass of a virtual wheel, as a share of that of a wheel
    for joint in range(at_start.root + 1, model.njoints):
        behind = [int(each) for each in model.subtrees[joint]]
        level = any(abs(data.oMi[joint].translation[2] - each.center[2]) < PLACED for each in wheels)
        mass = sum(model.inertias[each].mass for each in behind)
        if level and model.joints[joint].nv == 1 and not shaped & {*behind} and mass < virtual * lightest:
            found.append(str(model.names[joint]))
    return found


def find_raised_wheels(at_start: RobotAtStart, wheels: Sequence[Wheel]) -> list[Wheel]:
    """Return round bodies above the ground in the plane of several wheels: sprockets and idlers of a track."""
    standing = {wheel.joint for wheel in wheels}
    others = [each.wheel for each in _measured_wheels(at_start)[0] if each.is_shaped]
    in_plane = 3  # smallest number of wheels on the ground in the plane of a sprocket
    return [
        other
        for other in others
        if other.joint not in standing and sum(_are_in_plane(other, wheel) for wheel in wheels) >= in_plane
    ]


def stand_below_body(wheels: Sequence[Wheel], at_start: RobotAtStart) -> bool:
    """Return whether wheels have shapes that reach below all other parts, as propellers and thrusters do not."""
    own = {at_start.robot.joint_id(wheel.joint) for wheel in wheels}
    others = [shape.bottom for every in at_start.shapes.values() for shape in every if shape.joint not in own]
    lowest = min(others, default=np.inf)
    return any(
        wheel.measured in GEOMETRY and wheel.center[2] - wheel.radius < lowest - ALIGNED * wheel.radius
        for wheel in wheels
    )


def _are_in_plane(one: Wheel, other: Wheel) -> bool:
    """True if a wheel on the base and one that no pivot carries have parallel axles and the same place along them."""
    carried = (one.pivots, one.carriers, other.pivots)  # rollers of a track may hang on bogies
    is_parallel = np.linalg.norm(np.cross(one.axle, other.axle)) < ALIGNED
    return not any(carried) and bool(is_parallel and abs((one.center - other.center) @ other.axle) < other.radius / 2)


def _measured_wheels(at_start: RobotAtStart) -> tuple[list[_Found], list[_Candidate]]:
    """Wheels on the ground and above it with a radius, and those that are only named."""
    floor = _floor(at_start)
    found: list[_Found] = []
    unmeasured: list[_Candidate] = []
    bare: list[_Candidate] = []  # without shapes, a wheel's name and a round inertia
    virtual = find_virtual_joints(at_start)
    candidates = [each for each in _candidates(at_start) if at_start.robot.model.names[each.index] not in virtual]
    rollers = {each for candidate in candidates for each in candidate.rollers}
    for candidate in candidates:
        if candidate.index in rollers:
            continue
        size = _measured_size(at_start, candidate, floor)
        if size is not None:
            wheel = _wheel(at_start, candidate, size)
            doubtful = candidate.doubtful or candidate.turns_once
            if not doubtful or size.measured in candidate.parts:
                found.append(_Found(wheel, size.bottom, candidate.named, doubtful, candidate.turns_once))
        elif candidate.named:
            unmeasured.append(candidate)
        elif not any(candidate.parts.values()):
            bare.append(candidate)
    for candidate in bare:
        mate = next((each for each in found if _is_mate_of(at_start, candidate, each.wheel)), None)
        if mate is not None:
            size = _Size(mate.wheel.radius, float(candidate.center[2]) - mate.wheel.radius, "height")
            wheel = _wheel(at_start, candidate, size)
            found.append(_Found(wheel, size.bottom, False, candidate.doubtful, candidate.turns_once))
    return [replace(each, doubtful=False) if _has_mate(each, found) else each for each in found], unmeasured


def _is_mate_of(at_start: RobotAtStart, candidate: _Candidate, wheel: Wheel) -> bool:
    """True for a body of the same mass on the axle line of a wheel, on the same body: the other wheel of an axle."""
    model = at_start.robot.model
    other = at_start.robot.joint_id(wheel.joint)
    masses = [model.inertias[each].mass for each in (candidate.index, other)]
    return (
        _is_on_line(wheel, candidate.axle, candidate.center, wheel.radius)
        and abs(masses[0] - masses[1]) < ALIGNED * masses[1]
        and model.parents[candidate.index] == model.parents[other]
    )


def _is_on_line(wheel: Wheel, axle: np.ndarray, center: np.ndarray, radius: float) -> bool:
    """True if another wheel, with its axle (3,), center (3,) and radius, is on the axle line of a wheel."""
    beside = across(center - wheel.center, wheel.axle)
    is_parallel = np.linalg.norm(np.cross(axle, wheel.axle)) < ALIGNED
    return bool(is_parallel and np.linalg.norm(beside) < placed(radius))


def _has_mate(one: _Found, found: Sequence[_Found]) -> bool:
    """True for one of two equal disks side by side on one axle line of one body, which turn once."""
    for other in (each.wheel for each in found if each.turns_once and one.turns_once and each is not one):
        equal = abs(other.radius - one.wheel.radius) < ALIGNED * other.radius
        in_line = _is_on_line(one.wheel, other.axle, other.center, other.radius)
        if equal and in_line and one.wheel.is_beside(other):
            return True
    return False


@dataclass(frozen=True)
class _Size:
    radius: float
    bottom: float
    measured: str
    is_ball: bool = False


@dataclass(frozen=True)
class _Found:
    wheel: Wheel
    bottom: float
    named: bool
    doubtful: bool
    turns_once: bool

    @property
    def is_shaped(self) -> bool:
        """True if its radius is that of a shape."""
        return self.wheel.measured in GEOMETRY

    def touches(self, ground: float) -> bool:
        slack = NEAR if self.is_shaped else 1.0
        return self.bottom - ground < slack * self.wheel.radius


def _candidates(at_start: RobotAtStart) -> Iterator[_Candidate]:
    """Yield continuous joints with a horizontal axis and no child joints except rollers."""
    model = at_start.robot.model
    turns = 4 * np.pi  # a joint with a larger range can be a wheel, like a continuous joint; wrists have less [rad]
    for index in range(at_start.root + 1, model.njoints):
        if model.joints[index].nv != 1:
            continue
        axle = turning_axis(model, at_start.data, index)
        frame, center = _on_axle(at_start, index, axle)
        links = [each.name for each in model.frames if each.parentJoint == index and each.type == pin.FrameType.BODY]
        named = any(has_word(_WHEEL, name) and not has_word(_NO_WHEEL, name) for name in (model.names[index], *links))
        doubtful = not named and has_word(_NO_WHEEL, model.names[index], frame)
        rollers = [int(each) for each in model.children[index]]
        if not _are_rollers(at_start, rollers, center, axle):
            if not named:
                continue
            rollers = []  # a named wheel can carry gears and hubs
        travel = _travel(at_start, index)
        turns_once = not named and travel <= (1 + SAME) * turns
        if np.linalg.norm(axle) < 0.5 or abs(axle[2]) > LEVEL or (turns_once and travel < (1 - 10 * SAME) * 2 * np.pi):
            continue
        behind = {index, *rollers}
        parts = {kind: [each for each in every if each.joint in behind] for kind, every in at_start.shapes.items()}
        yield _Candidate(index, frame, axle, center, named, doubtful, turns_once, parts, tuple(rollers))


def _travel(at_start: RobotAtStart, index: int) -> float:
    """Range of a joint [rad or m]: upper limit minus lower limit."""
    low, high = joint_limits(at_start.robot, str(at_start.robot.model.names[index]))
    return high - low


def _on_axle(at_start: RobotAtStart, joint: int, axle: np.ndarray) -> tuple[str, np.ndarray]:
    """Frame of a wheel and its position (3,): a link on the axle with a wheel's name, or the joint's body frame."""
    origin = at_start.data.oMi[joint].translation
    on_axle = 1e-4  # largest distance of a wheel's frame from its axle [m]: a wheel that is farther away is eccentric
    for index, frame in enumerate(at_start.robot.model.frames):
        called = frame.parentJoint == joint and frame.type == pin.FrameType.BODY and has_word(_WHEEL, frame.name)
        if called and np.abs(across(at_start.data.oMf[index].translation - origin, axle)).max() < on_axle:
            return str(frame.name), at_start.data.oMf[index].translation.copy()
    return body_frame(at_start.robot, joint), origin.copy()


def _are_rollers(at_start: RobotAtStart, joints: list[int], center: np.ndarray, axle: np.ndarray) -> bool:
    """True if child joints stand on a rim about the axle; side gears of a differential are on the axle itself."""
    if not joints:
        return True
    model = at_start.robot.model
    leaves = all(model.joints[each].nv == 1 and not len(model.children[each]) for each in joints)
    away = np.array([across(at_start.data.oMi[each].translation - center, axle) for each in joints])
    distances = np.linalg.norm(away, axis=1)
    rollers = 4  # smallest number of child joints on a rim that are rollers
    return len(joints) >= rollers and leaves and bool(distances.min() > 0.5 * distances.max())


def _measured_size(at_start: RobotAtStart, candidate: _Candidate, floor: float | None) -> _Size | None:
    """Size of a wheel, or None if the candidate is no wheel.

    Sources of the radius, in order: its shapes, its height above a floor in the file, its inertia, its height above the
    base's origin.
    """
    widest = 8.0  # largest width of a wheel, in radii
    for kind, parts in candidate.parts.items():
        disk = fitted_disk(parts, candidate.center, candidate.axle)
        if disk is not None and disk.width < widest * disk.radius:
            return _Size(disk.radius, disk.bottom, kind, all(len(part.points) == 1 for part in parts))
    spun = _radius_from_inertia(at_start, candidate)
    if not candidate.named and (spun is None or any(candidate.parts.values())):
        return None
    height = float(candidate.center[2]) - (0.0 if floor is None else floor)
    if floor is not None and _is_plausible(height):
        return _Size(height, floor, "height")
    if spun is not None and not (_is_plausible(height) and 0.7 < height / spun < 1.4):
        return _Size(spun, float(candidate.center[2]) - spun, "inertia")
    return _Size(height, 0.0, "height") if _is_plausible(height) else None


def _is_plausible(radius: float) -> bool:
    return _SIZES[0] < radius < _SIZES[1]


def _radius_from_inertia(at_start: RobotAtStart, candidate: _Candidate) -> float | None:
    """Radius [m] of the solid disk with this inertia, or None if the inertia is not axisymmetric."""
    inertia = at_start.robot.model.inertias[candidate.index]
    if inertia.mass <= 0:
        return None
    axle = at_start.data.oMi[candidate.index].rotation.T @ candidate.axle
    tensor, lever = inertia.inertia, inertia.lever
    about = float(axle @ tensor @ axle)
    moments = np.linalg.eigvalsh(tensor - about * np.outer(axle, axle))
    moments = np.delete(moments, int(np.argmin(np.abs(moments))))  # moments about axes normal to the axle
    radius = float(np.sqrt(max(2 * about / inertia.mass, 0.0)))
    beside = np.linalg.norm(across(lever, axle))
    is_round = moments[0] > 0 and moments[1] < 1.15 * moments[0] and beside < 0.2 * radius
    return radius if is_round and _is_plausible(radius) else None


def _on_the_ground(found: list[_Found], everything: list[Shape], root: int) -> list[Wheel]:
    named = [each for each in found if each.named]
    sure = [each for each in named if each.is_shaped] or named
    if sure:
        unnamed = [each for each in found if each.is_shaped and not each.doubtful]  # a spare wheel may have the name
        ground = min(each.bottom for each in (*sure, *unnamed))
        lowest = min((shape.bottom for shape in everything), default=ground)
        level = sum(each.touches(ground) for each in sure)  # a fork or a skirt can be lower than two wheels
        if level < 2 and lowest < ground - 2 * max(each.wheel.radius for each in sure):
            return []  # named wheels, but above the ground
    else:
        bottoms = [shape.bottom for shape in everything if shape.joint <= root]
        ground = min([*bottoms, *(each.bottom for each in found if not each.doubtful)], default=0.0)
    standing = [each for each in found if each.touches(ground)]
    return [each.wheel for each in standing] if any(not each.doubtful for each in standing) else []


def _wheel(at_start: RobotAtStart, candidate: _Candidate, size: _Size) -> Wheel:
    model = at_start.robot.model
    lever = model.inertias[candidate.index].lever
    pivots, carriers = joints_above(
        at_start, model.parents[candidate.index], candidate.center, candidate.axle, size.radius
    )
    return Wheel(
        joint=str(model.names[candidate.index]),
        frame=candidate.frame,
        radius=size.radius,
        measured=size.measured,
        center=candidate.center,
        axle=candidate.axle,
        pivots=pivots,
        carriers=carriers,
        rollers=tuple(str(model.names[each]) for each in candidate.rollers),
        is_ball=size.is_ball,
        imbalance=float(np.linalg.norm(across(at_start.data.oMi[candidate.index].rotation @ lever, candidate.axle))),
    )


def joints_above(
    at_start: RobotAtStart, joint: int, center: np.ndarray, axle: np.ndarray, radius: float
) -> tuple[tuple[Pivot, ...], tuple[str, ...]]:
    """Pivots and other carriers of a wheel, from a joint on: its center (3,), axle (3,) and radius [m]."""
    model, data = at_start.robot.model, at_start.data
    pivots: list[Pivot] = []
    carriers: list[str] = []
    steers = 0.5  # smallest vertical part of a unit swivel axis: forks are inclined, those of choppers by 50 degrees
    while joint > at_start.root and model.joints[joint].nv == 1:
        axis = turning_axis(model, data, joint)
        along = center - data.oMi[joint].translation
        parallel = axis.any() and np.abs(across(axis, axle)).max() < ALIGNED
        if parallel and np.abs(across(along, axis)).max() < placed(radius):
            pass  # a gear on the same axle rotates the wheel but does not move it
        elif abs(axis[2]) > steers:
            free = _travel(at_start, joint) >= (1 - 10 * SAME) * 2 * np.pi  # files write 3.14
            point = data.oMi[joint].translation.copy()
            pivots.append(Pivot(str(model.names[joint]), int(joint), point, axis * np.sign(axis[2]), free))
        else:
            carriers.append(str(model.names[joint]))
        joint = model.parents[joint]
    return tuple(pivots), tuple(carriers)


def _floor(at_start: RobotAtStart) -> float | None:
    """Height of the base's footprint frame [m], or None."""
    heights = [
        float(at_start.data.oMf[index].translation[2])
        for index, frame in enumerate(at_start.robot.model.frames)
        if frame.parentJoint <= at_start.root and has_word("footprint", frame.name)
    ]
    return min(heights, default=None)
