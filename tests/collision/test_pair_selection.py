"""Pairs that an SRDF file disables."""

import pytest

import rnc_pin as rnc
from rnc_pin.collision import read_disabled_pairs

SRDF = """<robot name="r">
  <group name="arm"/>
  <disable_collisions link1="a" link2="b" reason="Never"/>
  <disable_collisions link1="a" link2="elsewhere" reason="Never"/>
</robot>"""


def test_disabled_pairs_are_read(tmp_path):
    file = tmp_path / "r.srdf"
    file.write_text(SRDF)
    assert read_disabled_pairs(file, ["a", "b", "c"]) == (("a", "b"),)


@pytest.mark.parametrize(("text", "words"), [("<robot>", "not well-formed"), ("<sdf/>", "expected <robot>")])
def test_other_files_are_refused(tmp_path, text, words):
    file = tmp_path / "r.srdf"
    file.write_text(text)
    with pytest.raises(rnc.ModelError, match=words):
        read_disabled_pairs(file, ["a"])
    with pytest.raises(rnc.ModelError, match="cannot be read"):
        read_disabled_pairs(tmp_path / "none.srdf", ["a"])
