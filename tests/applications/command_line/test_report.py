"""Progress of a command without a terminal."""

import time

import pytest

from rnc_pin.applications.command_line import messages
from rnc_pin.applications.command_line.report import progress_bar


@pytest.mark.parametrize("quiet", [False, True])
def test_a_log_gets_a_line_each_minute(quiet, monkeypatch, capsys):
    monkeypatch.setattr(messages, "_MINUTE", 0.02)
    with progress_bar(10.0, "driving", quiet) as advance:
        advance(4.0, "driving")
        time.sleep(0.5)
    first, *lines = capsys.readouterr().out.splitlines() or [""]
    assert (first, set(lines)) == (("", set()) if quiet else ("driving ...", {"driving: 40 %, 0 min ..."}))
