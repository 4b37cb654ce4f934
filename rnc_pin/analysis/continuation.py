"""Branches of equilibria and steady motions along a parameter, with their stability."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
import scipy
from numpy import ndarray as Array

from rnc_pin.analysis.derivatives import state_derivatives
from rnc_pin.analysis.equilibrium import Equilibrium, Velocities, search, velocities
from rnc_pin.analysis.lie_brackets import frame_bracket
from rnc_pin.analysis.symmetry import Symmetries, find_symmetries
from rnc_pin.array_shapes import Float
from rnc_pin.errors import ConstraintError, InputError, ModelError, SingularityError, place_of
from rnc_pin.math.linear_algebra import sorted_eigenvalues
from rnc_pin.model.input_validation import vector
from rnc_pin.model.kinematics import Kinematics
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.printing import printed

_GROWS = (
    1e-6  # real part above which a mode grows, relative to the size of A: double zeros are known to its square root
)
_HALVINGS = 8  # largest number of halvings of the parameter step, if no solution is found or it is far away
_FAR = 0.5  # largest change of q in one step; a larger change is another branch [rad or m]
_DEPENDENT = 1e-9

Family = ReducedModel | Callable[[float], ReducedModel]


@printed(eigenvalues="1/s")
@dataclass(frozen=True)
class SteadyMotion:
    """An equilibrium or a steady motion at one value of a parameter, and its stability under constant inputs.

    Attributes:
        value: of the parameter.
        q, v2, T: configuration (nq,), reduced velocities (r,) and inputs (p,).
        eigenvalues: of the linearised reduced system [1/s], without perturbations along symmetries and across holonomic
            rows. They are sorted by real part, then by imaginary part. Zeros belong to neighbouring steady motions.
        stable: True if no mode grows: no eigenvalue has a positive real part.

    Example:
        >>> robot = rnc.Robot.from_urdf("wheeled_pendulum.urdf", base="planar")
        >>> wheels = [rnc.RollingWheel("left_wheel", 0.1), rnc.RollingWheel("right_wheel", 0.1)]
        >>> system = rnc.NonholonomicSystem(robot, wheels, ["left_axle", "right_axle"])
        >>> reduced = system.reduce([rnc.FrameSpeed("base"), rnc.JointPosition("pitch"), rnc.FrameYaw("base")])
        >>> branch = rnc.continuation(reduced, robot.configuration(), [0.0, 1.0], parameter="base_speed_x")
        >>> [motion.stable for motion in branch]  # upright, it falls at any speed
        [False, False]
    """

    value: float
    q: Float[Array, nq]
    v2: Float[Array, r]
    T: Float[Array, p]
    eigenvalues: Array
    stable: bool


def continuation(
    family: Family,
    guess: Array,
    values: Sequence[float] | Array,
    parameter: str | None = None,
    v2: Velocities | None = None,
    hold: Sequence[str] = (),
    cyclic: Sequence[str] = (),
) -> tuple[SteadyMotion, ...]:
    """Follow a branch of equilibria or steady motions along a parameter.

    Each search starts from the extrapolation of the two solutions before it. If no solution is near, the parameter
    takes smaller steps.

    Args:
        family: the model, whose ``parameter`` varies; or a function that builds a model from the parameter's value.
        guess: configuration (nq,) at which the search for the first value starts.
        values: of the parameter, in the order in which the branch is followed.
        parameter: name of the reducing output whose rate takes the values; None with a function.
        v2: reduced velocities in the form of ``equilibrium``, without the parameter.
        hold: joints whose positions stay as in the guess.
        cyclic: joints that may move although the dynamics depend on them, as in ``equilibrium``.

    Raises:
        ConstraintError: no steady motion at some value; says which.
        InputError: shapes do not fit, or a parameter is missing, or given with a function.
        ModelError: no such joint or output.

    Example:
        >>> robot = rnc.Robot.from_urdf("wheeled_pendulum.urdf", base="planar")
        >>> wheels = [rnc.RollingWheel("left_wheel", 0.1), rnc.RollingWheel("right_wheel", 0.1)]
        >>> system = rnc.NonholonomicSystem(robot, wheels, ["left_axle", "right_axle"])
        >>> reduced = system.reduce([rnc.FrameSpeed("base"), rnc.JointPosition("pitch"), rnc.FrameYaw("base")])
        >>> leaning = robot.configuration({"pitch": 2.0})
        >>> turning = rnc.continuation(reduced, leaning, [7.0, 6.0], parameter="base_yaw")
        >>> [round(robot.joint_values(motion.q)["pitch"], 2) for motion in turning]
        [2.13, 2.28]
    """
    values = vector(np.asarray(values, float), np.size(values), "values")
    return _Branch(family, parameter, v2, hold, cyclic).along(np.asarray(guess, float), values)


class _Branch:
    def __init__(
        self,
        family: Family,
        parameter: str | None,
        v2: Velocities | None,
        hold: Sequence[str],
        cyclic: Sequence[str],
    ) -> None:
        if isinstance(family, ReducedModel) == (parameter is None):
            raise InputError(
                "continuation takes a model with the name of a reducing output as parameter, or a function without one"
            )
        self._family, self._parameter, self._v2 = family, parameter, v2
        self._hold, self._cyclic = hold, cyclic
        self._made: tuple[float, ReducedModel] | None = None
        self._symmetries: Symmetries | None = None

    def along(self, guess: Array, values: Array) -> tuple[SteadyMotion, ...]:
        found: list[tuple[float, Equilibrium]] = []
        motions = []
        for value in map(float, values):
            self._reach(value, guess, found)
            motions.append(self._judged(value, found[-1][1]))
        return tuple(motions)

    def _reach(self, value: float, guess: Array, found: list[tuple[float, Equilibrium]]) -> None:
        """Append the solution at a value, and the solutions at the intermediate values that it needs."""
        if not found:
            found.append((value, self._solve(value, guess, None)))
            return
        smallest = abs(value - found[-1][0]) / 2**_HALVINGS
        target = value
        while found[-1][0] != value:
            last, before = found[-1]
            failure: Exception | None = None
            try:
                after = self._solve(target, *self._predicted(target, found))
                change = pin.difference(self._model(target).robot.model, before.q, after.q)
                near = float(np.abs(change).max(initial=0.0)) <= _FAR
            except (ConstraintError, SingularityError) as error:
                failure, near = error, False
            if near:
                found.append((target, after))
                target = value
            elif abs(target - last) <= smallest:
                why = "the only ones found are of another branch" if failure is None else str(failure)
                raise ConstraintError(f"no steady motion at {target:.6g}, next to {last:.6g}: {why}") from failure
            else:
                target = 0.5 * (target + last)

    def _predicted(self, value: float, found: Sequence[tuple[float, Equilibrium]]) -> tuple[Array, Array]:
        """Configuration and velocities by extrapolation from the last two solutions."""
        last, end = found[-1]
        if len(found) == 1 or found[-2][0] == last:
            return end.q, end.v2
        before, start = found[-2]
        model, share = self._model(value).robot.model, (value - last) / (last - before)
        step = share * pin.difference(model, start.q, end.q)
        if np.abs(step).max(initial=0.0) > _FAR:
            return end.q, end.v2
        return pin.integrate(model, end.q, step), end.v2 + share * (end.v2 - start.v2)

    def _solve(self, value: float, q: Array, open_v2: Array | None) -> Equilibrium:
        reduced = self._model(value)
        _ = reduced.at(q)  # raises an error for an invalid configuration
        given, open_rates = self._velocities(reduced, value)
        if open_v2 is not None:
            given[open_rates] = open_v2[open_rates]
        moves = reduced.affine or bool(given.any()) or bool(open_rates.any())
        return search(reduced, q, given, self._hold, self._known(reduced, q) if moves else None, open_rates)

    def _velocities(self, reduced: ReducedModel, value: float) -> tuple[Array, Array]:
        given, open_rates = velocities(reduced, self._v2)
        given = given.copy()
        if self._parameter is not None:
            k = place_of(self._parameter, reduced.reducing.names, "parameter: no reducing output", ModelError)
            given[k], open_rates[k] = value, False
        return given, open_rates

    def _model(self, value: float) -> ReducedModel:
        if isinstance(self._family, ReducedModel):
            return self._family
        if self._made is None or self._made[0] != value:
            self._made, self._symmetries = (value, self._family(value)), None
        return self._made[1]

    def _known(self, reduced: ReducedModel, q: Array) -> Symmetries:
        if self._symmetries is None:
            self._symmetries = find_symmetries(reduced, q, self._cyclic)
        return self._symmetries

    def _judged(self, value: float, found: Equilibrium) -> SteadyMotion:
        reduced = self._model(value)
        A = _modulo_symmetries(reduced, found, self._known(reduced, found.q))
        eigenvalues = sorted_eigenvalues(A)
        grows = _GROWS * max(1.0, float(np.abs(A).max(initial=0.0)))
        stable = bool((eigenvalues.real <= grows).all())
        return SteadyMotion(value, found.q, found.v2, found.T, eigenvalues, stable)


def _modulo_symmetries(reduced: ReducedModel, found: Equilibrium, symmetries: Symmetries) -> Array:
    """System matrix for v2 and for perturbations of q that satisfy the holonomic rows, across the symmetries."""
    reduced = reduced.with_basis_at(found.q)
    d = state_derivatives(reduced, found.q, found.v2, found.T)
    n, bracket = reduced.n, frame_bracket(reduced.robot.model)
    # The system is time-invariant in axes that move with v and with the joints' motions in their own axes.
    carried = d.v - symmetries.own_axes(symmetries.coefficients(found.q, d.v))
    moving = np.stack([bracket(carried, each) for each in np.eye(n)], axis=-1)
    assembly = reduced.assembly
    left_out = [symmetries.directions(found.q).T]
    if assembly.size:
        left_out.append(assembly.jacobian(Kinematics(reduced.robot).position(found.q))[assembly.leading])
    kept = scipy.linalg.null_space(np.vstack(left_out), rcond=_DEPENDENT) if sum(map(len, left_out)) else np.eye(n)
    return np.block([[kept.T @ (d.v_q - moving) @ kept, kept.T @ d.v_v2], [d.v2_dot_q @ kept, d.v2_dot_v2]])
