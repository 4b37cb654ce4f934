"""The folder of results: it replaces and deletes what runs left there, and touches nothing else."""

import hashlib
import json
import os
import shutil
import signal
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

from patience import PATIENCE
from refusals import refusal
from rnc_pin.applications.scenario.output_folder import MANIFEST, OutputFolder
from urdf_parts import write


def contents(folder):
    """Every file under a folder and its content, without the manifest."""
    files = (path for path in sorted(folder.rglob("*")) if path.is_file() and path.name != MANIFEST)
    return {str(path.relative_to(folder)): path.read_text() for path in files}


def run(folder, force=False, **files):
    """A run: writes files, then keeps them."""
    keep(folder, {name.replace("_", "."): text for name, text in files.items()}, force)


def keep(folder, files, force=False):
    with OutputFolder(folder, force, list(files)) as out:
        for name, text in files.items():
            (out.fresh / name).write_text(text)
        out.keep()


def mine(folder, *names):
    """Files of the user, with their folders."""
    for name in names:
        write(folder / name, "mine")


def digest(text):
    return [hashlib.sha256(text.encode()).hexdigest()]


def forge(folder, files):
    (folder / MANIFEST).write_text(json.dumps({"files": files}))


def test_a_new_folder_is_made_with_its_parents_and_a_manifest(tmp_path):
    place = tmp_path / "runs" / "first"
    files = {"a.png": "a", "summary.json": "b"}
    keep(place, files)
    manifest = json.loads((place / MANIFEST).read_text())
    assert (manifest["files"], contents(place)) == ({name: digest(text) for name, text in files.items()}, files)
    assert sorted(path.name for path in place.iterdir()) == [MANIFEST, "a.png", "summary.json"]


def test_only_results_are_kept_and_a_run_that_keeps_nothing_leaves_nothing(tmp_path):
    with OutputFolder(tmp_path / "out") as folder:
        (folder.fresh / "a.png").write_text("a")
    assert not list(tmp_path.iterdir())
    with OutputFolder(tmp_path / "out") as folder:
        (folder.fresh / "a.png").write_text("a")
        (folder.fresh / "notes.txt").write_text("b")
        write(folder.fresh / "sub/summary.json", "c")
        folder.keep()
    assert contents(tmp_path) == {"out/a.png": "a"}


def test_a_second_run_removes_what_the_first_wrote_and_nothing_else(tmp_path):
    run(tmp_path, old_png="old", summary_json="old")
    mine(tmp_path, "notes.txt", "photos/robot.txt")
    run(tmp_path, new_png="new")
    assert contents(tmp_path) == {"new.png": "new", "notes.txt": "mine", "photos/robot.txt": "mine"}


def test_the_next_run_removes_the_half_picture_of_a_killed_one(tmp_path):
    run(tmp_path, summary_json="first")
    (tmp_path / ".rnc_pin_0a1b2c3d.png").write_text("half a picture")
    run(tmp_path, summary_json="second")
    assert not [*tmp_path.glob(".rnc_pin_*")]


@pytest.mark.parametrize("before", [{}, {"summary.json": "old", "overview.png": "old"}], ids=["empty", "run"])
def test_earlier_results_stay_until_the_new_ones_are_complete(before, tmp_path):
    keep(tmp_path, before)
    with OutputFolder(tmp_path) as folder:
        (folder.fresh / "summary.json").write_text("new")
        folder.keep_so_far()
        there = {name: text for name, text in contents(tmp_path).items() if "/" not in name}
        assert there == (before or {"summary.json": "new"})
        if before:
            folder.keep()
    assert contents(tmp_path) == {"summary.json": "new"}


KILLED = """
import os, signal, sys
from rnc_pin.applications.scenario.output_folder import OutputFolder
folder, fatal = sys.argv[1], int(sys.argv[2])
moved = []
def move(source, target, move=os.replace):
    if len(moved) == fatal:
        os.kill(os.getpid(), signal.SIGKILL)
    moved.append(target)
    move(source, target)
os.replace = move
with OutputFolder(folder) as out:
    for name in ("summary.json", "scenario.yaml", "trajectory.npz"):
        (out.fresh / name).write_text("new")
    out.keep()
"""


@pytest.mark.parametrize("fatal", [0, 2])  # of the manifest, three results, the manifest
def test_a_run_killed_while_it_puts_results_into_place_locks_nobody_out(fatal, tmp_path):
    run(tmp_path, summary_json="old", scenario_yaml="old", overview_png="old")
    process = subprocess.run([sys.executable, "-c", KILLED, tmp_path, str(fatal)], timeout=PATIENCE)
    assert process.returncode == -signal.SIGKILL
    run(tmp_path, summary_json="newer")
    assert contents(tmp_path) == {"summary.json": "newer"}
    assert {path.name for path in tmp_path.iterdir()} == {MANIFEST, "summary.json"}


def test_results_are_kept_if_somebody_removes_the_folder_meanwhile(tmp_path):
    out = tmp_path / "out"
    with OutputFolder(out) as folder:
        shutil.rmtree(out)
        with folder.writing() as fresh:
            (fresh / "summary.json").write_text("new")
        folder.keep()
    assert contents(out) == {"summary.json": "new"}
    with OutputFolder(out) as folder:
        shutil.rmtree(out)
        mine(out, "summary.json")
        with folder.writing() as fresh:
            (fresh / "summary.json").write_text("newer")
        message = refusal(folder.keep)
    assert contents(out)["summary.json"] == "mine"
    assert (Path(message.split("are in ")[1]) / "summary.json").read_text() == "newer"
    with OutputFolder(out, force=True):
        shutil.rmtree(out)
    assert not out.exists()


def test_somebody_elses_folder_is_refused_and_left_alone(tmp_path):
    (tmp_path / "thesis.txt").write_text("mine")
    message = refusal(lambda: OutputFolder(tmp_path))
    assert f"--out {tmp_path}: exists and was not made by rnc-pin" in message
    assert "--force" in message
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.txt"]
    assert contents(tmp_path) == {"thesis.txt": "mine"}


def test_force_replaces_only_files_of_the_same_names(tmp_path):
    mine(tmp_path, "thesis.txt", "summary.json")
    run(tmp_path, force=True, summary_json="old", overview_png="old")
    (tmp_path / "summary.json").write_text("edited")
    assert "summary.json was changed or not written by rnc-pin" in refusal(lambda: run(tmp_path, summary_json="new"))
    run(tmp_path, force=True, overview_png="new")
    assert contents(tmp_path) == {"summary.json": "edited", "overview.png": "new", "thesis.txt": "mine"}
    run(tmp_path, force=True, summary_json="new")
    assert contents(tmp_path) == {"summary.json": "new", "thesis.txt": "mine"}


FORGED = [
    "../precious.txt", "..", ".", "", "sub/../../precious.txt", "../beside", "link", "link/summary.json", "\0",
    "data.csv", ".git", "src", "src/summary.json", "overview.png",
]  # fmt: skip


@pytest.mark.parametrize("name", FORGED)
def test_a_forged_manifest_leads_nowhere(name, tmp_path):
    mine(tmp_path, "precious.txt", "beside/summary.json")
    forge(tmp_path / "beside", {"summary.json": digest("mine")})
    target = tmp_path / "out"
    mine(target, ".git/summary.json", "src/summary.json", "data.csv")
    (target / "link").symlink_to(tmp_path / "beside", target_is_directory=True)
    (target / "overview.png").symlink_to(tmp_path / "precious.txt")
    forge(target, {name: digest("mine")})
    before = contents(tmp_path)
    run(target, force=True, top_png="new")
    assert contents(tmp_path) == {**before, "out/top.png": "new"}
    assert (target / "link").is_symlink()


@pytest.mark.parametrize("manifest", [
    b"", b"[]", b"\xff\xfe", b"[" * 100_000, b'{"files": 3}', b'{"files": ["summary.json"]}', b'{"files": {"a": [1]}}',
])  # fmt: skip
def test_an_invalid_manifest_removes_nothing(manifest, tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    (tmp_path / MANIFEST).write_bytes(manifest)
    run(tmp_path, new_png="new")
    assert contents(tmp_path) == {"new.png": "new", "notes.txt": "mine"}


KINDS = {
    "link": lambda path, other: path.symlink_to(other),
    "pipe": lambda path, other: os.mkfifo(path),
    "folder": lambda path, other: path.mkdir(),
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", ["summary.json", MANIFEST])
def test_what_is_no_plain_file_is_neither_written_through_nor_waited_for(name, kind, tmp_path):
    other, out = tmp_path / "other.txt", tmp_path / "out"
    other.write_text("mine")
    run(out, summary_json="old")
    (out / name).unlink()
    KINDS[kind](out / name, other)
    refusal(lambda: run(out, summary_json="new"))
    if kind == "folder" or name == MANIFEST:
        refusal(lambda: run(out, force=True, summary_json="new"))
    else:
        run(out, force=True, summary_json="new")
        assert (out / "summary.json").read_text() == "new"
        assert not (out / "summary.json").is_symlink()
    assert other.read_text() == "mine"


@pytest.mark.parametrize(("name", "words"), [
    ("results", "is a file, expected a folder"), ("results/out", "cannot be"), ("x" * 300, "cannot be"),
])  # fmt: skip
def test_what_is_no_folder_or_cannot_be_one_is_refused(name, words, tmp_path):
    (tmp_path / "results").write_text("mine")
    assert f"--out {tmp_path / name}: {words}" in refusal(lambda: OutputFolder(tmp_path / name, force=True))
    assert (tmp_path / "results").read_text() == "mine"


SHORT = ["run", "space-robot", "--set", "simulation.duration=0.02", "--set", "comparisons={}", "--set", "plots={}"]


def test_a_run_replaces_files_of_others_only_by_force(tmp_path, call, no_pictures):
    (tmp_path / "summary.json").write_text("mine")
    assert [call(*SHORT, "--out", tmp_path, *more)[0] for more in ([], ["--force"])] == [2, 0]


def test_a_scenario_with_a_strange_name_writes_into_no_folder_above(tmp_path, monkeypatch, call, no_pictures):
    name = "...yaml"
    call(*SHORT, "--out", tmp_path / "first")
    file = write(tmp_path / "here" / name, (tmp_path / "first" / "scenario.yaml").read_text())
    monkeypatch.chdir(file.parent)
    assert call("run", name)[0] == 0
    assert {path.name for path in (tmp_path / "here").iterdir()} == {name, "runs"}
    assert [path.name for path in (tmp_path / "here" / "runs").iterdir()] == ["scenario"]


FULL = """
import resource, signal, sys
sys.dont_write_bytecode = True  # with a limit, Python leaves half of a file where the next import reads it
from rnc_pin.applications.command_line.cli import main
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv.pop(1)),) * 2)
main()
"""


def test_a_full_disk_leaves_what_was_there_and_nothing_half_written(tmp_path, call, no_pictures):
    out = tmp_path / "out"
    assert call(*SHORT, "--out", out)[0] == 0
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    arguments = ["100", *SHORT, "--out", str(out)]
    process = subprocess.run([sys.executable, "-c", FULL, *arguments], capture_output=True, text=True, timeout=PATIENCE)
    (line,) = process.stderr.splitlines()
    assert line.startswith(f"rnc-pin: error: --out {out}: cannot be written: File too large")
    assert process.returncode == 1
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before


HOLDING = """
import sys
from rnc_pin.applications.scenario.output_folder import OutputFolder
with OutputFolder(sys.argv[1]):
    print("mine", flush=True)
    sys.stdin.read()
"""


def test_a_second_run_into_a_folder_is_refused_until_the_first_is_over(tmp_path):
    out = tmp_path / "out"
    command = [sys.executable, "-c", textwrap.dedent(HOLDING), out]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "mine\n"
        for force in (False, True):
            message = refusal(lambda force=force: OutputFolder(out, force))
            assert message.startswith(f"--out {out}: another run is writing there")
        process.kill()
    run(out, summary_json="new")  # whoever is killed holds nothing
    assert {path.name for path in out.iterdir()} == {MANIFEST, "summary.json"}
