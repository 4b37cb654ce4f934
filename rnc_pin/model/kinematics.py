"""Kinematics of states over leading batch axes; rows and dynamics call Pinocchio only here.

Pinocchio updates its data to one state, and quantities such as Jacobians are read from the data. One loop over the
states does both and stores the quantities, so the same code serves one state and many. ``frame`` is an index. "World
axes" are parallel to the world's axes, at the frame's own origin.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from functools import partial
from threading import RLock
from typing import Literal, NamedTuple

import numpy as np
import pinocchio as pin

from rnc_pin import _kernel
from rnc_pin.errors import ModelError
from rnc_pin.math.linear_algebra import Component
from rnc_pin.model.cached_property import cached_property
from rnc_pin.robots.model_checks import joints_with_moving_axes
from rnc_pin.robots.robot import Robot

WORLD_AXES = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
OWN_AXES = pin.ReferenceFrame.LOCAL

Components = slice | np.ndarray
ALL = slice(0, 6)
"""All components of a spatial motion: linear x, y, z, then angular x, y, z."""


class Placement(NamedTuple):
    """Placement of a frame in the world."""

    rotation: np.ndarray
    """(..., 3, 3)"""
    translation: np.ndarray
    """(..., 3) [m]"""


class Kinematics:
    """Pinocchio's model and data of a robot. Threads take turns at the data.

        position = kinematics.position(q)         # q (..., nq)
        velocity = position.with_velocity(v)      # v (..., nv)

    Args:
        robot: the robot.
        time: time of all configurations [s], for a frozen model; None for time zero where none is given.

    Attributes:
        time: time of a frozen model [s]; None for others.
        current: quantities for whose state the data are current; None if there is no such state.
        requested: for each update, quantities that the last states were asked for, with their shapes.
        lock: held while the data are of one state.
    """

    def __init__(self, robot: Robot, time: float | None = None) -> None:
        self._robot, self.time = robot, time
        self.model = robot.model
        self.nv, self.zero = robot.nv, np.zeros(robot.nv)
        self.current: _Quantities | None = None
        self.lock = RLock()
        self._frames: dict[int, tuple[int, np.ndarray, np.ndarray]] = {}
        self.requested: dict[_Update, dict[_Quantity, tuple[int, ...]]] = defaultdict(dict)

    def __reduce__(self) -> tuple[type[Kinematics], tuple[Robot, float | None]]:
        """Create new Pinocchio data for a copy or a pickle."""
        return type(self), (self._robot, self.time)

    @cached_property
    def data(self) -> pin.Data:
        """Pinocchio's data; the compiled kernel has its own, so that many models never need these."""
        return self.model.createData()

    @cached_property
    def axes_are_constant(self) -> bool:
        """True if the axes of each joint are constant in the body that it moves.

        Pinocchio's derivatives and rates, and the kernel, assume it. Universal, ZYX and composite joints are different.
        """
        return not joints_with_moving_axes(self.model)

    def check_rates(self, frame: int | None = None) -> None:
        """Raise ``ModelError`` if Pinocchio's rates of the robot, or of one frame, are wrong: axes move in bodies.

        Args:
            frame: index of the frame; None for the whole robot.
        """
        model, frames = self.model, self.frame_constants
        # Pinocchio differentiates as if axes were constant in their bodies: wrong for e.g. universal joints, so
        # refused.
        for name in () if self.axes_are_constant else joints_with_moving_axes(model):
            if frame is None or model.getJointId(name) in list(model.supports[frames(frame)[0]]):
                raise ModelError(
                    f"rates of Jacobians and the Coriolis matrix are unknown: axes of '{name}' depend on its own "
                    "position; accelerations are known. Use joints of one degree of freedom instead"
                )

    def frame_constants(self, frame: int) -> tuple[int, np.ndarray, np.ndarray]:
        """Joint that carries a frame; its placement there (12,), by columns; mask (nv,) of the joints that move it.

        Args:
            frame: index of the frame in the model.
        """
        if frame not in self._frames:
            of = self.model.frames[frame]
            support = np.zeros(self.nv)
            # Other columns of the Jacobian of the frame are zero.
            support[moving_entries(self.model, of.parentJoint)] = 1.0
            self._frames[frame] = of.parentJoint, of.placement.homogeneous[:3].T.ravel(), support
        return self._frames[frame]

    def position(self, q: np.ndarray, t: Component | None = None) -> PositionKinematics:
        """Kinematics at configurations (..., nq) and times t (...), which only rheonomic rows read [s].

        Args:
            q: configurations (..., nq).
            t: times (...), which only rheonomic rows read [s].
        """
        return PositionKinematics(self, q, self.time_of(t))

    def time_of(self, t: Component | None) -> Component:
        """Time of configurations at t, if it is known: the time of a frozen model, or zero by default [s].

        Args:
            t: times (...) of configurations [s]; None if none is given.
        """
        t = t if self.time is None else self.time
        return 0.0 if t is None else t

    def over_states(self, function: Callable[..., object], shape: tuple[int, ...], *states: np.ndarray) -> np.ndarray:
        """Results (..., *shape) of a function of Pinocchio's model and data and of single states.

        Args:
            function: function of Pinocchio's model and data, and of single states.
            shape: shape of the result at one state.
            states: arrays (..., size) of the arguments.
        """
        with self.lock:
            self.current = None
            return over_states(partial(function, self.model, self.data), shape, *states)


def moving_entries(model: pin.Model, joint: int) -> list[int]:
    """Entries of v that move a joint: of the joint itself, and of the joints between it and the world.

    Args:
        model: Pinocchio's model of the robot.
        joint: index of the joint.
    """
    starts = [(model.idx_vs[support], model.nvs[support]) for support in list(model.supports[joint])[1:]]
    return [start + k for start, size in starts for k in range(size)]


_Update = Callable[..., None]  # of the data of a Kinematics to one state
_Quantity = tuple[Callable[..., np.ndarray], tuple[object, ...]]  # function of model and data, its other arguments


class _Quantities:
    """Quantities of states, read from the data after an update to each state, when they are first requested.

    For many states, the first request also stores what the previous states were asked for, in the same loop.

    Args:
        at: Pinocchio's model and data.
        update: updates the data to one state.
        states: arrays (..., size) with the arguments of ``update``.
    """

    def __init__(self, at: Kinematics, update: _Update, *states: np.ndarray) -> None:
        self._at, self._update, self._states = at, update, states
        self._values: dict[_Quantity, np.ndarray] = {}
        self._requested: dict[_Quantity, tuple[int, ...]] = {}

    def __reduce__(self) -> tuple[object, ...]:  # Pinocchio's functions cannot be pickled: values are read again
        return _Quantities, (self._at, self._update, *self._states)

    def get(self, read: Callable[..., np.ndarray], shape: tuple[int, ...], *arguments: object) -> np.ndarray:
        """Values (..., *shape) of a quantity, read-only."""
        quantity = read, arguments
        self._requested[quantity] = shape
        if quantity not in self._values:
            with self._at.lock:
                self._read(quantity, shape)
        return self._values[quantity]

    def _read(self, quantity: _Quantity, shape: tuple[int, ...]) -> None:
        """Read a quantity from the data."""
        at, (read, arguments) = self._at, quantity
        if self._states[0].ndim > 1:
            # A loop over states costs most in its updates: store now what the last states needed too.
            previous, at.requested[self._update] = at.requested[self._update], self._requested
            self._store({**previous, quantity: shape} if not self._values else {quantity: shape})
            return
        if at.current is not self:
            self._update(at, *self._states)
            at.current = self
        # The functions copy what they read: the next state overwrites Pinocchio's memory. Pinocchio returns matrices
        # with one column as vectors.
        value = read(at.model, at.data, *arguments).reshape(shape)
        value.setflags(write=False)
        self._values[quantity] = value

    def _store(self, shapes: dict[_Quantity, tuple[int, ...]]) -> None:
        """Store quantities of many states."""
        at, batch, pairs = self._at, self._states[0].shape[:-1], []
        # After the loop the data are of the last state only, which nobody may take for one of its own.
        at.current, stored = None, {}
        for (read, arguments), shape in shapes.items():
            stored[read, arguments] = values = np.empty((*batch, *shape))
            pairs.append((values.reshape(-1, *shape), partial(read, at.model, at.data, *arguments)))
            values.setflags(write=False)
        for i, state in enumerate(zip(*(each.reshape(-1, each.shape[-1]) for each in self._states), strict=True)):
            self._update(at, *state)
            for out, read_one in pairs:
                out[i] = read_one().reshape(out.shape[1:])
        self._values.update(stored)  # another thread may look for them


class PositionKinematics:
    """Kinematics at configurations.

    Args:
        at: Pinocchio's model and data.
        q: configurations (..., nq).
        t: times (...) [s]: one number, or one for each state.
    """

    def __init__(self, at: Kinematics, q: np.ndarray, t: Component) -> None:
        self._at, self.q, self.t = at, q, t
        self._placed = _Quantities(at, _update_placements, q)

    @cached_property
    def wrenches(self) -> dict[object, np.ndarray]:
        """Wrenches of rows at the configurations, which rows keep here."""
        return {}

    @property
    def M(self) -> np.ndarray:
        """Inertia matrices H* (..., nv, nv)."""
        return self._placed.get(_inertia, (self._at.nv, self._at.nv))

    def placement(self, frame: int) -> Placement:
        """Placement of a frame in the world.

        Args:
            frame: index of the frame in the model.
        """
        return _placement(self._placed.get(_frame_placement, (4, 3), frame))

    def joint_placement(self, joint: int) -> Placement:
        """Placement of the frame that moves with a joint.

        Args:
            joint: index of the joint.
        """
        return _placement(self._placed.get(_joint_placement, (4, 3), joint))

    def jacobian(self, frame: int, axes: pin.ReferenceFrame = WORLD_AXES, rows: Components = ALL) -> np.ndarray:
        """Frame Jacobian (..., 6, nv) at the frame's origin, or some of its rows; linear rows come first.

        Args:
            frame: index of the frame in the model.
            axes: axes of the components: those of the world, or the frame's own.
            rows: components to return; linear x, y, z come first, then angular ones.
        """
        return self._placed.get(pin.getFrameJacobian, (6, self._at.nv), frame, axes)[..., rows, :]

    def joint_jacobian(self, joint: int) -> np.ndarray:
        """Jacobian (..., 6, nv) of a joint's body: velocity of its point at the origin of the world, in world axes.

        Args:
            joint: index of the joint.
        """
        return self._placed.get(pin.getJointJacobian, (6, self._at.nv), joint, pin.ReferenceFrame.WORLD)

    @property
    def center_of_mass(self) -> np.ndarray:
        """Centre of mass of the robot and its Jacobian side by side, (..., 3, 1 + nv)."""
        return self._placed.get(_center_of_mass, (3, 1 + self._at.nv))

    def with_velocity(self, v: np.ndarray) -> VelocityKinematics:
        """The same configurations with velocities (..., nv).

        Args:
            v: full velocities (..., nv) [rad/s or m/s].
        """
        return VelocityKinematics(self, v)


class KnownKinematics(PositionKinematics):
    """Kinematics at one configuration with known inertia, joint placements and joint Jacobians.

    Frames follow from these, so that Pinocchio need not visit the configuration again.

    Args:
        at: Pinocchio's model and data, for all other quantities.
        q: configuration (nq,).
        t: time [s].
        record: M (nv, nv), J (6, nv) in the world, and placements of joints (njoints, 12).
    """

    def __init__(self, at: Kinematics, q: np.ndarray, t: Component, record: np.ndarray) -> None:
        super().__init__(at, q, t)
        self._record = record
        self._frames: dict[int, tuple[Placement, np.ndarray]] = {}

    @property
    def M(self) -> np.ndarray:
        found: np.ndarray = self._record["M"]
        return found

    def placement(self, frame: int) -> Placement:
        return self._frame(frame)[0]

    def jacobian(self, frame: int, axes: pin.ReferenceFrame = WORLD_AXES, rows: Components = ALL) -> np.ndarray:
        # The record has Jacobians along the axes of the world only.
        if axes != WORLD_AXES:
            return super().jacobian(frame, axes, rows)
        found = self._frame(frame)[1]
        return found if rows is ALL else found[rows]

    def _frame(self, frame: int) -> tuple[Placement, np.ndarray]:
        # A row asks for the placement and the Jacobian of its frame in turn: one call computes both.
        known = self._frames.get(frame)
        if known is None:
            joint, own, support = self._at.frame_constants(frame)
            numbers = np.empty(12 + 6 * self._at.nv)
            record = self._record
            if not _kernel.library.frame_kinematics(record["J"], record["placements"][joint], own, support, numbers):
                return super().placement(frame), super().jacobian(frame)
            numbers.setflags(write=False)
            # The kernel stores a placement by columns: three axes, then the origin.
            columns = numbers[:12].reshape(4, 3)
            known = self._frames[frame] = Placement(columns[:3].T, columns[3]), numbers[12:].reshape(6, -1)
        return known


class VelocityKinematics(PositionKinematics):
    """Kinematics at configurations and velocities, with rates along the velocities and derivatives at zero ``vdot``.

    Args:
        position: the configurations.
        v: velocities (..., nv).
    """

    def __init__(self, position: PositionKinematics, v: np.ndarray) -> None:
        self._at, self.q, self.t, self._placed, self.v = position._at, position.q, position.t, position._placed, v
        self._moving = _Quantities(self._at, _update_velocities, self.q, v)

    @cached_property
    def bias(self) -> np.ndarray:
        """Nonlinear effects ``C* v + g*``, (..., nv)."""
        return self._at.over_states(pin.nonLinearEffects, (self._at.nv,), self.q, self.v)

    @cached_property
    def C(self) -> np.ndarray:
        """Coriolis matrices C* (..., nv, nv), with ``Hdot* = C* + C*^T``; ``ModelError`` where axes move in bodies."""
        self._at.check_rates()
        return self._at.over_states(pin.computeCoriolisMatrix, (self._at.nv, self._at.nv), self.q, self.v)

    def of_center(self, kind: Literal["acceleration", "gradient", "rate"]) -> np.ndarray:
        """Acceleration (..., 3, 1) of the centre at zero ``vdot``, its gradient in q, or the rate of its Jacobian.

        Args:
            kind: quantity to return.
        """
        if kind == "rate":
            self._at.check_rates()
        read, columns = _OF_CENTER[kind], 1 if kind == "acceleration" else self._at.nv
        return self._at.over_states(read, (3, columns), self.q, self.v, np.zeros_like(self.v))

    def bias_gradient(self) -> np.ndarray:
        """Derivative of ``bias`` with respect to q at fixed v, (..., nv, nv)."""
        return self._gradient(self.v, np.zeros_like(self.v))

    def momentum_gradient(self) -> np.ndarray:
        """Derivative of ``M v`` with respect to q at fixed v, (..., nv, nv)."""
        zero = np.zeros_like(self.v)
        # With the velocity as acceleration, the inverse dynamics are M v + g*; the difference removes g*.
        return self._gradient(zero, self.v) - self._gradient(zero, zero)

    def _gradient(self, v: np.ndarray, w: np.ndarray) -> np.ndarray:
        """Derivative (..., nv, nv) of the inverse dynamics at velocities and accelerations (..., nv)."""
        nv, by_q = self._at.nv, lambda *state: pin.computeRNEADerivatives(*state)[0]
        return self._at.over_states(by_q, (nv, nv), self.q, v, w)

    @cached_property
    def _rates(self) -> _Quantities:
        return _Quantities(self._at, _update_rates, self.q, self.v)

    @cached_property
    def _derivatives(self) -> _Quantities:
        return _Quantities(self._at, _update_derivatives, self.q, self.v)

    def velocity(self, frame: int) -> np.ndarray:
        """Velocity of a frame's origin and angular velocity, (..., 6), in world axes.

        Args:
            frame: index of the frame in the model.
        """
        return self._moving.get(_velocity, (6,), frame)

    def acceleration(self, frame: int, axes: pin.ReferenceFrame = WORLD_AXES, rows: Components = ALL) -> np.ndarray:
        """Rate (..., 6), or some of its rows, of the frame's velocity components along ``axes``, at zero ``vdot``.

        Args:
            frame: index of the frame in the model.
            axes: axes of the components: those of the world, or the frame's own.
            rows: components to return; linear x, y, z come first, then angular ones.
        """
        return self._moving.get(_acceleration, (6,), frame, axes)[..., rows]

    def jacobian_dot(self, frame: int, axes: pin.ReferenceFrame = WORLD_AXES) -> np.ndarray:
        """Time derivative of ``jacobian``, (..., 6, nv); ``ModelError`` where axes move in the bodies below.

        Args:
            frame: index of the frame in the model.
            axes: axes of the components: those of the world, or the frame's own.
        """
        self._at.check_rates(frame)
        return self._rates.get(pin.getFrameJacobianTimeVariation, (6, self._at.nv), frame, axes)

    def frame_gradients(self, frame: int, axes: pin.ReferenceFrame = WORLD_AXES) -> np.ndarray:
        """Derivatives of ``velocity`` and ``acceleration`` with respect to q at fixed v, (..., 2, 6, nv).

        Args:
            frame: index of the frame in the model.
            axes: axes of the components: those of the world, or the frame's own.
        """
        read = _frame_gradients if axes == WORLD_AXES else _own_gradients
        return self._derivatives.get(read, (2, 6, self._at.nv), frame)


# ---------------------------------------------------------------------- updates of Pinocchio's data


def _update_placements(at: Kinematics, q: np.ndarray) -> None:
    # In the world convention, CRBA also computes placements and joint Jacobians.
    pin.crba(at.model, at.data, q, pin.Convention.WORLD)


def _update_velocities(at: Kinematics, q: np.ndarray, v: np.ndarray) -> None:
    # At zero vdot, accelerations are those that the rates of Jacobians cause: Jdot v.
    pin.forwardKinematics(at.model, at.data, q, v, at.zero)


def _update_rates(at: Kinematics, q: np.ndarray, v: np.ndarray) -> None:
    _update_velocities(at, q, v)
    pin.computeJointJacobiansTimeVariation(at.model, at.data, q, v)


def _update_derivatives(at: Kinematics, q: np.ndarray, v: np.ndarray) -> None:
    # The derivatives read the Jacobians, which they do not compute themselves.
    pin.computeJointJacobians(at.model, at.data, q)
    _update_velocities(at, q, v)
    pin.computeForwardKinematicsDerivatives(at.model, at.data, q, v, at.zero)


# ---------------------------------------------------------------------- quantities in Pinocchio's data


def _inertia(model: pin.Model, data: pin.Data) -> np.ndarray:
    return data.M.copy()


def _frame_placement(model: pin.Model, data: pin.Data, frame: int) -> np.ndarray:
    return pin.updateFramePlacement(model, data, frame).homogeneous[:3].T


def _joint_placement(model: pin.Model, data: pin.Data, joint: int) -> np.ndarray:
    return data.oMi[joint].homogeneous[:3].T


def _placement(columns: np.ndarray) -> Placement:
    """Placement from the columns (..., 4, 3) of its rotation, and its translation."""
    return Placement(columns[..., :3, :].mT, columns[..., 3, :])


def _center_of_mass(model: pin.Model, data: pin.Data) -> np.ndarray:
    # Both are of one visit: side by side they are one quantity.
    jacobian = pin.jacobianCenterOfMass(model, data, False)
    return np.column_stack([data.com[0], jacobian])


_OF_CENTER = {
    "acceleration": lambda m, d, q, v, w: _linear(m, pin.computeCentroidalMomentumTimeVariation(m, d, q, v, w).vector),
    "gradient": lambda m, d, q, v, w: _linear(m, pin.computeCentroidalDynamicsDerivatives(m, d, q, v, w)[1]),
    "rate": lambda m, d, q, v, w: _linear(m, pin.computeCentroidalMapTimeVariation(m, d, q, v)),
}


def _linear(model: pin.Model, momentum: np.ndarray) -> np.ndarray:
    """Part (3, nv) of the velocity of the centre of mass in derivatives of the momentum."""
    # Linear momentum is the mass times the velocity of the centre.
    return momentum.reshape(6, -1)[:3] / pin.computeTotalMass(model)


def _velocity(model: pin.Model, data: pin.Data, frame: int) -> np.ndarray:
    return pin.getFrameVelocity(model, data, frame, WORLD_AXES).vector


def _acceleration(model: pin.Model, data: pin.Data, frame: int, axes: pin.ReferenceFrame) -> np.ndarray:
    # Along the axes of the world, the rate of the components is the acceleration of the point; along own axes, it is
    # the spatial one.
    getter = pin.getFrameClassicalAcceleration if axes == WORLD_AXES else pin.getFrameAcceleration
    return getter(model, data, frame, axes).vector


def _own_gradients(model: pin.Model, data: pin.Data, frame: int) -> np.ndarray:
    """Derivatives of the frame's velocity and acceleration in its own axes, (2, 6, nv)."""
    found = pin.getFrameAccelerationDerivatives(model, data, frame, OWN_AXES)[:2]
    return np.array([each.reshape(6, model.nv) for each in found])


def _frame_gradients(model: pin.Model, data: pin.Data, frame: int) -> np.ndarray:
    """Derivatives of the frame's velocity and classical acceleration in world axes, (2, 6, nv).

    Pinocchio differentiates components along the frame's own axes. The rotation to world axes adds a term, because the
    frame's rotation depends on q.
    """
    turn = pin.updateFramePlacement(model, data, frame).rotation
    # Own rotation for unit motions of the coordinates.
    twist = pin.getFrameJacobian(model, data, frame, OWN_AXES).reshape(6, model.nv)[3:]
    v = pin.getFrameVelocity(model, data, frame, OWN_AXES)
    a = pin.getFrameAcceleration(model, data, frame, OWN_AXES)
    v_q, a_q = _own_gradients(model, data, frame)
    # Classical acceleration of the origin: spatial acceleration plus angular velocity x linear velocity.
    point = a.linear + np.cross(v.angular, v.linear)
    point_q = a_q[:3] - pin.skew(v.linear) @ v_q[3:] + pin.skew(v.angular) @ v_q[:3]
    own = (v.linear, v_q[:3]), (v.angular, v_q[3:]), (point, point_q), (a.angular, a_q[3:])
    # A vector in own axes turns with the frame: its gradient in the world has the part of that rotation too.
    return np.stack([turn @ (gradient - pin.skew(vector) @ twist) for vector, gradient in own]).reshape(2, 6, -1)


def over_states(function: Callable[..., object], shape: tuple[int, ...], *arrays: np.ndarray) -> np.ndarray:
    """Apply a function of single states over the leading axes of arrays (..., size); return (..., *shape).

    Args:
        function: function of single states.
        shape: shape of its result.
        arrays: arrays (..., size) of the arguments; after the first one also matrices (..., n, k).
    """
    batch = arrays[0].shape[:-1]
    if not batch:
        # The function may use its memory again, and Pinocchio returns matrices with one column as vectors.
        return np.array(function(*arrays), dtype=float).reshape(shape)
    out = np.empty((*batch, *shape))
    for i in np.ndindex(batch):
        out[i] = function(*(each[i] for each in arrays))
    return out
