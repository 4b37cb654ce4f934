"""Make ``docs/zoo.md`` again: every robot of example-robot-data, reduced and checked (``python docs/make_zoo.py``)."""

import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent / "tests"))

import zoo  # noqa: E402

HEAD = """# The zoo

Every robot of [example-robot-data](https://github.com/Gepetto/example-robot-data) under constraints that any can have:

* **momentum**: a free base in space, gravity off, six momentum rows; the joints are the reducing outputs;
* **knife edge**: a planar base on a skate, under gravity; forward speed, heading and the joints;
* **rolling wheels**: the robot on its own wheels, where it has such; the velocities that parametrise its motion best.

Figures are the worst of {states} random states, relative to size:

* **A R**, with unit rows and columns;
* **Lemma 1**: `H = H^T`, `Hdot = V + V^T` by finite differences, `V` linear in `v2`; H is positive definite throughout;
* **KKT**: accelerations, each weighted by what it moves, against Pinocchio's own solution of the constrained dynamics,
  `pin.forwardDynamics(model, data, q, v, tau, A, Adot v)`.

Nothing is left out: what is refused stands at the end, with the reason. `tests/test_zoo.py` runs all of it, the excuses
too, and `python docs/make_zoo.py` writes this page.

{passed} systems of {robots} robots pass, {excused} are excused.

| robot | constraint | base | dof | rows kept | r | A R | Lemma 1 | KKT | remarks |
|---|---|---|---|---|---|---|---|---|---|
"""
EXCUSES = """
## Not in the zoo

| robot | constraint | reason |
|---|---|---|
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


def page() -> str:
    passing = [entry for entry in zoo.entries() if entry not in zoo.EXCUSED]
    excuses = [(name, kind, reason) for (name, kind), (_, reason) in zoo.EXCUSED.items()]
    excuses += [(name, "all", reason) for name, reason in zoo.WITHOUT_URDF.items()]
    head = HEAD.format(
        states=zoo.STATES, passed=len(passing), robots=len({name for name, _ in passing}), excused=len(excuses)
    )
    rows = "\n".join(row(zoo.residuals(*entry)) for entry in passing)
    return head + rows + "\n" + EXCUSES + "".join(f"| {' | '.join(excuse)} |\n" for excuse in excuses)


if __name__ == "__main__":
    (HERE / "zoo.md").write_text(page())
