"""Reduced dynamics that are linear in inertial parameters, friction and motor inertia: ``R^T Y(q, v, vdot) p``.

The multipliers of all constraints vanish, since ``A R = 0``: of wheels on the ground and of closed loops alike. The
momentum of a free base is linear in the parameters too, and needs neither forces nor accelerations.

Base parameters are the combinations of parameters that a linear model shows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from rnc_pin.constraints.momentum import MomentumConservation
from rnc_pin.errors import ConfigurationError, nearest
from rnc_pin.math.linear_algebra import null_space
from rnc_pin.model.kinematics import Kinematics, VelocityKinematics
from rnc_pin.model.rows import Rows, parts_of
from rnc_pin.model.system import NonholonomicSystem
from rnc_pin.printing import Item, Line, SummaryMixin

_PARALLEL = 1e-3  # smallest distance of an entry of v from the span of the rows and of other entries


class Basis(NamedTuple):
    """Null-space basis of the rows that have reactions, and its rate."""

    R: np.ndarray
    """(N, nv, r)"""
    R_dot: np.ndarray
    """(N, nv, r)"""


class ReducedRegressor:
    """Columns of the dynamics for each parameter, projected onto the motions that the constraints allow.

    The reduced velocities are entries of v, those of driven joints first: then ``R^T B`` is the identity for them, and
    a row of the reduced dynamics contains the effort of one motor.

    Args:
        system: the robot with its constraints and actuators.
        measured: actuators whose effort is measured.

    Attributes:
        entries: entries of v that are the reduced velocities, (r,).
        rows: rows of the reduced dynamics in use, (k,): their forces are known.
        outputs: name of the effort in each of these rows; "" where no motor acts alone.
        drive: inputs of these rows for unit efforts, (k, p'), where it is constant; None if motors outnumber motions.
        joints: names of joints with one degree of freedom: their friction and motor inertia are columns.
        columns: names of the columns: ten for each body, three for each of ``joints``.

    Raises:
        ConfigurationError: constraints other than momentum are affine, or unmeasured efforts act on every row.
    """

    def __init__(self, system: NonholonomicSystem, measured: Sequence[str]) -> None:
        robot = system.robot
        model = robot.model
        given = parts_of(system.kinds)
        self.momentum: list[Rows] = [each.bind(robot) for each in given if isinstance(each, MomentumConservation)]
        rest = [each for each in system.kinds if not isinstance(each, MomentumConservation)]
        self.system = system if not self.momentum else system.with_robot(robot, rest)
        if self.system.constraints.affine:
            raise ConfigurationError("identification assumes constraints A v = 0 on ground that is at rest")
        self._kinematics = Kinematics(robot)
        self.bodies = [model.names[k] for k in range(1, model.njoints)]
        self.joints = [name for name in robot.joint_names if model.joints[model.getJointId(name)].nv == 1]
        self._coordinates = [model.joints[model.getJointId(name)].idx_v for name in self.joints]
        self.conserved = [k for rows in self.momentum for k in np.arange(robot.nv)[rows.conserved].tolist()]
        self._choose(system, measured)
        self.width = 10 * len(self.bodies) + 3 * len(self.joints)

    def _choose(self, system: NonholonomicSystem, measured: Sequence[str]) -> None:
        """Choose the reduced velocities, and the rows whose forces are known."""
        robot, driven = system.robot, list(system.actuation.names)
        axes = {name: robot.velocity_indices(name).start for name in driven if name in self.joints}
        hidden = [name for name in driven if name not in measured]
        first = [axes[name] for name in (*hidden, *measured) if name in axes]
        others = [k for k in range(robot.nv) if k not in first]
        samples = self.random_configurations(8, np.random.default_rng(0))
        bases = [null_space(A) for A in self.system.constraints.jacobian(self._kinematics.position(samples))]
        self.entries = _independent(bases, [*first, *others])
        by_entry = {axes[name]: name for name in axes}
        undriven = [k for k in range(len(self.entries)) if by_entry.get(self.entries[k]) not in hidden]
        lost = [name for name in hidden if axes.get(name) not in self.entries]
        if lost:
            undriven = []  # their efforts act on every row
        self.rows = [k for k in undriven if self.entries[k] not in self.conserved]
        plain = len(axes) == len(driven) and all(axes[name] in self.entries for name in measured)
        self.outputs = [by_entry.get(self.entries[k], "") if plain else "" for k in self.rows]
        self.plain = plain

    # ------------------------------------------------------------------ motions

    def random_configurations(self, count: int, generator: np.random.Generator) -> np.ndarray:
        """Random configurations (count, nq) that satisfy the holonomic rows."""
        return np.stack([self.system.assembly.random_configuration(generator, 1.5) for _ in range(count)])

    def basis(self, q: np.ndarray, v: np.ndarray | None = None) -> Basis:
        """Basis at configurations (N, nq), and its rate at velocities (N, nv), zero without them."""
        at = self._kinematics.position(q)
        m, nv = self.system.m, self.system.n
        chosen = np.eye(nv)[self.entries]
        E = np.concatenate([self.system.constraints.jacobian(at), np.broadcast_to(chosen, (len(q), *chosen.shape))], 1)
        inverse = np.linalg.inv(E)
        R = inverse[..., m:]
        if v is None:
            return Basis(R, np.zeros_like(R))
        rate = self.system.constraints.jacobian_dot(at.with_velocity(v))
        return Basis(R, -inverse[..., :m] @ (rate @ R))

    # ------------------------------------------------------------------ columns

    def forces(self, q: np.ndarray, v: np.ndarray, v_dot: np.ndarray) -> np.ndarray:
        """Columns (N, k, width) of the rows at accelerations (N, nv), by Pinocchio's regressor."""
        model, data = self._kinematics.model, self._kinematics.data
        self._kinematics.current = None
        R = self.basis(q).R[..., self.rows]
        out = np.empty((len(q), len(self.rows), self.width))
        for k, (qk, vk, ak) in enumerate(zip(q, v, v_dot, strict=True)):
            out[k, :, : 10 * len(self.bodies)] = R[k].T @ pin.computeJointTorqueRegressor(
                model, data, qk, vk, ak
            ).reshape(model.nv, -1)
        Rj, vj = R[:, self._coordinates], v[:, self._coordinates]
        scaled = (np.sign(vj), vj, v_dot[:, self._coordinates])
        out[:, :, 10 * len(self.bodies) :] = np.concatenate([(Rj * each[..., None]).mT for each in scaled], axis=2)
        return out

    def momenta(self, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Columns (N, c, width) of the conserved momentum in the axes of the base, and its values (N, c)."""
        at = self._kinematics.position(q).with_velocity(v)
        columns, values = np.zeros((len(q), len(self.conserved), self.width)), np.zeros((len(q), len(self.conserved)))
        for k in range(len(self.bodies)):
            J, H = at.joint_jacobian(k + 1)[..., self.conserved], _moved(at, k + 1, at.joint_velocity(k + 1))
            columns[:, :, 10 * k : 10 * k + 10] = J.mT @ H
        start = 0
        for rows in self.momentum:
            size, own = len(rows.names), rows.conserved
            if rows.affine:  # rows of another frame: A = T M, with the momentum M v of the base in its own axes
                A, M = rows.jacobian(at)[..., own], at.M[..., own, own]
                to_rows = np.linalg.solve(M, A.mT).mT
                values[:, start : start + size] = np.linalg.solve(to_rows, rows.rate(at)[..., None])[..., 0]
            start += size
        return columns, values

    def weak(self, q: np.ndarray, v: np.ndarray, windows: WindowAverages) -> np.ndarray:
        """Columns (W, k, width) of the rows, averaged over windows by parts: no acceleration is needed.

        ``w R^T J^T d(h)/dt = -(d(w R^T J^T)/dt) h`` under the integral, with the momentum h of a body in the axes of
        the world and a weight w that is zero at the ends of the window. Motor inertia is treated alike.
        """
        at = self._kinematics.position(q).with_velocity(v)
        R, R_dot = (each[..., self.rows] for each in self.basis(q, v))
        out = np.empty((windows.count, len(self.rows), self.width))
        for k in range(len(self.bodies)):
            J, J_dot = at.joint_jacobian(k + 1), at.joint_jacobian_dot(k + 1)
            Q, Q_dot = (J @ R).mT, (J_dot @ R + J @ R_dot).mT
            down = at.joint_placement(k + 1).rotation.mT @ self._kinematics.model.gravity.linear
            H, weight = _moved(at, k + 1, at.joint_velocity(k + 1)), _moved(at, k + 1, np.hstack([down, 0.0 * down]))
            out[:, :, 10 * k : 10 * k + 10] = windows.by_parts(Q @ H) - windows.mean(Q_dot @ H + Q @ weight)
        Rj, R_dot_j, vj = R[:, self._coordinates], R_dot[:, self._coordinates], v[:, self._coordinates, None]
        inertia = windows.by_parts((Rj * vj).mT) - windows.mean((R_dot_j * vj).mT)
        friction = [windows.mean((Rj * each).mT) for each in (np.sign(vj), vj)]
        out[:, :, 10 * len(self.bodies) :] = np.concatenate([*friction, inertia], axis=2)
        return out

    # ------------------------------------------------------------------ parameters of the file

    def nominal(self) -> np.ndarray:
        """Values of the columns' parameters in the robot's file, (width,)."""
        model = self._kinematics.model
        bodies = [model.inertias[k].toDynamicParameters() for k in range(1, model.njoints)]
        dry, damping = (np.asarray(each)[self._coordinates] for each in (model.upperDryFrictionLimit, model.damping))
        return np.concatenate([*bodies, dry, damping, np.asarray(model.armature)[self._coordinates]])


class WindowAverages:
    """Weights ``(1 - x^2)^4`` over windows of equal length, half of which overlap; each has integral 1.

    They and three derivatives are zero at the ends, so that the trapezoidal rule is accurate.

    Args:
        time: times (N,) [s].
        starts: index of the first sample of each window.
        length: number of intervals of a window.
    """

    def __init__(self, time: np.ndarray, starts: np.ndarray, length: int) -> None:
        self.count, self._size = len(starts), len(time)
        self.index = starts[:, None] + np.arange(length + 1)
        at = time[self.index]
        half = (at[:, -1:] - at[:, :1]) / 2
        x = (at - at[:, :1]) / half - 1
        steps = np.zeros_like(at)
        steps[:, :-1] += np.diff(at, axis=1) / 2
        steps[:, 1:] += np.diff(at, axis=1) / 2
        weight = (1 - x**2) ** 4
        total = np.sum(weight * steps, axis=1, keepdims=True)
        self._weight = weight * steps / total
        self._rate = -8 * x * (1 - x**2) ** 3 / half * steps / total

    def mean(self, values: np.ndarray) -> np.ndarray:
        """Weighted means (W, ...) of values (N, ...)."""
        return self._sums(self._weight, values)

    def by_parts(self, values: np.ndarray) -> np.ndarray:
        """Weighted means (W, ...) of the rates of values (N, ...)."""
        return -self._sums(self._rate, values)

    def _sums(self, weights: np.ndarray, values: np.ndarray) -> np.ndarray:
        out = np.zeros((self.count, *values.shape[1:]))
        expand = (slice(None), *[None] * (values.ndim - 1))
        for k in range(weights.shape[1]):
            out += weights[:, k][expand] * values[self.index[:, k]]
        return out


def _independent(bases: Sequence[np.ndarray], entries: Sequence[int]) -> list[int]:
    """The first entries of v that parametrise the motion at all configurations, for bases (nv, r) of the motions."""
    chosen: list[int] = []
    size = bases[0].shape[1]
    for k in entries:
        if len(chosen) == size:
            break
        if np.median([np.linalg.svd(basis[[*chosen, k]], compute_uv=False)[-1] for basis in bases]) > _PARALLEL:
            chosen.append(k)
    return chosen


_UNIT_MOMENTA = np.stack([pin.bodyRegressor(pin.Motion.Zero(), pin.Motion(unit)) for unit in np.eye(6)])
"""Momentum (6, 6, 10) of a body for unit parameters, at unit motions in its own axes: that of a body without rates."""


def _moved(at: VelocityKinematics, joint: int, motion: np.ndarray) -> np.ndarray:
    """Momentum (N, 6, 10) of a body for unit parameters, at motions (N, 6) in its own axes.

    It is about the origin of the world, in its axes.
    """
    place, columns = at.joint_placement(joint), np.tensordot(motion, _UNIT_MOMENTA, 1)
    linear, angular = place.rotation @ columns[:, :3], place.rotation @ columns[:, 3:]
    return np.concatenate([linear, angular + np.cross(place.translation[:, :, None], linear, axis=1)], axis=1)


_DEPENDENT = 1e-7  # distance of a unit column from the span of others below which it depends on them
_NAMED = 1e-6  # coefficient below which a parameter is not named
_MOST = 6  # parameters that the name of a combination has at most


@dataclass(frozen=True)
class BaseParameters:
    """Independent combinations ``K p`` of parameters p, and parameters without effect.

    Each combination is one parameter plus multiples of parameters whose effects are those of others.
    """

    K: np.ndarray
    """Combinations (b, P)."""
    names: tuple[str, ...]
    """Names of the combinations, such as ``I_zz of arm_1 + 0.25 m of arm_2``."""
    independent: np.ndarray
    """Parameter that each combination begins with, (b,). The columns of these have full rank."""
    invisible: tuple[str, ...]
    """Parameters without any effect."""

    @classmethod
    def of(cls, columns: np.ndarray, names: Sequence[str]) -> BaseParameters:
        """Return the combinations that columns (N, P) show; earlier parameters are preferred.

        Args:
            columns: regressor at many random states.
            names: names of the parameters.
        """
        sizes = np.linalg.norm(columns, axis=0)
        seen = sizes > _DEPENDENT * sizes.max(initial=1e-300)
        unit = np.divide(columns, sizes, out=np.zeros_like(columns), where=seen)
        chosen: list[int] = []
        directions = np.zeros((len(columns), 0))
        for k in np.flatnonzero(seen):
            rest = unit[:, k] - directions @ (directions.T @ unit[:, k])
            rest -= directions @ (directions.T @ rest)
            if np.linalg.norm(rest) > _DEPENDENT:
                chosen.append(int(k))
                directions = np.column_stack([directions, rest / np.linalg.norm(rest)])
        K = np.linalg.lstsq(unit[:, chosen], unit, rcond=None)[0] * sizes / sizes[chosen][:, None]
        K[:, ~seen] = 0.0
        K[np.abs(K) < _NAMED] = 0.0
        K[:, chosen] = np.eye(len(chosen))
        words = tuple(_words(row, k, names) for row, k in zip(K, chosen, strict=True))
        unseen = tuple(name for name, each in zip(names, seen, strict=True) if not each)
        return cls(K, words, np.array(chosen, dtype=int), unseen)


@dataclass(frozen=True, repr=False)
class Estimates(SummaryMixin):
    """Estimated parameters with their covariance."""

    names: tuple[str, ...]
    """Names of the parameters, (P,)."""
    nominal: np.ndarray
    """Their values in the robot's file, (P,)."""
    values: np.ndarray
    """Estimates (P,)."""
    covariance: np.ndarray
    """Covariance of the estimates (P, P), for errors as long correlated as the residuals are."""

    @property
    def std(self) -> np.ndarray:
        """Standard deviations of the estimates (P,)."""
        return np.sqrt(np.diag(self.covariance))

    def value(self, name: str) -> float:
        """Return one estimate.

        Args:
            name: name of the parameter.

        Raises:
            ConfigurationError: there is no such parameter.
        """
        if name not in self.names:
            raise ConfigurationError(f"no parameter '{name}' was estimated{nearest(name, self.names)}")
        return float(self.values[self.names.index(name)])

    def _estimates(self, units: Sequence[str]) -> list[Line]:
        """Lines of a summary, one for each parameter with its unit."""
        every = zip(self.names, units, self.values, self.std, self.nominal, strict=True)
        return [
            (name, [Item(f"{value:.6g} {unit}".strip(), f"std {std:.2g}, file {nominal:.6g}")])
            for name, unit, value, std, nominal in every
        ]


def combination_name(vector: np.ndarray, names: Sequence[str], least: float = 0.1) -> str:
    """Words of a combination of scaled parameters, the largest first and positive.

    Args:
        vector: coefficients (P,).
        names: names of the parameters.
        least: coefficient below which a parameter is not named, relative to the largest.
    """
    vector = vector / vector[np.argmax(np.abs(vector))]
    large = [k for k in np.argsort(-np.abs(vector)).tolist() if abs(vector[k]) > least][:_MOST]
    if len(large) == 1:
        return names[large[0]]
    words = " ".join(f"{'-' if vector[k] < 0 else '+'} {abs(vector[k]):.2f} {names[k]}" for k in large)
    return f"combination {words.removeprefix('+ ')}"


def _words(row: np.ndarray, first: int, names: Sequence[str]) -> str:
    others = [k for k in np.flatnonzero(row).tolist() if k != first]
    factors = ["" if abs(abs(row[k]) - 1) < _NAMED else f"{abs(row[k]):.4g} " for k in others[:_MOST]]
    words = [f" {'-' if row[k] < 0 else '+'} {factor}{names[k]}" for k, factor in zip(others, factors, strict=False)]
    return names[first] + "".join(words) + (f" and {len(others) - _MOST} more" if len(others) > _MOST else "")
