"""Task: the centre of mass follows a reference."""

from __future__ import annotations

from dataclasses import dataclass

from rnc_pin.control.controller import check_size
from rnc_pin.control.whole_body.tasks.control_task import ControlTask
from rnc_pin.control.whole_body.tasks.output_task import BoundOutput
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.outputs import CenterOfMass
from rnc_pin.planning.references import Reference


@dataclass(frozen=True)
class CenterOfMassTask(ControlTask):
    """Centre of mass of the robot that follows a reference in the world.

    Args:
        reference: of the coordinates [m].
        axes: world axes, e.g. "xy" or "xyz".

    Example:
        >>> robot = rnc.Robot.from_urdf("mobile_manipulator.urdf", base="planar")
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("axle")]).reduce()
        >>> task = rnc.control.tasks.CenterOfMassTask(rnc.planning.Hold([1.5, 0.0]), axes="xy", gain=2.0)
        >>> sample = rnc.control.ControlSample(reduced, 0.0, robot.configuration(), np.zeros(reduced.r), dt=0.01)
        >>> rows = task.bind(reduced).rows(sample)
        >>> rows.rate.round(6) + 0.0  # the centre is at x = 1 m
        array([1., 0.])
    """

    reference: Reference
    axes: str = "xyz"

    def bind(self, reduced: ReducedModel) -> BoundOutput:
        check_size(self.reference, len(self.axes), "centre-of-mass")
        return BoundOutput(self, CenterOfMass(self.axes), self.reference, reduced)
