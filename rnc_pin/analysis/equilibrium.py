"""Equilibria and steady motions of a reduced system, the inputs that hold them, and the symmetries of the system.

In a steady motion (a relative equilibrium) the shape and the reduced velocities are constant. The velocity is a
combination of symmetries: directions of motion along which the system does not change, such as driving on flat ground,
turning in place or spinning wheels.

The search for symmetries covers two kinds: motions of the whole robot in the world, and motions of joints in their own
axes, such as about a wheel's axle. Along a symmetry, the velocities of all bodies, the reduced accelerations and the
holonomic rows do not change, at given reduced velocities and inputs. These changes are linear in the direction and come
from analytic derivatives. So the symmetries are a null space over sampled states.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin
import scipy

from rnc_pin.analysis.derivatives import StateDerivatives, state_derivatives
from rnc_pin.analysis.lie_brackets import frame_bracket
from rnc_pin.array_shapes import Array, Float
from rnc_pin.errors import ConstraintError, ModelError, SingularityError, place_of
from rnc_pin.math.linear_algebra import null_space
from rnc_pin.model.input_validation import admit_configuration, vector
from rnc_pin.model.kinematics import Kinematics
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.printing import printed
from rnc_pin.robots.robot import Robot

_STEPS = 100  # largest number of Newton steps
_STILL = 1e-10  # acceleration that counts as zero, relative to gravity's
_GOOD = 1e-9  # largest accepted acceleration, on the same scale; a linearization accepts it too
_ROUNDED = 1e-6  # largest accepted shape rates and gaps in motion: symmetries of a rounded file are no more accurate
_DEPENDENT = 1e-9  # relative singular value below which coordinates are dependent
_UNACTUATED = 1e-10  # relative singular value below which no input reaches a direction


@printed(residual="N or N m")
class Equilibrium(NamedTuple):
    """Equilibrium or steady motion of a reduced system, and the inputs that hold it.

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
    """The smallest inputs that hold the system."""
    residual: float
    """Largest unbalanced reduced force [N or N m]."""
    v2: Float[Array, r]
    """Reduced velocities; zero at rest."""


Velocities = Array | Sequence[float] | Mapping[str, float]


def equilibrium(
    reduced: ReducedModel,
    guess: Array,
    hold: Sequence[str] = (),
    v2: Velocities | None = None,
    cyclic: Sequence[str] = (),
) -> Equilibrium:
    """Find the equilibrium or the steady motion nearest to a guess.

    At rest ``G(q) = input_matrix(q) T`` holds, and the holonomic rows are satisfied. In a steady motion ``v2`` is
    constant and no shape variable moves: the velocity is a combination of symmetries, found by ``find_symmetries``.
    Examples are the hitch angles of a vehicle in a circle, and the lean of a turning pendulum. With affine constraints,
    as on a table that turns at a given rate, a motion with ``v2 = 0`` is steady too.

    The method is Newton's on the configuration manifold, with exact derivatives. Often there are many solutions, such
    as one at every place on the ground. Then the search goes to the solution with the least change of the entries of
    ``v``: the least sum of squares, rad and m alike. Directions that the actuators can hold do not change.

    Args:
        reduced: the model, fully actuated or not.
        guess: configuration (nq,) to start from.
        hold: joints whose positions stay as in the guess.
        v2: reduced velocities (r,) of a steady motion; or rates of some reducing outputs by name. The search then finds
            the others, near zero. At rest by default.
        cyclic: joints, or entries of v by name, that may move although the dynamics depend on them, such as a slightly
            unbalanced wheel. The motion is then steady at their present position only.

    Raises:
        ConstraintError: no solution was found; the message names the shape variable or velocity that changes.
        InputError: shapes do not fit.
        ModelError: unknown joint or output.

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
        >>> turning = rnc.equilibrium(reduced, robot.configuration({"pitch": 2.0}), v2=[0.0, 0.0, 7.0])
        >>> round(robot.joint_values(turning.q)["pitch"], 3)  # weight and centrifugal force balance
        2.125
    """
    q = admit_configuration(guess, reduced.robot, "guess")
    given, open_rates = _velocities(reduced, v2)
    moves = reduced.affine or bool(given.any()) or bool(open_rates.any())
    # At rest every configuration is a candidate; symmetries cost derivatives at several states.
    symmetries = find_symmetries(reduced, q, cyclic) if moves else None
    free = np.ones(reduced.n, dtype=bool)
    for joint in hold:
        free[reduced.robot.velocity_indices(joint)] = False
    looking = _Search(reduced, given, free, q, symmetries, open_rates)
    found = looking.back_towards_the_guess(looking.any_near())
    state = reduced.at(found.q, found.v2)
    left = state.inverse_dynamics(np.zeros(reduced.r)) - state.input_matrix @ found.T
    return Equilibrium(found.q, found.T, float(np.abs(left).max()), found.v2)


def _velocities(reduced: ReducedModel, v2: Velocities | None) -> tuple[Array, Array]:
    """Reduced velocities (r,), all or some of them given, and a mask (r,) of the unknown ones."""
    found, names = np.zeros(reduced.r), reduced.reducing.names
    if not isinstance(v2, Mapping):
        return found if v2 is None else vector(v2, reduced.r, "v2"), np.zeros(reduced.r, dtype=bool)
    given = [place_of(name, names, "v2: no reducing output", ModelError) for name in v2]
    found[given] = vector(np.array(list(v2.values()), dtype=float), len(v2), "v2")
    return found, ~np.isin(np.arange(reduced.r), given)


class _Point(NamedTuple):
    """Iterate of the search."""

    q: Array
    T: Array
    """Inputs that leave the smallest unbalanced forces."""
    v2_dot: Array
    force: Array
    """Unbalanced forces over the square roots of the inertias that they act on, (r,)."""
    gap: Array
    """Errors of the holonomic rows."""
    v2: Array
    shape_rates: Array
    """Part of v (nv,) outside the symmetries; empty at rest."""

    @property
    def left(self) -> float:
        """Norm of the residual: distance from an equilibrium."""
        return float(np.linalg.norm(np.concatenate([self.force, self.gap, self.shape_rates])))


class _Search:
    def __init__(
        self,
        reduced: ReducedModel,
        v2: Array,
        free: Array,
        guess: Array,
        symmetries: Symmetries | None,
        open_rates: Array,
    ) -> None:
        self._reduced, self._v2, self._guess = reduced, v2, guess
        self._symmetries, self._open = symmetries, open_rates
        self._free = np.concatenate([free, np.ones(int(self._open.sum()), dtype=bool)])
        self._model = reduced.robot.model
        self._kinematics = Kinematics(reduced.robot)
        # Gravity and the motion give the scale: a residual counts as a part of their accelerations.
        b = reduced.at(guess).b
        self._size = 1.0 + float(np.linalg.norm(self._model.gravity.linear)) + float(v2 @ v2) + float(b @ b)

    def any_near(self) -> _Point:
        """Return an equilibrium near the guess, by Newton steps of least norm, halved until the residual decreases."""
        here = self._at(self._guess, self._v2)
        for _ in range(_STEPS):
            # Further than accepted: a Newton step costs little, and linearizations build on the result.
            if self._rests(here, _STILL):
                return here
            step = self._limited(self._newton(here)[0])
            halvings = 12  # a step that improves nothing at 1/4096 of its length points the wrong way
            tried = (self._after(here, 0.5**k * step) for k in range(halvings))
            ahead = next((each for each in tried if each.left < here.left), None)
            if ahead is None:
                break
            here = ahead
        if self._rests(here):
            return here
        raise self._not_found(here)

    def _not_found(self, here: _Point) -> ConstraintError:
        apart = ""
        if (np.abs(here.gap) > _GOOD).any():
            row, gap = self._reduced.assembly.worst(here.q)
            apart = f", and {row} is left {abs(gap):.3g} from zero"
        kind = "equilibrium" if self._symmetries is None else "steady motion"
        if (np.abs(here.shape_rates) > _ROUNDED * self._size).any():
            worst = int(np.argmax(np.abs(here.shape_rates)))
            name = self._reduced.robot.velocity_names[worst]
            changes = f"the shape variable '{name}' moves by {here.shape_rates[worst]:.3g} a second"
        else:
            worst = int(np.argmax(np.abs(here.v2_dot)))
            name = self._settled(here.q).reducing.names[worst]
            changes = f"the rate of '{name}' changes by {here.v2_dot[worst]:.3g} a second"
        return ConstraintError(f"no {kind} found near the guess: at best " + changes + apart)

    def back_towards_the_guess(self, found: _Point) -> _Point:
        """Return the equilibrium nearest to the guess on the same branch; ``found`` itself if the way is blocked."""
        here = found
        for _ in range(_STEPS):
            newton, null_space = self._newton(here)
            # Along neutral directions back towards the guess, while Newton's part keeps the point on the branch.
            step = self._limited(newton - null_space @ (null_space.T @ self._away(here)))
            if np.abs(step).max() <= _STILL:
                break
            here = self._after(here, step)
        # The way back may leave the branch: the result counts only if it rests and is nearer.
        is_nearer = np.linalg.norm(self._away(here)) < np.linalg.norm(self._away(found))
        return here if is_nearer and self._rests(here) else found

    def _after(self, here: _Point, step: Array) -> _Point:
        n, v2 = self._reduced.n, here.v2.copy()
        v2[self._open] += step[n:]
        return self._at(pin.integrate(self._model, here.q, step[:n]), v2)

    def _away(self, point: _Point) -> Array:
        """Difference from the guess, in q and in the unknown rates."""
        return np.concatenate([pin.difference(self._model, self._guess, point.q), (point.v2 - self._v2)[self._open]])

    def _rests(self, point: _Point, still: float = _GOOD) -> bool:
        kept = still if self._symmetries is None or still < _GOOD else _ROUNDED
        return bool(
            (np.abs(point.v2_dot) <= still * self._size).all()
            and (np.abs(point.gap) <= max(_GOOD, kept)).all()
            and (np.abs(point.shape_rates) <= kept * self._size).all()
        )

    def _limited(self, step: Array) -> Array:
        longest = 0.3  # step [rad or m]: Newton's step is a guess where it is long
        return step / max(1.0, float(np.abs(step).max()) / longest)

    def _at(self, q: Array, v2: Array) -> _Point:
        reduced = self._settled(q)
        assembly = reduced.assembly
        state = reduced.at(q, v2)
        # Forces over the root of their inertia compare a finger with a base, and are near the acceleration's size.
        scale = 1.0 / np.sqrt(np.diag(state.H))
        influence = scale[:, None] * state.input_matrix
        needed = scale * state.inverse_dynamics(np.zeros(reduced.r))
        # The inputs of least norm are no unknowns of the search: they balance what they reach, at every iterate.
        T = np.linalg.pinv(influence, rcond=_UNACTUATED) @ needed
        gap = assembly.residual(q)[assembly.leading]
        rates = np.zeros(0)
        if self._symmetries is not None:
            rates = state.v - self._symmetries.directions(q) @ self._symmetries.coefficients(q, state.v)
        return _Point(q, T, state.v2_dot(T), influence @ T - needed, gap, v2, rates)

    def _settled(self, q: Array) -> ReducedModel:
        """Model with the rows selected at q; its reducing outputs may change only in a search at rest."""
        reduced = self._reduced.with_basis_at(q)
        # Rates of a steady motion are given by the names of the outputs: with other outputs they would be other
        # numbers.
        same = self._symmetries is None or reduced.reducing.names == self._reduced.reducing.names
        return reduced if same else self._reduced

    def _newton(self, here: _Point) -> tuple[Array, Array]:
        """Least change of q and unknown rates (nv + k,) towards an equilibrium, and a basis of neutral changes."""
        reduced = self._settled(here.q)
        n = reduced.n
        derivatives = state_derivatives(reduced, here.q, here.v2, here.T)
        # The residual is the force H v2_dot: changes of H far from an equilibrium must not mislead the search.
        along = reduced.at(np.tile(here.q, (n, 1)), v=np.eye(n))
        R, R_dot, M = along.R, along.R_dot, along.M
        H_q = R_dot.mT @ M @ R + R.mT @ M @ R_dot + R.mT @ (along.C + along.C.mT) @ R
        H = reduced.at(here.q).H
        scale = 1.0 / np.sqrt(np.diag(H))[:, None]
        # Scaled to unit inertia: residuals of outputs with different units count alike.
        force_q = scale * (H @ derivatives.v2_dot_q + (H_q @ here.v2_dot).T)
        force_x = np.hstack([force_q, scale * (H @ derivatives.v2_dot_v2[:, self._open])])
        # Inputs balance as much as they can; q balances the rest and satisfies the holonomic rows.
        influence = scale * (H @ derivatives.v2_dot_T)
        unreached = null_space(influence.T, _UNACTUATED)
        rows, gap = unreached.T @ force_x, unreached.T @ here.force
        closing = reduced.assembly.jacobian(self._kinematics.position(here.q))[reduced.assembly.leading]
        closing = np.pad(closing, ((0, 0), (0, int(self._open.sum()))))
        rows, gap = np.vstack([rows, closing]), np.concatenate([gap, here.gap])
        if self._symmetries is not None:
            # A steady motion may drift along symmetries: only its shape has to rest.
            rows = np.vstack([rows, self._shape_gradient(here, derivatives)])
            gap = np.concatenate([gap, here.shape_rates])
        rows = rows[:, self._free]
        kernel = null_space(rows, _DEPENDENT)
        step, basis = np.zeros(len(self._free)), np.zeros((len(self._free), kernel.shape[1]))
        # The least change: the equilibrium nearest to the guess.
        step[self._free], basis[self._free] = np.linalg.lstsq(rows, -gap, rcond=_DEPENDENT)[0], kernel
        return step, basis

    def _shape_gradient(self, here: _Point, derivatives: StateDerivatives) -> Array:
        """Derivatives (nv, nv + k) of the shape rates; exact if the shape rates are zero."""
        assert self._symmetries is not None
        directions = self._symmetries.directions(here.q)
        coefficients = self._symmetries.coefficients(here.q, derivatives.v)
        along_q = derivatives.v_q - self._symmetries.gradient(here.q, coefficients)
        changes = np.hstack([along_q, derivatives.v_v2[:, self._open]])
        # Changes along the symmetries move no shape: only what is across them counts.
        symmetric = scipy.linalg.orth(directions, rcond=_DEPENDENT)
        return changes - symmetric @ (symmetric.T @ changes)


# ------------------------------------------------------------------ symmetries


class Symmetries:
    """Symmetries of a reduced system.

    Args:
        reduced: the model.
        twists: motions of the whole robot, (6, k) in the world [m/s, rad/s].
        joints: rates of joints in their own axes, (nv, s - k); there are s symmetries.
    """

    def __init__(self, reduced: ReducedModel, twists: np.ndarray, joints: np.ndarray) -> None:
        self._model = reduced.robot.model
        self._data = self._model.createData()
        self._twists, self._joints = twists, joints

    def coefficients(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return the least-squares coefficients (s,) of the symmetries in a velocity (nv,).

        Args:
            q: configuration (nq,).
            v: the velocity.
        """
        dependent = 1e-9  # relative singular value: symmetries may coincide at some configurations
        return np.linalg.lstsq(self.directions(q), v, rcond=dependent)[0]

    def directions(self, q: np.ndarray) -> np.ndarray:
        """Return the velocities (nv, s) of the symmetries at a configuration (nq,).

        Args:
            q: the configuration.
        """
        return np.hstack([_whole_motions(self._model, self._data, q)[0] @ self._twists, self._joints])

    def gradient(self, q: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
        """Return the derivatives (nv, nv) of ``directions(q) @ coefficients``; the last index is the direction.

        Args:
            q: configuration (nq,).
            coefficients: coefficients of the symmetries (s,).
        """
        n, model = self._model.nv, self._model
        result = np.zeros((n, n))
        X, inverse, _ = _whole_motions(model, self._data, q)
        velocity = X @ self._twists @ coefficients[: self._twists.shape[1]]
        for direction in range(n):  # derivative of J X = twist, with constant twist
            pin.computeJointJacobiansTimeVariation(model, self._data, q, np.eye(n)[direction])
            rates = [
                pin.getJointJacobianTimeVariation(model, self._data, joint, pin.WORLD).reshape(6, n) @ velocity
                for joint in range(1, model.njoints)
            ]
            result[:, direction] = -inverse @ np.concatenate(rates)
        return result


def find_symmetries(reduced: ReducedModel, q: np.ndarray, cyclic: Sequence[str] = ()) -> Symmetries:
    """Return the symmetries of a system, by derivatives at sampled states near a configuration.

    Args:
        reduced: the model.
        q: configuration (nq,) in the middle of the samples.
        cyclic: joints, or entries of v, that count as symmetries although the dynamics depend on them.

    Raises:
        ModelError: unknown joint.
        ConstraintError: no regular configurations near q.
    """
    robot, n = reduced.robot, reduced.n
    model, data = robot.model, robot.model.createData()
    of_robot, of_joints = [np.zeros((0, 6))], [np.zeros((0, n))]
    # A fixed seed: the same system always has the same symmetries.
    generator = np.random.default_rng(0)
    for configuration in _sampled(reduced, q, generator):
        here = reduced.with_basis_at(configuration)
        joints, bodies, others = _changes(here, configuration, generator)
        X, _, misfit = _whole_motions(model, data, configuration)
        of_robot += [misfit, *(_scaled(each) @ X for each in (bodies, *others))]
        of_joints += [_scaled(each) for each in (joints, *others)]
    unchanged = 1e-6  # singular value of changes that count as zero: each kind is scaled to one
    spaces = (np.linalg.svd(np.vstack(rows), full_matrices=False) for rows in (of_robot, of_joints))
    twists, joints = (right[values < unchanged].T for _, values, right in spaces)
    columns = [joints, *(np.eye(robot.nv)[:, entries_of(robot, name)] for name in cyclic)]
    return Symmetries(reduced, twists, scipy.linalg.orth(np.hstack(columns)))


def entries_of(robot: Robot, name: str) -> list[int]:
    """Return the indices in v of a joint, or of an entry of v by name.

    Args:
        robot: the robot.
        name: name of a joint, or of an entry of v.
    """
    names = robot.velocity_names
    return [names.index(name)] if name in names else [*range(robot.nv)[robot.velocity_indices(name)]]


def _changes(
    reduced: ReducedModel, q: np.ndarray, generator: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, tuple[np.ndarray, np.ndarray]]:
    """Changes of the system along each direction, (k, nv) each, at random velocities and inputs.

    First those of the velocity in axes that move along with the joints, then those of all body velocities in body axes,
    which show motions of the whole robot; last those of the reduced accelerations, and of the holonomic rows.
    """
    v2, T = generator.normal(size=reduced.r), generator.normal(size=reduced.p)
    derivatives = state_derivatives(reduced, q, v2, T)
    model, assembly = reduced.robot.model, reduced.assembly
    data = model.createData()
    pin.computeForwardKinematicsDerivatives(model, data, q, derivatives.v, np.zeros(reduced.n))
    bodies = []
    for joint in range(1, model.njoints):
        along_q, along_v = pin.getJointVelocityDerivatives(model, data, joint, pin.LOCAL)
        # A single column arrives as a vector.
        # In its own axes a symmetry of the whole robot changes no velocity of a body.
        bodies.append(along_q.reshape(6, -1) + along_v.reshape(6, -1) @ derivatives.v_q)
    closing = assembly.jacobian(Kinematics(reduced.robot).position(q))[assembly.leading]
    # Velocities are in moving frames: the change along a field has the bracket of the joints' groups too.
    carried = frame_bracket(model)(np.eye(reduced.n), derivatives.v).T
    return derivatives.v_q + carried, np.vstack(bodies), (derivatives.v2_dot_q, closing)


def _sampled(reduced: ReducedModel, q: np.ndarray, generator: np.random.Generator) -> list[np.ndarray]:
    """Regular configurations near a given one that satisfy the holonomic rows."""
    found: list[np.ndarray] = []
    samples, tries = 4, 40  # states that decide, and configurations tried for them: some cannot be assembled
    spread = 1.0  # [rad or m]: far enough that accidental symmetries of one configuration vanish
    for _ in range(tries):
        tangent = generator.uniform(-spread, spread, reduced.n)
        try:
            configuration = reduced.assembled(pin.integrate(reduced.robot.model, q, tangent))
            _ = reduced.at(configuration).R
        except (ConstraintError, SingularityError):
            continue
        found.append(configuration)
        if len(found) == samples:
            return found
    raise ConstraintError("no steady motion: there are no regular configurations near the guess")


def _whole_motions(model: pin.Model, data: pin.Data, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Velocities (nv, 6) that move all bodies with a unit twist, the inverse that gave them, and the misfit."""
    pin.computeJointJacobians(model, data, q)
    joints = range(1, model.njoints)
    J = np.vstack([pin.getJointJacobian(model, data, joint, pin.WORLD).reshape(6, -1) for joint in joints])
    # One velocity for all bodies to have the same twist; the misfit tells that a fixed base has none.
    inverse, twists = np.linalg.pinv(J), np.tile(np.eye(6), (len(joints), 1))
    X = inverse @ twists
    return X, inverse, J @ X - twists


def _scaled(changes: np.ndarray) -> np.ndarray:
    largest = np.abs(changes).max(initial=0.0)
    no_change = 1e-12  # absolute zero limit for the changes along all directions
    # Each kind of change has its own unit: scaled, the limit of the null space is the same for all.
    return changes / largest if largest > no_change else np.zeros_like(changes)
