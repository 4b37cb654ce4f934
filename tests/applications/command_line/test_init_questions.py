"""Questions of ``rnc-pin init``: what a file leaves open is asked on a terminal, and said elsewhere."""

import pytest
import yaml

from rnc_pin.applications.command_line.commands import init
from rnc_pin.applications.init import DraftDecision, DraftedScenario
from rnc_pin.applications.init.evidence import Alternative
from urdf_parts import BOX, link, pivot, robot, wheel


@pytest.fixture
def truck(brief, tmp_path, monkeypatch):
    """A robot of which nothing tells whether its fixed or its steered wheel has the motor; (its file, the draft)."""
    monkeypatch.chdir(tmp_path)
    parts = [link("base", 50.0, BOX), wheel("a", "base", (0.5, 0.3, 0)), wheel("b", "base", (0.5, -0.3, 0))]
    (tmp_path / "truck.urdf").write_text(
        robot(*parts, pivot("turn", "base", (-0.5, 0, 0)), wheel("c", "turn", (0, 0, 0)))
    )
    return "truck.urdf", tmp_path / "truck.yaml"


def test_without_a_terminal_the_question_is_said(truck, call):
    source, draft = truck
    status, _, error = call("init", source)
    assert status == 0
    (line,) = [each for each in error.splitlines() if "question" in each]
    assert line.startswith("rnc-pin: question: Which wheels are driven? a_joint, b_joint (50 % sure: ")
    assert line.endswith("Otherwise c_joint: --driven c_joint")
    assert "# QUESTION: Which wheels are driven?" in draft.read_text()
    assert "  # - c_joint  # uncomment it if it has a motor" in draft.read_text()


@pytest.mark.parametrize(("answer", "driven"), [("2\n", ["c_joint"]), ("\n", ["a_joint", "b_joint"])])
def test_on_a_terminal_the_answer_decides(answer, driven, truck, monkeypatch):
    from click.testing import CliRunner

    from rnc_pin.applications.command_line.usage import cli

    source, draft = truck
    monkeypatch.setattr(init, "_on_a_terminal", lambda: True)
    result = CliRunner().invoke(cli, ["init", source], input=answer, obj=0.0)
    assert result.exit_code == 0, result.output
    assert "Which wheels are driven?" in result.output
    assert yaml.safe_load(draft.read_text())["actuators"] == [*driven, "turn_joint"]
    text = draft.read_text().replace("\n# ", " ")
    assert "QUESTION" not in text
    assert f"Decided: Which wheels are driven? {', '.join(driven)} (your answer)" in text
    assert result.output.count("Which wheels are driven?") == 1


def test_an_answer_that_raises_the_next_question_is_asked_further(tmp_path, monkeypatch):
    from click.testing import CliRunner

    from rnc_pin.applications.command_line.usage import cli

    decisions = {
        (): [DraftDecision("One?", "a", 0.5, "a guess", (Alternative("b", ("--base", "free")),))],
        ("free", ): [DraftDecision("One?", "b", 0.5, "a guess", (Alternative("a", ("--base", "planar")),)),
            DraftDecision("Other?", "c", 0.5, "a guess", (Alternative("d", ("--driven", "d")),))],
    }  # fmt: skip

    def drafted(robot, folder, wishes):
        found = decisions[(wishes.base,) if wishes.base else ()]
        return DraftedScenario(lambda told: "\n".join(map(str, told)), tuple(found))

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(init, "draft_with_decisions", drafted)
    monkeypatch.setattr(init, "_on_a_terminal", lambda: True)
    result = CliRunner().invoke(cli, ["init", "robot.urdf"], input="2\n1\n", obj=0.0)
    assert result.exit_code == 0, result.output
    said = (tmp_path / "robot.yaml").read_text()
    assert said.startswith("One? b (your answer). Otherwise a: --base planar\nOther? c (your answer)")
