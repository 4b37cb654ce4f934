"""Exports of ``rnc_pin.visualization``, which ``__init__.py`` imports at their first use."""

from .browser.page import mg as mg
from .drawn_state import DrawnModel as DrawnModel
from .drawn_state import DrawnState as DrawnState
from .drawn_state import View as View
from .drawn_state import recorded_states as recorded_states
from .loop_view import LiveView as LiveView
from .loop_view import LoopView as LoopView
from .loop_view import show as show
from .plots import plot_limits as plot_limits
from .plots import plot_top_view as plot_top_view
from .recording import Recording as Recording
from .recording import write_video as write_video
