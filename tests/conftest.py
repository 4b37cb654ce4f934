"""Shapes in annotations are checked while tests run."""

from jaxtyping import install_import_hook

# Before anything imports rnc_pin: from here on the array code checks the shapes it is given and returns. What reads
# names and files is left out: it has to answer wrong input with an error of its own, and tests look at that.
install_import_hook(
    [f"rnc_pin.{module}" for module in ("reduction", "terms", "measurement", "control", "planning", "simulation")],
    "shape_checker.check",
)
