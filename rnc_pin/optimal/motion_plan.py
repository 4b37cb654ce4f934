"""Result of optimal control: states, inputs, feedback gains, references of the outputs, and their verification."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy import ndarray as Array

from rnc_pin.array_shapes import Float
from rnc_pin.errors import ConfigurationError, nearest
from rnc_pin.io.atomic_write import atomic_file
from rnc_pin.io.safe_npz import ArchiveError, read_npz
from rnc_pin.planning.references import ReferencePoint

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_ARRAYS = ("time", "q", "w", "u", "K", "position", "velocity", "acceleration")


@dataclass(frozen=True)
class PlanVerification:
    """Result of a re-integration of the inputs with a fine step, without feedback.

    Attributes:
        violation: largest violation of a bound or of the goal [its unit].
        name: name of that row.
        at: its time [s].
        deviation: largest difference between the integrated and the planned states at the nodes.
        substeps: integrator steps in each interval.
    """

    violation: float
    name: str
    at: float
    deviation: float
    substeps: int


@dataclass(frozen=True)
class PlanInfo:
    """Description of a plan: names, cost, outcome and verification.

    Attributes:
        form: form of the action model.
        input_names, state_names, output_names: names of inputs, states and outputs.
        cost: cost of the problem.
        violation: largest violation of bounds, goal and dynamics at the nodes.
        violated: name of that row.
        iterations: iterations of the guess that led to the plan.
        guess: the guess that led to it.
        outcome: "solved", or "feasible" if the cost still changed at the last iteration.
        verification: result of the re-integration.
        bounds: limits of inputs, velocities and outputs: (quantity, name, lower, upper).
    """

    form: str
    input_names: tuple[str, ...]
    state_names: tuple[str, ...]
    output_names: tuple[str, ...]
    cost: float
    violation: float
    violated: str
    iterations: int
    guess: str
    outcome: str
    verification: PlanVerification
    bounds: tuple[tuple[str, str, float, float], ...] = ()


class PlannedOutputs:
    """Reference of outputs along a plan: quintic polynomials between its nodes, at rest after its end.

    Values, rates and accelerations are those of the plan at both ends of every interval. Where the inputs jump, rates
    or accelerations jump.

    Args:
        time: times of the nodes (K + 1,) [s].
        position, velocity, acceleration: of k outputs at the two ends of every interval, (K, 2, k).

    Example:
        >>> position, still = np.array([[[0.0], [1.0]]]), np.zeros((1, 2, 1))
        >>> reference = rnc.optimal.PlannedOutputs(np.array([0.0, 2.0]), position, still, still)
        >>> reference.at(1.0).position, reference.at(1.0).velocity  # from rest to rest, as a minimum-jerk motion
        (array([0.5]), array([0.9375]))
    """

    def __init__(self, time: Array, position: Array, velocity: Array, acceleration: Array) -> None:
        self._time, self.duration, self.size = time, float(time[-1]), position.shape[2]
        h = np.diff(time)[:, None]
        a, b = (position[:, k] for k in (0, 1))
        va, vb = (h * velocity[:, k] for k in (0, 1))
        aa, ab = (h**2 * acceleration[:, k] for k in (0, 1))
        # Coefficients of the quintic on [0, 1] in powers of the fraction of the interval.
        self._coefficients = np.stack(
            [
                a,
                va,
                aa / 2,
                10 * (b - a) - 6 * va - 4 * vb - 1.5 * aa + 0.5 * ab,
                -15 * (b - a) + 8 * va + 7 * vb + 1.5 * aa - ab,
                6 * (b - a) - 3 * va - 3 * vb - 0.5 * aa + 0.5 * ab,
            ],
            axis=1,
        )
        zero = np.zeros(self.size)
        self._first = ReferencePoint(a[0], zero, zero, zero)
        self._last = ReferencePoint(b[-1], zero, zero, zero)

    def at(self, t: float) -> ReferencePoint:
        """Values and three derivatives at a time [s]."""
        if t < 0:
            return self._first
        if t >= self.duration:
            return self._last
        k = min(int(np.searchsorted(self._time, t, side="right")) - 1, len(self._coefficients) - 1)
        h = self._time[k + 1] - self._time[k]
        s, c = (t - self._time[k]) / h, self._coefficients[k]
        powers = s ** np.arange(6)
        found = []
        for order in range(4):
            found.append(powers[: len(c)] @ c / h**order)
            c = np.arange(1, len(c))[:, None] * c[1:]
        return ReferencePoint(*found)


@dataclass(frozen=True)
class MotionPlan:
    """Planned motion over K intervals. ``rnc.optimal.plan`` returns it.

    Attributes:
        time: times of the nodes [s].
        q: configurations.
        w: reduced velocities; none, (K + 1, 0), in the kinematic form.
        u: inputs, constant over each interval: v2, v2_dot or T.
        K: gains of the feedback ``u + K dx``, with dx the state minus its plan along the tangent space; from the
            Riccati recursion with the costs of the plan. Inputs at a bound have no feedback.
        position, velocity, acceleration: reducing and vertical outputs at both ends of every interval.
        info: names, cost, outcome and verification.

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")]).reduce(
        ...     [rnc.FrameSpeed("sleigh"), rnc.FrameYaw("sleigh")])
        >>> goal = {rnc.FramePosition("sleigh", "xy"): [1.0, 0.5], rnc.FrameYaw("sleigh"): 0.0}
        >>> plan = rnc.optimal.plan(reduced, robot.configuration(), goal, 4.0, form="kinematic")
        >>> plan.info.outcome, plan.u.shape
        ('solved', (40, 2))
    """

    time: Float[Array, " K1"]
    q: Float[Array, "K1 nq"]
    w: Float[Array, "K1 nw"]
    u: Float[Array, "K nu"]
    K: Float[Array, "K nu nx"]
    position: Float[Array, "K 2 k"]
    velocity: Float[Array, "K 2 k"]
    acceleration: Float[Array, "K 2 k"]
    info: PlanInfo

    def __post_init__(self) -> None:
        for name in _ARRAYS:
            getattr(self, name).setflags(write=False)

    def __repr__(self) -> str:
        i = self.info
        return (
            f"MotionPlan: {i.outcome}, {i.form}, {self.duration:.4g} s in {len(self.u)} intervals, cost {i.cost:.6g}, "
            f"{i.iterations} iterations, violation {i.verification.violation:.2g} after verification"
        )

    @property
    def duration(self) -> float:
        """Duration [s]."""
        return float(self.time[-1])

    def reference(self, outputs: str | Sequence[str] | None = None) -> PlannedOutputs:
        """Return the reference of outputs by name; of all outputs by default, reducing ones first.

        Quasi-velocities have their integral from the start.

        Raises:
            ConfigurationError: unknown output.
        """
        names = self.info.output_names
        chosen = names if outputs is None else (outputs,) if isinstance(outputs, str) else tuple(outputs)
        for name in chosen:
            if name not in names:
                raise ConfigurationError(f"no output '{name}' in the plan{nearest(name, names)}")
        k = [names.index(name) for name in chosen]
        return PlannedOutputs(self.time, self.position[:, :, k], self.velocity[:, :, k], self.acceleration[:, :, k])

    def save(self, path: str | Path) -> None:
        """Write a compressed ``.npz`` file to a path, for ``load``. An error leaves no partial file."""
        arrays = {name: getattr(self, name) for name in _ARRAYS}
        with atomic_file(Path(path)) as partial, partial.open("wb") as file:
            np.savez_compressed(file, **arrays, info=np.array(json.dumps(asdict(self.info))))

    @classmethod
    def load(cls, path: str | Path) -> MotionPlan:
        """Read a file of ``save`` from a path.

        Raises:
            ConfigurationError: the file does not exist, or is not a plan.
        """
        path = Path(path)
        try:
            arrays = read_npz(path, [*_ARRAYS, "info"], text=["info"])
            missing = [name for name in (*_ARRAYS, "info") if name not in arrays]
            if missing:
                raise ConfigurationError(f"{path}: not a plan: it has no '{missing[0]}'")
            info = _info(json.loads(str(arrays.pop("info"))))
            _check_shapes(arrays, info)
            return cls(**arrays, info=info)
        except FileNotFoundError:
            raise ConfigurationError(f"no file '{path}'") from None
        except (ArchiveError, ValueError, TypeError, KeyError) as error:
            raise ConfigurationError(f"{path}: not a plan: {error}") from None

    def plot(self, outputs: Sequence[str] | None = None) -> Figure:
        """Return a figure of outputs, their rates and the inputs over time; dashed lines are bounds.

        Args:
            outputs: names of the outputs; all by default.

        Raises:
            ConfigurationError: unknown output.
        """
        from rnc_pin.optimal.plan_figure import plan_figure  # Matplotlib takes a second to import

        return plan_figure(self, list(self.info.output_names if outputs is None else outputs))


def _info(given: dict[str, Any]) -> PlanInfo:
    verification = PlanVerification(**given.pop("verification"))
    known = {each.name for each in fields(PlanInfo)} - {"verification"}
    if set(given) != known:
        raise ConfigurationError(f"not a plan: fields {sorted(set(given) ^ known)}")
    given["bounds"] = tuple(map(tuple, given["bounds"]))
    values: dict[str, Any] = {name: tuple(value) if isinstance(value, list) else value for name, value in given.items()}
    return PlanInfo(**values, verification=verification)


def _check_shapes(arrays: dict[str, Array], info: PlanInfo) -> None:
    K, nu, k = len(arrays["u"]), len(info.input_names), len(info.output_names)
    expected: dict[str, tuple[int, ...]] = {"time": (K + 1,), "u": (K, nu), "K": (K, nu, len(info.state_names))}
    expected |= dict.fromkeys(("position", "velocity", "acceleration"), (K, 2, k))
    for name, shape in expected.items():
        if arrays[name].shape != shape:
            raise ConfigurationError(f"not a plan: '{name}' has shape {arrays[name].shape}, expected {shape}")
    for name in ("q", "w"):
        if arrays[name].ndim != 2 or len(arrays[name]) != K + 1:
            raise ConfigurationError(f"not a plan: '{name}' has shape {arrays[name].shape}")
    for name in _ARRAYS:
        if not np.isfinite(arrays[name]).all():
            raise ConfigurationError(f"not a plan: '{name}' is not finite")
