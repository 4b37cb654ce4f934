"""Published robots by ``init``, ``inspect`` and ``run``, and the second table of docs/zoo.md, which tells of them."""

import importlib.util

import pytest

import published
from places import ROOT
from rnc_pin.robots.robot_files import example_urdfs

PAGE = (ROOT / "docs" / "zoo.md").read_text().partition("## Published robots")[2].partition("\n## ")[0]
TABLE = {
    cells[0]: cells[1:]
    for cells in (
        [each.strip() for each in line.strip("|").split("|")] for line in PAGE.splitlines() if line[:2] == "| "
    )
    if cells[0] not in ("robot", "---")
}


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
    assert found.kind.removeprefix("base ") == TABLE[name][1], "docs/zoo.md is old: python docs/make_zoo.py"
    assert str(found.r) == TABLE[name][4]


def test_the_page_lists_every_published_robot_and_nothing_else():
    assert list(TABLE) == list(published.ROBOTS)


def test_nine_of_ten_published_robots_go_through_as_they_are():
    through = [name for name, cells in TABLE.items() if cells[5] == "yes"]
    assert len(TABLE) >= 40
    assert len(through) >= 0.9 * len(TABLE)


def test_a_description_is_found_without_importing_its_package():
    for robot in published.ROBOTS.values():
        if robot.package == "example-robot-data":
            assert robot.file() == example_urdfs()[robot.path]
        elif importlib.util.find_spec(robot.module) is None:
            assert robot.file() is None
