"""What is in the picture: a robot, with its reduced model where there is one."""

from __future__ import annotations

import copy
from dataclasses import dataclass

from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.robots.robot import Robot
from rnc_pin.simulation import OutputNames, output_names


@dataclass(frozen=True)
class Subject:
    """A robot to be drawn.

    Attributes:
        robot: whose bodies are drawn.
        reduced: knows its constraints, outputs and null motion; None where the robot is all there is.
    """

    robot: Robot
    reduced: ReducedModel | None = None

    @classmethod
    def of(cls, model: ReducedModel | Robot) -> Subject:
        """What callers give: either."""
        return cls(model.robot, model) if isinstance(model, ReducedModel) else cls(model)

    @property
    def outputs(self) -> OutputNames:
        """Names of the outputs; none without a model."""
        return OutputNames() if self.reduced is None else output_names(self.reduced)

    def for_another_thread(self) -> Subject:
        """The same with a model of its own: a model serves one thread at a time."""
        return self if self.reduced is None else Subject.of(copy.deepcopy(self.reduced))
