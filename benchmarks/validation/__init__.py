"""Published and closed-form results beside what rnc_pin computes. Run ``python -m benchmarks.validation``."""

from importlib import import_module

_MODULES = (
    "bicycle", "measured_bicycles", "disk", "sleigh", "slope", "ball", "floating_arm", "grasping", "snakeboard",
    "roller_racer", "rolling_body", "carried", "kapitza", "trailers",
)  # fmt: skip
PROBLEMS = {name: import_module(f"{__name__}.{name}").rows for name in _MODULES}
"""Function that gives the rows of each problem."""
