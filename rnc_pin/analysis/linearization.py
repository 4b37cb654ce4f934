"""Linear state-space models about equilibria and steady motions, and their linear-quadratic regulators."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pinocchio as pin
import scipy

from rnc_pin.analysis.derivatives import StateDerivatives, state_derivatives
from rnc_pin.analysis.equilibrium import entries_of
from rnc_pin.analysis.lie_brackets import frame_bracket
from rnc_pin.array_shapes import Array, Float
from rnc_pin.errors import (
    ConfigurationError,
    ConstraintError,
    InfeasibleError,
    InputError,
    ModelError,
    check_extra,
    place_of,
)
from rnc_pin.math.linear_algebra import null_space, weakest_rows
from rnc_pin.model.independence import ROUNDING
from rnc_pin.model.input_validation import admit_numbers
from rnc_pin.model.kinematics import Kinematics
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.reduction_data import VelocityRows, best_entries
from rnc_pin.model.rows import OutputKind, OutputRows, OutputStack
from rnc_pin.printing import printed

_STEADY = 1e-8  # largest acceleration that counts as zero, relative to the accelerations that gravity causes

Coordinate = str | OutputKind


@printed()
@dataclass(frozen=True)
class Linearization:
    """``x' = A x + B u`` for small deviations ``x = (coordinates, v2 - v2_0)`` and ``u = T - T_0``.

    The arrays are what ``scipy.linalg.solve_continuous_are`` takes; :meth:`to_control` is for python-control.

    Attributes:
        A, B: system matrix (s, s) and input matrix (s, p) for s states and p inputs.
        input_names: the actuators.
        v2, T: reduced velocity and inputs of the linearised motion.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf", gravity=(0, -9.81, 0))
        >>> reduced = rnc.NonholonomicSystem(robot, [], robot.joint_names).reduce()
        >>> linear = rnc.linearize(reduced, robot.configuration({"platform": -np.pi / 2}))  # it hangs down
        >>> linear.A.shape, linear.B.shape
        ((8, 8), (8, 4))
        >>> bool(np.abs(linear.eigenvalues.real).max() < 1e-6)  # and swings
        True
    """

    A: Float[Array, "s s"]
    B: Float[Array, "s p"]
    state_names: tuple[str, ...]
    """Coordinates, then reducing rates; rates of coordinates end in ``_dot``."""
    input_names: tuple[str, ...]
    q: Float[Array, nq]
    """Configuration of the linearised motion."""
    v2: Float[Array, r]
    T: Float[Array, p]
    difference_error: float
    """Estimated error of finite differences; 0.0 if every derivative is in closed form."""
    reducing: OutputStack = field(repr=False)
    """The outputs whose rates are states."""
    _read: _Coordinates = field(repr=False)
    _kept: list[int] = field(repr=False)

    @property
    def eigenvalues(self) -> Array:
        """Eigenvalues of A (s,) [1/s], by real and then by imaginary part; real parts of rounding count as zero."""
        values = np.linalg.eigvals(self.A)
        rounding_part = 1e-12  # part of the largest eigenvalue below which a real part is rounding
        rounding = rounding_part * np.abs(values).max(initial=0.0)
        order = np.lexsort((values.imag, np.where(np.abs(values.real) > rounding, values.real, 0.0)))
        return np.asarray(values[order])

    def deviation(self, q: Array, v2: Array) -> Array:
        """Return the state x (s,) at q (nq,) and v2 (r,), for a feedback ``T = T_0 - K x``.

        Args:
            q: configuration (nq,).
            v2: reduced velocity (r,).
        """
        rates = (np.asarray(v2, float) - self.v2)[self._kept]
        return np.concatenate([self._read.deviation(np.asarray(q, float), self.q), rates])

    def to_control(self) -> Any:
        """Return a ``StateSpace`` of python-control, whose outputs are the states: deviations from the motion.

        Names are those of states and inputs, with ``_`` for a dot, which python-control does not allow.

        Raises:
            ConfigurationError: python-control is not installed.
        """
        check_extra("control", "to_control")
        import control  # with Matplotlib, which takes a second

        states, inputs = ([each.replace(".", "_") for each in names] for names in (self.state_names, self.input_names))
        C, D = np.eye(len(states)), np.zeros_like(self.B)
        return control.ss(self.A, self.B, C, D, states=states, inputs=inputs, outputs=states)


def linearize(
    reduced: ReducedModel,
    q: Array,
    v2: Array | None = None,
    T: Array | None = None,
    coordinates: Sequence[Coordinate] | None = None,
    rates: Sequence[str] | None = None,
    cyclic: Sequence[str] = (),
) -> Linearization:
    """Linearise a reduced system about an equilibrium or a steady motion.

    In a steady motion q changes and ``v2`` is constant: a bicycle that rolls straight ahead. The state must then omit
    the coordinates that move or that nothing depends on (place, heading, wheel angles). To omit them, name the others
    in ``coordinates``. Likewise, ``rates`` may omit decoupled velocities (the forward speed). ``linearize`` checks that
    the motion is steady and that no kept state depends on an omitted one. Perturbations satisfy the constraints that
    are declared as holonomic.

    Args:
        reduced: the model, with any number of actuators.
        q: configuration (nq,).
        v2: reduced velocity (r,); at rest by default.
        T: inputs that hold the motion (p,); by default the smallest ones.
        coordinates: configuration part of the state: outputs, or entries of ``v`` by name (``robot.velocity_names``).
            An entry of ``v`` is a small motion of that joint; ``"root_joint[3]"`` is the roll of a free base in its own
            axes. By default all entries of ``v``, as perturbations in a frame that moves along with the motion; of
            coordinates that holonomic rows relate, such as heights of wheels, as many as they leave free.
        rates: names of the reducing outputs whose rates are states; all of them by default.
        cyclic: joints, or entries of v by name, whose positions count as having no effect although they have a small
            one, such as the angle of a slightly non-round wheel; the same as in ``equilibrium``.

    Raises:
        InputError: shapes do not fit, or no coordinate and no rate is left.
        ConstraintError: no equilibrium and no steady motion under these inputs; or the coordinates move, depend on
            each other, or are not a closed set.
        ModelError: unknown name.
        SingularityError: the reducing outputs do not parametrise the motion at q.

    Example:
        >>> robot = rnc.Robot.from_urdf("wheeled_pendulum.urdf", base="planar")
        >>> wheels = [rnc.RollingWheel("left_wheel", 0.1), rnc.RollingWheel("right_wheel", 0.1)]
        >>> system = rnc.NonholonomicSystem(robot, wheels, ["left_axle", "right_axle"])
        >>> reduced = system.reduce([rnc.FrameSpeed("base"), rnc.JointPosition("pitch"), rnc.FrameYaw("base")])
        >>> upright = robot.configuration()
        >>> linear = rnc.linearize(reduced, upright, coordinates=["pitch"], rates=["base_speed_x", "pitch"])
        >>> linear.state_names
        ('pitch', 'base_speed_x', 'pitch_dot')
    """
    q = admit_numbers(q, "q")
    reduced = reduced.with_basis_at(q)
    v2 = np.zeros(reduced.r) if v2 is None else admit_numbers(v2, "v2")
    state = reduced.at(q, v2)
    # By the pseudoinverse: of more inputs than necessary, the smallest that hold the state.
    holding = np.linalg.pinv(state.input_matrix) @ state.inverse_dynamics(np.zeros(reduced.r)) if T is None else T
    T = np.asarray(holding, float)
    derivatives = state_derivatives(reduced, q, v2, T)
    _check_steady(reduced, v2, T, derivatives.v2_dot)
    A, B = _whole(reduced, derivatives)
    for name in cyclic:
        A[:, entries_of(reduced.robot, name)] = 0.0
    held, names = state.A[list(reduced.constraints.holonomic)], reduced.robot.velocity_names
    # Heights of wheels follow from the other entries: an entry for each would be a state that no input moves.
    own = names if not len(held) else [names[k] for k in best_entries(held, reduced.n - len(held))]
    read = _Coordinates(reduced, own if coordinates is None else coordinates)
    outputs = reduced.reducing
    chosen = outputs.names if rates is None else rates
    kept = [place_of(name, outputs.names, "no reducing output", ModelError) for name in chosen]
    if not (read.names or kept):
        raise InputError("coordinates and rates are both empty: the state needs at least one entry")
    if coordinates is not None or len(held) or len(kept) < reduced.r:
        moving = derivatives.v if coordinates is not None else np.zeros(reduced.n)
        A, B = _restricted(reduced, read, kept, moving, q, A, B)
    rate_names = [each + "_dot" * (not outputs.quasi[i] or each in read.names) for i, each in enumerate(outputs.names)]
    state_names, difference_error = (*read.names, *(rate_names[i] for i in kept)), float(derivatives.difference_error)
    motion = reduced.actuation.names, q, v2, T
    return Linearization(A, B, state_names, *motion, difference_error, outputs, read, kept)


def _check_steady(reduced: ReducedModel, v2: Array, T: Array, v2_dot: Array) -> None:
    size = 1.0 + float(np.linalg.norm(reduced.robot.model.gravity.linear)) + float(v2 @ v2)
    if np.abs(v2_dot).max() > _STEADY * size:
        worst = int(np.argmax(np.abs(v2_dot)))
        raise ConstraintError(
            f"not an equilibrium and not a steady motion: under T = {np.array2string(T, precision=4)} the rate of "
            f"'{reduced.reducing.names[worst]}' changes by {v2_dot[worst]:.3g} a second"
        )


def _whole(reduced: ReducedModel, d: StateDerivatives) -> tuple[Array, Array]:
    """A and B for perturbations ``(xi, v2 - v2_0)`` with ``q = q_0(t) (+) xi``."""
    # In axes that move with v, xi' = (velocity) - (velocity of the motion) + [xi, v].
    carried = frame_bracket(reduced.robot.model)(np.eye(reduced.n), d.v).T
    A = np.block([[d.v_q + carried, d.v_v2], [d.v2_dot_q, d.v2_dot_v2]])
    return A, np.vstack([np.zeros((reduced.n, reduced.p)), d.v2_dot_T])


def _restricted(
    reduced: ReducedModel, read: _Coordinates, kept: list[int], v: Array, q: Array, A: Array, B: Array
) -> tuple[Array, Array]:
    """Return A and B of the selected coordinates and rates, if these form a closed system.

    The condition is ``C A = A_chosen C`` on all perturbations that satisfy the holonomic constraints; C selects.
    """
    J, J_dot = read.rows(q, v)
    # Only coordinates at rest have a constant linearization.
    moving = np.abs(J @ v) > _STEADY * (1.0 + np.abs(v).max())
    if moving.any():
        name = read.names[int(np.argmax(np.abs(J @ v)))]
        raise ConstraintError(f"coordinate '{name}' moves in this motion: leave it out of the coordinates")
    r = reduced.r
    rows = reduced.at(q).A[list(reduced.constraints.holonomic)]
    # Deviations that violate holonomic rows do not occur: they must not count as dependence.
    admissible = scipy.linalg.block_diag(null_space(rows), np.eye(r))
    C = scipy.linalg.block_diag(J, np.eye(r)[kept])
    C_dot = scipy.linalg.block_diag(J_dot, np.zeros((len(kept), r)))
    seen, moved = C @ admissible, (C @ A + C_dot) @ admissible
    values = np.linalg.svd(seen, compute_uv=False)
    least = 1e-10  # relative singular value at which coordinates are independent
    if seen.shape[1] < len(seen) or values[-1] <= least * values[0]:
        raise ConstraintError(f"coordinates {', '.join(read.names)} are not independent under the constraints")
    chosen = moved @ np.linalg.pinv(seen)
    # Zero if the chosen coordinates move by themselves alone: least squares shows what else moves them.
    rest = (moved - chosen @ seen) @ admissible.T
    # A wheel that the file makes slightly non-round depends on its angle by as much as the file rounds.
    if np.abs(rest).max() > ROUNDING * max(1.0, np.abs(A).max()):
        missing = (*reduced.robot.velocity_names, *reduced.reducing.names)[int(np.argmax(np.abs(rest).max(axis=0)))]
        known = ", ".join((*read.names, *(reduced.reducing.names[i] for i in kept)))
        raise ConstraintError(f"not a closed system: the motion of {known} also depends on '{missing}'")
    return chosen, C @ B


class _Coordinates:
    """Configuration part of a state: entries of v, or outputs."""

    def __init__(self, reduced: ReducedModel, chosen: Sequence[Coordinate]) -> None:
        self._robot = robot = reduced.robot
        if isinstance(chosen, str):
            raise InputError(f"coordinates have to be a list, found the string '{chosen}'")
        blocks, self._entries = list[OutputRows](), list[int]()
        for each in chosen:
            if isinstance(each, str):
                self._entries.append(place_of(each, robot.velocity_names, "no coordinate", ModelError))
                blocks.append(VelocityRows(np.eye(robot.nv)[self._entries[-1:]], [each], [""]))
                continue
            blocks.append(each.bind(robot))
            if blocks[-1].quasi:
                raise ConstraintError(
                    f"'{blocks[-1].names[0]}' is a quasi-velocity: it has no value to be a coordinate"
                )
        self._outputs = OutputStack(blocks)  # entries of v are the quasi-velocities among them
        self.names = self._outputs.names

    def rows(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Jacobian and its rate, (k, nv) each."""
        rates = Kinematics(self._robot).position(q).with_velocity(v)
        return self._outputs.jacobian(rates), self._outputs.jacobian_dot(rates)

    def deviation(self, q: Array, q_0: Array) -> Array:
        """Coordinates of q minus coordinates of q_0, (k,)."""
        outputs, place = self._outputs, Kinematics(self._robot).position
        found = outputs.coordinates.difference(outputs.value(place(q)), outputs.value(place(q_0)))
        found[outputs.quasi] = pin.difference(self._robot.model, q_0, q)[self._entries]
        return found


Cost = float | Sequence[float] | Mapping[str, float] | Array


def lqr(linear: Linearization, state_cost: Cost, input_cost: Cost = 1.0) -> Float[Array, "p s"]:
    """Return the gain K of the feedback ``T = T_0 - K x`` that minimises the integral of ``x^T Q x + u^T R u``.

    Args:
        linear: the linearised system.
        state_cost: Q: weights by state name, zero for the others; or one number, one for each state, or a matrix
            (s, s).
        input_cost: R: weights in the same forms, by input name; every input needs a positive weight.

    Raises:
        ConstraintError: a mode that is not stable is not controllable, or has no cost; the message names the states
            that it moves.
        ConfigurationError: a weight is not valid, or names an unknown state or input.

    Example:
        >>> robot = rnc.Robot.from_urdf("wheeled_pendulum.urdf", base="planar")
        >>> wheels = [rnc.RollingWheel("left_wheel", 0.1), rnc.RollingWheel("right_wheel", 0.1)]
        >>> system = rnc.NonholonomicSystem(robot, wheels, ["left_axle", "right_axle"])
        >>> reduced = system.reduce([rnc.FrameSpeed("base"), rnc.JointPosition("pitch"), rnc.FrameYaw("base")])
        >>> upright = robot.configuration()
        >>> linear = rnc.linearize(reduced, upright, coordinates=["pitch"], rates=["base_speed_x", "pitch"])
        >>> K = rnc.lqr(linear, {"pitch": 10.0, "base_speed_x": 1.0})
        >>> K.shape, bool(np.linalg.eigvals(linear.A - linear.B @ K).real.max() < 0)
        ((2, 3), True)
    """
    A, B = linear.A, linear.B
    Q = _cost(state_cost, linear.state_names, "state_cost")
    R = _cost(input_cost, linear.input_names, "input_cost")
    # A cost of the form C^T C has eigenvalues of zero, which rounding makes slightly negative.
    if np.linalg.eigvalsh(Q).min() < -1e-12 * np.abs(Q).max():
        raise ConfigurationError("state_cost: no weight may be negative")
    if not len(R):
        raise ConstraintError("a regulator needs at least one actuator, found none")
    if not np.linalg.eigvalsh(R).min() > 0:
        raise ConfigurationError("input_cost: every input needs a positive weight")
    # Scale each input so that its weight is 1: the result must not depend on units.
    unit = 1.0 / np.sqrt(np.diag(R))
    B, R = B * unit, unit[:, None] * R * unit
    size = float(np.abs(A).max(initial=1.0))
    slow = 1e-5  # real part, relative to the size of A, above which a mode counts as not stable
    unreached = 1e-6  # zero limit, relative to the sizes of A and B, or of the cost
    for mode in np.linalg.eigvals(A):
        if mode.real < -slow * size:
            continue
        # Hautus' test: [A - s I, B] loses rank for a mode that no input reaches, [A - s I; Q] for one without a cost.
        shifted = A - mode * np.eye(len(A))
        reached = np.hstack([shifted / size, B / max(np.abs(B).max(), 1e-300)])
        if np.linalg.svd(reached, compute_uv=False)[-1] < unreached:
            names = ", ".join(weakest_rows(reached, linear.state_names))
            raise ConstraintError(
                f"the actuators {', '.join(linear.input_names)} do not control a mode that is not stable: "
                f"it moves {names}; leave out what rows hold (coordinates= and rates= of linearize), or add actuators"
            )
        costly = np.vstack([shifted / size, Q / max(np.abs(Q).max(), 1e-300)])
        if np.linalg.svd(costly, compute_uv=False)[-1] < unreached and abs(mode.real) <= slow * size:
            names = ", ".join(weakest_rows(costly.T, linear.state_names))
            raise ConstraintError(f"state_cost: a mode that is not stable has zero cost: it moves {names}")
    try:
        P = scipy.linalg.solve_continuous_are(A, B, Q, R)
    except np.linalg.LinAlgError as error:
        raise ConstraintError(f"no regulator was found: {error}") from None
    K: Array = np.linalg.solve(R, B.T @ P)
    slowest = float(np.linalg.eigvals(A - B @ K).real.max())
    if not slowest < 0:
        raise ConstraintError(f"no regulator was found: with the best gain a mode still grows at {slowest:.3g}/s")
    return unit[:, None] * K


def check_sampling(linear: Linearization, K: Float[Array, "p s"], dt: float) -> None:
    """Refuse gains that are unstable in discrete time, with inputs constant over a sampling period.

    Args:
        linear: the linearised system.
        K: gain of the feedback ``T = T_0 - K x``.
        dt: sampling period [s].

    Raises:
        InfeasibleError: the closed loop is unstable; the message gives its rate.
    """
    s, p = linear.B.shape
    # The exact zero-order hold: the exponential of A and B together.
    held = scipy.linalg.expm(np.block([[linear.A, linear.B], [np.zeros((p, s + p))]]) * dt)
    if np.abs(np.linalg.eigvals(held[:s, :s] - held[:s, s:] @ K)).max(initial=0.0) >= 1.0:
        fastest = float(np.abs(np.linalg.eigvals(linear.A - linear.B @ K)).max())
        raise InfeasibleError(
            f"the closed loop is unstable in discrete time: its fastest eigenvalue is {fastest:.3g}/s "
            f"and the sampling period {dt:g} s; reduce the sampling period (simulation.dt) or raise input_cost"
        )


def _cost(given: Cost, names: Sequence[str], what: str) -> Array:
    size = len(names)
    if isinstance(given, Mapping):
        for name in given:
            place_of(name, names, f"{what}: no")
        given = [given.get(name, 0.0) for name in names]
    try:
        weights = np.asarray(given, float)
    except (TypeError, ValueError):
        raise ConfigurationError(f"{what}: expected numbers, found {given!r}") from None
    if weights.shape in ((), (size,)):
        weights = np.diag(np.broadcast_to(weights, size))
    if weights.shape != (size, size) or not np.isfinite(weights).all() or not np.allclose(weights, weights.T):
        raise ConfigurationError(
            f"{what}: expected a number, one for each of {', '.join(names)}, or a symmetric matrix, found {given!r}"
        )
    return weights
