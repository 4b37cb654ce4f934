"""Subject of a view: a robot, and its reduced model if there is one."""

from __future__ import annotations

import copy
from dataclasses import dataclass

from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.robots.robot import Robot
from rnc_pin.simulation import OutputNames, output_names


@dataclass(frozen=True)
class Subject:
    """Robot to draw.

    Attributes:
        robot: robot whose bodies are drawn.
        reduced: reduced model with the constraints, outputs and null motion; None if only the robot is known.
    """

    robot: Robot
    reduced: ReducedModel | None = None

    @classmethod
    def of(cls, model: ReducedModel | Robot) -> Subject:
        """Subject from a reduced model or from a robot."""
        return cls(model.robot, model) if isinstance(model, ReducedModel) else cls(model)

    @property
    def outputs(self) -> OutputNames:
        """Names of the outputs; empty without a reduced model."""
        return OutputNames() if self.reduced is None else output_names(self.reduced)

    def with_own_model(self) -> Subject:
        """Copy with its own reduced model: a model serves one thread at a time."""
        return self if self.reduced is None else Subject.of(copy.deepcopy(self.reduced))
