"""Redundancy of a family in one table: platforms in space with one or two arms of three to five links."""

import numpy as np
import pinocchio as pin

import rnc_pin as rnc


def platform(arms, links):
    """Platform that floats in the plane, and equal arms, whose links are 1 m long."""
    model = pin.Model()

    def add(parent, joint, name, x, size):
        index = model.addJoint(parent, joint, pin.SE3(np.eye(3), np.array([x, 0.0, 0.0])), name)
        model.appendBodyToJoint(index, pin.Inertia(size, np.zeros(3), size * np.eye(3)), pin.SE3.Identity())
        return index

    base = add(0, pin.JointModelPlanar(), "base", 0.0, 5.0)
    model.addFrame(pin.Frame("platform", base, 0, pin.SE3.Identity(), pin.FrameType.BODY))
    for side, place in (("left", -0.5), ("right", 0.5))[:arms]:
        last = base
        for k in range(links):
            last = add(last, pin.JointModelRZ(), f"{side}_{k + 1}", 1.0 if k else place, 1.0)
        tip = pin.SE3(np.eye(3), np.array([1.0, 0.0, 0.0]))
        model.addFrame(pin.Frame(f"{side}_hand", last, 0, tip, pin.FrameType.BODY))
    joints = list(model.names)[2:]
    return rnc.NonholonomicSystem(rnc.Robot(model), [rnc.MomentumConservation("base")], joints).reduce()


ROW = "{:4}  {:5}  {:7}  {:28}  {:5}  {:22}  {:>10}"
print(ROW.format("arms", "links", "motions", "use beside the left hand", "class", "rad for 1 rad or 1 m", "worst pose"))
for arms, links in ((arms, links) for arms in (1, 2) for links in (3, 4, 5)):
    uses = [[rnc.FrameYaw("platform")], [rnc.FramePosition("right_hand", "xy")]][:arms]
    found = rnc.explore(platform(arms, links), [rnc.FramePosition("left_hand", "xy")], uses)
    for use in found.rows:
        name = rnc.analysis.short_names(use.vertical)
        unit = 1.0 if name == "platform_yaw" else found.length  # angles of joints count by this length
        need, worst = (round(float(1.0 / (unit * value)), 2) for value in (use.singular_values[-1], use.smallest))
        print(ROW.format(arms, links, found.motions, name, use.redundancy_class, need, worst))
