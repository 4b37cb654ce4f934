"""Drafts of URDFs in tests of what a robot is taken for."""

import pytest
import yaml

from rnc_pin.applications.init import DraftOptions, draft_with_decisions
from urdf_parts import write


@pytest.fixture
def drafted(tmp_path):
    """Function from a URDF and choices to (words of the kind, content, decisions by question)."""

    def make(text, **wishes):
        found = draft_with_decisions(str(write(tmp_path / "unit.urdf", text)), tmp_path, DraftOptions(**wishes))
        (tmp_path / "unit.yaml").write_text(found.text)
        kind = next(line for line in found.text.splitlines() if line.startswith("# base"))
        decisions = {each.question: each for each in found.decisions}
        return kind.removeprefix("# base "), yaml.safe_load(found.text), decisions

    return make
