"""Maps, points and trajectories on disk: versioned, written whole or not at all."""
