"""The folder of results: it cleans up after itself, and touches nothing else."""

import json

import pytest

import rnc_pin as rnc
from rnc_pin.scenario.output import OutputFolder

MARK = ".rnc_pin"


def contents(folder):
    """Every file under a folder and what is in it, but not the mark."""
    return {
        str(path.relative_to(folder)): path.read_text()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name != MARK
    }


def refusal(call):
    with pytest.raises(rnc.ConfigurationError) as caught:
        call()
    message = str(caught.value)
    assert len(message.splitlines()) == 1
    return message


def test_a_new_folder_is_made_with_its_parents_and_marked(tmp_path):
    folder = OutputFolder(tmp_path / "runs" / "first")
    folder.file("a.txt").write_text("a")
    folder.write_json("b.json", {"x": [1, 2]})
    folder.write_yaml("c.yaml", {"z": 1, "a": 2})
    folder.folder("run_0").mkdir()
    mark = json.loads((tmp_path / "runs" / "first" / MARK).read_text())
    assert mark == {"files": ["a.txt", "b.json", "c.yaml", "run_0"]}
    written = contents(tmp_path / "runs" / "first")
    assert json.loads(written.pop("b.json")) == {"x": [1, 2]}
    assert written == {"a.txt": "a", "c.yaml": "z: 1\na: 2\n"}  # keys stay in their order


def test_an_empty_folder_may_be_used(tmp_path):
    OutputFolder(tmp_path).file("a.txt").write_text("a")
    assert contents(tmp_path) == {"a.txt": "a"}


def test_a_second_run_removes_what_the_first_wrote_and_nothing_else(tmp_path):
    first = OutputFolder(tmp_path)
    first.file("old.txt").write_text("old")
    first.folder("run_0").mkdir()
    (tmp_path / "run_0" / "inside.txt").write_text("old")
    first.file("never written.txt")
    (tmp_path / "notes.txt").write_text("mine")
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "robot.txt").write_text("mine")
    OutputFolder(tmp_path).file("new.txt").write_text("new")
    assert contents(tmp_path) == {"new.txt": "new", "notes.txt": "mine", "photos/robot.txt": "mine"}
    assert not (tmp_path / "run_0").exists()


def test_somebody_elses_folder_is_refused_and_left_alone(tmp_path):
    (tmp_path / "thesis.txt").write_text("mine")
    message = refusal(lambda: OutputFolder(tmp_path))
    assert f"--out {tmp_path}: exists and was not made by rnc-pin" in message
    assert "--force" in message
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.txt"]
    assert contents(tmp_path) == {"thesis.txt": "mine"}


def test_force_replaces_only_files_of_the_same_names(tmp_path):
    (tmp_path / "thesis.txt").write_text("mine")
    (tmp_path / "summary.json").write_text("mine")
    OutputFolder(tmp_path, force=True).write_json("summary.json", {})
    assert contents(tmp_path) == {"summary.json": "{}\n", "thesis.txt": "mine"}
    # The folder is marked now, and still only what was written into it is ours.
    OutputFolder(tmp_path)
    assert contents(tmp_path) == {"thesis.txt": "mine"}


FORGED = {
    "parent": ["../precious.txt"],
    "parent folder": [".."],
    "folder itself": [".", ""],
    "through a subfolder": ["sub/../../precious.txt"],
    "folder beside": ["../beside"],
    "link to a folder": ["link"],
    "inside a link": ["link/inside.txt"],
    "zero byte": ["\0"],
    "other things": [1, None, {}, []],
    "a number for a list": 3,
    "nothing for a list": None,
    "text for a list": "notes.txt",
}


@pytest.mark.parametrize("files", FORGED.values(), ids=FORGED)
def test_a_forged_mark_leads_nowhere(files, tmp_path):
    (tmp_path / "precious.txt").write_text("mine")
    (tmp_path / "beside").mkdir()
    (tmp_path / "beside" / "inside.txt").write_text("mine")
    target = tmp_path / "out"
    target.mkdir()
    (target / "notes.txt").write_text("mine")
    (target / "link").symlink_to(tmp_path / "beside", target_is_directory=True)
    if isinstance(files, list):
        files = [*files, str(tmp_path / "precious.txt")]
    (target / MARK).write_text(json.dumps({"files": files}))
    before = contents(tmp_path)
    OutputFolder(target)
    assert contents(tmp_path) == before


@pytest.mark.parametrize("mark", [b"", b"rubbish", b"[]", b"3", b"\xff\xfe", b'{"files"'])
def test_a_mark_that_cannot_be_read_removes_nothing(mark, tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    (tmp_path / MARK).write_bytes(mark)
    OutputFolder(tmp_path).file("new.txt").write_text("new")
    assert contents(tmp_path) == {"new.txt": "new", "notes.txt": "mine"}


def test_a_file_in_the_way_is_refused_and_left_alone(tmp_path):
    path = tmp_path / "results"
    path.write_text("mine")
    assert f"--out {path}: is a file, expected a folder" in refusal(lambda: OutputFolder(path, force=True))
    assert path.read_text() == "mine"


@pytest.mark.parametrize("below", ["file/out", "x" * 300], ids=["below a file", "name too long"])
def test_a_folder_that_cannot_be_made_is_refused(below, tmp_path):
    (tmp_path / "file").write_text("mine")
    assert "cannot be written" in refusal(lambda: OutputFolder(tmp_path / below))


def test_a_folder_that_cannot_be_written_is_refused():
    # Not even the administrator, as whom tests may run, can write there.
    assert "--out /proc/rnc_pin: cannot be written" in refusal(lambda: OutputFolder("/proc/rnc_pin"))
