"""Exports of ``rnc_pin.applications.init``, which ``__init__.py`` imports at their first use."""

from .draft import DraftedScenario as DraftedScenario
from .draft import draft as draft
from .draft import draft_with_decisions as draft_with_decisions
from .redundancy_use import FoundUse as FoundUse
from .redundancy_use import best_rows as best_rows
from .redundancy_use import find_uses as find_uses
from .redundancy_use import scenario_of as scenario_of
from .source import DraftOptions as DraftOptions
