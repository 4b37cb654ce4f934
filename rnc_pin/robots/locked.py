"""Model in which joints are locked."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import pinocchio as pin

from rnc_pin.errors import ModelError
from rnc_pin.robots.joint_values import JointValue, configuration, joint_index
from rnc_pin.robots.names import ToldApart


class Locked:
    """Reduced model without the locked joints, with its geometry."""

    def __init__(self, model: pin.Model, lock: Mapping[str, JointValue]) -> None:
        self._full = model
        self._joints = [joint_index(model, name) for name in lock]
        if "root_joint" in lock and model.joints[joint_index(model, "root_joint")].nv > 1:
            raise ModelError("'root_joint' cannot be locked: load the robot with base='fixed' instead")
        self._reference = configuration(model, lock)
        self.model = self._reduced(None)[0]

    def geometry(self, load: Callable[[str], pin.GeometryModel], kind: str) -> pin.GeometryModel:
        """Geometry of a kind, loaded by ``load`` for the full model and attached to the reduced model."""
        return self._reduced(load(kind))[1]

    def _reduced(self, geometry: pin.GeometryModel | None) -> tuple[pin.Model, pin.GeometryModel | None]:
        apart = ToldApart(self._full)
        (full,) = apart.models
        if geometry is None:
            model, reduced = pin.buildReducedModel(full, self._joints, self._reference), None
        else:
            model, reduced = pin.buildReducedModel(full, geometry, self._joints, self._reference)
        apart.restore(model)
        return model, reduced
