"""Controllers of tests: given inputs, none, or another controller that is told less."""

import numpy as np

from rnc_pin.control import Command


class Memoryless:
    """Controller whose command, or target, is a function of the time and the measurement alone."""

    def __init__(self, law):
        self._law = law

    def initial_state(self, measurement):
        return None

    def step(self, t, measurement, state):
        return self._law(t, measurement), state


class Inputs(Memoryless):
    """Actuator inputs as a function of time: a controller that looks at nothing."""

    def __init__(self, function):
        super().__init__(lambda t, _: Command(T=np.asarray(function(t), dtype=float)))


class Idle(Inputs):
    """No inputs."""

    def __init__(self, p):
        super().__init__(lambda _: np.zeros(p))


class WithoutDeficit:
    """Controller that does not learn that its actuators are saturated, so that it has no anti-windup."""

    def __init__(self, controller):
        self._controller = controller

    def initial_state(self, measurement):
        return self._controller.initial_state(measurement)

    def step(self, t, measurement, state):
        unaware = measurement._replace(force_deficit=None, input_deficit=None)
        return self._controller.step(t, unaware, state)
