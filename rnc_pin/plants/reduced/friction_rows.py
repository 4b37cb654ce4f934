"""Rows along which contacts push and friction acts, by the set of contacts that touch."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.plants.reduced.friction import DryFriction
from rnc_pin.plants.reduced.friction_impulses import FrictionGroup
from rnc_pin.plants.reduced.unilateral_contact import BoundContact

_TURNING = ("turning_x", "turning_y", "turning_z")


class _Part(NamedTuple):
    """Rows of one contact: where they are, those of its own, and those of its angular velocity."""

    contact: BoundContact
    where: slice
    own: slice
    turning: slice


class FrictionLayout(NamedTuple):
    """Order of the rows while some contacts touch: of each its normal row, then its friction, then joint friction.

    Attributes:
        parts: the contacts.
        size: number of rows (k).
        normals: rows of the normal impulses.
        groups: friction; limits of joint friction are forces.
        names: names of the rows.
        units: units of the forces along them; those of joint friction are unknown.
        keys: of the groups, number of the contact, or -1, and kind of friction: 0 for slip.
    """

    parts: list[_Part]
    size: int
    normals: list[int]
    groups: list[FrictionGroup]
    names: list[str]
    units: list[str]
    keys: list[tuple[int, int]]


class FrictionRows:
    """Rows (k, nv) of the contacts that touch and of dry joint friction.

    Args:
        contacts: the contacts.
        dry: dry joint friction.
    """

    def __init__(self, contacts: Sequence[BoundContact], dry: DryFriction) -> None:
        self._contacts, self._dry = contacts, dry
        self._limits = [each.turning_limits for each in contacts]
        self._layouts: dict[tuple[frozenset[int], bool], FrictionLayout] = {}

    def layout(self, touching: frozenset[int], joints: bool = True) -> FrictionLayout:
        """Order of the rows.

        Args:
            touching: numbers of the contacts that touch.
            joints: False without the rows of joint friction, as in an impact.
        """
        if (touching, joints) not in self._layouts:
            self._layouts[touching, joints] = self._layout(touching, joints)
        return self._layouts[touching, joints]

    def _layout(self, touching: frozenset[int], joints: bool) -> FrictionLayout:
        found = FrictionLayout([], 0, [], [], [], [], [])
        k = 0
        for number in sorted(touching):
            each, first = self._contacts[number], k
            slips = len(each.names) - 1 if each.contact.friction else 0
            rolling, spin = self._limits[number]
            turning = slice(0 if rolling else 2, 3 if spin else 2)
            found.normals.append(first)
            turned = [f"{kind}({each.name})" for kind in _TURNING[turning]]
            found.names.extend((*each.names[: 1 + slips], *turned))
            found.units.extend(("N",) * (1 + slips) + ("N m",) * len(turned))
            k += 1
            sizes = slips, 2 * bool(rolling), bool(spin)
            for kind, (size, coefficient) in enumerate(zip(sizes, (each.contact.friction, rolling, spin), strict=True)):
                if size:
                    found.groups.append(FrictionGroup(slice(k, k + size), first, float(coefficient or 0.0)))
                    found.keys.append((number, kind))
                    k += size
            found.parts.append(_Part(each, slice(first, k), slice(0, 1 + slips), turning))
        for i, limit in enumerate(self._dry.limits if joints else ()):
            found.groups.append(FrictionGroup(slice(k + i, k + i + 1), -1, 0.0, float(limit)))
            found.keys.append((-1, i))
            found.names.append(f"friction {i}")
            found.units.append("")
        return found._replace(size=k + (len(self._dry.limits) if joints else 0))

    def at(self, state: StateEvaluation, layout: FrictionLayout) -> tuple[np.ndarray, np.ndarray]:
        """Rows (k, nv) in an order, and velocities of the ground along them (k,)."""
        matrix, ground, at = np.empty((layout.size, len(state.v))), np.zeros(layout.size), state.position
        end = 0
        for each, where, own, turning in layout.parts:
            rows, speeds = each.rows(at)
            middle, end = where.start + own.stop, where.stop
            matrix[where.start : middle], ground[where.start : middle] = rows[own], speeds[own]
            if middle < end:
                matrix[middle:end] = each.turning(at)[turning]
        if end < layout.size:
            matrix[end:] = self._dry.rows(state)
        return matrix, ground
