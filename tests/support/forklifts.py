"""Forklift with a load on a planar base: model, and a replay of its plans by Pinocchio and coal alone."""

import coal
import numpy as np
import pinocchio as pin

import rnc_pin as rnc
from urdf_parts import joint, link, read

BASE, LOAD, OFFSET = (1.6, 0.9, 1.0), (0.9, 0.8, 0.6), (1.3, 0.0, 0.35)


def forklift(folder, effort=3000, **options):
    """Reduced model with forward speed, turning rate and lift."""
    boxes = ('<box size="{} {} {}"/>'.format(*size) for size in (BASE, LOAD))
    lift = {"axis": "0 0 1", "kind": "prismatic", "effort": effort, "limits": (0, 1.4), "speed": 0.5}
    parts = [link("base", 300, next(boxes), at="0 0 0.5", moment=60), link("load", 80, next(boxes), moment=8)]
    parts += [joint("lift_joint", "base", "load", OFFSET, **lift)]
    robot = read(folder / "forklift.urdf", *parts, base="planar", **options)
    inputs = [rnc.FrameForce("base", "x"), rnc.FrameTorque("base", "z"), "lift_joint"]
    system = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("base")], inputs)
    return system.reduce([rnc.FrameSpeed("base"), rnc.FrameYaw("base"), rnc.JointPosition("lift_joint")])


def goal_of(pose, lift):
    """Goal of a plan: pose of the base, and lift."""
    place = {rnc.FramePosition("base", "xy"): list(pose[:2]), rnc.FrameYaw("base"): float(pose[2])}
    return {**place, rnc.JointPosition("lift_joint"): float(lift)}


def replay(plan, model, step=1e-3):
    """Configurations every step of a plan in the acceleration form; the twist (speed, 0, turn) is in own axes."""
    assert plan.info.form == "acceleration"
    q, w = plan.q[0], plan.w[0].copy()
    found = [q]
    for u, h in zip(plan.u, np.diff(plan.time), strict=True):
        count = int(np.ceil(h / step))
        for _ in range(count):
            middle = w + 0.5 * h / count * u
            q = pin.integrate(model, q, h / count * np.array([middle[0], 0.0, middle[1], middle[2]]))
            w += h / count * u
            found.append(q)
    return np.array(found), w


def smallest_distance(q, rack, size):
    """Smallest distance of base and load from a box at configurations (n, 5)."""
    bodies, result = (coal.Box(*BASE), coal.Box(*LOAD)), np.inf
    box, place = coal.Box(*size), coal.Transform3s(np.eye(3), np.array(rack))
    for x, y, c, s, lift in q:
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        for body, at in zip(bodies, ((0.0, 0.0, 0.5), (OFFSET[0], OFFSET[1], OFFSET[2] + lift)), strict=True):
            pose = coal.Transform3s(turn, turn @ np.array(at) + [x, y, 0.0])
            found = coal.distance(body, pose, box, place, coal.DistanceRequest(), coal.DistanceResult())
            result = min(result, found)
    return result
