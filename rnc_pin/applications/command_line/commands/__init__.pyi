"""Exports of ``rnc_pin.applications.command_line.commands``, which ``__init__.py`` imports at their first use."""

from .calibrate import CalibrationChoice as CalibrationChoice
from .calibrate import calibrate_log as calibrate_log
from .compare import ComparisonChoice as ComparisonChoice
from .compare import compare_log as compare_log
from .compare import read_measured as read_measured
from .drive import drive_robot as drive_robot
from .export import export_file as export_file
from .init import draft_scenario as draft_scenario
from .inspect import inspect_system as inspect_system
from .list import list_scenarios as list_scenarios
from .replay import replay_runs as replay_runs
from .run import run_scenario as run_scenario
from .schema import print_schema as print_schema
from .sweep import sweep_scenario as sweep_scenario
