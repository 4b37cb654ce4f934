"""Exports of ``rnc_pin.lab.calibration``, which ``__init__.py`` imports at their first use."""

from .base_parameters import BaseParameters as BaseParameters
from .base_parameters import base_parameters as base_parameters
from .calibration import Calibration as Calibration
from .calibration import Comparison as Comparison
from .calibration import PathError as PathError
from .calibration import Replay as Replay
from .calibration import calibrate as calibrate
from .calibration import compare as compare
from .unknowns import EncoderOffset as EncoderOffset
from .unknowns import EncoderScale as EncoderScale
from .unknowns import JointShift as JointShift
from .unknowns import SensorPlace as SensorPlace
from .unknowns import TimeShift as TimeShift
from .unknowns import WheelRadius as WheelRadius
