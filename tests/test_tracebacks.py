"""Short tracebacks in IPython: the frames of the package are hidden, those of the user are not."""

import os
import subprocess
import sys
import textwrap
import traceback

import pytest

import rnc_pin as rnc
from patience import PATIENCE
from rnc_pin.tracebacks import VARIABLE, without_own_frames

pytest.importorskip("IPython", reason="IPython is an optional extra and not installed")

SESSION = """
    import os
    from IPython.core.interactiveshell import InteractiveShell
    shell = InteractiveShell.instance(colors="nocolor")
    {before}
    shell.run_cell("import numpy as np; import rnc_pin as rnc")
    shell.run_cell('reduced = rnc.NonholonomicSystem(rnc.Robot.from_urdf("space_robot.urdf")).reduce()')
    {after}
    shell.run_cell('''{cell}''')
"""
WRONG_SHAPE = "reduced.at([0.1, 0.2, 0.3])"
OWN_CONTROLLER = """
class Mine:
    def initial_state(self, measurement):
        return None
    def step(self, t, measurement, state):
        return reduced.at(q=[0.1]).nothing
rnc.simulate(reduced, Mine(), np.zeros(4), 0.1)
"""


def shown(cell, before="", after="", **environment):
    """Output of a cell of an IPython session."""
    code = textwrap.dedent(SESSION).format(before=before, after=after, cell=cell)
    command = [sys.executable, "-c", code]
    done = subprocess.run(
        command, env={**os.environ, **environment}, capture_output=True, text=True, timeout=PATIENCE, check=True
    )
    return done.stdout + done.stderr


def test_a_wrong_shape_takes_a_few_lines():
    """They were 46."""
    text = shown(WRONG_SHAPE)
    assert "InputError: q has shape (3,), expected (..., 4)" in text
    assert WRONG_SHAPE in text
    assert len(text.splitlines()) <= 8
    assert "rnc_pin/model" not in text


@pytest.mark.parametrize(
    "how", [{"after": "shell.run_cell('rnc.set_full_tracebacks(True)')"}, {VARIABLE: "1"}], ids=["function", "variable"]
)
def test_own_frames_are_shown_on_request(how):
    text = shown(WRONG_SHAPE, **how)
    assert "rnc_pin/model" in text
    assert len(text.splitlines()) > 20


def test_frames_can_be_hidden_again():
    text = shown(WRONG_SHAPE, after="shell.run_cell('rnc.set_full_tracebacks(True); rnc.set_full_tracebacks(False)')")
    assert "rnc_pin/model" not in text


def test_frames_of_the_user_within_a_run_are_shown():
    text = shown(OWN_CONTROLLER)
    assert "rnc.simulate(reduced, Mine()" in text
    assert "return reduced.at(q=[0.1]).nothing" in text
    assert "rnc_pin/simulation" not in text


def test_other_errors_and_other_handlers_stay():
    assert "ZeroDivisionError" in shown("1 / 0")
    taken = "shell.set_custom_exc((ValueError,), lambda *_, **__: print('mine'))"
    assert shown("raise ValueError", before=taken).count("mine") == 1
    assert "InputError" not in shown(WRONG_SHAPE, before=taken)  # an InputError is a ValueError, so it is theirs


def test_plain_python_keeps_all_frames_and_the_trimmed_traceback_has_those_of_the_user():
    def call():
        rnc.Robot.from_urdf("space_robot.urdf").velocity_indices("jont_2")

    with pytest.raises(rnc.ModelError) as caught:
        call()
    full = traceback.extract_tb(caught.value.__traceback__)
    short = traceback.extract_tb(without_own_frames(caught.value.__traceback__))
    assert any("rnc_pin" in each.filename and "tests" not in each.filename for each in full)
    assert [each.name for each in short][-1] == "call"
    assert without_own_frames(None) is None
