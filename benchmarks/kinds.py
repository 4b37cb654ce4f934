"""Cost of rows and forces by kind, beside bare Pinocchio calls.

Small systems, each with one kind of constraint or force that other systems lack: bodies that roll on planes, on moving
ground and in a bowl, prescribed motion, and forces that follow from the state. The columns are those of
``python -m benchmarks.reduction``; *free motion* is the processor time for 0.1 s of ``rnc.free_motion``.
``--json`` prints JSON in place of the table. ``RNC_PIN_KERNEL=numpy`` measures NumPy.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from dataclasses import asdict, dataclass

import rnc_pin as rnc
from benchmarks.reduction import bare_calls, derivatives, machine, of_batch, one_state, terms
from benchmarks.states import States, regular_states
from benchmarks.timing import Measurement, in_turn, used_by

ROUNDS, STATES = 5, 32
_DURATION = 0.1  # of the free motion [s]


@dataclass(frozen=True)
class KindCost:
    """Costs of one system.

    Attributes:
        kind: name of the system.
        bare_us: the bare calls at a state [us].
        one_state, of_batch, terms, derivatives: times of a state [us]; NaN without the quantity.
        free_motion_ms: 0.1 s of free motion [ms].
    """

    kind: str
    bare_us: float
    one_state: float
    of_batch: float
    terms: float
    derivatives: float
    free_motion_ms: float


def body(shape: object, **more: object) -> rnc.ReducedModel:
    """Rigid body that rolls."""
    robot = rnc.Robot.from_urdf("rolling_ball.urdf", base="free")
    return rnc.NonholonomicSystem(robot, [rnc.RollingBody("ball", shape, at=(0.0, 0.01, 0.02), **more)]).reduce()


def wheel(ground: rnc.GroundPlane) -> rnc.ReducedModel:
    """Disk on a plane."""
    robot = rnc.Robot.from_urdf("rolling_disk.urdf", base="free")
    return rnc.NonholonomicSystem(robot, [rnc.RollingWheel("disk", 0.3, "y", ground=ground)]).reduce()


def ball(ground: object) -> rnc.ReducedModel:
    """Ball on ground of its own."""
    robot = rnc.Robot.from_urdf("rolling_ball.urdf", base="free")
    return rnc.NonholonomicSystem(robot, [rnc.RollingBall("ball", 0.2, ground=ground)]).reduce()


def on_plate() -> rnc.ReducedModel:
    """Ball on a plate of the robot."""
    robot = rnc.Robot.from_urdf("ball_on_plate.urdf")
    rolls = rnc.RollingBall("ball", 0.05, ground=rnc.GroundPlane(frame="plate"))
    return rnc.NonholonomicSystem(robot, [rolls], ["roll", "pitch"]).reduce()


def arm(forces: list[object], driven: bool = False) -> rnc.ReducedModel:
    """Arm on wheels with forces, or with a joint that moves as prescribed."""
    robot = rnc.Robot.from_urdf("mobile_manipulator.urdf", base="planar")
    rows: list[object] = [rnc.NoSideSlip("axle")]
    if driven:
        swing = rnc.planning.Harmonic([0.1], amplitude=[0.3], frequency=0.5)
        rows.append(rnc.PrescribedMotion(rnc.JointPosition("joint_2"), swing))
    drives = [rnc.FrameForce("base", "x"), rnc.FrameTorque("base", "z"), "joint_1", "joint_2"]
    return rnc.NonholonomicSystem(robot, rows, drives, forces=forces).reduce()


TURNTABLE = rnc.GroundPlane(spin=1.3, point=(0.2, -0.1, 0.0))
SLOPE = rnc.GroundPlane(normal=(0.2, -0.3, 1.0), point=(0.1, 0.2, 0.3))
HAND = rnc.FramePosition("tip", "xy")
SYSTEMS: dict[str, Callable[[], rnc.ReducedModel]] = {
    "ellipsoid on a plane": lambda: body(rnc.Ellipsoid((0.3, 0.2, 0.15))),
    "sphere on a plane": lambda: body(rnc.Sphere(0.2)),
    "torus on a plane": lambda: body(rnc.Torus(0.3, 0.05, "y")),
    "ellipsoid on a turntable": lambda: body(rnc.Ellipsoid((0.3, 0.2, 0.15)), ground=TURNTABLE),
    "ball on a turntable": lambda: ball(TURNTABLE),
    "wheel on a slope": lambda: wheel(SLOPE),
    "wheel on a turntable": lambda: wheel(TURNTABLE),
    "ball in a bowl": lambda: ball(rnc.SphericalGround(1.0, (0.0, 0.0, 1.0))),
    "ball on a plate of the robot": on_plate,
    "prescribed motion": lambda: arm([], driven=True),
    "no force": lambda: arm([]),
    "spring of a joint": lambda: arm([rnc.forces.Spring(rnc.JointPosition("joint_1"), 40.0, 0.3)]),
    "spring between frames": lambda: arm([rnc.forces.Spring(rnc.Distance("base", "tip"), 40.0, 0.3)]),
    "damper of a frame": lambda: arm([rnc.forces.Damper(rnc.FrameSpeed("base"), 3.0)]),
    "friction of a frame": lambda: arm([rnc.forces.SmoothFriction(HAND, 2.0, 0.4)]),
    "wrench in own axes": lambda: arm([rnc.forces.Wrench("tip", (1.0, 0.0, 0.5), axes="own")]),
}


def costs(name: str, rounds: int = ROUNDS) -> KindCost:
    """Costs of one of ``SYSTEMS``; if it depends on time, those of states at the start."""
    reduced = SYSTEMS[name]()
    at_start = reduced.frozen(0.0) if reduced.rheonomic else reduced
    start = reduced.robot.configuration()
    states = regular_states(at_start, start, STATES)
    measures: list[Callable[[rnc.ReducedModel, States], Measurement]] = [
        bare_calls,
        one_state,
        of_batch,
        terms,
        derivatives,
    ]
    measurements = [each(at_start, states) for each in measures]
    found = in_turn([*measurements, free_motion(reduced, states)], rounds)
    *times, run = (float(each[0]) * 1e6 for each in found)
    return KindCost(name, *times, run / 1e3)


def free_motion(reduced: rnc.ReducedModel, states: States) -> Measurement:
    """Free motion from the first state."""
    q, v2 = states.q[0], states.v2[0]
    return used_by(lambda: rnc.free_motion(reduced, q, v2, _DURATION, _DURATION), 1)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.kinds", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--rounds", type=int, default=ROUNDS, metavar="N", help="default: %(default)s")
    parser.add_argument("--json", action="store_true", help="print JSON")
    given = parser.parse_args()
    found = [costs(name, given.rounds) for name in SYSTEMS]
    if given.json:
        print(json.dumps({"kinds": [asdict(each) for each in found], "kernel": rnc.kernel, "machine": machine()}))
        return
    print("| kind | bare calls | one state | of a batch | terms | derivatives | free motion |")
    print("|---|---|---|---|---|---|---|")
    for each in found:
        ratios = (each.one_state, each.of_batch, each.terms, each.derivatives)
        shown = " | ".join(f"{value / each.bare_us:.1f} x" for value in ratios)
        print(
            f"| {each.kind} | {each.bare_us:.1f} us | {shown} | {each.free_motion_ms:.2f} ms |".replace(
                "nan x", ""
            ).replace("nan ms", "")
        )
    print(f"kernel {rnc.kernel}, {', '.join(f'{name} {value}' for name, value in machine().items())}")


if __name__ == "__main__":
    main()
