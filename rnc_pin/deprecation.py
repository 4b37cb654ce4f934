"""Former names, kept for one version with a ``DeprecationWarning`` that names the replacement."""

from __future__ import annotations

import warnings
from typing import Any


def former_name(new: str) -> property:
    """Return a property for the former name of an attribute or method.

    Args:
        new: present name on the same object.
    """

    def get(self: object) -> Any:
        warn_of_rename(type(self).__name__, new)
        return getattr(self, new)

    return property(get, doc=f"Former name of ``{new}``.")


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


def warn_of_rename(former: str, new: str, stacklevel: int = 3) -> None:
    """Warn of a former name.

    Args:
        former: the name in use, for the message.
        new: its replacement.
        stacklevel: frames between this call and the code to blame.
    """
    warnings.warn(f"{former}: renamed, use '{new}'", DeprecationWarning, stacklevel=stacklevel)
