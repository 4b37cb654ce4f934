"""Measure the tables of the zoo again: every robot of example-robot-data, and what init makes of published robots.

``python docs/make_zoo.py`` makes both tables of ``docs/data/zoo.json``, which takes about an hour;
``python docs/make_zoo.py systems`` the first one only, ``python docs/make_zoo.py husky bike`` rows of the second.
"""

import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path += [str(ROOT / "tests" / "support"), str(ROOT)]  # last: the installed rnc_pin has the compiled kernel

import published  # noqa: E402
import zoo  # noqa: E402
from tools import tables  # noqa: E402


def remarks(name: str, kind: str) -> str:
    locked = len(zoo.massless_joints(name))
    words = [f"{locked} joints that move no mass are locked"] if locked else []
    words += ["Mecanum wheels"] if name in zoo.MECANUM and kind == "rolling wheels" else []
    return "; ".join(words)


def system_row(found: zoo.Residuals) -> tables.Row:
    """One robot under one kind of constraint."""
    figures = {"A R": found.constraint_residual, "Lemma 1": found.lemma_1, "KKT": found.kkt}
    return {
        "robot": found.robot,
        "constraint": found.constraint,
        "base": found.base,
        "dof": str(found.n),
        "rows kept": f"{found.kept} of {found.rows}",
        "r": str(found.r),
        **{name: f"{value:.0e}" if value else "0" for name, value in figures.items()},
        "remarks": remarks(found.robot, found.constraint),
    }


def systems() -> dict[str, list[tables.Row]]:
    """Systems that pass, and those that are excused."""
    excuses = [(name, kind, reason) for (name, kind), (_, reason) in zoo.EXCUSED.items()]
    excuses += [(name, "all", reason) for name, reason in zoo.WITHOUT_URDF.items()]
    return {
        "systems": [system_row(zoo.residuals(*entry)) for entry in zoo.entries() if entry not in zoo.EXCUSED],
        "excused": [dict(zip(("robot", "constraint", "reason"), each, strict=True)) for each in excuses],
    }


def published_row(name: str) -> tables.Row:
    """One robot, by the three commands."""
    robot = published.ROBOTS[name]
    with tempfile.TemporaryDirectory() as folder:
        found = published.measured(name, Path(folder))
    first = [published.shortened(each) for each in found.doubts[:1]]
    kept, dropped = (len(found.report.get(f"{each}_rows", ())) for each in ("kept", "dropped"))
    row = {
        "robot": name,
        "package": robot.package,
        "base: kind drafted": found.kind.removeprefix("base "),
        "doubts, and the first of them": ": ".join([str(len(found.doubts)), *first]),
        "rows kept": f"{kept} of {kept + dropped}",
        "r": str(found.report.get("r", 0)),
        "ran": found.refusal or "yes",
        "time": f"{found.seconds:.0f} s",
    }
    return {key: cell.replace("|", "/") for key, cell in row.items()}


def main(wanted: list[str]) -> None:
    made = tables.read("zoo")
    if not wanted or wanted == ["systems"]:
        made |= systems()
        tables.write("zoo", made)
    rows = {row["robot"]: row for row in made["published"]}
    for name in [] if wanted == ["systems"] else wanted or published.ROBOTS:
        if not published.ROBOTS[name].installed:
            print(f"{name}: {published.ROBOTS[name].package} is not installed; its row stays as it is")
            continue
        rows[name] = published_row(name)
        print(*rows[name].values(), sep=" | ", flush=True)
        made["published"] = [rows[each] for each in published.ROBOTS if each in rows]
        tables.write("zoo", made)


if __name__ == "__main__":
    main(sys.argv[1:])
