"""Start without delay: nothing heavy is imported before it is needed, and every public name is there when it is."""

import ast
import os
import subprocess
import sys
import sysconfig
from importlib import import_module
from importlib.util import resolve_name
from itertools import chain
from pathlib import Path

import pytest

import rnc_pin as rnc
from patience import PATIENCE
from places import ROOT
from rnc_pin.applications.scenario.files import built_in_names

COLD_START = """
from pathlib import Path
import numpy as np
import rnc_pin as rnc
from rnc_pin.robots.robot_files import find_urdf
robot = rnc.Robot.from_urdf(find_urdf("space_robot.urdf", Path()))
system = rnc.NonholonomicSystem(
    robot, [rnc.MomentumConservation("platform")], actuators=["joint_1", "joint_2", "joint_3"]
)
reduced = system.reduce([rnc.FramePosition("tip", "xy"), rnc.JointPosition("joint_1")])
reduced.forward_dynamics(np.array([0.0, -0.4, 1.8, -1.1]), np.zeros(3), np.zeros(3))
"""
STEPS = """
import doctest, os, sys
import numpy as np
import rnc_pin as rnc

depth = 0
class Watch:  # it finds no module
    def find_spec(self, name, path=None, target=None):
        if depth:
            print("imports", name)

def watched(step, name):
    def watched_step(*arguments, **named):
        global depth
        depth += 1
        print(name, "steps")
        found = step(*arguments, **named)
        depth -= 1
        return found
    return watched_step

sys.meta_path.insert(0, Watch())
for kind in [getattr(package, name) for package in (rnc.control, rnc.optimal, rnc) for name in package.__all__]:
    controls = hasattr(kind, "step") and (hasattr(kind, "initial_state") or kind.__name__.endswith("Loop"))
    if controls and not getattr(kind, "_is_protocol", False):
        print(kind.__name__, "exists", flush=True)
        if not os.fork():
            kind.step = watched(kind.step, kind.__name__)
            doctest.run_docstring_examples(kind, {"rnc": rnc, "np": np})
            sys.stdout.flush()
            os._exit(0)
        os.wait()
"""
COMMAND = Path(sysconfig.get_path("scripts")) / "rnc-pin"
DRAFT = "import pathlib, rnc_pin.applications.init as d; d.draft('differential_drive.urdf', pathlib.Path('.'))"
EVALUATION = ["email"] if rnc.kernel == "c" else []
DRAWING = {"matplotlib", "meshcat", "tornado"}
HEAVY = {"joblib", "matplotlib", "meshcat", "numpy", "pinocchio", "pydantic", "scipy", "xacro"}


def imported(command, **environment):
    """Output of a process, and the top-level packages that it imported."""
    # The installed package, not the checkout of the working directory, which has no kernel.
    environment = {**os.environ, "PYTHONPROFILEIMPORTTIME": "1", "PYTHONSAFEPATH": "1", **environment}
    process = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=PATIENCE)
    modules = [line.split("|")[-1].strip() for line in process.stderr.splitlines() if line.startswith("import time:")]
    assert "rnc_pin" in modules, process.stderr
    return process.stdout, {module.split(".")[0] for module in modules}


def completed(words):
    """Completions that bash is offered after these words; the last one is not finished yet."""
    environment = {"_RNC_PIN_COMPLETE": "bash_complete", "COMP_WORDS": words, "COMP_CWORD": str(words.count(" "))}
    out, packages = imported([COMMAND], **environment)
    assert not packages & HEAVY
    offered = [line.partition(",") for line in out.splitlines()]
    return {value for kind, _, value in offered if kind == "plain"}, {kind for kind, _, _ in offered}


@pytest.mark.parametrize(("command", "unneeded"), [
    ([sys.executable, "-c", "import rnc_pin"], HEAVY),
    ([COMMAND, "run", "--help"], HEAVY),
    ([COMMAND, "list", "--json"], HEAVY),
    ([COMMAND, "rnu"], HEAVY),
    ([sys.executable, "-c", "import rnc_pin.applications.scenario.schema.scenario"], DRAWING),
    ([sys.executable, "-c", DRAFT], DRAWING),
    # SciPy, which evaluates without the kernel, imports email.
    ([sys.executable, "-c", COLD_START], {"jaxtyping", "pydantic", *DRAWING, *EVALUATION}),
])  # fmt: skip
def test_nothing_is_imported_before_it_is_needed(command, unneeded):
    assert not imported(command)[1] & unneeded


def test_running_scenarios_imports_only_linear_algebra_of_scipy():
    code = "import sys, rnc_pin.applications.scenario.execution; print(*(m for m in sys.modules if m.count('.') == 1))"
    out, _ = imported([sys.executable, "-c", code])
    found = {name for name in out.split() if name.startswith("scipy.") and not name.startswith("scipy._")}
    assert found <= {"scipy.linalg", "scipy.version"}


def test_a_controller_imports_nothing_in_a_step():
    """Each example runs in a process of its own, where no other controller has stepped."""
    out = set(imported([sys.executable, "-c", STEPS])[0].splitlines())
    controllers = {line.split()[0] for line in out if line.endswith(" exists")}
    assert len(controllers) > 20
    assert {line for line in out if line.startswith("imports ")} == set()
    assert {line.split()[0] for line in out if line.endswith(" steps")} == controllers


def test_the_shell_learns_to_complete():
    out, packages = imported([COMMAND], _RNC_PIN_COMPLETE="bash_source")
    assert "complete -o nosort" in out
    assert not packages & HEAVY


def test_commands_options_and_scenarios_are_completed():
    names, kinds = completed("rnc-pin inspect space")
    assert names == {name for name in built_in_names() if name.startswith("space")}
    assert "file" in kinds
    assert completed("rnc-pin in") == ({"init", "inspect"}, {"plain"})
    assert {"--set", "--show"} <= completed("rnc-pin run --s")[0]


PACKAGES = sorted(".".join(stub.parent.relative_to(ROOT).parts) for stub in (ROOT / "rnc_pin").rglob("__init__.pyi"))


@pytest.mark.parametrize("name", PACKAGES)
def test_every_public_name_is_there(name):
    package = import_module(name)
    stub = ast.parse(Path(package.__file__).with_suffix(".pyi").read_text())
    listed = [each for each in stub.body if isinstance(each, ast.ImportFrom)]
    stars = [each for each in listed if each.names[0].name == "*"]
    starred = [import_module(resolve_name("." * each.level + each.module, name)).__all__ for each in stars]
    names = [each.asname for node in listed for each in node.names if each.asname] + [*chain(*starred)]
    assert package.__all__ == dir(package) == sorted(names)
    assert all(getattr(package, each) is not None for each in names)
    with pytest.raises(AttributeError, match="nothing"):
        _ = package.nothing


def test_an_export_is_not_hidden_by_its_module():
    """``preflight`` of ``simulation/preflight.py`` is the function, whatever was imported first."""
    code = "from rnc_pin.simulation import preflight; import rnc_pin.simulation.preflight; print(preflight.__name__)"
    assert imported([sys.executable, "-c", code])[0] == "preflight\n"


def test_the_example_of_the_readme_loads_a_fifth_of_the_package():
    example = (ROOT / "README.md").read_text().partition("```python\n")[2].partition("```")[0]
    count = "import sys; print(sum(name.startswith('rnc_pin.') for name in sys.modules))"
    out, _ = imported([sys.executable, "-c", f"{example}\n{count}"])
    assert int(out.splitlines()[-1]) <= 110
