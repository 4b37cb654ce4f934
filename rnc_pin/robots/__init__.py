"""Robots: descriptions, models and their names."""
