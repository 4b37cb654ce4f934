"""Nonholonomic mechanical system: robot, constraints and actuators. Paper (1).

A system decides once which constraint rows are kept, by ``independence.select_independent`` at sampled configurations.
Where a row of E depends on the others by more than 1e3, one over the sine of its angle to them, ``factorization`` looks
at one state again. The basis of each new chart of the reduced plant (``VelocityChart``) follows the rows chosen there.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import TypeVar

import numpy as np

from rnc_pin.errors import ConstraintError, SingularityError, argument, check_unique, few, warn
from rnc_pin.math.linear_algebra import null_space
from rnc_pin.model import independence
from rnc_pin.model.assembly import Assembly
from rnc_pin.model.evaluator import evaluator_for
from rnc_pin.model.generalized_forces import Actuation, Actuators, ForceKind, PassiveForces
from rnc_pin.model.input_validation import numbers_of
from rnc_pin.model.kinematics import Kinematics
from rnc_pin.model.reduced_model import ReducedModel, system_headline, system_lines
from rnc_pin.model.reduction_data import ReductionData, VelocityRows, best_entries
from rnc_pin.model.relative_rows import CouplingRow, is_loose, mimic_row, mimic_rows
from rnc_pin.model.rows import ConstraintKind, FrameAnchor, OutputKind, OutputStack, Rows, RowStack
from rnc_pin.printing import ObjectSummary, SummaryMixin
from rnc_pin.robots.joint_values import base_of, fixed_base
from rnc_pin.robots.model_checks import flat_links
from rnc_pin.robots.robot import Robot

_Kind = TypeVar("_Kind", ConstraintKind, OutputKind, ForceKind)

_SAMPLES = 12
_THIN = 1e-3  # smallest singular value of unit rows below which a warning is given


class NonholonomicSystem(SummaryMixin):
    """System ``B T + f = H* vdot + C* v + g* + A^T lambda`` with constraints ``A v = 0``, or affine ``A v = mu(q)``.

    A maximal independent set of the constraint rows is kept. ``dropped_rows`` lists the redundant rows with the
    reasons. Rows that are dependent to rounding count as dependent. Nearly dependent rows count as independent. A
    ``ModelWarning`` names both. The rank is computed at configurations that satisfy the holonomic rows: at any, or if
    it differs among them, at those near the neutral one.

    Args:
        robot: the robot.
        constraints: kinds from ``rnc_pin.constraints``, or objects with ``bind(robot) -> Rows``.
        actuators: joint names, ``FrameForce``, ``FrameTorque``; or a matrix (nv, p); or ``B(q)``.
        mimic: True to add rows like those of ``JointCoupling`` for the mimic joints of the robot's file
            (``robot.mimics``) that the constraints do not couple already. If one of two coupled joints is locked, the
            other is held at the position that follows.
        forces: forces f that follow from the state, kinds from ``rnc_pin.forces``. Potentials count as energy.
        may_stop: True if the constraints may leave no motion, as contacts that hold a body fast.

    Attributes:
        n: number of degrees of freedom before the constraints (nv).
        m: number of independent constraint rows.
        p: number of actuators.
        kinds: the given constraints.
        rows: all constraint rows; ``kept``: indices of the independent ones, (m,).
        constraints: the independent rows.
        dropped_rows: the other rows, with reasons.
        row_margin: smallest singular value of the kept rows, of unit length, at the sampled configuration where it is
            largest; angles count times the longest lever arm of the rows.
        nearly_dependent_rows: names of the kept rows that nearly depend on others; empty if ``row_margin`` is large.
        assembly: projection onto the holonomic rows, dropped ones included.

    Raises:
        ModelError: unknown joint or frame.
        ConstraintError: rank that varies with the configuration; constraints that leave no motion (unless they
            ``may_stop`` the robot) or contradict each other; or an actuator, a force or a reaction that changes a
            conserved momentum.

    Example:
        >>> robot = rnc.Robot.from_urdf("differential_drive.urdf", base="planar")
        >>> wheels = [rnc.RollingWheel("left_wheel", 0.2), rnc.RollingWheel("right_wheel", 0.2)]
        >>> system = rnc.NonholonomicSystem(robot, wheels, ["left_wheel_joint", "right_wheel_joint"])
        >>> system.constraints.names
        ('rolling(left_wheel)', 'lateral(left_wheel)', 'rolling(right_wheel)')
        >>> [row.name for row in system.dropped_rows]
        ['vertical(left_wheel)', 'lateral(right_wheel)', 'vertical(right_wheel)']
    """

    def __init__(
        self,
        robot: Robot,
        constraints: Sequence[ConstraintKind] = (),
        actuators: Actuators = (),
        mimic: bool = True,
        forces: Sequence[ForceKind] = (),
        may_stop: bool = False,
    ) -> None:
        robot.check_unchanged()
        self.robot = robot
        if isinstance(actuators, list | np.ndarray):  # the caller may change it
            actuators = actuators.copy()
        self.actuation = Actuation(actuators, robot)
        self.forces = PassiveForces(_kinds(forces, "forces"), robot)
        # Systems with further constraints are built again from these: their rank and checks are new.
        self._given = actuators, mimic, tuple(forces)
        self.kinds = tuple(_kinds(constraints, "constraints"))
        blocks, unnamed = list[Rows](), 0
        for kind in self.kinds:
            block = kind.bind(robot)
            block.kind = kind
            if block.unnamed:  # rows without names are numbered through all blocks
                block.names = tuple(f"row[{unnamed + row}]" for row in range(len(block.names)))
                unnamed += len(block.names)
            blocks.append(block)
        if mimic and robot.mimics:
            # A loop or a gear of the user may hold what a mimic joint repeats: one of both rows would be dependent.
            blocks += _not_implied(mimic_rows(robot, blocks), robot, blocks)
        self.rows = RowStack(blocks)
        check_unique(self.rows.names, "duplicate constraint row", ConstraintError)
        self.assembly = Assembly(robot, blocks)
        coupled = [name for block in blocks[len(self.kinds) :] for name in block.names]
        try:
            # The rank of the rows is that of assembled configurations: elsewhere loops are open.
            samples, found = self._selected(coupled)
        except independence.RankError:  # the rank counts where the robot can be, and not upside down
            if base_of(robot.model) == "free" and (flat := flat_links(robot.model)):
                planar = argument("base", "planar")
                why = "have a moment of inertia about one axis only, so that its motion in space has no inertia"
                raise ConstraintError(
                    f"robot '{robot.name}': {few(flat)} {why}: give all moments, or {planar}"
                ) from None
            near = 0.3  # [rad or m] from the neutral configuration
            samples, found = self._selected(coupled, near)
        self.kept, self.dropped_rows = found.kept, found.dropped
        self.row_margin = found.margin
        self.nearly_dependent_rows = tuple(found.weak) if found.margin < _THIN else ()
        merged = {row.name: row.rounding for row in self.dropped_rows if row.rounding}
        if merged:
            # Now that dependent rows are known, the projection leaves them to the independent ones.
            self.assembly = Assembly(robot, blocks, merged)
        self.constraints = RowStack(blocks, self.kept)
        self.n, self.m, self.p = robot.nv, self.constraints.size, self.actuation.size
        if self.m >= self.n and not may_stop:
            omitted = "mimic=False (mimic: false) omits them"
            hint = f"; {few(coupled)} come from the robot's file, {omitted}" if coupled else ""
            raise ConstraintError(
                f"{self.m} independent constraint rows leave no motion of {self.n} degrees of freedom"
                f"{hint}{self._still(self.rows)}"
            )
        independence.check_momenta(blocks, self.actuation, self.forces, robot, self._samples)
        for doubt in _doubts(robot, blocks, samples[:, self.kept], found):
            warn(f"robot '{robot.name}': {doubt}")

    def _selected(self, couplings: Sequence[str], spread: float = np.pi) -> tuple[np.ndarray, independence.Selection]:
        """All rows (samples, k, nv) at sampled configurations, and the independent ones."""
        # One set of configurations for all tests, so that rank, scales and regularity speak of the same places.
        self._samples = self.assembly.samples(_SAMPLES, spread)
        samples, rates = _sample_rows(self.rows, self.robot, self._samples)
        lengths = independence.block_row_scales(self.rows, samples)  # relative to which rows count as zero
        # Before the selection: it might drop the very row that tells the contradiction.
        independence.check_reactions(self.rows, samples, lengths, couplings)
        angular = np.array([unit == "rad/s" for unit in self.robot.velocity_units])
        mu = rates if self.rows.affine else None
        return samples, independence.select_independent(samples, self.rows.names, mu, lengths, angular)

    def with_constraints(self, constraints: Sequence[ConstraintKind], may_stop: bool = False) -> NonholonomicSystem:
        """The same robot, actuators and forces with further constraints.

        Args:
            constraints: constraints in addition to those of this system.
            may_stop: True if all of them together may leave no motion.
        """
        return NonholonomicSystem(self.robot, [*self.kinds, *constraints], *self._given, may_stop)

    def with_robot(self, robot: Robot, constraints: Sequence[ConstraintKind]) -> NonholonomicSystem:
        """The same actuators and forces on another robot, e.g. one with calibrated numbers.

        Args:
            robot: the robot, with the same names.
            constraints: its constraints.
        """
        return NonholonomicSystem(robot, constraints, *self._given)

    @property
    def r(self) -> int:
        """Number of reducing outputs that a reduction needs: n - m."""
        return self.n - self.m

    def assembled(self, q: np.ndarray, hold: Sequence[str] = ()) -> np.ndarray:
        """Return a configuration near q that satisfies the holonomic rows: loops closed, wheels on the ground.

        Args:
            q: one configuration (nq,).
            hold: names of joints that keep their positions.

        Raises:
            ConstraintError: no such configuration was found.
        """
        return self.assembly.project(numbers_of(q, "q"), hold)

    def reduce(
        self,
        reducing: Sequence[OutputKind] | None = None,
        vertical: Sequence[OutputKind] = (),
        singularity_limit: float = 1e8,
    ) -> ReducedModel:
        """Reduce to the velocities of chosen outputs: paper (2)-(3), (6)-(7).

        If you only need the dynamics, omit the outputs. Then the reduced velocities are the entries of v that best
        parametrise the motion, ``reduced.reducing.names``. At configurations where they are dependent, other entries
        replace them, and ``reduced.at(q).J2`` shows which.

        Args:
            reducing: outputs x2 with n - m rows in total, whose rates parametrise the motion.
            vertical: outputs x1 that follow kinematically, ``x1dot = A_star x2dot``.
            singularity_limit: largest dependence of a row of ``[A; J2]`` (one over the sine of its angle to the
                others); above it, ``SingularityError`` is raised.

        Raises:
            ConstraintError: not n - m reducing outputs, a duplicate output, or outputs that are dependent everywhere.
        """
        self.robot.check_unchanged()
        x1 = OutputStack([kind.bind(self.robot) for kind in _kinds(vertical, "vertical outputs")])
        free = reducing is None
        named = () if reducing is None else _kinds(reducing, "reducing outputs")
        x2 = self._entries() if free else OutputStack([kind.bind(self.robot) for kind in named])
        check_unique((*self.constraints.names, *x2.names, *x1.names), "duplicate output", ConstraintError)
        if x2.size != self.r:
            raise ConstraintError(
                f"{x2.size} reducing outputs ({', '.join(x2.names) or 'none'}), expected {self.r}: "
                f"{self.n} degrees of freedom less {self.m} of the constraints{self._still(x2)}"
            )
        lengths = independence.row_scales(self.robot, self.rows, x2, self._samples)
        rest = singularity_limit, lengths, Kinematics(self.robot), self.forces, free
        data = ReductionData(self.robot, self.rows, tuple(self.kept), self.actuation, x2, x1, *rest)
        reduced = ReducedModel(evaluator_for(data), self.assembly, self.dropped_rows)
        if not free:
            self._check_regular(reduced)
        return reduced

    def _summary(self) -> ObjectSummary:
        title = system_headline("NonholonomicSystem", self.robot, self.constraints)
        lines = system_lines(self.constraints, self.dropped_rows, self.actuation, self.forces)
        return ObjectSummary(title, lines)

    def _entries(self) -> OutputStack:
        """Entries of v that parametrise the motion well at every sampled configuration."""
        if not self.r:
            return OutputStack([])
        # Any basis will do: how well entries parametrise it depends on the space only.
        found = independence.defined_jacobians(self.constraints, self.robot, self._samples)
        bases = [(A, null_space(A)) for _, A in found]

        def worst(entries: list[int]) -> float:
            return min(float(np.linalg.svd(basis[entries], compute_uv=False)[-1]) for _, basis in bases)

        # Each sample proposes the entries that are best there; the sample where they are worst decides.
        best = max((best_entries(A, self.r) for A, _ in bases), key=worst)
        names, units = self.robot.velocity_names, self.robot.velocity_units
        rows = VelocityRows(np.eye(self.n)[best], [names[k] for k in best], [units[k] for k in best])
        return OutputStack([rows])

    def _check_regular(self, reduced: ReducedModel) -> None:
        """Raise an error if the outputs are dependent at every sampled configuration: this is a modeling mistake."""
        failures = []
        for q in self._samples:
            try:
                # One regular sample is enough: outputs may be singular somewhere, and the run tells where.
                _ = reduced.at(q, t=0.0).R
                return
            except SingularityError as error:
                failures.append(error)
        raise ConstraintError(
            "the reducing outputs do not parametrise the motion: at every sampled configuration the rows "
            f"{', '.join(failures[0].rows)} are dependent{self._still(reduced.reducing)}"
        )

    def _still(self, rows: RowStack) -> str:
        """Hint if the base is fixed and rows are zero at all sampled configurations, because their links rest."""
        if base_of(self.robot.model) != "fixed":
            return ""
        moving, at_rest = np.zeros(rows.size, dtype=bool), 1e-12  # largest entry of a row that no joint moves
        for _, jacobian in independence.defined_jacobians(rows, self.robot, self._samples):
            moving |= np.abs(jacobian).max(axis=1, initial=0.0) > at_rest
        names = [name for name, moves in zip(rows.names, moving, strict=True) if not moves]
        return f"; no joint moves {few(names)}: {fixed_base(self.robot.model)}" if names else ""


def _kinds(kinds: Sequence[_Kind], what: str) -> Sequence[_Kind]:
    """Return the kinds; raise an error for a single kind, and for an entry that is none."""
    if hasattr(kinds, "bind") or isinstance(kinds, str) or not isinstance(kinds, Iterable):
        raise ConstraintError(f"{what}: expected a list, found {kinds!r}")
    kinds = tuple(kinds)
    for place, kind in enumerate(kinds):
        if not hasattr(kind, "bind") or isinstance(kind, type):
            raise ConstraintError(f"{what}[{place}]: expected an object with bind(robot), found {kind!r}")
    return kinds


def _sample_rows(rows: RowStack, robot: Robot, configurations: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows (samples, k, nv) and mu (samples, k), without configurations at which they are undefined."""
    samples, rates = list[np.ndarray](), list[np.ndarray]()
    for position, out in independence.defined_jacobians(rows, robot, configurations):
        mu = rows.rate(position)
        # NaN would pass the rank test as any number, and make every evaluation NaN later.
        finite = np.isfinite(out).all(axis=1) & np.isfinite(mu)
        if not finite.all():
            bad = rows.names[int(np.argmin(finite))]
            raise ConstraintError(f"constraint row '{bad}' is not finite at q = {np.round(position.q, 4).tolist()}")
        samples.append(out)
        rates.append(mu)
    if not samples:
        raise ConstraintError(f"constraints {', '.join(rows.names)} are undefined at every sampled configuration")
    return np.stack(samples), np.stack(rates)


def _not_implied(couplings: Sequence[CouplingRow], robot: Robot, blocks: Sequence[Rows]) -> list[CouplingRow]:
    """Coupling rows of the robot's file that the given constraints do not already imply."""
    if not blocks or not couplings:
        return list(couplings)
    samples, _ = _sample_rows(RowStack(blocks), robot, Assembly(robot, blocks).samples(_SAMPLES))
    return [each for each in couplings if is_loose(each.matrix[0], samples)]


def _doubts(robot: Robot, blocks: Sequence[Rows], samples: np.ndarray, found: independence.Selection) -> Iterator[str]:
    """Texts of warnings about a system whose kept rows are ``samples`` (samples, m, nv).

    They are about mimic joints and loops of the robot's file that no constraint keeps, about rows that are dependent
    only to rounding, and about rows that are nearly dependent.
    """
    couplings = ((mimic, mimic_row(robot, mimic)) for mimic in robot.mimics)
    open_ones = (mimic for mimic, row in couplings if row is not None and is_loose(row.matrix[0], samples))
    loose = [f"{mimic.joint} (of {mimic.of})" for mimic in open_ones]
    if loose:
        yield (
            f"joints that should mimic others move independently: {few(loose)}; "
            "couple them (mimic=True, JointCoupling), or lock them together with the joints that they follow"
        )
    # Frames of one joint cannot move apart: a loop that locked joints have closed needs no rows.
    closed = [{*each.frames} for block in blocks for each in block.mechanisms() if isinstance(each, FrameAnchor)]
    loose = [
        f"{a} and {b}"
        for a, b, *_ in robot.closures
        if {a, b} not in closed and len({robot.model.frames[robot.frame_id(each)].parentJoint for each in (a, b)}) > 1
    ]
    if loose:
        yield (
            f"loops that the file closes are open: {few(loose)}; "
            "add LoopClosure(*closure) to the constraints for each closure in robot.closures"
        )
    remedy = "check for rounded angles of wheels or loops"
    merged = {row.name: row.rounding for row in found.dropped if row.rounding}
    if merged:
        largest = f"{max(merged.values()):.2g}"
        yield f"rows that depend on others except for rounding ({largest}) are dropped: {few(list(merged))}; {remedy}"
    if found.margin < _THIN:
        yield (
            f"rows are nearly dependent (smallest singular value {found.margin:.2g} at best), so the remaining motion "
            f"may not be the intended one: {few(found.weak)}; {remedy}"
        )
