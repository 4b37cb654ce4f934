"""Control of the reducing outputs alone; the vertical outputs are not controlled."""

from __future__ import annotations

import numpy as np

from rnc_pin.control.controller import DescribedMixin, VelocityTarget, check_size, goals_at
from rnc_pin.control.deviation import Feedback
from rnc_pin.model.measurement import Measurement
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.planning.references import Reference


class ReducingOutputController(DescribedMixin):
    """``v2d = x2d_dot + k2 (x2d - x2)``: every reducing output follows a reference of its own.

    The vertical outputs follow from the constraints. Reads from the measurement: ``x1, x2, v2``.

    Args:
        reduced: model that defines the outputs.
        reference: of x2.
        k2: [1/s]; a number or one for each output.
        monitored: indices in x1 and reference of vertical outputs, which follow without control; for the
            record only.

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> actuators = [rnc.FrameForce("sleigh", "x"), rnc.FrameTorque("sleigh", "z")]
        >>> system = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")], actuators)
        >>> reduced = system.reduce([rnc.FrameSpeed("sleigh"), rnc.FrameYaw("sleigh")])
        >>> controller = rnc.control.ReducingOutputController(reduced, rnc.planning.Hold([1.0, 0.0]), k2=2.0)
        >>> measurement = reduced.at(robot.configuration(), np.zeros(2)).measure(np.zeros(2))
        >>> target, state = controller.step(0.0, measurement, controller.initial_state(measurement))
        >>> target.v2  # k2 times the error
        array([2., 0.])
    """

    described = ("k2",)

    def __init__(
        self,
        reduced: ReducedModel,
        reference: Reference,
        k2: float | np.ndarray = 2.0,
        monitored: tuple[np.ndarray, Reference] | None = None,
    ) -> None:
        check_size(reference, reduced.r, "reducing")
        self.monitored = monitored
        self.reference, self.k2 = reference, k2
        self._feedback = Feedback(reduced.reducing.coordinates, k2)

    accepts_batches = True
    """All runs have one reference."""

    def initial_state(self, measurement: Measurement) -> None:
        """Return None: the controller has no state."""

    def step(self, t: float, measurement: Measurement, state: None = None) -> tuple[VelocityTarget, None]:
        desired = self.reference.at(t)
        x1 = None
        if self.monitored is not None:
            x1 = goals_at(self.monitored[1].at(t).position, self.monitored[0], measurement.x1.shape)
        v2, v2_dot = self._feedback(desired, measurement.x2, measurement.v2)
        x2 = desired.position
        if x2.shape != measurement.x2.shape:
            x2 = np.broadcast_to(x2, measurement.x2.shape)
        return VelocityTarget(v2=v2, v2_dot=v2_dot, x1=x1, x2=x2), None
