"""Broken files, the same ones each time: the short form of ``python -m benchmarks.fuzz``."""

import pytest

from benchmarks import fuzz


@pytest.mark.parametrize("kind", fuzz.READERS)
def test_broken_files_end_in_errors_of_ours(kind):
    count = 120 if kind == "run" else 16 if kind in fuzz.MESHES else 30  # few changes of a compressed run do no harm
    endings, faults = fuzz.run(count, kinds=(kind,))
    assert faults == []
    assert endings[f"{kind} read"] > 0, "some changes do no harm, so that more than the first check is reached"
    assert endings[f"{kind} refused"] > 0


def test_what_is_broken_is_read_when_it_is_whole(tmp_path):
    for kind, originals in fuzz.sources(tmp_path).items():
        name, read = fuzz.READERS[kind]
        for content in originals:
            (tmp_path / name).write_bytes(content)
            read(tmp_path / name)
