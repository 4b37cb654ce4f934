"""What ``inspect`` found, as a page in the terminal."""

from __future__ import annotations

from typing import Any

from rich.console import Console, Group, RenderableType
from rich.table import Table


def print_report(content: dict[str, Any]) -> None:
    """What ``inspect`` found, on one page."""
    console = Console()
    title = f"{content['system']} ({content['robot']})"
    table = Table(show_header=False, title=title, title_justify="left", title_style="bold", show_lines=True)
    table.add_column(style="bold", no_wrap=True)
    table.add_column(overflow="fold")
    n, rank, r = content["n"], content["rank"], content["r"]
    less = f"{rank} independent constraint row{'s'[: rank != 1]}"
    table.add_row("motion", f"{n} degrees of freedom less {less} leave {r}:\n{_list(content['reducing'])}")
    table.add_row("constraint rows", _constraint_rows(content))
    growth = content["growth_vector"]
    reach = "completely nonholonomic" if content["completely_nonholonomic"] else f"motion reaches {growth[-1]} of {n}"
    table.add_row("growth vector", f"({', '.join(map(str, growth))}): {reach}")
    table.add_row("actuators", _actuation(content))
    table.add_row("redundancy", _redundancy(content))
    table.add_row("singular", _singular(content))
    lemma = ", ".join(f"{name} {value:.1e}" for name, value in content["lemma1"].items())
    table.add_row("Lemma 1", f"{'holds' if content['lemma1_holds'] else 'DOES NOT HOLD'}: {lemma}")
    console.print(table, highlight=False)


def _list(names: list[str]) -> str:
    return ", ".join(names) or "none"


def _constraint_rows(content: dict[str, Any]) -> RenderableType:
    rows = Table.grid(padding=(0, 2))
    for name in content["kept_rows"]:
        rows.add_row(name, "integrable" if name in content["integrable_rows"] else "nonholonomic")
    for row in content["dropped_rows"]:
        rows.add_row(f"[dim]{row['name']}[/dim]", f"[dim]dropped: {row['reason']}[/dim]")
    combinations = content["integrable_combinations"]
    if not content["kept_rows"]:
        return "none"
    if not combinations:
        return Group(rows, "no combination of rows is integrable")
    count = f"{len(combinations)} integrable combination{'s'[: len(combinations) != 1]}"
    return Group(rows, *(f"{count if k == 0 else ' ' * len(count)}  {each}" for k, each in enumerate(combinations)))


def _actuation(content: dict[str, Any]) -> str:
    rank, r = content["actuation_rank"], content["r"]
    verdict = f"rank of R^T B {rank} of {r}: every F can be realised"
    if rank < r:
        verdict = f"rank of R^T B {rank} of {r}: not every F can be realised, {_list(content['unactuated'])} fall short"
    spare = content["p"] - rank
    return f"{_list(content['actuators'])}\n{verdict}" + (f", with {spare} actuators to spare" if spare else "")


def _redundancy(content: dict[str, Any]) -> RenderableType:
    found = content["redundancy"]
    task = Table.grid(padding=(0, 2))
    task.add_row("x21 primary", _list(content["primary"]))
    task.add_row("x22 redundant", _list(content["redundant"]))
    task.add_row("x11 tracked by x22", _list(found["tracked"]))
    task.add_row("x12 driven by x21", _list(found["driven"]))
    verdict = f"class {content['redundancy_class'] or 'none'}: {found['reason']}"
    if "blocks" not in found:
        return Group(verdict, task)
    blocks = Table(box=None, padding=(0, 1, 0, 0))
    for heading in ("block", "size", "largest", "smallest singular value"):
        blocks.add_column(heading, no_wrap=True)
    for block in found["blocks"]:
        spread = block.get("smallest_singular_value")
        if spread:
            size, largest = " x ".join(map(str, block["shape"])), _figure(block["largest_entry"])
            blocks.add_row(block["name"], size, largest, _spread(spread) if block["largest_entry"] else "0")
    return Group(verdict, task, blocks)


def _spread(values: dict[str, float]) -> str:
    return f"{_figure(values['min'])} to {_figure(values['max'])}, median {_figure(values['median'])}"


def _figure(value: float) -> str:
    return "0" if abs(value) < 1e-12 else f"{value:.3g}"


def _singular(content: dict[str, Any]) -> str:
    lines = [
        f"condition of E {_spread(content['condition'])}; "
        f"{content['singular_samples']} of {content['samples']} samples singular"
    ]
    for each in content["singularities"]:
        rows, several = _list(each["rows"]), len(each["rows"]) > 1
        if each["matrix"] == "E":
            what = f"{rows} depend on each other"
        else:
            what = f"x22 cannot move {rows}" + (" independently" if several else "")
        if each["located"]:
            lines.append(f"{each['matrix']} is singular where {what}{_where(each['configuration'])}")
        else:
            size = _figure(each["smallest_singular_value"])
            lines.append(f"{each['matrix']}: nowhere, as far as samples tell; smallest singular value {size} ({rows})")
    return "\n".join(lines)


def _where(configuration: dict[str, Any]) -> str:
    """A configuration of a robot with few joints, in words; of others it takes too much room."""
    if len(configuration) > 6:
        return ""
    values = {
        name: f"({', '.join(map(_figure, value))})" if isinstance(value, list) else _figure(value)
        for name, value in configuration.items()
    }
    return ", e.g. at " + ", ".join(f"{name} = {value}" for name, value in values.items())
