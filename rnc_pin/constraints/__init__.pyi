"""Exports of ``rnc_pin.constraints``, which ``__init__.py`` imports at their first use."""

from rnc_pin.model.rows import Rows as Rows

from .couplings import AckermannSteering as AckermannSteering
from .couplings import JointCoupling as JointCoupling
from .couplings import LoopClosure as LoopClosure
from .ground_plane import GroundPlane as GroundPlane
from .momentum import MomentumConservation as MomentumConservation
from .pfaffian import FixedOutput as FixedOutput
from .pfaffian import Pfaffian as Pfaffian
from .pfaffian import PrescribedMotion as PrescribedMotion
from .rolling_body import Caster as Caster
from .rolling_body import RollingBall as RollingBall
from .rolling_body import RollingBody as RollingBody
from .surfaces import CurvedGround as CurvedGround
from .surfaces import CylindricalGround as CylindricalGround
from .surfaces import Ellipsoid as Ellipsoid
from .surfaces import Sphere as Sphere
from .surfaces import SphericalGround as SphericalGround
from .surfaces import Torus as Torus
from .wheels_and_blades import NoSideSlip as NoSideSlip
from .wheels_and_blades import RollingWheel as RollingWheel
