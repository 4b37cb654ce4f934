"""Models made from others, with their geometry: joints locked, a robot attached to a frame, other link masses.

Pinocchio adds the inertias of links that are fixed to each other. It stores the inertia of each fixed link in its
frame. The rest of the sum is the inertia of the link that the joint itself moves. The ten dynamic parameters of bodies
about one point are additive, so a link is replaced by adding the difference.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import pinocchio as pin

from rnc_pin.errors import ModelError, argument, nearest
from rnc_pin.robots.joint_values import JointValue, NamedModel


class LazyGeometry:
    """Visual and collision geometry of a model.

    Meshes are slow to load, and a run without pictures needs none. A pickle or copy omits geometry that can be loaded
    again, because meshes are large.

    Args:
        load: function that loads the geometry of a kind, "visual" or "collision"; None if there is none to load.
        visual: visual geometry, if it is there already.
        collision: collision geometry, if it is there already.
    """

    def __init__(
        self,
        load: Callable[[str], pin.GeometryModel] | None = None,
        visual: pin.GeometryModel | None = None,
        collision: pin.GeometryModel | None = None,
    ) -> None:
        self._load = load
        self._models = {"visual": visual, "collision": collision}

    def get(self, kind: str) -> pin.GeometryModel | None:
        """Geometry of a kind, or None.

        Args:
            kind: "visual" or "collision".
        """
        if self._models[kind] is None and self._load is not None:
            self._models[kind] = self._load(kind)
        return self._models[kind]

    def __getstate__(self) -> dict[str, object]:
        """Return the state for pickle and copy."""
        state = dict(self.__dict__)
        if self._load is not None:
            # Geometry without a loader cannot be made again: it stays in the pickle.
            state["_models"] = dict.fromkeys(self._models)
        return state


class LockedModel:
    """Reduced model without the locked joints, with its geometry.

    Args:
        model: the full model; it is not changed.
        lock: joint name to value of each locked joint [rad or m].
    """

    def __init__(self, model: pin.Model, lock: Mapping[str, JointValue]) -> None:
        self._full, named = model, NamedModel(model)
        self._joints = [named.joint_id(name) for name in lock]
        if "root_joint" in lock and model.joints[named.joint_id("root_joint")].nv > 1:
            raise ModelError(f"'root_joint' cannot be locked: load the robot with {argument('base', 'fixed')} instead")
        self._reference = named.configuration(lock)
        self.model = self._reduced(None)[0]

    def geometry(self, load: Callable[[str], pin.GeometryModel], kind: str) -> pin.GeometryModel:
        """Geometry of a kind, loaded by ``load`` for the full model and attached to the reduced model.

        Args:
            load: function that loads the geometry of a kind for the full model.
            kind: "visual" or "collision".
        """
        return self._reduced(load(kind))[1]

    def _reduced(self, geometry: pin.GeometryModel | None) -> tuple[pin.Model, pin.GeometryModel | None]:
        # Pinocchio reduces model and geometry in one call, so the model is reduced again for each kind of geometry.
        unique = _UniqueFrameNames(self._full)
        (full,) = unique.models
        if geometry is None:
            model, reduced = pin.buildReducedModel(full, self._joints, self._reference), None
        else:
            model, reduced = pin.buildReducedModel(full, geometry, self._joints, self._reference)
        unique.restore(model)
        return model, reduced


class AttachedModel:
    """Two models joined into one, with their geometry. Gravity is the carrier's.

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
        """Geometry of a kind of both models, attached to the joined model.

        Args:
            carrier: geometry of the carrier.
            other: geometry of the attached robot.
            kind: "visual" or "collision".
        """
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
            # Pinocchio refuses a lower limit above the upper one, which nothing else reads.
            model.lowerVelocityLimit = np.minimum(model.lowerVelocityLimit, model.upperVelocityLimit)
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


# ---------------------------------------------------------------------- other link masses


LinkMass: TypeAlias = "float | pin.Inertia"
_ROUNDING = 1e-12  # rounding error, relative to a body's mass


@dataclass(frozen=True)
class _Link:
    """Indices of the frames that store a link's inertia.

    Attributes:
        frame: index of the link's frame.
        keeper: index of the frame that stores the inertia of this link alone; None for the link that a joint moves.
        group: index of the frame of the joint that moves the link, or moved it before the joint was locked.
    """

    frame: int
    keeper: int | None
    group: int


def with_link_masses(
    model: pin.Model, masses: Mapping[str, LinkMass], locked: Collection[str], robot: str
) -> pin.Model:
    """Return a copy of a model with other link masses.

    Args:
        model: not changed.
        masses: link to mass [kg], or to its inertia in the link frame.
        locked: names of locked joints; their frames store the inertia of all links that they moved.
        robot: name, for messages.

    Raises:
        ModelError: unknown link, a link without a mass to scale, or a mass that is not positive.
    """
    changed = model.copy()
    links = _links(model, locked)
    for name, mass in masses.items():
        if name not in links:
            raise ModelError(f"no link '{name}' in robot '{robot}'{nearest(str(name), links)}")
        link = links[name]
        # From the changed model: several links can be parts of one body.
        old = _own(changed, link, locked)
        _exchange(changed, link, _new(name, mass, old, robot), old)
    return changed


def _links(model: pin.Model, locked: Collection[str]) -> dict[str, _Link]:
    frames, found, moved = model.frames, {}, set()
    for index, frame in enumerate(frames):
        if frame.type != pin.FrameType.BODY:
            continue
        # Pinocchio's own rule: the frame of a fixed joint stores the inertia of its child, and a joint's model stores
        # the sum.
        group, parent = _group(model, index, locked), frame.parentFrame
        if _weighs(frame):
            found[frame.name] = _Link(index, index, group)
        elif _keeps_one(frames[parent], locked) and parent != group:
            found[frame.name] = _Link(index, parent, group)
        elif group not in moved:  # the first link of the group without a stored inertia
            moved.add(group)
            found[frame.name] = _Link(index, None, group)
        else:
            found[frame.name] = _Link(index, index, group)
    return found


def _group(model: pin.Model, index: int, locked: Collection[str]) -> int:
    """Index of the frame of the joint, locked or not, that moves a frame; 0 if none does."""
    while index and not _holds_all(model.frames[index], locked):
        index = model.frames[index].parentFrame
    return int(index)


def _holds_all(frame: pin.Frame, locked: Collection[str]) -> bool:
    return frame.type == pin.FrameType.JOINT or (frame.type == pin.FrameType.FIXED_JOINT and frame.name in locked)


def _keeps_one(frame: pin.Frame, locked: Collection[str]) -> bool:
    return frame.type == pin.FrameType.FIXED_JOINT and frame.name not in locked


def _weighs(frame: pin.Frame) -> bool:
    return bool(frame.inertia.mass or frame.inertia.inertia.any())


def _parameters(inertia: pin.Inertia, place: pin.SE3) -> np.ndarray:
    """Ten dynamic parameters of a body, about the origin of the joint that carries it."""
    return np.array(place.act(inertia).toDynamicParameters())


def _own(model: pin.Model, link: _Link, locked: Collection[str]) -> np.ndarray:
    """Dynamic parameters (10,) of a link alone, in the frame of the joint that carries it."""
    frame = model.frames[link.frame]
    if link.keeper is not None:
        keeper = model.frames[link.keeper]
        return _parameters(keeper.inertia, keeper.placement)
    group = model.frames[link.group]
    at_joint = group.type == pin.FrameType.JOINT or not link.group
    whole = model.inertias[frame.parentJoint].toDynamicParameters() if at_joint else None
    # The link that the joint moves has no record of its own: subtract what the other frames recorded from the whole.
    own = np.array(whole) if whole is not None else _parameters(group.inertia, group.placement)
    for index, other in enumerate(model.frames):
        if other.parentJoint != frame.parentJoint or not _weighs(other) or index == link.group:
            continue
        inside = _group(model, index, locked) == link.group
        whole_group = at_joint and _holds_all(other, locked)  # a locked joint stores all that it moved
        if inside or whole_group:
            own -= _parameters(other.inertia, other.placement)
    return own


def _new(name: str, mass: object, old: np.ndarray, robot: str) -> np.ndarray | pin.Inertia:
    if isinstance(mass, pin.Inertia):
        if not (mass.mass > 0 and np.isfinite(mass.toDynamicParameters()).all()):
            raise ModelError(f"inertia for link '{name}' has to have a positive mass and finite entries, found {mass}")
        return mass
    if isinstance(mass, bool) or not isinstance(mass, int | float | np.integer | np.floating) or not 0 < mass < np.inf:
        raise ModelError(f"mass of link '{name}' has to be positive [kg], or a pinocchio.Inertia, found {mass!r}")
    if not old[0] > _ROUNDING:
        raise ModelError(
            f"link '{name}' of robot '{robot}' has no mass of its own that could be scaled: give a pinocchio.Inertia"
        )
    # Same density distribution: the first moment and the inertia scale with the mass.
    return old * (float(mass) / old[0])


def _exchange(model: pin.Model, link: _Link, new: np.ndarray | pin.Inertia, old: np.ndarray) -> None:
    frame = model.frames[link.frame]
    parameters = new if isinstance(new, np.ndarray) else _parameters(new, frame.placement)
    joint, difference = frame.parentJoint, parameters - old
    whole = np.array(model.inertias[joint].toDynamicParameters())
    # A single link is scaled exactly, without the rounding errors of a sum and a difference.
    alone = np.abs(whole - old).max() <= _ROUNDING * np.abs(whole).max()
    model.inertias[joint] = pin.Inertia.FromDynamicParameters(parameters if alone else whole + difference)
    # The records have to follow the sum, or the next change of a mass would start from the old ones.
    keepers = [index for index in (link.keeper, link.group) if index is not None and _weighs(model.frames[index])]
    for index in dict.fromkeys(keepers):
        kept = model.frames[index]
        changed = _parameters(kept.inertia, kept.placement) + difference
        kept.inertia = kept.placement.actInv(pin.Inertia.FromDynamicParameters(changed))
