"""Distances between the links of a robot and to obstacles, with exact rates, by coal on Pinocchio's collision model."""

from rnc_pin.collision.collision_distances import CollisionDistances
from rnc_pin.collision.continuous_distances import ContinuousDistances, continuous_distances
from rnc_pin.collision.obstacle import Obstacle, ObstacleMotion, check_ignored_links, ground_shape, load_mesh_shape
from rnc_pin.collision.pair_distances import PairDistances
from rnc_pin.collision.pair_selection import LinkPair, OmittedPair, PairSelection, read_disabled_pairs

__all__ = [
    "CollisionDistances",
    "ContinuousDistances",
    "LinkPair",
    "Obstacle",
    "ObstacleMotion",
    "OmittedPair",
    "PairDistances",
    "PairSelection",
    "check_ignored_links",
    "continuous_distances",
    "ground_shape",
    "load_mesh_shape",
    "read_disabled_pairs",
]
