"""Analysis report of a reduced system before control: integrability of its constraint rows, Lemma 1, redundancy.

By Frobenius' theorem, motion stays on leaves whose tangent space is the involutive closure of span(R). A row that
vanishes on the closure, not only on span(R), is the differential of a function up to a factor, given the other rows.
Besides, ``n - dim(closure)`` counts combinations of rows that are integrable, such as the difference of the rolling
rows of two wheels on an axle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np

from rnc_pin.analysis.growth import GrowthEvidence, generic_growth, regular_samples
from rnc_pin.analysis.redundancy_class import Redundancy, Singularity, classify, stack_singularities, task_singularities
from rnc_pin.io.json import Json, to_json_mapping
from rnc_pin.math.linear_algebra import unit_rows
from rnc_pin.model.coordinates import ConfigurationManifold
from rnc_pin.model.independence import DroppedRow
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.task import Task
from rnc_pin.printing import Item, ObjectSummary, SummaryMixin, counted, items, printed


@printed()
@dataclass(frozen=True)
class Integrability:
    """Integrable and nonholonomic constraint rows, with the growth vector.

    Attributes:
        growth_vector: dimensions of span(R) and its brackets, level by level.
        integrable: rows that vanish on the involutive closure.
        nonholonomic: the others.
        evidence: number of configurations with this growth vector, and its margin.
    """

    growth_vector: tuple[int, ...]
    integrable: tuple[str, ...]
    nonholonomic: tuple[str, ...]
    evidence: GrowthEvidence


def integrability(reduced: ReducedModel, configurations: Sequence[np.ndarray] | np.ndarray) -> Integrability:
    """Sort the kept constraint rows into integrable and nonholonomic, at configurations of generic growth vector.

    Args:
        reduced: the model.
        configurations: regular configurations (count, nq); ``generic_growth`` uses as many as it needs.
    """
    evidence, growths = generic_growth(reduced, configurations)
    generic = growths[0][0].vector
    clearest = max(growth.margin for growth, _ in growths)
    clear = 1e6  # margin above which a closure is accurate enough to judge rows
    growths = [(growth, q) for growth, q in growths if growth.margin >= min(clear, clearest)]
    names = reduced.constraints.names
    outside = [np.linalg.norm(unit_rows(reduced.at(q).A) @ growth.closure, axis=1) for growth, q in growths]
    leftover = np.max(outside, axis=0)
    tolerance = 1e-5  # for unit rows; the closure is as accurate as the brackets
    flat = leftover < tolerance
    integrable = tuple(name for name, each in zip(names, flat, strict=True) if each)
    nonholonomic = tuple(name for name in names if name not in integrable)
    return Integrability(generic, integrable, nonholonomic, evidence)


@dataclass(frozen=True, repr=False)
class Report(SummaryMixin):
    """Result of ``analyze``.

    Attributes:
        n, r, p: degrees of freedom, reducing outputs, actuators.
        rank: independent constraint rows, m.
        kept_rows, dropped_rows: constraint rows, the latter with reasons.
        integrable_rows: kept rows that vanish on the involutive closure of span(R); holonomic given the other rows.
        nonholonomic_rows: the other kept rows.
        growth_vector: dimensions of span(R) and its brackets, level by level, the largest over the samples.
        growth_evidence: number of samples that agree on the growth vector, its margin, and the other results.
        completely_nonholonomic: True if the growth vector reaches n.
        redundancy_class: "1", "2", "2s" or None for the task.
        redundancy: the class with x11 (``tracked``), x12 (``driven``), and the evidence.
        actuation_rank: smallest rank of ``R^T B``; below r the actuators cannot realise every F.
        unactuated: reducing outputs with a component of F that no actuator produces.
        condition: min, median and max condition number of E with unit rows.
        samples: number of sampled configurations.
        singular_samples: number of singular samples.
        singularities: singular configurations of E and A4: points on singular surfaces between samples whose
            determinants have opposite signs. If there are none, the worst samples.
        lemma1: worst residuals of Lemma 1.
        lemma1_holds: True if all residuals are at the level of rounding and finite differences.

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")], [rnc.FrameForce("sleigh", "x")])
        >>> report = rnc.analyze(system.reduce([rnc.FrameSpeed("sleigh"), rnc.FrameYaw("sleigh")]), samples=16)
        >>> report.completely_nonholonomic, report.nonholonomic_rows
        (True, ('no_side_slip(sleigh.y)',))
        >>> report.actuation_rank, report.unactuated  # one force is less than two velocities
        (1, ('sleigh_yaw',))
    """

    n: int
    r: int
    p: int
    rank: int
    kept_rows: tuple[str, ...]
    dropped_rows: tuple[DroppedRow, ...]
    integrable_rows: tuple[str, ...]
    nonholonomic_rows: tuple[str, ...]
    growth_vector: tuple[int, ...]
    growth_evidence: GrowthEvidence
    completely_nonholonomic: bool
    redundancy_class: str | None
    redundancy: Redundancy
    actuation_rank: int
    unactuated: tuple[str, ...]
    condition: dict[str, float]
    samples: int
    singular_samples: int
    singularities: tuple[Singularity, ...]
    lemma1: dict[str, float]
    lemma1_holds: bool

    def to_dict(self) -> dict[str, Json]:
        """Plain lists, numbers and strings, ready for JSON."""
        return to_json_mapping(asdict(self), "report")

    def _summary(self) -> ObjectSummary:
        less = counted(self.rank, "independent row")
        title = f"Report: {self.n} degrees of freedom less {less} leave {self.r}"
        task, short = self.redundancy, self.r - self.actuation_rank
        # Without constraint rows nothing is nonholonomic.
        whole = "completely nonholonomic" if self.rank else "every configuration: no constraint row restricts it"
        reach = whole if self.completely_nonholonomic else f"at most {self.growth_vector[-1]} of {self.n}"
        vector = f"({', '.join(map(str, self.growth_vector))}), {self.growth_evidence}"
        kinds = ["integrable" if row in self.integrable_rows else "nonholonomic" for row in self.kept_rows]
        full = f"{self.actuation_rank} of {self.r} reduced forces" + (", not fully actuated: " if short else "")
        named = f"class {self.redundancy_class}" if self.redundancy_class else "no redundancy class"
        conditions = [Item(f"{name} {value:.3g}") for name, value in self.condition.items()]
        residuals = [Item(f"{name} {value:.1e}") for name, value in self.lemma1.items()]
        singular = [Item(f"{each.matrix}: {', '.join(each.rows)}", _place(each)) for each in self.singularities]
        lines = [
            ("constraint rows", items(self.kept_rows, kinds)),
            ("rows dropped", [Item(each.name, each.reason) for each in self.dropped_rows]),
            ("reach", [Item(reach, f"growth vector {vector}")]),
            (f"actuation, {counted(self.p, 'input')}", [Item(full + ", ".join(self.unactuated))]),
            ("redundancy", [Item(named, task.reason)]),
            ("outputs that redundant motions steer", items(task.tracked)),
            ("outputs that follow from primary motions", items(task.driven)),
            (f"condition of E at {counted(self.samples - self.singular_samples, 'sample')}", conditions),
            ("singular samples", [Item(f"{self.singular_samples} of {self.samples}")]),
            ("singular or worst configurations", singular),
            (f"Lemma 1 {'holds' if self.lemma1_holds else 'DOES NOT HOLD'}, residuals", residuals),
        ]
        return ObjectSummary(title, lines)


def _place(found: Singularity) -> str:
    """Words for where a matrix is singular, or how close to it the worst sample is."""
    if not found.located:
        return f"smallest singular value {found.smallest_singular_value:.2g}"
    values = {
        name: f"({', '.join(f'{each:.3g}' for each in value)})" if isinstance(value, list) else f"{value:.3g}"
        for name, value in found.configuration.items()
    }
    most_joints = 6  # more do not fit into a line
    if len(values) > most_joints:
        return "singular"
    return "singular, e.g. at " + ", ".join(f"{name} = {value}" for name, value in values.items())


def analyze(
    reduced: ReducedModel,
    primary: Sequence[str] | None = None,
    redundant: Sequence[str] = (),
    samples: int = 64,
    seed: int = 0,
    vertical: Sequence[str] | None = None,
) -> Report:
    """Analyse a reduced system at seeded random configurations.

    Args:
        reduced: the model; a rheonomic one is analysed at time zero, ``reduced.frozen(t)`` at another time.
        primary: names of the primary reducing outputs; by default all that are not redundant.
        redundant: names of the redundant reducing outputs.
        samples: number of configurations.
        seed: of the random configurations.
        vertical: names of the vertical outputs of the task; all by default.

    Raises:
        ConfigurationError: unknown output names.
        InputError: ``samples`` is not a positive integer.
        SingularityError: every sampled configuration is singular.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")], robot.joint_names[1:])
        >>> x2 = [rnc.FramePosition("tip", "xy"), rnc.JointPosition("joint_1")]
        >>> reduced = system.reduce(reducing=x2, vertical=[rnc.JointPosition("platform")])
        >>> report = rnc.analyze(reduced, primary=["tip_x", "tip_y"], redundant=["joint_1"], samples=16)
        >>> report.redundancy_class, report.growth_vector
        ('1', (3, 4))
    """
    # Ranks and brackets belong to one moment: rows over time are taken at their start.
    reduced = reduced.frozen(0.0)
    if primary is None:
        primary = [name for name in reduced.reducing.names if name not in redundant]
    task = Task.of(reduced, primary, redundant, vertical)
    configurations = regular_samples(reduced, samples, seed)
    conditions = np.asarray(reduced.at(configurations).condition)
    # Finite differences are inaccurate next to a singular configuration: decide on the better-conditioned half.
    good = configurations[conditions <= np.median(conditions)]
    rows = integrability(reduced, configurations[np.argsort(conditions)])
    growth = rows.growth_vector
    redundancy = classify(reduced, task, good, seed)
    lemma = lemma_1_residuals(reduced, good, seed)
    tolerance = 1e-6  # of the residuals: rounding, and fourth-order differences
    held = max(lemma[name] for name in ("A R", "H - H^T", "Hdot - V - V^T", "V linear")) < tolerance
    actuation_rank, unactuated = _actuation(reduced, configurations)
    singular = stack_singularities(reduced, configurations)
    if redundancy.redundancy_class in ("1", "2"):
        # Only these classes divide by a matrix of the task.
        singular += task_singularities(reduced, task, redundancy.tracked, configurations)
    return Report(
        n=reduced.n,
        r=reduced.r,
        p=reduced.p,
        rank=reduced.m,
        kept_rows=reduced.constraints.names,
        dropped_rows=reduced.dropped_rows,
        integrable_rows=rows.integrable,
        nonholonomic_rows=rows.nonholonomic,
        growth_vector=growth,
        growth_evidence=rows.evidence,
        completely_nonholonomic=growth[-1] == reduced.n,
        redundancy_class=redundancy.redundancy_class,
        redundancy=redundancy,
        actuation_rank=actuation_rank,
        unactuated=unactuated,
        condition=dict(zip(("min", "median", "max"), np.quantile(conditions, (0.0, 0.5, 1.0)).tolist(), strict=True)),
        samples=samples,
        singular_samples=samples - len(configurations),
        singularities=tuple(singular),
        lemma1=lemma,
        lemma1_holds=bool(held and lemma["smallest eigenvalue of H"] > 0),
    )


def _actuation(reduced: ReducedModel, configurations: np.ndarray) -> tuple[int, tuple[str, ...]]:
    """Smallest rank of ``R^T B``, and the unactuated reducing outputs at that sample."""
    # Left singular vectors beyond the rank are reduced forces that no actuator gives.
    left, values, _ = np.linalg.svd(reduced.at(configurations).input_matrix)
    least = 1e-10  # of the largest singular value of R^T B
    ranks = (values > least * values[:, :1]).sum(axis=1)
    worst, rank = int(np.argmin(ranks)), int(ranks.min())
    missing = np.linalg.norm(left[worst][:, rank:], axis=1)
    missing_part = 1e-6  # of a unit force: less is rounding
    return rank, tuple(name for name, part in zip(reduced.reducing.names, missing, strict=True) if part > missing_part)


# ------------------------------------------------------------------ Lemma 1


def lemma_1_residuals(
    reduced: ReducedModel, configurations: np.ndarray, seed: int = 0, step: float = 5e-4
) -> dict[str, float]:
    """Worst residuals at configurations (count, nq) with seeded random velocities.

    The residuals are: ``A R`` with unit rows and columns; ``H - H^T`` and ``Hdot - V - V^T`` relative to their size,
    with Hdot by fourth-order differences of this step; the smallest eigenvalue of H relative to its largest; and
    ``V(2 v2) - 2 V(v2)``.

    Args:
        reduced: the model.
        configurations: regular configurations.
        seed: of the velocities.
        step: step of the differences along the direction of the velocity [rad or m]. Truncation and rounding are equal
            near the default.
    """
    count = len(configurations)
    v2 = np.random.default_rng(seed).uniform(-1, 1, (count, reduced.r))
    terms = reduced.terms(configurations, v2)
    speeds = np.linalg.norm(terms.v, axis=-1, keepdims=True)
    directions = terms.v / speeds
    space = ConfigurationManifold(reduced.robot.model)
    # Along unit velocities: fast states would otherwise take a larger step.
    moved = (space.integrate(configurations, k * step * directions) for k in (-2, -1, 1, 2))
    far_behind, behind, ahead, far_ahead = (reduced.at(q).H for q in moved)
    H_dot = (far_behind - 8 * behind + 8 * ahead - far_ahead) / (12 * step) * speeds[..., None]
    V = terms.V
    # With affine constraints V is affine in v2 instead of linear.
    resting = reduced.terms(configurations, 0 * v2).V
    doubled = reduced.terms(configurations, 2 * v2).V
    eigenvalues = np.linalg.eigvalsh(terms.H)
    # Residuals are relative to both terms of the identity, so that fast or heavy systems are judged alike.
    size = np.abs(terms.H).max(axis=(1, 2)) * speeds[:, 0] + np.abs(V).max(axis=(1, 2))
    columns = terms.R / np.linalg.norm(terms.R, axis=-2, keepdims=True)
    return {
        "A R": _worst(np.abs(unit_rows(terms.A) @ columns)),
        "H - H^T": _worst(np.abs(terms.H - terms.H.mT).max(axis=(1, 2)) / np.abs(terms.H).max(axis=(1, 2))),
        "Hdot - V - V^T": _worst(np.abs(H_dot - V - V.mT).max(axis=(1, 2)) / size),
        "V linear": _worst(np.abs(doubled - 2 * V + resting).max(axis=(1, 2)) / size),
        "smallest eigenvalue of H": float((eigenvalues[:, 0] / eigenvalues[:, -1]).min()),
    }


def _worst(array: np.ndarray) -> float:
    return float(array.max(initial=0.0))
