"""Subject of a view: options, the robot with its reduced model, and its state at one time, live or recorded."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Literal, NamedTuple, get_args

import numpy as np
from annotated_types import Len
from numpy.typing import ArrayLike

from rnc_pin.collision import Obstacle
from rnc_pin.errors import place_of
from rnc_pin.model.coordinates import ConfigurationManifold
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.rows import ConstraintKind, GroundSurface
from rnc_pin.printing import printed
from rnc_pin.robots.robot import Robot
from rnc_pin.simulation import OutputNames, Sample, Trajectory, output_names

Layer = Literal[
    "path", "reference", "goal", "plan", "tracks", "constraint forces", "redundancy", "compared", "obstacles", "surface"
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
        redundancy: True draws how bodies move, as arrows, in each motion that leaves the primary outputs of the task
            alone. It is named by the reducing output that moves.
        hide: layers that are hidden at first; the legend and the controls of the viewer show them.
    """

    trail: Sequence[str] = ()
    camera: Point | None = None
    target: Point = (0.0, 0.0, 0.0)
    ground: float | Literal["auto"] | None = "auto"
    redundancy: bool = False
    hide: Sequence[Layer] = ()

    def __post_init__(self) -> None:
        # Here and not by the page: a wrong name would hide nothing, without a word.
        for layer in self.hide:
            place_of(layer, LAYERS, "view.hide: no layer")


@dataclass(frozen=True)
class DrawnModel:
    """Robot to draw.

    Attributes:
        robot: robot whose bodies are drawn.
        reduced: reduced model with the constraints and outputs; None if only the robot is known.
        obstacles: bodies in the world.
        switching: constraints that act during a part of the run, whose forces are drawn.
    """

    robot: Robot
    reduced: ReducedModel | None = None
    obstacles: tuple[Obstacle, ...] = ()
    switching: tuple[ConstraintKind, ...] = ()

    @classmethod
    def of(cls, model: DrawnModel | ReducedModel | Robot) -> DrawnModel:
        """DrawnModel from a reduced model or from a robot, without obstacles.

        Args:
            model: what a user gives for the subject of a view.
        """
        if isinstance(model, DrawnModel):
            return model
        return cls(model.robot, model) if isinstance(model, ReducedModel) else cls(model)

    @property
    def outputs(self) -> OutputNames:
        """Names of the outputs; empty without a reduced model."""
        return OutputNames() if self.reduced is None else output_names(self.reduced)

    def with_own_model(self) -> DrawnModel:
        """Copy with its own reduced model: a model serves one thread at a time."""
        if self.reduced is None:
            return self
        # Evaluations write into Pinocchio's data: the drawing thread must not use that of the loop.
        reduced = copy.deepcopy(self.reduced)
        return replace(self, robot=reduced.robot, reduced=reduced)

    def ground_height(self, view: View) -> float | None:
        """Height of the grid [m]; None for no grid, and by default on other ground than z = 0.

        Args:
            view: options of the view.
        """
        if view.ground == "auto":
            return None if self._floats() or grounds_of(self.reduced) else 0.0
        return view.ground

    def _floats(self) -> bool:
        """True if the robot floats in space: free base, no gravity, and (in a reduced model) conserved momentum."""
        model = self.robot.model
        # A grid below a satellite would look like ground.
        if model.joints[1].shortname() != "JointModelFreeFlyer" or model.gravity.linear.any():
            return False
        return self.reduced is None or any(name.startswith("momentum(") for name in self.reduced.constraints.names)


def grounds_of(reduced: ReducedModel | None) -> list[GroundSurface]:
    """Surfaces of all constraints of a system, each once.

    Args:
        reduced: reduced model; None without one.
    """
    found: list[GroundSurface] = []
    for place in () if reduced is None else reduced.all_constraints.places:
        if place.block.ground is not None and not any(place.block.ground is each for each in found):
            found.append(place.block.ground)
    return found


RATE = 25.0  # frames per second of a recording


@printed()
class DrawnState(NamedTuple):
    """State of a run at one time. Desired values are NaN for outputs without a goal."""

    time: float
    q: np.ndarray
    v2: np.ndarray
    x1: np.ndarray
    x2: np.ndarray
    x1_desired: np.ndarray
    x2_desired: np.ndarray
    multipliers: np.ndarray
    margin: float
    others: tuple[np.ndarray, ...] = ()
    """Configurations (nq,) of the compared runs."""

    def desired(self, kind: str) -> np.ndarray:
        """Desired values of the outputs "x1" or "x2".

        Args:
            kind: "x1" or "x2".
        """
        return self.x1_desired if kind == "x1" else self.x2_desired


def output_error(outputs: OutputNames, state: DrawnState, kind: str) -> np.ndarray:
    """Desired minus actual values of the outputs "x1" or "x2" at a state.

    Args:
        outputs: names of the outputs.
        state: the state.
        kind: "x1" or "x2".
    """
    return outputs.of(kind).coordinates.difference(state.desired(kind), state.x1 if kind == "x1" else state.x2)


def tracked_frames(outputs: OutputNames, goals: Sequence[str], robot: Robot) -> dict[str, dict[int, tuple[str, int]]]:
    """Frames with position goals: for each axis (0, 1, 2), kind and column of the output.

    Args:
        outputs: names of the outputs.
        goals: outputs that have goals.
        robot: the robot that has the frames.
    """
    frames: dict[str, dict[int, tuple[str, int]]] = {}
    for name in goals:
        # Outputs are found by their names: a run from a file has nothing else.
        frame, _, axis = name.rpartition("_")
        found = outputs.find(name)
        if axis in ("x", "y", "z") and robot.model.existFrame(frame) and found is not None:
            frames.setdefault(frame, {})["xyz".index(axis)] = found
    return frames


def recorded_states(
    robot: Robot, trajectory: Trajectory, rate: float = RATE, others: Sequence[Trajectory] = ()
) -> Iterator[DrawnState]:
    """States at a constant rate. Other runs that end earlier keep their last configuration.

    Args:
        robot: robot of all runs.
        trajectory: run to show.
        rate: states per second.
        others: compared runs.
    """
    times = even_times(trajectory.time[-1], rate)
    configurations = _configurations(robot, trajectory, times)
    beside = [_configurations(robot, other, times) for other in others]
    # Configurations are interpolated on their manifold; other values come from the next sample.
    nearest = np.searchsorted(trajectory.time, times).clip(max=len(trajectory.time) - 1)
    t = trajectory
    for frame, i in enumerate(nearest):
        yield DrawnState(
            float(times[frame]),
            configurations[frame],
            *(t.v2[i], t.x1[i], t.x2[i], t.x1_desired[i], t.x2_desired[i], t.multipliers[i]),
            float(t.singular_value[i]),
            tuple(each[frame] for each in beside),
        )


def live_state(model: DrawnModel, sample: Sample) -> DrawnState:
    """State at a sample of a live run. Outputs that the measurement omits are computed; unknown inputs are NaN.

    Args:
        model: drawn model, used by the calling thread alone.
        sample: sample of the run.
    """
    measurement, command, reduced = sample.measurement, sample.command, model.reduced
    q, v2 = measurement.q, measurement.v2
    if reduced is None:  # only the configuration is known: nothing is drawn but the robot
        none = np.empty(0)
        return DrawnState(sample.time, q, none, none, none, none, none, none, float("nan"))
    state = reduced.at(q, v2, t=sample.time)
    # Controllers of some kinds need no outputs, and their loops then measure none.
    if measurement.x2 is None:
        measurement = state.measure()  # without integrals: the values of quasi-velocity outputs are NaN
    # Servos tell no forces: multipliers are unknown then, and no arrows are drawn.
    known = np.isfinite(sample.T).all()

    def goal(value: ArrayLike | None, size: int) -> np.ndarray:
        return np.full(size, np.nan) if value is None else np.asarray(value, dtype=float)

    return DrawnState(
        sample.time,
        q,
        v2,
        measurement.x1,
        measurement.x2,
        goal(command.x1_desired, reduced.vertical.size),
        goal(command.x2_desired, reduced.r),
        state.multipliers(sample.T) if known else np.full(reduced.m, np.nan),
        float(state.smallest_singular_value),
    )


def even_times(end: float, rate: float) -> np.ndarray:
    """Times of pictures at a rate [1/s], from zero to the end [s].

    Args:
        end: end of the run [s].
        rate: pictures per second.
    """
    # Half a picture more: the last one is at the end, whatever the rounding of the steps.
    return np.arange(0.0, end + 0.5 / rate, 1.0 / rate).clip(max=end)


def _configurations(robot: Robot, trajectory: Trajectory, wanted: np.ndarray) -> np.ndarray:
    """Configurations (M, nq) at times (M,), and the last one after the end."""
    time, q = trajectory.time, trajectory.q
    places = np.interp(wanted, time, np.arange(len(time)))
    before = places.astype(int)
    after = np.minimum(before + 1, len(time) - 1)
    return ConfigurationManifold(robot.model).interpolate(q[before], q[after], places - before)
