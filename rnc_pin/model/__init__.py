"""The system, its rows, and its reduction."""
