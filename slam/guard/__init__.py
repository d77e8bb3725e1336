"""What tells that a robot is lost, and where else it may be: the parts of `slam.lost.Guard`."""
