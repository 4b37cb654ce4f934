"""Xacro files expanded without ROS, and without anything in them that could do more than compute.

The format is that of ``xacro`` 2.1, against which this is tested; but that library hands expressions to Python's
``eval``, from where a file reaches every program of the machine. Here they are computed over their syntax tree
(``expressions``), with functions, methods and environment variables by list, and the whole is bounded in time and size.
"""

from rnc_pin.robots.sources.xacro.files import expand, has_macros, is_xacro

__all__ = ["expand", "has_macros", "is_xacro"]
