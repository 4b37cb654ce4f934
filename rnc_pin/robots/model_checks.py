"""Validation of a model before anything is computed with it."""

from __future__ import annotations

import pinocchio as pin

from rnc_pin.errors import ModelError
from rnc_pin.robots.inertias import check_inertias, check_model_size


def check_model(model: pin.Model) -> None:
    """Raise an error if a model cannot be simulated; warn about inertias that no body can have.

    Raises:
        ModelError: no joints or too many, duplicate joint names, interleaved branches, or invalid inertias.
    """
    if model.nv == 0:
        raise ModelError(f"robot '{model.name}' has no moving joint: load it with base='planar' or 'free'")
    check_model_size(model)
    names = list(model.names)[1:]
    for name in names:
        if names.count(name) > 1:
            raise ModelError(f"robot '{model.name}' has two joints named '{name}'")
    _check_order(model)
    check_inertias(model)


def _check_order(model: pin.Model) -> None:
    """Check that each subtree has consecutive joint indices; Pinocchio's inertia matrix is wrong otherwise."""
    names = list(model.names)
    for joint, behind in enumerate(list(model.subtrees)[1:], start=1):
        for number, other in enumerate(behind, start=joint):
            if number != other:
                raise ModelError(
                    f"robot '{model.name}': joint '{names[number]}' was added between '{names[joint]}' and "
                    f"'{names[other]}' behind it, for which Pinocchio's inertia matrix is wrong; "
                    "add joints branch by branch"
                )
