"""Descriptions cannot be changed."""

import importlib
import inspect
import pkgutil
from dataclasses import is_dataclass

import pytest

import rnc_pin as rnc

PACKAGES = ("model", "constraints", "outputs", "control", "planning", "analysis")


def classes():
    for package in PACKAGES:
        whole = importlib.import_module(f"rnc_pin.{package}")
        for found in pkgutil.walk_packages(whole.__path__, f"{whole.__name__}."):
            module = importlib.import_module(found.name)
            yield from (
                each for _, each in inspect.getmembers(module, inspect.isclass) if each.__module__ == found.name
            )


def test_descriptions_cannot_be_changed():
    """They can be kept and compared: a system does not change."""
    described = [each for each in classes() if inspect.isclass(each) and is_dataclass(each)]
    assert len(described) > 40
    assert [each.__name__ for each in described if not each.__dataclass_params__.frozen] == []
    for kind in (rnc.FrameSpeed("base"), rnc.RollingWheel("wheel", 0.1), rnc.Caster("nose", 0.1)):
        with pytest.raises(AttributeError):
            kind.frame = "other"
