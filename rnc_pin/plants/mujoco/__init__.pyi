"""Exports of ``rnc_pin.plants.mujoco``, which ``__init__.py`` imports at their first use."""

from rnc_pin.lab.mujoco import *
