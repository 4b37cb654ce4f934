"""Measure the best use of the redundancy of every robot of the zoo again, as the page on redundancy shows it.

``python docs/make_redundancy.py`` makes ``docs/data/redundancy.json``, which takes about an hour;
``python docs/make_redundancy.py tiago ur5_robot`` these rows only.
"""

import multiprocessing
import re
import sys
import tempfile
import warnings
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path += [str(ROOT / "tests" / "support"), str(ROOT)]  # last: the installed rnc_pin has the compiled kernel

import zoo  # noqa: E402
from rnc_pin.analysis import short_names  # noqa: E402
from rnc_pin.applications.init import best_rows, draft, find_uses, scenario_of  # noqa: E402
from rnc_pin.applications.scenario.scenario import Scenario  # noqa: E402
from rnc_pin.errors import RncError, few  # noqa: E402
from tools import tables  # noqa: E402

LONGEST = 300.0  # [s] for one robot


def short(names: tuple[str, ...]) -> str:
    return few(short_names(names).split(", "))


def row(name: str) -> tables.Row:
    """Draft of one robot, its best use that actuators drive, and the run of the scenario that is made of it."""
    warnings.simplefilter("ignore")
    made = dict.fromkeys(("robot", "at rest", "best use", "class", "by", "run"), "") | {"robot": name}
    try:
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "draft.yaml"
            file.write_text(draft(name, file.parent), encoding="utf-8")
            scenario = Scenario.load(file)
            found, failures = find_uses(scenario)
            uses = [found[k] for k in best_rows(found, len(found)) if found[k].use.driven]
            best = next((each for each in uses if each.use.redundancy_class), None)
            if best is None:
                return made | {"best use": "none", "run": failures[0].partition(":")[0] if failures else ""}
            use = best.use
            made |= {"at rest": short(best.exploration.primary), "best use": short(use.vertical)}
            made |= {"class": str(use.redundancy_class), "by": short(use.actuators or use.redundant)}
            verdict = scenario_of(best)[1]
            return made | {"run": "succeeded" if verdict.succeeded else str(verdict.first)}
    except RncError as error:
        return made | {"run": re.sub(r"\S*/", "", str(error)).replace("|", "/")[:160]}  # without folders


def main(wanted: list[str]) -> None:
    names = list(dict.fromkeys(name for name, _ in zoo.entries()))
    known = (tables.DATA / "redundancy.json").is_file()
    rows = {each["robot"]: each for each in tables.read("redundancy")["zoo"]} if known else {}
    for name in wanted or names:
        with multiprocessing.get_context("spawn").Pool(1) as pool:
            try:
                rows[name] = pool.apply_async(row, (name,)).get(LONGEST)
            except multiprocessing.TimeoutError:
                cells = dict.fromkeys(("at rest", "best use", "class", "by"), "")
                rows[name] = {"robot": name, **cells, "run": f"not within {LONGEST:g} s"}
        print(*rows[name].values(), sep=" | ", flush=True)
        tables.write("redundancy", {"zoo": [rows[each] for each in names if each in rows]})


if __name__ == "__main__":
    main(sys.argv[1:])
