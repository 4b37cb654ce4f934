"""Configurations at which a reduced system rests, and the inputs that hold it there."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin
import scipy.linalg
from jaxtyping import Float
from numpy import ndarray as Array

from rnc_pin.analysis.derivatives import state_derivatives
from rnc_pin.errors import ConstraintError, InputError
from rnc_pin.model.admission import vector
from rnc_pin.model.kinematics import Kinematics
from rnc_pin.model.reduced_model import ReducedModel

_STEPS, _HALVINGS = 100, 12
_LONGEST = 0.3  # step [rad or m]
_STILL = 1e-10  # acceleration that counts as none, relative to those that gravity causes
_GOOD = 1e-9  # the largest that is accepted, which a linearisation accepts too
_DEPENDENT = 1e-9
_UNACTUATED = 1e-10


class Equilibrium(NamedTuple):
    """Where a system rests, or moves steadily, and what holds it there.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf", gravity=(0, -9.81, 0))
        >>> reduced = rnc.NonholonomicSystem(robot, [], robot.joint_names).reduce()
        >>> found = rnc.equilibrium(reduced, robot.configuration({"joint_1": 0.3}))
        >>> type(found).__name__, found.T.shape, found.residual < 1e-9  # the motors hold it where it is
        ('Equilibrium', (4,), True)
    """

    q: Float[Array, nq]
    """Configuration."""
    T: Float[Array, p]
    """The smallest inputs that do."""
    residual: float
    """Largest reduced force that is left unbalanced [N or N m]."""


def equilibrium(reduced: ReducedModel, guess: Array, hold: Sequence[str] = (), v2: Array | None = None) -> Equilibrium:
    """Find the equilibrium nearest to a guess: ``G(q) = input_matrix(q) T``, the holonomic rows satisfied.

    Newton steps on the configuration manifold with exact derivatives. Where equilibria are many, as those of every
    place on the ground are, it goes towards the one that changes the entries of ``v`` least, in the sum of squares, rad
    and m alike. What the actuators can hold stays as it is.

    Args:
        reduced: the model, fully actuated or not.
        guess: configuration (nq,) to start from.
        hold: joints whose positions stay as in the guess.
        v2: instead of at rest, moving steadily with these reduced velocities (r,): ``v2_dot = 0``.

    Raises:
        ConstraintError: none was found; or constraints are affine, so that nothing rests.
        InputError: shapes do not fit.
        ModelError: no such joint.

    Example:
        >>> robot = rnc.Robot.from_urdf("wheeled_pendulum.urdf", base="planar")
        >>> wheels = [rnc.RollingWheel("left_wheel", 0.1), rnc.RollingWheel("right_wheel", 0.1)]
        >>> system = rnc.NonholonomicSystem(robot, wheels, ["left_axle", "right_axle"])
        >>> reduced = system.reduce([rnc.FrameSpeed("base"), rnc.JointPosition("pitch"), rnc.FrameYaw("base")])
        >>> found = rnc.equilibrium(reduced, robot.configuration({"pitch": 0.3}))
        >>> abs(round(robot.joint_values(found.q)["pitch"], 9))
        0.0
        >>> rnc.linearize(reduced, found.q, T=found.T).A.shape
        (9, 9)
    """
    if reduced.affine:
        raise ConstraintError("constraints are affine, 'A v = mu' with mu not zero: nothing rests under them")
    v2 = np.zeros(reduced.r) if v2 is None else vector(v2, reduced.r, "v2")
    q = np.asarray(guess, float)
    _ = reduced.at(q)  # refuses what is no configuration
    if q.ndim > 1:
        raise InputError(f"the guess has shape {q.shape}, expected one configuration ({reduced.robot.nq},)")
    free = np.ones(reduced.n, dtype=bool)
    for joint in hold:
        free[reduced.robot.velocity_indices(joint)] = False
    search = _Search(reduced, v2, free, q)
    found = search.back_towards_the_guess(search.any_near())
    state = reduced.at(found.q, v2)
    left = state.inverse_dynamics(np.zeros(reduced.r)) - state.input_matrix @ found.T
    return Equilibrium(found.q, found.T, float(np.abs(left).max()))


class _Point(NamedTuple):
    """A configuration on the way."""

    q: Array
    T: Array
    """Inputs that leave the smallest forces."""
    v2_dot: Array
    force: Array
    """What is left unbalanced, over the roots of the inertias that it acts on, (r,)."""
    gap: Array
    """Of the holonomic rows."""
    names: tuple[str, ...]
    """Of the accelerations, (r,)."""

    @property
    def left(self) -> float:
        """How far from an equilibrium."""
        return float(np.linalg.norm(np.concatenate([self.force, self.gap])))


class _Search:
    def __init__(self, reduced: ReducedModel, v2: Array, free: Array, guess: Array) -> None:
        self._reduced, self._v2, self._free, self._guess = reduced, v2, free, guess
        self._model = reduced.robot.model
        self._kinematics = Kinematics(reduced.robot)
        self._size = 1.0 + float(np.linalg.norm(self._model.gravity.linear)) + float(v2 @ v2)

    def any_near(self) -> _Point:
        """An equilibrium, by steps that are as small as can be."""
        here = self._at(self._guess)
        for _ in range(_STEPS):
            if self._rests(here, _STILL):
                return here
            ahead = self._ahead(here)
            if ahead is None:
                break
            here = ahead
        if self._rests(here):
            return here
        worst, apart = int(np.argmax(np.abs(here.v2_dot))), ""
        if (np.abs(here.gap) > _GOOD).any():
            row, gap = self._reduced.assembly.worst(here.q)
            apart = f", and {row} is left {abs(gap):.3g} from zero"
        raise ConstraintError(
            f"no equilibrium found near the guess: at best the rate of '{here.names[worst]}' changes by "
            f"{here.v2_dot[worst]:.3g} a second{apart}"
        )

    def _ahead(self, here: _Point) -> _Point | None:
        """Where Newton's step leads, halved until that is nearer to an equilibrium; None if it never is."""
        step = self._limited(self._newton(here)[0])
        for _ in range(_HALVINGS):
            ahead = self._at(pin.integrate(self._model, here.q, step))
            if ahead.left < here.left:
                return ahead
            step = 0.5 * step
        return None

    def back_towards_the_guess(self, found: _Point) -> _Point:
        """Of equilibria in one piece with one, that nearest to the guess; itself where the way there is not clear."""
        here = found
        for _ in range(_STEPS):
            newton, null_space = self._newton(here)
            away = pin.difference(self._model, self._guess, here.q)
            step = self._limited(newton - null_space @ (null_space.T @ away))
            if np.abs(step).max() <= _STILL:
                break
            here = self._at(pin.integrate(self._model, here.q, step))
        return here if self._rests(here) and self._distance(here) < self._distance(found) else found

    def _distance(self, point: _Point) -> float:
        return float(np.linalg.norm(pin.difference(self._model, self._guess, point.q)))

    def _rests(self, point: _Point, still: float = _GOOD) -> bool:
        return bool((np.abs(point.v2_dot) <= still * self._size).all() and (np.abs(point.gap) <= _GOOD).all())

    def _limited(self, step: Array) -> Array:
        return step / max(1.0, float(np.abs(step).max()) / _LONGEST)

    def _at(self, q: Array) -> _Point:
        reduced = self._reduced.settled_at(q)
        assembly = reduced.assembly
        state = reduced.at(q, self._v2)
        scale = 1.0 / np.sqrt(np.diag(state.H))
        influence = scale[:, None] * state.input_matrix
        needed = scale * state.inverse_dynamics(np.zeros(reduced.r))
        T = np.linalg.pinv(influence, rcond=_UNACTUATED) @ needed
        gap = assembly.residual(q)[assembly.leading]
        return _Point(q, T, state.v2_dot(T), influence @ T - needed, gap, reduced.reducing.names)

    def _newton(self, here: _Point) -> tuple[Array, Array]:
        """The least change of q (nv,) towards an equilibrium, and a basis (nv, k) of those that keep to equilibria."""
        reduced = self._reduced.settled_at(here.q)
        n = reduced.n
        derivatives = state_derivatives(reduced, here.q, self._v2, here.T)
        # Of the unbalanced force H v2_dot, since what H does far from an equilibrium must not lead astray.
        along = reduced.at(np.tile(here.q, (n, 1)), v=np.eye(n))
        R, R_dot, M = along.R, along.R_dot, along.M
        H_q = R_dot.mT @ M @ R + R.mT @ M @ R_dot + R.mT @ (along.C + along.C.mT) @ R
        H = reduced.inertia(here.q)
        scale = 1.0 / np.sqrt(np.diag(H))[:, None]
        force_q = scale * (H @ derivatives.v2_dot_q + (H_q @ here.v2_dot).T)
        # Inputs take up what they can; the rest, and the holonomic rows, are for q.
        influence = scale * (H @ derivatives.v2_dot_T)
        unreached = scipy.linalg.null_space(influence.T, rcond=_UNACTUATED) if reduced.p else np.eye(reduced.r)
        rows, gap = unreached.T @ force_q, unreached.T @ here.force
        assembly = reduced.assembly
        if assembly.size:
            closing = assembly.jacobian(self._kinematics.position(here.q))[assembly.leading]
            rows, gap = np.vstack([rows, closing]), np.concatenate([gap, here.gap])
        rows = rows[:, self._free]
        step = np.zeros(reduced.n)
        if len(rows):
            step[self._free] = np.linalg.lstsq(rows, -gap, rcond=_DEPENDENT)[0]
            kernel = scipy.linalg.null_space(rows, rcond=_DEPENDENT)
        else:
            kernel = np.eye(int(self._free.sum()))
        basis = np.zeros((reduced.n, kernel.shape[1]))
        basis[self._free] = kernel
        return step, basis
