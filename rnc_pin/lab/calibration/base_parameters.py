"""Base parameters: the combinations of inertial parameters that the dynamics of a robot can show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rnc_pin.errors import ConfigurationError
from rnc_pin.model.evaluation_results import ReducedRegressor
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.printing import printed

_NAMED = 1e-6  # coefficient below which a parameter is not named


@printed()
@dataclass(frozen=True)
class BaseParameters:
    """Combinations ``matrix @ p`` of parameters p that act on the rows of a regressor, and combinations that do not.

    The columns with the indices ``columns`` have full rank, so ``numpy.linalg.lstsq(Y[:, base.columns], F)`` estimates
    ``base.matrix @ p``.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf", lock={"platform": 0.0, "joint_2": 0.0, "joint_3": 0.0})
        >>> base = rnc.base_parameters(rnc.NonholonomicSystem(robot, (), ["joint_1"]).reduce())
        >>> base.rank, base.names, base.unseen[:2]
        (1, ('I_zz of joint_1',), ('m of joint_1', 'm x of joint_1'))
    """

    names: tuple[str, ...]
    """Combinations that can be seen, such as ``I_zz of arm_1 + 0.25 m of arm_2``, (rank,)."""
    unseen: tuple[str, ...]
    """Changes of parameters without effect, such as ``m of arm_2 - 0.25 I_zz of arm_1``, (columns - rank,)."""
    matrix: np.ndarray
    """Combinations (rank, columns): each is one parameter plus multiples of parameters with the same effect."""
    columns: np.ndarray
    """Index of the parameter that each combination begins with, (rank,)."""
    condition: float
    """Condition number of these columns, of unit length each; large if samples hardly tell some combinations apart."""

    @property
    def rank(self) -> int:
        """Number of combinations that can be seen."""
        return len(self.names)


def base_parameters(
    source: ReducedModel | ReducedRegressor, *, samples: int = 64, seed: int = 0, tolerance: float = 1e-7
) -> BaseParameters:
    """Return the combinations of inertial parameters that a model can show, or that a measured motion shows.

    Earlier parameters are preferred: a combination begins with the first of the parameters that have the same effect.

    With ``MomentumConservation`` the basis R itself depends on masses. Leave this constraint out: then the rows of the
    free base have the known force zero, and the regressor is linear.

    Args:
        source: a model, whose states are drawn at random; or the regressor at the states of a motion.
        samples: number of random states of a model; at least three times the columns over r are drawn.
        seed: seed of the random states.
        tolerance: distance of a column of unit length from the span of others, below which it depends on them.

    Raises:
        ConfigurationError: a number is out of range.

    Example:
        >>> robot = rnc.Robot.from_urdf("differential_drive.urdf", base="planar")
        >>> wheels = [rnc.RollingWheel("left_wheel", 0.1), rnc.RollingWheel("right_wheel", 0.1)]
        >>> reduced = rnc.NonholonomicSystem(robot, wheels).reduce()
        >>> base = rnc.base_parameters(reduced)
        >>> base.rank, base.matrix.shape
        (16, (16, 30))
    """
    if samples < 1 or not 0 < tolerance < 1:
        raise ConfigurationError(
            f"base parameters: expected samples of at least 1 and a tolerance between 0 and 1, found {samples} and "
            f"{tolerance}"
        )
    regressor = source if isinstance(source, ReducedRegressor) else _drawn(source, samples, seed)
    names = regressor.names
    Y = regressor.matrix.reshape(-1, len(names))
    sizes = np.linalg.norm(Y, axis=0)
    # Units of columns differ: each is compared with the others at unit length, and only its zero with the largest.
    acting = sizes > tolerance * sizes.max(initial=np.finfo(float).tiny)
    unit = np.divide(Y, sizes, out=np.zeros_like(Y), where=acting)
    columns = _independent(unit, np.flatnonzero(acting).tolist(), tolerance)
    K = np.linalg.lstsq(unit[:, columns], unit, rcond=None)[0] * sizes / sizes[columns, None]
    K[:, ~acting] = 0.0
    K[np.abs(K) < _NAMED] = 0.0
    # Exactly: least squares leave rounding in the columns themselves.
    K[:, columns] = np.eye(len(columns))
    dependent = [k for k in range(len(names)) if k not in columns]
    directions = np.eye(len(names))[dependent]
    directions[:, columns] = -K[:, dependent].T
    return BaseParameters(
        tuple(_words(row, k, names) for row, k in zip(K, columns, strict=True)),
        tuple(_words(row, k, names) for row, k in zip(directions, dependent, strict=True)),
        K,
        np.array(columns, dtype=int),
        float(np.linalg.cond(unit[:, columns])) if columns else 1.0,
    )


def _drawn(reduced: ReducedModel, samples: int, seed: int) -> ReducedRegressor:
    """Regressor at random states of a model."""
    generator = np.random.default_rng(seed)
    width = 10 * (reduced.robot.model.njoints - 1) + reduced.n
    # Three times the rows that columns need, so that the dynamics and not the samples decide the rank.
    count = max(samples, 3 * width // max(reduced.r, 1))
    spread = 1.5  # range of random configurations around the neutral one [rad or m]
    q = np.stack([reduced.random_configuration(generator, spread) for _ in range(count)])
    v2, v2_dot = generator.normal(size=(2, count, reduced.r))
    return reduced.regressor(q, v2, v2_dot, t=0.0)


def _independent(unit: np.ndarray, candidates: Sequence[int], tolerance: float) -> list[int]:
    """The first columns of unit length that do not depend on those before."""
    chosen: list[int] = []
    directions = np.zeros((len(unit), 0))
    for k in candidates:
        # In order and not by pivots (qr with pivoting): the first parameters of a set with the same effect are kept.
        rest = unit[:, k] - directions @ (directions.T @ unit[:, k])
        rest -= directions @ (directions.T @ rest)  # once more, against rounding
        if np.linalg.norm(rest) > tolerance:
            chosen.append(k)
            directions = np.column_stack([directions, rest / np.linalg.norm(rest)])
    return chosen


def _words(row: np.ndarray, first: int, names: Sequence[str]) -> str:
    """Words of a combination whose coefficient of the parameter ``first`` is 1."""
    others = [k for k in np.flatnonzero(row).tolist() if k != first]
    most = 6  # further parameters that the name of a combination has at most: names stay readable
    factors = ["" if abs(abs(row[k]) - 1) < _NAMED else f"{abs(row[k]):.4g} " for k in others[:most]]
    words = [f" {'-' if row[k] < 0 else '+'} {factor}{names[k]}" for k, factor in zip(others, factors, strict=False)]
    return names[first] + "".join(words) + (f" and {len(others) - most} more" if len(others) > most else "")
