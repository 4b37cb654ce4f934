"""Rows: a Jacobian on the tangent space and its rate. Constraints and outputs consist of rows, in stacks.

A *kind* such as ``NoSideSlip("axle")`` is a description without a robot. ``bind(robot)`` resolves its names and returns
``Rows``. Rows have leading batch axes, so one formula serves one state and many.

Simulators and drawings do not read the kinds: they read the mechanisms of the rows.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple, Protocol, TypeVar, runtime_checkable

import numpy as np
import pinocchio as pin

from rnc_pin._kernel.kernel_rows import Form, KernelRow
from rnc_pin.errors import DivergenceError, SingularityError
from rnc_pin.math.linear_algebra import Component, as_slice
from rnc_pin.model.coordinates import Coordinates
from rnc_pin.model.kinematics import PositionKinematics, VelocityKinematics
from rnc_pin.robots.robot import Robot

Friction = Literal["all", "longitudinal", "lateral", "oblique", "none"]
"""Directions of ground friction: all, along the heading, across it, along one oblique line, or none."""


@dataclass(frozen=True)
class GroundContact:
    """Wheel, ball or runner on the ground z = 0.

    Attributes:
        frame: name of a frame on the body.
        radius: radius [m]; None for a runner: a point, or wheels that the robot's file draws on its axle.
        axle: unit vector in the frame's axes (3,); None for a ball.
        center: center in the frame's axes (3,) [m].
        friction: directions of friction.
    """

    frame: str
    radius: float | None = None
    axle: np.ndarray | None = None
    center: np.ndarray = field(default_factory=lambda: np.zeros(3))
    friction: Friction = "all"


@dataclass(frozen=True)
class JointCoupler:
    """Joint whose position follows from that of another joint.

    Attributes:
        joint: name of the joint that follows.
        driver: name of the joint that leads; None if the joint stays at its position.
        ratio: motion of the joint for unit motion of the driver; the offset follows from the initial positions.
        function: position of the joint up to multiples of ``period`` and its slope, from the position of the driver;
            None for a constant ratio.
        period: period of the position [rad].
    """

    joint: str
    driver: str | None
    ratio: float = 0.0
    function: Callable[[float], tuple[float, float]] | None = None
    period: float = 2 * np.pi


@dataclass(frozen=True)
class FrameAnchor:
    """Two frames that coincide, or only their origins.

    Attributes:
        frames: names of the parent frames.
        placements: placements of the joined frames on them.
        point: True if only the origins coincide.
    """

    frames: tuple[str, str]
    placements: tuple[pin.SE3, pin.SE3]
    point: bool


Mechanism = GroundContact | JointCoupler | FrameAnchor


class GroundSurface(Protocol):
    """Surface on which bodies roll, as drawings read it."""

    def mesh(self, center: np.ndarray, size: float) -> tuple[np.ndarray, np.ndarray]:
        """Part of the surface near a point (3,) [m], of half width ``size``: vertices (n, 3) and triangles (m, 3).

        Args:
            center: the point, in the world.
            size: half width of the part [m].
        """


def carrier_of(ground: GroundSurface | None) -> str | None:
    """Name of the frame that carries a ground and stands for the world; None for ground in the world.

    Args:
        ground: the surface; None for the plane z = 0.
    """
    return None if ground is None else getattr(ground, "frame", None)


# ------------------------------------------------------------------ rows


class Rows(ABC):
    """Linear forms on the velocity, k rows, with their rates and properties.

    Constraint rows require ``J v = mu``, with mu = 0 unless they are ``affine``. The type of a method's argument gives
    the quantities that it may depend on, e.g. a ``PositionKinematics`` has no velocity.

    Attributes:
        names: name of each row, (k,).
        units: unit of each row's rate, (k,).
        conserved: entries of ``v`` on which no actuator and no reaction may act (for momentum rows), else None. Such
            rows have no reaction force.
        affine: True if mu is not zero.
        rheonomic: True if the rows, mu or the residual depend on the time ``at.t``; rates then include its flow.
        turning: True if the Jacobian of rheonomic rows does, so that ``R`` depends on time too.
        holonomic: True for each row that keeps a function of q at zero, (k,); ``residual`` returns its value. Empty
            if no row does. A row with False may still be integrable together with others.
        on_ground: True if holonomic rows that no joint can move are ignored, e.g. the height of a wheel on a planar
            base. Otherwise they have to be satisfied.
        ground: surface on which the body rolls; None for the plane z = 0 at rest, and for rows without a ground.
        unnamed: True if the user gave no names, so that the system numbers the rows.
        kind: the description that was bound; None for rows that a system adds itself.

    Example:
        >>> class ForwardRow(rnc.Rows):
        ...     names, units = ("no forward motion",), ("m/s",)
        ...     def jacobian(self, at):
        ...         return np.array([[1.0, 0.0, 0.0]])
        ...     def jacobian_dot(self, at):
        ...         return np.zeros((1, 3))
        ...     def bias_acceleration(self, at):
        ...         return np.zeros(1)
        >>> class NoForwardMotion:
        ...     def bind(self, robot):
        ...         return ForwardRow()
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> print(rnc.NonholonomicSystem(robot, [NoForwardMotion()]).r)
        2
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    conserved: slice | None = None
    affine: bool = False
    rheonomic: bool = False
    turning: bool = False
    holonomic: tuple[bool, ...] = ()
    on_ground: bool = False
    ground: GroundSurface | None = None
    unnamed: bool = False
    kind: ConstraintKind | None = None

    @abstractmethod
    def jacobian(self, at: PositionKinematics) -> np.ndarray:
        """Jacobian J(q), (..., k, nv).

        Args:
            at: kinematics at configurations (..., nq).
        """

    @abstractmethod
    def jacobian_dot(self, at: VelocityKinematics) -> np.ndarray:
        """Rate of the Jacobian along v, (..., k, nv).

        Args:
            at: kinematics at states, configurations (..., nq) and velocities (..., nv).
        """

    @abstractmethod
    def bias_acceleration(self, at: VelocityKinematics) -> np.ndarray:
        """Bias acceleration ``Jdot v - mudot``, (..., k), for a velocity that satisfies the constraints.

        Args:
            at: kinematics at states, configurations (..., nq) and velocities (..., nv).
        """

    def rate(self, at: PositionKinematics) -> np.ndarray:
        """Right-hand side mu(q) of ``J v = mu``, (..., k).

        Args:
            at: kinematics at configurations (..., nq).
        """
        return self._zeros(at)

    def rate_dot(self, at: VelocityKinematics) -> np.ndarray:
        """Rate of mu along v, (..., k).

        Args:
            at: kinematics at states, configurations (..., nq) and velocities (..., nv).
        """
        return self._zeros(at)

    def rates_over_time(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        """Right-hand side mu(t) and its rate, (k,) each, of rheonomic rows with ``kernel_rows``.

        Args:
            t: time [s].
        """
        raise NotImplementedError

    def residual(self, at: PositionKinematics) -> np.ndarray:
        """Position residual of the holonomic rows, (..., k) [m or rad]; zero for the other rows.

        Where the residual is zero, its rate is ``J v``.

        Args:
            at: kinematics at configurations (..., nq).
        """
        return self._zeros(at)

    def bias_acceleration_gradient(self, at: VelocityKinematics) -> np.ndarray | None:
        """Derivative of ``Jdot v - mudot`` with respect to q at fixed v, (k, nv); None if there is no closed form.

        Only derivatives of the dynamics at one state in motion call it. For None, they use finite differences.

        Args:
            at: kinematics at one state (nq,), (nv,).
        """
        return None

    def kernel_rows(self, model: pin.Model) -> list[KernelRow] | None:
        """Rows as the compiled kernel evaluates them on the robot's ``model``, (k,); None if Python evaluates them.

        Args:
            model: Pinocchio's model of the robot.
        """
        return None

    def lines_of_action(self, at: PositionKinematics) -> tuple[np.ndarray, np.ndarray] | None:
        """Points and directions of the constraint forces in the world, for visualization.

        Args:
            at: kinematics at configurations (..., nq).

        Returns:
            Points (..., k, 3) [m] and unit vectors (..., k, 3); None for rows that act on no point, such as a momentum.
        """
        return None

    def mechanisms(self) -> tuple[Mechanism, ...]:
        """Physical mechanisms that enforce the rows, for simulators and drawings; empty if none is known."""
        return ()

    def _zeros(self, at: PositionKinematics) -> np.ndarray:
        return np.zeros((*at.q.shape[:-1], len(self.names)))


class ConstantRows(Rows):
    """Rows with a constant Jacobian.

    Attributes:
        matrix: the Jacobian (k, nv).
    """

    matrix: np.ndarray

    def jacobian(self, at: PositionKinematics) -> np.ndarray:
        return np.broadcast_to(self.matrix, (*at.q.shape[:-1], *self.matrix.shape))

    def jacobian_dot(self, at: VelocityKinematics) -> np.ndarray:
        return np.zeros((*at.q.shape[:-1], *self.matrix.shape))

    def bias_acceleration(self, at: VelocityKinematics) -> np.ndarray:
        return self._zeros(at)

    def bias_acceleration_gradient(self, at: VelocityKinematics) -> np.ndarray:
        return np.zeros(self.matrix.shape)

    def kernel_rows(self, model: pin.Model) -> list[KernelRow]:
        return [KernelRow(Form.CONSTANT, constant=row) for row in self.matrix]


class OutputRows(Rows):
    """Rows that are the rate of coordinates, or quasi-velocities.

    Attributes:
        angular: True for each value that is an angle, compared modulo a full turn, (k,).
        quasi: True if only the rate exists (a quasi-velocity), so that its integral serves as the value.
        rotation: True if the three values are a rotation vector, and the rates an angular velocity in world axes.
        generalized: True if they are a user's functions of q: they are unknown for a robot with a moving base.
    """

    angular: tuple[bool, ...]
    quasi: bool = False
    rotation: bool = False
    generalized: bool = False

    def value(self, at: PositionKinematics) -> np.ndarray:
        """Values of the coordinates, (..., k) [m or rad]; zeros if ``quasi``.

        Args:
            at: kinematics at configurations (..., nq).
        """
        return self._zeros(at)


@runtime_checkable
class ConstraintKind(Protocol):
    """Description of constraint rows that can be bound to a robot."""

    def bind(self, robot: Robot) -> Rows: ...


@runtime_checkable
class OutputKind(Protocol):
    """Description of outputs that can be bound to a robot."""

    def bind(self, robot: Robot) -> OutputRows: ...


def check_defined(what: str, q: np.ndarray, sizes: Component, limit: float, names: tuple[str, ...]) -> None:
    """Raise an error at states where rows are undefined because a length is too small.

    Args:
        what: reason, as text of the error.
        q: configurations (..., nq) of the states.
        sizes: lengths that have to be at least the limit: one number, or one for each state.
        limit: the limit.
        names: names of the rows.

    Raises:
        SingularityError: rows are undefined; the error has the first such state.
    """
    if (sizes.min(initial=np.inf) if isinstance(sizes, np.ndarray) else sizes) >= limit:
        return
    # Name the first state that fails; ``not >=`` finds NaN as well.
    flat = np.broadcast_to(sizes, q.shape[:-1]).reshape(-1)
    first = int(np.argmax(~(flat >= limit)))
    if np.isnan(flat[first]):
        return  # a configuration that is not finite raises another error
    state = q.reshape(-1, q.shape[-1])[first].copy()
    # The condition grows as one over the length.
    raise SingularityError(what, q=state, condition=1 / max(float(flat[first]), 1e-300), rows=names)


# ------------------------------------------------------------------ stacks

Selection = slice | np.ndarray
_Value = TypeVar("_Value")


class Place(NamedTuple):
    """Block of rows with its position in a stack."""

    block: Rows
    where: slice
    """Position of the rows in the stack."""
    rows: Selection | None
    """Selected rows of the block; None for all."""

    def of(self, values: np.ndarray) -> np.ndarray:
        """Entries of the selected rows, from the entries (..., k) of all rows of the block.

        Args:
            values: entries of all rows.
        """
        return values if self.rows is None else values[..., self.rows]

    def of_matrix(self, values: np.ndarray) -> np.ndarray:
        """Selected rows, from all rows (..., k, l) of the block.

        Args:
            values: all rows.
        """
        return values if self.rows is None else values[..., self.rows, :]

    def each(self, values: Sequence[_Value]) -> Sequence[_Value]:
        """Values of the selected rows, from the names or flags (k,) of all rows of the block.

        Args:
            values: values of all rows.
        """
        return [values[row] for row in self.of(np.arange(len(values)))]


class RowStack:
    """Vertical stack of selected rows of several blocks. Results have the leading axes of the states.

    Args:
        blocks: the bound rows.
        kept: indices of the selected rows among all rows, in increasing order; all rows by default.

    Attributes:
        names, units, holonomic: name, unit and holonomic flag of each row, (size,).
        size: number of rows.
        affine, rheonomic, turning: True if any block is.
        places: blocks with the positions of their rows.
    """

    def __init__(self, blocks: Sequence[Rows], kept: Sequence[int] | None = None) -> None:
        chosen, first = list[tuple[Rows, int, Selection | None]](), 0
        for block in blocks:
            size = len(block.names)
            # Indices count rows of all blocks: those of this block begin at its first row.
            rows = range(size) if kept is None else [row - first for row in kept if first <= row < first + size]
            if len(rows):
                chosen.append((block, len(rows), None if len(rows) == size else as_slice(np.array(rows))))
            first += size
        self._take(chosen)

    def _take(self, chosen: Iterable[tuple[Rows, int, Selection | None]]) -> None:
        """Place blocks one below the other, with the number of their selected rows."""
        self.places, self.size = list[Place](), 0
        for block, size, rows in chosen:
            self.places.append(Place(block, slice(self.size, self.size + size), rows))
            self.size += size
        self.names = tuple(name for place in self.places for name in place.each(place.block.names))
        self.units = tuple(unit for place in self.places for unit in place.each(place.block.units))
        flags = ((place, place.block.holonomic or (False,) * len(place.block.names)) for place in self.places)
        self.holonomic = tuple(flag for place, of_block in flags for flag in place.each(of_block))
        self.affine = any(place.block.affine for place in self.places)
        self.rheonomic = any(place.block.rheonomic for place in self.places)
        self.turning = any(place.block.turning for place in self.places)
        self._varying = [place for place in self.places if not isinstance(place.block, ConstantRows)]
        self._constant: np.ndarray | None = None
        self._selected: dict[tuple[int, ...], RowStack] = {}

    def selected(self, kept: tuple[int, ...]) -> RowStack:
        """Stack of some rows of a stack with whole blocks, by increasing indices; the same object each time.

        Args:
            kept: indices of the rows, increasing.
        """
        if kept not in self._selected:
            # One object for each choice, so that reductions with the same rows find that out by identity.
            self._selected[kept] = RowStack([place.block for place in self.places], kept)
        return self._selected[kept]

    @classmethod
    def of(cls, places: Iterable[Place]) -> RowStack:
        """Stack of places of other stacks, one below the other."""
        whole = RowStack([])
        whole._take((block, where.stop - where.start, rows) for block, where, rows in places)
        return whole

    def template(self, nv: int) -> np.ndarray:
        """Matrix (size, nv), stored by columns, with the values of the constant rows; do not write to it.

        Args:
            nv: number of columns.
        """
        if self._constant is None:
            # By columns, as LAPACK stores matrices: E is a copy of it, without a transposition.
            self._constant = np.zeros((self.size, nv), order="F")
            for place in self.places:
                if isinstance(place.block, ConstantRows):
                    self._constant[place.where] = place.of_matrix(place.block.matrix)
        return self._constant

    def write_jacobian(self, at: PositionKinematics, out: np.ndarray) -> None:
        """Write the rows of J(q) that are not constant into ``out`` (..., size, nv).

        Args:
            at: kinematics at configurations (..., nq).
            out: rows (..., size, nv), which are written.
        """
        for place in self._varying:
            out[..., place.where, :] = place.of_matrix(place.block.jacobian(at))

    def jacobian(self, at: PositionKinematics) -> np.ndarray:
        """Jacobian J(q), (..., size, nv).

        Args:
            at: kinematics at configurations (..., nq).
        """
        template, batch = self.template(at.M.shape[-1]), at.q.shape[:-1]
        # By rows, as the kernel reads them.
        out = np.array(np.broadcast_to(template, (*batch, *template.shape)), order="C") if batch else template.copy()
        self.write_jacobian(at, out)
        return out

    def bias_acceleration(self, at: VelocityKinematics) -> np.ndarray:
        """Bias acceleration ``Jdot v - mudot``, (..., size).

        Args:
            at: kinematics at states, configurations (..., nq) and velocities (..., nv).
        """
        return self._gather(at, lambda block: block.bias_acceleration(at))

    def jacobian_dot(self, at: VelocityKinematics) -> np.ndarray:
        """Jacobian rate Jdot(q, v), (..., size, nv).

        Args:
            at: kinematics at states, configurations (..., nq) and velocities (..., nv).
        """
        out = np.zeros((*at.q.shape[:-1], self.size, at.M.shape[-1]))
        for place in self._varying:
            out[..., place.where, :] = place.of_matrix(place.block.jacobian_dot(at))
        return out

    def rate(self, at: PositionKinematics) -> np.ndarray:
        """Right-hand side mu(q) of ``J v = mu``, (..., size).

        Args:
            at: kinematics at configurations (..., nq).
        """
        return self._gather(at, lambda block: block.rate(at))

    def rate_dot(self, at: VelocityKinematics) -> np.ndarray:
        """Rate of mu, (..., size).

        Args:
            at: kinematics at states, configurations (..., nq) and velocities (..., nv).
        """
        return self._gather(at, lambda block: block.rate_dot(at))

    def residual(self, at: PositionKinematics) -> np.ndarray:
        """Position residuals (..., size) [m or rad]; zero for rows that are not holonomic.

        Args:
            at: kinematics at configurations (..., nq).
        """
        return self._gather(at, lambda block: block.residual(at))

    def _gather(self, at: PositionKinematics, of: Callable[[Rows], np.ndarray]) -> np.ndarray:
        """Concatenate a quantity of all blocks, restricted to the selected rows, (..., size)."""
        out = np.empty((*at.q.shape[:-1], self.size))
        for place in self.places:
            out[..., place.where] = place.of(of(place.block))
        return out

    def mechanisms(self) -> list[Mechanism]:
        """Contacts, couplings and closures of all blocks."""
        return [each for place in self.places for each in place.block.mechanisms()]

    def conserved_rows(self) -> np.ndarray:
        """Mask (size,) of the rows that state a conserved momentum, which have no reaction force."""
        conserved = np.zeros(self.size, dtype=bool)
        for block, where, _ in self.places:
            conserved[where] = block.conserved is not None
        return conserved

    def lines_of_action(self, at: PositionKinematics) -> tuple[np.ndarray, np.ndarray]:
        """Points and unit vectors of the constraint forces, (..., size, 3) each; NaN for rows that act on no point.

        Args:
            at: kinematics at configurations (..., nq).
        """
        # Rows that act on no point keep NaN, which drawings leave out.
        points, directions = np.full((2, *at.q.shape[:-1], self.size, 3), np.nan)
        for place in self.places:
            lines = place.block.lines_of_action(at)
            if lines is not None:
                points[..., place.where, :], directions[..., place.where, :] = (place.of_matrix(each) for each in lines)
        return points, directions


class OutputStack(RowStack):
    """Vertical stack of outputs, with their values.

    Args:
        blocks: the bound outputs.

    Attributes:
        angular, quasi: masks of the angles and of the quasi-velocities, (size,); ``has_quasi``: True if there are some.
        coordinates: coordinate types of the outputs.
    """

    def __init__(self, blocks: Sequence[OutputRows]) -> None:
        super().__init__(blocks)
        self.angular = np.array([angle for block in blocks for angle in block.angular], dtype=bool)
        self.quasi = np.array([block.quasi for block in blocks for _ in block.names], dtype=bool)
        self.has_quasi = bool(self.quasi.any())
        self._values = [(block, where) for block, where, _ in self.places if isinstance(block, OutputRows)]
        self._generalized = any(block.generalized for block in blocks)
        # Three entries of a rotation belong together in differences and rates.
        rotations = [where.start for block, where in self._values if block.rotation]
        self.coordinates = Coordinates(self.angular, rotations, self.names)

    def value(self, at: PositionKinematics) -> np.ndarray:
        """Values of the outputs, (..., size).

        Args:
            at: kinematics at configurations (..., nq).
        """
        out = np.empty((*at.q.shape[:-1], self.size))
        for block, where in self._values:
            out[..., where] = block.value(at)
        return out

    def check(self, value: np.ndarray, *matrices: np.ndarray) -> None:
        """Raise ``DivergenceError`` if values (..., size) or rows (..., size, n) of a user's output are not finite.

        Args:
            value: values (..., size).
            matrices: rows (..., size, n).
        """
        if self._generalized:
            # A value and its rows of A_star and its rate, side by side: one test for all.
            values = np.concatenate([value[..., None], *matrices], axis=-1)
            finite = np.isfinite(values).all(axis=-1) | self.quasi
            if not finite.all():
                name = self.names[int(finite.reshape(-1, self.size).all(axis=0).argmin())]
                raise DivergenceError(f"output '{name}' is not finite")


def rheonomic_names(stack: RowStack) -> list[str]:
    """Names of the rows that depend on time.

    Args:
        stack: the rows.
    """
    return [name for place in stack.places if place.block.rheonomic for name in place.each(place.block.names)]
