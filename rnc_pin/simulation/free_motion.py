"""Motion without a sampled controller, integrated to a tolerance."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pinocchio as pin

from rnc_pin.control.protocol import Command
from rnc_pin.errors import DivergenceError, InputError, SimulationError, SingularityError
from rnc_pin.model.reduction import ReducedModel
from rnc_pin.simulation.adaptive import AdaptiveIntegrator
from rnc_pin.simulation.plant import Plant
from rnc_pin.simulation.simulate import OUTCOMES, Record, assembled_start
from rnc_pin.simulation.trajectory import Outcome, Trajectory

Feedback = Callable[[float, np.ndarray, np.ndarray], np.ndarray]


def free_motion(
    reduced: ReducedModel,
    q0: np.ndarray,
    v2_0: np.ndarray,
    duration: float,
    dt: float = 0.02,
    inputs: np.ndarray | Feedback | None = None,
    *,
    rtol: float = 1e-12,
    atol: float = 1e-12,
    joint_damping: bool = False,
    speed_limit: float = 1e3,
    meta: Mapping[str, Any] | None = None,
) -> Trajectory:
    """Let a reduced system move by itself, under constant inputs, or under a continuous feedback.

    An adaptive eighth-order method on the configuration manifold: for motions to be exact over minutes. What it lets
    holonomic rows drift, of the order of the tolerance, is removed after every step. A controller
    that samples and holds belongs into ``simulate``, whose fixed step it fits.

    Args:
        reduced: the model.
        q0: initial configuration (nq,).
        v2_0: initial reduced velocity (r,).
        duration: [s].
        dt: spacing of the samples that are kept [s]; steps are as long as the tolerances let them be.
        inputs: actuator inputs (p,), or ``inputs(t, q, v2) -> (p,)``, continuous; none by default.
        rtol, atol: relative and absolute tolerance of a step.
        joint_damping: let the URDF's viscous damping act.
        speed_limit: a reduced velocity beyond this counts as diverged.
        meta: kept with the trajectory.

    Raises:
        SingularityError, DivergenceError: with the run so far in ``error.trajectory``.
        InputError: wrong shapes, times or tolerances that are not positive, or an initial configuration that does not
            satisfy the holonomic rows.
    """
    if not (0 < dt <= duration < np.inf and rtol > 0 and atol > 0):
        raise InputError(
            f"duration {duration}, dt {dt}, rtol {rtol} and atol {atol} have to be positive, dt at most the duration"
        )
    r, p = reduced.r, reduced.p
    plant = Plant(reduced, joint_damping)
    constant = np.zeros(p) if inputs is None else None if callable(inputs) else np.array(inputs, dtype=float)

    def at(t: float, q: np.ndarray, v2: np.ndarray) -> np.ndarray:
        return constant if constant is not None else np.asarray(inputs(t, q, v2), dtype=float)  # type: ignore[misc, operator]

    def rate(t: float, q: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return plant.rate(at(t, q, y[:r]))(q, y)

    q, v2 = assembled_start(reduced, np.array(q0, dtype=float)), np.asarray(v2_0, dtype=float)
    reduced.forward_dynamics(q, v2, at(0.0, q, v2))  # shapes and singularities speak before the solver does
    y = np.concatenate([v2, np.zeros(r + 1)])
    times = np.linspace(0.0, duration, round(duration / dt) + 1)
    record = Record(reduced, len(times))
    project = reduced.assembly.project if reduced.assembly.size else None
    integrator = AdaptiveIntegrator(reduced.robot, rate, rtol, atol, project)
    outcome, information = Outcome.COMPLETED, dict(meta or {})
    t = 0.0
    try:
        for t, q_t, y_t in integrator.run(times, pin.normalize(reduced.robot.model, q), y):
            v2 = y_t[:r]
            if not np.abs(v2).max() < speed_limit:
                raise DivergenceError(f"reduced velocities reached {np.abs(v2).max():.3g}", time=t)
            T = at(t, q_t, v2)
            record.add(t, reduced.measure(q_t, v2, y_t[r : 2 * r]), Command(T=T), T, y_t)
    except SimulationError as error:
        if isinstance(error, SingularityError) and error.time is None:
            error.time = t
        information.update(outcome=OUTCOMES[type(error)], message=str(error))
        error.trajectory = record.finish(information, dt)
        raise
    except KeyboardInterrupt:
        outcome = Outcome.INTERRUPTED
    information.update(outcome=outcome)
    return record.finish(information, dt)
