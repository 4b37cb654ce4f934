"""Draft of a first scenario from a robot's file, with a remark on each assumption."""

from rnc_pin.scenario.draft.draft import draft
from rnc_pin.scenario.draft.source import Wishes

__all__ = ["Wishes", "draft"]
