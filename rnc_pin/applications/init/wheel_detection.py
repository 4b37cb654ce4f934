"""Detection of wheels: round shapes about a horizontal axle at the ground; names only help.

Axles and wheels that are only drawn, without a joint about their axle, are knife edges without side slip.
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from rnc_pin.applications.init.evidence import has_word, joint_limits
from rnc_pin.applications.init.robot_at_start import (
    ALIGNED,
    GEOMETRY,
    PLACED,
    SAME,
    RobotAtStart,
    Shape,
    across,
    fitted_disk,
    placed,
)
from rnc_pin.io import Json

UPRIGHT = 1e-5  # horizontal part of a unit axis below which a pivot is vertical up to rounding
LEVEL = 0.1  # largest vertical component of a unit axle vector
NEAR = 0.3  # largest height of a wheel's lowest point above the ground, in radii
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
        """Return the horizontal vector (3,) from the axis to a point (3,).

        Args:
            point: point in the world frame (3,) [m].
        """
        away = point - self.point
        return np.asarray(away - away[2] / self.axis[2] * self.axis)


@dataclass(frozen=True)
class Wheel:
    """Wheel with a joint.

    Attributes:
        joint: joint name; of a wheel that is only drawn, the joint that carries it.
        frame: frame fixed to the wheel, with its origin at the center.
        center: center in the world frame (3,) [m].
        axle: axle direction in the world frame (3,).
        radius: radius [m]; 0 before it is measured.
        bottom: height of the lowest point [m].
        width: width along the axle [m]; 0 if no shape tells it.
        measured: source of the radius: "collision" or "visual" geometry, "height" of the axle or "inertia".
        is_ball: True if the wheel is a sphere.
        pivots: nearly vertical joints between the wheel and the base, the nearest to the wheel first.
        carriers: other joints between the wheel and the base that move the wheel.
        rollers: joints of the rollers on the rim.
        edge: settings of the knife edge that stands for a wheel without a joint about its axle; else None.
        imbalance: distance of its center of mass from the axle [m].
        is_named: True if its joint or link has the name of a wheel, or if it is one of a pair without meshes.
        is_doubtful: True if its name means another part, or if it turns once: it is a wheel if its shape stands on the
            ground of others.
        wobbles: True if a gear on its axle, between it and the base, is not quite parallel, and so lifts it a little.
        turns_once: True if its limits permit one turn, as those of a wrist: no doubt is left of a pair on one axle.
    """

    joint: str
    frame: str
    center: np.ndarray
    axle: np.ndarray
    radius: float = 0.0
    bottom: float = 0.0
    width: float = 0.0
    measured: str = ""
    is_ball: bool = False
    pivots: tuple[Pivot, ...] = ()
    carriers: tuple[str, ...] = ()
    rollers: tuple[str, ...] = ()
    edge: Mapping[str, Json] | None = None
    imbalance: float = 0.0
    is_named: bool = False
    is_doubtful: bool = False
    turns_once: bool = False
    wobbles: bool = False

    @property
    def heading(self) -> np.ndarray:
        """Horizontal rolling direction in the world frame (3,)."""
        along = np.cross(self.axle, [0.0, 0.0, 1.0])
        return np.asarray(along / np.linalg.norm(along))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of joint, frame and nearest pivot."""
        return self.joint, self.frame, *(each.joint for each in self.pivots[:1])

    @property
    def is_shaped(self) -> bool:
        """True if its radius is that of a shape."""
        return self.measured in GEOMETRY

    @property
    def can_lean(self) -> bool:
        """True for one disk with a joint; rollers, rigid axles with a disk at each end, and knife edges stand."""
        return self.edge is None and self.width <= self.radius

    def touches(self, ground: float) -> bool:
        """Return whether it reaches down to a height [m]; a radius that was not measured may be half as large.

        Args:
            ground: height of the ground [m].
        """
        return self.bottom - ground < (NEAR if self.is_shaped else 1.0) * self.radius

    def is_in_line_with(self, other: Wheel) -> bool:
        """Return whether it is on the axle line of another wheel.

        Args:
            other: the other wheel.
        """
        beside = across(self.center - other.center, other.axle)
        # Before it is measured, a wheel has no radius: then 3 mm count, whatever its size.
        is_parallel = np.linalg.norm(np.cross(self.axle, other.axle)) < ALIGNED
        return bool(is_parallel and np.linalg.norm(beside) < placed(other.radius or np.inf))

    def is_like(self, other: Wheel) -> bool:
        """Return whether two disks on one body, which turn once, are equal and side by side on one axle line.

        Args:
            other: the other wheel.
        """
        chains = [(*each.carriers, *(pivot.joint for pivot in each.pivots)) for each in (self, other)]
        equal = abs(other.radius - self.radius) < ALIGNED * other.radius and chains[0] == chains[1]
        return self.turns_once and other.turns_once and equal and self.is_in_line_with(other)


class WheelSearch:
    """Wheels of a robot, and what is drawn as a wheel.

    Args:
        at_start: the robot.

    Attributes:
        guessed: joints that turn on and on about one axle in pairs, whose bodies lack all meshes: taken as wheels.
        virtual: joints at the height of axles that move no shape and nearly no mass beside a wheel: virtual wheels.
            Controllers of steered bases ask for such a wheel in the middle of each axle, and for a pivot above it.
        standing: wheels with a joint that touch the ground.
        raised: round bodies above the ground in the plane of several wheels: sprockets and idlers of a track.
    """

    def __init__(self, at_start: RobotAtStart) -> None:
        self._at_start, self._model, self._data = at_start, at_start.robot.model, at_start.data
        candidates = list(self._candidates())
        # A file without its package of meshes: two bodies that turn on and on about one axle are probably wheels.
        lost = set[int]().union(*at_start.without_mesh.values())
        unseen = [each for each in candidates if self._model.getJointId(each.joint) in lost and not self._parts(each)]
        unseen = [each for each in unseen if not (each.is_named or each.is_doubtful)]
        mates = (one for one, other in itertools.permutations(unseen, 2) if self._are_mates(one, other))
        self.guessed = list(dict.fromkeys(each.joint for each in mates))
        candidates = [replace(each, is_named=each.is_named or each.joint in self.guessed) for each in candidates]
        self.virtual = self._virtual_joints([each for each in candidates if self._parts(each)])
        found, named = self._measured([each for each in candidates if each.joint not in self.virtual])
        standing = self._on_the_ground(found)
        # Measured wheels first: they tell the ground for the others.
        ground = min((wheel.center[2] - wheel.radius for wheel in standing), default=0.0)
        for each in named if standing else ():  # their radius is their height above the common ground
            height = float(each.center[2] - ground)
            if _is_plausible(height) and height < 2 * max(wheel.radius for wheel in standing):
                standing.append(self._sized(each, height, "height"))
        # A round body that carries a wheel is a rocker or a hub that happens to reach down.
        carriers = {joint for wheel in standing for joint in wheel.carriers}
        self.standing = [wheel for wheel in standing if wheel.joint not in carriers]
        in_plane = 3  # smallest number of wheels on the ground in the plane of a sprocket: fewer carry no track
        at_ground = {wheel.joint for wheel in self.standing}
        above = [each for each in found if each.is_shaped and each.joint not in at_ground]
        self.raised = [each for each in above if sum(_are_in_plane(each, other) for other in self.standing) >= in_plane]

    @property
    def stands_below_body(self) -> bool:
        """True if wheels have shapes that reach below all other parts, as propellers and thrusters do not."""
        own = {self._model.getJointId(wheel.joint) for wheel in self.standing}
        lowest = min((each.bottom for each in self._at_start.all_shapes if each.joint not in own), default=np.inf)
        # One that is lower is enough: a boat has none, and legs reach as low as wheels.
        bottoms = [wheel.center[2] - (1 - ALIGNED) * wheel.radius for wheel in self.standing if wheel.is_shaped]
        return min(bottoms, default=np.inf) < lowest

    # ------------------------------------------------------------------ joints about an axle

    def _candidates(self) -> Iterator[Wheel]:
        """Yield continuous joints with a horizontal axis and no child joints except rollers, without a radius."""
        model = self._model
        turns = 4 * np.pi  # a joint with a larger range can be a wheel, like a continuous one; wrists have less [rad]
        for index in self._at_start.single_joints:
            joint, axle = str(model.names[index]), self._at_start.turning_axis(index)
            frame, center = self._on_axle(index, axle)
            # A name of the joint or of any link on it: exporters name the joint "joint_3" and the link "left_wheel".
            links = self._at_start.robot.links_of(index)
            named = any(has_word(_WHEEL, name) and not has_word(_NO_WHEEL, name) for name in (joint, *links))
            rollers = [int(each) for each in model.children[index]]
            if not self._are_rollers(rollers, center, axle):
                if not named:
                    continue
                rollers = []  # a named wheel can carry gears and hubs
            travel = float(np.ptp(joint_limits(self._at_start.robot, joint)))
            # Simulators want limits, so wheels have some; 0.1 % covers files that write 12.56.
            once = not named and travel <= (1 + SAME) * turns
            # A slide has no axle; an upright one is a pivot; what does not turn round once does not roll.
            if np.linalg.norm(axle) < 0.5 or abs(axle[2]) > LEVEL or (once and travel < _ROUND):
                continue
            lever = across(self._data.oMi[index].rotation @ model.inertias[index].lever, axle)
            doubtful = once or (not named and has_word(_NO_WHEEL, joint, frame))
            on_rim = tuple(str(model.names[each]) for each in rollers)
            found = Wheel(joint, frame, center, axle, rollers=on_rim, imbalance=float(np.linalg.norm(lever)))
            yield replace(found, is_named=named, is_doubtful=doubtful, turns_once=once)

    def _on_axle(self, joint: int, axle: np.ndarray) -> tuple[str, np.ndarray]:
        """Frame of a wheel and its position (3,): a link on the axle with a wheel's name, or the joint's body frame."""
        origin = self._data.oMi[joint].translation
        on_axle = 1e-4  # largest distance of a wheel's frame from its axle [m]: one that is farther away is eccentric
        for link, place in self._at_start.links_on(joint):
            if has_word(_WHEEL, link) and np.abs(across(place - origin, axle)).max() < on_axle:
                return link, place
        return self._at_start.body_frame(joint), origin.copy()

    def _are_rollers(self, joints: list[int], center: np.ndarray, axle: np.ndarray) -> bool:
        """True if child joints stand on a rim about the axle; side gears of a differential are on the axle itself."""
        if not joints:
            return True
        leaves = all(self._model.joints[each].nv == 1 and not len(self._model.children[each]) for each in joints)
        away = np.array([across(self._data.oMi[each].translation - center, axle) for each in joints])
        distances = np.linalg.norm(away, axis=1)
        rollers = 4  # smallest number of child joints on a rim that are rollers
        return len(joints) >= rollers and leaves and bool(distances.min() > 0.5 * distances.max())

    def _parts(self, wheel: Wheel) -> dict[str, list[Shape]]:
        """Shapes of a wheel and its rollers by their geometry, without geometry that has none."""
        behind = {self._model.getJointId(each) for each in (wheel.joint, *wheel.rollers)}
        parts = [(kind, each) for kind in GEOMETRY for each in self._at_start.shapes[kind] if each.joint in behind]
        return {kind: [each for other, each in parts if other == kind] for kind, _ in parts}

    def _virtual_joints(self, wheels: Sequence[Wheel]) -> list[str]:
        model = self._model
        shaped = {each.joint for each in self._at_start.all_shapes}
        # A lost mesh is a shape, too: such a joint moves something that this computer does not have.
        shaped = shaped.union(*self._at_start.without_mesh.values())
        masses = (float(model.inertias[model.getJointId(each.joint)].mass) for each in wheels)
        virtual = 0.01 * min(masses, default=0.0)  # largest mass of a virtual wheel, as a share of that of a wheel
        found = []
        for joint in self._at_start.single_joints:
            behind = [int(each) for each in model.subtrees[joint]]
            # At an axle's height: massless frames of cameras and tools stay as they are.
            level = any(abs(self._data.oMi[joint].translation[2] - each.center[2]) < PLACED for each in wheels)
            mass = sum(model.inertias[each].mass for each in behind)
            if level and not shaped & {*behind} and mass < virtual:
                found.append(str(model.names[joint]))
        return found

    # ------------------------------------------------------------------ radii

    def _measured(self, candidates: Sequence[Wheel]) -> tuple[list[Wheel], list[Wheel]]:
        """Wheels on the ground and above it with a radius, and those that are only named."""
        found: list[Wheel] = []
        named: list[Wheel] = []
        bare: list[Wheel] = []  # without shapes, a wheel's name and a round inertia
        rollers = {each for candidate in candidates for each in candidate.rollers}
        for candidate in (each for each in candidates if each.joint not in rollers):
            wheel = self._with_radius(candidate)
            if wheel is not None:
                # A doubtful wheel needs a shape: an inertia is round for motors and pulleys, too.
                found += [wheel] if wheel.is_shaped or not wheel.is_doubtful else []
            elif candidate.is_named:
                named.append(candidate)
            elif not self._parts(candidate):
                bare.append(candidate)
        for candidate in bare:  # of a pair, a file may draw one wheel only
            mate = next((each for each in found if self._are_mates(candidate, each)), None)
            if mate is not None:
                found.append(self._sized(candidate, mate.radius, "height"))
        # Two equal disks side by side are no wrists, although each turns only once.
        pairs = {one.joint for one, other in itertools.permutations(found, 2) if one.is_like(other)}
        return [replace(each, is_doubtful=False) if each.joint in pairs else each for each in found], named

    def _are_mates(self, candidate: Wheel, wheel: Wheel) -> bool:
        """True for a body of a wheel's mass on its axle line, on the same body: the other wheel of an axle."""
        one, other = (self._model.getJointId(each.joint) for each in (candidate, wheel))
        masses = [self._model.inertias[each].mass for each in (one, other)]
        same_mass = abs(masses[0] - masses[1]) < ALIGNED * masses[1]
        return candidate.is_in_line_with(wheel) and same_mass and self._model.parents[one] == self._model.parents[other]

    def _with_radius(self, candidate: Wheel) -> Wheel | None:
        """Return a candidate with its radius, or None if it is no wheel.

        Sources of the radius, in order: its shapes, its height above a floor in the file, its inertia, its height above
        the base's origin.
        """
        widest = 8.0  # largest width of a wheel, in radii
        every = self._parts(candidate)
        for kind, parts in every.items():  # collision geometry first: a wheel rolls on it in other simulators
            disk = fitted_disk(parts, candidate.center, candidate.axle)
            if disk is not None and disk.width < widest * disk.radius:
                is_ball = all(len(part.points) == 1 for part in parts)
                sized = self._sized(candidate, disk.radius, kind)
                return replace(sized, is_ball=is_ball, width=disk.width, bottom=disk.bottom)
        spun = self._radius_from_inertia(candidate)
        # Shapes that form no disk speak against a wheel, unless its name is one.
        if not candidate.is_named and (spun is None or every):
            return None
        height = float(candidate.center[2]) - (self._floor or 0.0)
        # A footprint frame lies on the ground by REP 105, so that this height is the radius. Without one, a factor
        # sqrt(2) separates a disk from a hoop of equal inertia: within it, the height is the better number.
        fits = spun is None or self._floor is not None or 0.7 < height / spun < 1.4
        if _is_plausible(height) and fits:
            return self._sized(candidate, height, "height")
        return None if spun is None else self._sized(candidate, spun, "inertia")

    def _sized(self, wheel: Wheel, radius: float, measured: str) -> Wheel:
        """Return a wheel with its radius [m], the height of its lowest point, and the joints that carry it."""
        carried = replace(wheel, radius=radius, bottom=float(wheel.center[2]) - radius, measured=measured)
        return self._carried(carried, self._model.parents[self._model.getJointId(wheel.joint)])

    def _radius_from_inertia(self, candidate: Wheel) -> float | None:
        """Radius [m] of the solid disk with this inertia, or None if the inertia is not axisymmetric."""
        joint = self._model.getJointId(candidate.joint)
        inertia = self._model.inertias[joint]
        if inertia.mass <= 0:
            return None
        axle, tensor = self._data.oMi[joint].rotation.T @ candidate.axle, inertia.inertia
        about = float(axle @ tensor @ axle)
        # Without the axle's own moment, an axisymmetric tensor has two equal eigenvalues beside a zero.
        moments = np.linalg.eigvalsh(tensor - about * np.outer(axle, axle))
        moments = np.delete(moments, int(np.argmin(np.abs(moments))))  # moments about axes normal to the axle
        radius = float(np.sqrt(max(2 * about / inertia.mass, 0.0)))  # of a solid disk: I = m r^2 / 2
        # 15 %: valves and spokes; the center of mass of a link that only hangs on the axle is far beside it.
        is_round = moments[0] > 0 and moments[1] < 1.15 * moments[0] and candidate.imbalance < 0.2 * radius
        return radius if is_round and _is_plausible(radius) else None

    @cached_property
    def _floor(self) -> float | None:
        """Height of the base's footprint frame [m], or None."""
        of_base = [k for k, frame in enumerate(self._model.frames) if frame.parentJoint <= self._at_start.root]
        footprints = [k for k in of_base if has_word("footprint", self._model.frames[k].name)]
        return min((float(self._data.oMf[k].translation[2]) for k in footprints), default=None)

    def _on_the_ground(self, found: Sequence[Wheel]) -> list[Wheel]:
        """Wheels that touch the common ground, which the wheels with names tell, else the lowest shapes."""
        shapes = self._at_start.shapes["collision"] or self._at_start.shapes["visual"]
        named = [each for each in found if each.is_named]
        sure = [each for each in named if each.is_shaped] or named
        if sure:
            unnamed = [each for each in found if each.is_shaped and not each.is_doubtful]  # a spare may have the name
            ground = min(each.bottom for each in (*sure, *unnamed))
            lowest = min((shape.bottom for shape in shapes), default=ground)
            level = sum(each.touches(ground) for each in sure)  # a fork or a skirt can be lower than two wheels
            # Where something reaches deeper by a diameter, the machine does not stand on these wheels.
            if level < 2 and lowest < ground - 2 * max(each.radius for each in sure):
                return []  # named wheels, but above the ground
        else:
            bottoms = [shape.bottom for shape in shapes if shape.joint <= self._at_start.root]
            ground = min([*bottoms, *(each.bottom for each in found if not each.is_doubtful)], default=0.0)
        standing = [each for each in found if each.touches(ground)]
        # Gears and pulleys at the ground count beside wheels only.
        return standing if any(not each.is_doubtful for each in standing) else []

    def _carried(self, wheel: Wheel, joint: int) -> Wheel:
        """Return a wheel with the pivots and other carriers between it and the base, from a joint on."""
        data, pivots, carriers, apart = self._data, list[Pivot](), list[str](), 0.0
        steers = 0.5  # smallest vertical part of a unit swivel axis: forks lean, those of choppers by 50 degrees
        while joint > self._at_start.root and self._model.joints[joint].nv == 1:  # from the wheel up to the base
            name, axis = str(self._model.names[joint]), self._at_start.turning_axis(joint)
            point = data.oMi[joint].translation.copy()
            parallel = axis.any() and np.abs(across(axis, wheel.axle)).max() < ALIGNED
            if parallel and np.abs(across(wheel.center - point, axis)).max() < placed(wheel.radius):
                # A gear on the same axle rotates the wheel but does not move it.
                apart = max(apart, float(np.abs(across(axis, wheel.axle)).max()))
            elif abs(axis[2]) > steers:
                free = float(np.ptp(joint_limits(self._at_start.robot, name))) >= _ROUND
                pivots.append(Pivot(name, int(joint), point, axis * np.sign(axis[2]), free))
            else:
                carriers.append(name)
            joint = self._model.parents[joint]
        return replace(wheel, pivots=tuple(pivots), carriers=tuple(carriers), wobbles=apart > UPRIGHT)

    # ------------------------------------------------------------------ disks without a joint about their axle

    @cached_property
    def _disks(self) -> list[Shape]:
        """Drawn disks with a horizontal axis at the ground."""
        disks = [each for each in self._at_start.drawn if each.is_disk and abs(each.axis[2]) < LEVEL]
        return [each for each in disks if each.bottom - self._at_start.ground < NEAR * each.radius]

    @cached_property
    def drawn_axles(self) -> list[Wheel]:
        """Pairs of coaxial horizontal disks at the ground on one body, each as one wheel that is only drawn."""
        axles: list[Wheel] = []
        for one, other in itertools.permutations(self._disks, 2):
            between = other.middle - one.middle
            apart, radius = np.linalg.norm(between), one.radius
            aligned = apart > radius and abs(between @ one.axis) > (1 - 0.5 * ALIGNED) * apart
            equal = one.joint == other.joint and abs(radius - other.radius) <= 0.1 * radius
            if one.name < other.name and aligned and equal:  # each pair once
                # Midway: there the knife edge of both stands.
                center = (one.middle + other.middle) / 2
                wheel = self._drawn(one.joint, radius, center, one.axis, max(PLACED, 0.2 * radius))
                if wheel is not None and all(wheel.frame != each.frame for each in axles):
                    axles.append(wheel)
        return axles

    def drawn_wheels(self, wheels: Collection[Wheel]) -> list[Wheel]:
        """Return disks on the ground that a pivot turns, and no joint about their axle: wheels that only steer.

        Args:
            wheels: wheels with a joint, or drawn axles, which tell where the ground is.
        """
        model = self._model
        ground = min((each.center[2] - each.radius for each in wheels), default=self._at_start.ground)
        # A hub that carries a rolling wheel has a disk at the ground, too.
        rolling = {int(each) for wheel in wheels for each in model.supports[model.getJointId(wheel.joint)]}
        others = [each for each in self._at_start.single_joints if each not in rolling]
        pivots = {each for each in others if abs(self._at_start.turning_axis(each)[2]) >= 1 - ALIGNED}
        found: dict[int, Wheel] = {}
        for shape in self._at_start.all_shapes:
            index = shape.joint
            if index in found or index not in pivots:
                continue
            center = (shape.points.min(axis=0) + shape.points.max(axis=0)) / 2
            # A mesh does not tell its axle: each axis of the joint's frame is tried.
            for axle in (shape.axis,) if shape.axis.any() else self._data.oMi[index].rotation.T:
                disk = fitted_disk([shape], center, axle) if abs(axle[2]) < LEVEL else None
                if disk and disk.width < 1.5 * disk.radius and abs(disk.bottom - ground) < NEAR * disk.radius:
                    wheel = self._drawn(index, disk.radius, center, axle, np.inf)
                    found |= {} if wheel is None else {index: wheel}
        return [*found.values()]

    @cached_property
    def crossed(self) -> list[str]:
        """Joints with a horizontal axis across that of the disk on the ground that they turn: mistakes of a file."""
        most = 0.1  # cosine of two axes that are across each other: 84 to 90 degrees
        crossed = []
        for disk in (each for each in self._disks if each.joint in self._at_start.single_joints):
            axis = self._at_start.turning_axis(disk.joint)
            if axis.any() and abs(axis[2]) < LEVEL and abs(axis @ disk.axis) < most:
                crossed.append(str(self._model.names[disk.joint]))
        return crossed

    def _drawn(self, joint: int, radius: float, center: np.ndarray, axle: np.ndarray, near: float) -> Wheel | None:
        """Wheel without a joint about its axle, or None if no frame of its body is along the axle and near it [m]."""
        found = []
        for link, place in self._at_start.links_on(joint):
            is_oblique = not isinstance(self._at_start.own_axis(axle, link), str)
            away = float(np.linalg.norm(across(place - center, axle)[:2]))
            found += [(is_oblique, away, link, place)] if away <= near else []
        if not found:
            return None
        # With an axis along the axle, if possible. Of frames at one place the last: a link that a file adds to a body
        # at the axle is named after the axle.
        _, _, frame, origin = min(reversed(found), key=lambda each: each[:2])
        wheel = Wheel(str(self._model.names[joint]), frame, center, axle, radius, measured="visual")
        ahead = float((center - origin) @ wheel.heading)
        # Only the part along the heading: beside and above, a knife edge has the same row.
        at = origin + ahead * wheel.heading if abs(ahead) > placed(radius) else origin
        return self._carried(replace(wheel, edge=self._at_start.knife_edge(axle, at, frame)), joint)


_ROUND = (1 - 10 * SAME) * 2 * np.pi  # range of a joint that turns round once [rad]: files write 3.14


def _is_plausible(radius: float) -> bool:
    """True for a radius that a wheel may have if no shape gives it [m]."""
    return 0.003 < radius < 1.5


def _are_in_plane(one: Wheel, other: Wheel) -> bool:
    """True if a wheel on the base and one that no pivot carries have parallel axles and the same place along them."""
    carried = (one.pivots, one.carriers, other.pivots)  # rollers of a track may hang on bogies
    is_parallel = np.linalg.norm(np.cross(one.axle, other.axle)) < ALIGNED
    return not any(carried) and bool(is_parallel and abs((one.center - other.center) @ other.axle) < other.radius / 2)
