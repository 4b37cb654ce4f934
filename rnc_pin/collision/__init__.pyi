"""Exports of ``rnc_pin.collision``, which ``__init__.py`` imports at their first use."""

from .collision_distances import CollisionDistances as CollisionDistances
from .continuous_distances import ContinuousDistances as ContinuousDistances
from .continuous_distances import continuous_distances as continuous_distances
from .occupied_cells import OccupancyMap as OccupancyMap
from .occupied_cells import cells_around as cells_around
from .occupied_cells import load_map as load_map
from .shapes import LinkPair as LinkPair
from .shapes import Obstacle as Obstacle
from .shapes import ObstacleMotion as ObstacleMotion
from .shapes import OmittedPair as OmittedPair
from .shapes import PairDistances as PairDistances
from .shapes import PairSelection as PairSelection
from .shapes import check_ignored_links as check_ignored_links
from .shapes import ground_shape as ground_shape
from .shapes import load_mesh_shape as load_mesh_shape
