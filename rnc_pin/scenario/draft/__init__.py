"""A first scenario for a robot: what its file suggests, in words that say what was assumed."""

from rnc_pin.scenario.draft.draft import draft
from rnc_pin.scenario.draft.source import Wishes

__all__ = ["Wishes", "draft"]
