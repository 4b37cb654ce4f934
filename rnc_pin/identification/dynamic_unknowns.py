"""Kinds of unknown dynamic parameters: of bodies, of joints, and of what drivers report as effort."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias


@dataclass(frozen=True)
class BodyInertia:
    """Mass, center of mass and moments of inertia of the body behind a joint: ten numbers.

    Links that are fixed to each other are one body.

    Args:
        joint: the joint that carries the body.

    Example:
        >>> rnc.identification.BodyInertia("joint_1").name
        'inertia of joint_1'
    """

    joint: str

    @property
    def name(self) -> str:
        """Name of the parameters."""
        return f"inertia of {self.joint}"


@dataclass(frozen=True)
class CoulombFriction:
    """Friction of a joint against its motion, whatever the speed [N m or N].

    Args:
        joint: the joint.

    Example:
        >>> rnc.identification.CoulombFriction("joint_1").name
        'Coulomb friction of joint_1'
    """

    joint: str

    @property
    def name(self) -> str:
        """Name of the parameter."""
        return f"Coulomb friction of {self.joint}"


@dataclass(frozen=True)
class ViscousFriction:
    """Friction of a joint in proportion to its speed [N m s/rad or N s/m].

    Args:
        joint: the joint.

    Example:
        >>> rnc.identification.ViscousFriction("joint_1").name
        'viscous friction of joint_1'
    """

    joint: str

    @property
    def name(self) -> str:
        """Name of the parameter."""
        return f"viscous friction of {self.joint}"


@dataclass(frozen=True)
class MotorInertia:
    """Inertia of a motor times the square of its gear, as the joint feels it [kg m^2 or kg].

    Args:
        joint: the joint.

    Example:
        >>> rnc.identification.MotorInertia("joint_1").name
        'motor inertia of joint_1'
    """

    joint: str

    @property
    def name(self) -> str:
        """Name of the parameter."""
        return f"motor inertia of {self.joint}"


@dataclass(frozen=True)
class EffortScale:
    """Reported effort for a unit of the true one: a gear, a motor constant, or a unit of the driver.

    Args:
        joint: the joint whose effort is reported.

    Example:
        >>> rnc.identification.EffortScale("joint_1").name
        'effort scale of joint_1'
    """

    joint: str

    @property
    def name(self) -> str:
        """Name of the parameter."""
        return f"effort scale of {self.joint}"


@dataclass(frozen=True)
class EffortOffset:
    """Reported effort at zero effort, in the unit of the driver.

    Args:
        joint: the joint whose effort is reported.

    Example:
        >>> rnc.identification.EffortOffset("joint_1").name
        'effort offset of joint_1'
    """

    joint: str

    @property
    def name(self) -> str:
        """Name of the parameter."""
        return f"effort offset of {self.joint}"


DynamicUnknown: TypeAlias = BodyInertia | CoulombFriction | ViscousFriction | MotorInertia | EffortScale | EffortOffset
INERTIAL = ("m", "m x", "m y", "m z", "I_xx", "I_xy", "I_yy", "I_xz", "I_yz", "I_zz")
"""Parameters of a body in Pinocchio's order: mass, first moments, moments of inertia about the origin of the joint."""
