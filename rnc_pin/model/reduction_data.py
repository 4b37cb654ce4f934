"""Data of a reduction: rows, outputs, actuators, and the workspace that evaluates them."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress

import numpy as np

from rnc_pin.errors import SingularityError
from rnc_pin.math.linear_algebra import null_space, pivot_columns
from rnc_pin.model.actuation import Actuation
from rnc_pin.model.cached_property import cached_property
from rnc_pin.model.compiled import CompiledReduction, UsesKernel
from rnc_pin.model.kernel_comparison import compile_reduction
from rnc_pin.model.kinematics import Kinematics
from rnc_pin.model.passive_forces import PassiveForces
from rnc_pin.model.row_stack import OutputStack, RowStack
from rnc_pin.model.rows import ConstantRows, OutputRows
from rnc_pin.robots.robot import Robot

_CHOOSE_AGAIN = 1e3  # dependence of a row above which other rows are selected, if there are any
_TIE = 1e-6  # relative preference of an entry of v over the next one, to break ties


class ReductionData(UsesKernel):
    """Data of a reduction with ``E = [A; J2]``: constraint rows, reducing and vertical outputs, actuators.

    Args:
        robot: the robot.
        rows: all constraint rows.
        kept: indices of the rows that are in A by default, (m,).
        actuation: the actuators.
        reducing, vertical: the outputs x2 and x1.
        singularity_limit: largest dependence of a row of E, see ``NonholonomicSystem.reduce``.
        lengths: typical lengths of all constraint rows, then of the reducing outputs.
        free: True if other reducing velocities may be selected where they are dependent, because none was named.
        kinematics: a workspace to share with another reduction of the same system.
        compared: reduction of the same system with the same rows that vary, for which the kernel was compared.
        forces: passive forces; None for none.
        constraints: the rows kept by default, if a reduction has made them.

    Attributes:
        constraints: the rows kept by default; ``stack``: E.
        basis, multiplied: index of the columns of E^-1 that form R, and of the columns of the multipliers.
        template: E with the values of its constant rows.
        constraint_scales, output_scales: typical lengths of all constraint rows and of the reducing outputs.
        affine, rheonomic, turning: True if the constraints move; if states need the time; if configurations need it.
    """

    def __init__(
        self,
        robot: Robot,
        rows: RowStack,
        kept: Sequence[int],
        actuation: Actuation,
        reducing: OutputStack,
        vertical: OutputStack,
        singularity_limit: float,
        lengths: np.ndarray,
        free: bool = False,
        kinematics: Kinematics | None = None,
        compared: ReductionData | None = None,
        forces: PassiveForces | None = None,
        constraints: RowStack | None = None,
    ) -> None:
        self.robot, self.rows, self.kept, self.actuation = robot, rows, tuple(kept), actuation
        self.reducing, self.vertical, self.free, self._compared = reducing, vertical, free, compared
        self.forces = PassiveForces((), robot) if forces is None else forces
        if constraints is None:
            constraints = RowStack([block for block, *_ in rows.places], self.kept)
        self.constraints = constraints
        self.stack = RowStack.joined(self.constraints, reducing)
        self.n, self.m, self.r, self.p = robot.nv, self.constraints.size, reducing.size, actuation.size
        self.kinematics = Kinematics(robot) if kinematics is None else kinematics
        self.affine, self.rheonomic = rows.affine, rows.rheonomic and not self.kinematics.frozen
        self.turning = rows.turning and self.rheonomic
        self.basis, self.multiplied = (..., slice(self.m, None)), (..., slice(None, self.m))
        self.template = self.stack.template(self.n)
        self.constraint_scales, self.output_scales = lengths[: rows.size], lengths[rows.size :]
        self.lengths = np.concatenate([self.constraint_scales[list(self.kept)], self.output_scales])
        self.singularity_limit = singularity_limit
        self.has_alternatives = free or rows.size > self.m
        limit = min(_CHOOSE_AGAIN, singularity_limit) if self.has_alternatives else singularity_limit
        self.fast_limit = limit**2
        self.fast_length = float(self.lengths.dot(self.lengths))

    @cached_property
    def compiled(self) -> CompiledReduction | None:
        """Compiled kernel; None if NumPy evaluates the reduction."""
        return compile_reduction(self, self._compared is None or self._compared.compiled is None)

    def rows_changed(self) -> None:
        """Read the parameters of constraint rows again; call it after a change of e.g. the radius of a wheel."""
        if self.compiled is not None:
            self.compiled.refresh()

    def in_velocities(
        self, W: np.ndarray, names: Sequence[str] = (), free: bool = False, vertical: OutputStack | None = None
    ) -> ReductionData:
        """Reduction of the same system to velocities ``W v``, with constant W (r, nv) and rows of unit length.

        Args:
            W: matrix (r, nv).
            names: names of the velocities.
            free: True if other velocities may be selected where these are dependent.
            vertical: other vertical outputs; by default those of this reduction.
        """
        names = names or [f"w[{k}]" for k in range(self.r)]
        reducing = OutputStack([VelocityRows(W, names, [""] * self.r)])
        known = {id(place.block) for stack in (self.reducing, self.vertical) for place in stack.places}
        rows_are_known = vertical is None or all(id(place.block) in known for place in vertical.places)
        return self._with(self.kept, reducing, np.ones(self.r), free, vertical, self if rows_are_known else None)

    def in_entries(self, entries: Sequence[int], free: bool = False) -> ReductionData:
        """Reduction of the same system to r entries of v."""
        names = [self.robot.velocity_names[k] for k in entries]
        return self.in_velocities(np.eye(self.n)[list(entries)], names, free)

    def keeping(self, kept: Sequence[int]) -> ReductionData:
        """The same reduction with other constraint rows in A, (m,)."""
        return self._with(kept, self.reducing, self.output_scales, self.free)

    def measuring(self, vertical: OutputStack) -> ReductionData:
        """The same reduction with other vertical outputs."""
        return self._with(self.kept, self.reducing, self.output_scales, self.free, vertical)

    def has_rows_of(self, other: ReductionData) -> bool:
        """True if E is that of another reduction of the same system, and regular at the same configurations."""
        same = self.constraints is other.constraints and self.reducing is other.reducing
        return same and self.kinematics is other.kinematics and self.fast_limit == other.fast_limit

    def frozen(self, t: float) -> ReductionData:
        """The same reduction at time t [s]."""
        kinematics = Kinematics(self.robot, t)
        return self._with(self.kept, self.reducing, self.output_scales, self.free, kinematics=kinematics)

    def _with(
        self,
        kept: Sequence[int],
        reducing: OutputStack,
        lengths: np.ndarray,
        free: bool,
        vertical: OutputStack | None = None,
        compared: ReductionData | None = None,
        kinematics: Kinematics | None = None,
    ) -> ReductionData:
        return ReductionData(
            self.robot,
            self.rows,
            kept,
            self.actuation,
            reducing,
            self.vertical if vertical is None else vertical,
            self.singularity_limit,
            np.concatenate([self.constraint_scales, lengths]),
            free,
            self.kinematics if kinematics is None else kinematics,
            compared,
            self.forces,
            self.constraints if kept is self.kept else None,
        )


class VelocityRows(ConstantRows, OutputRows):
    """Quasi-velocities ``W v`` with constant W.

    Args:
        W: matrix (k, nv).
        names, units: names and units of the rows, (k,).
    """

    quasi = True

    def __init__(self, W: np.ndarray, names: Sequence[str], units: Sequence[str]) -> None:
        self.matrix = W
        self.names, self.units, self.angular = tuple(names), tuple(units), (False,) * len(W)


def best_entries(rows: np.ndarray, r: int) -> list[int]:
    """Indices of the r entries of v that best parametrise the motion under rows (m, nv) of full rank.

    Column-pivoted QR selects these rows of an orthonormal basis of the null space, so the other entries are moderate
    combinations of them. If entries are equally good, e.g. of coupled joints, the first is selected.
    """
    basis = null_space(rows)
    preference = 1.0 - _TIE * np.arange(len(basis))  # otherwise rounding decides ties, differently at each state
    return sorted(pivot_columns(preference * basis.T, r)[0])


def row_scales(robot: Robot, rows: RowStack, reducing: OutputStack, configurations: np.ndarray) -> np.ndarray:
    """Typical length of each row: the median over configurations (count, nq), or the largest if the median is zero.

    It is zero for a row that is zero to rounding, e.g. the out-of-plane row of a planar loop.
    """
    stack = RowStack.joined(rows, reducing)
    kinematics = Kinematics(robot)
    found = []
    for q in configurations:
        with suppress(SingularityError):  # some row is undefined at q
            found.append(np.linalg.norm(stack.jacobian(kinematics.position(q)), axis=-1))
    lengths = np.array(found) if found else np.zeros((1, stack.size))
    lengths = np.where(lengths > 1e-12 * lengths.max(initial=0.0), lengths, 0.0)
    ordered, count = np.sort(lengths, axis=0), len(lengths)
    typical = (ordered[(count - 1) // 2] + ordered[count // 2]) / 2.0  # ``np.median`` would import ``numpy.ma``
    return np.where(typical > 0, typical, lengths.max(axis=0))
