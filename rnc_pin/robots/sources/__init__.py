"""Readers of robot descriptions: URDF, xacro and MJCF, with reports of what Pinocchio ignores."""

from rnc_pin.robots.sources.description import Description, Mimic
from rnc_pin.robots.sources.mjcf import read_mjcf
from rnc_pin.robots.sources.urdf import read_urdf

__all__ = ["Description", "Mimic", "read_mjcf", "read_urdf"]
