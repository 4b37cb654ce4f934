"""Exports of ``rnc_pin.robots.sources``, which ``__init__.py`` imports at their first use."""

from rnc_pin.robots.robot_files import Packages as Packages

from .description import parse_xml as parse_xml
from .description import read_number as read_number
from .urdf import parse_urdf as parse_urdf
