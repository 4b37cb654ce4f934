"""Work for another process, which imports little."""

import pickle

import numpy as np

import rnc_pin as rnc


def figures(reduced: rnc.ReducedModel) -> list[object]:
    """Bytes of the accelerations of a reduced model at two random states."""
    generator, said = np.random.default_rng(0), []
    for _ in range(2):
        q = reduced.random_configuration(generator)
        v2, T = generator.normal(size=reduced.r), generator.normal(size=reduced.p)
        try:
            said.append(reduced.forward_dynamics(q, v2, T).tobytes())
        except rnc.RncError as error:  # e.g. singular, or a row that needs the time
            said.append(str(error))
    return said


def figures_of_pickles(models: list[bytes], build: bytes) -> tuple[list[list[object]], np.ndarray]:
    """Return the figures of pickled models, and the motion that the function of a sweep returns."""
    return [figures(pickle.loads(each)) for each in models], pickle.loads(build)({"speed": 0.01}).q
