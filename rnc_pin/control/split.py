"""Several controllers for one robot; each controls some of the reducing outputs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rnc_pin.control.batches import accepts_batches
from rnc_pin.control.controller import Command, Controller, Description, State, describe
from rnc_pin.errors import ConfigurationError
from rnc_pin.model.measurement import Measurement
from rnc_pin.printing import ReprMixin


class SplitController(ReprMixin):
    """Controller of several parts; each measures and commands its own reducing outputs.

    The coupling forces between the parts are disturbances. The measurement of a part has ``x2`` and ``v2`` of its own
    outputs only; all other fields are complete.

    Args:
        parts: controllers and the indices of their outputs in x2.
        r: number of reducing outputs; each has to belong to one part.

    Raises:
        ConfigurationError: an output belongs to no part, or to two.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")], robot.joint_names[1:])
        >>> reduced = system.reduce([rnc.JointPosition(f"joint_{k}") for k in (1, 2, 3)])
        >>> arm = rnc.control.PositionTracker(rnc.planning.Hold([0.1, 1.8]))
        >>> hand = rnc.control.PositionTracker(rnc.planning.Hold([0.2]))
        >>> controller = rnc.control.SplitController([(arm, [0, 1]), (hand, [2])], r=3)
        >>> measurement = reduced.at(robot.configuration({"joint_2": 1.8}), np.zeros(3)).measure()
        >>> command, state = controller.step(0.0, measurement, controller.initial_state(measurement))
        >>> command.F.round(6)  # the error of joint_3 is twice that of joint_1
        array([4., 0., 8.])
    """

    def __init__(self, parts: Sequence[tuple[Controller, np.ndarray]], r: int) -> None:
        self._parts = [(controller, np.asarray(outputs, dtype=int)) for controller, outputs in parts]
        self._r = r
        places = np.concatenate([outputs for _, outputs in self._parts])
        if sorted(places.tolist()) != list(range(r)):
            raise ConfigurationError(
                f"the parts command outputs {sorted(places.tolist())}, expected each of 0 to {r - 1} once"
            )

    @property
    def accepts_batches(self) -> bool:
        """True if all parts accept batches."""
        return all(accepts_batches(controller) for controller, _ in self._parts)

    def describe(self) -> Description:
        """Return the descriptions of the parts, and the indices of their outputs in x2."""
        parts = [{**describe(part), "outputs": outputs.tolist()} for part, outputs in self._parts]
        return {"type": type(self).__name__, "parts": parts}

    def initial_state(self, measurement: Measurement) -> tuple[State, ...]:
        """Return the initial states of the parts."""
        return tuple(controller.initial_state(_part(measurement, outputs)) for controller, outputs in self._parts)

    def step(self, t: float, measurement: Measurement, state: tuple[State, ...]) -> tuple[Command, tuple[State, ...]]:
        shape = measurement.x2.shape
        F, v2, x2 = np.empty(shape), np.full(shape, np.nan), np.full(shape, np.nan)
        x1: np.ndarray | None = None
        states = []
        for (controller, outputs), own in zip(self._parts, state, strict=True):
            command, own = controller.step(t, _part(measurement, outputs), own)
            states.append(own)
            F[..., outputs] = command.F
            if command.v2_desired is not None:
                v2[..., outputs] = command.v2_desired
            if command.x2_desired is not None:
                x2[..., outputs] = command.x2_desired
            x1 = command.x1_desired if x1 is None else x1
        return Command(F=F, v2_desired=v2, x1_desired=x1, x2_desired=x2), tuple(states)

    def _settings(self) -> dict[str, object]:
        return {"parts": [controller for controller, _ in self._parts]}


def _part(measurement: Measurement, outputs: np.ndarray) -> Measurement:
    deficit = measurement.force_deficit
    return measurement._replace(
        x2=measurement.x2.take(outputs, axis=-1),  # contiguous, for the kernel
        v2=measurement.v2.take(outputs, axis=-1),
        force_deficit=None if deficit is None else deficit.take(outputs, axis=-1),
    )
