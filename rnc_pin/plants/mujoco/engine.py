"""MuJoCo itself, where it is installed."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from rnc_pin.errors import ConfigurationError

try:
    import mujoco
except ImportError:
    raise ConfigurationError("MuJoCo is not installed: pip install 'rnc_pin[mujoco]'") from None

__all__ = ["mujoco", "unlogged"]


@contextmanager
def unlogged() -> Iterator[None]:
    """What diverges is an error here: no file MUJOCO_LOG.TXT is written of it beside."""
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(_ignore)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(before)


def _ignore(message: str) -> None:
    """The state is looked at after every step."""
