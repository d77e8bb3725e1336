"""How far estimated poses are from true or reference ones. No estimator imports this."""

from slam.metrics.absolute import (
    AbsoluteErrors,
    absolute_errors,
    absolute_trajectory_error_m,
    alignment,
    pose_errors,
)
from slam.metrics.relation_files import read_relations, write_relations
from slam.metrics.relations import (
    LOOP_AFTER_S,
    LOOP_WITHIN_M,
    RelationErrors,
    Relations,
    built_relations,
    relation_errors,
)
from slam.metrics.relative import (
    RelativeErrors,
    index_pairs,
    relative_errors,
    time_pairs,
    way_pairs,
)
from slam.metrics.spread import Spread

__all__ = [
    "LOOP_AFTER_S",
    "LOOP_WITHIN_M",
    "AbsoluteErrors",
    "RelationErrors",
    "Relations",
    "RelativeErrors",
    "Spread",
    "absolute_errors",
    "absolute_trajectory_error_m",
    "alignment",
    "built_relations",
    "index_pairs",
    "pose_errors",
    "read_relations",
    "relation_errors",
    "relative_errors",
    "time_pairs",
    "way_pairs",
    "write_relations",
]
