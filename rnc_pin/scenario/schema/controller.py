"""Which controller a scenario has, and with which gains."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from rnc_pin.scenario.schema.base import Numbers, Positive, Strict


class UnknownMasses(Strict):
    """Bodies whose masses are estimated."""

    base: str
    """The joint whose momentum is conserved."""
    initial: Annotated[dict[str, float], Field(min_length=1)]
    """Joint that carries the body: first estimate, in ``unit``."""
    unit: Positive = 1.0
    """Mass that counts as 1 [kg]; the paper's parameters m_k / J have unit J."""
    bounds: Annotated[list[float], Field(min_length=2, max_length=2)] = [0.05, 20.0]
    """Estimates stay between these, in ``unit``."""


class PlatformGoal(Strict):
    """Where a unicycle platform goes in the second phase."""

    position: Annotated[list[str], Field(min_length=2, max_length=2)]
    """Vertical outputs that are its x and y."""
    to: Annotated[list[float], Field(min_length=3, max_length=3)]
    """x, y [m] and heading [rad]."""
    begin: Annotated[float, Field(ge=0)]
    """When the second phase starts [s]."""


class ControllerSettings(Strict):
    """Which controller, which preset of gains, and gains set by hand on top of it."""

    type: Literal[
        "redundancy", "reducing_outputs", "jacobian_transpose", "uncertain_redundancy", "steering", "two_phase"
    ]
    """``redundancy``: (12) over a velocity tracker. ``reducing_outputs``: references for all reducing outputs, the
    vertical ones go where they will. ``jacobian_transpose``: (8)-(9) on the ``active`` actuators, the others off.
    ``uncertain_redundancy``: (16) with masses estimated by (20). ``steering``: class 2s.
    ``two_phase``: class 3, (8)-(9) for the primary outputs, then a point stabiliser for the platform."""
    tracker: Literal["adaptive", "computed_torque"] = "adaptive"
    """Under the first two types: (10), or the model-based baseline."""
    preset: Literal["paper", "scaled"] = "scaled"
    """Gains of the paper, or gains scaled to the inertia along the way."""
    active: list[str] | None = None
    """Actuators that are on, for ``jacobian_transpose``."""
    unknown: UnknownMasses | None = None
    """For ``uncertain_redundancy``."""
    platform: PlatformGoal | None = None
    """For ``two_phase``."""
    alpha: Annotated[float, Field(ge=0)] | None = None
    """Adaptation of estimated masses (20)."""
    k: float | Numbers | None = None
    """Gain of the velocity tracker (10): one number, or one for each reducing output."""
    k1: float | Numbers | None = None
    """Gain of the position tracker (8)."""
    k2: float | Numbers | None = None
    """Gain of the position tracker (8)."""
    k3: float | Numbers | None = None
    """Outer gain on vertical outputs (12) [1/s]."""
    k21: float | Numbers | None = None
    """Outer gain on primary outputs [1/s]; the paper has 0."""
    k4: Positive | None = None
    """How fast steering follows, for ``steering`` [1/s]."""
    gamma: Positive | None = None
    """Filter of the position tracker (8) [1/s]."""
    beta: float | Numbers | None = None
    """Adaptation rate (9), (10)."""
    sigma: Annotated[float, Field(ge=0)] | None = None
    """Leak of what is adapted [1/s]."""
    bandwidth: Positive | None = None
    """Of the preset ``scaled`` [rad/s]."""
