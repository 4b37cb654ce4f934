"""Exports of ``rnc_pin.visualization``, which ``__init__.py`` imports at their first use."""

from .drawn_model import DrawnModel as DrawnModel
from .drawn_state import DrawnState as DrawnState
from .drawn_state import recorded_states as recorded_states
from .live import LiveView as LiveView
from .live import MeshcatViewer as MeshcatViewer
from .loop_view import LoopView as LoopView
from .loop_view import show as show
from .meshcat_library import mg as mg
from .recording import Recording as Recording
from .recording import write_frames as write_frames
from .recording import write_video as write_video
from .run_plots import plot_limits as plot_limits
from .run_plots import plot_top_view as plot_top_view
from .sweep_plots import Histogram as Histogram
from .sweep_plots import plot_distributions as plot_distributions
from .view import View as View
