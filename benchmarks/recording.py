"""Results of benchmarks with date, machine and command: one file each in ``benchmarks/results``."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
import time
from datetime import date
from pathlib import Path

FOLDER = Path(__file__).parent / "results"
_WIDTH = "132"  # columns of tables


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


def sections() -> str:
    """Text of ``docs/results.md`` below its head: a section for each recorded result."""
    return "\n".join(_section(path) for path in sorted(FOLDER.glob("*.txt")))


def _section(path: Path) -> str:
    head, _, output = path.read_text(encoding="utf-8").partition("\n\n")
    facts = dict(line.split(": ", 1) for line in head.splitlines())
    measured = (
        f"{facts['date']}, {facts['machine']}, commit {facts['commit']}; load {facts['load']}; {facts['duration']}"
    )
    shown = output if "\n|---" in output else f"```text\n{output}```\n"
    return f"## {path.stem}\n\n`{facts['command']}`: {measured}.\n\n{shown}"
