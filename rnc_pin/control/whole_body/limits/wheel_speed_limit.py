"""Limit: speed of wheels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from rnc_pin.constraints.wheel_rows import RollingRows
from rnc_pin.control.whole_body.control_sample import ControlSample
from rnc_pin.control.whole_body.limits.control_limit import BoundLimit, ControlLimit, LimitRows
from rnc_pin.errors import ConfigurationError, nearest
from rnc_pin.model.parameter_types import Positive
from rnc_pin.model.reduced_model import ReducedModel


@dataclass(frozen=True)
class WheelSpeedLimit(ControlLimit):
    """Limit of the speed of rolling wheels: radius times rate about the axle, whichever joint turns it.

    Args:
        limit: largest speed of the rim about the axle [m/s]; the speed over the ground of a wheel without rollers.
        wheels: frames of the wheels, as in their ``RollingWheel`` constraints; by default all of them.
        priority: order in which soft limits give way; the largest number first.

    Example:
        >>> robot = rnc.Robot.from_urdf("differential_drive.urdf", base="planar")
        >>> wheels = [rnc.RollingWheel("left_wheel", 0.2), rnc.RollingWheel("right_wheel", 0.2)]
        >>> reduced = rnc.NonholonomicSystem(robot, wheels, ["left_wheel_joint", "right_wheel_joint"]).reduce()
        >>> limit = rnc.control.limits.WheelSpeedLimit(1.0)
        >>> bound = limit.bind(reduced)
        >>> sample = rnc.control.ControlSample(reduced, 0.0, robot.configuration(), np.zeros(reduced.r), dt=0.01)
        >>> rows = bound.rows(sample)
        >>> rows.jacobian[:, -2:].round(6), rows.upper  # radius times rate of each wheel, at most 1 m/s
        (array([[0.2, 0. ],
               [0. , 0.2]]), array([1., 1.]))
    """

    limit: Positive
    wheels: Sequence[str] | None = None
    priority: int = field(default=0, kw_only=True)

    def bind(self, reduced: ReducedModel) -> BoundLimit:
        return _BoundWheels(self, reduced)


class _BoundWheels(BoundLimit):
    def __init__(self, limit: WheelSpeedLimit, reduced: ReducedModel) -> None:
        if not 0 < limit.limit < np.inf:
            raise ConfigurationError(f"a wheel speed limit has to be positive, found {limit.limit}")
        blocks = [place.block for place in reduced.all_constraints.places]
        rolling = {block.wheel: block for block in blocks if isinstance(block, RollingRows)}
        for name in limit.wheels or ():
            if name not in rolling:
                raise ConfigurationError(f"no RollingWheel constraint on frame '{name}'{nearest(name, rolling)}")
        if not rolling:
            raise ConfigurationError("a wheel speed limit needs RollingWheel constraints; the system has none")
        self._wheels = [rolling[name] for name in (rolling if limit.wheels is None else limit.wheels)]
        self.names = tuple(f"{each.wheel} speed" for each in self._wheels)
        self._upper = np.full(len(self._wheels), float(limit.limit))

    def rows(self, sample: ControlSample) -> LimitRows:
        at = sample.end.position
        jacobian = np.array(
            [each.radius * (at.rotation(each.frame) @ each.axle) @ at.jacobian(each.frame)[3:] for each in self._wheels]
        )
        return LimitRows(jacobian, -self._upper, self._upper)
