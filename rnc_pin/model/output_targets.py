"""Selected outputs and targets of them: values, errors and their Jacobians."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from rnc_pin.errors import ConfigurationError, InputError, nearest
from rnc_pin.model.kinematics import PositionKinematics
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.row_stack import OutputStack
from rnc_pin.model.rows import OutputKind, OutputRows

OutputTarget = str | OutputKind
"""Name of an output of the model, or an output object."""


class SelectedOutputs:
    """Selected outputs with their values, with leading batch axes.

    Args:
        chosen: stacks of outputs, and the chosen rows of each.

    Attributes:
        names, size: names and number of the rows.
    """

    def __init__(self, chosen: Sequence[tuple[OutputStack, np.ndarray]]) -> None:
        self._parts = [(stack, rows, stack.coordinates.choose(rows)) for stack, rows in chosen]
        self.names = tuple(stack.names[row] for stack, rows, _ in self._parts for row in rows)
        self.size = len(self.names)
        ends = np.cumsum([len(rows) for _, rows, _ in self._parts]).tolist()
        self._places = [slice(a, b) for a, b in zip([0, *ends], ends, strict=False)]

    def value(self, at: PositionKinematics) -> np.ndarray:
        """Values (..., k)."""
        return np.concatenate([stack.value(at)[..., rows] for stack, rows, _ in self._parts], axis=-1)

    def jacobian(self, at: PositionKinematics) -> np.ndarray:
        """Jacobian (..., k, nv); rows of rotations are angular velocities in world axes."""
        return np.concatenate([stack.jacobian(at)[..., rows, :] for stack, rows, _ in self._parts], axis=-2)

    def error(self, at: PositionKinematics, target: np.ndarray) -> np.ndarray:
        """Target minus value (..., k): angles within half a turn, rotations as vectors in world axes."""
        value = self.value(at)
        goal = target if target.shape == value.shape else np.broadcast_to(target, value.shape)
        parts = zip(self._parts, self._places, strict=True)
        found = [kinds.difference(goal[..., place], value[..., place]) for (*_, kinds), place in parts]
        return np.concatenate(found, axis=-1)

    def error_jacobian(self, at: PositionKinematics, error: np.ndarray) -> np.ndarray:
        """Derivative (..., k, nv) of ``-error`` along the tangent space at q."""
        J = self.jacobian(at)
        for (*_, kinds), place in zip(self._parts, self._places, strict=True):
            for first in kinds.rotations:
                triple = slice(place.start + first, place.start + first + 3)
                for state in np.ndindex(J.shape[:-2]):
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
    known: list[str] = []
    for each in (reduced.reducing, reduced.vertical):
        known += each.names
        for place in each.places:
            if output in place.of(np.array(place.block.names)) and isinstance(place.block, OutputRows):
                return OutputStack([place.block]), np.array([place.block.names.index(output)])
    raise ConfigurationError(f"no output '{output}'{nearest(output, known)}")


class OutputTargets:
    """Targets of several outputs as one error ``e(q)`` (k,) that has to vanish.

    Args:
        reduced: the model.
        targets: values [m or rad] by name of an output of the model, or by output object. A rotation is a rotation
            vector (3,) or a matrix (3, 3).

    Attributes:
        labels: name of each target.
        places: entries of each target in the error.

    Raises:
        ConfigurationError: unknown output, an output without a value, or one component of a rotation.
        InputError: a value has the wrong shape or is not finite.
    """

    def __init__(self, reduced: ReducedModel, targets: Mapping[OutputTarget, ArrayLike]) -> None:
        if not isinstance(targets, Mapping) or not targets:
            raise ConfigurationError("targets have to be a mapping from outputs to values, with at least one output")
        found = [_target(reduced, output, value) for output, value in targets.items()]
        self.labels = tuple(label for label, *_ in found)
        for label in self.labels:
            if self.labels.count(label) > 1:
                raise ConfigurationError(f"two targets for output '{label}'")
        self._outputs = SelectedOutputs([chosen for _, chosen, _ in found])
        self._values = np.concatenate([value for *_, value in found])
        ends = np.cumsum([len(value) for *_, value in found]).tolist()
        self.places = tuple(slice(a, b) for a, b in zip([0, *ends], ends, strict=False))

    def error(self, at: PositionKinematics) -> np.ndarray:
        """Error (k,): target minus value; rotations in world axes, angles within half a turn."""
        return self._outputs.error(at, self._values)

    def jacobian(self, at: PositionKinematics, error: np.ndarray) -> np.ndarray:
        """Jacobian (k, nv) of ``-error``."""
        return self._outputs.error_jacobian(at, error)

    def residuals(self, error: np.ndarray) -> dict[str, float]:
        """Length of the error of each target [m or rad]."""
        return {
            label: float(np.linalg.norm(error[place])) for label, place in zip(self.labels, self.places, strict=True)
        }


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
    try:
        array = np.array(value, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"target '{label}': expected {len(rows)} numbers, found {value!r}") from None
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
