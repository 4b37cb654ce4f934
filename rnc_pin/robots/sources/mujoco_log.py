"""Suppression of MuJoCo's log file."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType


@contextmanager
def unlogged(mujoco: ModuleType) -> Iterator[None]:
    """Prevent MuJoCo from writing MUJOCO_LOG.TXT to the working directory; important faults raise errors here."""
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(_ignore)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(before)


def _ignore(message: str) -> None:
    """Ignore a warning: states and models are checked after every step, with own error messages."""
