"""Plant that integrates the reduced model."""

from __future__ import annotations

from contextlib import suppress
from math import isfinite
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from rnc_pin.errors import DivergenceError, InputError
from rnc_pin.model.input_validation import own_vector
from rnc_pin.model.integrators import DEFAULT_TOLERANCE
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.plants.constrained_dynamics import ConstrainedDynamics, VelocityChart
from rnc_pin.plants.plant import MOST_EVENT_SUBSTEPS, MOST_SUBSTEPS, IntegrationErrors, PlantReport, Substeps
from rnc_pin.printing import ReprMixin

if TYPE_CHECKING:
    from rnc_pin.plants.friction import DissipativeStep


class Checkpoint(NamedTuple):
    """State of a ``ReducedPlant``; y is what its integrator holds beside q, see ``ConstrainedDynamics``."""

    q: np.ndarray
    y: np.ndarray
    state: StateEvaluation | None
    applied: np.ndarray
    chart: VelocityChart
    errors: IntegrationErrors


class _Step(NamedTuple):
    """State after a sample, the roughness of its steps, and the error that ended them."""

    q: np.ndarray
    y: np.ndarray
    roughness: float
    failure: DivergenceError | None = None


class ReducedPlant(ReprMixin):
    """Plant that satisfies its constraints exactly, with exact measurements.

    A fourth-order Lie-group integrator runs in charts of the constraints, which are regular if the constraints have
    constant rank. After each ``advance`` a projection removes the drift of holonomic rows, such as wheel height and
    loop closure. The correction has zero momentum along the admissible velocities.

    The plant chooses its integrator: ``LieRungeKutta4`` of ``ConstrainedDynamics``, or the exponential method of
    ``DissipativeStep`` with damping or friction. ``IntegrationErrors`` tells from the roughness of a sample whether it
    needs a comparison; ``advance`` then doubles the number of steps until the error is within the tolerance.

    With ``actuator_limits``, ``apply`` clips inputs. The control loop of ``simulate`` does so only if its option
    ``limits`` asks for it.

    Args:
        reduced: reduced model.
        joint_damping: True for the viscous joint damping of the robot's file.
        actuator_limits: True to clip inputs to the effort limits of the robot's file and of the actuators.
        joint_friction: True for the dry joint friction of the robot's file, with stiction.
        substeps: integration steps in one call of ``advance``, which is a sampling period. By default as many as the
            tolerance asks for: 1, 2, 4 and so on.
        tolerance: largest error that the integration adds in a second, on any entry of configuration and velocity
            [m, rad, m/s or rad/s].

    Attributes:
        errors: estimated errors of the integration since the start.
        dynamics: equations of motion, with the present chart.
        followed: error per second above which a sample is compared with one of twice as many substeps.

    Raises:
        ConstraintError: damping or friction acts on a momentum that the model declares conserved.
        InputError: substeps is not a positive integer, or the tolerance not a positive number.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")], robot.joint_names[1:])
        >>> plant = rnc.ReducedPlant(system.reduce(), actuator_limits=True)
        >>> plant.reset(robot.configuration({"joint_2": 1.0}), np.zeros(4))
        >>> plant.apply(np.array([1e4, 0.0, 0.0]))
        >>> plant.applied  # the file limits the first motor to 400 N m
        array([400.,   0.,   0.])
        >>> plant.advance(0.001)
        >>> bool(plant.read()[1][1] > 0)
        True
    """

    def __init__(
        self,
        reduced: ReducedModel,
        joint_damping: bool = False,
        actuator_limits: bool = False,
        joint_friction: bool = False,
        substeps: int | None = None,
        tolerance: float = DEFAULT_TOLERANCE,
    ) -> None:
        self._substeps = Substeps.checked(substeps, tolerance)
        self.reduced, (self.substeps, self.tolerance) = reduced, self._substeps
        # A fixed number does not follow the tolerance.
        self.followed = self.tolerance if self.substeps is None else np.inf
        self.joint_damping, self.actuator_limits, self.joint_friction = joint_damping, actuator_limits, joint_friction
        self.dynamics = ConstrainedDynamics(reduced, joint_damping, actuator_limits)
        self._dissipative: DissipativeStep | None = None
        # A file without friction gives the plant without it, whose runs are computed together.
        dry = joint_friction and (reduced.robot.model.upperDryFrictionLimit > 0).any()
        if dry or self.dynamics.damping is not None:
            from rnc_pin.plants.friction import DissipativeStep, DryFriction  # most plants start without it

            self._dissipative = DissipativeStep(self.dynamics, DryFriction(reduced, joint_friction))
        self.errors = IntegrationErrors.initial(self._substeps)
        self.applied = np.zeros(reduced.p)
        self._q: np.ndarray
        self._y: np.ndarray
        self._state: StateEvaluation | None = None

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> None:
            if name in ("_q", "_y"):
                raise InputError("the plant has no state yet: call reset(q, v)")
            raise AttributeError(f"'{type(self).__name__}' object has no attribute '{name}'")

    def _settings(self) -> dict[str, object]:
        of_motion = ("applied", "errors", "dynamics", "followed")  # attributes that are no settings
        return {name: value for name, value in super()._settings().items() if name not in of_motion}

    def twin(self) -> ReducedPlant:
        """Return another plant with the same model and options."""
        options = self.joint_damping, self.actuator_limits, self.joint_friction, *self._substeps
        return ReducedPlant(self.reduced, *options)

    def reset(self, q: np.ndarray, v: np.ndarray, t: float = 0.0) -> None:
        """Restart at configuration q (nq,) and velocity v (nv,); velocity against the constraints is removed.

        Args:
            q, v: configuration and velocity.
            t: time of rheonomic constraints [s].

        Raises:
            InputError: q or v has another shape, or is not made of finite numbers.
        """
        start = self.reduced.at(q, v=v, t=t)
        if start.v.ndim > 1:
            raise InputError(f"reset of one plant: q has shape {np.shape(q)} and v {np.shape(v)}, expected one state")
        self._q, self._y = start.q, self.dynamics.initial(start.q, start.v, t=t)
        self.applied, self._state = np.zeros(self.reduced.p), None
        self.errors = IntegrationErrors.initial(self._substeps)

    @property
    def state(self) -> StateEvaluation:
        """State in the reduction of the model.

        Raises:
            DivergenceError: the state is not finite.
        """
        if self._state is None:
            if not (isfinite(np.vdot(self._y, self._y)) or np.isfinite(self._y).all()):
                raise DivergenceError("plant velocities are not finite")
            self._state, self._y = self.dynamics.recentre(self._q, self._y)
        return self._state

    @property
    def integrals(self) -> np.ndarray:
        """Integrals of the reducing velocities since the start, (r,)."""
        return self.dynamics.integrals(self._y)

    @property
    def work(self) -> float:
        """Work of actuators and rheonomic constraints, minus the dissipation of damping and friction [J]."""
        return float(self._y[-1])

    def read(self) -> tuple[np.ndarray, np.ndarray]:
        """Configuration (nq,) and velocity (nv,)."""
        return self.state.q.copy(), self.state.v.copy()

    def checkpoint(self) -> Checkpoint:
        """Return the present state for ``rollback``."""
        return Checkpoint(self._q, self._y, self._state, self.applied, self.dynamics.chart, self.errors)

    def rollback(self, checkpoint: Checkpoint) -> None:
        """Return to the state of a ``checkpoint``, to the bit.

        Args:
            checkpoint: state of this plant.
        """
        self._q, self._y, self._state, self.applied, self.dynamics.chart, self.errors = checkpoint

    def apply(self, T: np.ndarray) -> None:
        """Hold the inputs T (p,), clipped if the plant has ``actuator_limits``; ``applied`` has the result.

        Args:
            T: actuator inputs [N or N m].

        Raises:
            InputError: T is not p finite numbers.
        """
        self.hold(own_vector(T, self.reduced.p, "T"))

    def hold(self, T: np.ndarray) -> None:
        """As ``apply``, which clips too, for inputs that are valid.

        Args:
            T: finite inputs (p,), contiguous, that nobody changes afterwards.
        """
        self.applied = self.dynamics.saturate(T)

    def keep_errors(self, errors: IntegrationErrors) -> None:
        """Go on with the estimated errors of a motion that this plant continues.

        Args:
            errors: the estimated errors.
        """
        self.errors = errors.interrupted()

    @property
    def dissipates(self) -> bool:
        """True if damping or friction is active."""
        return self._dissipative is not None

    @property
    def external(self) -> np.ndarray | None:
        """Current generalized forces (nv,) of damping and friction; None without them."""
        if self._dissipative is None:
            return None
        damped = self.dynamics.damping_force(self.state)
        # A new array in both cases: friction is added to it.
        force = np.zeros(self.reduced.n) if damped is None else damped
        if len(self._dissipative.friction.limits):
            force += self._dissipative.friction_force(self._q, self._y, self.applied)
        return force

    def report(self) -> PlantReport:
        """Return inputs, work, model, forces and errors; no forces at a state that is not finite."""
        external = None
        with suppress(DivergenceError):
            external = self.external
        return PlantReport(
            applied=self.applied, work=self.work, reduced=self.reduced, external=external, errors=self.errors,
            tolerance=self.tolerance,
        )  # fmt: skip

    def advance(self, dt: float) -> None:
        """Integrate over a time dt [s].

        Args:
            dt: the time [s].

        Raises:
            DivergenceError: velocities or accelerations are not finite.
            InputError: dt is not positive.
        """
        if not 0.0 < dt < np.inf:
            raise InputError(f"dt has to be a positive number, found {dt!r}")
        _ = self.state  # in a chart that is regular here
        errors = self.errors
        step = self._step(dt, errors.steps)
        # Roughness costs nothing, and a comparison two more integrations: most samples are judged by it alone.
        accepted, after = errors.after(step.roughness, dt, self.followed * dt)
        if accepted:
            self._take(step)
            self.errors = after
        else:
            self._take(self._compared(step, dt))

    def advance_part(self, dt: float, steps: int) -> None:
        """Integrate over a part of a sample by a number of steps.

        Args:
            dt: duration of the part [s].
            steps: number of equal steps.

        Raises:
            DivergenceError: as ``advance``.
        """
        _ = self.state
        step = self._step(dt, steps)
        self._take(step)
        if step.roughness < np.inf:
            # It counts without a comparison: a part is shorter than the sample to which the estimate refers.
            _, self.errors = self.errors.after(step.roughness, dt, np.inf)

    def _take(self, step: _Step) -> None:
        """Take a state, or raise the error that the steps ended with."""
        if step.failure is not None:
            raise step.failure
        q, y = step.q, step.y
        if self.reduced.assembly.size and np.isfinite(q).all():  # otherwise the next access to ``state`` raises
            # Charts keep velocities on the rows exactly, but positions only to the order of the steps.
            q = self.dynamics.project(q, y)
        self._q, self._y, self._state = q, y, None

    def _step(self, dt: float, steps: int) -> _Step:
        """State after equal steps from the present state."""
        q, y, h = self._q, self._y, dt / steps
        try:
            return _Step(*(self._dissipative or self.dynamics).advance(q, y, self.applied, h, steps))
        except DivergenceError as error:
            return _Step(q, y, np.inf, error)

    def _compared(self, step: _Step, dt: float) -> _Step:
        """Compare a sample with twice as many substeps, and return it with as many as the tolerance asks for."""
        errors, substeps, steps = self.errors, self._substeps, self.errors.steps
        # The tolerance is per second, so that a run's error does not depend on its sampling period.
        limit, first, enough = substeps.tolerance * dt, step, steps
        finer = self._step(dt, 2 * steps)
        error = first_error = self._difference(step, finer)
        if substeps.number is None or not error <= max(limit, errors.rate * dt):
            # With events more steps hardly help, so that the search ends earlier.
            most = MOST_EVENT_SUBSTEPS if self.dissipates else MOST_SUBSTEPS
            while not error <= limit and enough < most:
                # The finer sample of the last comparison is the coarse one of the next: each doubling costs one
                # integration.
                enough, step, finer = 2 * enough, finer, self._step(dt, 4 * enough)
                error = self._difference(step, finer)
        # A number that the user chose stays: its errors are only recorded.
        if substeps.number is not None:
            if first.failure is not None and step.failure is None:
                raise DivergenceError(
                    f"the integrator, not the robot: {first.failure.what}; substeps {steps} is too small, "
                    f"set {max(enough, errors.enough) if errors.enough == 1 else errors.enough}"
                )
            self.errors = errors.compared(steps, first.roughness, first_error, dt, substeps, enough)
            return first
        if step.failure is None:
            self.errors = errors.compared(enough, step.roughness, error, dt, substeps, enough)
        return step

    def _difference(self, step: _Step, finer: _Step) -> float:
        """Estimated error of a state by one from half the step; infinite if one of them is not finite."""
        for each in (step, finer):
            if each.failure is not None or not (np.isfinite(each.q).all() and np.isfinite(each.y).all()):
                return np.inf
        return self.dynamics.error(step.q, step.y, finer.q, finer.y, finer.roughness < np.inf)
