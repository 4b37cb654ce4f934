"""State to draw at one time, from a live run or from a finished one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.printing import printed
from rnc_pin.robots.robot import Robot
from rnc_pin.simulation import OutputNames, Sample, Trajectory

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


def output_error(outputs: OutputNames, state: DrawnState, kind: str) -> np.ndarray:
    """Desired minus actual values of the outputs "x1" or "x2" at a state."""
    return outputs.of(kind).coordinates.difference(getattr(state, f"{kind}_desired"), getattr(state, kind))


def tracked_frames(outputs: OutputNames, goals: Sequence[str], robot: Robot) -> dict[str, dict[int, tuple[str, int]]]:
    """Frames with position goals: for each axis (0, 1, 2), kind and column of the output."""
    frames: dict[str, dict[int, tuple[str, int]]] = {}
    for name in goals:
        frame, _, axis = name.rpartition("_")
        found = outputs.find(name)
        if axis in ("x", "y", "z") and robot.model.existFrame(frame) and found is not None:
            frames.setdefault(frame, {})["xyz".index(axis)] = found
    return frames


def sample_configurations(robot: Robot, trajectory: Trajectory, rate: float = RATE) -> np.ndarray:
    """Configurations (frames, nq) at a constant rate, interpolated on the manifold."""
    return _configurations(robot, trajectory, _even_times(trajectory, rate))


def recorded_states(
    robot: Robot, trajectory: Trajectory, rate: float = RATE, others: Sequence[Trajectory] = ()
) -> Iterator[DrawnState]:
    """States at a constant rate. Other runs that end earlier keep their last configuration."""
    times = _even_times(trajectory, rate)
    configurations = sample_configurations(robot, trajectory, rate)
    beside = [_configurations(robot, other, times) for other in others]
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


def live_state(reduced: ReducedModel, sample: Sample) -> DrawnState:
    """State at a sample of a live run. Outputs that the measurement omits are computed; unknown inputs are NaN."""
    measurement, command = sample.measurement, sample.command
    q, v2 = measurement.q, measurement.v2
    state = reduced.at(q, v2, t=sample.time)
    if measurement.x2 is None:
        measurement = state.measure()  # without integrals: the values of quasi-velocity outputs are NaN
    known = np.isfinite(sample.T).all()

    def goal(name: str, size: int) -> np.ndarray:
        value = getattr(command, name)
        return np.full(size, np.nan) if value is None else np.asarray(value, dtype=float)

    return DrawnState(
        sample.time,
        q,
        v2,
        measurement.x1,
        measurement.x2,
        goal("x1_desired", reduced.vertical.size),
        goal("x2_desired", reduced.r),
        state.multipliers(sample.T) if known else np.full(reduced.m, np.nan),
        float(state.smallest_singular_value),
    )


def _even_times(trajectory: Trajectory, rate: float) -> np.ndarray:
    end = trajectory.time[-1]
    return np.arange(0.0, end + 0.5 / rate, 1.0 / rate).clip(max=end)


def _configurations(robot: Robot, trajectory: Trajectory, wanted: np.ndarray) -> np.ndarray:
    time = trajectory.time
    index = np.clip(np.searchsorted(time, wanted, side="right") - 1, 0, max(len(time) - 2, 0))
    frames = []
    for t, i in zip(wanted, index, strict=True):
        j = min(i + 1, len(time) - 1)
        fraction = 0.0 if time[j] <= time[i] else float((t - time[i]) / (time[j] - time[i]))
        frames.append(pin.interpolate(robot.model, trajectory.q[i], trajectory.q[j], min(fraction, 1.0)))
    return np.stack(frames)
