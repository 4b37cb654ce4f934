"""Pages of the reference: one for the exports of ``rnc_pin`` and one for each public package, by ``__all__``.

The text comes from docstrings, by Sphinx's autodoc. Sphinx calls :func:`reference_pages` before it looks for pages.
"""

from __future__ import annotations

import importlib
import inspect
import re
from collections.abc import Iterator
from types import ModuleType

import click

import rnc_pin
from rnc_pin.applications.command_line.cli import cli

PACKAGES = (
    "analysis",
    "applications.sweep",
    "collision",
    "constraints",
    "control",
    "motion.whole_body.tasks",
    "motion.whole_body.limits",
    "forces",
    "model.integrators",
    "control.loop",
    "optimal",
    "outputs",
    "motion.planning",
    "plants",
    "plants.mujoco",
    "simulation",
)
RESULTS = {
    "rnc_pin.model.state_evaluation": ["StateEvaluation"],
    "rnc_pin.model.evaluation_results": ["ReducedTerms", "LagrangianTerms", "StateDerivative"],
}
"""Results of ``ReducedModel`` that no public package exports."""


def underlined(title: str, line: str = "=") -> str:
    return f"{title}\n{line * len(title)}\n"


INHERITING = ("Trajectory", "SweepResults")
"""Classes whose base, which is not exported, has most of their members."""


def entries(names: list[str], module: str) -> Iterator[str]:
    """Sections of one page: a table of the names, then each with its docstring."""
    yield ".. autosummary::\n   :nosignatures:\n"
    yield "".join(f"   {name}\n" for name in names)
    for name in names:
        thing = getattr(importlib.import_module(module), name)
        if inspect.isclass(thing):
            directive = "autoexception" if issubclass(thing, BaseException) else "autoclass"
        else:
            directive = "autofunction" if callable(thing) else "autodata"
        yield f".. {directive}:: {name}\n" + ("   :inherited-members: SummaryMixin\n" if name in INHERITING else "")


def reference_pages() -> dict[str, str]:
    """Return the pages by their place below ``docs``."""
    root = sorted(name for name in rnc_pin.__all__ if is_entry(getattr(rnc_pin, name)))
    pages = {"reference/rnc_pin.rst": page("rnc_pin", "Exports of the package: ``import rnc_pin as rnc``.", root)}
    known = {id(getattr(rnc_pin, name)) for name in root}
    for package in PACKAGES:
        module = importlib.import_module(f"rnc_pin.{package}")
        public = [name for name in module.__all__ if is_entry(getattr(module, name))]
        others = [name for name in public if id(getattr(module, name)) not in known]
        known |= {id(getattr(module, name)) for name in others}
        again = [name for name in public if name not in others]
        pages[f"reference/{package}.rst"] = page(f"rnc_pin.{package}", inspect.getdoc(module) or "", others, again)
    pages["reference/results.rst"] = results_page()
    pages["reference/command_line.rst"] = command_line_page()
    listed = "".join(f"   {place.removeprefix('reference/').removesuffix('.rst')}\n" for place in pages)
    pages["reference/index.rst"] = (
        underlined("Python reference")
        + "\nGenerated from docstrings: shapes, units, frames, errors and sources.\n\n.. toctree::\n   :maxdepth: 1\n\n"
        + listed
    )
    return pages


def is_entry(thing: object) -> bool:
    """True for all but modules and constants, whose docstrings are those of their types."""
    return not isinstance(thing, ModuleType | str | float | dict)


def page(module: str, text: str, names: list[str], again: list[str] | None = None) -> str:
    """One page of the reference."""
    parts = [underlined(f"``{module}``"), text + "\n", f".. module:: {module}\n"]
    if again:
        parts.append("Also here: " + ", ".join(f":py:obj:`{name} <rnc_pin.{name}>`" for name in again) + ".\n")
    if names:
        parts.extend(entries(names, module))
    return "\n".join(parts)


def results_page() -> str:
    """One page for the results of ``ReducedModel.at`` and its methods."""
    parts = [underlined("Results of ``ReducedModel``")]
    parts.append("``reduced.at(q, v2)`` computes each quantity once, at its first use; arrays are read-only.\n")
    for module, names in RESULTS.items():
        parts.append(f".. currentmodule:: {module}\n")
        for name in names:
            options = [":inherited-members: tuple", ":exclude-members: as_seen_by, at, measured, in_reduction"]
            parts.append("\n   ".join([f".. autoclass:: {name}", *options]) + "\n")
    return "\n".join(parts)


def command_line_page() -> str:
    """Usage, arguments and options of each command, as ``--help`` tells."""
    parts = [underlined("Command line"), "``rnc-pin COMMAND --help`` prints the same.\n"]
    parts.append("See also :doc:`/commands`, which has the files of a run.\n")
    for name, command in sorted(cli.commands.items()):
        context = click.Context(command, info_name=f"rnc-pin {name}")
        usage = command.get_usage(context).removeprefix("Usage: ")
        parts += [underlined(f"``rnc-pin {name}``", "-"), ".. code-block:: text\n", f"   {' '.join(usage.split())}\n"]
        parts.append(inspect.cleandoc(command.help or "") + "\n")
        records = [each for option in command.params if (each := option.get_help_record(context)) is not None]
        if records:
            parts.append(".. list-table::\n   :widths: 35 65\n")
        parts += [f"   * - ``{usage}``\n     - {rst_text(text)}" for usage, text in records]
        parts.append("")
    return "\n".join(parts)


def rst_text(text: str) -> str:
    """Return text without the characters that RST takes for markup."""
    return " ".join(re.sub(r"([*`_|\\])", r"\\\1", text).split())
