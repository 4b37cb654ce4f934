"""Meshcat and Pinocchio's visualizers, imported without packages that runs do not use."""

from rnc_pin.visualization.deferred_imports import deferred_imports

with deferred_imports({"viser": (), "trimesh": (), "imageio": (), "IPython.display": ("HTML",)}):
    import meshcat
    import meshcat.geometry as mg
    from pinocchio.visualize import BaseVisualizer
    from pinocchio.visualize.meshcat_visualizer import DaeMeshGeometry, MeshcatVisualizer

__all__ = ["BaseVisualizer", "DaeMeshGeometry", "MeshcatVisualizer", "meshcat", "mg"]
