"""Selection of the pairs of shapes that may collide."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import pinocchio as pin

from rnc_pin.errors import ModelError, nearest
from rnc_pin.io.safe_read import parse_tree, read_bytes


class LinkPair(NamedTuple):
    """Two shapes by index in the geometry, and their names: the link's name, or that of the obstacle.

    Attributes:
        first: index of the shape of a link.
        second: index of the other shape.
        names: names of the two bodies.
    """

    first: int
    second: int
    names: tuple[str, str]

    @property
    def label(self) -> str:
        """Both names in one text."""
        return f"{self.names[0]} / {self.names[1]}"


class OmittedPair(NamedTuple):
    """Pair that is not checked, and the reason.

    Attributes:
        names: names of the two bodies.
        reason: the reason, in words.
        depth: depth of the overlap [m]; zero for other reasons.
    """

    names: tuple[str, str]
    reason: str
    depth: float = 0.0

    def __str__(self) -> str:
        return f"{' / '.join(self.names)}: {self.reason}"


@dataclass(frozen=True)
class PairSelection:
    """Rules by which pairs of links are selected. Every link is always checked against every obstacle.

    Attributes:
        pairs: pairs of links to check, by name; None checks all pairs, except those that the other rules exclude.
        disabled: pairs of links to omit, by name, such as the result of ``read_disabled_pairs``.
        links: True to check links against each other; obstacles always count.
    """

    pairs: Sequence[tuple[str, str]] | None = None
    disabled: Sequence[tuple[str, str]] = ()
    links: bool = True


def select_pairs(
    model: pin.Model, names: Sequence[str], joints: Sequence[int], selection: PairSelection
) -> tuple[list[LinkPair], list[OmittedPair]]:
    """Return the pairs of links to check, and the pairs that a rule omits. Shapes of one rigid body are no pair.

    Args:
        model: model of the robot.
        names: link of each shape.
        joints: parent joint of each shape.
        selection: rules.

    Raises:
        ModelError: a rule names a link without collision geometry.
    """
    wanted = None if selection.pairs is None else _checked(selection.pairs, names)
    disabled = _checked(selection.disabled, names)
    kept: list[LinkPair] = []
    omitted: list[OmittedPair] = []
    for first, second in combinations(range(len(names)) if selection.links else (), 2):
        a, b = joints[first], joints[second]
        pair = names[first], names[second]
        if a == b:
            continue
        if wanted is not None:
            if frozenset(pair) in wanted:
                kept.append(LinkPair(first, second, pair))
        elif frozenset(pair) in disabled:
            omitted.append(OmittedPair(pair, "disabled"))
        elif model.parents[a] == b or model.parents[b] == a:
            omitted.append(OmittedPair(pair, "adjacent links"))
        else:
            kept.append(LinkPair(first, second, pair))
    return kept, omitted


def _checked(pairs: Iterable[tuple[str, str]], names: Sequence[str]) -> set[frozenset[str]]:
    found = set()
    for pair in pairs:
        if len(pair) != 2 or isinstance(pair, str):
            raise ModelError(f"expected a pair of links, found {pair!r}")
        for name in pair:
            if name not in names:
                raise ModelError(f"no link '{name}' with collision geometry{nearest(str(name), dict.fromkeys(names))}")
        found.add(frozenset(pair))
    return found


def read_disabled_pairs(path: str | Path, names: Iterable[str]) -> tuple[tuple[str, str], ...]:
    """Return the pairs of links that an SRDF file disables.

    Args:
        path: the file.
        names: links of the robot with collision geometry; pairs with other links do not matter and are dropped.

    Raises:
        ModelError: the file cannot be read, or is not an SRDF.
    """
    valid = set(names)
    try:
        root = parse_tree(read_bytes(Path(path)))
    except OSError as error:
        raise ModelError(f"{path}: cannot be read: {error.strerror or error}") from None
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise ModelError(f"{path}: not well-formed XML: {error}") from None
    if root.tag != "robot":
        raise ModelError(f"{path}: not an SRDF: its root element is <{str(root.tag)[:40]}>, expected <robot>")
    pairs = [(element.get("link1", ""), element.get("link2", "")) for element in root.iter("disable_collisions")]
    return tuple(pair for pair in pairs if valid.issuperset(pair))
