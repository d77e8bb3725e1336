"""Names in `models/kitasap2/kitasap2.xml`, as they read once the robot stands in a place."""

PREFIX = "kitasap2/"
"""Put before every name of the robot when it is attached to a place, so that no user's name clashes."""

BASE = PREFIX + "base"
HAND = PREFIX + "hand"
GRIP = PREFIX + "grip"
WHEELS = (PREFIX + "left_wheel", PREFIX + "right_wheel")
"""Joints, actuators, encoders and bodies alike; left, right, in this order always."""
TIRES = (PREFIX + "left_tire", PREFIX + "right_tire")
LASER = PREFIX + "laser"
"""The site at the origin of the laser, x forward."""

START = "start"
"""Site of a place where the robot stands at first."""
TRACK_PREFIX = "track_"
"""Sites of a place that make its scripted track, in the order of their names."""


LEGS = ("left_leg", "right_leg")
"""Bodies of a person's own file, left, right, in this order always."""


def person(index: int) -> str:
    """Prefix of one person's bodies in a simulated place."""
    return f"person_{index}/"


def beam(index: int) -> str:
    """Name of one beam's site and sensor in the robot's own file."""
    return f"lrs_{index:04d}"
