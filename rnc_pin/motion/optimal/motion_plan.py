"""Result of optimal control: states, inputs, feedback gains, references of the outputs, and their verification."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from rnc_pin.array_shapes import Array, Float
from rnc_pin.errors import ConfigurationError, place_of
from rnc_pin.io.json import atomic_file
from rnc_pin.io.safe_npz import ArchiveError, read_npz
from rnc_pin.printing import Line, ObjectSummary, SummaryMixin, described, items, printed, record_summary
from rnc_pin.references.reference import PiecewisePolynomial
from rnc_pin.verdict import Finding, Verdict

_HIGHEST = [[-6, 6, -3, -3, -0.5, 0.5], [15, -15, 8, 7, 1.5, -1], [-10, 10, -6, -4, -1.5, 0.5]]
_QUINTIC = np.vstack([_HIGHEST, np.eye(6)[[4, 2, 0]]])
_QUINTIC[3] /= 2
"""Coefficients in powers of the fraction of an interval, highest first, by values, rates and accelerations at ends."""
_ARRAYS = ("time", "q", "w", "u", "K", "position", "velocity", "acceleration")


@printed(at="s")
@dataclass(frozen=True)
class Integration:
    """Result of one re-integration of a plan.

    Attributes:
        violation: largest violation of a bound or of the goal [its unit]; infinite if the integration fails.
        name: name of that row; "" without a violation.
        at: its time [s].
        deviation: largest difference between the integrated and the planned states, at nodes or samples.
    """

    violation: float
    name: str
    at: float
    deviation: float


@printed()
@dataclass(frozen=True)
class PlanVerification:
    """Results of re-integrations of a plan: of the inputs alone with a fine step, and of the sampled loop.

    Attributes:
        inputs: integration of the inputs without feedback.
        feedback: integration of the loop that will run; None if the inputs alone decide.
        substeps: integrator steps in each interval, without feedback.
        dt: sampling period of the loop [s].
    """

    inputs: Integration
    feedback: Integration | None
    substeps: int
    dt: float

    @property
    def decisive(self) -> Integration:
        """The integration by which the plan is judged: that with feedback if there is one."""
        return self.inputs if self.feedback is None else self.feedback

    @property
    def violation(self) -> float:
        """Largest violation of a bound or of the goal in the integration that decides [its unit]."""
        return self.decisive.violation


@printed()
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
        outcome: "solved"; "feasible" if the cost still changed at the last iteration; "unverified" if the verification
            found a violation above the accuracy. ``rnc.optimal.plan`` raises an error that carries such a plan.
        verification: results of the re-integrations.
        accuracy: largest violation that the verification accepts.
        guesses: number of guesses that were tried.
        solutions: number of guesses that led to a motion within tolerance.
        bounds: limits of inputs, velocities and outputs: (quantity, name, lower, upper).
        findings: findings of the verification.
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
    accuracy: float
    guesses: int = 1
    solutions: int = 1
    bounds: tuple[tuple[str, str, float, float], ...] = ()
    findings: tuple[Finding, ...] = ()


class PlannedOutputs(PiecewisePolynomial):
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
        h = np.diff(time)[:, None, None]
        # Rates by the fraction of an interval: the matrix of the quintic then has numbers only.
        ends = np.concatenate([position, h * velocity, h**2 * acceleration], axis=1)
        quintic = np.einsum("ij,kjm->ikm", _QUINTIC, ends)
        coefficients = quintic / h[:, 0] ** np.arange(5, -1, -1)[:, None, None]
        super().__init__(coefficients, time, float(time[0]), float(time[-1]))


@dataclass(frozen=True, repr=False)
class MotionPlan(SummaryMixin):
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
            # A plan is shared: controllers, pages and sweeps read the same arrays.
            getattr(self, name).setflags(write=False)

    def _summary(self) -> ObjectSummary:
        checked = f"violation {self.info.verification.violation:.2g} after verification"
        title = f"MotionPlan: {self.verdict.headline}, {checked}, {self.duration:.4g} s in {len(self.u)} intervals"
        end = items(self.info.output_names, [f"{value:.4g}" for value in self.position[-1, 1]])
        lines: list[Line] = [("outputs at the end [m or rad]", end), ("q at the end [rad or m]", described(self.q[-1]))]
        return ObjectSummary(title, [*lines, *record_summary(self.info, {}).lines])

    @property
    def duration(self) -> float:
        """Duration [s]."""
        return float(self.time[-1])

    @property
    def verdict(self) -> Verdict:
        """Verdict of the verification: findings about the goal, limits, distances, and what was assumed."""
        return Verdict.of(self.info.findings)

    def reference(self, outputs: str | Sequence[str] | None = None) -> PlannedOutputs:
        """Return the reference of outputs by name; of all outputs by default, reducing ones first.

        Quasi-velocities have their integral from the start.

        Raises:
            ConfigurationError: unknown output.
        """
        names = self.info.output_names
        chosen = names if outputs is None else (outputs,) if isinstance(outputs, str) else tuple(outputs)
        k = [place_of(name, names, "the plan has no output") for name in chosen]
        return PlannedOutputs(self.time, self.position[:, :, k], self.velocity[:, :, k], self.acceleration[:, :, k])

    def save(self, path: str | Path) -> None:
        """Write a compressed ``.npz`` file to a path, for ``load``. An error leaves no partial file."""
        arrays = {name: getattr(self, name) for name in _ARRAYS}
        # A file object, because NumPy would add an ending to the temporary name.
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
            info = _info(str(arrays.pop("info")))
            _check_shapes(arrays, info)
            return cls(**arrays, info=info)
        except FileNotFoundError:
            raise ConfigurationError(f"no file '{path}'") from None
        except KeyError as error:
            raise ConfigurationError(f"{path}: not a plan: it has no {error}") from None
        except (ArchiveError, ValueError, TypeError) as error:
            raise ConfigurationError(f"{path}: not a plan: {error}") from None


def _info(text: str) -> PlanInfo:
    from pydantic import TypeAdapter, ValidationError  # plans that read no file start without it

    try:
        return TypeAdapter(PlanInfo).validate_python(json.loads(text))
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        raise ConfigurationError(f"not a plan: {'.'.join(map(str, first['loc']))}: {first['msg']}") from None


def _check_shapes(arrays: dict[str, Array], info: PlanInfo) -> None:
    K, nu, k = len(arrays["u"]), len(info.input_names), len(info.output_names)
    expected: dict[str, tuple[int, ...]] = {"time": (K + 1,), "u": (K, nu), "K": (K, nu, len(info.state_names))}
    expected |= dict.fromkeys(("position", "velocity", "acceleration"), (K, 2, k))
    expected |= {name: (K + 1, arrays[name].size // (K + 1)) for name in ("q", "w")}  # rows of any length
    for name, shape in expected.items():
        if arrays[name].shape != shape:
            raise ConfigurationError(f"not a plan: '{name}' has shape {arrays[name].shape}, expected {shape}")
        if not np.isfinite(arrays[name]).all():
            raise ConfigurationError(f"not a plan: '{name}' is not finite")
