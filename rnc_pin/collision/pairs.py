"""Pairs of shapes: selection of pairs that may collide, and signed distances with nearest points and rates by coal."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

import coal
import numpy as np
import pinocchio as pin

from rnc_pin.array_shapes import Float, Int
from rnc_pin.errors import ModelError, SimulationError, nearest


class LinkPair(NamedTuple):
    """Two shapes by index in the geometry, and their names: the name of the link, or of the obstacle.

    Attributes:
        first: index of the shape of a link.
        second: index of the other shape.
        names: names of the two bodies.
    """

    first: int
    second: int
    names: tuple[str, str]

    @property
    def label(self) -> str:
        """Both names in one text."""
        return f"{self.names[0]} / {self.names[1]}"


class OmittedPair(NamedTuple):
    """Pair that is not checked, and the reason.

    Attributes:
        names: names of the two bodies.
        reason: the reason, in words.
        depth: depth of the overlap [m]; zero for other reasons.
    """

    names: tuple[str, str]
    reason: str
    depth: float = 0.0

    def __str__(self) -> str:
        return f"{' / '.join(self.names)}: {self.reason}"


@dataclass(frozen=True)
class PairSelection:
    """Rules by which pairs of links are selected. Every link is always checked against every obstacle.

    Attributes:
        pairs: pairs of links to check, by name; None checks all pairs, except pairs that the other rules exclude.
        disabled: pairs of links to omit, by name.
        links: True to check links against each other; obstacles always count.
    """

    pairs: Sequence[tuple[str, str]] | None = None
    disabled: Sequence[tuple[str, str]] = ()
    links: bool = True


def select_pairs(
    model: pin.Model, names: Sequence[str], joints: Sequence[int], selection: PairSelection
) -> tuple[list[LinkPair], list[OmittedPair]]:
    """Return the pairs of links to check, and the pairs that a rule omits. Shapes of one rigid body are no pair.

    Args:
        model: model of the robot.
        names: link of each shape.
        joints: parent joint of each shape.
        selection: rules.

    Raises:
        ModelError: a rule names a link without collision geometry.
    """
    wanted = None if selection.pairs is None else _checked(selection.pairs, names)
    disabled = _checked(selection.disabled, names)
    kept: list[LinkPair] = []
    omitted: list[OmittedPair] = []
    for first, second in combinations(range(len(names)) if selection.links else (), 2):
        a, b = joints[first], joints[second]
        pair = names[first], names[second]
        # Both shapes are on one rigid body: their distance never changes.
        if a == b:
            continue
        if wanted is not None:
            if frozenset(pair) in wanted:
                kept.append(LinkPair(first, second, pair))
        elif frozenset(pair) in disabled:
            omitted.append(OmittedPair(pair, "disabled"))
        # Links of one joint touch at it by design.
        elif model.parents[a] == b or model.parents[b] == a:
            omitted.append(OmittedPair(pair, "adjacent links"))
        else:
            kept.append(LinkPair(first, second, pair))
    return kept, omitted


def _checked(pairs: Iterable[tuple[str, str]], names: Sequence[str]) -> set[frozenset[str]]:
    found = set()
    for pair in pairs:
        if len(pair) != 2 or isinstance(pair, str):
            raise ModelError(f"expected a pair of links, found {pair!r}")
        for name in pair:
            if name not in names:
                raise ModelError(f"no link '{name}' with collision geometry{nearest(str(name), dict.fromkeys(names))}")
        found.add(frozenset(pair))
    return found


# ------------------------------------------------------------------ measurement


@dataclass(frozen=True)
class PairDistances:
    """Distances of k pairs at one configuration and time.

    Attributes:
        pairs: indices of the pairs in ``CollisionDistances.pairs``, each once.
        distance: signed distances [m]; negative for penetration: minus the shortest translation that separates.
        point_a: nearest points of the first bodies, in the world [m].
        point_b: nearest points of the second bodies, in the world [m].
        normal: unit vectors from the first to the second body, ``point_b - point_a = distance * normal``.
        jacobian: rows of the rates: ``d_dot = jacobian @ v + drift``.
        drift: part of the rates that the prescribed motion of obstacles causes [m/s].
    """

    pairs: Int[np.ndarray, " k"]
    distance: Float[np.ndarray, " k"]
    point_a: Float[np.ndarray, "k 3"]
    point_b: Float[np.ndarray, "k 3"]
    normal: Float[np.ndarray, "k 3"]
    jacobian: Float[np.ndarray, "k nv"]
    drift: Float[np.ndarray, " k"]

    def __post_init__(self) -> None:
        for array in vars(self).values():
            array.flags.writeable = False

    def rates(self, v: np.ndarray) -> np.ndarray:
        """Rates (k,) of the distances [m/s] at a velocity v (nv,).

        Args:
            v: velocity of the robot.
        """
        return np.asarray(self.jacobian @ v + self.drift)


NUMBERS = 10
"""Numbers of a pair: distance, normal from the first to the second body, nearest points of both, in the world."""

_GJK, _EPA = 1e-9, 1e-6
"""Tolerances of coal: with these, distances are correct to 1e-7 m and depths to 2e-6 m. Its default for GJK is wrong by
up to 4e-5 m for cylinders, and a finer one for EPA makes it fail."""
_GJK_OF_TOUCHING = 1e-7
"""Tolerance for pairs of which EPA fails: of cylinders that touch along a line, 1 in 100 poses."""
_FAILED = -1e6  # [m]; coal returns the smallest float if EPA fails


def _request(tolerance: float) -> coal.DistanceRequest:
    request = coal.DistanceRequest()
    request.gjk_tolerance, request.epa_tolerance = tolerance, _EPA
    iterations = 256  # twice coal's default of 128: the finer tolerance needs more
    request.gjk_max_iterations = iterations
    return request


class PairMeasurement:
    """Measurement of pairs at given poses. One object serves one thread at a time.

    Pinocchio's ``computeDistance`` and coal's ``ComputeDistance`` start from their last result, so that the last digits
    would depend on the history. ``coal.distance`` starts anew.

    Args:
        shapes: convex shapes.
        pairs: pairs of them.
    """

    def __init__(self, shapes: Sequence[coal.CollisionGeometry], pairs: Sequence[LinkPair]) -> None:
        self._pairs, self._poses = pairs, [coal.Transform3s() for _ in shapes]
        request, result = _request(_GJK), coal.DistanceResult()
        self._request_of_touching = _request(_GJK_OF_TOUCHING)
        self._result = result
        # Arguments are made once: placements are written into the same objects.
        poses = self._poses
        self._arguments = [(shapes[a], poses[a], shapes[b], poses[b], request, result) for a, b, _ in pairs]

    def measure(
        self, pairs: Int[np.ndarray, " k"], rotations: Float[np.ndarray, "s 3 3"], origins: Float[np.ndarray, "s 3"]
    ) -> Float[np.ndarray, "k 10"]:
        """Numbers of pairs at poses of the shapes.

        Args:
            pairs: indices of the pairs.
            rotations: rotations of all shapes in the world.
            origins: origins of all shapes in the world [m].

        Raises:
            SimulationError: coal finds no depth of a penetration.
        """
        listed = pairs.tolist()
        columns = rotations.swapaxes(1, 2).copy()  # coal copies matrices that are stored by rows
        for k in {shape for pair in listed for shape in self._pairs[pair][:2]}:
            self._poses[k].setTransform(columns[k].T, origins[k])
        found = np.empty((len(listed), NUMBERS))
        result, arguments = self._result, self._arguments
        for row, pair in zip(found, listed, strict=True):
            result.clear()
            # The comparison is false for NaN too.
            if not coal.distance(*arguments[pair]) > _FAILED:
                result.clear()
                if not coal.distance(*arguments[pair][:4], self._request_of_touching, result) > _FAILED:
                    raise SimulationError(f"coal found no penetration depth of {self._pairs[pair].label}")
            row[0], row[1:4] = result.min_distance, result.normal
            row[4:7], row[7:] = result.getNearestPoint1(), result.getNearestPoint2()
        return found
