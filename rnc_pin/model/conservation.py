"""Checks of conserved momenta: no actuator, no passive force and no constraint reaction may act on the joint."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from rnc_pin.errors import ConstraintError, few
from rnc_pin.model.actuation import Actuation
from rnc_pin.model.kinematics import Kinematics
from rnc_pin.model.passive_forces import PassiveForces
from rnc_pin.model.row_stack import RowStack
from rnc_pin.model.rows import Rows

_DRIVES = 1e-12  # entry of B beyond rounding
_ACTS = 1e-9  # relative entry of a row beyond rounding: a user's loop in world axes is closed to 1e-11 m
_ROUNDING = 1e-12  # entry of a row relative to the largest entry of all rows


def check_actuators(
    blocks: Collection[Rows], actuation: Actuation, kinematics: Kinematics, samples: np.ndarray
) -> None:
    """Raise an error if an actuator drives a momentum that is declared as conserved.

    Args:
        blocks: bound rows of all constraints.
        actuation: the actuation matrix B(q).
        kinematics: kinematics of the robot.
        samples: configurations (samples, nq).

    Raises:
        ConstraintError: an actuator drives a conserved momentum; the message names both.
    """
    conserved = [block for block in blocks if block.conserved is not None]
    for q in samples if conserved else ():
        matrix = actuation.matrix(kinematics.position(q))
        for block in conserved:
            driven = np.abs(matrix[block.conserved]).max(axis=0) > _DRIVES
            if driven.any():
                name = actuation.names[int(np.argmax(driven))]
                raise ConstraintError(f"actuator '{name}' drives {block.names[0]}, which is declared as conserved")


def check_forces(blocks: Collection[Rows], forces: PassiveForces, kinematics: Kinematics, samples: np.ndarray) -> None:
    """Raise an error if a passive force acts on a momentum that is declared as conserved.

    Args:
        blocks: bound rows of all constraints.
        forces: the passive forces.
        kinematics: kinematics of the robot.
        samples: configurations (samples, nq).

    Raises:
        ConstraintError: a force acts on a conserved momentum; the message names both.
    """
    conserved = [block for block in blocks if block.conserved is not None]
    generator = np.random.default_rng(0)
    for q in samples if conserved and forces else ():
        at = kinematics.position(q).with_velocity(generator.uniform(-1.0, 1.0, kinematics.nv))
        for each in forces:
            force = np.abs(each.force(at))
            for block in conserved:
                if force[block.conserved].max() > _ACTS * max(1.0, float(force.max())):
                    raise ConstraintError(f"{each.name} acts on {block.names[0]}, which is declared as conserved")


def check_reactions(rows: RowStack, samples: np.ndarray, lengths: np.ndarray, couplings: Collection[str] = ()) -> None:
    """Raise an error if a constraint reaction changes a momentum that is declared as conserved.

    The reaction of a row is ``A^T lambda``. It does not change the momentum of a joint if the row is zero in the
    columns of that joint. Then a rigid motion of the subtree of the joint has no effect on the row. This holds for a
    loop within the subtree, but not for a wheel on the ground or a hand on a wall. Momentum rows have no reaction.

    Args:
        rows: all constraint rows, (k,).
        samples: these rows at assembled configurations, (samples, k, nv).
        lengths: typical length of each row, (k,), relative to which it counts as zero; 0 if there is none.
        couplings: names of rows that come from the robot's file.

    Raises:
        ConstraintError: a row acts on a conserved momentum; the message gives the rows, the momentum and the remedy.
    """
    momenta = [place for place in rows.places if place.block.conserved is not None]
    reacts = np.ones(rows.size, dtype=bool)
    for place in momenta:
        reacts[place.where] = False
    if not momenta or not reacts.any():
        return
    longest = np.maximum(np.linalg.norm(samples, axis=-1).max(axis=0), lengths)
    limit = np.maximum(_ACTS * longest, _ROUNDING * np.abs(samples[:, reacts]).max())
    for block, *_ in momenta:
        effect = np.abs(samples[..., block.conserved]).max(axis=(0, -1))
        found = [rows.names[k] for k in np.flatnonzero(reacts & (effect > limit))]
        if not found:
            continue
        acts = f"constraint row {found[0]} acts" if len(found) == 1 else f"constraint rows {few(found)} act"
        coupled = " (mimic=False, or mimic: false, omits the file's couplings)" if {*found} & {*couplings} else ""
        momentum = block.names[0].removesuffix("[0]")
        raise ConstraintError(
            f"{acts} on {momentum}, which is declared as conserved: omit the momentum (the motion follows from the "
            f"other constraints) or what acts on it{coupled}"
        )
