"""Everything that a user makes can be copied, pickled and sent to another process, and says there the same to the bit.

Each public name has an example in its docstring. The example runs here twice, the second time with copies of all its
objects after each statement. So a new kind of constraint, output, controller or plant joins these tests by its example.
"""

import copy
import multiprocessing
import pickle
import pkgutil
from importlib import import_module
from types import ModuleType

import cloudpickle
import numpy as np
import pytest

import rnc_pin as rnc
from docstring_examples import (
    MODULES,
    NAMED,
    PUBLIC,
    bits,
    called_by_users,
    pickled,
    replace_by_copies,
    run_example,
    statements,
    watch_constructors,
)
from elsewhere import figures, figures_of_pickles
from rnc_pin.visualization.drawn_state import DrawnModel

MOST_STATEMENTS = 10
INTERNAL = (
    *(f"rnc_pin.applications.{room}" for room in ("command_line", "init", "scenario")),
    *(f"rnc_pin.{room}" for room in ("figures", "io", "math", "model", "robots", "visualization")),
)
NEEDED = [name for name, thing in NAMED.items() if name.count(".") == 1 or called_by_users(thing)]
EXAMPLES = [name for name in NAMED if name in NEEDED or statements(name)]
SLOW = ["rnc_pin.SweepResults", "rnc_pin.sweep", "rnc_pin.load_sweep"]  # a sweep starts processes: it runs once
LONG = [  # these run with copies alone, which have to print what the docstring says
    "rnc_pin.BodySurface", "rnc_pin.Calibration", "rnc_pin.Comparison", "rnc_pin.FrictionPlant",
    "rnc_pin.analysis.PrivilegedCoordinates", "rnc_pin.control.SetPointController", "rnc_pin.excite",
    "rnc_pin.identify", "rnc_pin.plants.mujoco.MuJoCoPlant",
]  # fmt: skip


@pytest.mark.parametrize("name", EXAMPLES)
def test_the_example_runs_and_its_objects_can_be_copied(name, monkeypatch):
    assert 0 < len(statements(name)) <= MOST_STATEMENTS, f"{name} needs an example of at most {MOST_STATEMENTS} lines"
    made = watch_constructors(monkeypatch)
    namespace = run_example(name, between=replace_by_copies) if name in LONG else run_example(name)
    found = [*namespace.values(), *made]
    if called_by_users(NAMED[name]):
        assert any(type(thing) is NAMED[name] for thing in found), f"the example of {name} makes none"
    held = {id(thing) for thing in namespace.values()}
    for thing in [thing for thing in made if id(thing) not in held]:  # e.g. an output in a list
        assert type(copy.deepcopy(pickle.loads(pickled(thing)))) is type(thing)
    for reduced in [thing for thing in namespace.values() if isinstance(thing, rnc.ReducedModel)]:
        expected = figures(reduced)
        shown = DrawnModel.of(reduced).with_own_model()  # --show and drive do this
        for other in (copy.deepcopy(pickle.loads(pickled(reduced))), shown.reduced):
            assert figures(other) == expected
    if name in SLOW:
        replace_by_copies(namespace)
    elif name not in LONG:
        again = run_example(name, between=replace_by_copies)
        assert {key: bits(thing) for key, thing in again.items()} == {key: bits(t) for key, t in namespace.items()}


def test_no_public_package_is_forgotten():
    """``docs/make_reference.py`` lists the public packages: each that has exports, apart from internal rooms."""
    assert len({module.__name__ for module in MODULES}) == len(MODULES)
    packages = [found.name for found in pkgutil.walk_packages(rnc.__path__, "rnc_pin.") if found.ispkg]
    for name in [name for name in packages if not name.startswith(INTERNAL)]:
        module = import_module(name)
        exports = [getattr(module, export) for export in getattr(module, "__all__", ())]
        exports = [export for export in exports if not isinstance(export, ModuleType)]
        assert not exports or any(id(export) in PUBLIC for export in exports), f"{name} is not listed"


def test_another_process_says_the_same():
    """A fresh process, which inherits nothing: a reduced model with each kind of constraint, output and force.

    Also the function of a sweep, which holds a hand with mimic joints: these once held a joint model of Pinocchio.
    """
    kinds = ("rnc_pin.constraints.", "rnc_pin.outputs.", "rnc_pin.forces.")
    models = {
        f"{name}: {variable}": thing
        for name in EXAMPLES
        if NAMED[name].__module__.startswith(kinds)
        for variable, thing in run_example(name).items()
        if isinstance(thing, rnc.ReducedModel)
    }
    assert len(models) > 20
    robot = rnc.Robot.from_example("panda")
    hand = rnc.NonholonomicSystem(robot, [], list(robot.joint_names)).reduce()

    def build(draw):
        return rnc.free_motion(hand, robot.configuration(), np.full(hand.r, draw["speed"]), duration=0.02)

    with multiprocessing.get_context("spawn").Pool(1) as pool:
        data = [pickled(reduced) for reduced in models.values()], cloudpickle.dumps(build)
        found, q = pool.apply(figures_of_pickles, data)
    assert dict(zip(models, found, strict=True)) == {name: figures(reduced) for name, reduced in models.items()}
    assert np.array_equal(q, build({"speed": 0.01}).q)
