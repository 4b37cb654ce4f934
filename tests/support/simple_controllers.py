"""Controllers of tests: given inputs, or none."""

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
