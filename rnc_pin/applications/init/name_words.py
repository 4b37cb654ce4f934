"""Words in names of links, joints, meshes and plugins: names only help, and only as whole words."""

from __future__ import annotations

import itertools
import re
from functools import cache

_PARTS = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")


def words_of(*names: str) -> list[str]:
    """Return the words of names in lower case: ``baseFootprint_2`` has the words base and footprint."""
    return [part.lower() for name in names for part in _PARTS.findall(name)]


def has_word(pattern: str, *names: str) -> bool:
    """Return whether a word of the names, or two neighbouring words joined by "_", match a pattern from end to end.

    So "roller" is not found in "controller", and "foot" not in "footprint". A plural with "s" matches too.
    """
    whole = _whole(pattern)
    for name in names:
        words = words_of(name)
        pairs = (f"{one}_{other}" for one, other in itertools.pairwise(words))
        if any(whole.fullmatch(each) for each in (*words, *pairs)):
            return True
    return False


@cache
def _whole(pattern: str) -> re.Pattern[str]:
    return re.compile(f"(?:{pattern})s?")
