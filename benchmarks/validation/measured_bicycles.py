"""Bicycles that Moore measured: Human Control of a Bicycle, dissertation, University of California, Davis (2012).

Each full nonlinear bicycle is built from its 25 parameters, reduced and linearised. The reference is appendix A of
Meijaard et al. 2007 for the same parameters, with 50 digits (tests/data/moore_bicycles.json).
"""

from __future__ import annotations

import json
import warnings
from collections.abc import Mapping

import numpy as np
import pinocchio as pin

import rnc_pin as rnc
from benchmarks.validation.bicycle import in_order, linear, matrices
from benchmarks.validation.row import DATA, EIGENVALUE, MATRIX, Row

BICYCLES = json.loads((DATA / "moore_bicycles.json").read_text())["bicycles"]
_AXES = ("xx", "yy", "zz")


def bicycle(p: Mapping[str, float]) -> rnc.ReducedModel:
    """Whipple bicycle of given parameters, with the names and outputs of the benchmark.

    Args:
        p: parameters by the names of Meijaard et al. 2007, with z down and y to the right; the model has z up and y to
            the left.
    """
    model = pin.Model()
    model.gravity.linear = np.array([0.0, 0.0, -p["g"]])

    def append(joint: int, name: str, letter: str, place: tuple[float, float, float]) -> None:
        xx, yy, zz = (p[f"I{letter}{axes}"] if f"I{letter}{axes}" in p else p[f"I{letter}xx"] for axes in _AXES)
        inertia = np.diag([xx, yy, zz])
        inertia[0, 2] = inertia[2, 0] = -p.get(f"I{letter}xz", 0.0)
        model.appendBodyToJoint(joint, pin.Inertia(p[f"m{letter}"], np.array(place), inertia), pin.SE3.Identity())
        model.addFrame(pin.Frame(name, joint, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))

    def at(x: float, z: float) -> pin.SE3:
        return pin.SE3(np.eye(3), np.array([x, 0.0, z]))

    # The frame's origin is the rear wheel's centre, that of the fork the point of the steer axis on the ground.
    crossing = p["w"] + p["c"]
    base = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root_joint")
    append(base, "rear_frame", "B", (p["xB"], 0.0, -p["zB"] - p["rR"]))
    rear = model.addJoint(base, pin.JointModelRUBY(), pin.SE3.Identity(), "rear_axle")
    append(rear, "rear_wheel", "R", (0.0, 0.0, 0.0))
    axis = np.array([np.sin(p["lam"]), 0.0, -np.cos(p["lam"])])
    steering = model.addJoint(base, pin.JointModelRevoluteUnaligned(axis), at(crossing, -p["rR"]), "steering")
    append(steering, "fork", "H", (p["xH"] - crossing, 0.0, -p["zH"]))
    front = model.addJoint(steering, pin.JointModelRUBY(), at(-p["c"], p["rF"]), "front_axle")
    append(front, "front_wheel", "F", (0.0, 0.0, 0.0))
    wheels = [rnc.RollingWheel("rear_wheel", p["rR"]), rnc.RollingWheel("front_wheel", p["rF"])]
    with warnings.catch_warnings():  # measured moments violate the triangle inequality by their rounding
        warnings.filterwarnings("ignore", "robot '': impossible rotational inertia", rnc.ModelWarning)
        robot = rnc.Robot(model)
    system = rnc.NonholonomicSystem(robot, wheels, actuators=["steering"])
    return system.reduce(
        [rnc.FrameAngularVelocity("rear_frame", "x"), rnc.JointPosition("steering"), rnc.JointPosition("rear_axle")],
        [rnc.FrameTilt("rear_frame", "y"), rnc.FramePosition("rear_wheel", "xy")],
    )


def rows() -> list[Row]:
    """Matrices and eigenvalues of each bicycle."""
    result = []
    for name, data in BICYCLES.items():
        p, published = data["parameters"], data["linear"]
        source = "Moore 2012" + (" (parameter file)" if "rider" in name else "")
        reduced = bicycle(p)
        found = matrices(reduced, p["rR"], p["g"])
        sizes = {key: np.abs(published[key]).max() for key in found}
        expected = np.stack([np.array(published[key]) / sizes[key] for key in found])
        ours = np.stack([found[key] / sizes[key] for key in found])
        result.append(Row(source, f"{name}: matrices M, C1, K0, K2", expected, ours, MATRIX))
        for speed, values in published["eigenvalues"].items():
            known = in_order(np.array(values["real"]) + 1j * np.array(values["imag"]))
            computed = in_order(linear(float(speed), reduced, p["rR"]).eigenvalues)
            k = int(np.argmax(np.abs(computed - known) / np.abs(known)))
            quantity = f"{name}: eigenvalues at {speed} m/s, worst of 4"
            result.append(Row(source, quantity, known[k], complex(computed[k]), EIGENVALUE))
    return result
