"""Refusals of strange content in the folder of a sweep: one line, and nothing of it changes."""

import json
import os

import pytest

import rnc_pin as rnc

ROW = {"run": 0, "outcome": "completed", "verdict": "succeeded", "finding": "", "message": "", "wall_time": 0.1}
LINES = {
    "no JSON": (b"{]\n", "line 1 is not the row of a run: Expecting property name"),
    "bytes": (b"\xff\xfe\n", "line 1 is not the row of a run: "),
    "empty line": (b"\n", "line 1 is not the row of a run: Expecting value"),
    "deep": (b"[" * 100_000 + b"\n", "line 1 is not the row of a run: "),
    "a list": ([1], "expected a mapping, found [1]"),
    "no number": ({**ROW, "run": True}, "run: expected a number from 0 to 2, found True"),
    "beyond": ({**ROW, "run": 3}, "run: expected a number from 0 to 2, found 3"),
    "negative": ({**ROW, "run": -1}, "found -1"),
    "no verdict": ({**ROW, "verdict": None}, "verdict: expected text, found None"),
    "message": ({**ROW, "message": {"a": 1}}, "message: expected text, found a mapping with keys a"),
    "error": ({**ROW, "final_error.x": "small"}, "final_error.x: expected a number, found 'small'"),
    "redrawn": ({**ROW, "redrawn": [1]}, "redrawn: expected a number, found [1]"),
    "large": ({**ROW, "n": 10**30}, "n: 1000000000000000000000000000000 is too large"),
    "digits": (b'{"run": ' + b"1" * 5000 + b"}\n", "line 1 is not the row of a run: "),
}


def folder(path, line, **specification):
    content = {"runs": 3, "scenario": "space-robot", "options": {}, **specification}
    (path / "specification.json").write_text(json.dumps(content))
    (path / "runs.jsonl").write_bytes(line if isinstance(line, bytes) else json.dumps(line).encode() + b"\n")
    return path


@pytest.mark.parametrize(("line", "words"), LINES.values(), ids=LINES)
def test_a_line_that_is_no_run_is_refused(line, words, tmp_path):
    with pytest.raises(rnc.ConfigurationError) as caught:
        rnc.load_sweep(folder(tmp_path, line))
    assert str(tmp_path / "runs.jsonl") in str(caught.value)
    assert words in str(caught.value)


SPECIFICATIONS = ["[]", "{}", "{", '{"runs": 3}', '{"runs": "3", "build": "f"}', '{"runs": 3, "scenario": 1}',
    '{"runs": 3, "scenario": "space-robot", "options": [1]}', "[" * 100_000]  # fmt: skip


@pytest.mark.parametrize("text", SPECIFICATIONS, ids=range(len(SPECIFICATIONS)))
def test_what_is_no_specification_is_refused(text, tmp_path):
    (tmp_path / "specification.json").write_text(text)
    with pytest.raises(rnc.ConfigurationError, match=r"specification\.json: (is not|cannot be read)"):
        rnc.load_sweep(tmp_path)


@pytest.mark.parametrize("force", [False, True])
def test_a_link_is_neither_followed_nor_replaced(force, tmp_path):
    out, elsewhere = tmp_path / "out", tmp_path / "mine"
    elsewhere.write_text("mine")
    results = rnc.sweep("space-robot", 1, options={"simulation.duration": 0.02}, out=out)
    (results.path / "runs.jsonl").unlink()
    (results.path / "runs.jsonl").symlink_to(elsewhere)
    with pytest.raises(rnc.ConfigurationError, match=r"'runs\.jsonl' is not a sweep's own"):
        rnc.sweep("space-robot", 2, options={"simulation.duration": 0.02}, out=out, force=force)
    assert elsewhere.read_text() == "mine"


def test_a_pipe_does_not_block(tmp_path):
    folder(tmp_path, b"")
    (tmp_path / "runs.jsonl").unlink()
    os.mkfifo(tmp_path / "runs.jsonl")
    with pytest.raises(rnc.ConfigurationError, match=r"runs\.jsonl: cannot be read: Not a regular file"):
        rnc.load_sweep(tmp_path)
