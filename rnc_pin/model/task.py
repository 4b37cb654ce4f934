"""Division of outputs into primary, redundant and vertical for a task: paper section 2 and (11)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rnc_pin.errors import ConfigurationError, nearest
from rnc_pin.model.coordinates import Coordinates
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.printing import ReprMixin


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
        columns = {name: _position(name, x2.names, "reducing") for name in (*primary, *redundant)}
        if len(columns) < len(primary) + len(redundant):
            raise ConfigurationError("duplicate output in primary and redundant")
        left = [name for name in x2.names if name not in columns]
        if left:
            raise ConfigurationError(f"reducing output '{left[0]}' is neither primary nor redundant")
        first = np.array([columns[name] for name in primary], dtype=int)
        second = np.array([columns[name] for name in redundant], dtype=int)
        rows = np.array([_position(name, x1.names, "vertical") for name in chosen], dtype=int)
        return cls(
            primary=first,
            redundant=second,
            vertical=rows,
            primary_names=tuple(primary),
            redundant_names=tuple(redundant),
            vertical_names=chosen,
            primary_coordinates=x2.coordinates.choose(first),
            redundant_coordinates=x2.coordinates.choose(second),
            vertical_coordinates=x1.coordinates.choose(rows),
            r=reduced.r,
        )

    def _settings(self) -> Mapping[str, object]:
        return {"primary": self.primary_names, "redundant": self.redundant_names, "vertical": self.vertical_names}


def _position(name: str, names: Sequence[str], what: str) -> int:
    if name not in names:
        raise ConfigurationError(f"no {what} output '{name}'{nearest(str(name), names)}")
    return list(names).index(name)
