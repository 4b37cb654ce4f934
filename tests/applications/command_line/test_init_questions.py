"""Questions of ``rnc-pin init``: what a file leaves open is said on stderr and in the draft."""

from urdf_parts import BOX, link, pivot, robot, wheel


def test_a_question_is_said_with_the_option_that_answers_it(brief, call, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    parts = [link("base", 50.0, BOX), wheel("a", "base", (0.5, 0.3, 0)), wheel("b", "base", (0.5, -0.3, 0))]
    parts += [pivot("turn", "base", (-0.5, 0, 0)), wheel("c", "turn", (0, 0, 0))]
    (tmp_path / "truck.urdf").write_text(robot(*parts))
    status, _, error = call("init", "truck.urdf")
    assert status == 0
    (line,) = [each for each in error.splitlines() if "question" in each]
    assert line.startswith("rnc-pin: question: Which wheels are driven? a_joint, b_joint (50 % sure: ")
    assert line.endswith("Otherwise c_joint: --driven c_joint")
    assert "# QUESTION: Which wheels are driven?" in (tmp_path / "truck.yaml").read_text()
