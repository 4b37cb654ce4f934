"""Growth vectors of a tractor with trailers at regular and singular configurations.

F. Jean, The car with n trailers: characterisation of the singular configurations, ESAIM: COCV 1 (1996) 241-266. Each
trailer is hitched to the middle of the axle in front of it, at distance one.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

import rnc_pin as rnc
from benchmarks.validation.row import MATRIX, Row

RIGHT, SECOND = np.pi / 2, np.pi / 4  # Jean's first two angles: a_1, and a_2 = arctan(sin(a_1))
CASES = {  # hitches from the tractor on [rad]
    "two trailers, straight": (0.0, 0.0),
    "two trailers, tractor across": (RIGHT, 0.3),
    "three trailers, drawn": (0.4, -0.7, 1.1),
    "three trailers, first across": (0.5, RIGHT, 0.2),
    "three trailers, first across and tractor at 45 degrees": (SECOND, RIGHT, 0.2),
    "three trailers, both across": (RIGHT, RIGHT, 0.2),
}


def with_trailers(count: int) -> rnc.ReducedModel:
    """Speed and heading of the tractor as reducing outputs; every axle is a knife edge."""
    model, joint = pin.Model(), 0
    kinds = ("x", pin.JointModelPX()), ("y", pin.JointModelPY()), ("heading", pin.JointModelRZ())
    for name, kind in kinds:
        joint = model.addJoint(joint, kind, pin.SE3.Identity(), name)
    axle = pin.SE3.Identity()
    frames = []
    for k in range(count + 1):
        if k:
            joint = model.addJoint(joint, pin.JointModelRZ(), axle, f"hitch_{k}")
            axle = pin.SE3(np.eye(3), np.array([-1.0, 0.0, 0.0]))
        model.appendBodyToJoint(joint, pin.Inertia(1.0, np.zeros(3), 0.1 * np.eye(3)), axle)
        frames.append(f"axle_{k}")
        model.addFrame(pin.Frame(frames[-1], joint, axle, pin.FrameType.OP_FRAME))
    system = rnc.NonholonomicSystem(rnc.Robot(model), [rnc.NoSideSlip(frame) for frame in frames])
    return system.reduce([rnc.FrameSpeed(frames[0]), rnc.FrameYaw(frames[0])])


def depths(hitches: tuple[float, ...]) -> list[int]:
    """Depth of the brackets that reach dimension 2, 3, ..., n + 3, by Jean's recursion (theorem 3.1).

    The tractor and its hitch go first: ``b_i = b'_(i-1) + b''_(i-2)`` with the hitch at a right angle,
    ``2 b'_(i-1) - b''_(i-2)`` if the hitches are Jean's angles ``a_k, ..., a_1`` up to one in front of the last
    trailer, and ``1 + b'_(i-1)`` otherwise. One prime is without the tractor, two are without the first trailer too.
    """
    if not hitches:
        return [1, 2]
    shorter = depths(hitches[1:])
    if len(hitches) == 1:
        return [1, 2, 1 + shorter[1]]
    shortest = depths(hitches[2:])
    angles = [RIGHT]
    while len(angles) < len(hitches) - 1:
        angles.append(float(np.arctan(np.sin(angles[-1]))))
    first = np.isclose(abs(hitches[0]), RIGHT)
    later = any(
        np.allclose(hitches[: k + 1], side * np.array(angles[k::-1])) for k in range(1, len(angles)) for side in (1, -1)
    )
    deeper = [1, 2]
    for i in range(2, len(hitches) + 2):
        one, two = shorter[i - 1], shortest[i - 2]
        deeper.append(one + two if first else 2 * one - two if later else 1 + one)
    return deeper


def jean(hitches: tuple[float, ...]) -> list[int]:
    """Growth vector at the hitches [rad]."""
    found = depths(hitches)
    return [1 + sum(depth <= level for depth in found) for level in range(1, found[-1] + 1)]


def rows() -> list[Row]:
    """Growth vector of each case; that of two trailers with the tractor across is (2, 3, 4, 4, 5)."""
    found = []
    for words, hitches in CASES.items():
        reduced = with_trailers(len(hitches))
        q = reduced.robot.configuration({f"hitch_{k}": angle for k, angle in enumerate(hitches, start=1)})
        expected = jean(hitches)
        vector = ", ".join(map(str, expected))
        ours = np.array(rnc.analysis.growth_vector(reduced, q), dtype=float)
        found.append(Row("Jean 1996", f"{words}: {vector}", expected, ours, MATRIX))
    return found
