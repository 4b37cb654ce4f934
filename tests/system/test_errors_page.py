"""The page of errors has each message of the package, in a family with what to do."""

import re

import rnc_pin as rnc
from places import ROOT, docs_script

generated = docs_script("generated")
error_messages = generated.error_messages
TEXT = (ROOT / "docs" / "errors.md").read_text(encoding="utf-8")
SECTIONS = dict(re.findall(r"^## ([^\n]+)\n(.*?)(?=^## |\Z)", TEXT, flags=re.DOTALL | re.MULTILINE))
PUBLIC = [name for name in rnc.__all__ if isinstance(kind := getattr(rnc, name), type) and issubclass(kind, Exception)]


def test_each_message_has_a_family_and_each_path_of_a_family_has_messages():
    prefixes = error_messages.prefixes()
    assert len(prefixes) == len(set(prefixes))
    families = [error_messages.family_of(each, prefixes) for each in error_messages.messages()]
    assert None not in families
    assert set(families) == set(prefixes)


def test_each_family_has_causes_and_what_to_do():
    for title, section in SECTIONS.items():
        if "<!-- generated: messages" in section:
            meaning, _, rest = section.strip().partition("\n")
            assert re.search("[a-z]", meaning), title
            rows = re.findall(r"^\| [^-|].* \| .+ \|$", rest, flags=re.MULTILINE)
            assert len(rows) >= 3, title  # the head and two causes


def test_every_public_error_is_explained():
    assert sorted(re.findall(r"^\| `(\w+)` \|", SECTIONS["Classes"], flags=re.MULTILINE)) == sorted(PUBLIC)


RAISED = re.compile(r"\braise (\w+)\(\s*f?([\"'])(.*?)(?=\2|\{)", flags=re.DOTALL)


def test_no_raised_message_is_missing():
    """Beside the syntax trees that the page is made of: the text behind each ``raise SomeError(``."""
    shown = " ".join(re.sub("[`…]", " ", generated.filled(TEXT)).split())
    modules = [path.read_text(encoding="utf-8") for path in (ROOT / "rnc_pin").rglob("*.py")]
    raised = [each for text in modules for each in RAISED.findall(text) if re.search("[a-z]{4}", each[2])]
    found = [text for name, _, text in raised if issubclass(getattr(rnc, name, int), rnc.RncError)]
    assert len(found) > 300
    assert [text for text in found if " ".join(text.split())[:60] not in shown] == []
