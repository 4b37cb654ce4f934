"""Basic controllers: no input, computed torque, feedback of the state, and feedback of the reducing outputs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy import ndarray as Array

from rnc_pin.control.controller import (
    Command,
    DescribedMixin,
    Description,
    KinematicController,
    VelocityTarget,
    check_size,
    check_target,
    command_towards,
    goals_at,
    listed,
)
from rnc_pin.control.feedback import Feedback, deviation
from rnc_pin.errors import ConfigurationError, place_of
from rnc_pin.model.evaluation_results import Measurement
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.printing import ReprMixin
from rnc_pin.references.reference import Reference

if TYPE_CHECKING:  # a run without linear feedback starts without it
    from rnc_pin.analysis.linearization import Linearization


class ZeroInput(DescribedMixin):
    """All actuator inputs are zero, and no output has a goal.

    Args:
        reduced: the model.

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> actuators = [rnc.FrameForce("sleigh", "x"), rnc.FrameTorque("sleigh", "z")]
        >>> system = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")], actuators)
        >>> reduced = system.reduce([rnc.FrameSpeed("sleigh"), rnc.FrameYaw("sleigh")])
        >>> controller = rnc.control.ZeroInput(reduced)
        >>> run = rnc.simulate(reduced, controller, robot.configuration(), 0.1, dt=0.01, v2_0=[0.5, 0.0])
        >>> run.v2[-1].round(6) + 0.0  # straight on at constant speed
        array([0.5, 0. ])
    """

    def __init__(self, reduced: ReducedModel) -> None:
        # One array for all samples, so nobody may write into it.
        self.inputs = np.zeros(reduced.p)
        self.inputs.setflags(write=False)

    def initial_state(self, measurement: Measurement) -> None:
        """Return None: the controller has no state.

        Args:
            measurement: first measurement.
        """

    def step(self, t: float, measurement: Measurement, state: None = None) -> tuple[Command, None]:
        return Command(T=self.inputs), None


class ComputedTorque(DescribedMixin):
    """``F = H (v2d_dot + k (v2d - v2)) + V v2 + G``: the velocity error decays as exp(-k t).

    Unlike the adaptive trackers, it reads the model. Reads from the measurement: ``q, v2``, and the quantities that its
    kinematic controller reads.

    Args:
        reduced: the model.
        target: kinematic controller that computes ``v2d`` and its rate.
        k: [1/s]; a number or one for each output.

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> actuators = [rnc.FrameForce("sleigh", "x"), rnc.FrameTorque("sleigh", "z")]
        >>> system = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")], actuators)
        >>> reduced = system.reduce([rnc.FrameSpeed("sleigh"), rnc.FrameYaw("sleigh")])
        >>> target = rnc.control.ReducingOutputController(reduced, rnc.planning.Hold([1.0, 0.0]), k2=2.0)
        >>> controller = rnc.control.ComputedTorque(reduced, target, k=20.0)
        >>> state = reduced.at(robot.configuration(), np.zeros(2))
        >>> measurement = state.measure(np.zeros(2))
        >>> command, _ = controller.step(0.0, measurement, controller.initial_state(measurement))
        >>> np.linalg.solve(state.H, command.F).round(6)  # the acceleration k k2 e
        array([40.,  0.])
    """

    described = ("k", "target")

    def __init__(self, reduced: ReducedModel, target: KinematicController, k: float | Array = 20.0) -> None:
        check_target(target)
        self._reduced, self.target, self.k = reduced, target, k

    def initial_state(self, measurement: Measurement) -> object:
        """Return the initial state of the kinematic controller.

        Args:
            measurement: first measurement.
        """
        return self.target.initial_state(measurement)

    def step(self, t: float, measurement: Measurement, state: object) -> tuple[Command, object]:
        target, state = self.target.step(t, measurement, state)
        rate = target.v2_dot + self.k * (target.v2 - measurement.v2)
        # H a + V v2 + G in one call: the reduced force of the wanted acceleration.
        F = self._reduced.inverse_dynamics(measurement.q, measurement.v2, rate, t=t)
        return command_towards(target, F), state


class StateFeedback(ReprMixin):
    """``T = T_0 - K x``, x the deviation from the linearised motion, or from a reference.

    The controller uses the model, which gives T_0 and K. It suits systems with fewer actuators than velocities, near
    the linearised motion. A reference of a quasi-velocity changes the rate only, because its integral is not a state.

    Reads from the measurement ``q, v2``, and ``x2`` of outputs with a reference. One state at a time.

    Args:
        linear: the linearization.
        K: the gain (p, s), e.g. from ``rnc.lqr``.
        reference: of some reducing outputs; it replaces their values in the linearised motion.
        outputs: names of these; all reducing outputs by default.

    Raises:
        ConfigurationError: K or the reference has the wrong size, or neither an output nor its rate is a state.

    Example:
        >>> robot = rnc.Robot.from_urdf("wheeled_pendulum.urdf", base="planar")
        >>> wheels = [rnc.RollingWheel("left_wheel", 0.1), rnc.RollingWheel("right_wheel", 0.1)]
        >>> system = rnc.NonholonomicSystem(robot, wheels, ["left_axle", "right_axle"])
        >>> reduced = system.reduce([rnc.FrameSpeed("base"), rnc.JointPosition("pitch"), rnc.FrameYaw("base")])
        >>> upright = robot.configuration()
        >>> linear = rnc.linearize(reduced, upright, coordinates=["pitch"], rates=["base_speed_x", "pitch"])
        >>> controller = rnc.control.StateFeedback(linear, rnc.lqr(linear, {"pitch": 10.0, "base_speed_x": 1.0}))
        >>> run = rnc.simulate(reduced, controller, robot.configuration({"pitch": 0.1}), 2.0, dt=0.02)
        >>> bool(abs(reduced.at(run.q[-1]).outputs()[1][1]) < 0.01)  # it stands up again
        True
    """

    def __init__(
        self, linear: Linearization, K: Array, reference: Reference | None = None, outputs: Sequence[str] | None = None
    ) -> None:
        self.linear, self.K, self.reference = linear, np.asarray(K, float), reference
        if self.K.shape != linear.B.T.shape:
            raise ConfigurationError(f"the gain has shape {self.K.shape}, expected {linear.B.T.shape}")
        reducing, states = linear.reducing, linear.state_names
        self.outputs = (reducing.names if outputs is None else tuple(outputs)) if reference is not None else ()
        self._of = np.array([place_of(name, reducing.names, "no reducing output") for name in self.outputs], dtype=int)
        self._coordinates = reducing.coordinates.choose(self._of)
        quasi = [reducing.quasi[i] for i in self._of]  # they have their own names, unless coordinates have these
        rates = [n if quasi[k] and f"{n}_dot" not in states else f"{n}_dot" for k, n in enumerate(self.outputs)]
        # A quasi-velocity has no coordinate: only its rate can be a state.
        values = ["" if quasi[k] else name for k, name in enumerate(self.outputs)]
        self._values = [(k, states.index(name)) for k, name in enumerate(values) if name in states]
        self._rates = [(k, states.index(name)) for k, name in enumerate(rates) if name in states]
        if reference is not None:
            check_size(reference, len(self.outputs), "state feedback's")
        for k, name in enumerate(self.outputs):
            # A reference of an output that is no state would change nothing, and nothing would tell.
            if k not in {place for place, _ in (*self._values, *self._rates)}:
                raise ConfigurationError(
                    f"neither '{name}' nor its rate is a state, expected one of {', '.join(states)}"
                )

    def describe(self) -> Description:
        """Return the gain with the names of its states, and the inputs T_0."""
        numbers = {"K": listed(self.K), "T": listed(self.linear.T), "v2": listed(self.linear.v2)}
        return {"type": type(self).__name__, "states": list(self.linear.state_names), **numbers}

    def initial_state(self, measurement: Measurement) -> None:
        """Return None: the controller has no state.

        Args:
            measurement: first measurement.
        """

    def step(self, t: float, measurement: Measurement, state: None = None) -> tuple[Command, None]:
        linear = self.linear
        x = linear.deviation(measurement.q, measurement.v2)
        v2_desired, x2_desired = linear.v2, None
        if self.reference is not None:
            point, of, v2 = self.reference.at(t), self._of, measurement.v2
            seen = deviation(self._coordinates, point, measurement.x2[of], v2[of])
            for k, place in self._values:
                # The error is the goal minus the value, a deviation is the value minus the goal.
                x[place] = -seen.error[k]
            for k, place in self._rates:
                x[place] = -seen.error_rate[k]
            known = [k for k, _ in self._values]  # for the other outputs only the rate matters
            x2_desired = goals_at(point.position[known], of[known], v2.shape)
            # A copy: the linearization keeps its own.
            v2_desired = linear.v2.copy()
            v2_desired[of] = seen.velocity
        return Command(T=linear.T - self.K @ x, v2_desired=v2_desired, x2_desired=x2_desired), None


class ReducingOutputController(DescribedMixin):
    """``v2d = x2d_dot + k2 (x2d - x2)``: every reducing output follows a reference of its own.

    The vertical outputs follow from the constraints. Reads from the measurement: ``x1, x2, v2``.

    Args:
        reduced: model that defines the outputs.
        reference: of x2.
        k2: [1/s]; a number or one for each output.
        monitored: indices in x1 and reference of vertical outputs, which follow without control; for the
            record only.

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> actuators = [rnc.FrameForce("sleigh", "x"), rnc.FrameTorque("sleigh", "z")]
        >>> system = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")], actuators)
        >>> reduced = system.reduce([rnc.FrameSpeed("sleigh"), rnc.FrameYaw("sleigh")])
        >>> controller = rnc.control.ReducingOutputController(reduced, rnc.planning.Hold([1.0, 0.0]), k2=2.0)
        >>> measurement = reduced.at(robot.configuration(), np.zeros(2)).measure(np.zeros(2))
        >>> target, state = controller.step(0.0, measurement, controller.initial_state(measurement))
        >>> target.v2  # k2 times the error
        array([2., 0.])
    """

    described = ("k2",)

    def __init__(
        self,
        reduced: ReducedModel,
        reference: Reference,
        k2: float | Array = 2.0,
        monitored: tuple[Array, Reference] | None = None,
    ) -> None:
        check_size(reference, reduced.r, "reducing")
        self.monitored = monitored
        self.reference, self.k2 = reference, k2
        self._feedback = Feedback(reduced.reducing.coordinates, k2)

    def initial_state(self, measurement: Measurement) -> None:
        """Return None: the controller has no state.

        Args:
            measurement: first measurement.
        """

    def step(self, t: float, measurement: Measurement, state: None = None) -> tuple[VelocityTarget, None]:
        desired = self.reference.at(t)
        x1 = None
        # For the record only: no rate depends on x1 here.
        if self.monitored is not None:
            x1 = goals_at(self.monitored[1].at(t).position, self.monitored[0], measurement.x1.shape)
        v2, v2_dot = self._feedback(desired, measurement.x2, measurement.v2)
        x2 = goals_at(desired.position, slice(None), measurement.x2.shape)  # states of a batch share one reference
        return VelocityTarget(v2=v2, v2_dot=v2_dot, x1=x1, x2=x2), None
