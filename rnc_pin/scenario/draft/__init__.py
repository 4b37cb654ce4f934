"""A first scenario for a robot: what its file suggests, in words that say what was assumed."""

from rnc_pin.scenario.draft.draft import Wishes, draft

__all__ = ["Wishes", "draft"]
