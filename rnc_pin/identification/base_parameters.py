"""Base parameters, the combinations of parameters that a linear model shows, and estimates of parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rnc_pin.errors import ConfigurationError, nearest
from rnc_pin.printing import Item, Line, SummaryMixin

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
