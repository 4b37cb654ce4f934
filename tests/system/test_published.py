"""Published robots by ``init``, ``inspect`` and ``run``, and their table in docs/data/zoo.json."""

import importlib.util

import pytest

import published
from rnc_pin.robots.robot_files import example_urdfs
from tools import tables

TABLE = {row["robot"]: row for row in tables.read("zoo")["published"]}


def installed(name):
    robot = published.ROBOTS[name]
    if not robot.installed:
        pytest.skip(f"{robot.package} is not installed")
    return robot


@pytest.mark.published
@pytest.mark.parametrize("name", published.ROBOTS)
def test_a_published_robot_goes_through_or_its_remedy_works(name, tmp_path):
    robot = installed(name)
    found = published.measured(name, tmp_path)
    if robot.remedy:
        assert robot.complaint in found.refusal
        (tmp_path / "after").mkdir()
        found = published.measured(name, tmp_path / "after", remedied=True)
    assert found.ran, found.refusal
    assert found.kind.removeprefix("base ") == TABLE[name]["base: kind drafted"], (
        "the table is old: python docs/make_zoo.py"
    )
    assert str(found.r) == TABLE[name]["r"]


def test_the_table_lists_every_published_robot_and_nothing_else():
    assert list(TABLE) == list(published.ROBOTS)


def test_nine_of_ten_published_robots_go_through_as_they_are():
    through = [name for name, row in TABLE.items() if row["ran"] == "yes"]
    assert len(TABLE) >= 40
    assert len(through) >= 0.9 * len(TABLE)


def test_a_description_is_found_without_importing_its_package():
    for robot in published.ROBOTS.values():
        if robot.package == "example-robot-data":
            assert robot.file() == example_urdfs()[robot.path]
        elif importlib.util.find_spec(robot.module) is None:
            assert robot.file() is None
