"""Methods that ``ReducedModel`` had; they work for one version and warn of their replacements."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rnc_pin.deprecation import warn_of_rename
from rnc_pin.model.output_gradients import kinematic_gradient, log_determinant_gradient

_FORMER: dict[str, tuple[str, Callable[..., Any]]] = {
    "flow": ("at(q, v2).flow(T)", lambda model, q, v2, T, damping=None: model.at(q, v2).flow(T, damping)),
    "contact_forces": (
        "at(q, v2).contact_forces(T)",
        lambda model, q, v2, T: model.at(q, v2).contact_forces(T),
    ),
    "inertia": ("at(q).H", lambda model, q: model.at(q).H),
    "input_matrix": ("at(q).input_matrix", lambda model, q: model.at(q).input_matrix),
    "drive_jacobian": ("at(q).J2 @ at(q).B", lambda model, q: model.at(q).J2 @ model.at(q).B),
    "basis_rate": ("at(q, v=along).R_dot", lambda model, q, along: (model.at(q).R, model.at(q, v=along).R_dot)),
    "kinematic_gradient": (
        "rnc_pin.model.output_gradients.kinematic_gradient(at(q), along)",
        lambda model, q, along: kinematic_gradient(model.at(q), along),
    ),
    "log_determinant_gradient": (
        "rnc_pin.model.output_gradients.log_determinant_gradient(at(q), along)",
        lambda model, q, along: log_determinant_gradient(model.at(q), along),
    ),
    "measure": (
        "at(q, v2).measure(integrals)",
        lambda model, q, v2, integrals=None: model.at(q, v2).measure(integrals),
    ),
    "measured": (
        "at(q, v=v).measure(integrals)",
        lambda model, q, v, integrals=None: model.at(q, v=v).measure(integrals),
    ),
    "outputs": ("at(q).outputs(integrals)", lambda model, q, integrals=None: model.at(q).outputs(integrals)),
    "velocity": ("at(q, v2).v", lambda model, q, v2: model.at(q, v2).v),
    "constraint_residual": ("at(q, v=v).residual", lambda model, q, v: model.at(q, v=v).residual),
    "condition": ("at(q).condition", lambda model, q: model.at(q).condition),
    "smallest_singular_value": (
        "at(q).smallest_singular_value",
        lambda model, q: model.at(q).smallest_singular_value,
    ),
    "stacked_rows": ("at(q).E", lambda model, q: model.at(q).E),
    "position_residual": ("assembly.residual(q)", lambda model, q: model.assembly.residual(model.at(q).q)),
}


class FormerMethods:
    """Mixin with the former methods."""


def _add(name: str, new: str, compute: Callable[..., Any]) -> None:
    def call(self: object, *args: Any, **kwargs: Any) -> Any:
        warn_of_rename(f"ReducedModel.{name}", new)
        return compute(self, *args, **kwargs)

    setattr(FormerMethods, name, call)


for _name, (_new, _compute) in _FORMER.items():
    _add(_name, _new, _compute)
