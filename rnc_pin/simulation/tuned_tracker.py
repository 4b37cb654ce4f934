"""A velocity tracker with gains that suit the way it will go."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rnc_pin.control import KinematicController, VelocityGains, VelocityTracker
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.simulation.rollout import kinematic_rollout


def tuned_tracker(
    reduced: ReducedModel,
    kinematic: KinematicController,
    q0: np.ndarray,
    duration: float,
    dt: float = 0.002,
    *,
    along: KinematicController | None = None,
    step: float = 0.05,
    bandwidth: float | None = None,
    adaptation: float = 1.0,
    held: bool = False,
    delay: float = 0.0,
    dead_zone: float | np.ndarray = 0.0,
) -> VelocityTracker:
    """The adaptive velocity tracker over a kinematic controller, ready for ``simulate``.

    The kinematics are rolled out first, without dynamics; the gains are scaled to the inertia met on the way. The
    tracker itself reads nothing of the model.

    Args:
        reduced: the model.
        kinematic: what wants velocities.
        q0: initial configuration (nq,).
        duration: of the roll-out [s], as long as the references move.
        dt: sampling period that the gains are for [s], that of ``simulate``.
        along: another kinematic controller to roll out, where ``kinematic`` has yet to learn its way.
        step: of the roll-out [s].
        bandwidth: of the velocity loop [rad/s]; by default the largest that the sampling allows.
        adaptation: how fast it adapts, ``beta / k`` [1/s]; 30 where gravity is large for what it acts on.
        held: tell the tracker what its actuators hold up at the start, as they would report at rest.
        delay: from a measurement until a force answers it, sampling apart [s]: it bounds the bandwidth.
        dead_zone: velocity error below which nothing is learnt; a number, or one for each reducing output.

    Raises:
        InfeasibleError: no gains suit both the inertia and the sampling.
        SingularityError: the references lead through a singular configuration, with the time.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")], robot.joint_names[1:])
        >>> reduced = system.reduce([rnc.JointPosition(f"joint_{k}") for k in (1, 2, 3)])
        >>> swing = rnc.planning.MinimumJerk(np.zeros(3), [0.5, 0.0, 0.0], duration=1.0)
        >>> target = rnc.control.ReducingOutputController(reduced, swing)
        >>> tracker = rnc.tuned_tracker(reduced, target, robot.configuration(), duration=1.0)
        >>> run = rnc.simulate(reduced, tracker, robot.configuration(), duration=1.2)
        >>> bool(abs(run.x2[-1, 0] - 0.5) < 0.01)
        True
    """
    _, region = kinematic_rollout(reduced, along or kinematic, q0, duration, step)
    gains = VelocityGains.scaled(reduced, region, dt, bandwidth, adaptation=adaptation, delay=delay)
    gains = replace(gains, dead_zone=dead_zone)
    rest = np.zeros(reduced.r)
    return VelocityTracker(kinematic, gains, reduced.inverse_dynamics(q0, rest, rest) if held else None)
