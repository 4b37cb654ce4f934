"""Results of benchmarks with date, machine and command: one file each in ``benchmarks/results``, one page of all."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
import time
from datetime import date
from pathlib import Path

FOLDER = Path(__file__).parent / "results"
PAGE = Path(__file__).parents[1] / "docs" / "results.md"
_WIDTH = "132"  # columns of tables on the page
_HEAD = """# Results

This page has the results of `python -m benchmarks`, one section for each benchmark, with date, machine and command.
`python -m benchmarks --record NAME ...` runs a benchmark again and replaces its section. Nothing here is typed by hand.

*Load* is the number of busy processes of the machine, before and after. Times are processor times where a benchmark
does not say otherwise. Compare ratios: times of one machine differ by tens of percent between days.
[Performance](performance.md) says what the figures mean.
"""


def machine() -> str:
    """Processor, number of processors in use, system and Python."""
    cpu = Path("/proc/cpuinfo")
    lines = cpu.read_text().splitlines() if cpu.is_file() else []
    named = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    count = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    cores = f"{count} processor{'' if count == 1 else 's'}"
    name = named[0] if named else platform.processor()
    return f"{name}, {cores}, {platform.system()}, Python {platform.python_version()}"


def record(name: str, arguments: list[str]) -> None:
    """Run a benchmark, show its output, and keep it if it succeeds.

    Args:
        name: its name.
        arguments: its arguments.
    """
    command = [sys.executable, "-m", "benchmarks", name, *arguments]
    before, start = os.getloadavg()[0], time.monotonic()
    lines = []
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=os.environ | {"COLUMNS": _WIDTH}) as run:
        for line in run.stdout or ():
            print(line, end="", flush=True)
            lines.append(line.rstrip())
    if run.returncode:
        sys.exit(f"{name} ended with status {run.returncode}: nothing is recorded")
    commit = subprocess.run(["git", "rev-parse", "--short", "HEAD"], cwd=FOLDER.parent, capture_output=True, text=True)
    facts = {
        "command": " ".join(["python -m benchmarks", name, *arguments]),
        "date": date.today().isoformat(),
        "machine": machine(),
        "commit": commit.stdout.strip() or "unknown",
        "load": f"{before:.1f} before, {os.getloadavg()[0]:.1f} after",
        "duration": f"{time.monotonic() - start:.0f} s",
    }
    FOLDER.mkdir(exist_ok=True)
    head = "".join(f"{key}: {value}\n" for key, value in facts.items())
    output = "\n".join(lines).strip("\n")
    section = "-".join([name, *(each for each in arguments[:1] if each[0] != "-" and not each.isdigit())])
    (FOLDER / f"{section}.txt").write_text(f"{head}\n{output}\n", encoding="utf-8")


def page(known: dict[str, str]) -> str:
    """Text of the page with all recorded results.

    Args:
        known: first sentence of each benchmark, by name.
    """
    sections = [_section(path, known[path.stem.split("-")[0]]) for path in sorted(FOLDER.glob("*.txt"))]
    return "\n".join([_HEAD, *sections])


def _section(path: Path, said: str) -> str:
    head, _, output = path.read_text(encoding="utf-8").partition("\n\n")
    facts = dict(line.split(": ", 1) for line in head.splitlines())
    measured = (
        f"{facts['date']}, {facts['machine']}, commit {facts['commit']}; load {facts['load']}; {facts['duration']}"
    )
    shown = output if "\n|---" in output else f"```text\n{output}```\n"
    return f"## {path.stem}\n\n{said}\n\n`{facts['command']}`: {measured}.\n\n{shown}"
