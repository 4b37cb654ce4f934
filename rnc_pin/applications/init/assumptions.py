"""Assumptions of a draft: kind of base, constraints, outputs and actuators.

Reducing outputs are chosen from candidates. Actuators are those of the file, and further ones if these cannot produce
every reduced force.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field

import numpy as np

from rnc_pin.applications.init.evidence import LIKELY, SURE, Alternative, DraftDecision, DriveEvidence, joint_range
from rnc_pin.applications.init.robot_at_start import INDEPENDENT, SAME
from rnc_pin.applications.init.wheel_detection import UPRIGHT, Wheel
from rnc_pin.applications.scenario.schema.scenario import constraint_of, output_of
from rnc_pin.errors import ConfigurationError, ConstraintError, few
from rnc_pin.io import Json
from rnc_pin.math import unit_rows
from rnc_pin.model import Kinematics, NonholonomicSystem, OutputKind
from rnc_pin.robots import Robot

Entry = str | Mapping[str, Json]

DRIVEN, TURNED, BENT = 0.5, 0.4, 0.2  # displacements of the reference: base, heading, joint [m, rad, rad]
DURATION = 5  # duration of the reference [s]


@dataclass
class BaseAssumptions:
    """Assumptions of a draft about the base.

    Attributes:
        base: "fixed", "planar", "free", or None for the base of the file.
        kind: description of the assumed base, with its reason.
        frame: frame of the base.
        start: start values of the joints of the file.
        constraints: constraint entries, with a remark on each.
        actuators: actuator entries of the base, wheels and steering, with a remark on each.
        outputs: candidate reducing outputs, the preferred one first, with the displacement of each reference.
        vertical: entries of the vertical outputs, such as the pose of the base.
        lock: joints to lock, with their values.
        notes: assumptions and doubts, a line each.
        passive: joints without an actuator.
        mimic_drivers: driver of each joint that moves with it by a mimic of the file; such joints are passive.
        ground: height of the ground [m], or None if unknown.
        weightless: True if the scenario has no gravity.
        feedback: settings of the controller that the base needs, or None.
        initial: initial values of joints with several degrees of freedom.
        untracked: outputs without a reference.
        lean: horizontal axis in the world frame (3,) of a small initial tilt of the base, or None.
        v2: initial output rates, to be kept constant instead of a reference.
        travel: displacement of a base on wheels in the trial run [m]; 0 for other robots.
        without_effort: joints with effort 0 in the file, which states an effort of other joints.
        decisions: decisions behind these assumptions, with their evidence.
        doubts: facts of the file to be checked: joint, amount [m], and the fact in words.
        steering: actuated joints that turn wheels; an effort of 0 on one of them is a gap of the file.
    """

    base: str | None
    kind: str
    frame: str = ""
    start: Mapping[str, float] = field(default_factory=dict)
    constraints: list[tuple[Mapping[str, Json], str]] = field(default_factory=list)
    actuators: list[tuple[Entry, str]] = field(default_factory=list)
    outputs: list[tuple[Mapping[str, Json], float]] = field(default_factory=list)
    vertical: list[Mapping[str, Json]] = field(default_factory=list)
    lock: dict[str, float | list[float]] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    passive: set[str] = field(default_factory=set)
    mimic_drivers: dict[str, str] = field(default_factory=dict)
    ground: float | None = None
    weightless: bool = False
    feedback: Mapping[str, Json] | None = None
    initial: dict[str, list[float]] = field(default_factory=dict)
    untracked: set[str] = field(default_factory=set)
    lean: np.ndarray | None = None
    v2: dict[str, float] = field(default_factory=dict)
    travel: float = 0.0
    without_effort: set[str] = field(default_factory=set)
    decisions: list[DraftDecision] = field(default_factory=list)
    doubts: list[tuple[str, float, str]] = field(default_factory=list)
    steering: set[str] = field(default_factory=set)

    def steer(self, joint: str, remark: str = "steering") -> None:
        """Add a joint that turns wheels to the actuators: it is driven, whatever effort the file states.

        Args:
            joint: name of the joint.
            remark: remark on the entry.
        """
        self.actuators.append((joint, remark))
        self.steering.add(joint)

    def decide(self, question: str, answer: str, confidence: float, evidence: str, *others: Alternative) -> None:
        """Add a decision, with the other answers.

        Args:
            question: what is decided, as a question.
            answer: answer of the draft.
            confidence: confidence between 0 and 1.
            evidence: what the answer rests on.
            *others: other answers.
        """
        self.decisions.append(DraftDecision(question, answer, confidence, evidence, others))

    def hold(self, joints: Iterable[str], why: str) -> None:
        """Lock joints at their start values, and note the reason.

        Args:
            joints: names of joints.
            why: reason, in words.
        """
        named = list(dict.fromkeys(joints))
        self.lock.update({joint: self.start.get(joint, 0.0) for joint in named})
        self.note(why, named)

    def note(self, said: str, names: Sequence[str]) -> None:
        """Add a note on joints or links, if there are any.

        Args:
            said: the note.
            names: their names.
        """
        if names:
            self.notes.append(f"{said}: {', '.join(names)}")

    def lock_carriers(self, wheels: Iterable[Wheel]) -> None:
        """Lock the joints that would lift wheels.

        Args:
            wheels: the wheels.
        """
        carriers = (joint for wheel in wheels for joint in wheel.carriers)
        self.hold(carriers, "locked, because they would lift wheels off the ground")

    def roll_line(self, line: Iterable[Wheel], what: str = "", *, lateral: bool = True) -> None:
        """Add the wheels of an axle line: the first one has a lateral row, for all of them, or none has.

        Args:
            line: wheels of one axle line.
            what: remark on each wheel.
            lateral: whether the first wheel has a lateral row.
        """
        for index, wheel in enumerate(line):
            self.roll(wheel, what, **({} if lateral and index == 0 else {"lateral": False}))

    def roll(self, wheel: Wheel, what: str = "", /, **keys: Json) -> None:
        """Add a wheel to the constraints, with a remark; one that is only drawn is a knife edge, or skids freely.

        Args:
            wheel: the wheel.
            what: remark; empty for the source of the radius alone.
            **keys: further settings of the constraint.
        """
        if wheel.edge is not None:  # without a joint it cannot roll; its lateral row is left, if it has one
            if keys.get("lateral") is not False:
                self.constrain("no_side_slip", f"{what or 'knife edge'}; only drawn", **wheel.edge)
            return
        # Its vertical row would ask a base that keeps its height to move up and down, and lock it.
        leans = wheel.wobbles or any(float(np.hypot(*pivot.axis[:2])) > UPRIGHT for pivot in wheel.pivots)
        entry = rolls(wheel, **keys, **({"vertical": False} if leans else {}))
        self.constraints.append((entry, f"{what}; {measured(wheel)}" if what else measured(wheel)))
        balanced = 0.2  # largest distance of a wheel's center of mass from its axle, in radii
        if wheel.imbalance > balanced * wheel.radius:
            said = f"the center of mass of wheel {wheel.joint} is {wheel.imbalance:.2g} m from its axle in the file"
            self.doubts.append((wheel.joint, wheel.imbalance, said))

    def constrain(self, kind: str, remark: str, **settings: Json) -> None:
        """Add an entry to the constraints.

        Args:
            kind: kind of the constraint, such as "caster".
            remark: remark on the entry.
            **settings: its settings.
        """
        self.constraints.append(({kind: settings}, remark))

    def act(self, kind: str, axis: str, remark: str) -> None:
        """Add a force or torque along an axis of the base's frame to the actuators.

        Args:
            kind: "force" or "torque".
            axis: axis of the frame of the base: "x", "y" or "z".
            remark: remark on the entry.
        """
        self.actuators.append(({kind: {"frame": self.frame, "axis": axis}}, remark))

    def drive_along(self, axis: str, step: float = DRIVEN, frame: str = "") -> None:
        """Add the speed of the base along an axis of a frame to the candidate outputs.

        Args:
            axis: axis of the frame: "x", "y" or "z".
            step: displacement of the reference [m].
            frame: name of the frame; empty for the frame of the base.
        """
        self.outputs.append(({"frame_speed": {"frame": frame or self.frame, "axis": axis}}, step))

    def add_planar_pose_outputs(self) -> None:
        """Add position on the ground and heading to the candidate outputs."""
        self.outputs += zip(place_and_heading(self.frame), (DRIVEN, TURNED), strict=True)


def place_and_heading(frame: str) -> list[dict[str, Json]]:
    """Output entries for the position on the ground and the heading of a frame.

    Args:
        frame: name of the frame.
    """
    return [{"frame_position": {"frame": frame, "axes": "xy"}}, {"frame_yaw": frame}]


def rolls(wheel: Wheel, **more: Json) -> dict[str, Json]:
    """Constraint entry of a rolling wheel."""
    return {"rolling_wheel": {"frame": wheel.frame, "radius": float(f"{wheel.radius:.5g}"), **more}}


def measured(wheel: Wheel) -> str:
    """Remark on the source of a wheel's radius.

    Args:
        wheel: the wheel.
    """
    guesses = {"height": "is the axle's height", "inertia": "fits its inertia as a solid disk"}
    if wheel.measured in guesses:
        return f"MEASURE the radius: no round shape of the wheel was read, the value {guesses[wheel.measured]}"
    return f"radius from the {wheel.measured} geometry"


@dataclass
class ChosenOutputs:
    """Chosen reducing outputs.

    Attributes:
        entries: entries of the scenario.
        kinds: output objects of these entries.
        names: row names (r,).
        steps: displacement of the reference of each row (r,) [m, rad].
    """

    entries: list[Mapping[str, Json]] = field(default_factory=list)
    kinds: list[OutputKind] = field(default_factory=list)
    names: list[str] = field(default_factory=list)
    steps: list[float] = field(default_factory=list)


def output_candidates(
    mobility: BaseAssumptions, robot: Robot, start: Mapping[str, float]
) -> list[tuple[Mapping[str, Json], float]]:
    """Return output entries by preference with reference displacements: base, driven joints, passive joints.

    Args:
        mobility: assumptions about the base.
        robot: the robot.
        start: start values of its joints with one degree of freedom [rad or m].
    """
    # False sorts before True: joints with a motor are preferred, in the order of the file. One of the base, such as
    # steering with its own step, comes twice, and the second time it depends on the first.
    joints = sorted(start, key=lambda name: name in mobility.passive)
    return [*mobility.outputs, *(({"joint": name}, _step(robot, name, start[name])) for name in joints)]


def select_outputs(
    wanted: Iterable[tuple[Mapping[str, Json], float]], system: NonholonomicSystem, q: np.ndarray
) -> ChosenOutputs:
    """Return the candidates, in order, whose Jacobian rows at ``q`` (nq,) are independent of the rows before them.

    Args:
        wanted: output entries by preference, with the displacement of each reference [m or rad].
        system: the robot with its constraints.
        q: start (nq,).

    Raises:
        ConfigurationError: fewer than r independent rows.
    """
    chosen = ChosenOutputs()
    position = Kinematics(system.robot).position(q)
    rows = _unit_rows(system.constraints.jacobian(position)) if system.m else np.zeros((0, system.n))
    for entry, step in wanted:
        kind = output_of(entry)
        bound = kind.bind(system.robot)
        # Outputs have SI units: a row that is small beside 1.0 is rounding, which unit length would enlarge.
        added = _unit_rows(bound.jacobian(position), 1.0)
        if len(chosen.names) + len(added) > system.r or not _independent(rows, added):
            continue
        rows = np.vstack([rows, added])
        chosen.entries.append(entry)
        chosen.kinds.append(kind)
        chosen.names += bound.names
        # An output of several rows moves along its first one.
        chosen.steps += [step] + [0.0] * (len(added) - 1)
    if len(chosen.names) < system.r:
        raise ConfigurationError(
            f"only {len(chosen.names)} of {system.r} independent reducing outputs were found among its joints and base"
        )
    return chosen


def _independent(rows: np.ndarray, added: np.ndarray) -> bool:
    for row in added:
        # The part of a unit row outside the span of the others is as long as the sine of its angle to them.
        rest = row - (np.linalg.lstsq(rows.T, row, rcond=None)[0] @ rows if len(rows) else 0.0)
        if np.linalg.norm(rest) < INDEPENDENT:
            return False
        rows = np.vstack([rows, row])
    return True


def _step(robot: Robot, name: str, value: float) -> float:
    """Displacement of a joint's reference [rad or m]: small, toward the farther limit."""
    low, high = joint_range(robot, name)
    for mimic in robot.mimics:  # joints that it mimics stay within their limits, too
        if mimic.joint == name and mimic.multiplier and mimic.of in robot.joint_names:
            ends = sorted(mimic.multiplier * end + mimic.offset for end in joint_range(robot, mimic.of))
            low, high = max(low, ends[0]), min(high, ends[1])
    above, below = high - value, value - low  # both infinite without limits
    slid = 0.05  # displacement of the reference of a prismatic joint [m]
    # A third of the way to the farther limit leaves room for the overshoot.
    length = max(min(BENT if robot.single_joint(name).unit == "rad/s" else slid, 0.3 * max(above, below)), 0.0)
    return round(length if above >= (1 - SAME) * below else -length, 4)


@dataclass(frozen=True)
class ActuatorCandidates:
    """Candidate actuator entries, one input each, with a remark on each.

    Attributes:
        sure: actuators of the base and of joints with an effort limit.
        joints: joints without effort and passive joints, driven only if the sure actuators are not enough.
        forces: forces and torques on the base, in place of actuators that the file does not describe.
        wheels: those of ``joints`` that the base needs, e.g. wheels with effort 0 in the file.
    """

    sure: list[tuple[Entry, str]]
    joints: list[tuple[Entry, str]]
    forces: list[tuple[Entry, str]]
    wheels: list[tuple[Entry, str]]

    @property
    def all(self) -> list[tuple[Entry, str]]:
        """All entries, the most likely first."""
        return [*self.sure, *self.joints, *self.forces]

    def enough(self, input_matrix: np.ndarray) -> list[tuple[Entry, str]]:
        """Return the sure entries, and each further entry, in order, that raises the rank of the reduced forces.

        If a wheel without effort is among them, all such wheels are: their efforts are placeholders.

        Args:
            input_matrix: reduced forces for unit inputs of all entries (r, p).
        """
        columns, rows = list(range(len(self.sure))), _unit_rows(input_matrix)
        # Greedy in the order of likelihood: each entry that is not needed would be a motor that the file does not have.
        for column in range(len(self.sure), len(self.all)):
            if _rank(rows[:, [*columns, column]]) > _rank(rows[:, columns]):
                columns.append(column)
        chosen = [self.all[column] for column in columns]
        alike = self.wheels if any(wheel in chosen for wheel in self.wheels) else []
        return [each for each in self.all if each in chosen or each in alike]


def actuator_candidates(
    mobility: BaseAssumptions, robot: Robot, start: Iterable[str], undriven: Collection[str]
) -> ActuatorCandidates:
    """Return the candidate actuators of a robot with one kind of base.

    Args:
        mobility: assumptions about the base.
        robot: the robot with that base.
        start: its joints with one degree of freedom.
        undriven: joints without an actuator in a file that names the actuators of other joints.
    """
    joints = [name for name in start if name not in undriven]
    driving = [each for each in mobility.actuators if each[0] not in undriven]
    named = {entry for entry, _ in driving if isinstance(entry, str)}
    # A torque on a joint whose momentum is conserved would contradict its row.
    conserved = {entry.get("momentum") for entry, _ in mobility.constraints}
    followers = set(mobility.mimic_drivers)
    weak = [name for name in joints if name in mobility.without_effort - conserved - followers]
    sure = [name for name in joints if name not in named | mobility.passive | conserved]
    passive = [name for name in joints if name in mobility.passive - conserved - named - followers - {*weak}]
    given = [entry for entry, _ in driving]
    zero = "effort 0 in the file: CHECK its limit"
    untold = "in place of actuators that the file does not describe: CHECK"
    wheels: list[tuple[Entry, str]] = [(name, zero) for name in weak if name in named]
    others = [*((name, zero) for name in weak if name not in named)]
    others += [(name, "driven, although it is usually passive: CHECK") for name in passive]
    return ActuatorCandidates(
        [*(each for each in driving if each[0] not in weak), *((name, "") for name in sure)],
        [*wheels, *others],
        [(force, untold) for force in _forces(mobility) if force not in given],
        wheels,
    )


def _forces(mobility: BaseAssumptions) -> list[Entry]:
    """Forces and torques on the base; none if its momentum is conserved."""
    if mobility.weightless or mobility.base == "fixed":  # bolted down, a force on the base does nothing
        return []
    kinds = [("force", "xy"), ("torque", "z")] if mobility.base == "planar" else [("torque", "xyz")]
    return [{kind: {"frame": mobility.frame, "axis": axis}} for kind, axes in kinds for axis in axes]


def _rank(forces: np.ndarray) -> int:
    """Number of independent reduced forces of actuators."""
    return int(np.linalg.matrix_rank(forces, tol=INDEPENDENT)) if forces.size else 0


def _unit_rows(rows: np.ndarray, least: float = 0.0) -> np.ndarray:
    """Rows of unit length; entries that are rounding beside the longest row, or beside ``least``, are zero."""
    longest = np.linalg.norm(rows, axis=-1).max(initial=least)
    rounding = 1e-9  # entry of a row, relative to the longest row, that is rounding
    return unit_rows(np.where(np.abs(rows) > rounding * longest, rows, 0.0))


# ---------------------------------------------------------------------- joints without a motor


def assume_motors(mobility: BaseAssumptions, start: Collection[str], drives: DriveEvidence) -> list[str]:
    """Mark joints without a motor as passive: those with effort 0, and those that a list of motors leaves out.

    Args:
        mobility: assumptions about the base; its passive joints, decisions and notes are extended.
        start: joints of the robot with one degree of freedom.
        drives: evidence for which joints have a motor.

    Returns:
        Joints that the file or an option leaves without a motor.
    """
    driven = [name for name in start if name not in mobility.passive]
    weak = [name for name in driven if drives.efforts[name] == 0]
    # Zeros count only where another joint has an effort: else the file states none.
    powered = len(weak) < len(driven)
    of_base = {entry for entry, _ in mobility.actuators if isinstance(entry, str)} | mobility.passive
    others = [name for name in start if name not in of_base]
    leading = [name for name in start if name not in mobility.mimic_drivers]
    undriven = drives.unlisted(leading if drives.is_complete else others)
    idle = [name for name in others if name in undriven]
    if idle:
        mobility.decisions.append(_decision_on_others(idle, drives))
    # CAD exporters write 0 for motors too: a list of motors and the function as steering count more.
    named = [name for name in weak if drives.says(name) or name in mobility.steering]
    if powered:
        mobility.without_effort = set(weak) - set(named)
        if mobility.travel or mobility.weightless:  # a loose joint without an effort is held
            undriven += [name for name in weak if name not in {*named, *of_base, *undriven}]
        mobility.passive |= mobility.without_effort
        said = "effort 0 in the file, although they steer or it names their motors: driven without a limit, CHECK"
        mobility.note(said, named)
    elif weak and not drives.is_complete:  # joints of an MJCF without an actuator have effort 0
        mobility.notes.append("the file states no effort: 0 for every joint, so that they are driven without a limit")
    return undriven


def _decision_on_others(idle: Sequence[str], drives: DriveEvidence) -> DraftDecision:
    """Decision on the joints beside the base that have no motor."""
    asked = all(name in drives.passive for name in idle)
    sources = list(dict.fromkeys(drives.named.values()))
    evidence = "by an option" if asked else f"not named by {few(sources)}, which name other joints"
    sure = SURE if asked or drives.is_complete else LIKELY
    others = tuple(Alternative(f"{name} is driven", {"driven": [name]}) for name in idle[:2])
    return DraftDecision("Which joints beside the base have no motor?", few(idle), sure, evidence, others)


def conserve_momentum_of_free_joints(mobility: BaseAssumptions, robot: Robot) -> None:
    """Add conservation of momentum for joints without effort that turn on the ground, if nothing else acts on them.

    Args:
        mobility: assumptions about the base; they are extended.
        robot: the robot.
    """
    if mobility.base != "fixed" or mobility.constraints:  # forces of other rows would change the momentum
        return
    for name in robot.joint_names:
        if name in mobility.without_effort and robot.model.parents[robot.joint_id(name)] == 0:
            entry = {"momentum": name}
            with suppress(ConstraintError):  # gravity acts along it: then it is not conserved
                constraint_of(entry).bind(robot)
                mobility.constraints.append((entry, "turns freely, and the robot starts at rest"))
                mobility.vertical.append({"joint": name})
