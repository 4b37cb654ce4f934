"""Scenario files, and the objects that they build."""
