"""Verdicts beside an independent replay by Pinocchio and coal: no finding is missed, and none is invented."""

import pytest

from benchmarks import verdicts


@pytest.mark.parametrize("number", [0, 4, 5])
def test_drawn_runs_are_judged_as_they_are(number):
    """One of each scenario; with seed 0 they hit boxes, and exceed positions, velocities and efforts."""
    case = verdicts.drawn_case(0, number)
    assert [str(kind) for kind, each in case.items() if each.true not in (None, each.found)] == []


@pytest.mark.long
def test_two_hundred_drawn_runs_and_all_built_in_scenarios(capsys, monkeypatch):
    monkeypatch.setattr("sys.argv", ["verdicts", "--runs", "200"])
    verdicts.main()
    out = capsys.readouterr().out
    for line in out.splitlines():
        if line.startswith("| ") and not line.startswith("| finding"):
            missed, invented = line.split("|")[3:5]
            assert (int(missed), int(invented)) == (0, 0), out
