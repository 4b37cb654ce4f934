"""Write docs/random_tasks.md from the folders of ``rnc-pin sweep NAME --runs 200 --jobs -1 --out DIR``.

Those of figures 5 to 7 had ``--set simulation.dt=0.01`` as well, which saves four fifths of the time.

Run ``python docs/make_random_tasks.py DIR...``.
"""

import json
import sys
from pathlib import Path

PAGE = Path(__file__).parent / "random_tasks.md"
HEAD = """# Random tasks

This page shows the scaled gains on random tasks. `rnc-pin sweep NAME --runs 200 --out DIR` draws starts and goals from
the ranges under `sweep` in the scenario file. Each run has its own seed.

* The runs of figures 5 to 7 have a sample time of 10 ms (`--set simulation.dt=0.01`).
* Figure 6 also draws the first estimates. Figure 7 also draws the final heading of the platform.
* A task that preflight rejects is drawn again, up to nineteen times. The reasons are a singular value of E or A4 below
  0.01 along the path, no gains that suit the inertia, or no path.
* In figure 6, two of 200 runs found no task whose gains suit a period of 10 ms.
* The largest errors of figure 6 belong to one run. It came within 0.002 of a singular configuration. All other runs end
  within 0.007.

Final errors are in m or rad. `tests/system/test_random_tasks.py` runs some of these tasks.
`python docs/make_random_tasks.py DIR...` writes this page.

| scenario | runs | outcomes | drawn again | output | median | 95 % below | largest |
|---|---|---|---|---|---|---|---|
"""


def main(folders: list[str]) -> None:
    lines = []
    for folder in folders:
        content = json.loads((Path(folder) / "sweep.json").read_text())
        outcomes = ", ".join(f"{count} {name}" for name, count in content["outcomes"].items())
        first = [f"`{content['scenario']}`", str(content["runs"]), outcomes, str(content["redrawn"])]
        for output, figures in content["final_error"].items():
            numbers = [f"{figures[key]:.1e}" for key in ("median", "95 %", "max")]
            lines.append("| " + " | ".join([*first, f"`{output}`", *numbers]) + " |")
            first = [""] * 4
    PAGE.write_text(HEAD + "\n".join(lines) + "\n")


if __name__ == "__main__":
    main(sys.argv[1:])
