"""Small matrices, and what outputs live on."""
