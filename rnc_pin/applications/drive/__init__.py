"""Runs that a user drives in real time: commands from a page, goals within limits, and their record."""
