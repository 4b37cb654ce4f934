"""Controllers of tests: given inputs, or none; and a plant that tells no more than it has to."""

from types import SimpleNamespace

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


class Counting(Memoryless):
    """The same with a state: the number of its steps, from 5 on."""

    def initial_state(self, measurement):
        return 5

    def step(self, t, measurement, state):
        return self._law(t, measurement), state + 1


def silent(plant):
    """A plant without the rest of its interface, such as work and forces."""
    return SimpleNamespace(**{name: getattr(plant, name) for name in ("reset", "read", "apply", "advance")})


class Inputs(Memoryless):
    """Actuator inputs as a function of time: a controller that looks at nothing."""

    def __init__(self, function):
        super().__init__(lambda t, _: Command(T=np.asarray(function(t), dtype=float)))


class Idle(Inputs):
    """No inputs."""

    def __init__(self, p):
        super().__init__(lambda _: np.zeros(p))
