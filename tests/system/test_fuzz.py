"""Broken files, the same ones each time."""

import pytest

import broken_files


@pytest.mark.parametrize("kind", broken_files.READERS)
def test_broken_files_end_in_errors_of_ours(kind):
    endings, faults = broken_files.run(120 if kind == "run" else 30, kind)  # few changes of a compressed run do no harm
    assert faults == []
    assert endings["read"] > 0, "some changes do no harm, so that more than the first check is reached"
    assert endings["refused"] > 0


def test_what_is_broken_is_read_when_it_is_whole(tmp_path):
    for kind, originals in broken_files.sources(tmp_path).items():
        name, read = broken_files.READERS[kind]
        for content in originals:
            (tmp_path / name).write_bytes(content)
            read(tmp_path / name)
