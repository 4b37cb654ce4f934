"""View options: one declaration for pages, live views and scenario files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal, get_args

from annotated_types import Len

from rnc_pin.errors import ConfigurationError, nearest

Layer = Literal[
    "path", "reference", "goal", "plan", "tracks", "constraint directions", "constraint forces", "null motion",
    "margin", "compared", "obstacles", "surface",
]  # fmt: skip
LAYERS: tuple[Layer, ...] = get_args(Layer)
Point = Annotated[Sequence[float], Len(3, 3)]


@dataclass(frozen=True)
class View:
    """View options of a run, for any robot.

    Attributes:
        trail: frames whose paths are drawn; by default the frames that have goals.
        camera: position of the camera in the world [m]; by default the whole motion is in the picture.
        target: point that the camera looks at [m].
        ground: height of the grid and of the wheel tracks [m]; None draws neither. "auto" is 0, or None if the robot
            floats in space.
        hide: layers that are hidden at first; the legend and the controls of the viewer show them.
    """

    trail: Sequence[str] = ()
    camera: Point | None = None
    target: Point = (0.0, 0.0, 0.0)
    ground: float | Literal["auto"] | None = "auto"
    hide: Sequence[Layer] = ("constraint directions", "null motion")

    def __post_init__(self) -> None:
        for layer in self.hide:
            if layer not in LAYERS:
                raise ConfigurationError(f"view.hide: no layer '{layer}'{nearest(layer, LAYERS)}")
