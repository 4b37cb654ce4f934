"""Kinematics of a base on wheels, found from its constraint rows: joints that steer it or follow it.

The velocity has three parts: the base, its pivots, and the followers. A row of ``A v = 0`` is a guide if no other joint
than the base moves in it: it limits the twist itself, such as the row against side slip of an axle. A joint is a pivot
if a guide depends on its angle, and if it turns while the base rests. All other joints follow: wheels, linkages,
hitches. A joint that carries wheels which are steered one by one, such as a cart under a load, rests: the wheels are
aimed as if it were fixed. Names do not matter.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from rnc_pin.array_shapes import Array, Float
from rnc_pin.constraints.ground_plane import GroundPlane
from rnc_pin.constraints.wheels_and_blades import RollingRows
from rnc_pin.errors import ConfigurationError
from rnc_pin.model.frame_rows import FrameVelocityRows
from rnc_pin.model.input_validation import check_positive_settings
from rnc_pin.model.kinematics import OWN_AXES, Kinematics, PositionKinematics, moving_entries
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.rows import GroundContact, RowStack
from rnc_pin.robots.joint_values import limited_positions
from rnc_pin.robots.robot import Robot
from rnc_pin.verdict import Finding, FindingKind, Severity

SIDE_SLIP = 0.01
"""Lateral speed [m/s] above which a wheel without a lateral row slides."""
_SAMPLES = 3
_ROUNDED = 1e-3  # slope of an axle, or trail of a wheel in lengths of the base, that rounding in a file may cause
_ZERO = 1e-9  # effect of a joint on a row of unit length that rounding of numbers may cause
_UPRIGHT = 0.9  # vertical part of the axis of a pivot
_RANK = 1e-5  # smallest relative singular value of the followers' columns
_UNDECIDED = 0.1  # [rad] about a quarter turn within which a pivot goes on in its last direction
_HALF_TURNS = np.pi * np.arange(-2, 3)[:, None]  # half turns between the solutions of one pivot
_SETTLED = 1e-12  # [rad]
_PLANAR, _LIFT = (0, 1, 5), (2, 3, 4)  # rows of a frame's velocity in the plane of its x and y axes, and out of it


class BaseMotion(NamedTuple):
    """Admissible motion at one configuration. In scaled twists the yaw rate is multiplied by the base's length."""

    position: PositionKinematics
    """Kinematics of the configuration."""
    free: Float[Array, "3 d"]
    """Orthonormal basis of the scaled twists that the rows without pivots allow."""
    guides: Float[Array, "g 3"]
    """Guides with pivots, per scaled twist; their linear parts have length one."""
    slopes: Float[Array, "g 3"]
    """Derivatives of the guides with respect to the angles of their pivots [1/rad]."""
    resting: Float[Array, "2 g h"]
    """Guides and slopes per scaled rate of the joints that rest."""
    turning: Float[Array, "nv k"]
    """Velocities while one pivot turns at unit rate and the base rests."""
    moving: Float[Array, "nv 3"]
    """Velocities per scaled twist while the pivots rest; admissible for the twists that the rows allow."""

    def allowed(self, twist: Float[Array, " 3"]) -> Float[Array, " 3"]:
        """Scaled twist that the rows without pivots allow, nearest to one whose entries may be free (NaN)."""
        given = np.isfinite(twist)
        if given.all():
            return np.asarray(self.free @ (self.free.T @ twist))
        return np.asarray(self.free @ np.linalg.lstsq(self.free[given], twist[given], rcond=None)[0])


class PivotTurns(NamedTuple):
    """Turns of the pivots [rad], and the angles (k,) that their limits cut [rad]."""

    turn: Float[Array, " k"]
    beyond: Float[Array, " k"]


class WheeledBase:
    """Base of a reduced model, for the planar twist (vx, vy, wz) of one of its frames.

    A steered wheel whose lateral row is switched off gets a guide here, so that its pivot is aimed too.

    Args:
        reduced: the model; only its kinematics is used.
        frame: frame of the base, whose own x and y axes are level.
        length: length that weights yaw rates beside speeds [m]; None for the largest lever of a wheel
            about the frame.

    Attributes:
        frame: name of the frame.
        base: indices in v of the base's velocities, (3,).
        steering: indices in v of all joints that steer.
        pivots: indices in v of the joints that are aimed, (k,).
        resting: indices in v of joints that rest, (h,).
        aims: for each pivot, the index of the guide that aims it, (k,).
        kept: for each pivot, True if its guide is a row of the model, and not one of a wheel without a lateral row.
        slides: True if the rows hold the base sideways at all angles of its pivots, so that it may move to any side.
        length: length of the base [m].
        places: indices in q (nv,) of joints with position limits.
        lower, upper: position limits (nv,) [rad or m], infinite without any.

    Raises:
        ModelError: unknown frame.
        ConfigurationError: the constraints are affine, or the frame does not move in the plane with three velocities of
            a base.
    """

    def __init__(self, reduced: ReducedModel, frame: str, length: float | None = None) -> None:
        robot = reduced.robot
        # Velocities are linear in the twist only if the constraints prescribe none.
        if reduced.affine:
            raise ConfigurationError("the twist of a base assumes A v = 0, and these constraints are affine (A v = mu)")
        self.reduced, self.frame, self.base = reduced, frame, _base_entries(robot, frame)
        self._twist = FrameVelocityRows(robot, frame, _PLANAR, OWN_AXES)
        self._kinematics = Kinematics(robot)
        generator = np.random.default_rng(0)
        samples = [self._kinematics.position(reduced.random_configuration(generator)) for _ in range(_SAMPLES)]
        self._check_plane(samples)
        ranged, self.places = limited_positions(robot, None), np.zeros(reduced.n, dtype=int)
        self.lower, self.upper = np.full((2, reduced.n), [[-np.inf], [np.inf]])
        self.places[ranged.v], self.lower[ranged.v], self.upper[ranged.v] = ranged.q, ranged.lower, ranged.upper
        self.lower[self.base], self.upper[self.base] = -np.inf, np.inf
        self._others = np.setdiff1d(np.arange(reduced.n), self.base)
        self.length = 1.0
        self._own = reduced.all_constraints.size
        places = [*reduced.all_constraints.places, *missing_lateral_rows(reduced).places]
        self._use(RowStack.of(places), samples)
        self.length = self._lever(np.ones(len(self._scales), dtype=bool))  # for tolerances
        self._find_pivots(samples)
        self.length = self._lever(self._belongs) if length is None else float(length)
        check_positive_settings(length=self.length)

    def at(self, q: Float[Array, " nq"]) -> BaseMotion:
        """Evaluate the rows at a configuration (nq,)."""
        state = self.reduced.at(q)
        position, hard = state.position, ~self._is_guide[state.kept]
        rows, to_base = state.A[hard] * self._scales[state.kept[hard]], self._to_base(position)
        guided = np.zeros((2, self._weights.size, self.reduced.n))
        if len(self.pivots):
            turned = position.with_velocity(self._turned)
            guided = np.array([self._guides.jacobian(position), self._guides.jacobian_dot(turned)]) * self._weights
        guides, slopes = guided[:, :, self.base] @ to_base
        U, values, Vt = np.linalg.svd(rows[:, self._followers])
        rank = int((values > _RANK * values[0]).sum()) if len(values) else 0
        # What the followers do for each motion of the base: the pseudoinverse leaves out combinations that only
        # rounding tells.
        solved = (Vt[:rank].T / values[:rank]) @ U[:, :rank].T
        by_base = rows[:, self.base] @ to_base
        # Rows that no follower can answer limit the base itself.
        _, limits, directions = np.linalg.svd(U[:, rank:].T @ by_base)
        moving, turning = np.zeros((self.reduced.n, 3)), np.zeros((self.reduced.n, len(self.pivots)))
        moving[self.base], moving[self._followers] = to_base, -solved @ by_base
        turning[self.pivots, np.arange(len(self.pivots))] = 1.0
        turning[self._followers] = -solved @ rows[:, self.pivots]
        free = directions[int((limits > _ROUNDED).sum()) :].T
        return BaseMotion(position, free, guides, slopes, guided[:, :, self.resting] / self.length, turning, moving)

    def rows(self, q: Float[Array, " nq"]) -> tuple[Float[Array, "m nv"], Float[Array, "3 3"]]:
        """Independent rows (m, nv) at a configuration (nq,), scaled, and the base's velocities (3, 3) per twist."""
        state = self.reduced.at(q)
        return state.A * self._scales[state.kept], self._to_base(state.position) * [1.0, 1.0, self.length]

    def turns(self, motion: BaseMotion, q: Array, aim: Array, rates: Array) -> PivotTurns:
        """Turns of the pivots to the angles of a scaled twist, the shorter of both where limits admit it.

        Args:
            motion: admissible motion at the configuration q (nq,).
            q: present configuration (nq,).
            aim: scaled twist (3,).
            rates: present rates (k,), which decide between turns of nearly the same size [rad/s].
        """
        if not len(self.pivots):
            return PivotTurns(np.zeros(0), np.zeros(0))
        across, along = motion.guides[self.aims] @ aim, motion.slopes[self.aims] @ aim
        size = np.hypot(across, along)
        # A wheel may roll backwards: of both angles, half a turn apart, the one within a quarter turn.
        shortest = np.arctan2(-across * np.where(along < 0.0, -1.0, 1.0), np.abs(along))
        found, at = shortest + _HALF_TURNS, q[self.places[self.pivots]]
        low, high = self.lower[self.pivots] - at, self.upper[self.pivots] - at
        undecided = np.abs(shortest) > np.pi / 2 - _UNDECIDED
        # Near a quarter turn both ways are as short: going on in the last direction avoids that noise turns it back.
        cost = np.abs(found) + 4.0 * _UNDECIDED * (undecided & (found * rates < 0.0))
        cost[(found < low - _SETTLED) | (found > high + _SETTLED)] = np.inf
        best, columns = np.argmin(cost, axis=0), np.arange(len(size))
        turn, beyond, outside = found[best, columns], np.zeros(len(size)), np.isinf(cost[best, columns])
        if outside.any():
            ends = np.stack([low[outside], high[outside]])
            # No angle is within the limits: the end at which the wheel slips sideways least.
            missed = np.abs(across[outside] * np.cos(ends) + along[outside] * np.sin(ends))
            end = ends[np.argmin(missed + _ZERO * size[outside] * np.abs(ends), axis=0), np.arange(outside.sum())]
            turn[outside], beyond[outside] = end, np.abs(found[:, outside] - end).min(axis=0)
        through = size <= _ZERO * np.linalg.norm(aim)  # the centre of rotation is on the axis of the pivot
        turn[through] = beyond[through] = 0.0
        return PivotTurns(turn, beyond)

    def independence(self, motion: BaseMotion, turn: Float[Array, " k"]) -> float:
        """Smallest singular value of the guides of the model after turns of the pivots; infinite for one guide."""
        aims, angles = self.aims[self.kept], turn[self.kept, None]
        if len(aims) < 2:
            return np.inf
        rows, slopes = np.concatenate([[motion.guides, motion.slopes], motion.resting], axis=2)[:, aims]
        return float(np.linalg.svd(rows * np.cos(angles) + slopes * np.sin(angles), compute_uv=False)[-1])

    # ------------------------------------------------------------------ structure

    def _check_plane(self, samples: Sequence[PositionKinematics]) -> None:
        lift = FrameVelocityRows(self.reduced.robot, self.frame, _LIFT, OWN_AXES)
        for position in samples:
            twist = self._twist.jacobian(position)[:, self.base]
            if np.abs(lift.jacobian(position)[:, self.base]).max() > _ROUNDED or np.linalg.cond(twist) > 1.0 / _ZERO:
                raise ConfigurationError(
                    f"frame '{self.frame}' has no planar twist: expected a frame with level x and y axes on a base "
                    "that moves in the plane"
                )

    def _to_base(self, position: PositionKinematics) -> Array:
        """Velocities of the base per scaled twist, (3, 3)."""
        return np.asarray(np.linalg.inv(self._twist.jacobian(position)[:, self.base]) / [1.0, 1.0, self.length])

    def _use(self, rows: RowStack, samples: Sequence[PositionKinematics]) -> None:
        """Use rows, scaled by the linear part of their twist; those without one by their whole length."""
        self._rows = rows
        found = [rows.jacobian(each) for each in samples]
        twists = [A[:, self.base] @ self._to_base(each) for A, each in zip(found, samples, strict=True)]
        whole = np.max(np.linalg.norm(found, axis=2), axis=0)
        # By its linear part a row is a speed of a contact, so that rows of all wheels compare.
        linear = np.max(np.linalg.norm(np.array(twists)[:, :, :2], axis=2), axis=0)
        typical = np.where(linear > _ROUNDED * whole, linear, whole)
        self._scales = np.divide(1.0, typical, out=np.zeros_like(typical), where=typical > _ZERO)[:, None]

    def _lever(self, chosen: Array) -> float:
        """Largest lever of chosen rows about the frame [m], with all joints at zero; 1 m if there is none."""
        position = self._kinematics.position(self.reduced.robot.configuration())
        twist = (self._rows.jacobian(position) * self._scales)[chosen][:, self.base] @ self._to_base(position)
        twist[:, 2] *= self.length
        lever = float(np.abs(twist[np.linalg.norm(twist[:, :2], axis=1) > 0.5, 2]).max(initial=0.0))
        return lever if lever > _ROUNDED else 1.0

    def _find_pivots(self, samples: Sequence[PositionKinematics]) -> None:
        found = np.array([self._rows.jacobian(each) * self._scales for each in samples])
        moves, unit = np.abs(found).max(axis=0) > _ROUNDED * self.length, np.eye(found.shape[2])
        still = np.abs(found[:, :, self.base]).max(axis=(0, 2)) <= _ZERO
        depends = np.zeros((found.shape[1], found.shape[2]), dtype=bool)
        for joint in self._others:
            rates = [self._rows.jacobian_dot(each.with_velocity(unit[joint])) * self._scales for each in samples]
            slopes = [rate[:, self.base] @ self._to_base(each) for rate, each in zip(rates, samples, strict=True)]
            depends[:, joint] = np.abs(slopes).max(axis=(0, 2)) > _ZERO
        self.resting = [int(each) for each in self._others if self._rests(each, moves, depends, found[:, still])]
        self._others = np.setdiff1d(self._others, self.resting)
        # A guide has entries of the base and of joints that rest, at every configuration.
        is_guide = ~moves[:, self._others].any(axis=1) & ~still
        rows = found[:, : self._own][:, ~is_guide[: self._own]]
        steers = [each for each in self._others if depends[is_guide, each].any() and self._turns(rows, each, [])]
        self.steering, steered = steers, np.flatnonzero(is_guide & depends[:, steers].any(axis=1))
        # The last joint is the nearest to the wheel.
        pivot_of = {int(row): max(each for each in steers if depends[row, each]) for row in steered}
        towed = np.setdiff1d(self._others, steers)
        self._belongs = np.logical_not(depends[:, towed].any(axis=1))  # not of trailers and casters
        driven = np.abs(self.reduced.actuation.matrix(samples[0])).max(axis=1, initial=0.0) > 0
        aim_of: dict[int, int] = {}
        # Rows of the model before those that are missing, and driven pivots first: these are aimed, the others follow.
        for row in sorted(pivot_of, key=lambda row: (row >= self._own, not driven[pivot_of[row]], row)):
            joint = pivot_of[row]
            if joint not in aim_of and self._turns(rows, joint, list(aim_of)):
                aim_of[joint] = row
        # A guide that aims no pivot follows from the others, unless the system keeps it.
        guides = sorted({*aim_of.values(), *(row for row in pivot_of if row in self.reduced.reduction_data.kept)})
        self.pivots = np.array(sorted(aim_of), dtype=int)
        self.aims = np.array([guides.index(aim_of[joint]) for joint in self.pivots], dtype=int)
        self.kept = np.isin([aim_of[joint] for joint in self.pivots], self.reduced.reduction_data.kept)
        self.slides = len(self.pivots) > 0 and self.kept.sum() >= min(2, len(self.pivots))
        self._followers = np.setdiff1d(self._others, self.pivots)
        self._turned = unit[self.pivots].sum(axis=0)
        self._guides, self._weights = self._rows.selected(tuple(guides)), self._scales[guides]
        self._is_guide = np.isin(np.arange(self._own), list(pivot_of))

    def _rests(self, joint: int, moves: Array, depends: Array, couplings: Array) -> bool:
        """True if only a joint, beside the base, moves several wheels to their sides that are steered one by one."""
        aside = moves[:, joint] & (moves[:, self._others].sum(axis=1) == 1)
        first, *others = [int(each) for each in np.flatnonzero(depends[aside].any(axis=0)) if each != joint] or [joint]
        return any(self._turns(couplings, each, [first]) for each in others)

    def _turns(self, rows: Array, joint: int, resting: Sequence[int]) -> bool:
        """True if a joint turns while the base and some joints rest."""
        free = [each for each in self._others if each != joint and each not in resting]
        for A in rows:
            # Other joints may follow it, as those of a linkage, and a tie rod leaves a rest of rounding.
            answer = A[:, free] @ np.linalg.lstsq(A[:, free], -A[:, joint], rcond=_RANK)[0]
            if np.abs(answer + A[:, joint]).max(initial=0.0) > _ROUNDED * self.length:
                return False
        return True


def _base_entries(robot: Robot, frame: str) -> Array:
    """Indices in v of the joints that carry a frame."""
    model, joint = robot.model, robot.model.frames[robot.frame_id(frame)].parentJoint
    entries = moving_entries(model, joint)
    if len(entries) != 3:
        carried = ", ".join(str(model.names[each]) for each in list(model.supports[joint])[1:]) or "no joint"
        raise ConfigurationError(
            f"frame '{frame}' is carried by {carried} with {len(entries)} velocities: expected a frame of a base with "
            "three velocities in the plane, such as base='planar'"
        )
    return np.array(entries)


def missing_lateral_rows(reduced: ReducedModel, *, steered: bool = False) -> RowStack:
    """Lateral rows of the wheels without rollers that have none.

    Args:
        reduced: the model.
        steered: True for those only that an upright pivot carries, with no joint between: wheels that have to be aimed.
    """
    lateral, robot = {"lateral": (0.0, 1.0, 0.0)}, reduced.robot
    found, position = [], Kinematics(robot).position(robot.configuration())
    for block, *_ in reduced.all_constraints.places:
        parts = {name.partition("(")[0] for name in block.names}
        if not isinstance(block, RollingRows) or "rolling" not in parts or "lateral" in parts:
            continue
        if not steered or _on_pivot(robot, position, block.frame):
            plane = block.ground if isinstance(block.ground, GroundPlane) else GroundPlane()
            found.append(RollingRows(block.wheel, block.radius, block.axle, lateral, "all", plane, robot))
    return RowStack(found)


def _on_pivot(robot: Robot, position: PositionKinematics, wheel: int) -> bool:
    """True if an upright joint on the base carries the joint of a wheel."""
    model = robot.model
    pivot = int(model.parents[model.frames[wheel].parentJoint])
    # With fewer velocities it is the base's own.
    single = model.nvs[pivot] == 1 and sum(model.nvs[each] for each in model.supports[pivot]) > 3
    return bool(single and abs(position.joint_jacobian(pivot)[5, model.idx_vs[pivot]]) > _UPRIGHT)


# ---------------------------------------------------------------------- heights of wheels


def wheel_height_findings(
    reduced: ReducedModel, q: Float[Array, " nq"], ground: float | None = None
) -> tuple[Finding, ...]:
    """Compare radii of wheels, balls and casters with the heights of their centres.

    Heights are compared where the model fixes them, as on a planar base: elsewhere, a contact row keeps the height. A
    planar base without a stated ground can be drawn at any height. Then the ground is z = 0 only if it can be: a centre
    far below or above it says nothing. Wheels on curved ground, and on ground that a frame
    carries, are not compared.

    Args:
        reduced: the model.
        q: configuration at the start.
        ground: height of level ground that the constraints do not state [m]; None if it is not known.

    Returns:
        Findings of the kind ``MODEL``. A difference that rounding explains is a note: 1 % of the radius, or half its
        last digit, up to 5 %.
    """
    robot, found = reduced.robot, []
    at = Kinematics(robot).position(np.asarray(q, dtype=float))
    for block, *_ in reduced.all_constraints.places:
        plane = block.ground or GroundPlane()
        for wheel in block.mechanisms():
            if not isinstance(wheel, GroundContact) or not isinstance(plane, GroundPlane):
                continue
            frame, lines = robot.frame_id(wheel.frame), block.lines_of_action(at)
            assert lines is not None  # every contact has a point
            if not wheel.radius or plane.frame is not None or _rises(at, frame, lines[0][0], plane.axes[2]):
                continue
            place = at.placement(frame)
            center, level = place.translation + place.rotation @ wheel.center, plane
            if plane.axes[2, 2] == 1.0 and not plane.point[2]:  # z = 0 may be a default
                nearest, farthest = 0.25, 4.0  # heights of a centre, in radii, at which z = 0 can be its ground
                if ground is None and not nearest <= center[2] / wheel.radius <= farthest:
                    continue  # a base may be described at any height
                level = GroundPlane(point=(0.0, 0.0, ground or 0.0))
            gap = level.height(lines[0][0])
            equal = 1e-4  # part of a radius below which the messages print two lengths with the same digits
            if abs(gap) > equal * wheel.radius:
                message = (
                    f"{wheel.frame}: radius {wheel.radius:g} m, but its centre is {level.height(center):.4g} m above "
                    f"the ground: the contact point is {abs(gap):.4g} m {'above' if gap > 0 else 'below'} the ground"
                )
                severity = _severity(wheel.radius, abs(gap))
                found.append(Finding(FindingKind.MODEL, wheel.frame, abs(gap), "m", None, severity, message))
    return tuple(found)


def _rises(at: PositionKinematics, frame: int, contact: Array, up: Array) -> bool:
    """True if a joint changes the height of a contact point: then a row may keep it."""
    lift, arm = at.jacobian(frame), contact - at.placement(frame).translation
    rounding = 1e-9  # entry of a row [m/rad] below which a joint does not change the height
    return bool(np.abs(up @ (lift[:3] - pin.skew(arm) @ lift[3:])).max() >= rounding)


def _severity(radius: float, difference: float) -> Severity:
    """A note if rounding explains a difference [m] from a radius [m]."""
    # A radius of 0.1 may be 0.0985 rounded to its last digit; one of 0.0985 may not.
    digits = f"{radius:.9f}".rstrip("0").partition(".")[2]
    rounded, coarse = 0.01, 0.05  # parts of a radius that rounding explains: always, and if its last digit is as coarse
    rounding = min(0.5 * 10.0 ** -len(digits), coarse * radius)
    return Severity.NOTE if difference <= max(rounding, rounded * radius) else Severity.DEGRADES
