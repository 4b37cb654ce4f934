"""Models built from others by Pinocchio, with their geometry: joints locked, or a model attached to a frame."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping

import pinocchio as pin

from rnc_pin.errors import ModelError, argument
from rnc_pin.robots.joint_values import JointValue, configuration, joint_index
from rnc_pin.robots.lazy_geometry import LazyGeometry


class LockedModel:
    """Reduced model without the locked joints, with its geometry."""

    def __init__(self, model: pin.Model, lock: Mapping[str, JointValue]) -> None:
        self._full = model
        self._joints = [joint_index(model, name) for name in lock]
        if "root_joint" in lock and model.joints[joint_index(model, "root_joint")].nv > 1:
            raise ModelError(f"'root_joint' cannot be locked: load the robot with {argument('base', 'fixed')} instead")
        self._reference = configuration(model, lock)
        self.model = self._reduced(None)[0]

    def geometry(self, load: Callable[[str], pin.GeometryModel], kind: str) -> pin.GeometryModel:
        """Geometry of a kind, loaded by ``load`` for the full model and attached to the reduced model."""
        return self._reduced(load(kind))[1]

    def _reduced(self, geometry: pin.GeometryModel | None) -> tuple[pin.Model, pin.GeometryModel | None]:
        unique = _UniqueFrameNames(self._full)
        (full,) = unique.models
        if geometry is None:
            model, reduced = pin.buildReducedModel(full, self._joints, self._reference), None
        else:
            model, reduced = pin.buildReducedModel(full, geometry, self._joints, self._reference)
        unique.restore(model)
        return model, reduced


class AttachedModel:
    """Two models joined into one, with their geometry. Gravity is that of the carrier.

    Args:
        carrier: model that carries the other.
        other: attached model.
        frame: index of the carrier's frame.
        placement: pose of the other model's base in that frame; None for identity.

    Raises:
        ModelError: both have a joint or frame of the same name.
    """

    def __init__(self, carrier: pin.Model, other: pin.Model, frame: int, placement: pin.SE3 | None) -> None:
        for what, first, second in (
            ("joint", list(carrier.names)[1:], list(other.names)[1:]),
            ("frame", [each.name for each in carrier.frames][1:], [each.name for each in other.frames][1:]),
        ):
            for name in second:
                if name in first:
                    raise ModelError(f"robots '{carrier.name}' and '{other.name}' both have a {what} '{name}'")
        self._frame, self._placement = frame, pin.SE3.Identity() if placement is None else placement
        self._unique = _UniqueFrameNames(carrier, other)
        self.model = pin.appendModel(*self._unique.models, frame, self._placement)
        self._unique.restore(self.model)
        self.model.name = f"{carrier.name} with {other.name}"
        self.model.gravity = carrier.gravity  # appendModel takes the gravity of the second

    def geometry(self, carrier: LazyGeometry, other: LazyGeometry, kind: str) -> pin.GeometryModel:
        """Geometry of a kind of both models, attached to the joined model."""
        shapes = [each.get(kind) or pin.GeometryModel() for each in (carrier, other)]
        return pin.appendModel(*self._unique.models, *shapes, self._frame, self._placement)[1]


class _UniqueFrameNames:
    """Copies of models with unique frame names, because these functions of Pinocchio find frames by name alone.

    Frames of joints keep their names.

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
