"""Unique frame names for Pinocchio's functions that build a model from others, which find frames by name alone."""

from __future__ import annotations

from collections import Counter

import pinocchio as pin


class ToldApart:
    """Copies of models with unique frame names. Frames of joints keep their names.

    Args:
        models: models with unique joint names.

    Attributes:
        models: copies of the models.
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
        """Restore the original frame names in a model that was built from the copies."""
        for frame in model.frames:
            frame.name = self._names.get(frame.name, frame.name)
