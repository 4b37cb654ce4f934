"""Exports of ``rnc_pin.applications.init``, which ``__init__.py`` imports at their first use."""

from .draft import DraftedScenario as DraftedScenario
from .draft import draft as draft
from .draft import draft_with_decisions as draft_with_decisions
from .source import DraftOptions as DraftOptions
