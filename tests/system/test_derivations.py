"""The files in tests/data are what tests/derivations derives; all of it: ``python -m tests.derivations``."""

from derivations.comparison import differences, read

EXACT = 1e-12


def test_one_state_of_the_sleigh_is_what_the_lagrangian_says():
    from derivations import chaplygin_sleigh  # imports SymPy, which takes seconds

    data = read("chaplygin_sleigh")
    found = list(differences({"states": chaplygin_sleigh.states(data, 1)}, data))
    assert len(found) > 20
    assert max(found, key=lambda each: each[1])[1] < EXACT


def test_the_matrices_of_bicycles_are_those_of_their_parameters():
    from derivations import bicycle_linear

    data, measured = read("bicycle_linear"), read("moore_bicycles")["bicycles"]
    assert len(measured) == 10
    for each in (data, *measured.values()):
        found = {name: matrix.tolist() for name, matrix in bicycle_linear.matrices(each["parameters"]).items()}
        assert max(apart for _, apart in differences(found, each["linear"])) < EXACT
    wrong = {**data["parameters"], "IHxx": 0.06}  # what many public copies have
    apart = differences(bicycle_linear.matrices(wrong)["M"].tolist(), data["linear"]["M"])
    assert max(each for _, each in apart) > 1e-6
