"""Built-in scenarios run alike with the compiled kernel and with NumPy, and repeat themselves to the bit."""

import os
import subprocess
import sys

import numpy as np
import pytest

import rnc_pin as rnc
from rnc_pin.applications.scenario.execution import execute
from rnc_pin.applications.scenario.scenario import Scenario

# Every kind of rows and controllers; the other scenarios are of the same.
NAMES = [
    "space-robot-uncertain", "mobile-manipulator-two-phase", "fire-truck", "snakeboard", "unicycle", "car",
    "tiago-shelf", "free-flying-arm",
]  # fmt: skip
OPTIONS = {"simulation.duration": 0.2, "comparisons": {}, "plots": {}}
COLUMNS = ("q", "v", "v2", "T", "energy", "multipliers")
BOTH = 1e-9  # difference of the two paths, relative to the largest value
SCRIPT = f"""
import numpy as np
from rnc_pin.applications.scenario.execution import execute
from rnc_pin.applications.scenario.scenario import Scenario
import rnc_pin
runs = {{name: execute(Scenario.load(name, {OPTIONS!r})).trajectory for name in {NAMES!r}}}
columns = {{f"{{name}}/{{of}}": getattr(run, of) for name, run in runs.items() for of in {COLUMNS!r}}}
np.savez("runs.npz", kernel=rnc_pin.kernel, **columns)
"""


@pytest.fixture(scope="module")
def by_numpy(tmp_path_factory):
    folder = tmp_path_factory.mktemp("numpy")
    environment = {**os.environ, "RNC_PIN_KERNEL": "numpy"}
    subprocess.run([sys.executable, "-c", SCRIPT], check=True, cwd=folder, env=environment)
    with np.load(folder / "runs.npz") as found:
        assert str(found["kernel"]) == "numpy"
        return dict(found)


@pytest.mark.skipif(rnc.kernel == "numpy", reason="there is one path only")
@pytest.mark.parametrize("name", NAMES)
def test_both_paths_agree_and_the_kernel_repeats_itself(name, by_numpy):
    prepared = Scenario.load(name, OPTIONS).build()
    run, again = (execute(prepared).trajectory for _ in range(2))
    assert np.abs(run.v - run.v[0]).max() > 1e-4  # it moves
    for column in COLUMNS:
        expected, found = by_numpy[f"{name}/{column}"], getattr(run, column)
        np.testing.assert_array_equal(getattr(again, column), found)
        np.testing.assert_allclose(found, expected, rtol=0, atol=BOTH * max(1.0, np.abs(expected).max(initial=0.0)))
