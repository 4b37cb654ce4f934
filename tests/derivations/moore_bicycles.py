"""tests/data/moore_bicycles.json: appendix A of Meijaard et al. 2007 for the bicycles that Moore measured."""

from . import bicycle_linear


def derived(data):
    """Matrices and eigenvalues of all bicycles."""
    result = {}
    for name, bicycle in data["bicycles"].items():
        found, g = bicycle_linear.matrices(bicycle["parameters"]), bicycle["parameters"]["g"]
        linear = {key: matrix.tolist() for key, matrix in found.items()}
        linear["eigenvalues"] = {}
        for speed in ("2", "6"):
            roots = bicycle_linear.eigenvalues(found, speed, bicycle_linear.mp.mpf(repr(g)))
            linear["eigenvalues"][speed] = {"real": [x.real for x in roots], "imag": [x.imag for x in roots]}
        result[name] = {"linear": linear}
    return {"bicycles": result}
