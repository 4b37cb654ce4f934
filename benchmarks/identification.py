"""Inertial identification: base parameters of a free-flying arm from its motion, and efforts of a real arm.

    python -m benchmarks identification

The arm of TIAGo is measured if its log is there: ``../shared/data/logs/tiago``, or the folder in RNC_PIN_LOGS.
"""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np
import pinocchio as pin

import rnc_pin as rnc
from measured_logs import MEASURED
from rnc_pin.identification import (
    BodyInertia,
    CoulombFriction,
    EffortOffset,
    EffortScale,
    Identification,
    ViscousFriction,
)
from rnc_pin.identification.logs import Channel
from rnc_pin.identification.reduced_regressor import BaseParameters

JOINTS = ("torso_lift_joint", *(f"arm_{k}_joint" for k in range(1, 8)))
"""Joints of TIAGo that the log contains."""
PRIOR = 0.1
"""Relative standard deviation of the second moments of mass in TIAGo's file."""
WINDOW = 0.16
"""Duration over which efforts are averaged [s]."""
ARM = ("arm_1", "arm_2", "arm_3")


def random_inertia(mass: float, generator: np.random.Generator) -> pin.Inertia:
    """Inertia of a body with random principal axes and radii of gyration of 5 to 20 cm."""
    axes = np.linalg.qr(generator.normal(size=(3, 3)))[0]
    a, b, c = mass * generator.uniform(0.05, 0.2, 3) ** 2
    return pin.Inertia(mass, generator.uniform(-0.1, 0.1, 3), axes @ np.diag([b + c, a + c, a + b]) @ axes.T)


def arm(changed: int | None = None, base: bool = True) -> rnc.Robot:
    """An arm of three joints, on a free-flying base without gravity or on the ground.

    Args:
        changed: seed of changed masses, centers and moments; None for the true ones.
        base: True for the free-flying base.
    """
    generator, model = np.random.default_rng(0), pin.Model()
    parent = 0
    if base:
        model.gravity = pin.Motion.Zero()
        parent = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root_joint")
        model.appendBodyToJoint(parent, random_inertia(20.0, generator), pin.SE3.Identity())
        tracker = pin.SE3(pin.exp3(np.array([0.3, 0.5, -0.2])), np.array([0.1, 0.2, 0.3]))
        model.addFrame(pin.Frame("tracker", parent, 0, tracker, pin.FrameType.OP_FRAME))
    kinds = (pin.JointModelRZ, pin.JointModelRY, pin.JointModelRX)
    places = ((0.3, 0.0, 0.1), (0.0, 0.1, 0.3), (0.4, 0.0, 0.0))
    for name, kind, place, mass in zip(ARM, kinds, places, (4.0, 3.0, 2.0), strict=True):
        parent = model.addJoint(parent, kind(), pin.SE3(np.eye(3), np.array(place)), name)
        model.appendBodyToJoint(parent, random_inertia(mass, generator), pin.SE3.Identity())
    if changed is not None:
        draw = np.random.default_rng(changed)
        for k in range(1, model.njoints):
            at = model.inertias[k]
            by = draw.uniform(0.7, 1.4, 2)
            model.inertias[k] = pin.Inertia(
                by[0] * at.mass, at.lever + draw.uniform(-0.03, 0.03, 3), by[1] * at.inertia
            )
    return rnc.Robot(model)


def floating(robot: rnc.Robot) -> rnc.NonholonomicSystem:
    """The free-flying arm, whose momentum is zero."""
    return rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("root_joint")], ARM)


def floating_log(noise: float = 0.0, seed: int = 0, samples: int = 400) -> rnc.Log:
    """Log of the true free-flying arm: joints, and pose and twist of a tracker on its base.

    Args:
        noise: standard deviation of all velocities [rad/s and m/s].
        seed: seed of the noise.
        samples: number of samples.
    """
    robot, draw = arm(), np.random.default_rng(seed)
    reduced = floating(robot).reduce([rnc.JointPosition(name) for name in ARM])
    times = 0.02 * np.arange(samples)
    rate, size = 2 * np.pi * np.array([0.31, 0.47, 0.67]), np.array([1.2, 1.0, 1.1])
    q, configurations, velocities = robot.configuration(), [], []
    for t in times:
        v = reduced.at(q, size * rate * np.cos(rate * t)).v
        configurations.append(q)
        velocities.append(v)
        q = pin.integrate(robot.model, q, 0.02 * v)  # momentum holds at each state, however the next one is found
    moved = np.array(velocities)
    moved = moved + noise * draw.normal(size=moved.shape)
    log = rnc.Log.of_motion(robot, times, np.array(configurations), moved, frames=["tracker"])
    place = robot.model.frames[robot.frame_id("tracker")].placement.inverse()
    twist = Channel("twist", "tracker", times, moved[:, :6] @ place.toActionMatrix().T)
    return log.joined(rnc.Log([twist]))


def base_parameters(robot: rnc.Robot) -> BaseParameters:
    """Base parameters of the whole dynamics, by Pinocchio's regressor at random states."""
    draw, model = np.random.default_rng(3), robot.model
    data = model.createData()
    states = [(robot.random_configuration(draw), *draw.normal(size=(2, robot.nv))) for _ in range(80)]
    columns = np.vstack([pin.computeJointTorqueRegressor(model, data, *each) for each in states])
    return BaseParameters.of(columns, [str(k) for k in range(columns.shape[1])])


def parameters(robot: rnc.Robot) -> np.ndarray:
    """Dynamic parameters of all bodies."""
    return np.concatenate([each.toDynamicParameters() for each in list(robot.model.inertias)[1:]])


def floating_error() -> tuple[int, float, float]:
    """Base parameters of the free-flying arm; largest error of the file and of the estimate, at the true mass."""
    true = parameters(arm())
    base = base_parameters(arm())
    errors = []
    for robot in (arm(1), rnc.identify(floating(arm(1)), floating_log()).system.robot):
        found = parameters(robot)
        errors.append(float(np.abs(base.K @ (found * true[::10].sum() / found[::10].sum() - true)).max()))
    return len(base.names), *errors


def tiago_log() -> rnc.Log:
    """The measured log of TIAGo's torso and arm."""
    logs = []
    for quantity in ("position", "velocity", "effort"):
        joints = {name: {quantity: f"- {name}_{quantity}"} for name in JOINTS}
        mapping = {"separator": "comma", "time": "t", "joints": joints}
        logs.append(rnc.Log.read(MEASURED / "tiago" / f"tiago_{quantity}.csv", mapping))
    return logs[0].joined(logs[1]).joined(logs[2])


def tiago_system() -> rnc.NonholonomicSystem:
    """TIAGo on its base at rest, other joints locked at zero."""
    names = rnc.Robot.from_example("tiago").joint_names
    robot = rnc.Robot.from_example("tiago", lock={name: 0.0 for name in names if name not in JOINTS})
    return rnc.NonholonomicSystem(robot, (), JOINTS)


def tiago(bodies: bool = True) -> Identification:
    """Fit of the first half of TIAGo's log.

    The gravity of the torso is constant, so that its scale is not known apart from its offset: it is not asked.

    Args:
        bodies: False to fit scales and offsets of the efforts alone, with the inertias of the file.
    """
    kinds = (*((BodyInertia, CoulombFriction, ViscousFriction) if bodies else ()), EffortScale, EffortOffset)
    unknown = [kind(name) for kind in kinds for name in JOINTS]
    unknown.remove(EffortScale("torso_lift_joint"))
    return rnc.identify(tiago_system(), tiago_log(), unknown, prior=PRIOR, held_out=0.5, window=WINDOW)


def better(found: Identification, joints: Sequence[str] = JOINTS) -> list[str]:
    """Joints whose held out effort is predicted better than by the file and by a constant."""
    errors = found.held_out
    return [name for name in joints if errors[name].fit < min(errors[name].file, errors[name].constant)]


def main() -> None:
    """Print what was measured."""
    count, before, after = floating_error()
    print(f"free-flying arm, momentum alone: {count} base parameters; largest error before and after: {before:.2g}, "
          f"{after:.1e} [kg, kg m, kg m^2]; the mass of the robot has to be known")  # fmt: skip
    if not (MEASURED / "tiago").is_dir():
        print(f"the log of TIAGo is not in {MEASURED}")
        return
    begin = time.process_time()
    found = tiago()
    print(f"TIAGo, fit of the first half: {time.process_time() - begin:.0f} s of processor time")
    print(f"effort of the second half, averaged over {WINDOW} s, root mean square error in the unit of the driver:")
    scaled = tiago(bodies=False)
    for name in JOINTS:
        print(f"  {name}: {found.held_out[name]}, file with fitted scale and offset {scaled.held_out[name].fit:.3g}")
    print(f"better than the file and a constant: {len(better(found))} of {len(JOINTS)} joints")


if __name__ == "__main__":
    main()
