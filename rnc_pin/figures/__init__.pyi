"""Exports of ``rnc_pin.figures``, which ``__init__.py`` imports at their first use."""

from .panel import MAX_LINES as MAX_LINES
from .panel import Labels as Labels
from .panel import Panel as Panel
from .panel import Series as Series
from .panel import Sheet as Sheet
from .panel import Size as Size
from .panel_figure import GroundPath as GroundPath
from .panel_figure import GroundPaths as GroundPaths
from .panel_figure import PlaneView as PlaneView
from .panel_figure import draw_paths as draw_paths
from .panel_figure import panel_figure as panel_figure
from .style import LegendEntry as LegendEntry
from .style import save as save
