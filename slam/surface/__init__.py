"""Walls learnt from points: segments, surfels, and maps of surfaces that scans are matched with."""
