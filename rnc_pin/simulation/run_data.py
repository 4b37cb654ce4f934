"""Record of a run: its signals and metadata, and the file that holds them."""

from __future__ import annotations

import json
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import NamedTuple, Self

import numpy as np

from rnc_pin.array_shapes import Array, Float, Int
from rnc_pin.control.controller import LimitedAcceleration, MissedGoal
from rnc_pin.errors import ConfigurationError
from rnc_pin.io.json import Json
from rnc_pin.model.coordinates import Coordinates
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.simulation.run_info import Outcome, OutputNames, RunInfo
from rnc_pin.verdict import Verdict

TOP_VIEW = "top_view"
PLOTTED_QUANTITIES = (
    TOP_VIEW, "rates", "outputs", "errors", "inputs", "estimates", "prediction_error", "normal_forces", "margin",
)  # fmt: skip
"""Names that ``Trajectory.plot`` takes besides those of outputs; drawing them is in ``run_figure``."""


class Grounds(NamedTuple):
    """Grounds of the verdict about a run, besides its samples. They are in no file.

    Attributes:
        reduced: model of the run, with the limits of the robot's file and of actuators.
        accelerations: limits of accelerations that the controller keeps.
        missed: goals of the controller that the run has missed at its end.
    """

    reduced: ReducedModel
    accelerations: tuple[LimitedAcceleration, ...] = ()
    missed: tuple[MissedGoal, ...] = ()


@dataclass(frozen=True, repr=False)
class RunData:
    """Record of a run sampled at N times: what happened, and nothing that judges or draws it.

    ``derive`` makes it from samples, ``judge``, ``summarize``, ``plot_run`` and ``export_run`` are functions of it, and
    ``Trajectory`` has them as methods. It never changes.
    """

    time: Float[Array, " N"]
    """Time [s]."""
    q: Float[Array, "N nq"]
    """Configurations."""
    v: Float[Array, "N nv"]
    """Full velocities."""
    v2: Float[Array, "N r"]
    """Rates of the reducing outputs."""
    v2_desired: Float[Array, "N r"]
    """NaN where the controller had no goal."""
    x1: Float[Array, "N k"]
    """Vertical outputs; angles are continuous (unwrapped)."""
    v1: Float[Array, "N k"]
    """Rates of the vertical outputs, ``J1 v``."""
    x1_desired: Float[Array, "N k"]
    """NaN where the controller had no goal."""
    x2: Float[Array, "N r"]
    """Reducing outputs; integrals of v2 for quasi-velocities. Angles are continuous (unwrapped)."""
    x2_desired: Float[Array, "N r"]
    """Desired reducing outputs; the integral of the desired rate if there is only a rate."""
    F: Float[Array, "N r"]
    """Applied reduced force."""
    T: Float[Array, "N p"]
    """Actuator inputs."""
    multipliers: Float[Array, "N m"]
    """Multipliers of the kept constraint rows, minus their forces on the robot; NaN where other rows were needed."""
    contact_forces: Float[Array, "N c"]
    """Forces of all constraint rows on the robot, dropped rows included; of least norm if they are not unique."""
    energy: Float[Array, " N"]
    """Energy of the plant, with the plant's masses [J]."""
    work: Float[Array, " N"]
    """Work of actuators, rheonomic constraints and faults, minus the dissipation of damping and friction [J].

    ``energy - work`` is constant.
    """
    constraint_residual: Float[Array, " N"]
    """Largest absolute entry of ``A v - mu`` at the true velocity; for ``ReducedPlant`` of the order of rounding."""
    slip: Float[Array, "N m"]
    """``A v - mu`` of the kept constraint rows [m/s or rad/s]."""
    position_residual: Float[Array, " N"]
    """Largest violation of a holonomic row [m or rad]; zero without such rows."""
    singular_value: Float[Array, " N"]
    """Smallest singular value of the stack E with unit rows."""
    estimates: Float[Array, "N s"]
    """Parameter estimates of the controller; no columns without named parameters."""
    prediction_error: Float[Array, "N e"]
    """Measured minus predicted rates of the vertical outputs, if the controller predicts them."""
    v_measured: Float[Array, "N w"]
    """Measured full velocities; no columns if measurements are exact."""
    friction_used: Float[Array, "N c2"]
    """Friction use of each contact: friction force over its limit, 1 during slip; no columns without friction."""
    slip_speed: Float[Array, "N c2"]
    """Largest speed at which each contact slid at its limit since the last sample [m/s]; NaN if a plant does not know.

    It is inf where a drive force without a wheel was cut.
    """
    normal_forces: Float[Array, "N c3"]
    """Normal force of the ground on each contact [N]. The model allows negative values; a real contact lifts off.

    No columns without such contacts, or if the plant is not a reduced model.
    """
    ground_poses: Float[Array, "N g"]
    """Position x, y [m] and heading [rad] of each body that moves on the ground; no columns without such bodies."""
    info: RunInfo
    """Names, units, scenario, versions, seed, outcome."""

    grounds: Grounds | None = field(default=None, repr=False, compare=False)
    """Grounds of the verdict besides the samples; None for a run from a file."""

    @property
    def arrays(self) -> dict[str, Array]:
        """All arrays by name, as in the file."""
        return {name: getattr(self, name) for name in _ARRAYS}

    def with_verdict(self, verdict: Verdict) -> Self:
        """Return this run with a verdict, which ``save`` writes.

        Args:
            verdict: findings about the run.
        """
        return replace(self, info=replace(self.info, verdict=verdict))

    @property
    def meta(self) -> dict[str, Json]:
        """Copy of ``info`` as JSON content with fixed keys, as in the file."""
        return self.info.to_json()

    @property
    def outcome(self) -> Outcome:
        """Outcome of the run."""
        return self.info.outcome

    @property
    def phase(self) -> Int[Array, " N"]:
        """Index of the interval between events of contacts of each sample; zero without such events."""
        index = np.zeros(len(self.time), dtype=int)
        for number, each in enumerate(self.info.phases):
            index[each.first_sample :] = number
        return index

    def coordinates(self, kind: str) -> Coordinates:
        """Coordinate types of the outputs of a kind, "x1" or "x2": angles and rotation vectors.

        Args:
            kind: "x1" or "x2".
        """
        return self.info.outputs.of(kind).coordinates

    @classmethod
    def load(cls, path: str | Path, largest: int | None = None) -> Self:
        """Read a file of ``save``.

        Args:
            path: path of the ``.npz`` file.
            largest: largest size of the arrays [bytes]; by default 256 MiB or 20 times the file, whichever is larger.

        Raises:
            ConfigurationError: the file does not exist, is not a trajectory, or is too large.
        """
        from rnc_pin.io.safe_npz import ArchiveError, read_npz  # a run that reads no file starts without it

        path = Path(path)
        names = [*_ARRAYS, "meta"]
        try:
            arrays = read_npz(path, names, text=["meta"], largest=largest)
            missing = [name for name in names if name not in arrays]
            if missing:
                raise ConfigurationError(f"it has no '{missing[0]}'")
            info = RunInfo.from_json(json.loads(str(arrays.pop("meta"))))
            _check(arrays, info.outputs)  # a file of a stranger: wrong shapes would fail later, and far from here
            return cls(info=info, grounds=None, **arrays)
        except FileNotFoundError:
            raise ConfigurationError(f"no file '{path}'") from None
        except json.JSONDecodeError as error:
            raise ConfigurationError(f"{path}: not a trajectory: 'meta' is not JSON: {error}") from None
        except (ConfigurationError, ArchiveError) as error:
            raise ConfigurationError(f"{path}: not a trajectory: {error}") from None
        except (MemoryError, RecursionError, ValueError):  # invalid content or encoding of ``meta``
            raise ConfigurationError(f"{path}: not a trajectory: 'meta' cannot be read") from None


def tracking_errors(trajectory: RunData) -> dict[str, np.ndarray]:
    """Desired minus actual value over time, (N,) per output with a goal; NaN before the first goal.

    Args:
        trajectory: the run.
    """
    errors: dict[str, np.ndarray] = {}
    for kind in ("x2", "x1"):
        desired, actual = getattr(trajectory, f"{kind}_desired"), getattr(trajectory, kind)
        # On the manifold of the outputs: an angle of 359 degrees is 1 degree from zero.
        difference = trajectory.coordinates(kind).difference(desired, actual)
        for column, name in enumerate(trajectory.info.outputs.of(kind).names):
            if name in trajectory.info.goals:
                errors[name] = difference[:, column]
    return errors


SERIES_UNITS = {
    "time": "s", "energy": "J", "work": "J", "constraint_residual": "m/s or rad/s", "position_residual": "m or rad",
    "singular_value": "-",
}  # fmt: skip
"""Arrays of one number a sample, and their units."""
_ARRAYS = tuple(each.name for each in fields(RunData) if each.name not in ("info", "grounds"))


def _check(arrays: dict[str, np.ndarray], outputs: OutputNames) -> None:
    for name, array in arrays.items():
        # Wrong types too: text or integers in place of floats fail in NumPy, with other words.
        depth = 1 if name in SERIES_UNITS else 2
        if array.dtype.kind != "f" or array.ndim != depth or len(array) != arrays["time"].size:
            raise ConfigurationError(f"'{name}' has shape {array.shape}")
    for kind in ("x1", "x2"):
        columns = outputs.of(kind)
        if {len(columns.names), len(columns.units), len(columns.angular)} != {arrays[kind].shape[1]}:
            raise ConfigurationError(f"'meta' does not name the columns of '{kind}'")
        # None of them: a file of a run without quasi-velocities leaves the flags out.
        if len(columns.quasi) not in (0, len(columns.names)):
            raise ConfigurationError(f"'meta' does not name the quasi-velocities of '{kind}'")
    for kind in ("T", "multipliers", "contact_forces", "q", "v"):
        names, units = getattr(outputs, kind), getattr(outputs, f"{kind}_units")
        if len(names) not in ({arrays[kind].shape[1]} if kind == "T" else {0, arrays[kind].shape[1]}):
            raise ConfigurationError(f"'meta' does not name the columns of '{kind}'")
        if len(units) not in (0, len(names)):
            raise ConfigurationError(f"'meta' does not have the units of the columns of '{kind}'")
    if 3 * len(outputs.ground_poses) != arrays["ground_poses"].shape[1]:
        raise ConfigurationError("'meta' does not name the columns of 'ground_poses'")
    # All other arrays may have NaN, where a plant or a controller does not know a value.
    if not all(np.isfinite(arrays[name]).all() for name in ("time", "q", "v2")):
        raise ConfigurationError("it holds values that are not finite")
    if (np.diff(arrays["time"]) < 0).any():
        raise ConfigurationError("its time runs backwards")
