"""Subject of a view: a robot, and its reduced model if there is one."""

from __future__ import annotations

import copy
from dataclasses import dataclass, replace

from rnc_pin.collision import Obstacle
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.rows import ConstraintKind, GroundSurface
from rnc_pin.robots.robot import Robot
from rnc_pin.simulation import OutputNames, output_names
from rnc_pin.visualization.view import View


@dataclass(frozen=True)
class DrawnModel:
    """Robot to draw.

    Attributes:
        robot: robot whose bodies are drawn.
        reduced: reduced model with the constraints, outputs and null motion; None if only the robot is known.
        obstacles: bodies in the world.
        switching: constraints that act during a part of the run, whose forces are drawn.
    """

    robot: Robot
    reduced: ReducedModel | None = None
    obstacles: tuple[Obstacle, ...] = ()
    switching: tuple[ConstraintKind, ...] = ()

    @classmethod
    def of(cls, model: DrawnModel | ReducedModel | Robot) -> DrawnModel:
        """DrawnModel from a reduced model or from a robot, without obstacles."""
        if isinstance(model, DrawnModel):
            return model
        return cls(model.robot, model) if isinstance(model, ReducedModel) else cls(model)

    @property
    def outputs(self) -> OutputNames:
        """Names of the outputs; empty without a reduced model."""
        return OutputNames() if self.reduced is None else output_names(self.reduced)

    def with_own_model(self) -> DrawnModel:
        """Copy with its own reduced model: a model serves one thread at a time."""
        if self.reduced is None:
            return self
        reduced = copy.deepcopy(self.reduced)
        return replace(self, robot=reduced.robot, reduced=reduced)

    def ground_height(self, view: View) -> float | None:
        """Height of the grid [m]; None for no grid, and by default on other ground than z = 0."""
        if view.ground == "auto":
            return None if self._floats() or grounds_of(self.reduced) else 0.0
        return view.ground

    def _floats(self) -> bool:
        """True if the robot floats in space: free base, no gravity, and (in a reduced model) conserved momentum."""
        model = self.robot.model
        if model.joints[1].shortname() != "JointModelFreeFlyer" or model.gravity.linear.any():
            return False
        return self.reduced is None or any(name.startswith("momentum(") for name in self.reduced.constraints.names)


def grounds_of(reduced: ReducedModel | None) -> list[GroundSurface]:
    """Surfaces of all constraints of a system, each once."""
    found: list[GroundSurface] = []
    for place in () if reduced is None else reduced.all_constraints.places:
        if place.block.ground is not None and not any(place.block.ground is each for each in found):
            found.append(place.block.ground)
    return found
