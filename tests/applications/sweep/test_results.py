"""Results of a sweep: columns and statistics."""

import csv
import json
import math
import os

import pytest

import rnc_pin as rnc
from rnc_pin.applications.sweep.results import sweep_statistics
from rnc_pin.applications.sweep.runs import SeededDraws
from urdf_parts import write


def test_columns_and_statistics_of_rows_with_different_values(tmp_path):
    rows = [
        {"run": 2, "a": 1.5, "n": 3, "b": True, "what": [1, 2], "verdict": "failed", "finding": "goal"},
        {"run": 0, "a": 0.1, "n": None, "b": False, "redrawn": 4},
        {"run": 1, "a": 1, "n": 2, "b": True, "redrawn": 1, "final_error.x": 0.25},
    ]
    common = {"outcome": "completed", "verdict": "succeeded", "finding": "", "message": "a, b"}
    (tmp_path / "runs.jsonl").write_text("".join(json.dumps({**common, **row}) + "\n" for row in rows))
    (tmp_path / "specification.json").write_text('{"runs": 4, "build": "f"}')
    results = rnc.load_sweep(tmp_path)
    assert (len(results), results.complete) == (3, False)
    assert (results["run"].tolist(), results["a"].tolist()) == ([0, 1, 2], [0.1, 1.0, 1.5])
    assert results["n"].tolist() == pytest.approx([math.nan, 2.0, 3.0], nan_ok=True)
    assert (results["b"].dtype, results["what"].tolist()) == (bool, [None, None, [1, 2]])
    assert (results.drawn, results.verdicts) == (["a", "n", "b", "what"], {"succeeded": 2, "goal": 1})
    assert [row["run"] for row in results.failures()] == [2]
    found = sweep_statistics(results)
    assert (found["redrawn"], found["final_error"]) == (5, {"x": {"median": 0.25, "95 %": 0.25, "max": 0.25}})
    results.to_csv(tmp_path / "all.csv")
    with (tmp_path / "all.csv").open(newline="") as file:
        table = list(csv.DictReader(file))
    assert [row["a"] for row in table] == ["0.1", "1", "1.5"]
    assert (table[0]["n"], table[2]["what"], table[2]["message"]) == ("", "[1, 2]", "a, b")
    with pytest.raises(rnc.InputError, match="no column 'vedict'; did you mean 'verdict'"):
        results["vedict"]
    with pytest.raises(rnc.InputError, match="no finished run 3"):
        results.row(3)


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

DRAWS = {"seed": 4, "distributions": {"mass": [1.0, 2.0], "wheel": {"choice": ["a", "b"]}}}
OWN, OTHER = ({**ROW, **next(SeededDraws.of(DRAWS["distributions"], 4).of_run(run))} for run in (0, 1))
STRANGE = {
    "values of another run": ([OTHER], "mass: run 0 of this sweep draws 1."),
    "no values": ([ROW], "found None"),
    "another draw": ([{**OWN, "redrawn": 1}], "mass: run 0 of this sweep draws "),
    "endless draws": ([{**OWN, "redrawn": 10**15}], "redrawn: expected a number from 0 to 19"),
    "twice": ([OWN, OWN], "run: 0 is there twice"),
}


@pytest.mark.parametrize(("rows", "words"), STRANGE.values(), ids=STRANGE)
def test_a_row_that_has_other_values_than_its_run_draws_is_refused(rows, words, tmp_path):
    assert len(rnc.load_sweep(folder(tmp_path, OWN, draws=DRAWS))) == 1
    with pytest.raises(rnc.ConfigurationError, match="is not the row of a run: ") as caught:
        rnc.load_sweep(folder(tmp_path, b"".join(json.dumps(row).encode() + b"\n" for row in rows), draws=DRAWS))
    assert words in str(caught.value)


MACRO = '<robot xmlns:xacro="http://ros.org/xacro"><xacro:property name="mass" value="{}"/></robot>'
SLEIGH = """<robot name="sleigh" xmlns:xacro="http://ros.org/xacro"><xacro:include filename="parts/mass.xacro"/>
<link name="sleigh"><inertial><mass value="${mass}"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>
</inertial><collision><geometry><mesh filename="hull.obj"/></geometry></collision></link></robot>"""
HULL = "v 0 0 {}\nv 1 0 0\nv 0 1 0\nv 0 0 -1\nf 1 2 3\nf 1 2 4\nf 2 3 4\nf 1 3 4\n"
LOT = "image: lot.pgm\nresolution: 0.5\norigin: [5, 5, 0]\nnegate: 0\noccupied_thresh: 0.6\nfree_thresh: 0.2\n"
SCENARIO = """
robot: {urdf: sleigh.urdf.xacro, base: planar}
constraints: [{no_side_slip: {frame: sleigh}}]
obstacles: [{map: {file: lot.yaml}}]
controller: {type: none}
sweep: {simulation.duration: {choice: [0.02, 0.03]}}
"""
READ = {
    "included macro": ("parts/mass.xacro", MACRO.format(3)),
    "mesh": ("hull.obj", HULL.format(2)),
    "picture of a map": ("lot.pgm", "P2 2 2 255\n0 255 255 0\n"),
}


@pytest.mark.parametrize(("name", "text"), READ.values(), ids=READ)
def test_a_sweep_does_not_continue_after_a_file_that_it_read_changed(name, text, tmp_path):
    files = {"sleigh.urdf.xacro": SLEIGH, "parts/mass.xacro": MACRO.format(2), "hull.obj": HULL.format(1),
        "lot.yaml": LOT, "lot.pgm": "P2 2 2 255\n0 255 255 255\n", "run.yaml": SCENARIO}  # fmt: skip
    for each, content in files.items():
        write(tmp_path / each, content)
    run = tmp_path / "run.yaml"
    assert rnc.sweep(run, 1, out=tmp_path / "out").row(0)["message"] == ""
    assert len(rnc.sweep(run, 2, out=tmp_path / "out")) == 2
    (tmp_path / name).write_text(text)
    with pytest.raises(rnc.ConfigurationError, match=f"holds another sweep: its files.{name} is "):
        rnc.sweep(run, 3, out=tmp_path / "out")


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
