"""Peers in environments of their own, because they need other versions of Pinocchio than ours."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path
from typing import Any


def answer(peer: str, variable: str, script: Path, problem: dict[str, Any], *arguments: str) -> dict[str, Any] | None:
    """Answer of a script to a problem, both as JSON; None after a line that says why there is none.

    Args:
        peer: name of the peer.
        variable: environment variable that names the interpreter.
        script: reads the problem, and writes the answer as its last line.
        problem: JSON content.
        *arguments: arguments of the script.
    """
    interpreter = os.environ.get(variable)
    if not interpreter:
        print(f"  {peer} is missing: {variable} names no interpreter of an environment that has it")
        return None
    command = [interpreter, str(script), *arguments]
    done = subprocess.run(command, input=json.dumps(problem), text=True, capture_output=True, check=False)
    if done.returncode:
        print(f"  {peer} is missing: {interpreter}: {done.stderr.strip().splitlines()[-1]}")
        return None
    found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return found
