"""Build hook: compiles the kernel if a C compiler and Python.h are present; otherwise the wheel is pure Python."""

from __future__ import annotations

import os
import shutil
import subprocess
import sysconfig
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

SOURCE, LIBRARY = "rnc_pin/_kernel/kernel.c", "rnc_pin/_kernel/compiled.abi3.so"
# Without contraction to fused multiply-add, results do not depend on the processor.
OPTIONS = ("-O3", "-ffp-contract=off", "-std=c11", "-fPIC", "-shared")


def compile_kernel(root: Path, target: Path, *options: str) -> None:
    """Compile the kernel of a source tree into a library.

    Raises:
        OSError: there is no C compiler.
        subprocess.CalledProcessError: it failed, e.g. without Python.h.
    """
    compiler, headers = os.environ.get("CC", "cc"), sysconfig.get_paths()["include"]
    command = [compiler, *OPTIONS, *options, f"-I{headers}", str(root / SOURCE), "-o", str(target), "-lm"]
    subprocess.run(command, check=True, capture_output=True, text=True)


class KernelHook(BuildHookInterface):  # type: ignore[type-arg]
    """Hook of hatchling. An editable installation gets the library in its source tree, a wheel in its own files."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        root, editable = Path(self.root), version == "editable"
        self._folder = tempfile.TemporaryDirectory()
        built = Path(self._folder.name) / Path(LIBRARY).name
        try:
            compile_kernel(root, built)
            if editable:
                fresh = shutil.copyfile(built, (root / LIBRARY).with_suffix(".new"))
                fresh.replace(root / LIBRARY)  # a running process keeps the library that it loaded
        except (OSError, subprocess.SubprocessError) as error:
            reason = (getattr(error, "stderr", None) or str(error)).strip().splitlines()[0]
            self.app.display_warning(f"rnc_pin: no compiled kernel, so NumPy evaluates models: {reason}")
            return
        if not editable:
            build_data["force_include"][str(built)] = LIBRARY
            platform = sysconfig.get_platform().replace("-", "_").replace(".", "_")
            build_data["tag"], build_data["pure_python"] = f"cp311-abi3-{platform}", False

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        self._folder.cleanup()
