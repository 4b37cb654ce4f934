"""Design of gains: of the trackers (8)-(9) and (10), and of the outer loops. Python and scenario files both use it.

There are two presets. ``paper`` has the numbers of the paper. ``scaled`` reads H over a region of configurations. Only
this design reads an inertia, and only beforehand.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Literal, NamedTuple, TypeVar

import numpy as np
import pinocchio as pin

from rnc_pin.array_shapes import Array, Float
from rnc_pin.control.controller import Description, listed
from rnc_pin.errors import ConfigurationError, InfeasibleError, check_known, few, short_text
from rnc_pin.math.linear_algebra import apply_transposed
from rnc_pin.model.input_validation import NotNegative, Positive
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.printing import printed

Gain = float | np.ndarray
Preset = Literal["paper", "scaled"]


class OuterGains(NamedTuple):
    """Gains of the loops over the trackers. They do not depend on the inertia."""

    k3: Gain = 2.0
    """Gain on vertical outputs (12) [1/s]; one number, or one for each."""
    k4: Positive = 10.0
    """Rate at which a steering angle follows its desired value [1/s]; several times k3."""
    k21: Gain = 2.0
    """Gain on primary outputs [1/s]; one number, or one for each. Zero for the paper, which uses x21d_dot in open
    loop."""
    alpha: NotNegative = 20.0
    """Adaptation gain of parameter estimates (20); 0 for constant estimates."""
    k: float = 0.4
    """Decay rate of a platform's distance to its goal [1/s]; several times slower than its tracker."""
    rate: float = 1.0
    """Decay rate of a platform's angles [1/s]."""
    tolerance: float = 2e-3
    """Distance [m] and heading error [rad] below which a platform rests."""
    max_speed: tuple[float, float] = (1.0, 1.0)
    """Largest forward speed [m/s] and yaw rate [rad/s] of a platform."""


DEFAULT_OUTER_GAINS = OuterGains()
"""Gains of the outer loops unless the preset is "paper"; also the defaults of their constructors."""
OUTER_GAINS: dict[Preset, OuterGains] = {
    "paper": OuterGains(k21=0.0, alpha=1.0, k=0.1, rate=0.2, tolerance=0.015, max_speed=(0.3, 0.3)),
    "scaled": DEFAULT_OUTER_GAINS,
}
"""Gains of the outer loops by preset."""


@printed(bandwidth="rad/s", slowest="1/s", adaptation="1/s", delay="s")
@dataclass(frozen=True)
class GainDesign:
    """Choice of the gains of a tracker: a preset, and what it needs to know.

    Attributes:
        preset: "paper" or "scaled".
        bandwidth: for "scaled": bandwidth of the velocity loop [rad/s]; by default the largest that sampling allows.
        adaptation: for "scaled": adaptation rate ``beta / k`` [1/s]; by default 1, and up to 20 where gravity loads the
            outputs.
        delay: for "scaled": time from a measurement to its force, without sampling [s]; 0 by default.
        slowest: for "scaled": lowest accepted rate of the velocity loop [1/s]; about twice the outer loop's gain.
        overrides: fields of ``VelocityGains`` or ``PositionGains`` by name, in place of the preset's; None
            leaves the preset's. ``k`` and ``beta`` are gains of single outputs, also with the preset "scaled".

    Example:
        >>> rnc.control.GainDesign(bandwidth=20.0, overrides={"dead_zone": 1e-3}).preset
        'scaled'
    """

    preset: Preset = "scaled"
    bandwidth: Positive | None = None
    adaptation: Positive | None = None
    delay: NotNegative | None = None
    slowest: Positive = 4.0
    overrides: Mapping[str, Gain | None] = field(default_factory=dict)


_SCALED = GainDesign()


class TrackerGains:
    """Gains of an adaptive tracker.

    Raises:
        ConfigurationError: a gain is not a finite number of at least 0, or an array of them.
    """

    def __post_init__(self) -> None:
        for name, gain in vars(self).items():
            values = np.asarray(gain)
            # Modes are directions of any sign; a negative gain would drive the robot away from its reference.
            if name != "modes" and (values.dtype.kind not in "fiu" or not (np.isfinite(values) & (values >= 0)).all()):
                raise ConfigurationError(f"gain {name}: expected numbers of at least 0, found {short_text(gain)}")

    def describe(self) -> Description:
        """Return the gains by name; dead zone and modes only if there are some."""
        # The paper has neither.
        optional = ("dead_zone", "modes")
        return {name: listed(value) for name, value in vars(self).items() if name not in optional or np.any(value)}


@printed(k="force per velocity", sigma="1/s", dead_zone="m/s or rad/s")
@dataclass(frozen=True)
class VelocityGains(TrackerGains):
    """Gains of (10).

    Attributes:
        k: gain of the velocity error [force per velocity]; one number, or one for each reducing output.
        beta: adaptation gain (10); one number, or one for each reducing output.
        sigma: leak rate of the adapted values [1/s].
        dead_zone: velocity error below which adaptation stops, as large as the velocity noise [m/s or rad/s]; zero in
            the paper (``control.feedback``). One number, or one for each reducing output.
        modes: matrix S (r, r). The tracker then works on the mode velocities ``S^T v2`` with mode forces F', and
            ``F = S F'``: ``k`` and ``beta`` belong to the modes. None for gains of single outputs.
    """

    k: Gain = 10.0
    beta: Gain = 10.0
    sigma: NotNegative = 0.1
    dead_zone: Gain = 0.0
    modes: np.ndarray | None = None


@printed(gamma="1/s", sigma="1/s")
@dataclass(frozen=True)
class PositionGains(TrackerGains):
    """Gains of (8)-(9).

    Attributes:
        k1: gain of the filtered error w, which replaces the rate (8); one number, or one for each output.
        k2: gain of the error (8); one number, or one for each output.
        gamma: rate of the filter (8) [1/s].
        beta: adaptation gain (9); one number, or one for each output.
        sigma: leak rate of the adapted values [1/s].
        dead_zone: error below which adaptation stops, as large as the output noise; zero in the paper. One number, or
            one for each output.
    """

    k1: Gain = 10.0
    k2: Gain = 10.0
    gamma: Positive = 2.0
    beta: Gain = 10.0
    sigma: NotNegative = 0.1
    dead_zone: Gain = 0.0


def design_velocity_gains(
    reduced: ReducedModel,
    configurations: np.ndarray,
    dt: float,
    design: GainDesign = _SCALED,
    *,
    outputs: np.ndarray | None = None,
    times: np.ndarray | None = None,
) -> VelocityGains:
    """Return the gains of a velocity tracker: of a preset, or overrides in their place.

    The preset "scaled" has gains ``K = bandwidth D`` for a typical inertia D over a region. It reads the model's
    inertia once, beforehand; the controller never reads it. The closed velocity loop has rates ``eig(H^-1 K)``. They
    have to be slow for the sampling (rate times dt below ``MAX_RATE_TIMES_PERIOD``) and fast for the outer loop (at
    least ``slowest``). These limits are a window for the bandwidth; the default is its upper end.

    Adaptation must be as fast as the force of gravity changes. Where gravity loads the outputs, its rate is 20/s, or
    less with a delay. Use 30/s if gravity is large compared with the inertia, as at a light wrist.

    D is the diagonal of H if this window is not empty: one gain for each output. Else D is a typical H itself, with its
    modes. An arm needs this: the motion of one joint accelerates the others, so that H is far from diagonal. Lemma 3
    holds for the modes too, since they are fixed combinations of the reduced velocities.

    A delay limits the rates too. The applied force is ``delay`` old, plus half a sample on average for the hold. With
    ``age = delay + dt / 2``, ``edot = -rate e(t - age)`` has solutions ``exp(s t)`` with ``s = -rate exp(-s age)``. The
    first solutions cross the imaginary axis at ``rate age = pi / 2``. The rates stay below half of that,
    ``MAX_RATE_TIMES_DELAY = pi / 4``. The other half of the phase is for the outer loop and for adaptation, which takes
    ``atan(beta / k / rate)``.

    Args:
        reduced: the model; only "scaled" reads its inertia.
        configurations: region of the motion, (count, nq), e.g. of a kinematic roll-out of the reference.
        dt: sampling period [s].
        design: preset, bandwidth, slowest rate, adaptation, delay and overrides.
        outputs: indices of the reducing outputs of these gains; all by default.
        times: times (count,) of the configurations [s], for error messages.

    Raises:
        InfeasibleError: the window is empty. The message gives its limits, and the configuration that causes it.
        ConfigurationError: ``bandwidth`` is outside the window, or another argument is not valid.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")], robot.joint_names[1:])
        >>> reduced = system.reduce()
        >>> q0 = robot.configuration({"joint_2": 1.8})
        >>> gains = rnc.control.design_velocity_gains(
        ...     reduced, q0, 0.002, rnc.control.GainDesign(overrides={"sigma": 0.0}))
        >>> gains.k.shape, gains.sigma
        ((3,), 0.0)
    """
    delay = _checked(design)
    if design.preset == "paper":
        return _override(VelocityGains(), design)
    bandwidth, slowest, adaptation = design.bandwidth, design.slowest, design.adaptation
    region = np.atleast_2d(configurations)
    H = reduced.at(region).H
    H = H if outputs is None else H[:, outputs][:, :, outputs]
    fastest = fastest_rate(dt, delay)
    inertia = inertia_of_outputs(H)
    low, high = inertia.window(slowest, fastest)
    # Gains of single outputs are simpler to read and to override: modes only if there are none, or a gain is given.
    if low > high and all(design.overrides.get(name) is None for name in ("k", "beta")):
        inertia = inertia_of_modes(H)
        low, high = inertia.window(slowest, fastest)
    if low > high:
        raise _no_gains(reduced, region, times, inertia, slowest, dt, delay)
    if bandwidth is not None and not low <= bandwidth <= high:
        raise ConfigurationError(f"bandwidth {bandwidth:g} rad/s is outside the window {low:.3g} to {high:.3g}")
    # The upper end: the ball of errors shrinks as k grows (Lemma 3), and the window has room for the sampling.
    k = (high if bandwidth is None else bandwidth) * inertia.weights
    if adaptation is None:
        adaptation = adaptation_rate(gravity_loads(reduced, region, outputs), dt, delay)
    return _override(VelocityGains(k=k, beta=adaptation * k, modes=inertia.modes), design)


def design_position_gains(
    inertia: Callable[[np.ndarray], np.ndarray], configurations: np.ndarray, dt: float, design: GainDesign = _SCALED
) -> PositionGains:
    """Return the gains of a position tracker: of a preset, or overrides in their place.

    The preset "scaled" has gains ``k = kappa diag(H)``. The closed loop then oscillates at
    ``omega^2 = kappa1 gamma^4 + kappa2 gamma^2``. The filter damps this oscillation at about ``gamma``. The zero-order
    hold excites it at ``omega^2 dt / 4``: half of omega^2 times the average age of inputs, half a sample. So omega^2
    may be gamma / dt, or with a delay ``gamma / (dt + 2 delay)``. The error then decays at
    ``rate = 2 kappa2 gamma^3 / omega^2``, which is 3/s with ``gamma = 8/s``.

    Args:
        inertia: function that returns the inertia (..., k, k) of the outputs at configurations (..., nq). Only
            "scaled" calls it.
        configurations: region of the motion, (..., nq).
        dt: sampling period [s].
        design: preset, delay and overrides.

    Raises:
        InfeasibleError: sampling is too slow for these rates; the message gives the limits.
        ConfigurationError: an argument is not valid.
    """
    delay = _checked(design)
    if design.preset == "paper":
        return _override(PositionGains(), design)
    gamma, rate = 8.0, 3.0  # [1/s]; the oscillation decays at gamma, before the error does at the rate
    diagonal, _, eigenvalues = inertia_of_outputs(inertia(configurations))
    # omega^2 of the slowest output; those with less inertia than typical oscillate faster.
    square = gamma / (dt + 2.0 * delay) * float(eigenvalues.min())
    kappa2 = rate * square / (2.0 * gamma**3)
    kappa1 = (square - kappa2 * gamma**2) / gamma**4
    if square < (4.0 * rate) ** 2 * float(eigenvalues.max()):
        late = f" with a delay of {delay:g} s" if delay else ""
        raise InfeasibleError(
            f"no position gains suit this region: sampling every {dt:g} s{late} allows oscillations of "
            f"{np.sqrt(square):.3g} rad/s, a decay rate of {rate:g}/s with gamma {gamma:g} needs more; sample faster"
        )
    scaled = PositionGains(k1=kappa1 * diagonal, k2=kappa2 * diagonal, gamma=gamma, beta=diagonal.copy())
    return _override(scaled, design)


_Gains = TypeVar("_Gains", VelocityGains, PositionGains)


def _override(gains: _Gains, design: GainDesign) -> _Gains:
    return replace(gains, **{name: value for name, value in design.overrides.items() if value is not None})  # type: ignore[arg-type]


def _checked(design: GainDesign) -> float:
    """Delay of a design [s]; raise an error if its preset or its delay is not valid."""
    check_known(design.preset, OUTER_GAINS, "preset")
    delay = design.delay or 0.0
    if not 0 <= delay < np.inf:
        raise ConfigurationError(f"delay of a loop has to be a time [s], not negative, found {delay}")
    return delay


# ---------------------------------------------------------------------- typical inertia of a region


MAX_RATE_TIMES_PERIOD = 0.2
"""Largest product of a closed-loop rate and the sampling period that the sampled tracker tolerates."""
MAX_RATE_TIMES_DELAY = np.pi / 4
"""Largest product of a closed-loop rate and the age of the feedback signal: half of pi / 2."""
NEARLY_SINGULAR = 0.05
"""Smallest singular value of E with scaled rows below which a refusal names the singular configuration as its cause."""
AWAY_FROM_SINGULAR = "keep away from there: nearer goals, another start or path, or other outputs"


class TypicalInertia(NamedTuple):
    """Typical inertia ``modes diag(weights) modes^T`` of inertia matrices H, and their distance from it.

    Attributes:
        weights: inertia of each output or mode (k,).
        modes: matrix (k, k), whose columns are the directions of forces on single modes; None for single outputs.
        eigenvalues: of ``typical^-1 H``, ascending, (count, k).
    """

    weights: Float[Array, " k"]
    modes: Float[Array, "k k"] | None
    eigenvalues: Float[Array, "count k"]

    def window(self, slowest: float, fastest: float) -> tuple[float, float]:
        """Lowest and highest bandwidth for closed-loop rates between two limits [1/s].

        Args:
            slowest: lowest accepted rate.
            fastest: highest accepted rate.
        """
        return slowest * float(self.eigenvalues.max()), fastest * float(self.eigenvalues.min())


def inertia_of_outputs(H: np.ndarray) -> TypicalInertia:
    """Return the typical diagonal D (k,) of inertia matrices (count, k, k): the geometric mean of its extremes.

    Args:
        H: inertia matrices.
    """
    H = _symmetric(H)
    entries = np.einsum("...ii->...i", H).reshape(-1, H.shape[-1])
    # The geometric mean is as far from the least as from the largest, in ratios: the window is symmetric.
    diagonal = np.sqrt(entries.min(axis=0) * entries.max(axis=0))
    # Ratios to the typical inertia: 1 is typical, whatever the units.
    scale = np.sqrt(diagonal)
    return TypicalInertia(diagonal, None, np.linalg.eigvalsh(H / np.multiply.outer(scale, scale)))


def inertia_of_modes(H: np.ndarray) -> TypicalInertia:
    """Return the typical inertia with its modes: the geometric mean of the arithmetic and the harmonic mean of H.

    The geometric mean ``P # Q`` of two positive definite matrices solves ``X P^-1 X = Q``. For a single output it is
    the square root of their product.

    Args:
        H: inertia matrices (count, k, k).
    """
    # Means of matrices in kg and in kg m^2 would depend on units.
    scale = np.sqrt(inertia_of_outputs(H).weights)
    normal = _symmetric(H / np.multiply.outer(scale, scale))  # free of units
    arithmetic, harmonic = normal.mean(axis=0), np.linalg.inv(np.linalg.inv(normal).mean(axis=0))
    values, vectors = np.linalg.eigh(arithmetic)
    root = vectors * np.sqrt(values)
    inverse = vectors / np.sqrt(values)
    middle, turned = np.linalg.eigh(_symmetric(inverse.T @ harmonic @ inverse))
    half = root @ turned
    weights, modes = np.linalg.eigh(_symmetric((half * np.sqrt(middle)) @ half.T))
    whitened = modes / np.sqrt(weights)
    return TypicalInertia(weights, scale[:, None] * modes, np.linalg.eigvalsh(whitened.T @ normal @ whitened))


def fastest_rate(dt: float, delay: float) -> float:
    """Largest closed-loop rate [1/s] for a sampling period and a delay [s].

    Args:
        dt: sampling period.
        delay: time from a measurement to its force, without sampling.
    """
    # The hold and the age of the feedback each bound the rate; the smaller bound counts.
    return min(MAX_RATE_TIMES_PERIOD / dt, MAX_RATE_TIMES_DELAY / (delay + dt / 2))


def gravity_loads(reduced: ReducedModel, configurations: np.ndarray, outputs: np.ndarray | None = None) -> bool:
    """Return whether gravity loads outputs in a region.

    Args:
        reduced: the model.
        configurations: region, (count, nq).
        outputs: indices of the reducing outputs; all by default.
    """
    region = np.atleast_2d(configurations)
    count = 12  # of configurations at which gravity is computed: it changes slowly over a region
    some = region[np.unique(np.linspace(0, len(region) - 1, count).astype(int))]
    model = reduced.robot.model
    data = model.createData()
    weight = float(pin.computeTotalMass(model) * np.linalg.norm(model.gravity.linear))
    forces = np.array([pin.computeGeneralizedGravity(model, data, q) for q in some])
    loads = apply_transposed(reduced.at(some).R, forces)
    lever = 1e-4  # [m] of the robot's weight above which gravity loads an output; for a slide, part of the weight
    # 1e-6 N is rounding, for a robot whose model has no weight.
    return bool(np.abs(loads if outputs is None else loads[:, outputs]).max(initial=0.0) > max(lever * weight, 1e-6))


def adaptation_rate(is_loaded: bool, dt: float, delay: float) -> float:
    """Return the default adaptation rate ``beta / k`` [1/s]: 1, or up to 20 where gravity loads the outputs.

    An adaptation rate a makes the loop ``rate (s + a) / s^2 exp(-age s)``, with ``age = delay + dt / 2``. With
    ``a <= 20/s`` and ``a age <= 0.1`` its phase margin is at least 20 degrees for rates from 4/s to ``fastest_rate``.

    Args:
        is_loaded: True if gravity loads the outputs.
        dt, delay: sampling period, and delay without sampling [s].
    """
    under_gravity = 20.0  # [1/s], with which a tracker follows the change of its gravity load
    largest_product = 0.1  # of the adaptation rate and the age of the feedback signal
    return max(1.0, min(under_gravity, largest_product / (delay + dt / 2))) if is_loaded else 1.0


def _no_gains(
    reduced: ReducedModel,
    configurations: np.ndarray,
    times: np.ndarray | None,
    inertia: TypicalInertia,
    slowest: float,
    dt: float,
    delay: float,
) -> InfeasibleError:
    """Error that no velocity gains suit a region: where, which rows, and what would help."""
    at = reduced.at(configurations)
    values = np.atleast_1d(at.smallest_singular_value)
    singular = bool(values.min() < NEARLY_SINGULAR)
    # The cause is told where it is worst.
    place = int(np.argmin(values) if singular else np.argmax(inertia.eigenvalues[:, -1]))
    time, rows = None if times is None else float(times[place]), at.dependent_rows(place)
    # The longest sampling period with gains [s]; 0 if the delay alone excludes them.
    when = "" if time is None else f" at t = {time:.2f} s"
    where = f"{when} at q = [{few([f'{value:.3g}' for value in at.q[place]], 8)}]"  # the error has all positions
    rate = slowest * float(inertia.eigenvalues.max() / inertia.eigenvalues.min())
    period = max(0.0, min(MAX_RATE_TIMES_PERIOD / rate, 2.0 * (MAX_RATE_TIMES_DELAY / rate - delay)))
    if singular:
        cause = (
            f"the outputs are nearly singular{where}: rows {few(rows, 4)} are almost dependent, smallest singular "
            f"value of E = [A; J2] {values[place]:.2g}; {AWAY_FROM_SINGULAR}"
        )
    else:
        low, high = inertia.window(slowest, fastest_rate(dt, delay))
        least, most = inertia.eigenvalues[place, 0], inertia.eigenvalues[place, -1]
        cause = (
            f"rates of at least {slowest:g}/s need a bandwidth of {low:.3g} rad/s, sampling every {dt:g} s"
            f"{f' with a delay of {delay:g} s' if delay else ''} allows {high:.3g}; the inertia is most uneven{where}, "
            f"with {least:.3g} to {most:.3g} of its typical value"
        )
    shortest = 1e-4  # [s]; control loops that sample faster are rare, so no message asks for it
    faster = f"; sample faster, at least every {period:.2g} s" if period >= shortest else ""
    remedy = faster if period else "; the delay is too long for any sampling"
    error = InfeasibleError(f"no velocity gains suit this region: {cause}{remedy}")
    error.q, error.time, error.rows, error.singular_value = at.q[place].copy(), time, rows, float(values[place])
    return error


def _symmetric(H: np.ndarray) -> np.ndarray:
    """Symmetric part: an effective inertia need not be symmetric."""
    return np.asarray(0.5 * (H + H.mT))
