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
