"""Tables of the keys of scenario files, from the JSON Schema."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any

from rnc_pin.applications.scenario.schema.scenario import schema

_LONGEST = 30  # letters of a default that the table shows


def kind(entry: dict[str, Any], parts: dict[str, Any]) -> str:
    """The type of a value, in a few words."""
    if "$ref" in entry:
        name = entry["$ref"].rpartition("/")[2]
        if name.endswith("Entry"):
            return " or ".join(f"`{key}:` {kind(value, parts)}" for key, value in parts[name]["properties"].items())
        return f"[{name.strip('_')}](#{name.strip('_').lower()})"
    if "enum" in entry or "const" in entry:
        return ", ".join(f"`{value}`" for value in entry.get("enum", [entry.get("const")]))
    for choices in ("anyOf", "oneOf", "allOf"):
        if choices in entry:
            kinds = [kind(each, parts) for each in entry[choices] if each.get("type") != "null"]
            return (" or " if len(kinds) < 4 else "<br>").join(dict.fromkeys(kinds))
    if entry.get("type") == "array":
        of = kind(entry.get("items", {}), parts)
        return f"list of:<br>{of}" if "<br>" in of else f"list of {of}"
    if entry.get("type") == "object":
        values = entry.get("additionalProperties")
        return f"mapping to {kind(values, parts)}" if isinstance(values, dict) and values else "mapping"
    return str(entry.get("type", "any value"))


def table(part: dict[str, Any], parts: dict[str, Any]) -> Iterator[str]:
    """One line for each key."""
    yield "| key | value | default | |\n|---|---|---|---|\n"
    for key, entry in part.get("properties", {}).items():
        default = f"`{json.dumps(entry['default'])}`" if "default" in entry else ""
        if key in part.get("required", []):
            default = "required"
        text = re.sub(r"\s+", " ", entry.get("description", "")).replace("``", "`").replace("|", "\\|")
        yield f"| `{key}` | {kind(entry, parts)} | {default if len(default) < _LONGEST else ''} | {text} |\n"


def keys() -> str:
    """All tables: the scenario itself, then each of its parts. Entries with one key stand where they are used."""
    whole = schema()
    parts: dict[str, Any] = dict(whole["$defs"])
    shown = {"Scenario": whole, **{name: parts[name] for name in sorted(parts, key=lambda name: name.strip("_"))}}
    lines = []
    for name, part in shown.items():
        if not name.endswith("Entry"):
            lines.append(f"\n### {name.strip('_')}\n\n{part.get('description', '').replace('``', '`')}\n\n")
            lines.extend(table(part, parts))
    return re.sub(r"\n{3,}", "\n\n", "".join(lines))
