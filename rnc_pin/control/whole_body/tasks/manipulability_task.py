"""Task: ascent on the manipulability of an output."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rnc_pin.control.whole_body.control_sample import ControlSample
from rnc_pin.control.whole_body.tasks.control_task import BoundTask, ControlTask, TaskRows
from rnc_pin.errors import SingularityError
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.rows import OutputKind


@dataclass(frozen=True)
class ManipulabilityTask(ControlTask):
    """Motion that increases the manipulability of an output: ``v2 = gain dw/dx2``, ``w = log det(A A^T) / 2``.

    A is the Jacobian of the output in reduced velocities, ``A = J R``. ``exp(w)`` is the manipulability of T.
    Yoshikawa, Int. J. Robotics Research 4(2), 1985. Give the task a lower priority than the output itself: it then is
    the secondary objective of law (12). The gradient is exact.

    Args:
        output: the output, e.g. ``rnc.FramePosition("hand")``.

    Raises:
        SingularityError: at a sample, A has no full rank, so w has no gradient.

    Example:
        >>> robot = rnc.Robot.from_urdf("mobile_manipulator.urdf")  # the arm alone
        >>> reduced = rnc.NonholonomicSystem(robot, [], robot.joint_names).reduce()
        >>> task = rnc.control.tasks.ManipulabilityTask(rnc.FramePosition("tip", "xy"))
        >>> q = robot.configuration({"joint_2": 1.0})
        >>> sample = rnc.control.ControlSample(reduced, 0.0, q, np.zeros(reduced.r), dt=0.01)
        >>> rows = task.bind(reduced).rows(sample)
        >>> rows.rate.round(6) + 0.0  # w = log |sin q2|, so dw/dq2 = 1 / tan q2
        array([0.      , 0.642093])
    """

    output: OutputKind

    def bind(self, reduced: ReducedModel) -> BoundTask:
        return _BoundManipulability(self, reduced)


class _BoundManipulability(BoundTask):
    def __init__(self, task: ManipulabilityTask, reduced: ReducedModel) -> None:
        self._block = task.output.bind(reduced.robot)
        self.names = tuple(f"{name} manipulability" for name in reduced.reducing.names)
        self._gain = task.numbers("gain", task.gain, reduced.r)

    def rows(self, sample: ControlSample) -> TaskRows:
        end, motions = sample.end, sample.along_reducing_outputs()
        J = self._block.jacobian(end.position)
        A = J @ end.R
        try:
            weights = np.linalg.solve(A @ A.T, A)
        except np.linalg.LinAlgError:
            raise SingularityError(
                "the manipulability of an output is zero", q=end.q.copy(), condition=np.inf, rows=self._block.names
            ) from None
        rates = self._block.jacobian_dot(motions.rates) @ end.R + J @ motions.R_dot  # (r, k, r), one for each motion
        return TaskRows(end.J2, self._gain * np.einsum("kr,skr->s", weights, rates))
