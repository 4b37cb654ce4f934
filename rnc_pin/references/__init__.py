"""Goals of outputs over time."""
