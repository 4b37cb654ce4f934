"""Small dense matrices, and the coordinates of outputs."""
