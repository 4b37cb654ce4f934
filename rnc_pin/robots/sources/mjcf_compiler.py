"""Compilation of an MJCF by MuJoCo, the optional extra ``mujoco``."""

from __future__ import annotations

import re
import warnings
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from rnc_pin.errors import ModelError, nearest
from rnc_pin.extras import missing_extra
from rnc_pin.robots.sources.description import brief, captured_stderr
from rnc_pin.robots.sources.mjcf_meshes import MeshAssets
from rnc_pin.robots.sources.mujoco_log import unlogged

SMALLEST = 1e-15
"""Smallest mass [kg] and moment of inertia [kg m^2] of a moving body in MuJoCo (mjMINVAL)."""


def compile_document(root: ElementTree.Element, path: Path, assets: MeshAssets) -> Any:
    """Return the ``mujoco.MjModel`` of a file.

    A moving body without mass is compiled with the smallest one, because its joint may be locked.

    Args:
        root: root element of the file, reduced to what MuJoCo may see, without meshes.
        path: path of the file, for messages.
        assets: meshes of the file.

    Raises:
        ModelError: MuJoCo is not installed, or refuses the file.
    """
    try:
        import mujoco
    except ImportError:
        raise ModelError(f"{path}: MuJoCo compiles MJCF. {missing_extra('mujoco')}") from None
    try:
        with captured_stderr(), unlogged(mujoco), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                return _compile(mujoco, root, assets)
            except ValueError as error:
                if "mjMINVAL" not in str(error):
                    raise
                bounds = {"boundmass": str(SMALLEST), "boundinertia": str(SMALLEST)}
                root.insert(0, ElementTree.Element("compiler", bounds))
                return _compile(mujoco, root, assets)
    except ModelError:
        raise
    except Exception as error:  # raised by its C code
        raise ModelError(f"{path}: {_explained(brief(error), root)}") from None


def _compile(mujoco: Any, root: ElementTree.Element, assets: MeshAssets) -> Any:
    spec = mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"))
    assets.put_in(spec)
    return spec.compile()


def _explained(message: str, root: ElementTree.Element) -> str:
    """Text of an error of MuJoCo, with the name of the file that is nearest to an unknown one."""
    text, _, place = message.replace("XML Error:", "").replace("Error:", "").partition("Element")
    text, named = " ".join(text.split()), re.search("'([^']+)'", place)
    text += "" if named is None else f" (element '{named[1]}')"
    unknown = re.search("'([^']+)'", text)
    if unknown is not None and ("unknown" in text or "not found" in text):
        names = {each.get("name", "") for each in root.iter()} - {""}
        names |= {"main", *(each.get("class", "main") for each in root.iter("default"))}
        text += nearest(unknown[1], sorted(names))
    return text
