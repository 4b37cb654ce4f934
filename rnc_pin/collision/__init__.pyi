"""Exports of ``rnc_pin.collision``, which ``__init__.py`` imports at their first use."""

from .collision_distances import CollisionDistances as CollisionDistances
from .continuous_distances import ContinuousDistances as ContinuousDistances
from .continuous_distances import DistanceCurves as DistanceCurves
from .continuous_distances import continuous_distances as continuous_distances
from .obstacle import Obstacle as Obstacle
from .obstacle import ObstacleMotion as ObstacleMotion
from .obstacle import check_ignored_links as check_ignored_links
from .obstacle import ground_shape as ground_shape
from .obstacle import load_mesh_shape as load_mesh_shape
from .occupancy_map import OccupancyMap as OccupancyMap
from .occupancy_map import load_map as load_map
from .occupied_cells import OccupiedCells as OccupiedCells
from .occupied_cells import cells_around as cells_around
from .occupied_cells import load_cells as load_cells
from .pair_measurement import PairDistances as PairDistances
from .pair_selection import LinkPair as LinkPair
from .pair_selection import OmittedPair as OmittedPair
from .pair_selection import PairSelection as PairSelection
from .pair_selection import read_disabled_pairs as read_disabled_pairs
