"""Validation of a model before anything is computed with it."""

from __future__ import annotations

import warnings

import pinocchio as pin

from rnc_pin.errors import ModelError, ModelWarning, argument, few
from rnc_pin.robots.inertias import check_inertias, check_model_size

_BODY_FIXED = ("Planar", "FreeFlyer", "Spherical", "Translation")  # joints of several axes, constant in the body


def check_model(model: pin.Model) -> None:
    """Raise an error if a model cannot be simulated; warn about inertias that no body can have, and moving axes.

    Raises:
        ModelError: no joints or too many, duplicate joint names, interleaved branches, or invalid inertias.
    """
    if model.nv == 0:
        raise ModelError(
            f"robot '{model.name}' has no moving joint: load it with {argument('base', 'planar')}, or 'free'"
        )
    check_model_size(model)
    names = list(model.names)[1:]
    for name in names:
        if names.count(name) > 1:
            raise ModelError(f"robot '{model.name}' has two joints named '{name}'")
    _check_order(model)
    check_inertias(model)
    moving = joints_with_moving_axes(model)
    if moving:
        warnings.warn(
            f"robot '{model.name}': axes of {few(moving)} depend on the joint's own position. Pinocchio's Jacobian "
            "rates and Coriolis matrix are wrong for such joints, so R_dot, V and A_star_dot are; accelerations are "
            "right. Use joints of one degree of freedom instead",
            ModelWarning,
            stacklevel=2,
        )


def joints_with_moving_axes(model: pin.Model) -> list[str]:
    """Joints whose axes are not constant in the body that they move: universal, ZYX and composite joints."""
    joints = zip(model.names, model.joints, strict=True)
    return [name for name, joint in joints if joint.nv > 1 and not joint.shortname().endswith(_BODY_FIXED)]


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
