"""Controllers of tests: given inputs, none, or another controller that is told less."""

import numpy as np

from rnc_pin.control import Command


class Inputs:
    """Actuator inputs as a function of time: a controller that looks at nothing."""

    def __init__(self, function):
        self.function = function

    def initial_state(self, measurement):
        return 0

    def step(self, t, measurement, state):
        return Command(T=np.asarray(self.function(t), dtype=float)), state + 1


class Idle:
    """No inputs."""

    def __init__(self, p):
        self.T = np.zeros(p)

    def initial_state(self, measurement):
        return None

    def step(self, t, measurement, state):
        return Command(T=self.T), state


class WithoutDeficit:
    """Controller that does not learn that its actuators are saturated, so that it has no anti-windup."""

    def __init__(self, controller):
        self._controller = controller

    def initial_state(self, measurement):
        return self._controller.initial_state(measurement)

    def step(self, t, measurement, state):
        unaware = measurement._replace(force_deficit=None, input_deficit=None)
        return self._controller.step(t, unaware, state)
