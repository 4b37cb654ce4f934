"""Protocol of plants: the methods that a control loop needs, and the report of what else a plant knows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import NamedTuple, Never, Protocol, runtime_checkable

import numpy as np

from rnc_pin.array_shapes import Array, Float
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.plants.step_control import IntegrationErrors

_NONE: Mapping[str, Never] = MappingProxyType({})


@dataclass(frozen=True)
class ContactEvent:
    """Contacts that opened or closed, or began to slip or to grip.

    Attributes:
        time: time [s].
        cause: description, such as "landing of ball"; "start" for the first one.
        closed: names of the closed contacts from then on.
        impulses: impulse of each row that took part in an impact [N s or N m s]; empty without an impact.
        energy_loss: kinetic energy that the impact removed [J].
    """

    time: float
    cause: str
    closed: tuple[str, ...]
    impulses: Mapping[str, float] = field(default_factory=dict)
    energy_loss: float = 0.0


class PlantReport(NamedTuple):
    """Quantities of a plant after its last ``apply`` or ``advance``, for the record of a run; each is optional.

    Attributes:
        actual: true configuration and velocity, if ``read`` returns sensor values.
        applied: applied inputs (p,), if the plant limits them.
        effort: present efforts (p,) of velocity servos [N or N m].
        work: work since the start [J].
        reduced: reduced model of the plant.
        external: generalized forces (nv,) in addition to the inputs.
        friction_used: tangential force over friction limit, by contact.
        slip_speed: largest speed since the last sample at which these contacts slid [m/s].
        normal_forces, contact_forces: forces by name that ``reduced`` does not have [N; N or N m].
        contact_force_units: units of ``contact_forces``, by name.
        contact_events: contacts that opened and closed since the start.
        errors: estimated errors of the integration since the start.
        tolerance: allowed error per second.
    """

    actual: tuple[Float[Array, " nq"], Float[Array, " nv"]] | None = None
    applied: Float[Array, " p"] | None = None
    effort: Float[Array, " p"] | None = None
    work: float = np.nan
    reduced: ReducedModel | None = None
    external: Float[Array, " nv"] | None = None
    friction_used: Mapping[str, float] = _NONE
    slip_speed: Mapping[str, float] = _NONE
    normal_forces: Mapping[str, float] = _NONE
    contact_forces: Mapping[str, float] = _NONE
    contact_force_units: Mapping[str, str] = _NONE
    contact_events: tuple[ContactEvent, ...] = ()
    errors: IntegrationErrors | None = None
    tolerance: float = np.nan


@runtime_checkable
class Plant(Protocol):
    """Controlled system: the integrated reduced model, another simulator, or hardware.

    Configurations and velocities are those of the loaded robot, in Pinocchio's order and conventions. Velocities are
    those of the plant and need not satisfy the constraints. Any object with these four methods is a plant.

    A plant clips inputs to what its actuators give. In ``simulate`` nobody does it before, so that controllers learn
    what is missing; a ``ControlLoop`` for a real robot clips to the limits of its file.
    A plant that knows more has a fifth method, ``report()``: it returns a ``PlantReport`` at any time after ``reset``,
    without an error. A plant with velocity servos has ``takes_velocities = True``: its inputs are velocities
    ``u = B^T v`` of the actuators, and it reports their ``effort``.

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")]).reduce()
        >>> isinstance(rnc.ReducedPlant(reduced), rnc.plants.Plant)
        True
    """

    def reset(self, q: Float[Array, " nq"], v: Float[Array, " nv"]) -> None:
        """Restart at time zero with zero inputs.

        Args:
            q: configuration, in Pinocchio's order.
            v: velocity, in Pinocchio's order.
        """

    def read(self) -> tuple[Float[Array, " nq"], Float[Array, " nv"]]:
        """Return copies of the current configuration and velocity."""

    def apply(self, T: Float[Array, " p"]) -> None:
        """Apply actuator inputs until the next call.

        Args:
            T: actuator inputs, in the order of the actuators [N or N m].
        """

    def advance(self, dt: float) -> None:
        """Advance the time by dt [s].

        Args:
            dt: the time [s].
        """


@runtime_checkable
class VelocityTaking(Protocol):
    """Plant whose inputs may be velocities of its actuators."""

    @property
    def takes_velocities(self) -> bool: ...


def takes_velocities(plant: object) -> bool:
    """Return True if the inputs of a plant are velocities of its actuators.

    Args:
        plant: any plant.
    """
    return isinstance(plant, VelocityTaking) and plant.takes_velocities


@runtime_checkable
class ReportingPlant(Plant, Protocol):
    """Plant that reports."""

    def report(self) -> PlantReport:
        """Return what the plant knows beyond ``read``."""


def report_of(plant: Plant) -> PlantReport:
    """Return the report of a plant; an empty one of a plant that does not report.

    Args:
        plant: any plant.
    """
    return plant.report() if isinstance(plant, ReportingPlant) else PlantReport()
