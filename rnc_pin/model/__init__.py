"""Nonholonomic system, its constraint and output rows, and its reduction."""
