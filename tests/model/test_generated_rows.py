"""The C of the rows is that of their formulas in Python; ``test_twins.py`` compares what both compute."""

from tools.generate_rows import PATH, generate


def test_the_formulas_of_the_kernel_are_current():
    assert PATH.read_text() == generate(), "run python -m tools.generate_rows"
