"""Folders that tests read."""

import importlib.util
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).parents[2]
DATA = ROOT / "tests" / "data"
DIRT = DATA / "dirt"
"""Small files with what published descriptions get wrong."""
GENERATED = ("project", "reference", "_scenes")
"""Folders of ``docs`` that the build of the site writes."""


def pages() -> list[Path]:
    """Pages that people write: of the repository's root, and of ``docs`` and its folders."""
    docs = sorted((ROOT / "docs").rglob("*.md"))
    return [*sorted(ROOT.glob("*.md")), *(page for page in docs if page.relative_to(ROOT).parts[1] not in GENERATED)]


def docs_script(name: str) -> ModuleType:
    """Module of a script in ``docs``, which is no package."""
    spec = importlib.util.spec_from_file_location(name, ROOT / "docs" / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
