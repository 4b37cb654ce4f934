"""Make ``docs/zoo.md`` again: every robot of example-robot-data, reduced and checked, and what init makes of others.

``python docs/make_zoo.py`` makes all of it, which takes about an hour; ``python docs/make_zoo.py systems`` the first
table only, ``python docs/make_zoo.py husky bike`` the rows of these in the second.
"""

import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).parent
PAGE = HERE / "zoo.md"
sys.path.insert(0, str(HERE.parent / "tests" / "support"))

import published  # noqa: E402
import zoo  # noqa: E402

HEAD = """# The zoo

This page reduces every robot of [example-robot-data](https://github.com/Gepetto/example-robot-data) under three sets of
constraints.

| constraint | base | reducing outputs |
|---|---|---|
| **momentum** | free, in space without gravity; six momentum rows | joints |
| **knife edge** | planar, on a skate, under gravity | forward speed, heading and joints |
| **rolling wheels** | on the robot's own wheels, if it has any | the velocities that parametrise its motion best |

Residuals are the worst of {states} random states, relative to size.

| column | residual |
|---|---|
| **A R** | `A R` with unit rows and columns |
| **Lemma 1** | `H = H^T`; `Hdot = V + V^T` by finite differences; `V` linear in `v2`. H is always positive definite |
| **KKT** | accelerations, weighted by the inertia that they move, against Pinocchio's own constrained dynamics |

Pinocchio's function is `pin.forwardDynamics(model, data, q, v, tau, A, Adot v)`.

The page omits no robot. Excused systems are at the end, with their reasons.
`tests/system/test_zoo.py` runs all systems,
excused ones too. `python docs/make_zoo.py` writes this page.

{passed} systems of {robots} robots pass, {excused} are excused.

| robot | constraint | base | dof | rows kept | r | A R | Lemma 1 | KKT | remarks |
|---|---|---|---|---|---|---|---|---|---|
"""
EXCUSES = """
## Not in the zoo

| robot | constraint | reason |
|---|---|---|
"""
PUBLISHED = """## Published robots, by init, inspect and run

This table shows robot descriptions of other authors. Each gets `rnc-pin init`, `inspect --samples {samples}` and `run`
for {duration:.0f} s, each in its own process. The descriptions are unchanged, but their meshes are hidden. Xacro files
keep their meshes.

{ran} of {all} work without a change. Kinds and doubts are quotations from the draft. The draft has all doubts, beside
the lines that they concern.

`pytest -m published` repeats this where the packages are installed: `pip install '.[robots]'`, others with
`pip install --no-deps`.

None of these packages contains a robot of the following two kinds.
`tests/applications/init/test_snake_and_ball.py` makes them:

* **snake**: four or more bodies in a row (three if the names say so). Each has wheels without actuators, and the
  vertical joints between them have actuators. The first body follows one wave of a serpenoid. The joints follow by the
  constraints;
* **spherical robot**: a round shell that encloses everything else, with driven joints inside. The joints follow their
  references, and the shell rolls accordingly.

[Your own robot](own_robot.md#let-a-draft-be-written) states the evidence of each decision. Transmissions,
`ros2_control` and simulator plugins name the driven joints. In files without these, efforts, words and habit do.

| robot | package | base: kind drafted | doubts, and the first of them | rows kept | r | ran | time |
|---|---|---|---|---|---|---|---|
"""
PERTURBED = """
## The same robots, changed

A change that means the same robot keeps the kind of its base, or the draft says why not.
`python -m benchmarks.perturbations` drafts each robot again after each of these changes. Its kind is the base, the
family, the trailers, the wheels and the inputs of the base; names do not count.

One draw of 124 robots on 26 November 2026: the shipped ones, those of the tests, those of example-robot-data, and the
published ones above whose draft is not refused.

| change | kept, of tried | says why not | neither |
|---|---|---|---|
| noise of 1 mm and 0.1 degrees (normal) on all placements | 123 of 124 | 1 | 0 |
| other names of links and joints | 122 of 124 | 2 | 0 |
| another order of links and joints | 124 of 124 | 0 | 0 |
| transmissions and plugins removed | 28 of 30 | 2 | 0 |
| drives on another axle | 9 of 9 | 0 | 0 |
| a tenth of the size | 124 of 124 | 0 | 0 |
| ten times the size | 123 of 124 | 1 | 0 |
| mirrored, left for right | 124 of 124 | 0 | 0 |
| all | 777 of 783 (99.2 %) | 6 | 0 |
"""


def remarks(name: str, kind: str) -> str:
    locked, coupled = len(zoo.massless_joints(name)), zoo.mimic_joints(name)
    words = [f"{locked} joints that move no mass are locked"] if locked else []
    words += [f"{coupled} `<mimic>` joint{'s follow' if coupled != 1 else ' follows'}"] if coupled else []
    words += ["Mecanum wheels"] if name in zoo.MECANUM and kind == "rolling wheels" else []
    return "; ".join(words)


def row(found: zoo.Residuals) -> str:
    kept = f"{found.kept} of {found.rows}"
    figures = [f"{value:.0e}" if value else "0" for value in (found.constraint_residual, found.lemma_1, found.kkt)]
    cells = [
        found.robot,
        found.constraint,
        found.base,
        found.n,
        kept,
        found.r,
        *figures,
        remarks(found.robot, found.constraint),
    ]
    return f"| {' | '.join(map(str, cells))} |"


def systems() -> str:
    passing = [entry for entry in zoo.entries() if entry not in zoo.EXCUSED]
    excuses = [(name, kind, reason) for (name, kind), (_, reason) in zoo.EXCUSED.items()]
    excuses += [(name, "all", reason) for name, reason in zoo.WITHOUT_URDF.items()]
    head = HEAD.format(
        states=zoo.STATES, passed=len(passing), robots=len({name for name, _ in passing}), excused=len(excuses)
    )
    rows = "\n".join(row(zoo.residuals(*entry)) for entry in passing)
    return head + rows + "\n" + EXCUSES + "".join(f"| {' | '.join(excuse)} |\n" for excuse in excuses)


def published_row(name: str) -> str:
    """One robot, by the three commands; of a refusal also what becomes of it when its remedy is followed."""
    robot = published.ROBOTS[name]
    with tempfile.TemporaryDirectory() as folder:
        found = published.measured(name, Path(folder))
    if robot.remedy and not found.ran:
        with tempfile.TemporaryDirectory() as folder:
            after = published.measured(name, Path(folder), remedied=True)
        refusal, found = found.refusal.rpartition("/")[2], after
        old, new = (each.replace("\\", "") for each in robot.remedy)
        ran = f"refused: {refusal}; `{new}` for `{old}`: {'yes' if after.ran else after.refusal}"
    else:
        ran = "yes" if found.ran else f"{list(found.statuses)[-1]}: {found.refusal}"
    doubts = f"{found.doubts}: {published.shortened(found.doubt)}" if found.doubts else "0"
    rows = f"{found.kept} of {found.rows}"
    cells = [
        name,
        robot.package,
        found.kind.removeprefix("base "),
        doubts,
        rows,
        found.r,
        ran,
        f"{found.seconds:.0f} s",
    ]
    return f"| {' | '.join(str(each).replace('|', '/') for each in cells)} |"


def published_section(rows: dict[str, str]) -> str:
    """The second table, of rows by robot."""
    kept = [rows[name] for name in published.ROBOTS if name in rows]
    ran = sum("| yes |" in each for each in kept)
    head = PUBLISHED.format(ran=ran, all=len(kept), samples=published.SAMPLES, duration=published.DURATION)
    return head + "".join(f"{each}\n" for each in kept) + PERTURBED


def published_rows(text: str) -> dict[str, str]:
    """The rows of a page that was made before."""
    lines = text.partition(PUBLISHED.splitlines()[0])[2].splitlines()
    return {
        line.split("|")[1].strip(): line
        for line in lines
        if line.split("|")[1:2] and line.split("|")[1].strip() in published.ROBOTS
    }


def write(first: str, rows: dict[str, str]) -> None:
    PAGE.write_text(first.rstrip("\n") + "\n\n" + published_section(rows))


def main(wanted: list[str]) -> None:
    if not wanted or wanted == ["systems"]:
        made = systems()
        write(made, published_rows(PAGE.read_text()))
    for name in [] if wanted == ["systems"] else wanted or published.ROBOTS:
        if not published.ROBOTS[name].installed:
            print(f"{name}: {published.ROBOTS[name].package} is not installed; its row stays as it is")
            continue
        made = published_row(name)
        print(made, flush=True)
        text = PAGE.read_text()
        write(text.partition(PUBLISHED.splitlines()[0])[0], {**published_rows(text), name: made})


if __name__ == "__main__":
    main(sys.argv[1:])
