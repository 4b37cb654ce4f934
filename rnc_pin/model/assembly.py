"""Configurations that satisfy the holonomic rows: loops closed, wheels on the ground, joints geared."""

from __future__ import annotations

import copy
from collections.abc import Collection, Sequence
from contextlib import suppress

import numpy as np
import pinocchio as pin
from numpy import ndarray as Array

from rnc_pin.errors import ConstraintError, InputError, SingularityError
from rnc_pin.math.linear_algebra import Component
from rnc_pin.model.independence import ROUNDING, TOLERANCE, block_row_scales, defined_jacobians, select_independent
from rnc_pin.model.kinematics import Kinematics, PositionKinematics
from rnc_pin.model.rows import Rows, RowStack
from rnc_pin.robots.robot import Robot

_STEPS = 100  # of the projection, at most
_GOOD = 1e-11  # residual below which rows are satisfied [m or rad]
_FAR = 1e-3  # residual that is not small [m or rad]: the iteration does not converge, or the rows are out of reach


class Assembly:
    """Gauss-Newton projection onto the holonomic constraints, in the metric of the inertia matrix M.

    The step is ``dq = -M^-1 A^T (A M^-1 A^T)^+ residual``. It is M-orthogonal to every velocity that the holonomic
    rows allow, so a correction has no momentum along the remaining motion. Dependent rows, e.g. of planar loops, are
    allowed: if the independent rows are satisfied, the dependent rows are too, to the rounding of a file's numbers.

    Args:
        robot: the robot that has the configurations.
        blocks: bound rows; rows that are not holonomic, and rows ``on_ground`` that no joint moves, are omitted.
        merged: names of rows that depend on others to rounding, in addition to rows that do so at any configuration.

    Attributes:
        names: names of the holonomic rows, (h,).
        size: number h of holonomic rows.
        leading: mask (h,) of the rows that are corrected; the others depend on them, at least to a file's rounding.
    """

    def __init__(self, robot: Robot, blocks: Sequence[Rows], merged: Collection[str] = ()) -> None:
        self.robot = robot
        self._kinematics = Kinematics(robot)
        kept = list[int]()
        for block, where, _ in RowStack(blocks).places:
            rows = np.flatnonzero(block.holonomic)
            if block.on_ground and len(rows):
                # Heights that no joint changes, as of a planar base, are facts of the model and no equations.
                rows = rows[self._moving(block)[rows]]
            kept += (where.start + rows).tolist()
        self._rows = RowStack(blocks, kept)
        self.names, self.size = self._rows.names, self._rows.size
        dependent = {*merged, *self._dependent()} if self.size > 1 else set()
        self.leading = np.array([name not in dependent for name in self.names], dtype=bool)

    def frozen(self, t: float) -> Assembly:
        """The same rows at time t [s].

        Args:
            t: the time [s].
        """
        found = copy.copy(self)
        found._kinematics = Kinematics(self.robot, t)
        return found

    def residual(self, q: Array, t: Component | None = None) -> Array:
        """Residual (..., h) of the holonomic rows at configurations (..., nq) and times t (...) [m or rad].

        Args:
            q: configurations (..., nq).
            t: times (...) [s]; zero, or that of a frozen model, by default.
        """
        return self._rows.residual(self._kinematics.position(q, t))

    def rank(self, q: Array) -> int:
        """Rank of the holonomic rows at a configuration (nq,).

        Args:
            q: one configuration (nq,).
        """
        return int(np.linalg.matrix_rank(self.jacobian(self._kinematics.position(q)), rtol=TOLERANCE))

    def worst(self, q: Array) -> tuple[str, float]:
        """Name of the row with the largest residual, and this residual [m or rad].

        Args:
            q: one configuration (nq,).
        """
        residual = self.residual(q)
        row = int(np.argmax(np.abs(residual)))
        return self.names[row], float(residual[row])

    def project(self, q: Array, hold: Sequence[str] = (), t: float | None = None) -> Array:
        """Return a configuration (nq,) near q that satisfies the rows; q itself if it satisfies them.

        Args:
            q: initial configuration (nq,).
            hold: names of joints that keep their positions.
            t: time, for rheonomic rows [s]; zero, or that of a frozen model, by default.

        Raises:
            InputError: q is not one configuration of finite numbers.
            ModelError: unknown joint.
            ConstraintError: no such configuration was found; the message names the worst row and its residual.
        """
        if q.shape != (self.robot.nq,) or not np.isfinite(q).all():
            raise InputError(
                f"expected one configuration of {self.robot.nq} finite numbers, found shape {q.shape}: {q}"
            )
        found, residual, closed = self._closest(q, hold, t)
        if not closed:
            raise ConstraintError(
                f"no configuration near q satisfies {', '.join(self.names)}: {_worst_row(self, residual)}"
            )
        return found

    def remedy(self, name: str) -> str:
        """Proposal for a row that is not satisfied: on a ball as ground, bodies roll outside. Empty without one.

        Args:
            name: name of the row.
        """
        grounds = (getattr(block.kind, "ground", None) for block, *_ in self._rows.places if name in block.names)
        outside = any(getattr(each, "inside", False) for each in grounds)
        return "; its ground is hollow: inside=False if bodies roll on the outside of a ball or pipe" if outside else ""

    def _closest(
        self, q: Array, hold: Sequence[str] = (), t: float | None = None, steps: int = _STEPS
    ) -> tuple[Array, Array, bool]:
        """Configuration near q, its residual (h,), and True if the rows are satisfied.

        Args:
            q: initial configuration (nq,).
            hold: names of joints that keep their positions.
            t: time, for rheonomic rows [s].
            steps: largest number of steps that are the shortest by kinetic energy.
        """
        if not self.size:
            return q, np.zeros(0), True
        free = np.ones(self.robot.nv, dtype=bool)
        # Joints that are held have no columns in the step: the others alone close the loop.
        for joint in hold:
            free[self.robot.velocity_indices(joint)] = False
        # Rows that depend on others to the rounding of a file's numbers cannot be closer than that rounding.
        rounded, everything = 1e-4, np.ones(self.size, dtype=bool)  # [m or rad]
        attempts = [(self.leading, np.where(self.leading, _GOOD, rounded)), (everything, _GOOD)]
        # In the metric of inertia heavy bodies stay and light ones move, as a mechanism that closes would. But a light
        # body far from its place would rather turn than move: then the shortest steps in the entries of v follow.
        for by_inertia, most in ((True, steps), (False, _STEPS)):
            for rows, allowed in attempts[: 1 if self.leading.all() else 2]:
                found, residual = self._descended(q, free, rows, by_inertia, t, most)
                if (np.abs(residual) <= allowed).all():
                    return found, residual, True
        return found, residual, False

    def _descended(
        self, q: Array, free: Array, rows: Array, by_inertia: bool, t: float | None, steps: int
    ) -> tuple[Array, Array]:
        """Minimize the residual of the rows in a mask (h,), starting at q; return q and the residual of all rows."""
        here = self._kinematics.position(q, t)
        residual, stalls = self._rows.residual(here), 0
        exact, longest, halvings = 1e-14, 0.5, 12  # residual at the end [m or rad]; largest step [rad or m]
        stalled, patience = 0.999, 2  # ratio of residuals above which a step stalls, and how many may stall
        for _ in range(steps):
            if stalls == patience or np.abs(residual[rows]).max(initial=0.0) <= exact:
                return q, residual
            step = self._step(here, residual, free, rows, by_inertia)
            # Newton's step is a guess far from a solution: shorten it, then halve it until the residual decreases.
            step *= min(1.0, longest / max(float(np.abs(step).max()), 1e-300))
            for _ in range(halvings):
                ahead = self._kinematics.position(pin.integrate(self.robot.model, q, step), t)
                left = self._rows.residual(ahead)
                if np.linalg.norm(left[rows]) < np.linalg.norm(residual[rows]):
                    break
                step = 0.5 * step
            else:
                return q, residual
            before, after = (float(np.linalg.norm(each[rows])) for each in (residual, left))
            stalls = stalls + 1 if after > max(_FAR, stalled * before) else 0
            here, q, residual = ahead, ahead.q, left
        return q, residual

    def random_configuration(self, generator: np.random.Generator, spread: float = np.pi) -> Array:
        """Random configuration that satisfies the rows: ``Robot.random_configuration``, projected, with retries.

        Args:
            generator: source of the random numbers.
            spread: largest distance from the neutral configuration before the projection [rad or m].

        Raises:
            ConstraintError: the projection failed at every try.
        """
        failures: list[float] = []
        tries, early = 100, 25  # draws, and failures after which it is asked whether the rows are out of reach
        drawn_steps = 30  # nearly all draws that arrive take less than ten
        for _ in range(tries):
            with suppress(SingularityError):
                drawn = self.robot.random_configuration(generator, spread)
                found, residual, closed = self._closest(drawn, steps=drawn_steps)
                if closed:
                    return found
                failures.append(float(np.linalg.norm(residual)))
                worst = f": {_worst_row(self, residual)}"
            if len(failures) == early and _out_of_reach(failures):
                break
        count = f"{early}" if len(failures) == early else f"any of {tries}"
        text = f"constraints cannot be satisfied from {count} random configurations"
        raise ConstraintError(text + (worst if failures else ""))

    def samples(self, count: int, spread: float = np.pi) -> Array:
        """Seeded random configurations and the neutral one, (count or count + 1, nq), which satisfy the rows.

        At other configurations, the rank of the rows may differ. The neutral configuration is omitted if it cannot be
        assembled, or if loops lose rank there, e.g. of a linkage that is folded flat and can continue in several ways.

        Args:
            count: number of random configurations.
            spread: largest distance from the neutral configuration before they are assembled [rad or m].
        """
        generator = np.random.default_rng(0)
        configurations = [self.random_configuration(generator, spread) for _ in range(count)]
        with suppress(ConstraintError, SingularityError):
            neutral = self.project(self.robot.configuration())
            # A neutral configuration is often singular, such as a stretched linkage: then it would lower the rank of
            # all.
            if self.rank(neutral) >= max(map(self.rank, configurations)):
                configurations.append(neutral)
        return np.stack(configurations)

    def jacobian(self, at: PositionKinematics) -> Array:
        """Jacobian (h, nv) of the rows at one configuration; it gives the rate of ``residual`` where that is zero.

        Args:
            at: kinematics at one configuration (nq,).
        """
        return self._rows.jacobian(at)

    def _step(self, at: PositionKinematics, residual: Array, free: Array, which: Array, by_inertia: bool) -> Array:
        rows = self.jacobian(at)[which][:, free]
        try:
            factor = np.linalg.cholesky(at.M[np.ix_(free, free)]) if by_inertia else np.eye(int(free.sum()))
        except np.linalg.LinAlgError:
            raise ConstraintError(
                "inertia matrix is not positive definite: check for masses of very different magnitude"
            ) from None
        # Triangular solvers of LAPACK start threads for two or more right-hand sides, and these spin: avoid them.
        with np.errstate(over="ignore", invalid="ignore"):
            scaled = np.linalg.solve(factor, rows.T).T  # A L^-T
            if not np.isfinite(np.sum(scaled**2)):
                raise ConstraintError("constraint rows overflow: scale down their entries")
        dependent = 1e-9  # relative singular value below which a direction is not corrected
        reduced = np.linalg.lstsq(scaled, -residual[which], rcond=dependent)[0]
        step = np.zeros(len(free))
        step[free] = np.linalg.solve(factor.T, reduced)
        return step

    def _dependent(self) -> set[str]:
        """Names of rows that depend on others at random configurations, which need not satisfy the rows."""
        whole = RowStack([block for block, *_ in self._rows.places])
        both = zip(self._rows.places, whole.places, strict=True)
        rows = [row for place, (_, where, _) in both for row in place.each(range(where.start, where.stop))]
        samples = self._random_rows(whole)
        if not len(samples):
            return set()
        try:
            lengths = block_row_scales(whole, samples)[rows]
            return {row.name for row in select_independent(samples[:, rows], self.names, lengths=lengths).dropped}
        except ConstraintError:
            return set()  # the rank may differ at configurations that do not satisfy the rows

    def _moving(self, block: Rows) -> Array:
        """Mask of the rows of a block that are larger than rounding at some sampled configuration."""
        rows = RowStack([block])
        samples = self._random_rows(rows)
        size = np.linalg.norm(samples, axis=-1).max(axis=0, initial=0.0)
        return size > np.maximum(1e-12, ROUNDING * block_row_scales(rows, samples))

    def _random_rows(self, rows: RowStack) -> Array:
        """Rows (samples, k, nv) at random configurations, which need not satisfy the rows."""
        generator, count = np.random.default_rng(0), 4
        configurations = np.array([self.robot.random_configuration(generator) for _ in range(count)])
        found = [matrix for _, matrix in defined_jacobians(rows, self.robot, configurations)]
        return np.array([each for each in found if np.isfinite(each).all()]).reshape(-1, rows.size, self.robot.nv)


def _worst_row(assembly: Assembly, residual: Array) -> str:
    """The worst row of a configuration with its residual, for messages."""
    row = int(np.argmax(np.abs(residual)))
    limit = f"{_GOOD:.0e}{assembly.remedy(assembly.names[row])}"
    return f"{assembly.names[row]} has residual {abs(residual[row]):.3g}, limit {limit}"


def _out_of_reach(failures: Sequence[float]) -> bool:
    """Return True if most tries ended at the same residual, e.g. of a fully stretched loop that cannot close."""
    least, alike, within = min(failures), 20, 1.01  # so many of the tries within this ratio of the least residual
    return least > _FAR and sum(each <= within * least for each in failures) >= alike
