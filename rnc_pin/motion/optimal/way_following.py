"""Follow a way: speeds within an acceleration, stops where the velocity of the way jumps, and feedback beside it."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from typing import NamedTuple

import numpy as np

from rnc_pin.array_shapes import Array, Float
from rnc_pin.control.controller import DescribedMixin, MissedGoal, VelocityTarget, elapsed_time
from rnc_pin.control.twist_controller import STEERING_ACCELERATION
from rnc_pin.errors import ConfigurationError
from rnc_pin.model.evaluation_results import Measurement
from rnc_pin.model.input_validation import Positive, check_positive_settings
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.motion.optimal.plan_feedback import regulator_gains
from rnc_pin.motion.planning.action_models import ActionModel, Nodes
from rnc_pin.motion.planning.exact_steering import AimedSteering, CarSteering
from rnc_pin.motion.planning.way import Way

_SAME = 1e-9  # relative difference of velocities without a stop between them
_END = 1e-9  # [s] before a place of the way that counts as the place


class WayState(NamedTuple):
    """Place on a way, as a time of the way at its own speeds, and where the robot stops."""

    end: float
    """Place at which the robot stops [s]: the end of the way, or sooner after it has left the tube."""
    place: float = 0.0
    """Place [s]."""
    speed: float = 0.0
    """Rate of the place: the share of the velocity of the way."""
    rate: float = 0.0
    """Rate of the speed in the last step [1/s]."""
    t: float | None = None
    """Time of the last step [s]."""


@dataclass(eq=False, repr=False)
class WayFollower(DescribedMixin):
    """Follow a way of ``rnc.planning.find_way`` among obstacles that stand: a kinematic controller.

    The robot drives along the way within an acceleration, with feedback in proportion to its speed. It stops at the
    nodes where the velocity of the way jumps, and at the end. A robot that leaves the tube around the way brakes on it,
    and stays: another way from there is a new call of ``find_way``, and another follower. So the clearance of the way
    should cover the tube.

    In ``rnc.VelocityLoop``, it drives a robot of your own. Reads from the measurement ``q``. One state at a time.

    Args:
        reduced: the model.
        way: a way by exact steering.
        acceleration: largest rate of each entry of the velocity along the way [m/s^2 or rad/s^2]; at least 4 rad/s^2
            for joints that steer while the base stands.
        speed: share of the velocity of the way that is used.
        tube: distance of the robot from the way at which it stops [m or rad].
        tolerance: error at the end above which a run has missed its goal [m or rad].
        state_cost: weight of the distance from the way in the gains of the feedback.

    Raises:
        ConfigurationError: a number is out of range, or the way has propagated motions.

    Example:
        >>> robot = rnc.Robot.from_urdf("unicycle.urdf", base="planar")
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("axle")]).reduce()
        >>> goal = {rnc.FramePosition("axle", "xy"): [1.0, 0.0], rnc.FrameYaw("axle"): 0.0}
        >>> way = rnc.planning.find_way(reduced, robot.configuration(), goal)
        >>> controller = rnc.optimal.WayFollower(reduced, way, acceleration=1.0)
        >>> measured = reduced.at(way.q[0], np.zeros(3)).measure(np.zeros(3))
        >>> state = controller.initial_state(measured)
        >>> for k in range(3):
        ...     target, state = controller.step(0.1 * k, measured, state)
        >>> round(state.speed, 3), controller.missed_goals(0.3, way.q[-1], np.zeros(3))
        (0.2, ())
    """

    described = ("acceleration", "speed", "tube", "tolerance", "state_cost")

    reduced: ReducedModel
    way: Way
    _: KW_ONLY
    acceleration: Positive = 0.5
    speed: Positive = 0.8
    tube: Positive = 0.05
    tolerance: Positive = 0.02
    state_cost: Positive = 10.0

    def __post_init__(self) -> None:
        check_positive_settings(**{name: getattr(self, name) for name in self.described})
        if self.speed > 1.0:
            raise ConfigurationError(f"speed: expected a share of the velocity of the way up to 1, found {self.speed}")
        if self.way.info.steering == "propagated":
            raise ConfigurationError(
                "way: a follower stops between motions by exact steering, and this way has propagated motions; "
                "follow a plan along it: rnc.optimal.plan(..., guess=way)"
            )
        self._model = ActionModel(self.reduced, "kinematic")
        self._v = np.where(self.way.planned, self.way.v, 0.0)
        driving, steered = self._v[:, :3].any(axis=1), self.way.info.steering in (AimedSteering.kind, CarSteering.kind)
        steers = steered & driving.any() & ~self._v[driving].any(axis=0)  # joints that move while the base stands
        # Motors of steering are quicker than a base: a small acceleration of the base does not slow them.
        share = np.where(steers, min(1.0, self.acceleration / STEERING_ACCELERATION), 1.0)
        self._sizes = np.abs(share * self._v).max(axis=1)
        # A corner of the reduced velocities is a jump of v too, and v has the units that the acceleration is given in.
        jumps = np.abs(np.diff(self._v, axis=0)).max(axis=1) > _SAME * self._sizes[:-1]
        ends = np.where(np.append(jumps, True)[: len(self._v)], self.way.time[1:], np.inf)
        self._stops = np.minimum.accumulate(ends[::-1])[::-1]
        if len(self._v):  # the robot is there otherwise
            self._gains = self._gains_along()

    def missed_goals(self, t: float, q: Float[Array, " nq"], v2: Float[Array, " r"]) -> tuple[MissedGoal, ...]:
        """Joints that are away from the end of the way if a run ends in this state, for its verdict.

        Args:
            t: time [s].
            q: configuration (nq,).
            v2: reduced velocity (r,).
        """
        reason = f"it was more than the tube of {self.tube:g} off its way, and stopped; find a way from where it stands"
        away = np.abs(self._away(self.way.duration, q)).tolist()
        named = zip(self.reduced.robot.velocity_names, away, strict=True)
        return MissedGoal.of_errors(dict(named), self.tolerance, "the run ends on the way" if v2.any() else reason)

    def initial_state(self, measurement: Measurement) -> WayState:
        """Return a state that starts the way."""
        return WayState(self.way.duration)

    def step(self, t: float, measurement: Measurement, state: WayState) -> tuple[VelocityTarget, WayState]:
        q = np.asarray(measurement.q, dtype=float)
        state = self._moved(elapsed_time(t, state.t), state)._replace(t=t)
        still = np.zeros(self._model.nu)
        if not state.speed:
            return VelocityTarget(v2=still, v2_dot=still), state
        away = self._away(state.place, q)
        if np.abs(away).max() > self.tube and state.end == self.way.duration:
            # It brakes on the way, as far as the next stop: beside the way nothing was checked.
            k = self._segment(state.place)
            room = 0.5 * state.speed**2 * float(self._sizes[k]) / self.acceleration
            state = state._replace(end=min(state.place + room, float(self._stops[k])))
        along = self.way.reduced_velocity(state.place)
        places, gains = self._gains
        K = gains[int(places.searchsorted(state.place, "right")) - 1]
        # The gains are for the speeds of the way: scaled with the speed, the path is the same, and at rest nothing
        # moves.
        return VelocityTarget(v2=state.speed * (along + K @ away), v2_dot=state.rate * along), state

    def _away(self, place: float, q: Array) -> Float[Array, " nv"]:
        """Displacement of the planned joints from a place of the way."""
        step = self._model.manifold.difference(self.way.at(place)[None], q[None])[0]
        return np.where(self.way.planned, step, 0.0)

    def _segment(self, place: float) -> int:
        """Segment after a place."""
        return min(int(self.way.time.searchsorted(place + _END, "right")) - 1, len(self._v) - 1)

    def _moved(self, since: float, state: WayState) -> WayState:
        """State after a time [s]: the speed rises, stays, or falls so that the robot stops at the next stop."""
        place, speed = state.place, state.speed
        if place >= state.end:
            return state._replace(speed=0.0, rate=0.0)
        k = self._segment(place)
        last, most = min(float(self._stops[k]), state.end), self.acceleration / float(self._sizes[k])
        room = max(last - place - 0.5 * speed * since, 0.0)
        # The largest speed from which the robot, after this sample, still stops in the room with its acceleration: the
        # root of new^2 / (2 most) + new since / 2 = room.
        top = most * ((0.25 * since**2 + 2.0 * room / most) ** 0.5 - 0.5 * since)
        new = max(min(self.speed, speed + most * since, top), speed - most * since, 0.0)
        place += 0.5 * (speed + new) * since
        if place >= last - _END:
            return state._replace(place=last, speed=0.0, rate=0.0)
        return state._replace(place=place, speed=new, rate=(new - speed) / since if since else 0.0)

    def _gains_along(self) -> tuple[Float[Array, " m"], Float[Array, "m r nv"]]:
        """Places, and gains of a linear-quadratic regulator from each to the next, at the speeds of the way."""
        durations = np.diff(self.way.time)
        spacing = 0.05  # [m or rad]; largest displacement between two gains of the feedback
        counts = np.maximum(np.ceil(np.abs(self._v).max(axis=1) * durations / spacing), 1.0).astype(int)
        h, k = np.repeat(durations / counts, counts), np.repeat(np.arange(len(self._v)), counts)
        places = np.concatenate([[0.0], np.cumsum(h)[:-1]])
        q = self.way.at(places)
        u = np.matvec(self.reduced.at(q).J2, self.way.v[k])
        weights = np.where(self.way.planned, self.state_cost, 0.0), np.ones(self._model.nu)
        return places, regulator_gains(self._model, Nodes(q, np.empty((len(q), 0))), u, h, weights)
