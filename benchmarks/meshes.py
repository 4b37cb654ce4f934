"""Mesh files beside the loader of coal, which this package does not use: the same boxes, the same number of triangles?

    python -m benchmarks.meshes FOLDER...

It is code without checks: give it no files of strangers.
"""

from __future__ import annotations

import argparse
import os
import time
from collections import Counter
from pathlib import Path

import coal
import numpy as np

from rnc_pin.robots.sources.mesh_formats import FORMATS, MeshError, read_mesh

SINGLE = 2e-6  # of the largest coordinate: coal's loader keeps single precision


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="+", type=Path)
    folders = parser.parse_args().folders
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # coal's loader talks
    count: Counter[str] = Counter()
    ours = theirs = 0.0
    for path in sorted(path for folder in folders for path in folder.rglob("*") if path.suffix.lower() in FORMATS):
        start = time.perf_counter()
        fault = None
        try:
            mesh = read_mesh(path)
        except MeshError as error:
            fault = error
        middle = time.perf_counter()
        try:
            loaded = coal.MeshLoader().load(str(path), np.ones(3))
        except Exception:  # Boost.Python raises whatever the C++ side threw
            loaded = None
        ours, theirs = ours + middle - start, theirs + time.perf_counter() - middle
        if fault is not None or loaded is None:
            ending = "refused by both" if fault and loaded is None else "refused" if fault else "read here alone"
        else:
            points, others = mesh.vertices, np.array(loaded.vertices())
            boxes = [np.stack([each.min(axis=0), each.max(axis=0)]) for each in (points, others)]
            near = np.abs(boxes[0] - boxes[1]).max() <= SINGLE * np.abs(others).max()
            ending = "alike" if near and len(mesh.triangles) == loaded.num_tris else "different"
        count[f"{path.suffix.lower()} {ending}"] += 1
        if ending != "alike":
            print(f"{path}: {ending}: {fault or ''}")
    for ending, number in sorted(count.items()):
        print(f"{ending:24} {number:6,}")
    print(f"{ours:.0f} s here, {theirs:.0f} s by coal, which also builds trees of boxes")


if __name__ == "__main__":
    main()
