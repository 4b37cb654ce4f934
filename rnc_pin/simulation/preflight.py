"""Before anything moves: how close a reference comes to a singular configuration, when and where."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rnc_pin.control import RedundancyController
from rnc_pin.errors import SingularityError
from rnc_pin.planning import TaskReference
from rnc_pin.reduction import ReducedModel
from rnc_pin.simulation.rollout import kinematic_rollout
from rnc_pin.task import Task

_K3 = 2.0


@dataclass(frozen=True)
class Margin:
    """A smallest singular value along a reference.

    Attributes:
        value: of the stack E with unit rows, or of A4.
        time: when it is reached [s].
        q: where, (nq,).
    """

    value: float
    time: float
    q: np.ndarray


@dataclass(frozen=True)
class Margins:
    """What a preflight found.

    Attributes:
        stack: of ``E = [A; J2]``: whether x2 parametrises the motion.
        A4: whether the redundant outputs can move the vertical ones.
        singular: the error that ended the roll-out early, with its time, or None.
        time: times of the roll-out (N,) [s].
        q: its configurations (N, nq).
    """

    stack: Margin
    A4: Margin
    singular: SingularityError | None
    time: np.ndarray
    q: np.ndarray


def preflight(
    reduced: ReducedModel,
    task: Task,
    reference: TaskReference,
    q0: np.ndarray,
    duration: float | None = None,
    dt: float = 0.02,
) -> Margins:
    """Follow a reference by kinematics alone, without dynamics, and watch the singular values.

    Args:
        reduced: the model.
        task: its outputs.
        reference: desired x21 and x1.
        q0: initial configuration (nq,).
        duration: [s]; by default until the reference rests.
        dt: step of the roll-out [s].

    Raises:
        SingularityError: the initial configuration is singular.
    """
    controller = RedundancyController(task, reference.primary, reference.vertical, k3=_K3, k21=_K3)
    horizon = reference.duration if duration is None else duration
    singular: SingularityError | None = None
    try:
        times, path = kinematic_rollout(reduced, controller, q0, horizon, dt)
    except SingularityError as error:
        if error.trajectory is None:
            raise
        singular = error
        times, path = error.trajectory
    stack = np.asarray(reduced.smallest_singular_value(path))
    A_star = reduced.terms(path, np.zeros((len(path), reduced.r))).A_star
    A4 = np.linalg.svd(A_star[:, task.vertical][:, :, task.redundant], compute_uv=False)[:, -1]

    def smallest(values: np.ndarray) -> Margin:
        index = int(np.argmin(values))
        return Margin(float(values[index]), float(times[index]), path[index])

    return Margins(smallest(stack), smallest(A4), singular, times, path)
