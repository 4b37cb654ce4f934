"""What MuJoCo warns of, kept off the disk."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType


@contextmanager
def unlogged(mujoco: ModuleType) -> Iterator[None]:
    """Let no file MUJOCO_LOG.TXT be written where the program was started: what matters is an error here."""
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(_ignore)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(before)


def _ignore(message: str) -> None:
    """States and models are looked at after every step, and refused in a line of ours."""
