"""Protocol of plants: the methods that a control loop needs, the report of what else a plant knows, and step control.

Step control chooses the number of substeps of each sample, and estimates the error of integration that remains. An
estimate by comparison with twice as many substeps is reliable, but it costs two more integrations. So only some samples
are compared. In between, the stages of the Runge-Kutta steps show by their roughness how the error changes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import NamedTuple, Never, Protocol, runtime_checkable

import numpy as np

from rnc_pin.array_shapes import Array, Float
from rnc_pin.errors import InputError
from rnc_pin.model.input_validation import is_count, is_number
from rnc_pin.model.reduced_model import ReducedModel

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

    By default, nobody clips inputs in ``simulate``. ``ReducedPlant`` and plants with contacts do it with
    ``actuator_limits``, MuJoCo's with ``effort_limits``, and faulty plants at the fault ``effort``. They report what
    they applied, so that controllers learn what is missing. The verdict compares the applied inputs of the record with
    the limits (``limit_replay._efforts``). A ``ControlLoop`` for a real robot clips to the limits of its file.
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

    takes_velocities: bool


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


# ------------------------------------------------------------------ step control

MOST_SUBSTEPS = 1024
"""Largest number of substeps that a plant chooses."""
MOST_EVENT_SUBSTEPS = 16
"""The same with friction, where the error at an event falls slowly with the step."""

_PERIOD = 128  # samples after which a comparison is due
ROUNDING = 1e-14
"""Relative difference of two integrations that is rounding."""


class Substeps(NamedTuple):
    """Choice of the number of substeps.

    Attributes:
        number: fixed number; None for as many as the tolerance asks for.
        tolerance: largest error that the integration adds in a second [m, rad, m/s or rad/s].
    """

    number: int | None
    tolerance: float

    @classmethod
    def checked(cls, number: object, tolerance: object) -> Substeps:
        """Return a valid choice.

        Args:
            number: number of substeps that the user gave; None for a free choice.
            tolerance: tolerance that the user gave [m, rad, m/s or rad/s].

        Raises:
            InputError: the number is not a positive integer, or the tolerance not a positive number.
        """
        if number is not None and not is_count(number, 1):
            raise InputError(f"substeps of a plant have to be a positive integer, found {number!r}")
        if not (is_number(tolerance) and tolerance > 0):
            raise InputError(f"tolerance of a plant has to be a positive number, found {tolerance!r}")
        return cls(None if number is None else int(number), float(tolerance))


class IntegrationErrors(NamedTuple):
    """Estimated errors of a run, and its choice of substeps. Those of B runs are arrays (B,).

    The error of a sample is the error of its worst entry of configuration and velocity [m, rad, m/s or rad/s].

    Attributes:
        steps, used: substeps of the next and of the last sample.
        age: samples since the last comparison.
        roughness: roughness of the compared sample.
        size: error of the compared sample, at least rounding.
        span: duration of the compared sample [s].
        total: sum of the estimated errors of all samples.
        rate: largest error per second of a compared sample.
        most: largest number of substeps so far.
        enough: number of substeps that the tolerance asks for.
    """

    steps: int
    used: int
    age: int
    roughness: float
    size: float
    span: float
    total: float
    rate: float
    most: int
    enough: int

    @classmethod
    def initial(cls, substeps: Substeps) -> IntegrationErrors:
        """Return the errors at the start of a run.

        Args:
            substeps: choice of the number of substeps.
        """
        # Due for a comparison at once (age): nothing is known of the motion yet.
        steps = substeps.number or 1
        return IntegrationErrors(steps, steps, _PERIOD, 0.0, 0.0, 0.0, 0.0, 0.0, steps, 1)

    def after(self, roughness: float, dt: float, limit: float) -> tuple[bool, IntegrationErrors]:
        """Judge a sample by its roughness.

        Args:
            roughness: roughness of its steps.
            dt: duration of the sample [s].
            limit: largest error that needs no comparison.

        Returns:
            True where the sample needs no comparison, and the errors after it.
        """
        # Arithmetic alone, without branches: the same lines judge one run and arrays of runs.
        steps, _, age, reference, size, span, total = self[:7]
        least = 1e-60  # roughness of a motion at rest: no division by zero
        # The ratio to the roughness of the compared sample estimates drawn motions better than a power of the ratio.
        share = roughness / (reference + least)
        error = share * size
        pause = 32  # samples after a comparison without another one, unless the tolerance needs it
        growth = 4.0  # error of a sample over the compared one, from which a comparison is due
        settled = (age < pause) | (share < growth) | (error < self.rate * dt)
        longer = 1.5  # duration over the compared sample's, from which a comparison is due
        # The error falls faster with the duration than the roughness, and the error of a short sample may be below
        # rounding.
        accepted = (error <= limit) & (age < _PERIOD) & settled & (dt <= longer * span)
        return accepted, IntegrationErrors(
            steps, steps, age + 1, reference, size, span, total + error, self.rate, self.most, self.enough
        )

    def interrupted(self) -> IntegrationErrors:
        """Return the errors at a jump of the velocity, after which a comparison is due."""
        return self._replace(age=_PERIOD)

    def compared(
        self, steps: int, roughness: float, error: float, dt: float, substeps: Substeps, enough: int
    ) -> IntegrationErrors:
        """Return the errors after a compared sample.

        Args:
            steps: its number of substeps.
            roughness: roughness of its steps.
            error: its estimated error.
            dt: its duration [s].
            substeps: choice of the number of substeps.
            enough: number of substeps that keeps the tolerance.
        """
        following, again = steps, not roughness < np.inf
        margin = 64.0  # half the substeps have 16 times the error; four times that is a reserve
        if substeps.number is None and steps > 1 and error * margin < substeps.tolerance * dt:
            following, again = steps // 2, True
        return IntegrationErrors(
            following, steps, _PERIOD if again else 0, roughness, max(error, ROUNDING), dt,
            self.total + error, max(self.rate, error / dt), max(self.most, steps), max(self.enough, enough),
        )  # fmt: skip
