"""Results of a sweep: columns and statistics."""

import csv
import json
import math

import pytest

import rnc_pin as rnc
from rnc_pin.applications.sweep.results import sweep_statistics


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
