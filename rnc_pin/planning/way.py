"""Collision-free way of a reduced system from one configuration to another."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy import ndarray as Array
from numpy.typing import ArrayLike

from rnc_pin.array_shapes import Bool, Float
from rnc_pin.model.configuration_manifold import ConfigurationManifold
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.planning.exact_steering import ExactMotion
from rnc_pin.planning.kinematic_flow import KinematicFlow
from rnc_pin.planning.way_checking import NarrowPlace, WayChecker
from rnc_pin.planning.way_search import speed_limits
from rnc_pin.printing import Line, ObjectSummary, SummaryMixin, counted, items

_SEEN = 1.0  # [m]; the narrowest place is looked for within this distance


@dataclass(frozen=True, repr=False)
class WayInfo:
    """Record of the search for a way.

    Attributes:
        steering: kind of the exact steering; "propagated" if none is known.
        seconds: time of the search [s].
        edges: number of motions whose collisions were checked.
        goals: number of goal configurations.
        first_duration: duration of the first way, before it was shortened [s].
        history: number of checked motions and duration [s] of each way that was faster than those before, to this one.
    """

    steering: str
    seconds: float
    edges: int
    goals: int
    first_duration: float
    history: tuple[tuple[int, float], ...] = ()


@dataclass(frozen=True, repr=False)
class Way(SummaryMixin):
    """Collision-free motion along which the constraint rows hold.

    The reduced velocities ``J2(q) v`` are constant between nodes. By exact steering, joints move at constant rates too:
    a node is followed by a geodesic. The velocity jumps at nodes, so that a robot has to stop there, or to follow a
    smoother motion beside the way.

    Attributes:
        reduced: the model.
        time: times (N,) of the nodes [s]. Joints keep the velocity limits of the robot's file; planned joints without
            a limit keep 1 rad/s or 1 m/s.
        q: configurations (N, nq).
        v: velocities (N - 1, nv) after the nodes.
        length: length of the path of the base [m]; zero for a fixed base.
        residual: largest entry of ``A(q) v`` at the nodes, and halfway between them.
        info: record of the search.
        checker: distances that the way keeps; None without obstacles and shapes of links.
        geodesic: True if joints move at constant rates between nodes.
    """

    reduced: ReducedModel
    time: Float[Array, " n"]
    q: Float[Array, "n nq"]
    v: Float[Array, "k nv"]
    length: float
    residual: float
    info: WayInfo
    checker: WayChecker | None = field(default=None, repr=False)
    geodesic: bool = True

    @property
    def duration(self) -> float:
        """Duration [s]."""
        return float(self.time[-1])

    @cached_property
    def narrowest(self) -> NarrowPlace | None:
        """Narrowest place beside obstacles; None if none is nearer than 1 m. It is measured when it is asked for."""
        if self.checker is None or not len(self.v):
            return None
        return self.checker.narrowest(self.time, self.q, _SEEN)

    @cached_property
    def _manifold(self) -> ConfigurationManifold:
        return ConfigurationManifold(self.reduced.robot.model)

    def at(self, t: ArrayLike) -> Float[Array, "*k nq"]:
        """Configurations (..., nq) at times [s]; those of the ends before and after the way.

        Args:
            t: a time, or times (k,).
        """
        times = np.clip(np.atleast_1d(np.asarray(t, dtype=float)), 0.0, self.duration)
        if not len(self.v):
            found = np.repeat(self.q, len(times), axis=0)
        else:
            k = np.clip(np.searchsorted(self.time, times, "right") - 1, 0, len(self.v) - 1)
            v, since = self.v[k], (times - self.time[k])[:, None]
            if self.geodesic:
                found = self._manifold.integrate(self.q[k], since * v)
            else:
                u = np.einsum("nij,nj->ni", self.reduced.at(self.q[k]).J2, v)
                found = KinematicFlow(self.reduced).step(self.q[k], since * u)
        return found[0] if np.ndim(t) == 0 else found

    def reduced_velocity(self, t: float) -> Float[Array, " r"]:
        """Reduced velocities (r,) at a time [s]: ``v = R(q) v2``."""
        k = int(np.clip(np.searchsorted(self.time, t, "right") - 1, 0, len(self.v) - 1))
        return np.array(self.reduced.at(self.at(t)).J2 @ self.v[k])

    def _summary(self) -> ObjectSummary:
        lines: list[Line] = [
            ("length of the path of the base", items([f"{self.length:.3g} m"])),
            ("duration", items([f"{self.duration:.3g} s, {self.info.first_duration:.3g} s before it was shortened"])),
            ("nodes", items([f"{len(self.q)}"])),
            ("residual of constraint rows", items([f"{self.residual:.1g}"])),
        ]
        waits = float(np.diff(self.time)[~self.v.any(axis=1)].sum())
        if waits:
            lines.append(("waits for obstacles that move", items([f"{waits:.3g} s"])))
        if self.narrowest is not None:
            place = self.narrowest
            lines.append(("narrowest place", items([f"{place.distance:.3g} m at {place.time:.3g} s, {place.pair}"])))
        found = f"found in {self.info.seconds:.2g} s, {counted(self.info.edges, 'motion')} checked"
        how = "steering" if self.geodesic else "motions"
        return ObjectSummary(f"Way by {self.info.steering} {how}", [*lines, ("search", items([found]))])


def way_along(
    reduced: ReducedModel,
    planned: Bool[Array, " nv"],
    checker: WayChecker | None,
    motion: ExactMotion,
    info: WayInfo,
) -> Way:
    """Way along a motion of all joints, at the largest speeds.

    Args:
        reduced: the model.
        planned: mask (nv,) of the velocities that are planned.
        checker: distances to obstacles.
        motion: displacements of all joints.
        info: record of the search.
    """
    durations = (np.abs(motion.steps) / speed_limits(reduced, planned)).max(axis=1, initial=0.0)
    time = np.concatenate([[0.0], np.cumsum(durations)])
    v = motion.steps / durations[:, None]
    for array in (time, motion.q, v):
        array.setflags(write=False)
    geodesic = info.steering != "propagated"
    return Way(
        reduced=reduced,
        time=time,
        q=motion.q,
        v=v,
        length=_length(reduced, motion),
        residual=_residual(reduced, motion, v, geodesic),
        info=info,
        checker=checker,
        geodesic=geodesic,
    )


def _length(reduced: ReducedModel, motion: ExactMotion) -> float:
    """Length of the path of a base [m]."""
    base = reduced.robot.model.joints[1]
    size = {"JointModelPlanar": 2, "JointModelFreeFlyer": 3}.get(base.shortname(), 0)
    return float(np.linalg.norm(motion.steps[:, base.idx_v : base.idx_v + size], axis=1).sum())


def _residual(reduced: ReducedModel, motion: ExactMotion, v: Array, geodesic: bool) -> float:
    """Largest entry of ``A(q) v`` at the nodes; for geodesics also halfway and at their ends."""
    places = [motion.q[:-1]]
    if geodesic:
        places += [
            ConfigurationManifold(reduced.robot.model).integrate(motion.q[:-1], 0.5 * motion.steps),
            motion.q[1:],
        ]
    pairs = [(q, rate) for each in places for q, rate in zip(each, v, strict=True)]
    return max((float(np.abs(reduced.at(q).A @ rate).max(initial=0.0)) for q, rate in pairs), default=0.0)
