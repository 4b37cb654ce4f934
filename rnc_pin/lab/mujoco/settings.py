"""Settings of the MuJoCo plant as plain values. This module does not import MuJoCo."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from rnc_pin.errors import ConfigurationError, nearest
from rnc_pin.model.input_validation import NotNegative, Positive, check_settings, is_number

Integrator = Literal["implicitfast", "implicit", "Euler", "RK4"]
Stance = Literal["auto", "free", "level"]


@dataclass(frozen=True)
class MuJoCoSettings:
    """Settings of ``MuJoCoPlant``.

    Args:
        step: time step of MuJoCo [s]; reduced slightly so that the sampling period is a multiple of it.
        integrator: "RK4" for motion without contacts, where it agrees with the reduced model to many digits;
            "implicitfast", "implicit" and "Euler" are of first order and cheaper.
        friction: friction coefficients of wheels and blades: sliding [1], torsional [m], rolling [m].
        contact_time: time constant of contacts [s]; at least four steps, which is the default. The penetration under
            the weight is 10 m/s^2 times its square.
        stance: support of a vehicle whose model is planar. "free": six degrees of freedom; it can lean and tip.
            "level": it moves vertically but cannot lean, so its wheels share the weight evenly. "auto": free if its
            wheels carry it, level if it would tip.
        casters: add frictionless supports to a vehicle of stance "free"; "auto" adds them if its wheels alone do not
            carry it.
        settling: time before a run in which the vehicle comes to rest on the ground with fixed joints [s].
        joint_limits: enforce the position limits of the robot file.
        joint_damping: apply the viscous joint damping of the robot file.
        effort_limits: clip inputs to the limits of the actuators.

    Raises:
        ConfigurationError: a value is not a listed choice or not a valid number.

    Example:
        >>> from rnc_pin.lab.mujoco import MuJoCoSettings
        >>> MuJoCoSettings(friction=(0.4, 0.0, 0.0)).friction[0]
        0.4
        >>> try:
        ...     MuJoCoSettings(integrator="euler")
        ... except rnc.ConfigurationError as error:
        ...     print(error)
        MuJoCo: integrator 'euler' is not known; did you mean 'Euler'?
    """

    step: Positive = 0.0005
    integrator: Integrator = "RK4"
    friction: tuple[float, float, float] = (1.0, 0.0, 0.0)
    contact_time: NotNegative = 0.0
    stance: Stance = "auto"
    casters: Literal["auto"] | bool = "auto"
    settling: NotNegative = 0.2
    joint_limits: bool = False
    joint_damping: bool = False
    effort_limits: bool = False

    @property
    def contact_time_constant(self) -> float:
        """Time constant of contacts [s]."""
        return max(self.contact_time, 4 * self.step)

    def __post_init__(self) -> None:
        # Words of each setting.
        listed = {"integrator": get_args(Integrator), "stance": get_args(Stance), "casters": ("auto", True, False)}
        for name, choices in listed.items():
            value = getattr(self, name)
            if value not in choices:
                raise ConfigurationError(
                    f"MuJoCo: {name} '{value}' is not known{nearest(str(value), map(str, choices))}"
                )
        check_settings(self)
        friction = self.friction if isinstance(self.friction, Sequence | np.ndarray) else ()
        if len(friction) != 3 or not all(is_number(each) and each >= 0 for each in friction):
            raise ConfigurationError(
                "MuJoCo: friction: expected three numbers of at least 0 (sliding, torsional, rolling), found "
                f"{self.friction!r}"
            )
