"""When one of the places where the robot may be is sure."""

from __future__ import annotations

import math
from dataclasses import dataclass

from slam.surface.segment_map import SegmentMap


@dataclass(frozen=True)
class HypothesesConfig:
    """How `Hypotheses` carries places along, and when one is sure.

    max_places: carried to the next scan. max_views: scans summed over. view_m, view_rad: of a scan
    and the views from nearer to it than both, the scan alone counts, and is remembered where there
    are none: the same view twice is no second witness.
    drift_m, drift_rad: by how much the wheels may be wrong between two views.
    min_views: through which a place has to have been the best one. beats: by how many times the
    margin a place must be better than one believed, beaten_scans: through how many scans in a row.
    min_margin, min_share: of log-likelihood, by which the next best place must be worse, and as a
    share of what the best leaves unexplained. min_margin_per_view: more of it for each view after
    the first: where a map made of scans or cells errs, it does so in all views alike.
    max_unexplained: more than that is sure of nothing. strange_views: instead of min_views where
    more is left unexplained than usual, by people or by another building, or where beams went
    through walls, by so much more than is usual as slack; where both is so, nothing is sure. 0: not
    asked. around_m, around_rad: between the first of these views and the last the robot went or
    turned so far. chosen on the Intel, ACES and Freiburg logs.
    """

    max_places: int = 12
    max_views: int = 6
    view_m: float = 0.1
    view_rad: float = math.radians(5.0)
    drift_m: float = 0.15
    drift_rad: float = math.radians(6.0)
    min_views: int = 1
    beats: float = 1.0
    beaten_scans: int = 1
    min_margin: float = 10.0
    min_share: float = 0.05
    min_margin_per_view: float = 0.0
    max_unexplained: float = 1.2
    strange_views: int = 3
    slack: float = 0.02
    around_m: float = 0.5
    around_rad: float = math.radians(60.0)

    @staticmethod
    def fit_for(segment_map: SegmentMap) -> HypothesesConfig:
        """As it is for a map that is exactly known; more careful for one that was made of scans.

        Such a map need not show all that the robot may see: a corridor on it may fit a scan of
        another one that it lacks, for a while, and one place after another then looks best. chosen
        on the second half of the Intel log, of which the first half's map lacks a third.
        """
        if segment_map.is_exact:
            return HypothesesConfig()
        return HypothesesConfig(
            view_m=0.3,
            view_rad=math.radians(15.0),
            drift_m=0.3,
            drift_rad=math.radians(12.0),
            min_views=5,
            beats=2.0,
            beaten_scans=2,
            min_margin=12.0,
            min_share=0.2,
            min_margin_per_view=12.0,
            max_unexplained=0.8,
            strange_views=0,
        )
