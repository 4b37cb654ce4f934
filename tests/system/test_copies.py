"""Everything that a user makes can be copied, pickled and sent to another process, and says there the same to the bit.

Each public name has an example in its docstring. The example runs here twice, the second time with copies of all its
objects after each statement. So a new kind of constraint, output, controller or plant joins these tests by its example.
"""

import copy
import doctest
import functools
import importlib
import inspect
import io
import multiprocessing
import pickle
import pkgutil
import sys
import tempfile
from types import FunctionType, ModuleType

import cloudpickle
import numpy as np
import pytest

import rnc_pin as rnc
from elsewhere import figures, figures_of_pickles
from places import docs_script
from rnc_pin.visualization import LoopView
from rnc_pin.visualization.drawn_state import DrawnModel

MODULES = [rnc, *(importlib.import_module(f"rnc_pin.{package}") for package in docs_script("make_reference").PACKAGES)]
PUBLIC = {
    id(thing): (f"{module.__name__}.{name}", thing)
    for module in reversed(MODULES)  # the shortest name is the last one
    for name in module.__all__
    if callable(thing := getattr(module, name))
}
NAMED = dict(PUBLIC.values())
"""Public functions and classes by name."""
CLASSES = [thing for thing in NAMED.values() if isinstance(thing, type) and not issubclass(thing, BaseException)]
OPTIONS = doctest.NORMALIZE_WHITESPACE
OF_AN_EXAMPLE = "rnc_pin_example"


def statements(name: str) -> list[doctest.Example]:
    return doctest.DocTestParser().get_examples(inspect.getdoc(NAMED[name]) or "")


def called_by_users(thing: object) -> bool:
    """True for a class whose docstring lists arguments. Results list attributes only."""
    if not isinstance(thing, type) or inspect.isabstract(thing) or getattr(thing, "_is_protocol", False):
        return False
    return "Args:" in (inspect.getdoc(thing) or "")


def run_example(name: str, between=lambda namespace: None) -> dict[str, object]:
    """Run the example of a public name, which has to print what it says. Return its namespace without imports.

    Args:
        name: the public name.
        between: changes the namespace after each statement.
    """
    namespace = {"np": np, "rnc": rnc, "__name__": OF_AN_EXAMPLE}
    said: list[str] = []
    with np.printoptions(precision=8, suppress=False, linewidth=75):
        for statement in statements(name):
            test = doctest.DocTest([statement], {}, name, None, None, None)
            test.globs = namespace
            doctest.DocTestRunner(optionflags=OPTIONS).run(test, out=said.append, clear_globs=False)
            between(namespace)
    assert not said, "".join(said)
    return own(namespace)


def own(namespace: dict[str, object]) -> dict[str, object]:
    """Objects that an example made. A folder on the disk and a page in a browser are none: they have one owner."""
    others = ModuleType | tempfile.TemporaryDirectory | LoopView
    return {
        name: thing for name, thing in namespace.items() if not name.startswith("__") and not isinstance(thing, others)
    }


def watch_constructors(monkeypatch) -> list[object]:
    """Return a list which fills with the objects of public classes that examples themselves construct."""
    found: list[object] = []

    def watched(init):
        @functools.wraps(init)
        def record(self, *arguments, **options):
            init(self, *arguments, **options)
            if sys._getframe(1).f_globals.get("__name__") == OF_AN_EXAMPLE:
                found.append(self)

        return record

    for kind in CLASSES:
        if inspect.isfunction(vars(kind).get("__init__")) and not getattr(kind, "_is_protocol", False):
            monkeypatch.setattr(kind, "__init__", watched(kind.__init__))
    return found


def _from_an_example(thing: object) -> bool:
    return isinstance(thing, FunctionType | type) and thing.__module__ == OF_AN_EXAMPLE


class _ByValue(pickle.Pickler):
    """Pickler that sends functions and classes of an example by value, as a sweep does, and no others."""

    def reducer_override(self, thing):
        return (pickle.loads, (cloudpickle.dumps(thing),)) if _from_an_example(thing) else NotImplemented


class _ByName(pickle.Pickler):
    """Pickler for which functions and classes of an example are those of a module: they exist once."""

    def __init__(self, memory: io.BytesIO) -> None:
        super().__init__(memory)
        self.known: dict[str, object] = {}

    def persistent_id(self, thing):
        if not _from_an_example(thing):
            return None
        self.known[str(id(thing))] = thing
        return str(id(thing))


def pickled(thing: object) -> bytes:
    memory = io.BytesIO()
    _ByValue(memory).dump(thing)
    return memory.getvalue()


def replace_by_copies(namespace: dict[str, object]) -> None:
    """Replace all objects of an example by copies of pickles, which keep what refers to what."""
    memory = io.BytesIO()
    pickler = _ByName(memory)
    pickler.dump(own(namespace))
    unpickler = pickle.Unpickler(io.BytesIO(memory.getvalue()))
    unpickler.persistent_load = pickler.known.__getitem__
    namespace.update(copy.deepcopy(unpickler.load()))


def bits(thing: object) -> object:
    """Arrays and numbers of a value to the bit; the type of other things."""
    if isinstance(thing, np.ndarray):
        return thing.dtype.str, thing.shape, thing.tobytes()
    if isinstance(thing, float):
        return float(thing).hex()
    if isinstance(thing, list | tuple):
        return [bits(each) for each in thing]
    return type(thing).__qualname__


MOST_STATEMENTS = 10
INTERNAL = (
    *(f"rnc_pin.applications.{room}" for room in ("command_line", "init", "scenario")),
    *(f"rnc_pin.{room}" for room in ("figures", "io", "math", "model", "robots", "visualization")),
)
NEEDED = [name for name, thing in NAMED.items() if name.count(".") == 1 or called_by_users(thing)]
EXAMPLES = [name for name in NAMED if name in NEEDED or statements(name)]
SLOW = ["rnc_pin.SweepResults", "rnc_pin.sweep", "rnc_pin.load_sweep"]  # a sweep starts processes: it runs once
LONG = [  # these run with copies alone, which have to print what the docstring says
    "rnc_pin.Calibration", "rnc_pin.Comparison",
    "rnc_pin.analysis.PrivilegedCoordinates", "rnc_pin.optimal.SetPointController",
    "rnc_pin.plants.mujoco.MuJoCoPlant",
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
        module = importlib.import_module(name)
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
