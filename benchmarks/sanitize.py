"""Tests of the compiled kernel under the address sanitizer.

Compiles the kernel with gcc's address and undefined-behaviour sanitizers into a temporary folder, and runs
the tests that compare it with NumPy; names of other tests may follow the command. Any access outside an array ends
the run with a report. Needs a source tree, gcc with libasan, and the packages of the extras ``test`` and ``dev``.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

from hatch_build import compile_kernel

ROOT = Path(__file__).parent.parent
FLAGS = ("-O1", "-g", "-fno-omit-frame-pointer", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
TESTS = (
    "tests/model/test_twins.py", "tests/model/test_compiled.py", "tests/analysis/test_derivatives.py",
    "tests/plants/test_friction.py", "tests/simulation/test_batch.py",
)  # fmt: skip
RUN = """
import importlib.util, sys
spec = importlib.util.spec_from_file_location("rnc_pin._kernel.compiled", sys.argv[1])
sys.modules[spec.name] = importlib.util.module_from_spec(spec)  # in place of the installed library
spec.loader.exec_module(sys.modules[spec.name])
import pytest
sys.exit(pytest.main(["-q", "-p", "no:cacheprovider", *sys.argv[2:]]))
"""


def runtime(name: str) -> str:
    """Path of a library of the compiler, which has to be loaded before Python."""
    compiler = os.environ.get("CC", "cc")
    command = [compiler, f"-print-file-name={name}"]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()


def main(tests: list[str]) -> int:
    """Run tests with the sanitized kernel; return the exit status."""
    with tempfile.TemporaryDirectory() as folder:
        library = Path(folder) / "compiled.abi3.so"
        compile_kernel(ROOT, library, *FLAGS)
        environment = {
            **os.environ,
            "LD_PRELOAD": f"{runtime('libasan.so')} {runtime('libubsan.so')}",
            "ASAN_OPTIONS": "detect_leaks=0",  # Python itself keeps memory until it ends
            "RNC_PIN_KERNEL": "c",
        }
        command = [sys.executable, "-c", RUN, str(library), *(tests or TESTS)]
        return subprocess.run(command, env=environment, cwd=ROOT, check=False).returncode


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
