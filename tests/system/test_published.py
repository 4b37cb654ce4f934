"""Published robots by ``init``, ``inspect`` and ``run``, and their table in docs/data/zoo.json."""

import pytest

import published
from tools import tables

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
