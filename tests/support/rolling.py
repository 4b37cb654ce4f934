"""One rigid body that rolls, and rates by differences."""

import numpy as np
import pinocchio as pin

import rnc_pin as rnc
from bodies import add_body

STEP = 1e-4  # [s]; differences of the fourth order
GRAVITY = np.array([0.0, 0.0, -9.81])


def rigid_body(mass=2.0, moments=(0.02, 0.03, 0.04), lever=(0.0, 0.0, 0.0), turned=(0.0, 0.0, 0.0), gravity=GRAVITY):
    """One body on a free base."""
    model = pin.Model()
    model.name = "body"
    R = pin.rpy.rpyToMatrix(np.array(turned))
    inertia = pin.Inertia(mass, np.array(lever), R @ np.diag(moments) @ R.T)
    add_body(model, "root_joint", "FreeFlyer", inertia, frame="body")
    model.gravity.linear = gravity
    return rnc.Robot(model)


def slope(model, function, q, v):
    """Rate of an array along v, by differences."""
    near, far = (
        (function(pin.integrate(model, q, h * v)) - function(pin.integrate(model, q, -h * v))) / (2 * h)
        for h in (STEP, 2 * STEP)
    )
    return (4 * near - far) / 3
