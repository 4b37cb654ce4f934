"""Data of a reduction: rows, outputs, actuators, and the workspace that evaluates them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from rnc_pin.math.linear_algebra import null_space, pivot_columns
from rnc_pin.model.generalized_forces import Actuation, PassiveForces
from rnc_pin.model.kinematics import Kinematics
from rnc_pin.model.rows import ConstantRows, OutputRows, OutputStack, RowStack
from rnc_pin.robots.robot import Robot


@dataclass(frozen=True, eq=False)
class ReductionData:
    """Data of a reduction with ``E = [A; J2]``: constraint rows, reducing and vertical outputs, actuators."""

    robot: Robot
    rows: RowStack
    """All constraint rows."""
    kept: tuple[int, ...]
    """Indices of the rows that are in A by default, (m,)."""
    actuation: Actuation
    reducing: OutputStack
    """Reducing outputs x2."""
    vertical: OutputStack
    """Vertical outputs x1."""
    singularity_limit: float
    """Largest dependence of a row of E, see ``NonholonomicSystem.reduce``."""
    scales: np.ndarray
    """Typical lengths of all constraint rows, then of the reducing outputs."""
    kinematics: Kinematics
    """Workspace; reductions of the same system share it."""
    forces: PassiveForces
    free: bool = False
    """True if other reducing velocities may be selected where they are dependent, because none was named."""

    @cached_property
    def constraints(self) -> RowStack:
        """Rows kept by default."""
        return self.rows.selected(self.kept)

    @cached_property
    def stack(self) -> RowStack:
        """Rows of E."""
        return RowStack.of([*self.constraints.places, *self.reducing.places])

    @cached_property
    def n(self) -> int:
        """Degrees of freedom nv before the constraints."""
        return self.robot.nv

    @cached_property
    def m(self) -> int:
        """Number of rows of A."""
        return self.constraints.size

    @cached_property
    def r(self) -> int:
        """Number of reducing outputs."""
        return self.reducing.size

    @cached_property
    def p(self) -> int:
        """Number of actuators."""
        return self.actuation.size

    @cached_property
    def affine(self) -> bool:
        """True if the constraints move, ``A v = mu``."""
        return self.rows.affine

    @cached_property
    def rheonomic(self) -> bool:
        """True if states need the time."""
        return self.rows.rheonomic and self.kinematics.time is None

    @cached_property
    def turning(self) -> bool:
        """True if configurations need the time."""
        return self.rows.turning and self.rheonomic

    @cached_property
    def constraint_scales(self) -> np.ndarray:
        """Typical lengths of all constraint rows."""
        return self.scales[: self.rows.size]

    @cached_property
    def output_scales(self) -> np.ndarray:
        """Typical lengths of the reducing outputs."""
        return self.scales[self.rows.size :]

    @cached_property
    def lengths(self) -> np.ndarray:
        """Typical lengths of the rows of E."""
        return np.concatenate([self.constraint_scales[list(self.kept)], self.output_scales])

    @cached_property
    def has_alternatives(self) -> bool:
        """True if other rows can replace those of E where they are dependent."""
        return self.free or self.rows.size > self.m

    @cached_property
    def fast_limit(self) -> float:
        """Square of the dependence of a row from which other rows are considered."""
        # Far below the limit of an error: other rows take over before the default ones lose digits.
        choose_again = 1e3
        limit = min(choose_again, self.singularity_limit) if self.has_alternatives else self.singularity_limit
        return limit**2

    @cached_property
    def fast_length(self) -> float:
        """Sum of the squares of ``lengths``."""
        return float(self.lengths.dot(self.lengths))

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
        # Constant rows cost nothing at a state: charts of the plant are such reductions.
        reducing = OutputStack([VelocityRows(W, names, [""] * self.r)])
        scales = np.concatenate([self.constraint_scales, np.ones(self.r)])
        vertical = self.vertical if vertical is None else vertical
        return replace(self, reducing=reducing, scales=scales, free=free, vertical=vertical)

    def in_entries(self, entries: Sequence[int], free: bool = False) -> ReductionData:
        """Reduction of the same system to r entries of v.

        Args:
            entries: indices of the entries (r,).
            free: True if other entries may be selected where these are dependent.
        """
        names = [self.robot.velocity_names[k] for k in entries]
        return self.in_velocities(np.eye(self.n)[list(entries)], names, free)

    def measuring(self, vertical: OutputStack) -> ReductionData:
        """The same reduction with other vertical outputs.

        Args:
            vertical: the outputs.
        """
        return replace(self, vertical=vertical)

    def frozen(self, t: float) -> ReductionData:
        """The same reduction at time t [s].

        Args:
            t: the time [s].
        """
        return replace(self, kinematics=Kinematics(self.robot, t))

    def has_rows_of(self, other: ReductionData) -> bool:
        """True if E is that of another reduction of the same system, and regular at the same configurations.

        Args:
            other: the other reduction.
        """
        # By identity: a stack returns the same object for each choice of its rows.
        same = self.constraints is other.constraints and self.reducing is other.reducing
        return same and self.kinematics is other.kinematics and self.fast_limit == other.fast_limit

    def varies_as(self, other: ReductionData) -> bool:
        """True if the rows that are not constant are known from another reduction of the same system.

        Args:
            other: the other reduction.
        """
        # By identity: the same object has the same description for the kernel, which was compared already.
        known = {id(place.block) for stack in (other.reducing, other.vertical) for place in stack.places}
        own = (place.block for stack in (self.reducing, self.vertical) for place in stack.places)
        same = self.constraints is other.constraints and self.kinematics is other.kinematics
        return same and all(id(block) in known or isinstance(block, ConstantRows) for block in own)


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

    Args:
        rows: constraint rows.
        r: number of entries, nv - m.
    """
    basis = null_space(rows)
    tie = 1e-6  # relative preference over the next entry: otherwise rounding decides ties, differently at each state
    preference = 1.0 - tie * np.arange(len(basis))
    return sorted(pivot_columns(preference * basis.T, r)[0])
