"""Examples of docstrings: who has one, and runs of them with the same objects or with copies of them."""

import copy
import doctest
import functools
import importlib
import inspect
import io
import pickle
import sys
import tempfile
from types import FunctionType, ModuleType

import cloudpickle
import numpy as np

import rnc_pin as rnc
from places import docs_script
from rnc_pin.visualization import LoopView

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
