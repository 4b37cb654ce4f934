"""Velocities of wheels and steering joints for a commanded twist of a base, of any kind that its constraint rows state.

A pivot that turns by d changes its guide ``c`` to ``c cos(d) + c' sin(d)``. So a twist w aims it at
``d = -arctan(c w / c' w)``, or half a turn further, where the wheel rolls backwards. While pivots are not there yet,
the base slows or waits.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import product
from typing import Literal, NamedTuple, TypeAlias

import numpy as np
import pinocchio as pin

from rnc_pin.array_shapes import Array, Float
from rnc_pin.constraints.wheeled_base import BaseMotion, WheeledBase
from rnc_pin.control.actuator_velocity import check_velocity_actuation, driven_joints, velocity_limits
from rnc_pin.errors import ConfigurationError, InfeasibleError, InputError
from rnc_pin.math.convex_programs import nearest_point
from rnc_pin.model.coordinates import wrapped
from rnc_pin.model.input_validation import admit_configuration, numbers_or_nan
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.printing import ReprMixin, printed

_STILL = 1e-9  # share of a twist that rounding causes
_MOVING = 0.1  # share of the command below which a base counts as standing
_SETTLED = 1e-12  # [rad] angle that no pivot has to turn any more
_REGULAR = 0.04  # smallest singular value of the model's guides, at angles for which a program aims
STEERING_ACCELERATION = 4.0
"""Acceleration of a pivot while its base stands [rad/s^2]."""


Twist: TypeAlias = Sequence[float | None] | Array
"""Twist (vx, vy, wz) [m/s, m/s, rad/s]; an entry that is None or NaN is free."""


class TwistCut(NamedTuple):
    """Reason why a base does not have the commanded twist."""

    kind: Literal["constraint", "angle", "steering", "speed", "range"]
    """"constraint": rows forbid a part of the twist, at any steering angle. "angle": a pivot is at its limit.
    "steering": a pivot is still turning. "speed": a joint is at its velocity limit. "range": a joint that follows the
    base is at its position limit."""
    name: str
    """Joint, or frame of the base."""
    amount: float
    """Speed that is cut [m/s], yaw rates times the base's length; remaining angle [rad]; or share of the twist left."""

    def __str__(self) -> str:
        amount, name = f"{self.amount:.3g}", self.name
        return {
            "constraint": f"the rows forbid {amount} m/s of the twist of {name}",
            "angle": f"{name} is at its limit, {amount} rad before the angle of the twist",
            "steering": f"{name} has {amount} rad to turn",
            "speed": f"{name} is at its velocity limit: the twist is scaled by {amount}",
            "range": f"{name} is at its position limit: the twist is scaled by {amount}",
        }[self.kind]


class TwistState(NamedTuple):
    """State of a twist controller between two samples."""

    aim: Float[Array, " 3"]
    """Last commanded twist that was not zero: the pivots keep its angles while the base waits."""
    twist: Float[Array, " 3"]
    """Twist of the last command."""
    rates: Float[Array, " k"]
    """Rates of the pivots [rad/s]."""


@printed(joints="rad/s or m/s", twist="m/s, m/s, rad/s", u="rad/s or m/s")
class TwistCommand(NamedTuple):
    """Velocities for one sample."""

    joints: Float[Array, " j"]
    """Velocities of the controller's ``joints`` [rad/s, m/s]."""
    twist: Float[Array, " 3"]
    """Twist (vx, vy, wz) of the frame that these velocities cause [m/s, m/s, rad/s]."""
    v: Float[Array, " nv"]
    """Velocity of the whole robot; passive wheels included."""
    u: Float[Array, " p"]
    """Velocities of the actuators, ``B^T v``."""
    cuts: tuple[TwistCut, ...]
    """Reasons why ``twist`` is not the commanded one; empty if it is."""


@printed(twist="m/s, m/s, rad/s")
class FeasibleTwist(NamedTuple):
    """Twist that a base reaches under a constant command, when its pivots have turned."""

    twist: Float[Array, " 3"]
    """Twist (vx, vy, wz) of the frame."""
    q: Float[Array, " nq"]
    """Configuration with the pivots at their angles."""
    v: Float[Array, " nv"]
    """Velocity of the whole robot there."""
    cuts: tuple[TwistCut, ...]
    """Reasons why it is not the commanded twist."""


class TwistController(ReprMixin):
    """Planar twist of a base to velocities of its joints, for any drafted base.

    The rows tell which joints steer (``WheeledBase``). Each takes the shorter way to one of its two angles within its
    limits. A base that drives changes its twist only as fast as all pivots follow together. One that stands is slowed
    until they are there. With a zero command it stands, and the pivots complete the last command.

    The twist is the nearest that the rows allow: the yaw rate counts times the base's length. Limits of velocity and
    position scale it as a whole, so its centre of rotation stays. A wheel whose trail is not zero does not count as
    steered: it follows the base at once, as a powered caster.

    Args:
        reduced: the model; only its kinematics is used.
        frame: frame of the base that has the twist, x forward and z up.
        dt: sampling period [s].
        limits: True for the velocity limits of the robot's file, False for none; or limits (nv,) of the velocity v.
            Position limits always come from the file.
        length: length that weights yaw rates beside speeds [m]; by default the largest lever of a wheel.
        slip: side slip that a pivot may have on its way, as a share of the speed. Beyond it the base waits.
        waits: angle between the motion that pivots on their way allow and the commanded one, beyond which the base
            stands [rad]. With a small one a base that turns on the spot does not creep, e.g. 0.01.
        max_acceleration: largest accelerations in x, y and yaw [m/s^2, m/s^2, rad/s^2]; by default there is no limit.

    Attributes:
        joints: names of the driven joints, in the order of ``TwistCommand.joints``.
        steering: names of the joints that steer.

    Raises:
        ModelError: unknown frame.
        ConfigurationError: an option is invalid, the actuators do not determine the motion, or the frame is not on a
            base in the plane.

    Example:
        >>> robot = rnc.Robot.from_urdf("differential_drive.urdf", base="planar")
        >>> wheels = [rnc.RollingWheel("left_wheel", 0.1), rnc.RollingWheel("right_wheel", 0.1)]
        >>> system = rnc.NonholonomicSystem(robot, wheels, ["left_wheel_joint", "right_wheel_joint"])
        >>> controller = rnc.control.TwistController(system.reduce(), "base")
        >>> command, state = controller.step(robot.configuration(), [0.5, 0.2, 0.0], controller.initial_state())
        >>> command.joints.round(6), command.twist.round(6) + 0.0
        (array([5., 5.]), array([0.5, 0. , 0. ]))
        >>> str(command.cuts[0])
        'the rows forbid 0.2 m/s of the twist of base'
    """

    def __init__(
        self,
        reduced: ReducedModel,
        frame: str,
        dt: float = 0.02,
        *,
        limits: bool | Float[Array, " nv"] = True,
        length: float | None = None,
        slip: float = 0.02,
        waits: float = np.pi / 4,
        max_acceleration: Sequence[float] | None = None,
    ) -> None:
        most = np.array((np.inf,) * 3 if max_acceleration is None else max_acceleration, dtype=float)
        if not (0 < dt < np.inf and 0 < slip < 1 and 0 < waits <= np.pi / 2 and most.shape == (3,) and most.min() > 0):
            raise ConfigurationError(
                f"a twist controller needs dt > 0, 0 < slip < 1, 0 < waits <= pi / 2 and three positive accelerations, "
                f"found {dt!r}, {slip!r}, {waits!r} and {max_acceleration!r}"
            )
        check_velocity_actuation(reduced)
        self.waits, self._acceleration = float(waits), most
        self.base, self.dt, self.slip = WheeledBase(reduced, frame, length), float(dt), float(slip)
        self.frame, self.joints = frame, driven_joints(reduced)
        self._reduced, self._names = reduced, reduced.robot.velocity_names
        self.steering = tuple(str(self._names[each]) for each in self.base.pivots)
        self._limits = velocity_limits(reduced, limits)
        self._entries = np.array([reduced.robot.velocity_indices(name).start for name in self.joints], dtype=int)
        self._scale = np.array([1.0, 1.0, self.base.length])

    def initial_state(self) -> TwistState:
        """Return the state of a base that stands and has no command."""
        return TwistState(np.zeros(3), np.zeros(3), np.zeros(len(self.base.pivots)))

    def step(self, q: Float[Array, " nq"], twist: Twist, state: TwistState) -> tuple[TwistCommand, TwistState]:
        """Return the velocities for the next sampling period, and the new state.

        Args:
            q: measured configuration (nq,); the place of the base does not matter.
            twist: commanded twist (vx, vy, wz) of the frame in its own axes [m/s, m/s, rad/s]. None leaves an entry
                free, such as vy of a frame that is not on the axle of a car.
            state: state of the last step; at first ``initial_state()``.

        Raises:
            InputError: q or the twist has another shape, or is not finite.
        """
        q, wanted = self._admitted(q, twist)
        motion, bounds = self.base.at(q), self._bounds(q, self.dt, self._limits)
        last = state.twist * self._scale
        goal, beyond = self._in_range(motion, q, self._accelerated(last, motion.allowed(wanted), self.dt), state.rates)
        aim = goal if goal.any() else motion.allowed(state.aim * self._scale)
        turn = aimed = self.base.turns(motion, q, aim, state.rates).turn
        share = _largest_share(motion.turning @ turn / self.dt, 0.0, bounds)
        if share < 1.0 and goal.any():
            goal, turn = self._followed(motion, q, goal, state, turn, bounds)
            share = _largest_share(motion.turning @ turn / self.dt, 0.0, bounds)
        rates = share * turn / self.dt
        if rates.any():  # velocities that fit the angles halfway
            before, middle = motion.turning, 0.5 * self.dt * (motion.turning @ rates)
            motion = self.base.at(pin.integrate(self._reduced.robot.model, q, middle))
            # At the angles halfway and at the end, passive joints may turn faster for the same rates of the pivots.
            for turning in (motion.turning, 2.0 * motion.turning - before):
                rates = rates * _largest_share(turning @ rates, 0.0, bounds)
        offset = motion.turning @ rates
        allowed = self._nearest(motion, goal, self.waits * (share > _STILL))
        along = motion.moving @ allowed
        scale = _largest_share(along, offset, bounds)
        v, reached = scale * along + offset, scale * allowed / self._scale
        # A zero command is not cut: the base rests because it has to.
        cuts: tuple[TwistCut, ...] = ()
        if np.nan_to_num(wanted).any():
            left = np.abs(aimed - self.dt * rates)
            stopped = left * (share < _STILL)  # another joint of the linkage is at its limit
            found = self._cuts(motion, wanted, left - stopped, np.maximum(beyond, stopped))
            cuts = (*found, *self._scaling(along, offset, bounds))
        u = self._reduced.actuation.matrix(motion.position).T @ v
        return TwistCommand(v[self._entries], reached, v, u, cuts), TwistState(aim / self._scale, reached, rates)

    def feasible(self, q: Float[Array, " nq"], twist: Twist) -> FeasibleTwist:
        """Return the twist that the base reaches under a constant command, when its pivots have turned.

        Args:
            q: configuration (nq,) from which the pivots turn.
            twist: commanded twist (vx, vy, wz) of the frame in its own axes [m/s, m/s, rad/s]. None leaves an entry
                free, such as vy of a frame that is not on the axle of a car.

        Raises:
            InputError: q or the twist has another shape, or is not finite.
            InfeasibleError: no angles of the pivots were found.
        """
        q, wanted = self._admitted(q, twist)
        resting, unlimited = np.zeros(len(self.base.pivots)), np.full(self._reduced.n, np.inf)
        iterations = 50  # a bound only: the search ends when no pivot turns
        for _ in range(iterations):
            motion = self.base.at(q)
            goal, beyond = self._in_range(motion, q, motion.allowed(wanted), resting)
            left = self.base.turns(motion, q, goal, resting).turn
            moved = motion.turning @ left
            share = _largest_share(moved, 0.0, self._bounds(q, 1.0, unlimited))
            if share * np.abs(left).max(initial=0.0) < _SETTLED:
                break
            q = np.asarray(pin.integrate(self._reduced.robot.model, q, share * moved))
            # Joints of a linkage move along: their loops close again after the finite step.
            if self._reduced.assembly.size:
                q = self._reduced.assembled(q, hold=self.steering)
        else:
            raise InfeasibleError(f"no angles of {', '.join(self.steering)} found for twist {twist} of '{self.frame}'")
        allowed, bounds = self._nearest(motion, goal, waits=0.0), self._bounds(q, self.dt, self._limits)
        along = motion.moving @ allowed
        scale, angles = _largest_share(along, 0.0, bounds), np.maximum(beyond, np.abs(left))
        cuts = (*self._cuts(motion, wanted, 0.0 * left, angles), *self._scaling(along, 0.0, bounds))
        return FeasibleTwist(scale * allowed / self._scale, q, scale * along, cuts)

    def aimed(
        self, q: Array, twist: Twist, v: Array, dt: float, limits: tuple[Array, Array] | None = None
    ) -> tuple[Array, Array]:
        """Return the twist and the rates of the pivots that a program has as goals, such as one of the whole body.

        The base waits until its pivots are aimed. Angles at which the model's own rows become dependent are left out:
        two guides whose axles are in line. There the twist differs by up to 4 %.

        Args:
            q: configuration (nq,).
            twist: commanded twist, as for ``step``.
            v: present velocity (nv,).
            dt: duration of the sample [s].
            limits: rows (k, nv) whose accelerations the program limits, and these limits (k,); None without.

        Raises:
            InputError: q or the twist has another shape, or is not finite.
        """
        q, wanted = self._admitted(q, twist)
        if not self.base.slides:
            wanted[1] = np.nan
        motion, pivots = self.base.at(q), self.base.pivots
        last, rates = np.linalg.solve(motion.moving[self.base.base], v[self.base.base]), v[pivots]
        goal, turn = self._regular(motion, q, self._in_range(motion, q, motion.allowed(wanted), rates)[0], rates)
        independence = self.base.independence(motion, 0.0 * turn)
        quiet = 1e-3  # [m/s] speed of a command that turns no pivot of a program: rest of an error
        near = 0.2  # [rad] within which a base of a program begins to drive
        largest, still = np.abs(turn).max(initial=0.0), max(quiet, _MOVING * float(np.linalg.norm(goal)))
        waits = largest > min(near, 0.25 * independence)
        turn = turn * (not waits or np.linalg.norm(last) <= still)  # it stops before its pivots turn far
        rows, most = limits or (np.zeros((1, self._reduced.n)), np.full(1, np.inf))
        used = np.abs(rows @ (motion.turning @ turn)) / max(largest, _SETTLED)
        steering = float(min(STEERING_ACCELERATION, *(most / np.maximum(used, _STILL))))
        profile = 30.0  # [1/s] rate of a pivot over its last turn
        speed = min(profile, np.sqrt(steering / max(largest, _SETTLED)))
        turning = speed * turn * (np.linalg.norm(goal) > quiet)
        lead = 0.05  # [s] by which goals are ahead: errors of velocities decay in such a time
        ahead = max(dt, lead)
        bounds, change = self._bounds(q, dt, self._limits), steering * ahead
        turning *= _largest_share(motion.turning @ turning, 0.0, bounds)
        goal = self._accelerated(last, self._nearest(motion, goal * (not waits), near), ahead)
        allowed = min(1.0, 2.0 * independence / _REGULAR) * self._nearest(motion, goal, waits=0.0)
        allowed *= _largest_share(motion.moving @ allowed, 0.0, bounds)
        # The pivots accelerate first, then the base by what they leave.
        room, more = (-dt * most, dt * most), np.clip(turning - rates, -change, change)
        more *= _largest_share(rows @ (motion.turning @ more), 0.0, room)
        share = _largest_share(rows @ (motion.moving @ (allowed - last)), rows @ (motion.turning @ more), room)
        return (last + share * (allowed - last)) / self._scale, rates + more

    # ------------------------------------------------------------------ one sample

    def _accelerated(self, last: Array, goal: Array, dt: float) -> Array:
        """Scaled twist after a time dt, on the way from the last to a goal within the limits of acceleration."""
        excess = np.max(np.abs(goal - last) / self._scale / (dt * self._acceleration))
        return np.asarray(last + (goal - last) / max(1.0, excess))

    def _regular(self, motion: BaseMotion, q: Array, goal: Array, rates: Array) -> tuple[Array, Array]:
        """Scaled twist near a goal for which the model's guides are independent, and the turns of the pivots."""
        turn = self.base.turns(motion, q, goal, rates).turn
        missing, size = 1.0 - self.base.independence(motion, turn) / _REGULAR, np.linalg.norm(goal)
        if missing <= 0.0 or not size:
            return goal, turn
        found = []
        # To both sides of the goal: the turns of the pivots decide.
        for across in np.linalg.svd((motion.free.T @ goal)[None])[2][1:]:
            for sign in (1.0, -1.0):
                twist = goal + sign * missing * _REGULAR * size * (motion.free @ across)
                turn = self.base.turns(motion, q, twist, rates).turn
                missed = max(0.75 * _REGULAR - self.base.independence(motion, turn), 0.0)
                found.append((missed, float(np.abs(turn).max()), twist, turn))
        _, _, twist, turn = min(found, key=lambda each: (each[0], each[1]))
        return twist, turn

    def _admitted(self, q: Array, twist: Twist) -> tuple[Array, Array]:
        """Return the configuration, and the scaled twist."""
        wanted = numbers_or_nan(twist)
        unknown = 3 - np.count_nonzero(np.isfinite(wanted))
        if wanted.shape != (3,) or (unknown and not sum(each is None for each in twist) == unknown < 3):
            raise InputError(f"a twist is (vx, vy, wz): three finite numbers, or None for a free one; found {twist!r}")
        return admit_configuration(q, self._reduced.robot), wanted * self._scale

    def _bounds(self, q: Array, dt: float, limits: Array) -> tuple[Array, Array]:
        """Smallest and largest velocities (nv,) within limits, and within position limits after dt."""
        at = q[self.base.places]
        low = np.maximum(-limits, np.minimum(self.base.lower - at, 0.0) / dt)
        return low, np.minimum(limits, np.maximum(self.base.upper - at, 0.0) / dt)

    def _in_range(self, motion: BaseMotion, q: Array, goal: Array, rates: Array) -> tuple[Array, Array]:
        """Return the nearest scaled twist for which all pivots are within their limits, and the angles beyond them.

        At an angle within its limits, a wheel rolls forwards or backwards. With one choice for each wheel, the guide
        at both limits has opposite signs: linear bounds of the twist. The nearest of all choices is the result, and
        among equal ones that with the smaller turns.
        """
        beyond = self.base.turns(motion, q, goal, rates).beyond
        if not beyond.any():
            return goal, beyond
        pivots, aims = self.base.pivots, self.base.aims
        at = q[self.base.places[pivots]]
        ends = np.stack([self.base.lower[pivots] - at, self.base.upper[pivots] - at])
        # A range of half a turn or more has every direction of rolling, forwards or backwards.
        narrow = ends[1] - ends[0] < np.pi
        ends = ends[:, narrow, None]
        across, along = (each[aims][narrow] @ motion.free for each in (motion.guides, motion.slopes))
        low, high = across * np.cos(ends) + along * np.sin(ends)
        part, bounds = motion.free.T @ goal, np.zeros(2 * len(low))
        found = []
        # Forwards or backwards of each wheel: the union of convex sets, each with one nearest point.
        for ways in _choices((low - high) @ part):
            rows = np.vstack([ways[:, None] * low, -ways[:, None] * high])
            nearest = nearest_point(part, rows, bounds, np.full(len(bounds), np.inf))
            if nearest is not None:
                twist = motion.free @ nearest.point
                turns = np.abs(self.base.turns(motion, q, twist, rates).turn).max()
                # Rounded: equally near twists are chosen by their turns and not by rounding.
                found.append((round(float(np.linalg.norm(nearest.point - part)), 9), float(turns), twist))
        twist = min(found, key=lambda each: each[:2])[2]
        return np.where(np.abs(twist) > _STILL * np.linalg.norm(goal), twist, 0.0), beyond

    def _followed(
        self, motion: BaseMotion, q: Array, wanted: Array, state: TwistState, turn: Array, bounds: tuple[Array, Array]
    ) -> tuple[Array, Array]:
        """Return the twist nearest to the wanted one, on the way from the last, that all pivots can follow; and turns.

        All pivots then have the same centre of rotation at each sample. Otherwise the base goes on with the wanted
        twist and its turns: if it stands, if its pivots do not fit the last twist, or if a pivot that followed would
        not come to the angle of its turn, but half a turn away.
        """
        last = state.twist * self._scale
        slowest = _MOVING * np.linalg.norm(wanted)
        if not np.linalg.norm(last) > slowest:
            return wanted, turn
        if last @ wanted < 0.0:  # wheels at the same angles, that roll back slowly
            last = -last * min(1.0, 2.0 * slowest / np.linalg.norm(last))
        start = self.base.turns(motion, q, last, state.rates).turn
        across, along = (each[self.base.aims] @ np.stack([last, wanted]).T for each in (motion.guides, motion.slopes))
        before, after = np.arctan2(-across, along).T
        seen = np.hypot(across, along).min(axis=1) > _STILL * np.linalg.norm(wanted)
        follows = np.abs(start + wrapped(after - before) - turn) < 0.5 * np.pi
        if not (self._can_turn(motion, start, bounds) and follows[seen].all()):
            return wanted, turn
        # Bisection: the share that all pivots can follow has no closed form.
        halves = 0.5 ** np.arange(1, 13)  # a share of the change to 2e-4
        share, found = 0.0, (wanted, turn)
        for more in halves:
            goal = last + (share + more) * (wanted - last)
            turns = self.base.turns(motion, q, goal, state.rates).turn
            if self._can_turn(motion, turns, bounds):
                share, found = share + more, (goal, turns)
        return found

    def _can_turn(self, motion: BaseMotion, turn: Array, bounds: tuple[Array, Array]) -> bool:
        """True if the pivots can turn within one sample."""
        return _largest_share(motion.turning @ turn / self.dt, 0.0, bounds) == 1.0

    def _nearest(self, motion: BaseMotion, wanted: Array, waits: float) -> Array:
        """Scaled twist nearest to a wanted one that the rows allow at the present angles, up to the side slip.

        It minimizes ``|w - wanted|^2 + |guides w / slip|^2``. So it is continuous where guides become dependent.
        A base that waits for its pivots is slowed by the angle between w and the wanted twist: beyond the angle
        ``waits`` it stands, because it would go elsewhere. 0 does not wait.
        """
        part = motion.free.T @ wanted
        if len(motion.guides) and part.size:
            _, values, axes = np.linalg.svd(motion.guides @ motion.free)
            weights = np.ones(part.size)
            # The minimum in the axes of the guides: each part of the twist fades with the side slip that it causes.
            weights[: len(values)] = 1.0 / (1.0 + (values / self.slip) ** 2)
            size, part = part @ part, axes.T @ (weights * (axes @ part))
            if waits and size > 0.0:
                angle = np.arccos(min(np.sqrt(part @ part / size), 1.0))
                part = part * np.cos(0.5 * np.pi * min(angle / waits, 1.0))
        return np.asarray(motion.free @ part)

    # ------------------------------------------------------------------ report

    def _cuts(self, motion: BaseMotion, wanted: Array, left: Array, beyond: Array) -> Iterator[TwistCut]:
        """Cuts by rows, by pivots that have angles left to turn, and by pivots whose angles are beyond their limits."""
        forbidden = float(np.linalg.norm(np.nan_to_num(wanted - motion.allowed(wanted))))
        if forbidden > _STILL * np.linalg.norm(np.nan_to_num(wanted)):
            yield TwistCut("constraint", self.frame, forbidden)
        for name, turn, cut in zip(self.steering, left.tolist(), beyond.tolist(), strict=True):
            if turn > _STILL:
                yield TwistCut("steering", name, turn)
            if cut > _STILL:
                yield TwistCut("angle", name, cut)

    def _scaling(self, along: Array, offset: Array | float, bounds: tuple[Array, Array]) -> Iterator[TwistCut]:
        """Cut by the limit of a joint that scales the twist, whose whole velocity is ``along``."""
        shares = _shares(along, offset, bounds)
        joint = int(np.argmin(shares))
        if (scale := float(shares[joint])) < 1.0:
            bound = bounds[1][joint] if along[joint] > 0.0 else -bounds[0][joint]
            yield TwistCut("range" if bound < self._limits[joint] else "speed", str(self._names[joint]), scale)


def _choices(favoured: Array) -> Iterable[Array]:
    """Signs of rolling of some wheels, (k,): all choices, or the favoured one for more wheels than vehicles have."""
    most = 6  # four wheels of a vehicle have 16 choices, six have 64
    if len(favoured) > most:
        return [np.where(favoured < 0.0, -1.0, 1.0)]
    return (np.array(signs) for signs in product((1.0, -1.0), repeat=len(favoured)))


def _largest_share(along: Array, offset: Array | float, bounds: tuple[Array, Array]) -> float:
    """Return the largest share s in [0, 1] with ``s along + offset`` within bounds."""
    return float(_shares(along, offset, bounds).min(initial=1.0))


def _shares(along: Array, offset: Array | float, bounds: tuple[Array, Array]) -> Array:
    """Return the largest share s in [0, 1] of each entry with ``s along + offset`` within bounds."""
    total = along + offset
    above, below = total > bounds[1] + _STILL, total < bounds[0] - _STILL
    room = np.where(above, bounds[1], bounds[0]) - offset
    shares = np.where(above | below, 0.0, 1.0)  # 0: the offset is beyond a bound
    np.divide(room, along, out=shares, where=(above | below) & (along != 0.0))
    return np.clip(shares, 0.0, 1.0)
