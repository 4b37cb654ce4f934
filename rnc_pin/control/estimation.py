"""Common parts of estimators of uncertain kinematics: a linear regression, and models with estimated parameters.

Paper (14)-(21), for any constraint that is affine in its unknown parameters p: ``A_known(q) v + Y(q, v) p = 0``.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple, Protocol, TypeVar

import numpy as np
import pinocchio as pin
from numpy import ndarray as Array

from rnc_pin import _kernel
from rnc_pin.array_shapes import Float
from rnc_pin.control.adaptation import apply_dead_zone
from rnc_pin.math.linear_algebra import solve
from rnc_pin.model.kinematics import Kinematics
from rnc_pin.model.numpy_evaluator import NumPyEvaluator
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.reduction_data import ReductionData, row_scales
from rnc_pin.model.row_stack import RowStack
from rnc_pin.robots.robot import Robot

_SAMPLES = 12
_Thing = TypeVar("_Thing", Robot, RowStack, ReductionData, NumPyEvaluator, ReducedModel)


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
        """Return y and Y at a measured q (nq,) and v (nv,): ``y = Y p`` at the true parameters p."""

    def estimated(self, reduced: ReducedModel) -> EstimatedModel:
        """Return a model with the outputs of ``reduced``, and estimates in place of the unknown parameters."""


class ParametrizedCopy(NamedTuple):
    """Copies of a Pinocchio model and of its rows, and a function that writes parameters (s,) into them."""

    model: pin.Model
    rows: RowStack
    """All constraint rows. Rows without unknown parameters may be the given ones: they refer to joints by index."""
    set_parameters: Callable[[Array], None]


class EstimatedModel:
    """Models with the same outputs and actuators, under constraints with estimated parameters.

    A model with other parameters is another model: none changes while it, a part or an evaluation of it exists. The
    memory of models that no longer exist is used again, so that a new model costs little.

    Args:
        reduced: the model with the true constraints.
        make_copy: function that returns new copies of its Pinocchio model and rows, with valid parameters.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")], robot.joint_names[1:])
        >>> reduced = system.reduce([rnc.JointPosition(f"joint_{k}") for k in (1, 2, 3)])
        >>> regressor = rnc.control.MomentumRegressor(robot, "platform", [rnc.control.UnknownMass("joint_3")])
        >>> models = regressor.estimated(reduced)
        >>> heavy = models.at(np.array([40.0]))
        >>> heavy.robot.model.inertias[4].mass, robot.model.inertias[4].mass  # of the body behind joint_3 [kg]
        (40.0, 10.0)
    """

    def __init__(self, reduced: ReducedModel, make_copy: Callable[[], ParametrizedCopy]) -> None:
        self._reduced, self._make_copy = reduced, make_copy
        self._scales: Array | None = None
        self._memory = [self._allocate()]

    def __getstate__(self) -> dict[str, object]:
        return {**vars(self), "_memory": []}  # a copy has memory of its own

    def at(self, p: Float[Array, " s"]) -> ReducedModel:
        """Return a model with these parameters, which never changes."""
        memory = next((each for each in self._memory if each.is_free), None)
        if memory is None:
            memory = self._allocate()
            self._memory.append(memory)
        return memory.lend(p)

    def _allocate(self) -> _ModelMemory:
        copied, known = self._make_copy(), self._reduced.reduction_data
        robot = Robot(copied.model)
        if self._scales is None:  # the scales of the true rows are unknown
            generator = np.random.default_rng(0)
            samples = np.stack([robot.random_configuration(generator) for _ in range(_SAMPLES)])
            self._scales = row_scales(robot, copied.rows, known.reducing, samples)
        data = replace(
            known, robot=robot, rows=copied.rows, scales=self._scales, free=False, kinematics=Kinematics(robot)
        )
        own_rows = copied.rows is not self._reduced.all_constraints
        return _ModelMemory(ReducedModel(data, self._reduced.assembly), copied.set_parameters, own_rows)


class _Lease:
    """Mark of the parts of a lent model. It exists as long as one of them does."""


class _ModelMemory:
    """Model whose parameters change only while nobody uses it.

    Args:
        model: the model.
        set_parameters: writes parameters into it.
        has_own_rows: True if they may be parameters of its rows too, not of its bodies only.
    """

    def __init__(self, model: ReducedModel, set_parameters: Callable[[Array], None], has_own_rows: bool) -> None:
        self._model, self._set_parameters, self._has_own_rows = model, set_parameters, has_own_rows
        self._lease: weakref.ref[_Lease] | None = None

    @property
    def is_free(self) -> bool:
        """True if no part and no evaluation of the lent model exists."""
        return self._lease is None or self._lease() is None

    def lend(self, p: Array) -> ReducedModel:
        """Return the model with parameters p (s,)."""
        own, lease = self._model.evaluator, _Lease()
        self._set_parameters(p)
        if self._has_own_rows:
            own.rows_changed()
        # Evaluations and other reductions of the same model hold these robot and rows.
        robot, rows, data = _shallow(own.data.robot), _shallow(own.data.rows), _shallow(own.data)
        vars(robot)["_lease"] = vars(rows)["_lease"] = lease
        vars(data).update(robot=robot, rows=rows)
        evaluator, model = _shallow(own), _shallow(self._model)
        evaluator.data = data
        vars(model).update(_data=data, _evaluator=evaluator)
        self._lease = weakref.ref(lease)
        return model


def _shallow(thing: _Thing) -> _Thing:
    """Return another object with the same attributes; ``copy`` drops some."""
    other = object.__new__(type(thing))
    vars(other).update(vars(thing))
    return other


class AdaptedModel(ReducedModel):
    """Reduced model with the estimates of the last sample, for controllers that need a model.

    An evaluation keeps the estimates of its construction.

    Args:
        model: the model with the first estimates.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")], robot.joint_names[1:])
        >>> reduced = system.reduce([rnc.JointPosition(f"joint_{k}") for k in (1, 2, 3)])
        >>> regressor = rnc.control.MomentumRegressor(robot, "platform", [rnc.control.UnknownMass("joint_3")])
        >>> models = regressor.estimated(reduced)
        >>> model = rnc.control.AdaptedModel(models.at(np.array([20.0])))
        >>> before = model.at(robot.configuration())
        >>> model.use(models.at(np.array([40.0])))
        >>> after = model.at(robot.configuration())
        >>> bool(after.H[0, 0] > before.H[0, 0])
        True
    """

    def __init__(self, model: ReducedModel) -> None:
        self.use(model)

    def use(self, model: ReducedModel) -> None:
        """Evaluate another model from now on."""
        vars(self).update(vars(model))


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
    errors (``control.adaptation``). Clipping to a box that contains p does not make it grow either.
    """
    step = gain * elapsed
    beyond = error if _is_zero(dead_zone) else apply_dead_zone(error, dead_zone)
    found = np.empty(p.shape)
    if _kernel.library.adapt(p, W, beyond, low, high, step, found):
        return found
    correction = solve(np.eye(len(error)) + step * W @ W.T, step * beyond).dot(W)
    return np.minimum(np.maximum(p + correction, low), high)


def _is_zero(zone: float | np.ndarray) -> bool:
    return not (zone if isinstance(zone, float) else np.any(zone))
