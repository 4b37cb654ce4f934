"""Deferred imports: the modules stay out of the process until something uses them, and then behave as usual."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from patience import PATIENCE
from rnc_pin.visualization.browser.page import deferred_imports

_NAMES = ("viser", "trimesh", "imageio", "IPython")
_PAGE = f"""
import sys
import rnc_pin.visualization.recording
found = [name for name in {_NAMES} if name in sys.modules]
assert not found, found
"""


def test_the_packages_of_pages_are_imported_only_when_they_are_used(tmp_path: Path) -> None:
    for name in _NAMES:  # found before those of the environment, which may lack them
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text("")
    (tmp_path / "IPython" / "display.py").write_text("HTML = str")
    searched = {**os.environ, "PYTHONPATH": str(tmp_path)}
    subprocess.run([sys.executable, "-c", _PAGE], check=True, timeout=PATIENCE, env=searched)


def test_placeholders_last_until_the_first_use(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "slow_module.py").write_text("def twice(x): return 2 * x\nLIMIT = 7\n")
    monkeypatch.syspath_prepend(tmp_path)
    with deferred_imports({"slow_module": ("twice",), "module_that_is_absent": ()}):
        import slow_module
        from slow_module import twice

        with pytest.raises(ImportError):
            import module_that_is_absent  # noqa: F401
    assert "slow_module" not in sys.modules
    assert twice(4) == 8
    assert sys.modules["slow_module"] is not slow_module
    assert slow_module.LIMIT == 7
    with pytest.raises(AttributeError, match="slow_module"):
        _ = slow_module.limit


def test_a_module_used_during_the_context_is_imported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "used_module.py").write_text("LIMIT = 3\n")
    monkeypatch.syspath_prepend(tmp_path)
    with deferred_imports({"used_module": ()}):
        import used_module

        assert used_module.LIMIT == 3
    assert sys.modules["used_module"].LIMIT == 3
