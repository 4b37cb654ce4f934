"""Constraints ``A v = 0`` or ``A v = mu``, which may depend on time: one file for each kind."""

from rnc_pin.constraints.ackermann_steering import AckermannSteering
from rnc_pin.constraints.body_shapes import Ellipsoid, Sphere, Torus
from rnc_pin.constraints.body_surface import BodySurface
from rnc_pin.constraints.caster import Caster
from rnc_pin.constraints.curved_grounds import CurvedGround, CylindricalGround, HeightField, SphericalGround
from rnc_pin.constraints.ground_plane import GroundPlane
from rnc_pin.constraints.joint_coupling import JointCoupling
from rnc_pin.constraints.line_shapes import Cone, Cylinder
from rnc_pin.constraints.loop_closure import LoopClosure
from rnc_pin.constraints.momentum import MomentumConservation
from rnc_pin.constraints.no_side_slip import NoSideSlip
from rnc_pin.constraints.pfaffian import Pfaffian
from rnc_pin.constraints.prescribed_motion import PrescribedMotion
from rnc_pin.constraints.rolling_ball import RollingBall
from rnc_pin.constraints.rolling_body import RollingBody
from rnc_pin.constraints.rolling_wheel import RollingWheel
from rnc_pin.constraints.wheel_rows import RollingRows
from rnc_pin.model.rows import Rows

__all__ = [
    "AckermannSteering",
    "BodySurface",
    "Caster",
    "Cone",
    "CurvedGround",
    "Cylinder",
    "CylindricalGround",
    "Ellipsoid",
    "GroundPlane",
    "HeightField",
    "JointCoupling",
    "LoopClosure",
    "MomentumConservation",
    "NoSideSlip",
    "Pfaffian",
    "PrescribedMotion",
    "RollingBall",
    "RollingBody",
    "RollingRows",
    "RollingWheel",
    "Rows",
    "Sphere",
    "SphericalGround",
    "Torus",
]
