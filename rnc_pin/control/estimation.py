"""Estimation of uncertain kinematics: a linear regression, models with estimated parameters, and the law (20).

Paper (14)-(21) and Lemma 4, for any constraint that is affine in its unknown parameters p:
``A_known(q) v + Y(q, v) p = 0``.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import replace
from threading import RLock
from typing import NamedTuple, Protocol

import numpy as np
import pinocchio as pin

from rnc_pin.array_shapes import Array, Float
from rnc_pin.control.controller import Description, elapsed_time, listed
from rnc_pin.control.feedback import apply_dead_zone
from rnc_pin.errors import ConfigurationError
from rnc_pin.math.linear_algebra import apply, solve
from rnc_pin.model.evaluation_results import Measurement
from rnc_pin.model.evaluator import Evaluator, evaluator_for
from rnc_pin.model.independence import row_scales
from rnc_pin.model.kinematics import Kinematics
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.rows import RowStack
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.printing import ReprMixin
from rnc_pin.robots.robot import Robot

_LENDING = RLock()  # of copies that estimates of all threads share
Bound = float | Sequence[float] | np.ndarray
Bounds = tuple[Bound, Bound]

BOUNDS = (0.05, 20.0)
"""Default lowest and highest estimate."""


class Regressor(Protocol):
    """Constraints that are affine in unknown parameters p, without their true values.

    Attributes:
        names: of the parameters (s,).
        predicted: names of the entries of the prediction error (e,).
        units: of the parameters (s,).
        predicted_units: units of the entries of the prediction error (e,).
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    predicted: tuple[str, ...]
    predicted_units: tuple[str, ...]

    def regress(self, q: Array, v: Array) -> tuple[Float[Array, " e"], Float[Array, "e s"]]:
        """Return y and Y at a measured q (nq,) and v (nv,): ``y = Y p`` at the true parameters p.

        Args:
            q: measured configuration.
            v: measured velocity.
        """

    def estimated(self, reduced: ReducedModel) -> EstimatedModel:
        """Return a model with the outputs of ``reduced``, and estimates in place of the unknown parameters.

        Args:
            reduced: the model with the true constraints.
        """


class ParametrizedCopy(NamedTuple):
    """Copies of a Pinocchio model and of its rows, and a function that writes parameters (s,) into them."""

    model: pin.Model
    rows: RowStack
    """All constraint rows. Rows without unknown parameters may be the given ones: they refer to joints by index."""
    set_parameters: Callable[[Array], None]


class EstimatedModel(ReducedModel):
    """Reduced model under constraints with estimated parameters, at first all 1.

    ``with_parameters`` returns a model that never changes. ``use`` changes this model itself, for controllers that keep
    it; evaluations that it has returned never change either.

    Args:
        reduced: the model with the true constraints.
        make_copy: function that returns new copies of its Pinocchio model and rows, with parameters 1.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")], robot.joint_names[1:])
        >>> reduced = system.reduce([rnc.JointPosition(f"joint_{k}") for k in (1, 2, 3)])
        >>> regressor = rnc.control.MomentumRegressor(robot, "platform", [rnc.control.UnknownMass("joint_3")])
        >>> model = regressor.estimated(reduced)
        >>> heavy = model.with_parameters(np.array([40.0]))
        >>> heavy.robot.model.inertias[4].mass, robot.model.inertias[4].mass  # of the body behind joint_3 [kg]
        (40.0, 10.0)
        >>> before = model.at(robot.configuration())
        >>> model.use(np.array([40.0]))
        >>> bool(model.at(robot.configuration()).H[0, 0] > before.H[0, 0])
        True
    """

    def __setattr__(self, name: str, value: object) -> None:
        object.__setattr__(self, name, value)  # ``use`` changes the model

    def __init__(self, reduced: ReducedModel, make_copy: Callable[[], ParametrizedCopy]) -> None:
        self._reduced, self._make_copy, self._copies = reduced, make_copy, list[_OwnedCopy]()
        self._scales: Array | None = None
        super().__init__(self._evaluator_of(None), reduced.assembly)

    def __getstate__(self) -> dict[str, object]:
        return {**vars(self), "_copies": []}  # a copy makes its own

    def with_parameters(self, p: Float[Array, " s"]) -> ReducedModel:
        """Return a model with these parameters, which never changes.

        Args:
            p: parameters.
        """
        return ReducedModel(self._evaluator_of(p), self.assembly)

    def use(self, p: Float[Array, " s"]) -> None:
        """Evaluate with these parameters from now on.

        Args:
            p: parameters.
        """
        super().__init__(self._evaluator_of(p), self.assembly)

    def _evaluator_of(self, p: Array | None) -> Evaluator:
        """Evaluator of a copy that nobody uses, with parameters p (s,), or 1."""
        with _LENDING:  # two threads would find the same copy free
            # Usually two copies are enough: that of this sample, and that of the last one, which is still in use.
            free = next((each for each in self._copies if each.is_free), None)
            if free is None:
                free = self._new_copy()
                self._copies.append(free)
            return free.with_parameters(p)

    def _new_copy(self) -> _OwnedCopy:
        copied, known = self._make_copy(), self._reduced.reduction_data
        rows, robot = copied.rows, Robot(copied.model)
        count = 12  # as many as a system takes for the scales of its rows
        if self._scales is None:  # the scales of the true rows are unknown
            generator = np.random.default_rng(0)
            samples = np.stack([robot.random_configuration(generator) for _ in range(count)])
            self._scales = row_scales(robot, rows, known.reducing, samples)
        data = replace(known, robot=robot, rows=rows, scales=self._scales, free=False, kinematics=Kinematics(robot))
        return _OwnedCopy(evaluator_for(data), copied.set_parameters, rows is not known.rows)


class _OwnedCopy:
    """Copy of a model whose parameters are written in place, which is faster than another copy for each sample.

    Each writing gets a robot object of its own, to which all models and evaluations of these parameters refer. It
    is written again only when this robot no longer exists: then no model or evaluation uses it any more.

    Args:
        evaluator: evaluator of the copy.
        set_parameters: writes parameters into it.
        has_own_rows: True if they may be parameters of its rows too, not of its bodies only.
    """

    def __init__(self, evaluator: Evaluator, set_parameters: Callable[[Array], None], has_own_rows: bool) -> None:
        self._evaluator, self._set_parameters, self._has_own_rows = evaluator, set_parameters, has_own_rows
        self._user: Callable[[], Robot | None] = lambda: None

    @property
    def is_free(self) -> bool:
        """True if no model and no evaluation refers to the parameters."""
        return self._user() is None

    def with_parameters(self, p: Array | None) -> Evaluator:
        """Evaluator with parameters p (s,), or with those of its construction."""
        own = self._evaluator
        if p is not None:
            self._set_parameters(p)
            if self._has_own_rows:
                own.rows_changed()
        # Evaluations refer to this shallow copy alone: when it is gone, nobody reads the parameters any more.
        robot = copy(own.data.robot)
        self._user = weakref.ref(robot)
        return Evaluator(replace(own.data, robot=robot, kinematics=Kinematics(robot)), own.kernel)


def adapt(
    p: np.ndarray,
    W: np.ndarray,
    error: np.ndarray,
    gain: float,
    elapsed: float,
    low: np.ndarray,
    high: np.ndarray,
    dead_zone: float | np.ndarray = 0.0,
) -> np.ndarray:
    """Return the parameters after one sample of ``pdot = alpha W^T E`` (20), kept within bounds.

    The step is bounded as in the trackers: it never corrects more than the measured error, so ``|p - phat|`` does not
    grow (Lemma 4). With noise within the dead zone it does not grow for small steps, because the law ignores such
    errors (``control.feedback``). Clipping to a box that contains p does not make it grow either.

    Args:
        p: parameters (s,).
        W: regressor (e, s).
        error: prediction error (e,) of these parameters.
        gain: adaptation gain alpha.
        elapsed: duration of the sample [s].
        low: lowest parameters (s,).
        high: highest parameters (s,).
        dead_zone: error that is ignored; a number or one for each entry.
    """
    step = gain * elapsed
    beyond = apply_dead_zone(error, dead_zone)
    # Implicit Euler: p moves at most to where the error is zero, whatever alpha and the period are.
    correction = solve(np.eye(len(error)) + step * W @ W.T, step * beyond).dot(W)
    return np.minimum(np.maximum(p + correction, low), high)


class EstimatorState(NamedTuple):
    """State of the estimator: time of the last sample, and parameter estimates."""

    time: float | None
    p: Float[Array, " s"]
    """Parameter estimates."""


class Estimator(ReprMixin):
    """``phat_dot = alpha Y^T E`` with ``E = y - Y phat``, paper (20), at the measured q and v.

    Args:
        reduced: the system; the true values of its unknown parameters are never read.
        regressor: model of the unknown parameters, e.g. ``MomentumRegressor`` or ``WheelRegressor``.
        initial: first estimates (s,), in the regressor's units.
        bounds: lowest and highest values, positive; a number or one for each parameter.
        alpha: adaptation gain; 0 switches it off.
        dead_zone: prediction error below which estimates do not change; a number or one for each entry.

    Attributes:
        model: the model with the estimates of the last step; at first with ``initial``. Use it for every controller
            that needs a model, and for gains that are scaled to an inertia. Its evaluations never change.

    Raises:
        ConfigurationError: estimates are outside the bounds or of the wrong number, or the momentum is not zero.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")], robot.joint_names[1:])
        >>> reduced = system.reduce([rnc.JointPosition(f"joint_{k}") for k in (1, 2, 3)])
        >>> regressor = rnc.control.MomentumRegressor(robot, "platform", [rnc.control.UnknownMass("joint_3")])
        >>> estimator = rnc.control.Estimator(reduced, regressor, initial=[15.0], bounds=(1.0, 50.0), alpha=1e9)
        >>> moving = reduced.at(robot.configuration({"joint_2": 1.8}), [0.1, 0.2, 0.3]).measure()
        >>> state, error = estimator.step(0.0, moving, estimator.initial_state())
        >>> state, error = estimator.step(1.0, moving, state)
        >>> state.p.round(2)  # one sample with a large gain finds the mass
        array([10.])
    """

    def __init__(
        self,
        reduced: ReducedModel,
        regressor: Regressor,
        initial: Sequence[float] | np.ndarray,
        bounds: Bounds = BOUNDS,
        alpha: float = 1.0,
        dead_zone: float | np.ndarray = 0.0,
    ) -> None:
        self.regressor, self.alpha, self.dead_zone = regressor, alpha, dead_zone
        self.initial = np.array(initial, dtype=float)
        size = len(regressor.names)
        if self.initial.shape != (size,):
            raise ConfigurationError(f"{self.initial.size} initial estimates for {size} unknown parameters")
        self._low, self._high = (_one_each(bound, size) for bound in bounds)
        # Masses, radii and tracks: the estimated model has to be a robot at any of them.
        if not ((self._low > 0) & (self._low < self._high)).all():
            raise ConfigurationError(f"bounds of estimates have to be positive and in order, found {tuple(bounds)}")
        outside = np.flatnonzero((self.initial < self._low) | (self.initial > self._high))
        if len(outside):
            first = outside[0]
            raise ConfigurationError(
                f"first estimate of the {regressor.names[first]}, {self.initial[first]:g}, has to be within its bounds "
                f"{self._low[first]:g} and {self._high[first]:g}"
            )
        if reduced.affine:
            raise ConfigurationError("estimation assumes A v = 0 (zero momentum), but the momentum is not zero")
        self.model, self._p = regressor.estimated(reduced), self.initial  # parameters of ``model``
        self.model.use(self._p)

    def describe(self) -> Description:
        """Return the gain, the first estimates by name, and the bounds."""
        initial = dict(zip(self.regressor.names, self.initial.tolist(), strict=True))
        bounds = [listed(self._low), listed(self._high)]
        return {"alpha": self.alpha, "dead_zone": listed(self.dead_zone), "initial": initial, "bounds": bounds}

    def initial_state(self) -> EstimatorState:
        """Return the first estimates; ``model`` has them too."""
        # A second run starts here again, whatever the last one has learnt.
        self._use(self.initial)
        return EstimatorState(None, self.initial)

    def step(self, t: float, measurement: Measurement, state: EstimatorState) -> tuple[EstimatorState, np.ndarray]:
        """Update the estimates and ``model``; also return the prediction error E (e,) of the previous estimates.

        Reads from the measurement: ``q, v``.

        Args:
            t: time of the sample [s].
            measurement: measurement at that time.
            state: estimates of the last sample.

        Raises:
            InputError: time runs backwards.
        """
        elapsed = elapsed_time(t, state.time)
        # Paper (18): what the estimates do not explain of the measured motion.
        y, Y = self.regressor.regress(measurement.q, measurement.v)
        error = y - Y @ state.p
        p = state.p
        # Without adaptation the step is zero, and solving for it only takes time.
        if self.alpha > 0:
            p = adapt(p, Y, error, self.alpha, elapsed, self._low, self._high, self.dead_zone)
        self._use(p)
        return EstimatorState(t, p), error

    def _use(self, p: np.ndarray) -> None:
        """Let ``model`` have parameters p."""
        # Equal estimates keep the evaluations of the model that are cached.
        if not np.array_equal(p, self._p):
            self.model.use(p)
            self._p = p

    def _settings(self) -> dict[str, object]:
        return {"unknown": list(self.regressor.names), "initial": self.initial, "alpha": self.alpha}


def with_estimated_kinematics(measurement: Measurement, estimate: StateEvaluation) -> Measurement:
    """Return a measurement with the kinematics of an estimated model instead of the true kinematics.

    Args:
        measurement: measurement of the robot.
        estimate: evaluation of the estimated model at the measured state.
    """
    # The slip is relative to the true constraints, which nobody knows here.
    seen = measurement._replace(A_star=estimate.A_star, A_star_dot=estimate.A_star_dot, residual=None)
    if seen.input_deficit is None:
        return seen
    return seen._replace(force_deficit=apply(estimate.input_matrix, seen.input_deficit))


def _one_each(bound: Bound, size: int) -> np.ndarray:
    values = np.asarray(bound, dtype=float)
    if values.shape not in ((), (size,)):
        raise ConfigurationError(f"bounds of estimates: {values.size} values for {size} unknown parameters")
    return np.array(np.broadcast_to(values, (size,)))
