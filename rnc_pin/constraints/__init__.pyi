"""Exports of ``rnc_pin.constraints``, which ``__init__.py`` imports at their first use."""

from rnc_pin.model.rows import Rows as Rows

from .blades_and_casters import Caster as Caster
from .blades_and_casters import NoSideSlip as NoSideSlip
from .body_shapes import Ellipsoid as Ellipsoid
from .body_shapes import Sphere as Sphere
from .body_shapes import Torus as Torus
from .couplings import AckermannSteering as AckermannSteering
from .couplings import JointCoupling as JointCoupling
from .couplings import LoopClosure as LoopClosure
from .curved_grounds import CurvedGround as CurvedGround
from .curved_grounds import CylindricalGround as CylindricalGround
from .curved_grounds import SphericalGround as SphericalGround
from .ground_plane import GroundPlane as GroundPlane
from .momentum import MomentumConservation as MomentumConservation
from .pfaffian import FixedOutput as FixedOutput
from .pfaffian import Pfaffian as Pfaffian
from .pfaffian import PrescribedMotion as PrescribedMotion
from .rolling_body import RollingBall as RollingBall
from .rolling_body import RollingBody as RollingBody
from .rolling_wheel import RollingWheel as RollingWheel
