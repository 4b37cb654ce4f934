"""Inertial identification of a robot under constraints: base parameters, friction and effort scales from a log."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin

from rnc_pin.errors import ConfigurationError, InfeasibleError, short_text
from rnc_pin.identification.inertial_fit import InertialFit, MeasuredRow
from rnc_pin.identification.inertial_problem import AskedParameters, InertialProblem, column_names
from rnc_pin.identification.logs.log import Log
from rnc_pin.identification.reduced_regressor import BaseParameters, Estimates, combination_name
from rnc_pin.identification.unknowns import (
    INERTIAL,
    DynamicUnknown,
)
from rnc_pin.identification.urdf_copy import write_inertias
from rnc_pin.identification.window_fit import correlation_length
from rnc_pin.model.system import NonholonomicSystem
from rnc_pin.printing import Item, ObjectSummary
from rnc_pin.robots.robot import Robot

_HELPS = 0.3  # change that a joint shows, relative to the best joint, from which it is named


@dataclass(frozen=True)
class EffortError:
    """Root mean square error of a row that the identified robot predicts, beside other predictions.

    Rows are averages over windows of time. A row without effort is a force or a momentum, whose unit it has.

    Example:
        >>> rnc.identification.EffortError(fit=0.1, file=0.3, constant=0.5).fit
        0.1
    """

    fit: float
    """Error of the identified robot."""
    file: float
    """Error of the robot's file."""
    constant: float
    """Error of a constant: the mean of the row in the part that was fitted."""

    def __str__(self) -> str:
        return f"{self.fit:.3g}, file {self.file:.3g}, constant {self.constant:.3g}"


@dataclass(frozen=True)
class WeakCombination:
    """Combination of parameters that the log shows worst, and joints whose motion would show it.

    Example:
        >>> rnc.identification.WeakCombination("m of arm", 0.3, ("arm",)).joints
        ('arm',)
    """

    name: str
    """Combination of base parameters, relative to their typical sizes."""
    std: float
    """Its standard deviation from the log alone."""
    joints: tuple[str, ...]
    """Joints that change the measured rows most for it, the best first."""


@dataclass(frozen=True, repr=False)
class Identification(Estimates):
    """Base parameters, friction and effort scales of a robot, with their covariance.

    Base parameters are combinations that the rows can show. Effort scales and offsets come after them.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> heavy = robot.with_masses({"link_3": 12.0})
        >>> joints = [f"joint_{k}" for k in (1, 2, 3)]
        >>> momentum = rnc.MomentumConservation("platform")
        >>> reduced = rnc.NonholonomicSystem(heavy, [momentum], joints).reduce([rnc.JointPosition(k) for k in joints])
        >>> turns = rnc.planning.Harmonic([0.0, 0.0, 1.0], [0.6, 0.7, 0.8], frequency=[0.3, 0.5, 0.7])
        >>> target = rnc.control.ReducingOutputController(reduced, turns)
        >>> time, q = rnc.kinematic_rollout(reduced, target, robot.configuration({"joint_3": 1.0}), duration=4.0)
        >>> log = rnc.Log.of_motion(robot, time, q)
        >>> file = rnc.NonholonomicSystem(robot, [momentum], joints)
        >>> found = rnc.identify(file, log, prior=0.3)
        >>> found.assumed
        'inertia of the robot in its zero position of momentum(platform)'
    """

    invisible: tuple[str, ...]
    """Parameters that act on no row in any motion."""
    assumed: str
    """Quantity that has its value of the file, since the rows do not show the scale of all masses; "" for none."""
    errors: Mapping[str, EffortError]
    """Errors of each row that was fitted."""
    held_out: Mapping[str, EffortError]
    """Errors of each row on the part of the log that was held out."""
    weakest: WeakCombination
    """Combination of parameters to measure next."""
    system: NonholonomicSystem
    """The robot with the estimated inertias, friction and motor inertia. Scales of efforts are not part of it."""
    changed: tuple[tuple[str, ...], tuple[str, ...]]
    """Joints of the bodies, and joints whose friction was estimated."""

    def write_urdf(self, source: str | Path, path: str | Path) -> None:
        """Write a copy of the robot's URDF with the estimated inertias, damping and friction.

        Args:
            source: URDF that the robot was read from.
            path: file to write.

        Raises:
            ConfigurationError: the source is not a URDF of this robot.
        """
        bodies, joints = self.changed
        write_inertias(Path(source), Path(path), self.system.robot, list(bodies), list(joints))

    def _summary(self) -> ObjectSummary:
        lines = self._estimates([""] * len(self.names))
        lines += [(f"error, {name}", [Item(str(error))]) for name, error in self.errors.items()]
        lines += [(f"error held out, {name}", [Item(str(error))]) for name, error in self.held_out.items()]
        lines += [("assumed", [Item(self.assumed)])] if self.assumed else []
        lines += [("worst known", [Item(self.weakest.name, f"std {self.weakest.std:.2g}")])]
        lines += [("measure next", [Item(name) for name in self.weakest.joints])]
        return ObjectSummary("Identification", lines)


def identify(
    system: NonholonomicSystem,
    log: Log,
    unknown: Sequence[DynamicUnknown] | None = None,
    *,
    prior: float | None = None,
    held_out: float = 0.0,
    window: float | None = None,
    resolution: float = 0.1,
) -> Identification:
    """Estimate inertias, friction and effort scales of a robot under constraints from a log.

    The rows are ``R^T Y(q, v, vdot) p = R^T B T`` without the multipliers of wheels and loops, averaged over windows
    by parts, so that no acceleration is needed. The momentum of a free base is linear in the same parameters: it needs
    no effort. Each body keeps an inertia that a body can have: its pseudo-inertia is positive definite.

    Assumptions: constraints hold exactly, sensors of velocity have no delay, and errors of the measured motion are
    small beside those of the efforts.

    Args:
        system: the robot with its constraints; its actuators are joints for effort scales and offsets.
        log: positions of joints, and velocities if they are measured; efforts; pose and twist of a free base.
        unknown: the parameters; by default the inertias of all bodies, and the friction of joints with efforts.
        prior: relative standard deviation of the second moments of mass in the file; None to use the log alone.
        held_out: share of the log at its end that is not used, but whose errors are stated.
        window: duration of the windows [s]; by default 32 samples.
        resolution: largest accepted standard deviation of a combination without a prior, relative to typical sizes.

    Raises:
        ConfigurationError: a name is unknown, an option is out of range, or the log lacks a measurement.
        InfeasibleError: without a prior, the log does not determine a combination, which the message names.

    Returns:
        Base parameters with their covariance, and the robot that has them.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")], robot.joint_names[1:])
        >>> still = rnc.Log.of_motion(robot, np.arange(40.0), np.tile(robot.configuration(), (40, 1)))
        >>> try:
        ...     rnc.identify(system, still, [rnc.identification.BodyInertia("joint_3")])
        ... except rnc.InfeasibleError as error:
        ...     print(str(error)[:30])
        the log does not determine the
    """
    for name, given, kind in (("system", system, NonholonomicSystem), ("log", log, Log)):
        if not isinstance(given, kind):
            raise ConfigurationError(f"{name}: expected a {kind.__name__}, found {short_text(given)}")
    if prior is not None and not prior > 0:
        raise ConfigurationError(f"prior: expected a positive number, found {prior}")
    if not 0 <= held_out <= 0.9:
        raise ConfigurationError(f"held_out: expected a share of 0 to 0.9, found {held_out}")
    problem = InertialProblem(system, log, window)
    time = problem.motion.time
    end = time[0] + (1 - held_out) * np.ptp(time)
    blocks = problem.blocks(time[0], end)
    if not blocks:
        raise ConfigurationError("the log is shorter than a window of time")
    asked = AskedParameters(problem, unknown)
    fit = asked.fit(blocks, prior)
    fit.solve()
    names = column_names(problem.regressor, INERTIAL)
    generator = np.random.default_rng(0)
    base = BaseParameters.of(problem.structure(generator)[:, asked.columns], [names[k] for k in asked.columns])
    correlation = max([correlation_length(each.residuals(fit.parameters(fit.x), fit.x)) for each in blocks])
    weakest = _judged(problem, asked, fit, base, prior is None, resolution / np.sqrt(correlation))
    p, others = fit.parameters(fit.x), np.arange(len(asked.columns), len(fit.x))
    count = len(base.names)
    maps = np.zeros((count + len(others), len(fit.x)))
    maps[:count, : len(asked.columns)] = base.K
    maps[count:, others] = np.eye(len(others))
    spread = maps @ np.linalg.pinv(fit.terms(fit.x)[1], rcond=1e-13) * np.sqrt(correlation)
    rest = problem.blocks(np.nextafter(end, np.inf), np.inf) if held_out else []
    return Identification(
        (*base.names, *asked.names),
        np.concatenate([base.K @ fit.known[asked.columns], asked.first_values]),
        np.concatenate([base.K @ p[asked.columns], fit.x[others]]),
        spread @ spread.T,
        base.invisible,
        problem.assumed,
        _errors(asked, blocks, fit),
        _errors(asked, rest, fit),
        weakest,
        identified(system, problem, p, asked),
        (tuple(asked.bodies), tuple(asked.friction)),
    )


def _errors(asked: AskedParameters, blocks: Sequence[MeasuredRow], fit: InertialFit) -> dict[str, EffortError]:
    """Errors of rows by the fit, by the file and by a constant."""
    asked.bind(blocks)
    p, found = fit.parameters(fit.x), {}
    for block in blocks:
        if not block.fixed:
            mean = np.mean(next(each.y for each in fit.blocks if each.name == block.name))
            found[block.name] = EffortError(
                _rms(block.residuals(p, fit.x)), _rms(block.D @ fit.known - block.y), _rms(block.y - mean)
            )
    return found


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _judged(
    problem: InertialProblem,
    asked: AskedParameters,
    fit: InertialFit,
    base: BaseParameters,
    strict: bool,
    resolution: float,
) -> WeakCombination:
    """The combination that the log shows worst; an error if it is not known well enough and has to be."""
    chosen = np.array(asked.columns, dtype=int)[base.independent]
    sizes, others = _sizes(fit.known, asked, problem, chosen), np.ones(len(asked.names))
    for block in fit.blocks:
        if block.scale is not None:
            others[block.scale - asked.begin] = fit.x[block.scale]
        if block.offset is not None:
            others[block.offset - asked.begin] = block.size
    _, J = fit.data(fit.x)
    scaled = np.hstack([J[:, base.independent] * sizes, J[:, asked.begin :] * others])
    scaled = np.vstack([scaled, np.zeros((scaled.shape[1], scaled.shape[1]))])
    _, values, vectors = np.linalg.svd(scaled, full_matrices=False)
    names, helpful = [*base.names, *asked.names], _helpful(problem, chosen, vectors[-1][: len(chosen)] * sizes)
    lost = values <= np.maximum(1 / resolution, 1e-11 * values[0])
    if strict and lost.any():
        missing = [combination_name(vector, names) for vector in vectors[lost]]
        more = f"; or the {missing[-2]}" if len(missing) > 1 else ""
        count = f" ({len(missing)} combinations)" if len(missing) > 2 else ""
        raise InfeasibleError(f"the log does not determine the {missing[-1]}{more}{count}: "
                              f"move {', '.join(helpful) or 'other joints'}, or give a prior")  # fmt: skip
    return WeakCombination(
        combination_name(vectors[-1], names),
        float(1 / values[-1]) if values[-1] > 1e-11 * values[0] else np.inf,
        helpful,
    )


def _helpful(problem: InertialProblem, columns: np.ndarray, values: np.ndarray) -> tuple[str, ...]:
    """Joints whose motion shows a combination of columns."""
    combination = np.zeros(problem.regressor.width)
    combination[columns] = values
    found = problem.movers(combination, np.random.default_rng(1))
    best = max((size for _, size in found), default=0.0)
    return tuple(name for name, size in found[:3] if size > _HELPS * best)


def _sizes(known: np.ndarray, asked: AskedParameters, problem: InertialProblem, columns: np.ndarray) -> np.ndarray:
    """Typical sizes of parameters: of a body's mass and length, and of friction that acts as much as the efforts."""
    model = problem.system.robot.model
    length = max([float(np.linalg.norm(each.translation)) for each in model.jointPlacements[1:]] or [1.0]) or 1.0
    mass = max(float(np.sum(known[0 : 10 * len(problem.regressor.bodies) : 10])), 1e-300)
    sizes = np.ones(len(known))
    for k in range(len(problem.regressor.bodies)):
        own = max(known[10 * k], 1e-3 * mass)
        sizes[10 * k : 10 * k + 10] = own * np.array([1.0, *[length] * 3, *[length**2] * 6])
    sizes[10 * len(problem.regressor.bodies) :] = problem.effort_size
    return sizes[columns]


def identified(
    system: NonholonomicSystem, problem: InertialProblem, p: np.ndarray, asked: AskedParameters
) -> NonholonomicSystem:
    """The system with parameters (width,) of the regressor."""
    robot: Robot = copy(system.robot)
    model = robot.model = system.robot.model.copy()
    regressor = problem.regressor
    for k, name in enumerate(regressor.bodies):
        if name in asked.bodies:
            model.inertias[robot.joint_id(name)] = pin.Inertia.FromDynamicParameters(p[10 * k : 10 * k + 10])
    dry, damping, armature = p[10 * len(regressor.bodies) :].reshape(3, -1)
    for k, name in enumerate(regressor.joints):
        if name in asked.friction:
            entry = robot.velocity_indices(name).start
            model.upperDryFrictionLimit[entry], model.lowerDryFrictionLimit[entry] = dry[k], -dry[k]
            model.damping[entry], model.armature[entry] = damping[k], armature[k]
    return system.with_robot(robot, system.kinds)
