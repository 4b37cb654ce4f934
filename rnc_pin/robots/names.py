"""Links and joints of one name: Pinocchio's functions that make a model of others look frames up by name alone."""

from __future__ import annotations

from collections import Counter

import pinocchio as pin


class ToldApart:
    """A copy of models in which no two frames share a name, joints' frames keeping theirs.

    Args:
        models: each with unique names of joints.

    Attributes:
        models: the copies.
    """

    def __init__(self, *models: pin.Model) -> None:
        self.models = tuple(model.copy() for model in models)
        self._names: dict[str, str] = {}
        for model in self.models:
            names = [frame.name for frame in model.frames]
            counts = Counter(names)
            for index, frame in enumerate(model.frames):
                if counts[names[index]] > 1 and index and frame.type != pin.FrameType.JOINT:
                    frame.name = f"{names[index]} (frame {index})"
                    self._names[frame.name] = names[index]

    def restore(self, model: pin.Model) -> None:
        """Give the frames of a model that was made of the copies their names again."""
        for frame in model.frames:
            frame.name = self._names.get(frame.name, frame.name)
