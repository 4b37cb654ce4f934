"""One sample of a whole-body controller: its measured start and its predicted end."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.state_evaluation import StateEvaluation


class ControlSample:
    """Sample of a whole-body controller, as tasks and limits see it.

    The program decides the velocity at the end of the sample. Over the sample the commanded velocity changes linearly.
    So the end is predicted from the velocity that is commanded at the start.

    Args:
        reduced: the model.
        time: time of the start [s].
        q: measured configuration at the start, (nq,).
        v2: reduced velocity commanded at the start, (r,).
        dt: duration of the sample [s]; zero for the start itself.

    Attributes:
        time: time of the end [s].
        dt: duration [s].
        start: model at the start: measured configuration, commanded velocity.
        end: model at the predicted configuration of the end. ``end.position`` has placements and Jacobians of frames;
            ``end.R`` and ``end.b`` map reduced velocities at the end, ``v = R v2 + b``. Its own velocity is the one
            commanded at the start.

    Example:
        >>> robot = rnc.Robot.from_urdf("mobile_manipulator.urdf", base="planar")
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("axle")]).reduce()
        >>> sample = rnc.control.ControlSample(reduced, 0.0, robot.configuration(), np.eye(reduced.r)[0], dt=0.01)
        >>> sample.time, float(sample.end.q[0].round(6))  # the base moves forward at 1 m/s
        (0.01, 0.01)
    """

    __slots__ = ("_reduced", "dt", "end", "start", "time")

    def __init__(self, reduced: ReducedModel, time: float, q: np.ndarray, v2: np.ndarray, dt: float) -> None:
        self._reduced, self.time, self.dt = reduced, time + dt, dt
        self.start: StateEvaluation = reduced.at(q, v2, t=time)
        self.end: StateEvaluation = self.start
        if dt:
            ahead = pin.integrate(reduced.robot.model, self.start.q, dt * self.start.v)
            self.end = reduced.at(ahead, v2, t=self.time)

    def along_reducing_outputs(self) -> StateEvaluation:
        """Return the end, evaluated with each column of R as velocity; one leading axis (r,).

        Rates of this evaluation are derivatives along single reducing outputs.
        """
        columns = self.end.R.T
        q = np.broadcast_to(self.end.q, (len(columns), len(self.end.q)))
        return self._reduced.at(q, v=columns, t=self.time)
