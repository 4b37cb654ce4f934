"""Exports of ``rnc_pin.identification``, which ``__init__.py`` imports at their first use."""

from .calibration import Calibration as Calibration
from .calibration import PathError as PathError
from .calibration import calibrate as calibrate
from .comparison import Comparison as Comparison
from .comparison import Suspect as Suspect
from .comparison import compare as compare
from .dynamic_unknowns import BodyInertia as BodyInertia
from .dynamic_unknowns import CoulombFriction as CoulombFriction
from .dynamic_unknowns import EffortOffset as EffortOffset
from .dynamic_unknowns import EffortScale as EffortScale
from .dynamic_unknowns import MotorInertia as MotorInertia
from .dynamic_unknowns import ViscousFriction as ViscousFriction
from .excitation import Excitation as Excitation
from .excitation import excite as excite
from .inertial import EffortError as EffortError
from .inertial import Identification as Identification
from .inertial import WeakCombination as WeakCombination
from .inertial import identify as identify
from .unknowns import EncoderOffset as EncoderOffset
from .unknowns import EncoderScale as EncoderScale
from .unknowns import JointShift as JointShift
from .unknowns import JointTilt as JointTilt
from .unknowns import SensorPlace as SensorPlace
from .unknowns import TimeShift as TimeShift
from .unknowns import WheelRadius as WheelRadius
