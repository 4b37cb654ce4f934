"""A scenario for one way a robot may stand in the world, made whole and tried out."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import pinocchio as pin
from pydantic import TypeAdapter

from rnc_pin.constraints import MomentumConservation
from rnc_pin.errors import ConfigurationError, ConstraintError, RncError
from rnc_pin.math.linear_algebra import unit_rows
from rnc_pin.model.kinematics import Kinematics
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.rows import OutputKind
from rnc_pin.model.system import NonholonomicSystem
from rnc_pin.plain import Json, plain_mapping
from rnc_pin.scenario.builder import Experiment, build_experiment, build_system
from rnc_pin.scenario.draft.joints import effort_limit, joint_limits, turns
from rnc_pin.scenario.draft.mobility import Entry, Mobility
from rnc_pin.scenario.draft.source import Source
from rnc_pin.scenario.draft.text import Drafted, write_draft
from rnc_pin.scenario.loading import validate
from rnc_pin.scenario.run import Plan, execute
from rnc_pin.scenario.schema.outputs import OutputItem
from rnc_pin.simulation import Outcome

_APART = 1e-3  # sine of the angle from the rows before it, below which an output adds no motion; wheels are small
_BENT, _SLID = 0.2, 0.05  # how far a joint's reference goes [rad], [m]
_LEAN = 0.05  # [rad]
_SINGULAR = 1e-9  # smallest eigenvalue of an inertia matrix with ones on its diagonal
_PULLED, _TURNED_ASIDE = 0.1, 0.6  # [m], [rad]
_MOVES = 3  # joints moved for that
_SHORT, _LONG = 0.1, 6  # how long a draft is tried out, and how long where that does not take long [s]
_PATIENCE = 20.0  # [s]
_TRACKERS = (("adaptive", 0.002), ("adaptive", 0.001), ("computed_torque", 0.002))


@dataclass
class Attempt:
    """One way.

    Args:
        mobility: how the base stands.
        source: the robot.
        start: values of joints at the start.
        folder: where the scenario will be.
    """

    mobility: Mobility
    source: Source
    start: dict[str, float]
    folder: Path

    def __post_init__(self) -> None:
        mobility = self.mobility
        self.robot = self.source.load(mobility.base, mobility.lock)
        mobility.lock = {**self.source.held, **mobility.lock}
        self.start = {name: value for name, value in self.start.items() if name in self.robot.joint_names}
        mobility.passive |= {mimic.joint for mimic in self.robot.mimics}
        self._find_momentum()
        self._spread()

    def _spread(self) -> None:
        """Move a joint where the inertia matrix is singular at the start: two axes on one line, no mass between."""
        for _ in range(_MOVES):
            if self._stiffness(self.start) > _SINGULAR:
                return
            moved = {name: {**self.start, name: self._aside(name)} for name in self.start}
            name = max(moved, key=lambda each: self._stiffness(moved[each]))
            self.start = moved[name]
            self.mobility.notes.append(f"{name} starts at {self.start[name]:g}: at zero axes lie on one line")

    def _stiffness(self, start: Mapping[str, float]) -> float:
        """Smallest eigenvalue of the inertia matrix with ones on its diagonal."""
        M = pin.crba(self.robot.model, self.robot.model.createData(), self.robot.configuration(start))
        size = np.sqrt(np.diag(M))
        return float(np.linalg.eigvalsh(M / np.outer(size, size))[0])

    def _aside(self, name: str) -> float:
        """A value of a joint beside that at the start, within its range."""
        low, high = joint_limits(self.robot, name)
        step = min(_TURNED_ASIDE if turns(self.robot, name) else _PULLED, (high - low) / 4)
        return round(self.start[name] + (step if self.start[name] + step < high else -step), 4)

    @cached_property
    def q0(self) -> np.ndarray:
        """Where it starts (nq,), wheels on the ground."""
        q = self.robot.configuration({**self.start, **self.mobility.initial})
        if self.mobility.lean is not None:
            pitched = pin.AngleAxis(_LEAN, self.mobility.lean / np.linalg.norm(self.mobility.lean))
            q[3:7] = (pin.Quaternion(pitched) * pin.Quaternion(q[3:7])).coeffs()
        return self._system(self.mobility.actuators).assembled(q)

    def text(self) -> str:
        """The scenario, which has run as it is.

        Raises:
            RncError: it does not.
        """
        scenario, remarks = self._scenario()
        if self.mobility.feedback is not None:
            scenario["controller"] = self.mobility.feedback
            scenario["simulation"] = {"duration": _LONG, "dt": 0.002}
            remarks["controller"] = "knows the model: feedback of the state, by linearize and lqr at the start"
            self._try_out(scenario)
            return write_draft(self.robot.name, scenario, remarks, self.mobility)
        failures: list[str] = []
        trackers: Sequence[tuple[str, float]] = _TRACKERS
        if self._is_loaded():
            trackers = trackers[2:]
            failures.append("gravity loads the robot, which it takes long to learn")
        for tracker, dt in trackers:
            scenario["controller"] = {"type": "reducing_outputs", "tracker": tracker, "preset": "scaled"}
            scenario["simulation"] = {"duration": _LONG, "dt": dt}
            try:
                self._try_out(scenario)
            except RncError as error:
                failures.append(str(error))
                continue
            if tracker != "adaptive":
                remarks["controller"] = (
                    "computed_torque knows the model; adaptive does not, and does not suit: " + failures[0]
                )
            return write_draft(self.robot.name, scenario, remarks, self.mobility)
        raise ConfigurationError(failures[-1])

    # ------------------------------------------------------------------ trying out

    def _try_out(self, scenario: Drafted) -> None:
        """Build it, with its preflight, and run it: a moment, and to the end where that is soon."""
        raw = _without_remarks(scenario)
        experiment = build_experiment(validate(raw, "draft"), self.folder)
        begun = time.perf_counter()
        self._run(raw, experiment, _SHORT)
        if (time.perf_counter() - begun) * _LONG / _SHORT < _PATIENCE:
            self._run(raw, experiment, _LONG)

    def _run(self, raw: dict[str, Json], experiment: Experiment, duration: float) -> None:
        settings = experiment.simulation.model_copy(update={"duration": duration})
        brief = replace(experiment, simulation=settings)
        result = execute(Plan("draft", raw, self.folder, brief, {}, built_in=False))
        if result.error is not None:
            raise result.error
        if result.trajectory.outcome is not Outcome.COMPLETED:
            raise ConfigurationError(f"its run ends early: {result.trajectory.outcome.value}")

    def _is_loaded(self) -> bool:
        """Whether gravity pulls at a joint."""
        model = self.robot.model
        forces = np.abs(pin.computeGeneralizedGravity(model, model.createData(), self.q0))
        rows = [self.robot.velocity_indices(name).start for name in self.start]
        return bool(not self.mobility.weightless and forces[rows].max(initial=0.0) > 1e-6)

    # ------------------------------------------------------------------ its parts

    def _find_momentum(self) -> None:
        """Joints without effort are passive, and one of them on the ground may keep its momentum."""
        robot, mobility = self.robot, self.mobility
        limits = {name: effort_limit(robot, name) for name in self.start}
        weak = [name for name, limit in limits.items() if limit == 0 and name not in mobility.passive]
        if len(weak) < len(limits):
            mobility.passive |= set(weak)
            if weak:
                mobility.notes.append(f"effort 0 in the file, so that nothing drives them: {', '.join(weak)}")
        if mobility.base != "fixed" or mobility.constraints:
            return
        for name in weak if len(weak) < len(limits) else ():
            if robot.model.parents[robot.joint_id(name)] != 0:
                continue
            try:
                MomentumConservation(name).bind(robot)
            except ConstraintError:
                continue
            mobility.constraints.append(({"momentum": name}, "turns freely, and the robot starts at rest"))
            mobility.vertical.append({"joint": name})

    def _robot_entry(self) -> dict[str, Json]:
        """What the scenario says of the robot."""
        mobility = self.mobility
        return {
            **self.source.described(mobility.base),
            **({"lock": mobility.lock} if mobility.lock else {}),
            **({"gravity": [0, 0, 0]} if mobility.weightless else {}),
        }

    def _scenario(self) -> tuple[Drafted, dict[str, str]]:
        mobility = self.mobility
        system, actuators = self._actuated()
        outputs, names, steps = self._outputs(system)
        primary = [name for name in names if name not in mobility.untracked]
        initial: dict[str, float | list[float]] = {name: value for name, value in self.start.items() if value}
        if mobility.initial:
            values = self.robot.joint_values(self.q0)
            initial = {**initial, **{name: _rounded(values[name]) for name in mobility.initial}}
        view: dict[str, Json] = {"trail": [mobility.frame] if mobility.base != "fixed" else []}
        if mobility.ground is not None:
            view["ground"] = round(mobility.ground, 4) + 0.0
        elif mobility.weightless:
            view["ground"] = None
        scenario: Drafted = {
            "robot": self._robot_entry(),
            "constraints": mobility.constraints,
            "actuators": actuators,
            "outputs": {
                "reducing": outputs,
                "vertical": [entry for entry in mobility.vertical if entry not in outputs],
            },
            "task": {"primary": primary},
            "initial": {"q": initial, "v2": mobility.v2} if mobility.v2 else {"q": initial},
            "view": view,
        }
        if len(primary) < len(names):
            scenario["task"] = {"primary": primary, "redundant": [name for name in names if name not in primary]}
        if not mobility.v2:
            way = [step for name, step in zip(names, steps, strict=True) if name in primary]
            scenario["reference"] = {"primary": {"minimum_jerk": {"by": way, "duration": 5}}}
        return scenario, {}

    def _actuated(self) -> tuple[NonholonomicSystem, list[tuple[Entry, str]]]:
        """The system with its actuators: joints without effort are driven too where the rest cannot do it."""
        mobility = self.mobility
        named = {entry for entry, _ in mobility.actuators if isinstance(entry, str)}
        conserved = {entry.get("momentum") for entry, _ in mobility.constraints if isinstance(entry, dict)}
        rest = [name for name in self.start if name not in named | mobility.passive | conserved]
        actuators = [*mobility.actuators, *((name, "") for name in rest)]
        system = self._system(actuators)
        if mobility.feedback is not None or self._rank(system) == system.r:
            return system, actuators
        followers = {mimic.joint for mimic in self.robot.mimics}
        added = [name for name in self.start if name in mobility.passive - conserved - named - followers]
        rank = self._rank(system)
        for name in added:
            more = [*actuators, (name, "the file gives it no effort, or it would be carried along: CHECK")]
            system = self._system(more)
            if self._rank(system) > rank:
                actuators, rank = more, self._rank(system)
        if len(actuators) > len(mobility.actuators) + len(rest):
            driven = ", ".join(str(entry) for entry, _ in actuators[len(mobility.actuators) + len(rest) :])
            mobility.notes.append(f"driven although nothing in the file says so, or the rest would fall: {driven}")
        for force in self._forces() if rank < system.r else ():
            more = [*actuators, (force, "stands for what the file does not tell of: CHECK")]
            if self._rank(self._system(more)) > rank:
                actuators, rank = more, self._rank(self._system(more))
        return self._system(actuators), actuators

    def _forces(self) -> list[Entry]:
        """Forces and torques on the base, unless its momentum is kept."""
        if self.mobility.weightless or self.mobility.base == "fixed":
            return []
        frame = self.mobility.frame
        kinds = [("force", "xy"), ("torque", "z")] if self.mobility.base == "planar" else [("torque", "xyz")]
        return [{kind: {"frame": frame, "axis": axis}} for kind, axes in kinds for axis in axes]

    def _rank(self, system: NonholonomicSystem) -> int:
        """How many reduced forces the actuators can make at the start."""
        outputs, _, _ = self._outputs(system)
        reduced: ReducedModel = system.reduce([_build(each) for each in outputs])
        matrix = reduced.terms(self.q0, np.zeros(reduced.r)).input_matrix
        return int(np.linalg.matrix_rank(unit_rows(matrix), tol=1e-8)) if matrix.size else 0

    def _system(self, actuators: list[tuple[Entry, str]]) -> NonholonomicSystem:
        raw: dict[str, Json] = {
            "robot": self._robot_entry(),
            "constraints": [entry for entry, _ in self.mobility.constraints],
            "actuators": [entry for entry, _ in actuators],
            "outputs": {"reducing": [{"joint": "unused"}]},
        }
        return build_system(validate(raw, "draft"), self.folder)

    def _outputs(self, system: NonholonomicSystem) -> tuple[list[Mapping[str, Json]], list[str], list[float]]:
        """Reducing outputs: of the candidates in order, those that add a motion at the start."""
        mobility = self.mobility
        driven = [name for name in self.start if name not in mobility.passive]
        passive = [name for name in self.start if name in mobility.passive]
        used = [entry["joint"] for entry, _ in mobility.outputs if "joint" in entry]
        joints = [({"joint": name}, self._step(name)) for name in (*driven, *passive) if name not in used]
        position = Kinematics(system.robot).position(self.q0)
        rows = unit_rows(system.constraints.jacobian(position)) if system.m else np.zeros((0, system.n))
        chosen: list[Mapping[str, Json]] = []
        names: list[str] = []
        steps: list[float] = []
        for entry, step in (*mobility.outputs, *joints):
            bound = _build(entry).bind(system.robot)
            added = unit_rows(bound.jacobian(position))
            if len(names) + len(added) > system.r or not _independent(rows, added):
                continue
            rows = np.vstack([rows, added])
            chosen.append(entry)
            names += bound.names
            steps += [step] + [0.0] * (len(added) - 1)
        if len(names) < system.r:
            raise ConfigurationError(
                f"of {system.r} independent motions only {len(names)} were found in its joints and base"
            )
        return chosen, names, steps

    def _step(self, name: str) -> float:
        """How far a joint's reference goes: a little, and to the side where there is room."""
        low, high = joint_limits(self.robot, name)
        above, below = high - self.start[name], self.start[name] - low  # both infinite where nothing ends
        length = min(_BENT if turns(self.robot, name) else _SLID, 0.3 * max(above, below))
        return round(length if above >= below - 1e-12 else -length, 4)


def _build(entry: Mapping[str, Json]) -> OutputKind:
    kind: OutputKind = TypeAdapter(OutputItem).validate_python(entry)
    return kind


def _independent(rows: np.ndarray, added: np.ndarray) -> bool:
    for row in added:
        rest = row - (np.linalg.lstsq(rows.T, row, rcond=None)[0] @ rows if len(rows) else 0.0)
        if np.linalg.norm(rest) < _APART:
            return False
        rows = np.vstack([rows, row])
    return True


def _rounded(value: float | list[float]) -> float | list[float]:
    if isinstance(value, list):
        return [round(each, 9) + 0.0 for each in value]
    return round(value, 9) + 0.0


def _without_remarks(scenario: Drafted) -> dict[str, Json]:
    bare = {key: [entry for entry, _ in scenario[key]] for key in ("constraints", "actuators")}
    return plain_mapping({**scenario, **bare}, "draft")
