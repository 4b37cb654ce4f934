"""Privileged coordinates: at a configuration, how many brackets each direction of motion takes, in coordinates.

A function has order s at q if all its derivatives along fewer than s columns of R vanish there. The directions that
brackets of up to s fields reach form the spaces ``D1 < D2 < ...``. Coordinates z are privileged if each has as its
order its weight, the first s for which its differential does not vanish on Ds (Bellaiche, "The tangent space in
sub-Riemannian geometry", 1996; Jean, "Control of Nonholonomic Systems", 2014). Then z_i is of the size t^w_i after a
motion over the distance t, and a motion to z costs the homogeneous norm, the sum of |z_i|^(1 / w_i).

Functions that are linear in a chart have the differentials; polynomials of lower coordinates make their order right:

    z_j = l_j(x) + sum over a of c_a z_1^a1 z_2^a2 ...     with weighted degrees a1 w_1 + a2 w_2 + ... < w_j

The coefficients follow from the Taylor coefficients of x along random flows of the columns of R: below the degree
w_j, those of z_j vanish.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin
import scipy
from numpy.typing import ArrayLike

from rnc_pin.analysis.growth import filtration
from rnc_pin.analysis.lie_brackets import PIECES, BracketJets
from rnc_pin.array_shapes import Array, Float
from rnc_pin.errors import ConfigurationError, ConstraintError, InfeasibleError, InputError
from rnc_pin.model.coordinates import PlacementChart
from rnc_pin.model.input_validation import admit_configuration
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.printing import ReprMixin

_SPAN = 1e-7  # singular value of unit vectors below which they are dependent
_ACCURATE = 1e-11  # error of coefficients that ends the search for a better flow time

Polynomial = dict[tuple[int, ...], float]
"""Coefficients by the powers (c,) of the coordinates."""


class PrivilegedCoordinates(ReprMixin):
    """Coordinates z about a configuration, with their weights. ``privileged_coordinates`` returns them.

    Each is a coordinate of the chart plus a linear combination of others and a polynomial of lower coordinates. The
    chart has the place and rotation of a planar or free base in the axes that the base has at q, and joint positions.

    Args:
        reduced: the model.
        q: the center (nq,).
        names: of the coordinates.
        weights: of the coordinates, ascending (c,).
        linear: combinations of the coordinates of the chart (c, nv).
        polynomials: polynomial of lower coordinates that each has in addition: coefficients by the powers of the
            coordinates.
        error: estimated error of the coefficients.

    Attributes:
        size: number of coordinates.
        growth_vector: dimensions of D1, D2, ... in these coordinates.
        chart: the chart about q.

    Example:
        >>> robot = rnc.Robot.from_urdf("fire_truck.urdf", base="planar")
        >>> edges = [rnc.NoSideSlip(each) for each in ("front_axle", "tractor_axle", "rear_axle")]
        >>> reduced = rnc.NonholonomicSystem(robot, edges).reduce()
        >>> coordinates = rnc.analysis.privileged_coordinates(reduced, robot.configuration())
        >>> coordinates.weights, coordinates.growth_vector
        ((1, 1, 1, 2, 2, 3), (3, 5, 6))
    """

    def __init__(
        self,
        reduced: ReducedModel,
        q: Float[Array, " nq"],
        names: Sequence[str],
        weights: Sequence[int],
        linear: Float[Array, "c nv"],
        polynomials: Sequence[Polynomial],
        error: float,
    ) -> None:
        self.q, self.names, self.weights, self.error = q, tuple(names), tuple(weights), error
        self.size = len(self.weights)
        self.growth_vector = tuple(sum(w <= s for w in self.weights) for s in range(1, max(self.weights) + 1))
        self.linear, self.polynomials = linear, tuple(polynomials)
        self.chart = PlacementChart(reduced.robot.model, q)
        for each in (self.q, self.linear):
            each.setflags(write=False)

    def values(self, q: ArrayLike) -> Float[Array, "*n c"]:
        """Coordinates z of configurations (..., nq).

        Args:
            q: configurations near the center.
        """
        return self.evaluate(q)[0]

    def jacobian(self, q: ArrayLike) -> Float[Array, "*n c nv"]:
        """Derivatives of z along tangent vectors at configurations (..., nq).

        Args:
            q: configurations near the center.
        """
        return self.evaluate(q)[1]

    def norm(self, q: ArrayLike) -> Float[Array, "*n"]:
        """Homogeneous norms, sums of ``|z_i|^(1 / w_i)``: within constant factors, the lengths of shortest motions.

        Args:
            q: configurations near the center (..., nq).
        """
        return np.asarray((np.abs(self.values(q)) ** (1.0 / np.array(self.weights))).sum(axis=-1))

    def evaluate(self, q: ArrayLike) -> tuple[Float[Array, "*n c"], Float[Array, "*n c nv"]]:
        """Coordinates z of configurations (..., nq), and their derivatives along tangent vectors.

        Args:
            q: configurations near the center.
        """
        array = np.asarray(q, dtype=float)
        if array.shape[-1:] != self.q.shape or not np.isfinite(array).all():
            raise InputError(f"q: expected finite configurations (..., {len(self.q)}), found shape {array.shape}")
        flat = array.reshape(-1, len(self.q))
        z, slopes = self.chart.coordinates(flat) @ self.linear.T, self.linear @ self.chart.jacobian(flat)
        # In the order of the weights: each polynomial has coordinates that are corrected already.
        for j, polynomial in enumerate(self.polynomials):
            lower = z.copy()
            for powers, coefficient in polynomial.items():
                z[:, j] += coefficient * np.prod(lower**powers, axis=1)
                for i in np.flatnonzero(powers):
                    rest = powers - 1 * (np.arange(self.size) == i)
                    slope = coefficient * powers[i] * np.prod(lower**rest, axis=1)
                    slopes[:, j] += slope[:, None] * slopes[:, i]
        batch = array.shape[:-1]
        return z.reshape(*batch, self.size), slopes.reshape(*batch, *slopes.shape[1:])


def privileged_coordinates(
    reduced: ReducedModel, q: ArrayLike, *, ignored: Sequence[str] = ()
) -> PrivilegedCoordinates:
    """Return privileged coordinates of a reduced system about a configuration.

    Singular configurations have weights of their own, for instance a trailer at right angles. If constraints
    are integrable, the robot stays on a leaf through q: the coordinates are as many as its dimensions, and privileged
    on it.

    Args:
        reduced: the model.
        q: the configuration (nq,).
        ignored: joints whose position does not matter, such as the angles of rolling wheels. No constraint may depend
            on it.

    Raises:
        ConstraintError: rows are affine, as with ground that moves or momentum that is not zero; or a constraint
            depends on an ignored joint.
        ConfigurationError: unknown joint.
        InfeasibleError: the growth vector at q is in doubt, or the precision is not sufficient.
        SingularityError: q is singular.

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")]).reduce(
        ...     [rnc.FrameSpeed("sleigh"), rnc.FrameYaw("sleigh")])
        >>> coordinates = rnc.analysis.privileged_coordinates(reduced, robot.configuration())
        >>> dict(zip(coordinates.names, coordinates.weights))
        {'root_joint[0]': 1, 'root_joint[2]': 1, 'root_joint[1]': 2}
        >>> aside = np.array([0.0, 0.04, 1.0, 0.0])
        >>> round(float(coordinates.norm(aside)), 6)  # 4 cm aside are as far as 0.2 m ahead
        0.2
    """
    for place in reduced.all_constraints.places:
        if place.block.affine:
            raise ConstraintError(
                f"privileged coordinates: constraint '{place.block.names[0]}' is affine (ground that moves, momentum "
                "that is not zero, or a prescribed motion): the robot moves without inputs, so q is no set point"
            )
    center = admit_configuration(q, reduced.robot)
    kept = _kept(reduced, center, ignored)
    growth = filtration(reduced, center)
    # The weights follow from the growth vector: an uncertain one gives coordinates of another order.
    if growth.doubtful:
        raise InfeasibleError(
            f"privileged coordinates: next to a singular configuration; of the growth vector {growth.vector}, a "
            "direction is neither clearly present nor clearly absent; choose the singular configuration or one away"
        )
    flags = [growth.closure[kept, :size] for size in growth.vector]
    rows, pivots, weights = _adapted(flags)
    linear = np.zeros((len(rows), reduced.n))
    linear[:, kept] = rows
    names = [str(reduced.robot.velocity_names[kept[pivot]]) for pivot in pivots]
    found = _corrected(BracketJets(reduced, center), linear, weights, kept)
    return PrivilegedCoordinates(reduced, center, names, weights, *found)


def _kept(reduced: ReducedModel, q: Array, ignored: Sequence[str]) -> Array:
    """Entries of v of joints that are not ignored.

    Raises:
        ConstraintError: the motions of the other joints depend on an ignored joint.
    """
    model = reduced.robot.model
    free = np.zeros(reduced.n, dtype=bool)
    for name in ignored:
        free[reduced.robot.velocity_indices(name)] = True
    kept, generator = np.flatnonzero(~free), np.random.default_rng(0)
    if not len(kept):
        raise ConfigurationError("ignored: no joint is left")
    # A turn of the ignored joints must leave the motions of the others as they are.
    if free.any():
        turned = pin.integrate(model, q, free * generator.uniform(0.5, 1.0, reduced.n))
        here, there = (scipy.linalg.orth(reduced.at(each).R[kept], _SPAN) for each in (q, turned))
        if np.abs(here @ here.T - there @ there.T).max() > _SPAN:
            names = ", ".join(map(str, ignored))
            raise ConstraintError(f"ignored: the constraints of the other joints depend on the position of {names}")
    return kept


def _adapted(flags: Sequence[Array]) -> tuple[Array, list[int], list[int]]:
    """Linear functions (c, k) adapted to spaces D1 < D2 < ..., ascending, with their pivots and weights.

    A function of weight w vanishes on D(w - 1). Each has the coefficient 1 at its pivot, where those of the same or
    higher weight have none.
    """
    size = len(flags[0])
    rows, pivots, weights = np.empty((0, size)), list[int](), list[int]()
    large = 0.95  # of the largest entry: the first such entry is the pivot, so that rounding does not choose it
    for level in range(len(flags), -1, -1):
        known = scipy.linalg.orth(flags[level - 1], _SPAN) if level else np.empty((size, 0))
        missing = size - known.shape[1] - len(rows)
        left = np.linalg.svd(known)[0][:, known.shape[1] :].T if known.size else np.eye(size)
        left = left - left[:, pivots] @ np.linalg.solve(rows[:, pivots], rows)
        for _ in range(missing):
            sizes = np.abs(left).max(axis=0)
            pivot = int(np.flatnonzero(sizes >= large * sizes.max())[0])  # places come before joints
            k = int(np.abs(left[:, pivot]).argmax())
            row = left[k] / left[k, pivot]
            left = left - left[:, pivot : pivot + 1] * row
            same = [place for place, weight in enumerate(weights) if weight == level + 1]
            rows[same] -= rows[same, pivot : pivot + 1] * row
            rows = np.vstack([rows, row])
            pivots.append(pivot)
            weights.append(level + 1)
    inside = [place for place, weight in enumerate(weights) if weight <= len(flags)]  # others are constant on the leaf
    order = sorted(inside, key=lambda place: (weights[place], pivots[place]))
    return rows[order], [pivots[k] for k in order], [weights[k] for k in order]


def _corrected(
    jets: BracketJets, linear: Array, weights: Sequence[int], kept: Array
) -> tuple[Array, list[Polynomial], float]:
    """Linear parts without rounding errors, polynomials, and the error of their coefficients."""
    deepest = max(weights)
    if deepest == 1:
        return linear, [{} for _ in weights], 0.0
    powers = [_monomials(weights, degree) for degree in range(deepest)]
    spare = 6  # flows above the number of coefficients: least squares averages their errors
    count, pieces = max(map(len, powers)) + spare, max(PIECES, len(kept))
    _, sizes, right = np.linalg.svd(jets.generators[kept], full_matrices=False)
    moving = sizes > _SPAN
    fields = np.random.default_rng(0).normal(size=(count, pieces, int(moving.sum())))
    fields *= np.sqrt(moving.sum()) / (pieces * np.linalg.norm(fields, axis=2, keepdims=True))
    fields = fields / sizes[moving] @ right[moving]  # the joints that matter move over unit lengths
    tried = list[tuple[Array, list[Polynomial], float]]()
    times = (0.5, 0.2, 0.05)  # of flows, tried in turn while the error is large
    for time in times:
        drawn = jets.follow(deepest - 1, time, fields)
        scales = float(time) ** np.arange(deepest)
        series = [np.einsum("cn,mnf->cmf", linear, each / scales[:, None, None]) for each in drawn]
        fine, coarse = (_coefficients(each, weights, powers) for each in series)
        error = float(np.abs(np.concatenate(fine) - np.concatenate(coarse)).max())
        tried.append((*_sorted(fine, linear, powers, weights, error), error))
        if error < _ACCURATE:
            break
    best = min(tried, key=lambda each: each[2])
    wrong = 1e-6  # a polynomial with such coefficients is no approximation of the chart
    if best[2] > wrong:
        raise InfeasibleError(f"privileged coordinates: the error of their coefficients is {best[2]:.1g}")
    return best


def _coefficients(series: Array, weights: Sequence[int], powers: Sequence[Array]) -> list[Array]:
    """Coefficients of the monomials below the weight of each coordinate, from series (c, degrees, flows)."""
    z, found = series.copy(), []
    for j, weight in enumerate(weights):
        chosen = []
        for degree in range(1, weight):
            # Below its weight, a monomial has no Taylor coefficient; the first is the product of the first ones.
            basis = [_product(z[:j], each) for each in powers[degree]]
            matrix = np.array([each[degree] for each in basis]).T
            sizes = np.linalg.norm(matrix, axis=0)
            # Columns of unit length: monomials of small coordinates would look dependent.
            c, _, rank, _ = np.linalg.lstsq(matrix / sizes, -z[j, degree], rcond=_SPAN)
            if rank < len(sizes):
                raise InfeasibleError("privileged coordinates: the flows are too few for their polynomials")
            chosen.append(c / sizes)
            for value, each in zip(chosen[-1], basis, strict=True):
                z[j] += value * each
        found.append(np.concatenate([np.empty(0), *chosen]))
    return found


def _product(z: Array, power: Array) -> Array:
    """Series (degrees, flows) of a monomial of series z (c, degrees, flows)."""
    found = np.zeros(z.shape[1:])
    found[0] = 1.0
    for i in np.flatnonzero(power):
        for _ in range(power[i]):
            found = np.array([sum(found[a] * z[i, d - a] for a in range(d + 1)) for d in range(z.shape[1])])
    return found


def _sorted(
    found: Sequence[Array], linear: Array, powers: Sequence[Array], weights: Sequence[int], error: float
) -> tuple[Array, list[Polynomial]]:
    """Linear parts with corrections of the first power, and polynomials of higher ones, without zero terms."""
    linear, polynomials = linear.copy(), list[Polynomial]()
    noise = 10.0  # times the error: a coefficient below it is zero
    for j, (coefficients, weight) in enumerate(zip(found, weights, strict=True)):
        of = np.concatenate([np.empty((0, len(weights)), dtype=int), *powers[1:weight]])
        for power, value in zip(of, coefficients, strict=True):
            # Linear terms change the linear part; only the others are polynomials beside it.
            if power.sum() == 1:
                linear[j] += value * linear[int(power.argmax())]
        chosen = (of.sum(axis=1) > 1) & (np.abs(coefficients) > max(noise * error, _ACCURATE))
        polynomials.append(dict(zip(map(tuple, of[chosen].tolist()), coefficients[chosen].tolist(), strict=True)))
    linear[np.abs(linear) < max(noise * error, _ACCURATE)] = 0.0
    return linear, polynomials


def _monomials(weights: Sequence[int], degree: int) -> Array:
    """Powers (k, c) of the monomials of a weighted degree."""
    found: list[tuple[tuple[int, ...], int]] = [((), degree)]  # powers of the first coordinates, and the degree left
    for w in weights:
        found = [((*powers, k), left - k * w) for powers, left in found for k in range(left // w + 1)]
    return np.array([powers for powers, left in found if not left], dtype=int).reshape(-1, len(weights))
