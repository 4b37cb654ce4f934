"""Targets of outputs for inverse kinematics: values, errors and their Jacobians."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from rnc_pin.errors import ConfigurationError, InputError, nearest
from rnc_pin.math.coordinates import Coordinates
from rnc_pin.model.kinematics import PositionKinematics
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.rows import OutputKind, OutputRows

OutputTarget = str | OutputKind
"""Name of an output of the model, or an output object."""


@dataclass(frozen=True)
class _Target:
    """Target of some rows of one output."""

    label: str
    block: OutputRows
    rows: list[int]
    value: np.ndarray
    coordinates: Coordinates


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
        self._targets = [_target(reduced, output, value) for output, value in targets.items()]
        self.labels = tuple(each.label for each in self._targets)
        for label in self.labels:
            if self.labels.count(label) > 1:
                raise ConfigurationError(f"two targets for output '{label}'")
        ends = np.cumsum([len(each.rows) for each in self._targets]).tolist()
        self.places = tuple(slice(a, b) for a, b in zip([0, *ends], ends, strict=False))
        self.size: int = ends[-1]

    def error(self, at: PositionKinematics) -> np.ndarray:
        """Error (k,): target minus value; rotations in world axes, angles within half a turn."""
        return np.concatenate(
            [each.coordinates.difference(each.value, each.block.value(at)[each.rows]) for each in self._targets]
        )

    def jacobian(self, at: PositionKinematics, error: np.ndarray) -> np.ndarray:
        """Jacobian (k, nv) of ``-error``."""
        blocks = []
        for each, place in zip(self._targets, self.places, strict=True):
            rows = each.block.jacobian(at)[each.rows]
            blocks.append(pin.Jlog3(pin.exp3(error[place])) @ rows if each.block.rotation else rows)
        return np.concatenate(blocks)

    def residuals(self, error: np.ndarray) -> dict[str, float]:
        """Length of the error of each target [m or rad]."""
        return {
            label: float(np.linalg.norm(error[place])) for label, place in zip(self.labels, self.places, strict=True)
        }


def _target(reduced: ReducedModel, output: object, value: object) -> _Target:
    block, rows, label = _rows(reduced, output)
    if block.quasi:
        raise ConfigurationError(f"target '{label}': a speed has no value that a configuration could reach")
    if block.rotation and len(rows) != 3:
        raise ConfigurationError(
            f"target '{label}': one component of a rotation is no target; use the output object, FrameOrientation(...)"
        )
    try:
        array = np.array(value, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"target '{label}': expected {len(rows)} numbers, found {value!r}") from None
    if block.rotation and array.shape == (3, 3):
        if not np.allclose(array @ array.T, np.eye(3), atol=1e-6) or np.linalg.det(array) < 0:
            raise InputError(f"target '{label}': the matrix is not a rotation")
        array = pin.log3(array)
    array = np.atleast_1d(array)
    if array.shape != (len(rows),):
        raise InputError(f"target '{label}' has shape {array.shape}, expected ({len(rows)},)")
    if not np.isfinite(array).all():
        raise InputError(f"target '{label}' is not finite: {array.tolist()}")
    angular = np.asarray(block.angular, dtype=bool)[rows]
    return _Target(label, block, rows, array, Coordinates(angular, (0,) if block.rotation else ()))


def _rows(reduced: ReducedModel, output: object) -> tuple[OutputRows, list[int], str]:
    """Return the block, its rows and the label of an output."""
    if not isinstance(output, str):
        if not isinstance(output, OutputKind):
            raise ConfigurationError(f"a target needs the name of an output or an output object, found {output!r}")
        block = output.bind(reduced.robot)
        return block, list(range(len(block.names))), _common(block.names)
    known: list[str] = []
    for stack in (reduced.reducing, reduced.vertical):
        for place in stack.places:
            names = place.of(np.array(place.block.names)).tolist()
            known += names
            if output in names and isinstance(place.block, OutputRows):
                return place.block, [place.block.names.index(output)], output
    raise ConfigurationError(f"no output '{output}'{nearest(output, known)}")


def _common(names: Sequence[str]) -> str:
    """Return the name of an output with several rows: ``tip`` for ``tip_x`` and ``tip_y``."""
    if len(names) == 1:
        return names[0]
    stems = {name.rpartition("_")[0] for name in names}
    return stems.pop() if len(stems) == 1 and "" not in stems else ", ".join(names)
