"""Exports of ``rnc_pin.app.commands``. Type checkers read it; ``__init__.py`` imports each name lazily from it."""

from .drive import drive_robot
from .init import draft_scenario
from .inspect import inspect_system
from .list import list_scenarios
from .replay import replay_runs
from .run import run_scenario
from .schema import print_schema
from .sweep import sweep_scenario

__all__ = [
    "draft_scenario",
    "drive_robot",
    "inspect_system",
    "list_scenarios",
    "print_schema",
    "replay_runs",
    "run_scenario",
    "sweep_scenario",
]
