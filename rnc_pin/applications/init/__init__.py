"""Draft of a first scenario from a robot's file, with a remark on each assumption."""

from rnc_pin.applications.init.decision import DraftDecision
from rnc_pin.applications.init.draft import DraftedScenario, draft, draft_with_decisions
from rnc_pin.applications.init.source import DraftOptions, with_choices

__all__ = ["DraftDecision", "DraftOptions", "DraftedScenario", "draft", "draft_with_decisions", "with_choices"]
