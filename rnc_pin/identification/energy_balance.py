"""Power balance of a measured motion: change of the model's energy, and work of the measured efforts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rnc_pin.identification.logs.log import Log
from rnc_pin.identification.rolling_motion import RollingMotion
from rnc_pin.identification.suspects import Suspect
from rnc_pin.robots.robot import Robot

_WINDOW = 1.0  # duration of a balance [s]
_WIDTH = 0.1  # duration over which velocities are averaged [s]
_MOST = 3
_WORTH = 0.1  # share of the remaining squares that a further number has to explain
_RARE = 12.0  # share of noise that one of few numbers explains by chance, times the number of windows
_BALANCED = 0.01  # residual relative to the exchanged energy below which the balance holds


@dataclass(frozen=True)
class EnergyBalance:
    """Energy of the model and work of the measured efforts over windows of one second.

    The balance assumes that wheels roll, and that all efforts which do work are measured. Joint damping and dry
    friction of the robot's file count.

    Example:
        >>> rnc.identification.EnergyBalance(np.zeros(1), np.ones(1), np.ones(1), np.full(1, 0.2), ()).residual
        array([-0.2])
    """

    time: np.ndarray
    """Times in the middle of the windows (W,) [s]."""
    change: np.ndarray
    """Change of the model's kinetic and potential energy (W,) [J]."""
    work: np.ndarray
    """Work of the measured efforts (W,) [J]."""
    loss: np.ndarray
    """Loss by the damping and friction of the file (W,) [J]."""
    suspects: tuple[Suspect, ...]
    """Numbers that explain the residual, the most suspicious first: friction, masses, scales of efforts."""

    @property
    def residual(self) -> np.ndarray:
        """Work minus loss minus change (W,) [J]: what an unknown friction takes, or a wrong mass hides."""
        return self.work - self.loss - self.change

    @property
    def imbalance(self) -> float:
        """Root mean square residual over that of the exchanged energy."""
        exchanged = np.sqrt(np.mean((np.abs(self.work) + np.abs(self.change)) ** 2))
        return float(np.sqrt(np.mean(self.residual**2)) / exchanged) if exchanged > 0 else 0.0


def energy_balance(motion: RollingMotion, robot: Robot, log: Log) -> EnergyBalance | None:
    """Return the power balance of a motion; None without measured efforts of its joints.

    Args:
        motion: the motion, without unknown parameters.
        robot: its robot.
        log: efforts of joints.
    """
    joints = [name for name in log.names("effort") if name in motion.joint_names]
    edges = np.arange(motion.time[0] + _WIDTH, motion.time[-1] - _WIDTH, _WINDOW)
    if not joints or len(edges) < 3:
        return None
    kinetic, potential = _energies(robot, *motion.states(edges, _WIDTH))
    changes = np.diff(kinetic + potential, axis=0)
    moved = motion.joint_changes()
    number = np.searchsorted(edges, motion.step_times, side="right") - 1
    inside = (number >= 0) & (number < len(edges) - 1)
    efforts = {name: log.channel("effort", name).at(motion.step_times)[:, 0] for name in joints}
    known = np.all([np.isfinite(each) for each in efforts.values()], axis=0)

    def summed(values: np.ndarray) -> np.ndarray:
        return np.bincount(number[inside], values[inside], minlength=len(edges) - 1)

    broken = np.searchsorted(edges, motion.breaks, side="right") - 1
    whole = summed((~known).astype(float)) == 0
    whole[broken[(broken >= 0) & (broken < len(whole))]] = False
    if whole.sum() < 3:
        return None
    works = {name: summed(np.where(known, efforts[name], 0.0) * moved[name]) for name in joints}
    duration = np.diff(motion.time)
    parts: list[tuple[str, str, float, np.ndarray]] = []
    loss = np.zeros(len(edges) - 1)
    for name, change in moved.items():
        column = robot.velocity_indices(name).start
        viscous, dry = summed(change**2 / duration), summed(np.abs(change))
        damping, friction = float(robot.model.damping[column]), float(robot.model.friction[column])
        loss += damping * viscous + friction * dry
        unit = robot.velocity_units[column]
        force = "N" if unit == "m/s" else "N m"
        parts += [(f"viscous friction of {name}", f"{force} s/{unit.removesuffix('/s')}", damping, viscous)]
        parts += [(f"dry friction of {name}", force, friction, dry)]
    for index, inertia in enumerate(robot.model.inertias):
        if index and inertia.mass > 0 and np.abs(changes[:, index]).max() > 0:
            parts.append((f"mass of {robot.model.names[index]}", "kg", inertia.mass, changes[:, index] / inertia.mass))
    parts += [(f"effort of {name}", "", 1.0, -work) for name, work in works.items()]
    found = EnergyBalance(
        (edges[1:] + edges[:-1])[whole] / 2,
        changes.sum(axis=1)[whole],
        sum(works.values(), np.zeros(len(whole)))[whole],
        loss[whole],
        (),
    )
    suspects = _suspects(found, [(*said, column[whole]) for *said, column in parts])
    return EnergyBalance(found.time, found.change, found.work, found.loss, suspects)


def _energies(robot: Robot, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Kinetic and potential energy (T, bodies) of each body [J]."""
    model, data = robot.model, robot.model.createData()
    kinetic, potential = np.zeros((len(q), model.njoints)), np.zeros((len(q), model.njoints))
    gravity = model.gravity.linear
    for row, (position, velocity) in enumerate(zip(q, v, strict=True)):
        pin.forwardKinematics(model, data, position, velocity)
        for index in range(1, model.njoints):
            inertia = model.inertias[index]
            kinetic[row, index] = inertia.vtiv(data.v[index]) / 2
            potential[row, index] = -inertia.mass * gravity @ data.oMi[index].act(inertia.lever)
    return kinetic, potential


def _suspects(balance: EnergyBalance, parts: list[tuple[str, str, float, np.ndarray]]) -> tuple[Suspect, ...]:
    """Numbers that explain the residual, chosen one after the other."""
    if balance.imbalance < _BALANCED:
        return ()
    residual, count = balance.residual, len(balance.time)
    columns = np.stack([column for *_, column in parts], axis=1)
    chosen: list[int] = []
    values, shares = np.zeros(0), []
    left, first = residual, float(residual @ residual)
    while len(chosen) < _MOST:
        rest = columns
        if chosen:
            basis, _ = np.linalg.qr(columns[:, chosen])
            rest = columns - basis @ (basis.T @ columns)
        sizes, origin = np.sum(rest**2, axis=0), np.sum(columns**2, axis=0)
        gains = np.divide((rest.T @ left) ** 2, sizes, out=np.zeros_like(sizes), where=sizes > 1e-9 * origin)
        for index in np.argsort(-gains):
            if gains[index] <= max(_WORTH, _RARE / count) * float(left @ left):
                index = -1
                break
            trial = np.linalg.lstsq(columns[:, [*chosen, int(index)]], residual, rcond=None)[0]
            if _possible(trial[-1], parts[int(index)]):
                break
        else:
            index = -1
        if index < 0:
            break
        chosen.append(int(index))
        values = trial
        left = residual - columns[:, chosen] @ values
        shares.append(1.0 - float(left @ left) / first)
        if np.sqrt(np.mean(left**2)) < _BALANCED * np.sqrt(
            np.mean((np.abs(balance.work) + np.abs(balance.change)) ** 2)
        ):
            break
    return tuple(
        Suspect(name, unit, nominal, nominal + float(value), share)
        for (name, unit, nominal, _), value, share in zip([parts[k] for k in chosen], values, shares, strict=True)
    )


def _possible(change: float, part: tuple[str, str, float, np.ndarray]) -> bool:
    """True if a number with this change is possible: friction and masses are not negative."""
    name, _, nominal, _ = part
    return name.startswith("effort") or nominal + change >= 0
