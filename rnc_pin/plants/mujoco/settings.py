"""How MuJoCo is asked to compute; plain values, as a file has them. Needs no MuJoCo."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from rnc_pin.errors import ConfigurationError, nearest

Integrator = Literal["implicitfast", "implicit", "Euler", "RK4"]
Solver = Literal["Newton", "CG", "PGS"]
Cone = Literal["elliptic", "pyramidal"]
WheelShape = Literal["ellipsoid", "sphere", "cylinder"]
Stance = Literal["auto", "free", "level"]

_CHOICES: dict[str, tuple[object, ...]] = {
    "integrator": get_args(Integrator),
    "solver": get_args(Solver),
    "cone": get_args(Cone),
    "wheel_shape": get_args(WheelShape),
    "stance": get_args(Stance),
    "casters": ("auto", True, False),
}
_LEAST = {"step": 0.0, "iterations": 1, "tolerance": 0.0, "contact_time": 0.0, "settling": 0.0}
_POSITIVE = ("step", "tolerance")


@dataclass(frozen=True)
class MuJoCoSettings:
    """Settings of ``MuJoCoPlant``.

    Args:
        step: of MuJoCo's integrator [s]; where ``advance`` asks for a time that is no multiple, a little less.
        integrator: "RK4" for motion without contacts, where it agrees with the reduced model to many digits;
            "implicitfast", "implicit" and "Euler" are of first order and cheaper.
        friction: of wheels and blades on the ground: sliding [1], torsional [m], rolling [m].
        solver: of contact forces.
        iterations: of the solver, at most.
        tolerance: of the solver.
        cone: of friction forces.
        contact_time: time constant in which a contact takes away what it penetrates [s]; at least four steps, which is
            the default. The ground gives way under the weight by 10 m/s^2 times its square.
        wheel_shape: of wheels that turn: "ellipsoid", a thin disk with one point on the ground; "sphere", the same for
            upright wheels; "cylinder", a tenth as wide as high, which scrubs when it turns on the spot.
        stance: how a vehicle stands that the robot's model keeps on a plane. "free": in all six degrees of freedom, it
            may lean and tip. "level": it moves up and down but cannot lean, so that its wheels share its weight evenly.
            "auto": free where its wheels carry it, level where it would tip.
        casters: whether supports without friction are added to a vehicle that stands free; "auto" where its wheels
            alone do not carry it.
        settling: time that the vehicle is given to come to rest on the ground, joints held, before a run [s].
        joint_limits: whether joints have the stops that the robot's file gives them.
        joint_damping: whether they have the viscous damping of the file.
        effort_limits: whether inputs are clipped to the limits of the actuators.

    Raises:
        ConfigurationError: a value that is not one of these, or no number.

    Example:
        >>> from rnc_pin.plants.mujoco import MuJoCoSettings
        >>> MuJoCoSettings(friction=(0.4, 0.0, 0.0)).friction[0]
        0.4
        >>> try:
        ...     MuJoCoSettings(solver="newton")
        ... except rnc.ConfigurationError as error:
        ...     print(error)
        MuJoCo: solver 'newton' is not known; did you mean 'Newton'?
    """

    step: float = 0.0005
    integrator: Integrator = "RK4"
    friction: tuple[float, float, float] = (1.0, 0.0, 0.0)
    solver: Solver = "Newton"
    iterations: int = 50
    tolerance: float = 1e-12
    cone: Cone = "elliptic"
    contact_time: float = 0.0
    wheel_shape: WheelShape = "ellipsoid"
    stance: Stance = "auto"
    casters: Literal["auto"] | bool = "auto"
    settling: float = 0.2
    joint_limits: bool = False
    joint_damping: bool = False
    effort_limits: bool = False

    @property
    def firmness(self) -> float:
        """The time constant of contacts [s]."""
        return max(self.contact_time, 4 * self.step)

    def __post_init__(self) -> None:
        for name, choices in _CHOICES.items():
            value = getattr(self, name)
            if value not in choices:
                raise ConfigurationError(
                    f"MuJoCo: {name} '{value}' is not known{nearest(str(value), map(str, choices))}"
                )
        for name, least in _LEAST.items():
            value = getattr(self, name)
            number = isinstance(value, int | float) and not isinstance(value, bool) and np.isfinite(value)
            if not number or value < least or (name in _POSITIVE and not value > 0):
                expected = "a positive number" if name in _POSITIVE else f"a number from {least:g}"
                raise ConfigurationError(f"MuJoCo: {name}: expected {expected}, found {value!r}")
        try:
            friction = np.asarray(self.friction, dtype=float)
        except (TypeError, ValueError):
            friction = np.empty(0)
        if friction.shape != (3,) or not (np.isfinite(friction).all() and (friction >= 0).all()):
            raise ConfigurationError(
                "MuJoCo: friction is three numbers, sliding, torsional and rolling, none negative, found "
                f"{self.friction!r}"
            )
