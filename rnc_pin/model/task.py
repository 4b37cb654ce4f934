"""Choice of outputs by name: targets of them, and their division for a task, paper section 2 and (11)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from rnc_pin.errors import ConfigurationError, InputError, check_unique, nearest, place_of
from rnc_pin.model.coordinates import Coordinates
from rnc_pin.model.input_validation import numbers_of
from rnc_pin.model.kinematics import PositionKinematics
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.rows import OutputKind, OutputRows, OutputStack
from rnc_pin.printing import ReprMixin

OutputTarget = str | OutputKind
"""Name of an output of the model, or an output object."""


class SelectedOutputs:
    """Selected outputs with their values, with leading batch axes.

    Args:
        chosen: stacks of outputs, and the chosen rows of each.

    Attributes:
        names, size: names and number of the rows.
        places: entries of each stack in values.
    """

    def __init__(self, chosen: Sequence[tuple[OutputStack, np.ndarray]]) -> None:
        self._chosen, self.names = chosen, tuple(stack.names[row] for stack, rows in chosen for row in rows)
        self.size = len(self.names)
        ends = np.cumsum([0, *(len(rows) for _, rows in chosen)]).tolist()
        self.places = tuple(slice(*each) for each in pairwise(ends))
        coordinates = [stack.coordinates.choose(rows) for stack, rows in chosen]
        self._kinds = list(zip(coordinates, self.places, strict=True))

    def value(self, at: PositionKinematics) -> np.ndarray:
        """Values (..., k).

        Args:
            at: kinematics at configurations (..., nq).
        """
        return np.concatenate([stack.value(at)[..., rows] for stack, rows in self._chosen], axis=-1)

    def jacobian(self, at: PositionKinematics) -> np.ndarray:
        """Jacobian (..., k, nv); rows of rotations are angular velocities in world axes.

        Args:
            at: kinematics at configurations (..., nq).
        """
        return np.concatenate([stack.jacobian(at)[..., rows, :] for stack, rows in self._chosen], axis=-2)

    def error(self, at: PositionKinematics, target: np.ndarray) -> np.ndarray:
        """Target minus value (..., k): angles within half a turn, rotations as vectors in world axes.

        Args:
            at: kinematics at configurations (..., nq).
            target: targets (k,) or (..., k) [rad or m].
        """
        value = self.value(at)
        goal = target if target.shape == value.shape else np.broadcast_to(target, value.shape)
        found = [kinds.difference(goal[..., place], value[..., place]) for kinds, place in self._kinds]
        return np.concatenate(found, axis=-1)

    def error_jacobian(self, at: PositionKinematics, error: np.ndarray) -> np.ndarray:
        """Derivative (..., k, nv) of ``-error`` along the tangent space at q.

        Args:
            at: kinematics at configurations (..., nq).
            error: the error (..., k) [rad or m].
        """
        J = self.jacobian(at)
        for kinds, place in self._kinds:
            for first in kinds.rotations:
                triple = slice(place.start + first, place.start + first + 3)
                for state in np.ndindex(J.shape[:-2]):
                    # The logarithm of a rotation does not change at its angular velocity, but by Jlog times it.
                    J[(*state, triple)] = pin.Jlog3(pin.exp3(error[(*state, triple)])) @ J[(*state, triple)]
        return J


def find_output(reduced: ReducedModel, output: object, what: str) -> tuple[OutputStack, np.ndarray]:
    """Return the outputs of a target, and the chosen rows of them.

    Args:
        reduced: the model.
        output: an output object, or the name of an output of the model.
        what: beginning of the message for other objects.

    Raises:
        ConfigurationError: there is no such output.
    """
    if not isinstance(output, str):
        if not isinstance(output, OutputKind):
            raise ConfigurationError(f"{what} the name of an output or an output object, found {output!r}")
        stack = OutputStack([output.bind(reduced.robot)])
        return stack, np.arange(stack.size)
    for each in (reduced.reducing, reduced.vertical):
        for place in each.places:
            if output in place.of(np.array(place.block.names)) and isinstance(place.block, OutputRows):
                # The whole block, of which one row is chosen: a rotation needs its three entries for a difference.
                return OutputStack([place.block]), np.array([place.block.names.index(output)])
    known = *reduced.reducing.names, *reduced.vertical.names
    raise ConfigurationError(f"no output '{output}'{nearest(output, known)}")


class OutputTargets(SelectedOutputs):
    """Targets of several outputs as one error ``e(q)`` (k,) that has to vanish.

    Args:
        reduced: the model.
        targets: values [m or rad] by name of an output of the model, or by output object. A rotation is a rotation
            vector (3,) or a matrix (3, 3).

    Attributes:
        labels: name of each target; ``places``: its entries in the error.
        goal: values of all targets (k,).

    Raises:
        ConfigurationError: unknown output, an output without a value, or one component of a rotation.
        InputError: a value has the wrong shape or is not finite.
    """

    def __init__(self, reduced: ReducedModel, targets: Mapping[OutputTarget, ArrayLike]) -> None:
        if not isinstance(targets, Mapping) or not targets:
            raise ConfigurationError("targets have to be a mapping from outputs to values, with at least one output")
        found = [_target(reduced, output, value) for output, value in targets.items()]
        self.labels = tuple(label for label, *_ in found)
        # Two goals of one output contradict each other, and the nearest point to both meets neither.
        check_unique(self.labels, "two targets for output")
        super().__init__([chosen for _, chosen, _ in found])
        self.goal = np.concatenate([value for *_, value in found])

    def residuals(self, at: PositionKinematics) -> dict[str, float]:
        """Length of the error of each target [m or rad].

        Args:
            at: kinematics at one configuration (nq,).
        """
        error, places = self.error(at, self.goal), zip(self.labels, self.places, strict=True)
        return {label: float(np.linalg.norm(error[place])) for label, place in places}


def _target(
    reduced: ReducedModel, output: object, value: object
) -> tuple[str, tuple[OutputStack, np.ndarray], np.ndarray]:
    """Label, outputs and value of a target."""
    stack, rows = find_output(reduced, output, "a target needs")
    label, rotation = _common([stack.names[row] for row in rows]), bool(stack.coordinates.rotations)
    if stack.quasi[rows].any():
        raise ConfigurationError(f"target '{label}': a speed has no value that a configuration could reach")
    if rotation and len(rows) != 3:
        raise ConfigurationError(
            f"target '{label}': one component of a rotation is no target; use the output object, FrameOrientation(...)"
        )
    array = numbers_of(value, f"target '{label}'")
    # A matrix is read as such: its rotation vector has three numbers, as the output has.
    if rotation and array.shape == (3, 3):
        if not np.allclose(array @ array.T, np.eye(3), atol=1e-6) or np.linalg.det(array) < 0:
            raise InputError(f"target '{label}': the matrix is not a rotation")
        array = pin.log3(array)
    array = np.atleast_1d(array)
    if array.shape != (len(rows),):
        raise InputError(f"target '{label}' has shape {array.shape}, expected ({len(rows)},)")
    if not np.isfinite(array).all():
        raise InputError(f"target '{label}' is not finite: {array.tolist()}")
    return label, (stack, rows), array


def _common(names: Sequence[str]) -> str:
    """Return the name of an output with several rows: ``tip`` for ``tip_x`` and ``tip_y``."""
    if len(names) == 1:
        return names[0]
    stems = {name.rpartition("_")[0] for name in names}
    return stems.pop() if len(stems) == 1 and "" not in stems else ", ".join(names)


# ------------------------------------------------------------------ tasks


@dataclass(frozen=True, repr=False)
class Task(ReprMixin):
    """Division of the reducing outputs into primary ones (x21), which the task prescribes, and redundant ones (x22).

    Together they are all reducing outputs of the model. Construct a task with ``Task.of``.

    Attributes:
        primary, redundant: indices of x21 and x22 among the reducing outputs.
        vertical: indices of the task's x1 among the vertical outputs.
        primary_names, redundant_names, vertical_names: names of these outputs.
        primary_coordinates, redundant_coordinates, vertical_coordinates: coordinate types of these outputs.
        r: number of reducing outputs.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")], robot.joint_names[1:])
        >>> x2 = [rnc.FramePosition("tip", "xy"), rnc.JointPosition("joint_1")]
        >>> reduced = system.reduce(reducing=x2, vertical=[rnc.JointPosition("platform")])
        >>> rnc.Task.of(reduced, primary=["tip_x", "tip_y"], redundant=["joint_1"])
        Task(primary=[tip_x, tip_y], redundant=[joint_1], vertical=[platform])
    """

    primary: np.ndarray
    redundant: np.ndarray
    vertical: np.ndarray
    primary_names: tuple[str, ...]
    redundant_names: tuple[str, ...]
    vertical_names: tuple[str, ...]
    primary_coordinates: Coordinates
    redundant_coordinates: Coordinates
    vertical_coordinates: Coordinates
    r: int

    @classmethod
    def of(
        cls,
        reduced: ReducedModel,
        primary: Sequence[str],
        redundant: Sequence[str],
        vertical: Sequence[str] | None = None,
    ) -> Task:
        """Construct a task from names of outputs.

        Args:
            reduced: the reduced model that has the outputs.
            primary: names of x21.
            redundant: names of x22.
            vertical: names of the task's vertical outputs; all by default.

        Raises:
            ConfigurationError: unknown name, duplicate name, missing reducing output, or an orientation whose three
                components are not together.
        """
        x2, x1 = reduced.reducing, reduced.vertical
        chosen = x1.names if vertical is None else tuple(vertical)
        columns = {name: place_of(name, x2.names, "no reducing output") for name in (*primary, *redundant)}
        # A mapping keeps a name once: fewer entries than names tell that one is there twice.
        if len(columns) < len(primary) + len(redundant):
            raise ConfigurationError("duplicate output in primary and redundant")
        # Each reducing output belongs to one part: what is left out would move at will.
        left = [name for name in x2.names if name not in columns]
        if left:
            raise ConfigurationError(f"reducing output '{left[0]}' is neither primary nor redundant")
        first = np.array([columns[name] for name in primary], dtype=int)
        second = np.array([columns[name] for name in redundant], dtype=int)
        rows = np.array([place_of(name, x1.names, "no vertical output") for name in chosen], dtype=int)
        names = tuple(primary), tuple(redundant), chosen
        coordinates = x2.coordinates.choose(first), x2.coordinates.choose(second), x1.coordinates.choose(rows)
        return cls(first, second, rows, *names, *coordinates, reduced.r)

    def _settings(self) -> Mapping[str, object]:
        return {"primary": self.primary_names, "redundant": self.redundant_names, "vertical": self.vertical_names}
