"""Expansion of xacro files without ROS, where expressions can only compute values.

``xacro`` 2.1 defines the format, and the tests compare with it. That library passes expressions to Python's
``eval``, so a file could run any program. Here their syntax tree is evaluated (``xacro_expressions``). Only listed
functions, methods and environment variables are allowed, and time and size are bounded.

The library has the same order of evaluation. Macros see the properties of their caller. Properties are evaluated on
first access. Blocks are evaluated once in the call and again at their insertion.
"""

from __future__ import annotations

import keyword
import os
from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from xml.etree.ElementTree import Element

from rnc_pin.errors import ModelError, nearest, place_of
from rnc_pin.robots.robot_files import Packages
from rnc_pin.robots.sources import xacro_definitions as definitions
from rnc_pin.robots.sources.xacro_definitions import Parameter, PlacedElement, Scope, Substitution
from rnc_pin.robots.sources.xacro_expressions import Namespace, Value

_PREFIX = "xacro:"


def expand(
    path: Path, arguments: Mapping[str, object] | None, packages: Packages, known: Mapping[str, Collection[str]]
) -> Element:
    """Return the root element of an expanded xacro file.

    Args:
        path: path of the file.
        arguments: values for its ``<xacro:arg>``.
        packages: packages and files that it may name.
        known: element to the elements that the format knows inside. Others, with the name of a macro, are refused: they
            are calls without the prefix.

    Raises:
        ModelError: not XML, an unknown macro, argument, property or package, or a refused expression.
    """
    texts = {
        name: str(value).lower() if isinstance(value, bool) else str(value) for name, value in (arguments or {}).items()
    }
    given = definitions.Arguments(texts)
    expander = _Expander(path, Substitution(path, given, packages), known)
    try:
        root = expander.expand()
    except RecursionError:
        raise ModelError(f"{path}: xacro: macros or includes are recursive or nested too deeply") from None
    except ModelError as error:
        raise ModelError(f"{path}: xacro: {error}{expander.fault}") from None
    # Afterwards: only the expansion shows which arguments the files ask for.
    for name in texts:
        place_of(name, given.asked, f"{path}: no xacro argument", ModelError)
    return root


class _Expander:
    """Expander of one file.

    Args:
        path: path of the file.
        substitution: its arguments, and the files that it may name.
        known: see ``expand``.

    Attributes:
        fault: file and line of the error of ``expand``, in brackets after a blank; empty if they are unknown.
    """

    def __init__(self, path: Path, substitution: Substitution, known: Mapping[str, Collection[str]]) -> None:
        self._path, self._known, self._substitution = path, known, substitution
        self._value, self._arguments = substitution.value, substitution.arguments
        self._called: list[Element] = []
        self.fault = ""
        self._elements: Mapping[str, Callable[[Element, Element, Scope], None]] = {
            "arg": self._arg,
            "if": self._condition,
            "include": self._include,
            "insert_block": self._insert_block,
            "macro": self._macro,
            "property": self._property,
            "unless": self._condition,
        }

    def expand(self) -> Element:
        """Return the root element of the expanded file."""
        return self._copy(definitions.read_document(self._path), Scope(self._substitution.symbols, resolve=self._value))

    def _text(self, text: str, scope: Scope) -> str:
        return str(self._value(text, scope))

    def _copy(self, source: Element, scope: Scope) -> Element:
        copy = PlacedElement(source.tag)
        if isinstance(source, PlacedElement):
            copy.file, copy.line = source.file, source.line
        for name, text in source.items():
            if not name.startswith(_PREFIX):
                copy.set(name, self._text(text, scope))
        self._inside(source, copy, scope)
        return copy

    def _inside(self, source: Element, target: Element, scope: Scope) -> None:
        """Expand the content of an element into another element."""
        if source.text:
            _write(target, self._text(source.text, scope))
        for child in source:
            try:
                self._add(child, target, scope)
            except ModelError:
                if not self.fault and isinstance(child, PlacedElement):  # the innermost element is nearest to the error
                    file = "" if child.file == self._path else f"in {child.file}, "
                    self.fault = f" ({file}line {child.line})"
                raise

    def _add(self, child: Element, target: Element, scope: Scope) -> None:
        # Elements count as steps too: macros that call macros many times are bounded.
        self._substitution.budget.spend(10)
        if child.tag.startswith(_PREFIX):
            self._elements.get(child.tag.removeprefix(_PREFIX), self._call)(child, target, scope)
        else:
            self._check_prefix(child.tag, target.tag, scope)
            target.append(self._copy(child, scope))
        if child.tail:
            _write(target, self._text(child.tail, scope))

    def _check_prefix(self, tag: str, parent: str, scope: Scope) -> None:
        """Refuse a macro or element of xacro without its prefix: xacro would leave it alone."""
        if tag in self._known.get(parent, (tag,)):
            return
        # A macro can write an element of its own name.
        if tag in scope.macros and scope.macros[tag] not in self._called:
            raise ModelError(f"element <{tag}>: a macro of this name exists; write <{_PREFIX}{tag}>")
        if tag in self._elements:
            raise ModelError(f"element <{tag}>: xacro has an element of this name; write <{_PREFIX}{tag}>")

    def _arg(self, element: Element, _target: Element, scope: Scope) -> None:
        name, default = _required(element, "name"), element.get("default")
        self._arguments.asked.add(name)
        if default is not None and name not in self._arguments:
            self._arguments[name] = self._text(default, scope)

    def _condition(self, element: Element, target: Element, scope: Scope) -> None:
        text = _required(element, "value")
        if definitions.truth(self._value(text, scope), text) == (element.tag == "xacro:if"):
            self._inside(element, target, scope)

    def _insert_block(self, element: Element, target: Element, scope: Scope) -> None:
        name = _required(element, "name")
        many, one = scope.blocks.get(f"**{name}"), scope.blocks.get(f"*{name}")
        if many is not None:
            self._inside(many, target, scope)
        elif one is not None:
            self._add(one, target, scope)
        else:
            raise ModelError(f"no block '{name}'")

    def _property(self, element: Element, _target: Element, scope: Scope) -> None:
        name = self._text(_required(element, "name"), scope)
        if not name.isidentifier() or keyword.iskeyword(name) or name.startswith("__"):
            raise ModelError(f"'{name[:80]}' cannot be the name of a property")
        value, default = element.get("value"), element.get("default")
        remove = self._flag(element, "remove", "false", scope)
        if (value is not None) + (default is not None) + remove > 1:
            raise ModelError(f"property '{name}' has more than one of value, default and remove")
        if remove:
            scope.remove(name)
            return
        if default is not None and name in scope:
            return
        value = value if default is None else default
        lazy = self._flag(element, "lazy_eval", "true", scope)
        owner = {"global": scope.outermost(), "parent": scope.caller()}.get(element.get("scope", ""))
        if value is None:
            (owner or scope).blocks[f"**{name}"] = element
        elif owner is None and lazy:
            scope.define(name, value, lazy=True)
        else:
            # Now, in the scope that the element is in: another one may not have the names of its text.
            (owner or scope).define(name, self._value(value, scope))

    def _flag(self, element: Element, key: str, default: str, scope: Scope) -> bool:
        text = element.get(key, default)
        return definitions.truth(self._value(text, scope), text)

    def _macro(self, element: Element, _target: Element, scope: Scope) -> None:
        name = _required(element, "name").removeprefix(_PREFIX)
        if name == "call" or "." in name:
            raise ModelError(f"a macro cannot have the name '{name}'")
        scope.macros[name] = element

    def _call(self, element: Element, target: Element, scope: Scope) -> None:
        name = element.tag.removeprefix(_PREFIX)
        # A call costs like many steps: macros that call themselves end by the budget.
        self._substitution.budget.spend(50)
        owner, macro = _resolve(name, scope)
        inner = owner.inner()
        missing = {parameter.name: parameter for parameter in definitions.parameters_of(macro.get("params", ""))}
        for key, text in element.items():
            if missing.pop(key, None) is None:
                raise ModelError(f"macro '{name}' has no parameter '{key}'{nearest(key, missing)}")
            # In the scope of the caller: names of the macro do not exist there.
            inner.define(key, self._value(text, scope))
        self._take_blocks(element, missing, inner, scope)
        for parameter in list(missing.values()):
            if parameter.default is not None or parameter.forwarded:
                inner.define(parameter.name, self._default(parameter, scope))
                del missing[parameter.name]
        if missing:
            raise ModelError(f"macro '{name}' is called without {', '.join(missing)}")
        self._called.append(macro)
        self._check_depth()
        self._inside(macro, target, inner)
        self._called.pop()

    def _take_blocks(self, call: Element, missing: dict[str, Parameter], inner: Scope, scope: Scope) -> None:
        """Expand the elements of a call in the caller's scope, and assign them to the macro's blocks in order."""
        given = Element("blocks")
        self._inside(call, given, scope)
        # As in xacro, elements of a call are expanded before the macro runs, in the caller's scope.
        blocks = list(given)
        names = [name for name in missing if name.startswith("*")]
        if len(blocks) < len(names):
            raise ModelError(f"too few blocks for <{call.tag}>: {names[len(blocks)].strip('*')} is missing")
        if len(blocks) > len(names):
            raise ModelError(f"too many blocks for <{call.tag}>: <{blocks[len(names)].tag}> is not used")
        for name, block in zip(names, blocks, strict=True):
            block.tail = None
            inner.blocks[name] = block
            del missing[name]

    def _default(self, parameter: Parameter, scope: Scope) -> Value:
        if parameter.forwarded and parameter.name in scope:
            return scope[parameter.name]
        if parameter.default is None:
            raise ModelError(f"no property '{parameter.name}' to forward to the macro")
        return self._value(parameter.default, scope)

    def _include(self, element: Element, target: Element, scope: Scope) -> None:
        inner, namespace = scope, element.get("ns")
        if namespace:
            name, inner = self._text(namespace, scope), scope.inner(namespace=True)
            scope.define(name, Namespace(name, inner))
        optional = definitions.truth(element.get("optional", "false"), "optional")
        path = self._substitution.path(self._text(_required(element, "filename"), scope))
        if optional and not os.path.isfile(path):
            return
        # Before it is opened: files outside of the allowed folders are not even looked at.
        self._substitution.admitted(path)
        self._substitution.files.append(path)
        self._check_depth()
        try:
            source = definitions.read_document(path)
        except ModelError:
            if os.path.isfile(path):  # a missing file is a fault of the file that includes it
                self.fault = f" (in {path})"
            raise
        self._inside(source, target, inner)
        self._substitution.files.pop()

    def _check_depth(self) -> None:
        # Before Python's own limit, whose error pathlib takes for a ring of links, and an expression for its own fault.
        deepest = 100  # nesting of macros and includes, which are expanded by recursion
        if len(self._called) + len(self._substitution.files) > deepest:
            raise ModelError("macros or includes are recursive or nested too deeply")


def _resolve(name: str, scope: Scope) -> tuple[Scope, Element]:
    """Return the element of a macro with its scope; a dotted name refers to a file that was included with a name."""
    if name not in scope.macros:
        *namespaces, last = name.split(".")
        owner: object = scope
        for each in namespaces:
            space = owner.get(each) if isinstance(owner, Scope) else None
            owner = space.members if isinstance(space, Namespace) else None
        if not isinstance(owner, Scope) or last not in owner.macros:
            raise ModelError(f"unknown macro name '{_PREFIX}{name}'{nearest(name, scope.macros)}")
        scope, name = owner, last
    return scope, scope.macros[name]


def _required(element: Element, key: str) -> str:
    text = element.get(key)
    if text is None:
        raise ModelError(f"<{element.tag}> without {key.removeprefix(_PREFIX)}")
    return text


def _write(target: Element, text: str) -> None:
    if len(target):
        target[-1].tail = (target[-1].tail or "") + text
    else:
        target.text = (target.text or "") + text
