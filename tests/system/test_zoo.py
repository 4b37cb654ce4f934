"""The zoo: every robot of example-robot-data, published robots, and docs/data/zoo.json, which has their tables."""

import re

import pytest

import published
import rnc_pin as rnc
import zoo
from rnc_pin.robots.robot_files import example_urdfs
from tolerances import CONSTRAINT, KKT, LEMMA_1
from tools import tables

# Each robot on its wheels, or under one constraint; -m long has it under the other one, too.
SHORT = {(name, ("momentum", "knife edge")[k % 2]) for k, name in enumerate(sorted(example_urdfs()))}
PASSING = [
    entry if entry[1] == "rolling wheels" or entry in SHORT else pytest.param(entry, marks=pytest.mark.long)
    for entry in zoo.entries()
    if entry not in zoo.EXCUSED
]
TABLES = tables.read("zoo")
SYSTEMS = {(row["robot"], row["constraint"]): row for row in TABLES["systems"]}
EXCUSED = {(row["robot"], row["constraint"]): row["reason"] for row in TABLES["excused"]}


def label(entry):
    return " ".join(entry)


@pytest.mark.parametrize("entry", PASSING, ids=label)
def test_robot_of_the_zoo(entry):
    found = zoo.residuals(*entry)
    assert found.constraint_residual < CONSTRAINT
    assert found.lemma_1 < LEMMA_1
    assert found.smallest_eigenvalue > 0
    assert found.kkt < KKT
    row = SYSTEMS[entry]
    assert (row["base"], row["dof"], row["r"]) == (found.base, str(found.n), str(found.r))
    assert row["rows kept"] == f"{found.kept} of {found.rows}"
    for figure, tolerance in (("A R", CONSTRAINT), ("Lemma 1", LEMMA_1), ("KKT", KKT)):
        assert float(row[figure]) < tolerance


@pytest.mark.parametrize("entry", zoo.EXCUSED, ids=label)
def test_an_excuse_is_true(entry):
    name, kind = entry
    complaint, reason = zoo.EXCUSED[entry]
    with pytest.raises(rnc.RncError, match=re.escape(complaint)):
        zoo.KINDS[kind](name)
    assert EXCUSED[entry] == reason


def test_the_tables_list_every_robot_and_nothing_else():
    assert SYSTEMS.keys() | EXCUSED.keys() == {*zoo.entries(), *((name, "all") for name in zoo.WITHOUT_URDF)}


def test_no_robot_is_left_out():
    assert {name for name, _ in zoo.entries()} == set(example_urdfs())


def test_every_robot_with_wheels_is_on_them_or_says_why_not():
    wheeled = {name for name in example_urdfs() if zoo.wheel_links(name)}
    assert wheeled == {name for name, kind in zoo.entries() if kind == "rolling wheels"}


@pytest.mark.parametrize(("name", "growth"), [
    ("tiago_pro", (22, 24)),
    pytest.param("tiago_dual", (99, 100, 101), marks=pytest.mark.long),  # as Tiago with one hand
])  # fmt: skip
def test_growth_vectors_of_wheeled_robots(name, growth):
    """Closed forms: the base can go sideways beyond its velocities, or to any place on the plane.

    Of four Mecanum wheels the sum of the front rates equals that of the rear ones, and the heading is a combination
    of wheel angles.
    """
    reduced = zoo.KINDS["rolling wheels"](name)
    assert rnc.analysis.integrability(reduced, [zoo.states(reduced)[0][0]]).growth_vector == growth


def test_two_robots_of_one_name_are_told_apart():
    with pytest.raises(rnc.ModelError, match="expected one of anymal_b_simple/anymal, anymal_c_simple/anymal"):
        rnc.Robot.from_example("anymal")
    both = [rnc.Robot.from_example(f"anymal_{each}_simple/anymal") for each in "bc"]
    assert both[0].model.inertias[1].mass != both[1].model.inertias[1].mass


TABLE = {row["robot"]: row for row in tables.read("zoo")["published"]}


@pytest.mark.published
@pytest.mark.parametrize("name", published.ROBOTS)
def test_a_published_robot_goes_through_as_the_table_says(name, tmp_path):
    if not published.ROBOTS[name].installed:
        pytest.skip(f"{published.ROBOTS[name].package} is not installed")
    found, row = published.measured(name, tmp_path), TABLE[name]
    assert (not found.refusal) == (row["ran"] == "yes"), found.refusal
    if not found.refusal:
        assert found.kind.removeprefix("base ") == row["base: kind drafted"], "python docs/make_zoo.py makes it anew"
        assert str(found.report["r"]) == row["r"]


def test_the_table_lists_every_published_robot_of_which_nine_of_ten_go_through():
    assert list(TABLE) == list(published.ROBOTS)
    assert len([row for row in TABLE.values() if row["ran"] == "yes"]) >= 0.9 * len(TABLE)
