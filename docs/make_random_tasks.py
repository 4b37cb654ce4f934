"""Write docs/random_tasks.md from the folders of ``rnc-pin sweep NAME --runs 200 --jobs -1 --out DIR``.

Those of figures 5 to 7 had ``--set simulation.dt=0.01`` as well, which saves four fifths of the time.

Run ``python docs/make_random_tasks.py DIR...``.
"""

import json
import sys
from pathlib import Path

PAGE = Path(__file__).parent / "random_tasks.md"
HEAD = """# Random tasks

What the scaled gains do on tasks that nobody picked: `rnc-pin sweep NAME --runs 200 --out DIR` draws starts and goals
from the ranges under `sweep` in the scenario's file, with a seed of its own for each run; those of figures 5 to 7 were
sampled every 10 ms (`--set simulation.dt=0.01`). In figure 6 the first estimates are drawn too, in figure 7 the heading
in which the platform should arrive. A task that preflight speaks against (a singular value of E or A4 below 0.01 along
the way, no gains that suit the inertia, no path) is drawn again, up to nineteen times: in figure 6 two of 200 found
none whose gains suit a period of 10 ms. The largest errors there are of one run that came within 0.002 of a singular
configuration; all others end within 0.007. Final errors in m or rad. `tests/system/test_random_tasks.py` runs a few of
the same; `python docs/make_random_tasks.py DIR...` wrote this page.

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
