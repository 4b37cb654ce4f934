"""Shapes in annotations are checked while tests run."""

from jaxtyping import install_import_hook

# Before anything imports rnc_pin: from here on what annotates shapes checks what it returns. Code that runs once a
# sample and annotates none is left out, because a checked call costs several times an unchecked one.
install_import_hook(
    [f"rnc_pin.{module}" for module in ("reduction", "terms", "measurement", "simulation.trajectory")],
    "shape_checker.check",
)
