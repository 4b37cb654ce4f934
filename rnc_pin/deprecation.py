"""Former names, kept for one version with a ``DeprecationWarning`` that names the replacement."""

from __future__ import annotations

import functools
import sys
import warnings
from collections.abc import Callable, Mapping
from typing import Any, ParamSpec, TypeVar

_P = ParamSpec("_P")
_T = TypeVar("_T")


def former_name(new: str) -> property:
    """Return a property for the former name of an attribute or method.

    Args:
        new: present name on the same object.
    """

    def get(self: object) -> Any:
        warn_of_rename(type(self).__name__, new)
        return getattr(self, new)

    return property(get, doc=f"Former name of ``{new}``.")


def keep_former_attributes(kind: type, names: Mapping[str, str]) -> None:
    """Give a named tuple read access to fields under their former names. A NamedTuple's body can hold no property.

    Args:
        kind: the named tuple.
        names: present fields by former ones.
    """
    for former, new in names.items():
        setattr(kind, former, former_name(new))


def former_exports(package: str, names: Mapping[str, str]) -> Callable[[str], Any]:
    """Return the ``__getattr__`` of a package whose exports have former names too.

    Args:
        package: name of the package.
        names: present exports by former ones.
    """

    def get(name: str) -> Any:
        if name not in names:
            raise AttributeError(f"module '{package}' has no attribute '{name}'")
        warn_of_rename(f"{package}.{name}", names[name])
        return getattr(sys.modules[package], names[name])

    return get


def adopt_former_names(kind: type, names: dict[str, str]) -> None:
    """Give methods that a class defines under former names their present names.

    Args:
        kind: a class, during its definition.
        names: present names by former names.
    """
    for former, new in names.items():
        if former in vars(kind) and new not in vars(kind):
            warn_of_rename(f"{kind.__name__}.{former}", new, stacklevel=4)
            setattr(kind, new, vars(kind)[former])


def former_keywords(names: Mapping[str, str]) -> Callable[[Callable[_P, _T]], Callable[_P, _T]]:
    """Return a decorator of a function that accepts keywords under their former names too.

    Args:
        names: present keywords by former ones.
    """

    def decorate(function: Callable[_P, _T]) -> Callable[_P, _T]:
        @functools.wraps(function)
        def call(*args: _P.args, **kwargs: _P.kwargs) -> _T:
            if not names.keys() & kwargs.keys():
                return function(*args, **kwargs)
            present = present_keywords(kwargs, names, function.__qualname__.removesuffix(".__init__"), stacklevel=4)
            return function(*args, **present)

        return call

    return decorate


def present_keywords(given: Mapping[str, Any], names: Mapping[str, str], what: str, stacklevel: int = 3) -> Any:
    """Return keywords under their present names, and warn of former ones. Unknown keywords are kept.

    Args:
        given: values by keyword.
        names: present keywords by former ones.
        what: owner of the keywords, for messages.
        stacklevel: frames between the warning and the code to blame.

    Raises:
        TypeError: a keyword is given under both names.
    """
    present = {key: value for key, value in given.items() if key not in names}
    for former in [key for key in given if key in names]:
        new = names[former]
        if new in given:
            raise TypeError(f"{what}: '{former}' is the former name of '{new}', and both are given")
        warn_of_rename(f"{what}: {former}", new, stacklevel)
        present[new] = given[former]
    return present


def adopt_former_fields(kind: Any, names: Mapping[str, str]) -> None:
    """Let a named tuple read and take its fields by their former names too.

    Args:
        kind: class of the named tuple.
        names: present names by former names.
    """

    def renamed(method: Callable[_P, _T]) -> Callable[_P, _T]:
        @functools.wraps(method)
        def call(*args: _P.args, **fields: _P.kwargs) -> _T:
            if not names.keys() & fields.keys():
                return method(*args, **fields)
            return method(*args, **present_keywords(fields, names, kind.__name__))

        return call

    keep_former_attributes(kind, names)
    kind.__new__, kind._replace = renamed(kind.__new__), renamed(kind._replace)


def warn_of_rename(former: str, new: str, stacklevel: int = 3) -> None:
    """Warn of a former name.

    Args:
        former: the name in use, for the message.
        new: its replacement.
        stacklevel: frames between this call and the code to blame.
    """
    warnings.warn(f"{former}: renamed, use '{new}'", DeprecationWarning, stacklevel=stacklevel)
