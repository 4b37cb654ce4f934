"""Linear feedback of the state about an equilibrium or a steady motion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rnc_pin.analysis.linearization import Linearization
from rnc_pin.control.controller import Command, Description, check_size, goals_at, listed
from rnc_pin.control.deviation import deviation
from rnc_pin.errors import ConfigurationError, nearest
from rnc_pin.model.measurement import Measurement
from rnc_pin.planning.references import Reference
from rnc_pin.printing import ReprMixin


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
        self,
        linear: Linearization,
        K: np.ndarray,
        reference: Reference | None = None,
        outputs: Sequence[str] | None = None,
    ) -> None:
        self.linear, self.K, self.reference = linear, np.asarray(K, float), reference
        if self.K.shape != linear.B.T.shape:
            raise ConfigurationError(f"the gain has shape {self.K.shape}, expected {linear.B.T.shape}")
        reducing, states = linear.reducing, linear.state_names
        self.outputs = (reducing.names if outputs is None else tuple(outputs)) if reference is not None else ()
        for name in self.outputs:
            if name not in reducing.names:
                raise ConfigurationError(f"no reducing output '{name}'{nearest(name, reducing.names)}")
        self._of = np.array([reducing.names.index(name) for name in self.outputs], dtype=int)
        self._coordinates = reducing.coordinates.choose(self._of)
        rates = [name if reducing.quasi[i] else f"{name}_dot" for name, i in zip(self.outputs, self._of, strict=True)]
        values = [name if not reducing.quasi[i] else "" for name, i in zip(self.outputs, self._of, strict=True)]
        self._values = [(k, states.index(name)) for k, name in enumerate(values) if name in states]
        self._rates = [(k, states.index(name)) for k, name in enumerate(rates) if name in states]
        if reference is not None:
            check_size(reference, len(self.outputs), "state feedback's")
        for k, name in enumerate(self.outputs):
            if k not in {place for place, _ in (*self._values, *self._rates)}:
                raise ConfigurationError(
                    f"neither '{name}' nor its rate is a state, expected one of {', '.join(states)}"
                )

    def describe(self) -> Description:
        """Return the gain with the names of its states, and the inputs T_0."""
        return {
            "type": type(self).__name__,
            "states": list(self.linear.state_names),
            "K": listed(self.K),
            "T": listed(self.linear.T),
            "v2": listed(self.linear.v2),
        }

    def initial_state(self, measurement: Measurement) -> None:
        """Return None: the controller has no state."""

    def step(self, t: float, measurement: Measurement, state: None = None) -> tuple[Command, None]:
        linear = self.linear
        x = linear.deviation(measurement.q, measurement.v2)
        v2_desired, x2_desired = linear.v2, None
        if self.reference is not None:
            point, of, v2 = self.reference.at(t), self._of, measurement.v2
            seen = deviation(self._coordinates, point, measurement.x2[of], v2[of])
            for k, place in self._values:
                x[place] = -seen.error[k]
            for k, place in self._rates:
                x[place] = -seen.error_rate[k]
            known = [k for k, _ in self._values]  # for the other outputs only the rate matters
            x2_desired = goals_at(point.position[known], of[known], v2.shape)
            v2_desired = linear.v2.copy()
            v2_desired[of] = seen.velocity
        return Command(T=linear.T - self.K @ x, v2_desired=v2_desired, x2_desired=x2_desired), None
