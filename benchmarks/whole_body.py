"""Processor time of one sample of whole-body control: 10 tasks, 14 joints, all limits of the file, 20 pairs of links.

The last line is one sample of ``rnc-pin drive tiago``: commands, program, computed torque, plant and record.

``python -m benchmarks whole_body peers`` times an arm beside placo and TSID. ``ticks`` prints the thread time of a
sample with verified braking motions, the least of rounds: scenarios, a cart with friction, obstacles around a hand.
"""

from __future__ import annotations

import sys
import time

import coal
import numpy as np
import pinocchio as pin

import rnc_pin as rnc
from benchmarks.whole_body_peers import whole_body_peers
from rnc_pin.applications.drive.commands import LoggedCommand, parse_command
from rnc_pin.applications.drive.preparation import prepare_drive, read_source
from rnc_pin.applications.drive.run import drive
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.collision import CollisionDistances, Obstacle
from rnc_pin.control import InverseDynamicsQP, VelocityQP, limits, tasks
from rnc_pin.motion.planning import Harmonic, Hold
from rnc_pin.motion.whole_body.braking_motion import BrakingState

SAMPLES, ROUNDS, DT, TICKS = 200, 5, 0.002, 300
PAIRS = 20  # least number of active pairs at the start


def model() -> rnc.ReducedModel:
    """TIAGo with two wheels, torso, arm and head: 12 reduced velocities, 14 joints without its planar base."""
    robot = rnc.Robot.from_example("tiago_no_hand", base="planar")
    wheels = ["wheel_left_joint", "wheel_right_joint"]
    arm = [name for name in robot.joint_names if name not in ("root_joint", *wheels)]
    rolling = [rnc.RollingWheel(f"wheel_{side}_link", 0.0985) for side in ("left", "right")]
    system = rnc.NonholonomicSystem(robot, rolling, [*wheels, *arm])
    return system.reduce([rnc.FrameSpeed("base_link"), rnc.FrameYaw("base_link"), *map(rnc.JointPosition, arm)])


def wanted(start: np.ndarray) -> list[tasks.ControlTask]:
    """Ten tasks of the common kinds."""
    swing = Harmonic(start, [0.3, 0.3, 0.2], 0.4)
    hand = "arm_7_link"
    return [
        tasks.OutputTask(rnc.FramePosition(hand), swing, gain=5.0),
        tasks.OutputTask(rnc.FrameOrientation(hand), Hold(np.zeros(3)), weight=0.1),
        tasks.PostureTask({"head_1_joint": 0.3, "head_2_joint": -0.4}, weight=0.2),
        tasks.OutputTask(rnc.FrameYaw("base_link"), Hold([0.0]), weight=0.1),
        tasks.OutputTask(rnc.FrameSpeed("base_link"), Hold([0.0]), weight=0.1),
        tasks.OutputTask(rnc.Distance("base_link", hand), Hold([0.8]), weight=0.1),
        tasks.CenterOfMassTask(Hold([0.0, 0.0]), "xy", weight=0.05),
        tasks.PostureTask({"torso_lift_joint": 0.15}, weight=0.1),
        tasks.PostureTask({f"arm_{k}_joint": 0.5 for k in range(1, 8)}, weight=0.02, priority=1),
        tasks.DampingTask(weight=0.01, priority=1),
    ]


def stepped(program: VelocityQP, reduced: rnc.ReducedModel, q0: np.ndarray, warm: bool = True) -> float:
    """Processor time of a sample [s], along a run of the ideal robot: the measurement does not count."""
    q, used = q0, 0.0
    state = program.initial_state(reduced.at(q, np.zeros(reduced.r)).measure())
    for sample in range(SAMPLES):
        here = reduced.at(q, state.v2)
        measurement = here.measure()
        given = state if warm else state._replace(multipliers=np.zeros_like(state.multipliers))
        begin = time.process_time()
        target, state = program.step(sample * DT, measurement, given)
        used += time.process_time() - begin
        q = pin.integrate(reduced.robot.model, q, DT * (here.R @ target.v2))
    return used / SAMPLES


def driven() -> tuple[float, float]:
    """Processor time of a sample of a driven TIAGo, and its period [s]. The hand has a goal and the base drives."""
    run = prepare_drive(read_source("tiago", {}), {})
    reach = {"kind": "frame_goal", "frame": "arm_tool_link", "position": [1.0, 0.3, 0.8]}
    forward = {"kind": "base_velocity", "forward": 0.5, "turn": 0.2}
    for sample, message in ((0, reach), *((sample, forward) for sample in range(10, SAMPLES, 10))):
        run.log.append(LoggedCommand(sample, parse_command(message, run.controls)))
    used: list[float] = []  # processor time at each sample [s]
    drive(run, samples=SAMPLES, watcher=lambda sample, status: used.append(time.process_time()))
    return (used[-1] - used[0]) / (SAMPLES - 1), run.scenario.experiment.simulation.dt


def _ticks(program: InverseDynamicsQP, reduced: rnc.ReducedModel, q0: np.ndarray) -> tuple[np.ndarray, BrakingState]:
    """Thread time of each tick [ms], and the samples that braked."""
    plant, used, q = rnc.ReducedPlant(reduced), np.empty(TICKS), q0
    plant.reset(q, np.zeros(reduced.n))
    state = program.initial_state(reduced.at(q, np.zeros(reduced.r)).measure())
    for sample in range(TICKS):
        q, v = plant.read()
        measurement = reduced.at(q, v=v).measure()
        begin = time.thread_time()
        command, state = program.step(sample * program.dt, measurement, state)
        used[sample] = 1e3 * (time.thread_time() - begin)
        plant.apply(np.array(command.T))
        plant.advance(program.dt)
    return used, state.braking


def _contained(name: str, frame: str) -> tuple[InverseDynamicsQP, rnc.ReducedModel, np.ndarray]:
    """An arm whose hand an obstacle contains."""
    locked = {each: 0.0 for each in rnc.Robot.from_example(name).joint_names if "wheel" in each or "finger" in each}
    robot = rnc.Robot.from_example(name, lock=locked)
    reduced = rnc.NonholonomicSystem(robot, [], robot.joint_names).reduce()
    q0 = 0.7 * robot.model.lowerPositionLimit + 0.3 * robot.model.upperPositionLimit
    at = reduced.at(q0).position.placement(robot.frame_id(frame)).translation.copy()
    near = limits.CollisionAvoidance(obstacles=[Obstacle(coal.Sphere(0.08), position=tuple(at), name="ball")], q0=q0)
    reach = tasks.OutputTask(rnc.FramePosition(frame), Hold(at + 0.2), gain=3.0)
    kept = [limits.JointPositionLimit(), limits.JointVelocityLimit(), near]
    return InverseDynamicsQP(reduced, [reach], kept, dt=0.01), reduced, q0


def ticks() -> None:
    """Print median and largest thread time of a tick."""
    cases = {name: _built_in(name, {}) for name in ("tiago-shelf", "doorway")}
    cases["doorway, friction 0.1, 5 ms"] = _built_in("doorway", {"controller.friction": 0.1, "simulation.dt": 0.005})
    for name, frame in (("panda", "panda_hand"), ("ur5_robot", "tool0"), ("tiago_no_hand", "arm_7_link")):
        cases[f"{name}, obstacle at the hand"] = _contained(name, frame)
    for name, case in cases.items():
        rounds = [_ticks(*case) for _ in range(ROUNDS)]
        used, count = np.min([each for each, _ in rounds], axis=0), rounds[0][1]
        said = f"{count.braked.samples} of {TICKS} samples braked, {count.unverified.samples} not verified"
        print(f"{name}: median {np.median(used):.1f} ms, largest {used.max():.1f} ms; {said}")


def _built_in(name: str, changes: dict[str, object]) -> tuple[InverseDynamicsQP, rnc.ReducedModel, np.ndarray]:
    made = Scenario.load(name, {"plots": {}, **changes}).build().experiment
    return made.controller, made.reduced, np.asarray(made.q0)


def main() -> None:
    """Print the time of a sample, cold and warm, or beside peers."""
    if sys.argv[1:] == ["ticks"]:
        ticks()
        return
    if sys.argv[1:] == ["peers"]:
        whole_body_peers()
        return
    reduced = model()
    q0 = reduced.robot.configuration({"arm_1_joint": 0.5, "arm_2_joint": -0.5, "arm_4_joint": 1.0})
    start = reduced.at(q0).position.placement(reduced.robot.frame_id("arm_7_link")).translation.copy()
    box = [limits.JointPositionLimit(), limits.JointVelocityLimit(), limits.AccelerationLimit(5.0)]
    distances = CollisionDistances(reduced.robot, q0=q0)
    apart = np.sort(distances.at(q0, within=1.0).distance)
    influence = max(limits.CollisionAvoidance().influence, 1.001 * apart[PAIRS - 1])
    near = limits.CollisionAvoidance(q0=q0, influence=influence)
    active = len(distances.at(q0, within=near.influence).pairs)
    cases = {"daqp": (box, True), "daqp, cold": (box, False)}
    cases[f"daqp, with collisions, {active} active pairs at the start"] = ([*box, near], True)
    for label, (given, warm) in cases.items():
        program = VelocityQP(reduced, wanted(start), given, dt=DT)
        best = min(stepped(program, reduced, q0, warm) for _ in range(ROUNDS))
        print(f"{label}: {1e6 * best:.0f} us a sample, {len(program.limit_names)} rows of limits")
    used, period = min(driven() for _ in range(ROUNDS))
    print(f"driven: {1e3 * used:.1f} ms a sample of {1e3 * period:.0f} ms, with the plant")


if __name__ == "__main__":
    main()
