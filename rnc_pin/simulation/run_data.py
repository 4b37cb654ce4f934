"""Signals and metadata of a run, and the file that holds them."""

from __future__ import annotations

import json
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from itertools import chain, zip_longest
from pathlib import Path
from typing import Self

import numpy as np
from numpy import ndarray as Array

from rnc_pin.array_shapes import Float, Int
from rnc_pin.errors import ConfigurationError, RncError
from rnc_pin.io.json import Json, atomic_file, dump_json
from rnc_pin.io.safe_npz import ArchiveError, read_npz
from rnc_pin.model.coordinates import Coordinates
from rnc_pin.printing import Item, Line, ObjectSummary, SummaryMixin
from rnc_pin.simulation.run_info import Outcome, OutputNames, RunInfo
from rnc_pin.verdict import Verdict


@dataclass(frozen=True, repr=False)
class RunData(SummaryMixin):
    """Signals of a run sampled at N times, and their file. ``Trajectory`` is a run that plots and exports itself."""

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

    def judged_later(self, judge: Callable[[Self], Verdict]) -> Self:
        """Return this run, whose verdict is computed at its first use.

        Args:
            judge: function from this run to its verdict.
        """
        vars(self)["_judge"] = judge
        return self

    @property
    def verdict(self) -> Verdict:
        """Findings about the run: it succeeded only if none fails. Computed at its first use.

        Runs of ``simulate`` and ``free_motion`` are judged by the limits of the robot's file, by distances between its
        links, by contacts and by the commands of the loop. Runs of scenarios are also judged by their goals and
        obstacles. ``save`` writes it too.

        Raises:
            ConfigurationError: the run is from a file, and nothing could judge it before it was saved.
        """
        if self.info.verdict is None:
            if "_judge" not in vars(self):
                raise ConfigurationError(
                    "the run was saved before it was judged: call rnc.simulation.judge(run, "
                    "rnc.simulation.replay_limits(robot, run))"
                )
            self.keep_verdict(vars(self)["_judge"](self))
        assert self.info.verdict is not None
        return self.info.verdict

    def keep_verdict(self, verdict: Verdict) -> None:
        """Let this run have a verdict, which ``save`` writes.

        Args:
            verdict: findings about the run.
        """
        vars(self)["info"] = replace(self.info, verdict=verdict)

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
        """Coordinate types of the outputs of a kind, "x1" or "x2": angles and rotation vectors."""
        return self.info.outputs.of(kind).coordinates

    def save(self, path: str | Path) -> None:
        """Write a ``.npz`` file with the verdict, for ``load``. An error leaves no partial file."""
        path = Path(path)
        with suppress(RncError):  # samples that nothing can judge are kept too
            _ = self.verdict  # in the file, because it cannot be judged without the robot
        arrays = {name: getattr(self, name) for name in _array_names()}
        with atomic_file(path) as partial, partial.open("wb") as file:
            np.savez(file, **arrays, meta=np.array(dump_json(self.meta)))

    @classmethod
    def load(cls, path: str | Path, largest: int | None = None) -> Self:
        """Read a file of ``save``.

        Args:
            path: path of the ``.npz`` file.
            largest: largest size of the arrays [bytes]; by default 256 MiB or 20 times the file, whichever is larger.

        Raises:
            ConfigurationError: the file does not exist, is not a trajectory, or is too large.
        """
        path = Path(path)
        names = [*_array_names(), "meta"]
        try:
            arrays = read_npz(path, names, text=["meta"], largest=largest)
            missing = [name for name in names if name not in arrays]
            if missing:
                raise ConfigurationError(f"it has no '{missing[0]}'")
            info = RunInfo.from_json(json.loads(str(arrays.pop("meta"))))
            _check(arrays, info.outputs)
            return cls(**arrays, info=info)
        except FileNotFoundError:
            raise ConfigurationError(f"no file '{path}'") from None
        except json.JSONDecodeError as error:
            raise ConfigurationError(f"{path}: not a trajectory: 'meta' is not JSON: {error}") from None
        except (ConfigurationError, ArchiveError) as error:
            raise ConfigurationError(f"{path}: not a trajectory: {error}") from None
        except (MemoryError, RecursionError, ValueError):  # invalid content or encoding of ``meta``
            raise ConfigurationError(f"{path}: not a trajectory: 'meta' cannot be read") from None

    def _summary(self) -> ObjectSummary:
        duration = self.time[-1] if len(self.time) else 0.0
        scenario, message, outputs = self.info.provenance.scenario, self.info.message, self.info.outputs
        of, verdict = f" of '{scenario}'" if scenario else "", str(self.outcome)
        with suppress(RncError):  # samples that nothing can judge print their outcome
            verdict = self.verdict.headline
        title = f"Trajectory{of}: {verdict}, {duration:g} s in {len(self.time)} samples"
        lines: list[Line] = [("run", [Item(f"{self.outcome}, {duration:g} s in {len(self.time)} samples")])]
        lines += [("message", [Item(message)])] if message else []
        if not len(self.time):
            return ObjectSummary(title, lines)
        both = outputs.x2, outputs.x1
        names, units = (tuple(chain.from_iterable(each)) for each in ([x.names for x in both], [x.units for x in both]))
        values = {
            "outputs at the end": zip_longest(names, (*self.x2[-1], *self.x1[-1]), units, fillvalue=""),
            "largest input": zip_longest(outputs.T, np.abs(self.T).max(axis=0), outputs.T_units, fillvalue=""),
            "checks": (
                ("constraint residual, largest", self.constraint_residual.max(), ""),
                ("singular value of E, smallest", self.singular_value.min(), ""),
            ),
        }
        said = [
            (label, [Item(name, f"{x:.4g} {unit}".rstrip()) for name, x, unit in rows])
            for label, rows in values.items()
        ]
        return ObjectSummary(title, [*lines, *(line for line in said if line[1])])


def tracking_errors(trajectory: RunData) -> dict[str, np.ndarray]:
    """Desired minus actual value over time, (N,) per output with a goal; NaN before the first goal."""
    errors: dict[str, np.ndarray] = {}
    for kind in ("x2", "x1"):
        desired, actual = getattr(trajectory, f"{kind}_desired"), getattr(trajectory, kind)
        difference = trajectory.coordinates(kind).difference(desired, actual)
        for column, name in enumerate(trajectory.info.outputs.of(kind).names):
            if name in trajectory.info.goals:
                errors[name] = difference[:, column]
    return errors


def _array_names() -> list[str]:
    return [each.name for each in fields(RunData) if each.name != "info"]


def _check(arrays: dict[str, np.ndarray], outputs: OutputNames) -> None:
    for name, array in arrays.items():
        depth = 1 if name in _SERIES else 2
        if array.dtype.kind != "f" or array.ndim != depth or len(array) != arrays["time"].size:
            raise ConfigurationError(f"'{name}' has shape {array.shape}")
    for kind in ("x1", "x2"):
        columns = outputs.of(kind)
        if {len(columns.names), len(columns.units), len(columns.angular)} != {arrays[kind].shape[1]}:
            raise ConfigurationError(f"'meta' does not name the columns of '{kind}'")
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
    if not all(np.isfinite(arrays[name]).all() for name in ("time", "q", "v2")):
        raise ConfigurationError("it holds values that are not finite")
    if (np.diff(arrays["time"]) < 0).any():
        raise ConfigurationError("its time runs backwards")


_SERIES = ("time", "energy", "work", "constraint_residual", "position_residual", "singular_value")
