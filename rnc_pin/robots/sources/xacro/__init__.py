"""Expansion of xacro files without ROS, where expressions can only compute values.

The format is that of ``xacro`` 2.1, and the tests compare with it. That library passes expressions to Python's
``eval``, so a file could run any program. This package evaluates their syntax tree (``expressions``) instead. Only
listed functions, methods and environment variables are allowed, and time and size are bounded.
"""

from rnc_pin.robots.sources.xacro.expand import expand, has_macros, is_xacro

__all__ = ["expand", "has_macros", "is_xacro"]
