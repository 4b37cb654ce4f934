"""Former arguments of ``simulate`` and ``free_motion``, which work for one version with a ``DeprecationWarning``."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import wraps
from typing import Any, ParamSpec, TypeVar

from rnc_pin.deprecation import warn_of_rename
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.plants import ReducedPlant
from rnc_pin.simulation.simulation_options import DEFAULT_OPTIONS

_P = ParamSpec("_P")
_Result = TypeVar("_Result")


@dataclass(frozen=True)
class Plant:
    """Former options of a plant; ``ReducedPlant`` takes them as arguments."""

    joint_damping: bool = False
    actuator_limits: bool = False
    joint_friction: bool = False

    def __post_init__(self) -> None:
        warn_of_rename("rnc_pin.Plant", "rnc_pin.ReducedPlant(reduced, ...)", stacklevel=4)

    def of(self, reduced: ReducedModel, substeps: int = 1) -> ReducedPlant:
        """Return the plant of a model with these options."""
        return ReducedPlant(reduced, **asdict(self), substeps=substeps)


def accept_former_arguments(simulate: Callable[_P, _Result]) -> Callable[_P, _Result]:
    """Return ``simulate`` with its former keywords in addition to its present ones."""

    @wraps(simulate)
    def call(*args: _P.args, **keywords: _P.kwargs) -> _Result:
        arguments: dict[str, Any] = dict(keywords)
        if isinstance(arguments.get("plant"), Plant) or not _FORMER.isdisjoint(arguments):
            _adopt(args[0] if args else arguments.get("reduced"), arguments)
        return simulate(*args, **arguments)

    return call


_OPTIONS = ("stop", "loop", "controller_state", "observer", "meta")
_FORMER = {*_OPTIONS, "machine", "substeps"}


def _adopt(reduced: Any, arguments: dict[str, Any]) -> None:
    """Replace former keywords by present ones."""
    options = {name: arguments.pop(name) for name in _OPTIONS if name in arguments}
    for name in options:
        warn_of_rename(f"simulate({name}=...)", f"options=SimulationOptions({name}=...)", stacklevel=4)
    if "loop" in options:
        options["loop"] = options["loop"] or {}
    plant, machine, substeps = arguments.get("plant"), arguments.pop("machine", None), arguments.pop("substeps", None)
    if substeps is not None:
        warn_of_rename("simulate(substeps=...)", "plant=ReducedPlant(reduced, substeps=...)", stacklevel=4)
    if machine is not None:
        warn_of_rename("simulate(machine=...)", "plant=...", stacklevel=4)
        limits = isinstance(plant, Plant) and plant.actuator_limits
        options["loop"] = {"fallback": "hold", "limits": limits, **options.get("loop", {})}
        arguments["plant"] = machine
    elif isinstance(plant, Plant):
        arguments["plant"] = plant.of(reduced, 1 if substeps is None else substeps)
    elif plant is None and substeps is not None:
        arguments["plant"] = ReducedPlant(reduced, substeps=substeps)
    if options:
        arguments["options"] = replace(arguments.get("options", DEFAULT_OPTIONS), **options)
