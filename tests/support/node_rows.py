"""Check of rows at nodes: their derivatives are those of central differences."""

import numpy as np

from rnc_pin.motion.optimal.costs import NodeData


def check_rows(model, block, at, u, step=3e-5, **tolerances):  # logarithms near half a turn round to 1e-11
    """Compare values with and without derivatives, and derivatives by state and input; return the rows."""
    n, time = len(at.q), np.linspace(0.0, 1.0, len(at.q))

    def values(at, u):
        return block.rows(NodeData(model, at, u, time), False).value

    found = block.rows(NodeData(model, at, u, time, model.flow_derivatives(at, u)), True)
    np.testing.assert_allclose(found.value, values(at, u), rtol=1e-12, atol=1e-12)
    moves = [lambda d: values(model.displaced(at, np.tile(d, (n, 1))), u), lambda d: values(at, u + d)]
    for slopes, moved in zip(np.split(found.J, [model.nx], axis=2), moves, strict=True):
        for k, d in enumerate(np.eye(slopes.shape[2]) * step):
            differences = (moved(d) - moved(-d)) / (2 * step)
            np.testing.assert_allclose(slopes[:, :, k], differences, **{"atol": 1e-6, "rtol": 0.0, **tolerances})
    return found
