"""Exports of ``rnc_pin.robots``, which ``__init__.py`` imports at their first use."""

from .joint_values import NO_LIMIT as NO_LIMIT
from .model_checks import Massless as Massless
from .model_checks import UselessInertia as UselessInertia
from .model_checks import flat_links as flat_links
from .model_checks import mass_of_box as mass_of_box
from .robot import Robot as Robot
from .robot_files import example_urdfs as example_urdfs
from .robot_files import find_mjcf as find_mjcf
from .robot_files import find_shipped as find_shipped
from .robot_files import find_urdf as find_urdf
from .robot_files import shipped_directory as shipped_directory
