"""Exports of ``rnc_pin.applications.command_line``, which ``__init__.py`` imports at their first use."""

from .drive import drive_robot as drive_robot
from .inspection import draft_scenario as draft_scenario
from .inspection import explore_system as explore_system
from .inspection import inspect_system as inspect_system
from .inspection import print_schema as print_schema
from .replay import export_file as export_file
from .replay import replay_runs as replay_runs
from .run import run_scenario as run_scenario
from .sweep import sweep_scenario as sweep_scenario
