"""A first scenario for a robot: base, wheels, actuators, outputs, a gentle motion and a controller."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pinocchio as pin
from pydantic import TypeAdapter

from rnc_pin.constraints import MomentumConservation
from rnc_pin.errors import ConfigurationError, ConstraintError, ModelError, RncError, nearest
from rnc_pin.math.linear_algebra import unit_rows
from rnc_pin.model.kinematics import Kinematics
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.rows import OutputKind
from rnc_pin.model.system import NonholonomicSystem
from rnc_pin.plain import Json, plain_mapping
from rnc_pin.robots.robot import Robot
from rnc_pin.robots.sources.description import parse_xml
from rnc_pin.robots.urdf_files import example_urdfs, is_file, shipped_directory
from rnc_pin.scenario.builder import build_experiment, build_system
from rnc_pin.scenario.draft.base import Entry, Mobility, on_drawn_axles, on_wheels
from rnc_pin.scenario.draft.text import Drafted, write_draft
from rnc_pin.scenario.draft.wheels import body_frame, find_drawn_axles, find_wheels
from rnc_pin.scenario.loading import admitted, validate
from rnc_pin.scenario.schema.outputs import OutputItem
from rnc_pin.scenario.schema.robot import RobotSource

_APART = 1e-3  # sine of the angle from the rows before it, below which an output adds no motion; wheels are small
_BENT, _SLID = 0.2, 0.05  # how far a joint's reference goes [rad], [m]
_LIMBS = 3  # a body with so many is more likely to float than to be bolted down


def draft(source: str, folder: Path, base: str | None = None, xacro_arguments: Mapping[str, Json] | None = None) -> str:
    """The text of a scenario that ``rnc-pin inspect`` and ``rnc-pin run`` accept as it is.

    Args:
        source: a URDF, xacro or MJCF file, the name of a URDF shipped with rnc_pin or of a robot of example-robot-data.
        folder: where the scenario will be: paths in it are relative to that.
        base: "fixed", "planar" or "free" instead of a guess.
        xacro_arguments: values for the arguments of a xacro file.

    Raises:
        RncError: no such robot, or one of which no scenario can be made.
    """
    entry = _source(source, folder)
    if xacro_arguments:
        entry["xacro_arguments"] = dict(xacro_arguments)
    return _Draft(entry, folder, base).text()


def _source(source: str, folder: Path) -> dict[str, Json]:
    path = Path(source).expanduser()
    if is_file(path):
        relative = os.path.relpath(path.resolve(), folder.resolve())
        if path.suffix == ".xacro" or parse_xml(path).tag != "mujoco":
            return {"urdf": relative}
        return {"mjcf": relative}
    if path.is_dir():
        raise ModelError(f"'{source}' is a folder, expected a robot's file")
    shipped = [each.name for each in shipped_directory().glob("*.urdf")]
    if source in shipped:
        return {"urdf": source}
    if source in example_urdfs():
        return {"example": source}
    valid = [*shipped, *example_urdfs()]
    raise ModelError(f"no robot '{source}': neither a file nor a name{nearest(source, valid)}")


@dataclass
class _Draft:
    entry: dict[str, Json]
    folder: Path
    asked: str | None
    notes: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        lying = None if "mjcf" in self.entry else "fixed"
        self.standing = self.load(lying)
        self.start = _start(self.standing)
        held = self.coupled()
        if held:
            self.standing = self.load(lying, held)
            self.start = _start(self.standing)
        mobility = self.mobility = self.find_base()
        if held:
            mobility.lock.update(held)
            mobility.notes.append(
                "joints that mimic others are locked with those: the model itself does not couple them"
            )
        self.robot = self.load(mobility.base, mobility.lock)
        self.start = {name: value for name, value in self.start.items() if name in self.robot.joint_names}
        self.q0 = self.robot.configuration(self.start)
        self.find_momentum()

    # ------------------------------------------------------------------ the base

    def load(self, base: str | None, lock: Mapping[str, float] | None = None) -> Robot:
        raw = {**self.entry, **({} if base is None else {"base": base}), "lock": dict(lock or {})}
        return admitted(RobotSource, raw, "robot").build(self.folder)

    def find_base(self) -> Mobility:
        robot = self.standing
        q = robot.configuration(self.start)
        root = 1 if robot.model.joints[1].nv > 1 else 0
        frame = _base_frame(robot, root)
        data = robot.model.createData()
        pin.framesForwardKinematics(robot.model, data, q)
        placement = data.oMf[robot.frame_id(frame)]
        if self.asked in (None, "planar"):
            wheels = find_wheels(robot, q)
            if wheels:
                return on_wheels(wheels, frame, placement, self.start)
            axles = find_drawn_axles(robot, q)
            if axles:
                return on_drawn_axles(axles, frame, placement)
        return self.without_wheels(frame, root)

    def without_wheels(self, frame: str, root: int) -> Mobility:
        limbs = len(self.standing.model.children[root])
        if self.asked == "planar":
            result = Mobility("planar", "asked for; no wheels were found, so that it moves in any direction", frame)
            result.actuators += [({"force": {"frame": frame, "axis": axis}}, "") for axis in "xy"]
            result.actuators.append(({"torque": {"frame": frame, "axis": "z"}}, ""))
            result.outputs += [({"frame_position": {"frame": frame, "axes": "xy"}}, 0.5), ({"frame_yaw": frame}, 0.4)]
            return result
        own = "mjcf" in self.entry and root == 1
        floats = self.asked == "free" or (self.asked is None and (own or (limbs >= _LIMBS and self.has_mass())))
        if not floats:
            why = "asked for" if self.asked else "no wheels were found, and the first link is taken to be bolted down"
            return Mobility("fixed", why, frame)
        why = (
            "asked for"
            if self.asked
            else "a free joint in the file"
            if own
            else f"no wheels, and {limbs} limbs on one body"
        )
        result = Mobility(None if own and self.asked is None else "free", why, frame, weightless=True)
        joint = self.standing.joint_names[0] if result.base is None else "root_joint"
        result.constraints.append(({"momentum": joint}, "nothing pushes the base, and it starts at rest"))
        result.vertical += [{"frame_position": {"frame": frame}}, {"frame_yaw": frame}]
        result.passive.add(joint)
        result.notes.append(
            "a floating base is free of contacts and of gravity, as in space; for a bolted one: --base fixed"
        )
        return result

    def has_mass(self) -> bool:
        """Whether the first link has an inertia: a ground or world has none."""
        try:
            return bool(self.load("free").model.inertias[1].mass > 0)
        except ModelError:
            return False

    def coupled(self) -> dict[str, float]:
        """Joints that mimic others and those that they follow, with values that fit together."""
        names = self.standing.joint_names
        held: dict[str, float] = {}
        for joint, of, multiplier, offset in self.standing.mimics:
            value = held.setdefault(of, self.start.get(of, 0.0)) if of in names else 0.0
            if joint in names:
                held[joint] = multiplier * value + offset
        return {name: round(value, 6) for name, value in held.items()}

    def find_momentum(self) -> None:
        """Joints without effort are passive, and one of them on the ground may keep its momentum."""
        robot, mobility = self.robot, self.mobility
        limits = {name: _effort(robot, name) for name in self.start}
        weak = [name for name, limit in limits.items() if limit == 0]
        if len(weak) < len(limits):
            mobility.passive |= set(weak)
            if weak:
                mobility.notes.append(f"effort 0 in the file, so that nothing drives them: {', '.join(weak)}")
        if mobility.base != "fixed":
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

    # ------------------------------------------------------------------ the scenario

    def text(self) -> str:
        scenario, remarks = self.scenario()
        failures: list[str] = []
        trackers = [("adaptive", 0.002), ("adaptive", 0.001), ("computed_torque", 0.002)]
        if self.is_loaded():
            trackers = trackers[2:]
            failures.append("gravity loads the robot, which it takes long to learn")
        for tracker, dt in trackers:
            scenario["controller"] = {"type": "reducing_outputs", "tracker": tracker, "preset": "scaled"}
            scenario["simulation"] = {"duration": 6, "dt": dt}
            try:
                build_experiment(validate(_without_remarks(scenario), "draft"), self.folder)
            except RncError as error:
                failures.append(str(error))
                continue
            if tracker != "adaptive":
                remarks["controller"] = (
                    "computed_torque knows the model; adaptive does not, and does not suit: " + failures[0]
                )
            return write_draft(self.robot.name, scenario, remarks, self.mobility)
        raise ConfigurationError(f"no scenario can be drafted for '{self.robot.name}': {failures[-1]}")

    def is_loaded(self) -> bool:
        """Whether gravity pulls at a joint."""
        model = self.robot.model
        forces = np.abs(pin.computeGeneralizedGravity(model, model.createData(), self.q0))
        return bool(not self.mobility.weightless and forces[[*self.rows()]].max(initial=0.0) > 1e-6)

    def rows(self) -> list[int]:
        """Where joints of one degree of freedom stand in v: a base stands on the ground."""
        return [self.robot.velocity_indices(name).start for name in self.start]

    def robot_entry(self) -> dict[str, Json]:
        """What the scenario says of the robot."""
        mobility = self.mobility
        return {
            **self.entry,
            **({} if mobility.base is None else {"base": mobility.base}),
            **({"lock": mobility.lock} if mobility.lock else {}),
            **({"gravity": [0, 0, 0]} if mobility.weightless else {}),
        }

    def scenario(self) -> tuple[Drafted, dict[str, str]]:
        mobility = self.mobility
        system, actuators = self.actuated()
        outputs, names, steps = self.outputs(system)
        initial = {name: value for name, value in self.start.items() if value}
        view: dict[str, Json] = {"trail": [mobility.frame] if mobility.base != "fixed" else []}
        if mobility.ground is not None:
            view["ground"] = round(mobility.ground, 4) + 0.0
        scenario: Drafted = {
            "robot": self.robot_entry(),
            "constraints": mobility.constraints,
            "actuators": actuators,
            "outputs": {"reducing": outputs, "vertical": self.vertical(outputs)},
            "task": {"primary": names},
            "initial": {"q": initial},
            "reference": {"primary": {"minimum_jerk": {"by": steps, "duration": 5}}},
            "view": view,
        }
        return scenario, {}

    def actuated(self) -> tuple[NonholonomicSystem, list[tuple[Entry, str]]]:
        """The system with its actuators; joints without effort are driven too where the rest cannot do it."""
        mobility = self.mobility
        named = {entry for entry, _ in mobility.actuators if isinstance(entry, str)}
        conserved = {entry.get("momentum") for entry, _ in mobility.constraints if isinstance(entry, dict)}
        rest = [name for name in self.start if name not in named | mobility.passive | conserved]
        actuators = [*mobility.actuators, *((name, "") for name in rest)]
        system = self.system(actuators)
        outputs, _, _ = self.outputs(system)
        if _rank(self.reduce(system, outputs), self.q0) < system.r:
            added = [name for name in self.start if name in mobility.passive - conserved - named]
            if added:
                mobility.notes.append(
                    f"driven although the file gives them no effort, or the rest would fall: {', '.join(added)}"
                )
                actuators += [(name, "") for name in added]
                system = self.system(actuators)
        return system, actuators

    def system(self, actuators: list[tuple[Entry, str]]) -> NonholonomicSystem:
        raw: dict[str, Json] = {
            "robot": self.robot_entry(),
            "constraints": [entry for entry, _ in self.mobility.constraints],
            "actuators": [entry for entry, _ in actuators],
            "outputs": {"reducing": [{"joint": "unused"}]},
        }
        return build_system(validate(raw, "draft"), self.folder)

    def reduce(self, system: NonholonomicSystem, outputs: list[Mapping[str, Json]]) -> ReducedModel:
        return system.reduce([_build(each) for each in outputs])

    def outputs(self, system: NonholonomicSystem) -> tuple[list[Mapping[str, Json]], list[str], list[float]]:
        """Reducing outputs: of the candidates in order, those that add a motion at the start."""
        mobility = self.mobility
        driven = [name for name in self.start if name not in mobility.passive]
        passive = [name for name in self.start if name in mobility.passive]
        used = [entry["joint"] for entry, _ in mobility.outputs if "joint" in entry]
        joints = [({"joint": name}, self.step(name)) for name in (*driven, *passive) if name not in used]
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
                f"no scenario can be drafted for '{self.robot.name}': of {system.r} independent motions "
                f"only {len(names)} were found in its joints and base"
            )
        return chosen, names, steps

    def vertical(self, reducing: list[Mapping[str, Json]]) -> list[Mapping[str, Json]]:
        return [entry for entry in self.mobility.vertical if entry not in reducing]

    def step(self, name: str) -> float:
        """How far a joint's reference goes: a little, and to the side where there is room."""
        low, high = _limits(self.robot, name)
        turns = self.robot.velocity_units[self.robot.velocity_indices(name).start] == "rad/s"
        above, below = high - self.start[name], self.start[name] - low  # both infinite where nothing ends
        length = min(_BENT if turns else _SLID, 0.3 * max(above, below))
        return round(length if above >= below - 1e-12 else -length, 4)


def _start(robot: Robot) -> dict[str, float]:
    """Joints of one degree of freedom: at zero, or where that is not well inside their range, in its middle."""
    start = {}
    for index, name in enumerate(robot.joint_names, start=1):
        if robot.model.joints[index].nv != 1:
            continue
        low, high = _limits(robot, name)
        margin = 0.02 * (high - low) if np.isfinite(high - low) else 0.0
        inside = low + margin < 0 < high - margin or low >= high
        start[name] = 0.0 if inside else round(float((low + high) / 2), 4)
    return start


def _limits(robot: Robot, name: str) -> tuple[float, float]:
    joint = robot.model.joints[robot.joint_id(name)]
    if joint.nq != 1:
        return -np.inf, np.inf
    low, high = robot.model.lowerPositionLimit[joint.idx_q], robot.model.upperPositionLimit[joint.idx_q]
    return (float(low), float(high)) if low < high else (-np.inf, np.inf)


def _effort(robot: Robot, name: str) -> float:
    return float(robot.model.upperEffortLimit[robot.velocity_indices(name).start])


def _base_frame(robot: Robot, root: int) -> str:
    """The frame of the base: ``base_link`` where there is one, else the first link."""
    frames = [
        str(frame.name)
        for frame in robot.model.frames
        if frame.parentJoint == root and frame.type == pin.FrameType.BODY and frame.name != "universe"
    ]
    if "base_link" in frames:
        return "base_link"
    return frames[0] if frames else body_frame(robot, max(root, 1))


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


def _rank(reduced: ReducedModel, q: np.ndarray) -> int:
    matrix = reduced.terms(q, np.zeros(reduced.r)).input_matrix
    return int(np.linalg.matrix_rank(unit_rows(matrix), tol=1e-8)) if matrix.size else 0


def _without_remarks(scenario: Drafted) -> dict[str, Json]:
    bare = {key: [entry for entry, _ in scenario[key]] for key in ("constraints", "actuators")}
    return plain_mapping({**scenario, **bare}, "draft")
