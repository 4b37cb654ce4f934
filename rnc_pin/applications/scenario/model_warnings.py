"""Warnings about a model as data: they belong to the verdict of a run, and to the row of a sweep."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager

from rnc_pin.errors import ModelWarning


@contextmanager
def collected_model_warnings(show: bool) -> Iterator[list[str]]:
    """Collect the texts of ``ModelWarning``, each once. Other warnings are shown as usual.

    Args:
        show: True to show those of models afterwards too.
    """
    texts: list[str] = []
    told: list[warnings.WarningMessage] = []
    try:
        with warnings.catch_warnings(record=True) as found:
            warnings.simplefilter("always", ModelWarning)
            yield texts
            told = found
    finally:
        for each in told:
            of_model = issubclass(each.category, ModelWarning)
            if of_model and str(each.message) not in texts:
                texts.append(str(each.message))
            if show or not of_model:
                warnings.warn_explicit(each.message, each.category, each.filename, each.lineno)
