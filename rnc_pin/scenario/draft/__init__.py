"""Draft of a first scenario from a robot's file, with a remark on each assumption."""

from rnc_pin.scenario.draft.draft import draft
from rnc_pin.scenario.draft.source import DraftOptions

__all__ = ["DraftOptions", "draft"]
