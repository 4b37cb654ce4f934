"""Contacts with the ground that open and close by themselves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rnc_pin.constraints import GroundPlane
from rnc_pin.errors import ConfigurationError
from rnc_pin.model.kernel_rows import KernelRow
from rnc_pin.model.kinematics import Kinematics, PositionKinematics, VelocityKinematics
from rnc_pin.model.parameter_types import NotNegative
from rnc_pin.model.rows import ConstraintKind, Rows
from rnc_pin.robots.robot import Robot

_SMALL = 1e-9  # entry of a height row that counts as zero
_SAMPLES = 3


@dataclass(frozen=True)
class UnilateralContact:
    """Contact that only pushes: it closes when the body lands, and opens when its normal force becomes zero.

    Its constraint acts while the contact is closed. The height row of the constraint gives the gap, its other rows
    prevent slip without a limit of friction. A ``Caster`` has the height row only, so it is a contact without friction,
    of a ball or of a point (radius 0).

    Args:
        constraint: ``RollingWheel``, ``RollingBall``, ``RollingBody`` or ``Caster`` on a plane.
        restitution: coefficient of the height row, from 0 (no rebound) to 1 (elastic): Newton's of a contact without
            friction; with friction the energetic one, whose square is the share of the work that the rebound returns.
        rest_speed: speed [m/s] of a rebound below which the contact stays closed. Contacts that touch close together if
            their gaps and slips are slower. So bouncing and rocking end after a finite time.

    Raises:
        ConfigurationError: a coefficient out of its range; when it is bound, a constraint without a gap.

    Example:
        >>> contact = rnc.UnilateralContact(rnc.RollingBall("ball", radius=0.2), restitution=0.7)
        >>> contact.rest_speed
        0.01
    """

    constraint: ConstraintKind
    restitution: float = 0.0
    rest_speed: NotNegative = 0.01

    def __post_init__(self) -> None:
        for name, value, most in (("restitution", self.restitution, 1.0), ("rest_speed", self.rest_speed, np.inf)):
            number = isinstance(value, int | float | np.number) and not isinstance(value, bool)
            if not (number and 0.0 <= value <= most and np.isfinite(value)):
                limit = "a number from 0 to 1" if most == 1.0 else "a number that is not negative"
                raise ConfigurationError(f"{name} of a contact: expected {limit}, found {value!r}")


class BoundContact:
    """Contact of a robot: its gap, and the rates of the gap.

    Args:
        contact: the contact.
        robot: the robot.

    Attributes:
        contact: the contact.
        friction: constraint of the rows that prevent slip, without the height row.
        name: frame of the constraint, or its height row.
        row: name of the height row.

    Raises:
        ConfigurationError: the constraint has no height row, its ground is not a plane, or no joint changes the gap.
    """

    def __init__(self, contact: UnilateralContact, robot: Robot) -> None:
        kind = contact.constraint
        ground = getattr(kind, "ground", None)
        if ground is not None and not isinstance(ground, GroundPlane):
            raise ConfigurationError(
                f"contact of {type(kind).__name__}: expected a plane as ground, found {type(ground).__name__}: "
                "contacts that open and close need a gap, which curved ground does not give"
            )
        self._rows = rows = kind.bind(robot)
        heights = [row for row, flag in enumerate(rows.holonomic) if flag and rows.on_ground]
        if len(heights) != 1:
            raise ConfigurationError(
                f"contact of {type(kind).__name__}: expected a RollingWheel, RollingBall, RollingBody or Caster with "
                f"one height row, found {len(heights)} height rows"
            )
        self.contact, self._height = contact, heights[0]
        self.friction = _Friction(rows, self._height)
        self.row = rows.names[self._height]
        self.name = str(getattr(kind, "frame", self.row))
        kinematics, generator = Kinematics(robot), np.random.default_rng(0)
        moments = (kinematics.position(robot.random_configuration(generator)) for _ in range(_SAMPLES))
        if max(float(np.abs(self.jacobian(at)).max()) for at in moments) < _SMALL:
            raise ConfigurationError(
                f"contact '{self.name}': no joint changes its height, so it cannot open: load the robot with a free "
                "base"
            )

    def jacobian(self, at: PositionKinematics) -> np.ndarray:
        """Jacobian of the gap, (nv,)."""
        return np.asarray(self._rows.jacobian(at)[self._height])

    @property
    def slips(self) -> bool:
        """True if the contact has rows that prevent slip."""
        return len(self.friction.names) > 0

    def slip(self, at: PositionKinematics) -> tuple[np.ndarray, np.ndarray, list[str]]:
        """Rows that prevent slip, (k, nv), with their velocities (k,) and names."""
        return self.friction.jacobian(at), self.friction.rate(at), list(self.friction.names)

    def rebound(self, rate: float) -> float:
        """Coefficient of restitution of an impact at a rate of the gap [m/s]; zero for slow ones."""
        fast = -self.contact.restitution * rate > self.contact.rest_speed
        return float(self.contact.restitution) if fast else 0.0

    def gap(self, at: PositionKinematics) -> float:
        """Distance from the ground [m], negative below it."""
        return float(self._rows.residual(at)[self._height])

    def gap_rate(self, at: PositionKinematics, v: np.ndarray) -> float:
        """Rate of the gap at velocity v (nv,) [m/s], negative if the contact closes."""
        return float(self.jacobian(at) @ v)

    def at_rest(self, at: PositionKinematics, v: np.ndarray) -> bool:
        """True if no row is faster than the rest speed, slip included."""
        slip = self._rows.jacobian(at) @ v - self._rows.rate(at)
        return bool(np.abs(slip).max() <= self.contact.rest_speed)

    def gap_acceleration(self, at: VelocityKinematics, v_dot: np.ndarray) -> float:
        """Second rate of the gap at acceleration v_dot (nv,) [m/s^2]."""
        return float(self.jacobian(at) @ v_dot + self._rows.bias_acceleration(at)[self._height])


class _Friction(Rows):
    """Rows of a contact besides its height row.

    Args:
        rows: all rows of the contact.
        height: index of the height row.
    """

    def __init__(self, rows: Rows, height: int) -> None:
        self._rows, self._kept = rows, [row for row in range(len(rows.names)) if row != height]
        self.names = tuple(rows.names[row] for row in self._kept)
        self.units = tuple(rows.units[row] for row in self._kept)
        self.affine, self.rheonomic, self.turning, self.ground = rows.affine, rows.rheonomic, rows.turning, rows.ground

    def bind(self, robot: Robot) -> Rows:
        return self

    def jacobian(self, at: PositionKinematics) -> np.ndarray:
        return self._rows.jacobian(at)[..., self._kept, :]

    def jacobian_dot(self, at: VelocityKinematics) -> np.ndarray:
        return self._rows.jacobian_dot(at)[..., self._kept, :]

    def bias_acceleration(self, at: VelocityKinematics) -> np.ndarray:
        return self._rows.bias_acceleration(at)[..., self._kept]

    def rate(self, at: PositionKinematics) -> np.ndarray:
        return self._rows.rate(at)[..., self._kept]

    def rate_dot(self, at: VelocityKinematics) -> np.ndarray:
        return self._rows.rate_dot(at)[..., self._kept]

    def rates_over_time(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        mu, mu_dot = self._rows.rates_over_time(t)
        return mu[self._kept], mu_dot[self._kept]

    def kernel_rows(self, model: pin.Model) -> list[KernelRow] | None:
        found = self._rows.kernel_rows(model)
        return None if found is None else [found[row] for row in self._kept]
