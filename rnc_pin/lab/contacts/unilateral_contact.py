"""Contacts with the ground that open and close by themselves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np
import pinocchio as pin
from annotated_types import Ge, Le

from rnc_pin.constraints import GroundPlane
from rnc_pin.errors import ConfigurationError
from rnc_pin.model.input_validation import NotNegative, check_settings
from rnc_pin.model.kinematics import Kinematics, PositionKinematics, VelocityKinematics
from rnc_pin.model.rows import ConstraintKind
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.model.system import NonholonomicSystem
from rnc_pin.plants.friction import DryFriction
from rnc_pin.robots.robot import Robot


@dataclass(frozen=True)
class UnilateralContact:
    """Contact that only pushes: it closes when the body lands, and opens when its normal force becomes zero.

    Its constraint acts while the contact is closed. The height row of the constraint gives the gap, its other rows
    prevent slip: by Coulomb friction, or without a limit if ``friction`` is None. A ``Caster`` has the height row only,
    so it is a contact without friction, of a ball or of a point (radius 0).

    Args:
        constraint: ``RollingWheel``, ``RollingBall``, ``RollingBody`` or ``Caster`` on a plane.
        restitution: coefficient of the height row, from 0 (no rebound) to 1 (elastic): Newton's of a contact without
            friction; with friction the energetic one, whose square is the share of the work that the rebound returns.
        rest_speed: speed [m/s] of a rebound below which the contact stays closed. Contacts that touch close together if
            their gaps are slower, and without a limit of friction also their slips. So bouncing and rocking end after
            a finite time.
        friction: coefficient of Coulomb friction; None for no limit.

    Raises:
        ConfigurationError: a coefficient out of its range; when it is bound, a constraint without a gap, or friction of
            a contact without rows that prevent slip.

    Example:
        >>> contact = rnc.UnilateralContact(rnc.RollingBall("ball", radius=0.2), restitution=0.7, friction=0.4)
        >>> contact.rest_speed
        0.01
    """

    constraint: ConstraintKind
    restitution: Annotated[float, Ge(0), Le(1)] = 0.0
    rest_speed: NotNegative = 0.01
    friction: NotNegative | None = None

    def __post_init__(self) -> None:
        check_settings(self)


class BoundContact:
    """Contact of a robot: its gap, and the rates of the gap.

    Args:
        contact: the contact.
        robot: the robot.

    Attributes:
        contact: the contact.
        name: frame of the constraint, or its height row.
        names: names of the rows along which it acts: the height row, and rows that prevent slip.
        friction: number of the rows that prevent slip, and the coefficient, infinite without a limit.
        has_limit: True if a coefficient limits friction.
        needs_coefficient: True if it prevents slip without a limit.

    Raises:
        ConfigurationError: the constraint has no height row, its ground is not a plane, no joint changes the gap, or
            friction has no rows.
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
        slips = [row for row in range(len(rows.names)) if row != heights[0]]
        self.name = str(getattr(kind, "frame", rows.names[heights[0]]))
        if contact.friction and not slips:
            raise ConfigurationError(
                f"contact '{self.name}': a {type(kind).__name__} has no rows along the ground for friction; a "
                "RollingBall has them, also a small one for a corner or a foot"
            )
        self.has_limit = contact.friction is not None
        self.needs_coefficient = bool(slips) and contact.friction is None
        # Rows without friction would only make the problem larger.
        slips = [] if contact.friction == 0.0 else slips
        self._order = [self._height, *slips]
        self.names = tuple(rows.names[row] for row in self._order)
        self.friction = len(slips), np.inf if contact.friction is None else float(contact.friction)
        kinematics, generator = Kinematics(robot), np.random.default_rng(0)
        samples = 3  # random configurations: a joint that changes the gap does so at almost all
        moments = (kinematics.position(robot.random_configuration(generator)) for _ in range(samples))
        zero = 1e-9  # entry of a height row that counts as zero
        if max(float(np.abs(self.jacobian(at)).max()) for at in moments) < zero:
            raise ConfigurationError(
                f"contact '{self.name}': no joint changes its height, so it cannot open: load the robot with a free "
                "base"
            )

    def rows(self, at: PositionKinematics) -> tuple[np.ndarray, np.ndarray]:
        """Rows ``names`` (k, nv) with their velocities (k,): the gap first.

        Args:
            at: kinematics at the configuration.
        """
        rates = self._rows.rate(at)[self._order] if self._rows.affine else np.zeros(len(self.names))
        return self._rows.jacobian(at)[self._order], rates

    def jacobian(self, at: PositionKinematics) -> np.ndarray:
        """Jacobian of the gap, (nv,).

        Args:
            at: kinematics at the configuration.
        """
        return np.asarray(self._rows.jacobian(at)[self._height])

    def gap(self, at: PositionKinematics) -> float:
        """Distance from the ground [m], negative below it.

        Args:
            at: kinematics at the configuration.
        """
        return float(self._rows.residual(at)[self._height])

    def gap_rate(self, at: PositionKinematics, v: np.ndarray) -> float:
        """Rate of the gap at velocity v (nv,) [m/s], negative if the contact closes.

        Args:
            at: kinematics at the configuration.
            v: velocity (nv,).
        """
        return float(self.jacobian(at) @ v)

    def gap_acceleration(self, at: VelocityKinematics, v_dot: np.ndarray) -> float:
        """Second rate of the gap at acceleration v_dot (nv,) [m/s^2].

        Args:
            at: kinematics at the state.
            v_dot: acceleration (nv,).
        """
        return float(self.jacobian(at) @ v_dot + self._rows.bias_acceleration(at)[self._height])


class FrictionGroup(NamedTuple):
    """Rows of one friction force: its norm is at most ``coefficient`` times the normal impulse, plus ``constant``.

    Attributes:
        rows: the rows, which are neighbours.
        normal: row of the normal impulse; -1 without one, as of dry friction in a joint.
        coefficient: coefficient of friction; infinite for no slip while the contact is
            closed.
        constant: impulse [N s or N m s].
        key: number of the contact, or -1 and less for the joints.
    """

    rows: slice
    normal: int
    coefficient: float
    constant: float = 0.0
    key: int = 0

    def limit(self, p: np.ndarray) -> float:
        """Largest norm of the impulse beside impulses p (k,).

        Args:
            p: impulses of all rows (k,).
        """
        return self.constant + (self.coefficient * max(float(p[self.normal]), 0.0) if self.normal >= 0 else 0.0)


class RowLayout(NamedTuple):
    """Order of the rows while some contacts touch: of each its normal row, then its friction, then joint friction.

    Attributes:
        contacts: the contacts.
        size: number of rows (k).
        normals: rows of the normal impulses.
        groups: friction; limits of joint friction are forces.
        names: names of the rows of contacts.
    """

    contacts: list[BoundContact]
    size: int
    normals: list[int]
    groups: list[FrictionGroup]
    names: list[str]


class ContactRows:
    """Rows (k, nv) of the contacts that touch and of dry joint friction.

    Args:
        contacts: the contacts.
        dry: dry joint friction.
    """

    def __init__(self, contacts: Sequence[BoundContact], dry: DryFriction) -> None:
        self._contacts, self._dry = contacts, dry
        self._layouts: dict[tuple[frozenset[int], bool], RowLayout] = {}

    def layout(self, touching: frozenset[int], joints: bool = True) -> RowLayout:
        """Order of the rows.

        Args:
            touching: numbers of the contacts that touch.
            joints: False without the rows of joint friction, as in an impact.
        """
        if (touching, joints) not in self._layouts:
            self._layouts[touching, joints] = self._layout(touching, joints)
        return self._layouts[touching, joints]

    def _layout(self, touching: frozenset[int], joints: bool) -> RowLayout:
        found, k = RowLayout([], 0, [], [], []), 0
        for number in sorted(touching):
            each = self._contacts[number]
            found.contacts.append(each)
            found.normals.append(k)
            found.names.extend(each.names)
            size, coefficient = each.friction
            if size:
                found.groups.append(FrictionGroup(slice(k + 1, k + 1 + size), k, coefficient, key=number))
            k += 1 + size
        for joint, limit in enumerate(self._dry.limits if joints else ()):
            found.groups.append(FrictionGroup(slice(k, k + 1), -1, 0.0, float(limit), -1 - joint))
            k += 1
        return found._replace(size=k)

    def at(self, state: StateEvaluation, layout: RowLayout) -> tuple[np.ndarray, np.ndarray]:
        """Rows (k, nv) in an order, and velocities of the ground along them (k,).

        Args:
            state: state of the system.
            layout: order of the rows.
        """
        matrix, ground, end = np.empty((layout.size, len(state.v))), np.zeros(layout.size), 0
        for each in layout.contacts:
            start, end = end, end + len(each.names)
            matrix[start:end], ground[start:end] = each.rows(state.position)
        if end < layout.size:
            matrix[end:] = self._dry.rows
        return matrix, ground


def bound_contacts(system: NonholonomicSystem, contacts: Sequence[UnilateralContact]) -> list[BoundContact]:
    """Return the contacts of a plant, bound to the robot of its system.

    Args:
        system: system without the contacts.
        contacts: the contacts.

    Raises:
        ConfigurationError: no contacts, contacts of the same name, a contact without a gap, or friction with
            a limit at some contacts only.
    """
    if not contacts or not all(isinstance(each, UnilateralContact) for each in contacts):
        raise ConfigurationError(f"contacts: expected a list of UnilateralContact, found {contacts!r}")
    bound = [BoundContact(each, system.robot) for each in contacts]
    names = [each.name for each in bound]
    for name in names:
        if names.count(name) > 1:
            raise ConfigurationError(f"contacts: '{name}' occurs twice")
    for each in bound:
        # Rows with and without a limit would need two methods at one impact.
        if each.needs_coefficient and any(other.has_limit for other in bound):
            raise ConfigurationError(
                f"contact '{each.name}': requires its coefficient of friction, because the friction of some contact "
                "has a limit"
            )
    return bound


def radius_of_gyration(model: pin.Model, q: np.ndarray) -> float:
    """Radius of gyration of a robot about its centre of mass, the mean of three axes [m].

    Args:
        model: Pinocchio model.
        q: configuration (nq,).
    """
    data = model.createData()
    pin.ccrba(model, data, q, np.zeros(model.nv))
    total = data.Ig
    # The trace of the inertia is twice the sum of m r^2.
    return float(np.sqrt(np.trace(total.inertia) / (2.0 * total.mass)))
