"""Derived numbers beside those of a file."""

import json
from collections.abc import Iterator
from pathlib import Path

import mpmath as mp


def read(name: str) -> dict:
    return json.loads((Path(__file__).parents[1] / "data" / f"{name}.json").read_text())


def differences(found, given, where: str = "") -> Iterator[tuple[str, float]]:
    """Of every array under its name: the largest difference, relative to its largest entry where that is above one."""
    if isinstance(found, dict):
        for key, value in found.items():
            yield from differences(value, given[key], f"{where}/{key}")
    elif isinstance(found, list) and found and isinstance(found[0], dict):
        assert len(found) <= len(given)
        for index, value in enumerate(found):
            yield from differences(value, given[index], f"{where}/{index}")
    else:
        ours, theirs = _flat(found), _flat(given)
        assert len(ours) == len(theirs), where
        size = max([mp.mpf(1), *(abs(each) for each in ours)])
        yield where, float(max(abs(a - mp.mpf(b)) for a, b in zip(ours, theirs, strict=True)) / size)


def _flat(value) -> list:
    if isinstance(value, list):
        return [each for part in value for each in _flat(part)]
    return [value]
