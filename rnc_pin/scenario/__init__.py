"""Scenario files and what they build."""
