"""Write ``docs/data/random_tasks.json`` from the folders of ``rnc-pin sweep NAME --runs 200 --jobs -1 --out DIR``.

Those of figures 5 to 7 had ``--set simulation.dt=0.01`` as well, which saves four fifths of the time.

Run ``python docs/make_random_tasks.py DIR...``.
"""

import json
import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1]))  # last: the installed rnc_pin has the compiled kernel

from tools import tables

FIGURES = {"median": "median", "95 %": "95 % below", "max": "largest"}


def rows(content: dict) -> list[tables.Row]:
    """Rows of one sweep: one for each output, the first of them with what all share."""
    outcomes = ", ".join(f"{count} {name}" for name, count in content["outcomes"].items())
    shared = {"scenario": f"`{content['scenario']}`", "runs": str(content["runs"]), "outcomes": outcomes}
    shared["drawn again"] = str(content["redrawn"])
    found = []
    for output, figures in content["final_error"].items():
        numbers = {head: f"{figures[key]:.1e}" for key, head in FIGURES.items()}
        found.append({**shared, "output": f"`{output}`", **numbers})
        shared = dict.fromkeys(shared, "")
    return found


if __name__ == "__main__":
    sweeps = [json.loads((Path(folder) / "sweep.json").read_text()) for folder in sys.argv[1:]]
    tables.write("random_tasks", {"tasks": [row for content in sweeps for row in rows(content)]})
