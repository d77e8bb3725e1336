"""Sparse pose graphs in the plane: least squares that wrong loop closures do not bend."""

from slam.pose_graph.g2o import read_g2o, write_g2o
from slam.pose_graph.graph import PoseGraph, Start
from slam.pose_graph.robust import EdgeKernel, PoseGraphConfig
from slam.pose_graph.solution import GraphConsistency, PoseGraphSolution

__all__ = [
    "EdgeKernel",
    "GraphConsistency",
    "PoseGraph",
    "PoseGraphConfig",
    "PoseGraphSolution",
    "Start",
    "read_g2o",
    "write_g2o",
]
