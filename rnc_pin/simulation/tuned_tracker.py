"""Velocity tracker with gains scaled to the inertia along its reference."""

from __future__ import annotations

import numpy as np

from rnc_pin.control import GainDesign, KinematicController, VelocityTracker, design_velocity_gains
from rnc_pin.control.typical_inertia import gravity_loads
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.simulation.rollout import kinematic_rollout

_DESIGN, _STEP = GainDesign(), 0.05  # [s], of the roll-out


def tuned_tracker(
    reduced: ReducedModel,
    kinematic: KinematicController,
    q0: np.ndarray,
    duration: float,
    dt: float = 0.002,
    *,
    along: KinematicController | None = None,
    design: GainDesign = _DESIGN,
    gravity_compensation: bool | None = None,
) -> VelocityTracker:
    """Construct the adaptive velocity tracker of a kinematic controller, for ``simulate``.

    A kinematic roll-out, without dynamics, gives the configurations of the motion. The gains are scaled to the inertia
    at these configurations. The tracker itself does not use the model.

    Args:
        reduced: reduced model.
        kinematic: kinematic controller that gives the desired velocities.
        q0: initial configuration (nq,).
        duration: duration of the roll-out [s]; use that of the references.
        dt: sampling period [s], the same as for ``simulate``.
        along: kinematic controller for the roll-out instead of ``kinematic``, if that one is adaptive.
        design: choice of the gains; scaled to the inertia by default.
        gravity_compensation: True starts the tracker with the force that holds the system at rest at q0, as the
            actuators would report it. This is the default where gravity loads the outputs.

    Raises:
        InfeasibleError: no gains fit both the inertia and the sampling.
        SingularityError: the references reach a singular configuration; the error has the time.

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
    times, region = kinematic_rollout(reduced, along or kinematic, q0, duration, _STEP)
    gains = design_velocity_gains(reduced, region, dt, design, times=times)
    if gravity_compensation is None:
        gravity_compensation = gravity_loads(reduced, q0)
    rest = np.zeros(reduced.r)
    force = reduced.inverse_dynamics(q0, rest, rest) if gravity_compensation else None
    return VelocityTracker(kinematic, gains, force)
